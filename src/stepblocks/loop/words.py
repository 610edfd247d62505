"""Covariates, units and figures as people read them."""

import math

import numpy as np

from stepblocks.loop.channels import CHANNELS_IN_WORDS
from stepblocks.quantities import format_column_label
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.forward import PEAK_FORCE, SPEED_OVER_LOAD, TOGETHER

# factor and unit in which people read a parameter, by the unit that the parameter has
_READABLE_UNITS = {
    "m": (1e6, "µm"),
    "N": (1e3, "mN"),
    "s": (1e3, "ms"),
    "m/s": (1e3, "mm/s"),
    "rad": (1e3, "mrad"),
    "N/m": (1e-3, "N/mm"),
}
_LARGEST_READABLE = 1e3  # figure from which the plain unit is used
# units of differences along a covariate by the end of its name, the longest first
_COVARIATE_UNITS = {
    "_mm_s": "(mm/s)",
    "run_order": "trial",
    "_pct": "%",
    "_um": "um",
    "_c": "K",
    "_n": "N",
    "_s": "s",
}
_COVARIATES = {
    "height_um": "the height",
    "load_n": "the load",
    "speed_mm_s": "the speed",
    "run_order": "the order of the run",
    "temperature_c": "the temperature",
    "humidity_pct": "the humidity",
    "previous_load_n": "the load of the trial before",
    "previous_height_um": "the height of the step before",
    "passes_of_block": "the passes over a block",
    "pause_s": "the pause before a trial",
    "trials_since_rest": "the trials since a rest",
    PEAK_FORCE: "the peak force",
    SPEED_OVER_LOAD: "speed over load",
    "none": "nothing that is set",
    "block": "the block",
}


# effects that follow no covariate, so that the name has none to leave out
_UNFOLLOWED = ("", "none", "block")
# how the shapes of effects are said before the covariate that they run over
_SHAPES = {"smooth": "a change of", "weighed": "", "trend": "a line of"}


def convert_name_to_words(name: str) -> str:
    """Write the name of a channel, effect or constant in words."""
    if name in CHANNELS_IN_WORDS:
        return CHANNELS_IN_WORDS[name]
    words = name.replace("ln_", "").replace("~", ", ").replace("_", " ")
    return words.replace("[", " of ").replace("]", "").strip()


def format_effect_name(effect_id: str, covariate: str = "") -> str:
    """Name an effect in words by its name in result.json.

    Parameters
    ----------
    effect_id : str
    covariate : str
        What the effect follows, as its record has it; empty where it has no record.
    """
    ending = f"_{covariate}"
    if covariate in _UNFOLLOWED or ending not in effect_id:
        return convert_name_to_words(effect_id)
    plain = convert_name_to_words(effect_id.replace(ending, ""))
    for shape, words in _SHAPES.items():
        plain = plain.replace(shape, words)
    return f"{plain.strip()} over {describe_covariate(covariate)}"


def capitalise_first_letter(text: str) -> str:
    """Return a text with a capital letter, as a sentence or a line begins."""
    return text[0].upper() + text[1:]


def describe_covariate(covariate: str) -> str:
    """Name what an effect follows; a column that only this session has keeps its own name."""
    return " times ".join(map(_describe_single_covariate, covariate.split(TOGETHER)))


def _describe_single_covariate(covariate: str) -> str:
    """Name one covariate in words, without its unit."""
    if covariate in _COVARIATES:
        return _COVARIATES[covariate]
    return format_column_label(covariate).partition(",")[0]


def format_in_readable_unit(value: float, unit: str, half_width: float = 0.0) -> str:
    """Write a figure of a parameter in the unit in which people read it.

    Parameters
    ----------
    value : float
    unit : str
        Unit of `value`.
    half_width : float
        Half width of its interval. The figure has the decimals that give this two digits, or three
        digits where it is zero.
    """
    plain_unit = "" if unit == "1" else unit
    factor, shown_unit = _READABLE_UNITS.get(unit, (1.0, plain_unit))
    if unit in _READABLE_UNITS and abs(value * factor) >= _LARGEST_READABLE:
        factor, shown_unit = 1.0, unit
    text = f"{value * factor:.3g}"
    if half_width > 0.0:
        decimals = 1 - math.floor(math.log10(half_width * factor))
        # adding zero takes the sign from a figure that is rounded to zero
        rounded = round(value * factor, decimals) + 0.0
        text = f"{rounded:.{max(decimals, 0)}f}"
    return f"{text} {shown_unit}".rstrip()


def get_difference_unit(covariate: str) -> str:
    """Return the unit of a difference along a covariate; the covariate's name if none is known."""
    for ending, unit in _COVARIATE_UNITS.items():
        if covariate.endswith(ending):
            return unit
    return covariate


def find_slope_factor_and_unit(covariate_range: CovariateRange) -> tuple[float, str]:
    """Find the factor from a slope per half range to a slope per unit, and the unit of the latter.

    For a pair of covariates both are products.
    """
    if covariate_range.is_grouped:
        return find_slope_factor_and_unit(covariate_range.pair[1])
    if covariate_range.pair:
        first_factor, first_unit = find_slope_factor_and_unit(covariate_range.pair[0])
        second_factor, second_unit = find_slope_factor_and_unit(covariate_range.pair[1])
        return first_factor * second_factor, f"{first_unit} {second_unit}"
    if covariate_range.log:
        return 2.0 / float(
            np.log(covariate_range.high / covariate_range.low)
        ), f"1/ln {covariate_range.name}"
    return 2.0 / (
        covariate_range.high - covariate_range.low
    ), f"1/{get_difference_unit(covariate_range.name)}"
