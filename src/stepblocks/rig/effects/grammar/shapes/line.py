"""A straight line: a slot follows a covariate, drifts along the run, or follows a product."""

from dataclasses import replace

from stepblocks.lawsearch.law import Law, SizedChange
from stepblocks.rig.effects.grammar.covariates import RUN, CovariateRange
from stepblocks.rig.effects.grammar.parts import (
    format_covariate_name,
    is_nearly_binary,
    make_amplitude,
    make_size_from_columns,
)
from stepblocks.rig.effects.grammar.slots import JUMPING_SLOTS, MAIN_SLOTS, SLOT_MOVES


def list_line_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the line of a slot over a covariate.

    Over a covariate that is laid out by its logarithm that is a power, and the line over its
    numbers stands beside it.
    """
    if covariate.labels or covariate.is_grouped:
        return []
    if is_nearly_binary(covariate) and not covariate.pair:
        return []
    laws = [_make_line_law(slot, covariate)]
    if covariate.log and slot in MAIN_SLOTS and covariate.distinct > 2:
        laws.append(_make_plain_line_law(slot, replace(covariate, log=False)))
    return laws


def _make_line_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that follows a covariate along a straight line."""
    move = SLOT_MOVES[slot]
    is_drift = covariate.name == RUN and slot in JUMPING_SLOTS
    followed = covariate.name
    if covariate.log:
        followed = f"ln {covariate.name}"
    slope = make_amplitude("slope")
    change = SizedChange(
        move.change, make_size_from_columns(covariate.build_line_column, (slope.name,))
    )
    shape = ""
    description = ""
    if is_drift:
        description = f"{move.words} drifts along the run, by ln"
    elif covariate.log:
        shape = "power"
        description = (
            f"{move.words} follows a power of the {format_covariate_name(covariate)}: by ln, "
            f"over half "
            "the range of the power"
        )
    elif not covariate.pair:
        shape = "line"
        description = (
            f"{move.words} follows the {format_covariate_name(covariate)} along a line, slope"
        )
    return Law(
        f"trend_{slot}_{covariate.name}",
        f"{move.form}, g a straight line over {followed}",
        (slope,),
        change,
        move.slot,
        covariate.name,
        named=is_drift,
        rank=10,
        description=description,
        shape=shape,
    )


def _make_plain_line_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a line over a covariate whose power is another law."""
    line = _make_line_law(slot, covariate)
    return replace(line, id=f"{line.id}~line", rank=11)
