"""An exponential approach: what begins elsewhere and settles along the run."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.rig.effects.grammar.covariates import RUN, CovariateRange
from stepblocks.rig.effects.grammar.parts import (
    can_locate_change,
    convert_to_floats,
    make_amplitude,
)
from stepblocks.rig.effects.grammar.slots import MAIN_SLOTS, SLOT_MOVES
from stepblocks.rig.state import Floats

_SHARES = (0.04, 0.1, 0.25)  # of the run, over which a search lets a slot settle
_LEAST_SHARE, _LARGEST_SHARE = 0.01, 0.5  # over which it may settle; later it is a drift


def list_settling_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the settling of a slot along the run; that of friction has a name of its own."""
    if covariate.name != RUN or slot not in MAIN_SLOTS or slot == "friction":
        return []
    if not can_locate_change(covariate):
        return []
    return [_make_settling_law(slot, covariate)]


def _make_settling_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that settles within half the run; a slower change is a drift."""
    move = SLOT_MOVES[slot]
    reach = covariate.high - covariate.low

    def compute_settling_excess(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        """Return the excess that is left in each trial, shape (n,)."""
        passed = convert_to_floats(column) - covariate.low
        fading = np.exp(-passed / values["settling_trials"])
        return np.asarray(values["excess"] * fading)

    duration = Parameter(
        "settling_trials",
        "1",
        start=_SHARES[1] * reach,
        low=_LEAST_SHARE * reach,
        high=_LARGEST_SHARE * reach,
        scale=0.02 * reach,
    )
    shapes = tuple({duration.name: share * reach} for share in _SHARES)
    change = SizedChange(move.change, compute_settling_excess)
    description = f"{move.words} settles along the run: excess at first {{}}, trials to settle {{}}"
    return Law(
        f"trend_{slot}_{covariate.name}~settling",
        f"{move.form}, g = s exp(-n / n0)",
        (make_amplitude("excess"), duration),
        change,
        move.slot,
        covariate.name,
        shapes,
        named=False,
        rank=13,
        description=description,
        shape="settling",
    )
