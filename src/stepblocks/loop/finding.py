"""The finding in one sentence, as a terminal, a report and result.json open with it."""

import math
from collections.abc import Iterator, Sequence
from functools import reduce

import numpy as np

from stepblocks.files.text import Document
from stepblocks.lawsearch.explain import Explanation, Finding, Verdict
from stepblocks.lawsearch.law import Law
from stepblocks.quantities import format_column_label
from stepblocks.rig.effects.smooth import CovariateRange
from stepblocks.rig.forward import PEAK_FORCE, SPEED_OVER_LOAD, TOGETHER

# a factor and a unit that people read, by the unit that a parameter has; from `_MANY` on the plain
# one
_MANY = 1e3
_READ = {
    "m": (1e6, "µm"),
    "N": (1e3, "mN"),
    "s": (1e3, "ms"),
    "m/s": (1e3, "mm/s"),
    "rad": (1e3, "mrad"),
    "N/m": (1e-3, "N/mm"),
}
# units of covariates by the ends of their names, the longest first
_UNITS = {
    "_mm_s": "(mm/s)",
    "run_order": "trial",
    "_pct": "%",
    "_um": "um",
    "_c": "K",
    "_n": "N",
    "_s": "s",
}
# what an effect follows, in words
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
# what a trial shows, in words, its residual a difference of logarithms or of numbers
CHANNELS_IN_WORDS = {
    "ln_energy": "vibration energy",
    "ln_peak_force": "peak force",
    "sliding_friction": "friction before the edge",
    "spring_constant": "stiffness of the ramp",
    "ln_ring_frequency": "pitch of the ring",
    "ln_decay_time": "decay of the ring",
    "normal_load_ratio": "normal force over set load",
}


def describe_covariate(name: str) -> str:
    """Say in words what an effect follows; a column that only this session has by its name."""
    return " times ".join(
        _COVARIATES.get(one, format_column_label(one).partition(",")[0])
        for one in name.split(TOGETHER)
    )


def format_value(value: float, unit: str, reach: float = 0.0) -> str:
    """Write a figure of a parameter in the unit that people read.

    It has three digits, or the decimals that give its interval, of half width `reach`, two digits.
    """
    factor, shown = _READ.get(unit, (1.0, "" if unit == "1" else unit))
    if unit in _READ and abs(value * factor) >= _MANY:
        factor, shown = 1.0, unit
    text = f"{value * factor:.3g}"
    if reach > 0.0:
        decimals = 1 - math.floor(math.log10(reach * factor))
        # adding zero takes the sign from what rounds to none
        text = f"{round(value * factor, decimals) + 0.0:.{max(decimals, 0)}f}"
    return f"{text} {shown}".rstrip()


def find_unit(covariate: str) -> str:
    """Return the unit of differences along a covariate; its name where none is known."""
    return next((unit for end, unit in _UNITS.items() if covariate.endswith(end)), covariate)


def find_slope_unit(where: CovariateRange) -> tuple[float, str]:
    """Return what a slope per half range is per unit of the covariate, and its unit."""
    if where.pair:
        (one, unit), (other, second) = map(find_slope_unit, where.pair)
        return one * other, f"{unit} {second}"
    if where.log:
        return 2.0 / float(np.log(where.high / where.low)), f"1/ln {where.name}"
    return 2.0 / (where.high - where.low), f"1/{find_unit(where.name)}"


def write_summary(document: Document) -> str:
    """Write verdict, number of trials and held-out error of the energy before and after."""
    before, after = (
        f"{document[part]['error']['ln_energy_rms']:.1%}" for part in ("nominal", "extended")
    )
    return f"{document['verdict']}, {document['trials_analysed']} trials, E_v {before} -> {after}"


