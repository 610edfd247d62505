"""A threshold: a slot follows a covariate on one side of a place, and is constant on the other."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.rig.effects.grammar.covariates import RUN, CovariateRange
from stepblocks.rig.effects.grammar.parts import (
    can_locate_change,
    convert_to_floats,
    format_covariate_name,
    is_nearly_binary,
    make_amplitude,
)
from stepblocks.rig.effects.grammar.slots import MAIN_SLOTS, SLOT_MOVES
from stepblocks.rig.state import Floats

_SHARES = (0.2, 0.35, 0.5, 0.65, 0.8)  # of the range, at which a search places a threshold
_EDGE = 0.1  # share of the range at either end where no threshold can be seen


def list_threshold_and_saturation_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List a slot that changes above a place of a covariate, and one that changes up to it."""
    if slot not in MAIN_SLOTS or not can_locate_change(covariate) or is_nearly_binary(covariate):
        return []
    return [_make_threshold_law(slot, covariate), _make_saturation_law(slot, covariate)]


def _make_threshold_parameter(covariate: CovariateRange) -> Parameter:
    """Make the parameter of the place beyond, or up to, which a slot changes."""
    reach = covariate.high - covariate.low
    middle = covariate.low + 0.5 * reach
    lowest = covariate.low + _EDGE * reach
    highest = covariate.high - _EDGE * reach
    return Parameter("at", "1", middle, lowest, highest, 0.05 * reach)


def _list_threshold_starts(covariate: CovariateRange) -> tuple[dict[str, float], ...]:
    """List the places at which a search begins."""
    reach = covariate.high - covariate.low
    return tuple({"at": covariate.low + share * reach} for share in _SHARES)


def _make_threshold_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that changes along a line beyond a place."""
    move = SLOT_MOVES[slot]
    high = covariate.high

    def compute_change_beyond_place(
        column: NDArray[np.generic], values: Mapping[str, float]
    ) -> Floats:
        """Return the change along the line in each trial, shape (n,)."""
        place = values["at"]
        numbers = convert_to_floats(column)
        beyond = np.clip(numbers, place, high) - place
        risen = values["rise"] * beyond / (high - place)
        return np.asarray(risen)

    change = SizedChange(move.change, compute_change_beyond_place)
    description = (
        f"{move.words} changes by {{}} up to the end of the range, "
        f"{_format_threshold_words(covariate)} {{}} on"
    )
    return Law(
        f"trend_{slot}_{covariate.name}~threshold",
        f"{move.form}, g = s (x - x0) / ({high:.3g} - x0) above x0, x the {covariate.name}",
        (make_amplitude("rise"), _make_threshold_parameter(covariate)),
        change,
        move.slot,
        covariate.name,
        _list_threshold_starts(covariate),
        named=False,
        rank=14,
        description=description,
        shape="threshold",
    )


def _make_saturation_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that changes along a line up to a place, and not beyond it."""
    move = SLOT_MOVES[slot]
    low = covariate.low

    def compute_change_up_to_place(
        column: NDArray[np.generic], values: Mapping[str, float]
    ) -> Floats:
        """Return the change along the line in each trial, shape (n,)."""
        place = values["at"]
        numbers = convert_to_floats(column)
        passed = np.clip(numbers, low, place) - low
        risen = values["rise"] * passed / (place - low)
        return np.asarray(risen)

    change = SizedChange(move.change, compute_change_up_to_place)
    description = (
        f"{move.words} changes by {{}} until it stays, {_format_threshold_words(covariate)} {{}} on"
    )
    return Law(
        f"trend_{slot}_{covariate.name}~saturation",
        f"{move.form}, g = s (x - {low:.3g}) / (x0 - {low:.3g}) up to x0, x the {covariate.name}",
        (make_amplitude("rise"), _make_threshold_parameter(covariate)),
        change,
        move.slot,
        covariate.name,
        _list_threshold_starts(covariate),
        named=False,
        rank=14,
        description=description,
        shape="saturation",
    )


def _format_threshold_words(covariate: CovariateRange) -> str:
    """Describe the threshold in words, to be followed by its value."""
    if covariate.name == RUN:
        return "from trial"
    return f"from a {format_covariate_name(covariate)} of"
