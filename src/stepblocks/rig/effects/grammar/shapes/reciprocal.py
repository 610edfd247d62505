"""A sum with the reciprocal of a covariate: g = s (x0 / x - 1)."""

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, SizedChange
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.grammar.parts import (
    convert_to_floats,
    format_covariate_name,
    make_amplitude,
    make_size_from_columns,
)
from stepblocks.rig.effects.grammar.slots import MAIN_SLOTS, SLOT_MOVES
from stepblocks.rig.state import Floats

_SET = ("height_um", "load_n", "speed_mm_s")
_LEAST_RATIO = 1.5  # of the ends of a range, below which a reciprocal is a straight line


def list_reciprocal_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the reciprocal of a slot over what is set on the bench."""
    if slot not in MAIN_SLOTS or covariate.name not in _SET or covariate.distinct < 3:
        return []
    if covariate.low <= 0.0 or covariate.high < _LEAST_RATIO * covariate.low:
        return []
    return [_make_reciprocal_law(slot, covariate)]


def _make_reciprocal_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a reciprocal of a covariate, zero at the logarithmic middle of its range."""
    move = SLOT_MOVES[slot]
    middle = float(np.sqrt(covariate.low * covariate.high))

    def compute_reciprocal(column: NDArray[np.generic]) -> Floats:
        """Return the reciprocal of the covariate, zero at the middle, shape (n, 1)."""
        numbers = convert_to_floats(column)
        inside = np.clip(numbers, covariate.low, covariate.high)
        excess = middle / inside - 1.0
        return excess[:, None]

    change = SizedChange(move.change, make_size_from_columns(compute_reciprocal, ("share",)))
    description = (
        f"{move.words} has a part that falls with the {format_covariate_name(covariate)} as "
        "its reciprocal: share"
    )
    return Law(
        f"trend_{slot}_{covariate.name}~reciprocal",
        f"{move.form}, g = s ({middle:.3g} / {covariate.name} - 1)",
        (make_amplitude("share"),),
        change,
        move.slot,
        covariate.name,
        named=False,
        rank=12,
        description=description,
        shape="reciprocal",
    )
