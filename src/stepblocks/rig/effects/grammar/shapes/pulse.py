"""A pulse: a slot is another over a stretch of trials, and then as before."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.rig.effects.grammar.covariates import RUN, CovariateRange
from stepblocks.rig.effects.grammar.parts import can_locate_change
from stepblocks.rig.effects.grammar.shapes.jump import list_start_places, make_step_size_function
from stepblocks.rig.effects.grammar.slots import JUMPING_SLOTS, MAIN_SLOTS, SLOT_MOVES
from stepblocks.rig.state import Floats

_FROM, _UNTIL = "from_trial", "until_trial"
_PLACES = 8  # along the run, between any two of which a search looks for a pulse


def list_pulse_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the pulse of a slot along the run."""
    if covariate.name != RUN or slot not in MAIN_SLOTS:
        return []
    if not can_locate_change(covariate):
        return []
    return [_make_pulse_law(slot, covariate)]


def _make_pulse_end_parameter(
    parameter_name: str, covariate: CovariateRange, run_share: float
) -> Parameter:
    """Make the parameter of one end of a pulse; a fit starts it at a share of the run."""
    reach = covariate.high - covariate.low
    start = covariate.low + run_share * reach
    return Parameter(parameter_name, "1", start, covariate.low, covariate.high, 0.02 * reach)


def _make_pulse_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that has another level from one trial to a later one."""
    move = SLOT_MOVES[slot]
    rise = make_step_size_function(covariate, ("step", "back"), (_FROM, _UNTIL))

    def compute_pulse_levels(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        """Return the level of the pulse in each trial, shape (n,)."""
        return rise(column, {**values, "back": 0.0})

    size = Parameter("step", "1", 0.0, -3.0, 3.0, 0.1)
    begin = _make_pulse_end_parameter(_FROM, covariate, 0.4)
    end = _make_pulse_end_parameter(_UNTIL, covariate, 0.6)
    places = np.arange(0.5, _PLACES) / _PLACES
    stretches = np.array(list(combinations(places.tolist(), 2)))
    change = SizedChange(move.change, compute_pulse_levels)
    description = f"{move.words} changes for a stretch of the run: by {{}}, from trial {{}} to {{}}"
    return Law(
        f"step_{slot}_{covariate.name}~pulse",
        f"{move.form}, g over a stretch of the run",
        (size, begin, end),
        change,
        move.slot,
        covariate.name,
        list_start_places(covariate, (_FROM, _UNTIL), stretches),
        named=slot in JUMPING_SLOTS,
        rank=15,
        description=description,
        steps=(_FROM, _UNTIL),
        shape="pulse",
    )
