"""A swing: a slot goes up and down along the run."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.rig.effects.grammar.covariates import RUN, CovariateRange
from stepblocks.rig.effects.grammar.parts import can_locate_change, convert_to_floats
from stepblocks.rig.effects.grammar.slots import JUMPING_SLOTS, SLOT_MOVES
from stepblocks.rig.state import Floats

_SHORTEST_PERIOD = 6.0  # trials
_MOST_TURNS = 500  # half turns of a swing over the run: of thousands of trials more are most work
_SWINGING = (*JUMPING_SLOTS, "seen_load", "stiffness", "gain", "zero")
_MOST_TURNS_BESIDE = 40  # of slots that do not scatter from trial to trial


def list_swing_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the swing of a slot along the run."""
    if covariate.name != RUN or slot not in _SWINGING or not can_locate_change(covariate):
        return []
    return [_make_swing_law(slot, covariate)]


def _make_swing_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that swings along the run.

    Any period from a few trials to three quarters of the run may be found: what went up and down
    once need not come back.
    """
    move = SLOT_MOVES[slot]
    is_named = slot in JUMPING_SLOTS
    reach = covariate.high - covariate.low
    cosine = Parameter("cosine", "1", 0.0, -2.0, 2.0, 0.05)
    period = Parameter("period_trials", "1", 0.5 * reach, 0.8 * _SHORTEST_PERIOD, 0.75 * reach, 0.5)

    def compute_swing(order: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        """Return the deflection of the swing in each trial, shape (n,)."""
        phase = 2.0 * np.pi * convert_to_floats(order) / values["period_trials"]
        in_phase = values["cosine"] * np.cos(phase)
        in_quadrature = values["sine"] * np.sin(phase)
        return np.asarray(in_phase + in_quadrature)

    # half a turn over the whole run apart, so that a fit begins within its own valley
    most_turns = _MOST_TURNS_BESIDE
    if is_named:
        most_turns = _MOST_TURNS
    last_turn = min(int(2.0 * reach / _SHORTEST_PERIOD), most_turns)
    periods = 2.0 * reach / np.arange(3, last_turn + 1)
    shapes = tuple({period.name: duration} for duration in periods.tolist())
    sine = replace(cosine, name="sine")
    change = SizedChange(move.change, compute_swing)
    return Law(
        f"periodic_{slot}_{covariate.name}",
        f"{move.form}, g = a cos(2 pi n / P) + b sin(2 pi n / P)",
        (cosine, sine, period),
        change,
        move.slot,
        covariate.name,
        shapes,
        named=is_named,
        rank=12,
        description=f"{move.words} swings along the run: cosine {{}}, sine {{}}, every {{}} trials",
        shape="swing",
    )