def write_sentence(explanation: Explanation, document: Document) -> str:
    """Say what was found, how large, how far the error fell, and what noise leaves."""
    errors = format_errors(document)
    if explanation.verdict is Verdict.NONE:
        could = [
            f"{e['text']} of {format_value(e['value'], e['unit'])}"
            for e in document["could_have_shown"][:3]
        ]
        shown = f" (what would have shown: {', '.join(could)})" if could else ""
        return (
            f"No effect beyond noise was found{shown}; error of E_v "
            f"{errors['before']}, noise {errors['noise']}"
        )
    told = [hint.sentence for hint in explanation.hints]
    rivals = iter(document["rivals"])  # those of the first finding, then those of the next
    parts = told + [
        _describe_finding(f, entry, rivals, told)
        for f, entry in zip(explanation.findings, document["effects"], strict=True)
    ]
    if explanation.verdict is Verdict.UNEXPLAINED and explanation.reason not in (
        "",
        *(f.reason for f in explanation.findings),
    ):
        where = CHANNELS_IN_WORDS.get(explanation.channel, explanation.channel)
        parts.append(f"unexplained as a whole, as {explanation.reason}{where and f' in {where}'}")
    if any(hint.kind != "stick-slip" for hint in explanation.hints):
        parts.append("write down what differs between these trials")
    text = (
        "; ".join(dict.fromkeys(parts))
        or "The trials differ by more than noise would do, and no law is claimed"
    )
    change = (
        f"{errors['before']} -> {errors['after']} on new trials, "
        f"{errors['before_blocks']} -> {errors['after_blocks']} on new blocks"
        if explanation.findings
        else errors["before"]
    )
    apart = f"; {n} trial{'s' if n > 1 else ''} held apart" if (n := len(document["apart"])) else ""
    text = f"{text}{apart}; error of E_v {change}, noise {errors['noise']}"
    return text[0].upper() + text[1:]


def format_errors(document: Document) -> dict[str, str]:
    """Say the errors of E_v of both models, on trials and on blocks held out, as percentages."""
    extended = document["extended"]["error"]
    figures = {
        "before": document["nominal"]["error"]["ln_energy_rms"],
        "after": extended["ln_energy_rms"],
        "before_blocks": document["nominal"]["error"]["ln_energy_rms_blocks_left_out"],
        "after_blocks": extended["ln_energy_rms_blocks_left_out"],
        "noise": extended["noise_floor"]["ln_energy_rms"],
    }
    shown = {
        name: np.rint(100.0 * np.expm1(np.nan if v is None else v)) for name, v in figures.items()
    }
    # a model that errs by more beyond chance is not delivered
    return {
        name: "unknown"
        if np.isnan(value)
        else f"{value:.0f} % (by chance)"
        if value > shown[name.replace("after", "before")]
        else f"{value:.0f} %"
        for name, value in shown.items()
    }


def _describe_finding(
    finding: Finding, entry: Document, rivals: Iterator[Document], told: Sequence[str]
) -> str:
    # `told` is what the sentence has said before
    law = finding.effect
    others = [
        _describe_law(rival, one)
        for (rival, _, _), one in zip(finding.rivals, rivals, strict=False)
    ]
    if finding.verdict is Verdict.UNEXPLAINED or not law.description:
        why = f": {finding.reason}" if finding.reason not in ("", *told) else ""
        return f"{_describe_law(law)}, no law claimed{why}"
    text = _describe_law(law, entry)
    if finding.verdict is not Verdict.AMBIGUOUS:
        return text
    choices = [text, *(others[:2] or ["what some folds chose instead"])]
    return f"{', or '.join(choices)}; these trials cannot tell which"


def _describe_law(law: Law, entry: Document | None = None) -> str:
    # By its place alone where it has no words of its own, or no entry with its figures is given
    if not (entry and law.description):
        along = {"none": "is another", "block": "differs by block"}.get(
            law.covariate, f"follows {describe_covariate(law.covariate)}"
        )
        return f"{law.slot.replace('_', ' ')} {along}"
    figures = [
        f"{key[key.index('[') + 1 : -1] + ' ' if '[' in key else ''}"
        f"{format_value(p['value'], p['unit'])} ({format_value(p['low'], p['unit'])} to "
        f"{format_value(p['high'], p['unit'])})"
        for key, p in entry["parameters"].items()
    ]
    places = "" if "{}" in law.description else " " + ", ".join(["{}"] * len(figures))
    return reduce(
        lambda text, figure: text.replace("{}", figure, 1), figures, law.description + places
    )
