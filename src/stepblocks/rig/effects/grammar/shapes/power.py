"""A power of a covariate: g = p ln(x / x0)."""

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.rig.effects.grammar.covariates import RUN, CovariateRange
from stepblocks.rig.effects.grammar.parts import (
    convert_to_floats,
    format_covariate_name,
    make_size_from_columns,
)
from stepblocks.rig.effects.grammar.slots import MAIN_SLOTS, SLOT_MOVES
from stepblocks.rig.state import Floats

_LEAST_RATIO = 1.5  # of the ends of a range, below which a power is a straight line


def list_power_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the power of a slot over a covariate.

    A covariate that is laid out by its logarithm has it already: there a line is a power.
    """
    if slot not in MAIN_SLOTS or not covariate.is_number or covariate.distinct < 3:
        return []
    is_straight = covariate.low <= 0.0 or covariate.high < _LEAST_RATIO * covariate.low
    if is_straight or covariate.log or covariate.name == RUN:
        return []
    return [_make_power_law(slot, covariate)]


def _make_power_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a power of a covariate, 1 at the logarithmic middle of its range."""
    move = SLOT_MOVES[slot]
    middle = float(np.sqrt(covariate.low * covariate.high))

    def take_logarithm(column: NDArray[np.generic]) -> Floats:
        """Return the logarithm of the covariate over the middle of its range."""
        numbers = convert_to_floats(column)
        inside = np.clip(numbers, covariate.low, covariate.high)
        logarithm = np.log(inside / middle)
        return logarithm[:, None]

    exponent = Parameter("exponent", "1", 0.0, -3.0, 3.0, 0.05)
    change = SizedChange(move.change, make_size_from_columns(take_logarithm, (exponent.name,)))
    description = (
        f"{move.words} follows a power of the {format_covariate_name(covariate)}: exponent"
    )
    return Law(
        f"trend_{slot}_{covariate.name}~power",
        f"{move.form}, g = p ln({covariate.name} / {middle:.3g})",
        (exponent,),
        change,
        move.slot,
        covariate.name,
        named=False,
        rank=11,
        description=description,
        shape="power",
    )
