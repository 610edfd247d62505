"""A line for each label: a slot follows a number under one label otherwise than under another."""

from dataclasses import replace

from stepblocks.lawsearch.law import Law, SizedChange
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.grammar.parts import (
    format_covariate_name,
    make_amplitudes,
    make_size_from_columns,
)
from stepblocks.rig.effects.grammar.slots import MAIN_SLOTS, SLOT_MOVES


def list_group_line_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the lines of a slot over a number, one for each label of another column.

    Over a number that is laid out by its logarithm they are powers, and the lines over the number
    itself stand beside them.
    """
    if slot not in MAIN_SLOTS or not covariate.is_grouped:
        return []
    groups, number = covariate.pair
    if not number.log:
        return [_make_group_line_law(slot, covariate)]
    straight = replace(covariate, pair=(groups, replace(number, log=False)))
    powers = _make_group_line_law(slot, covariate)
    lines = _make_group_line_law(slot, straight)
    return [powers, replace(lines, id=f"{lines.id}~line", rank=17)]


def _make_group_line_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that follows a number along a line of its own for each label."""
    move = SLOT_MOVES[slot]
    groups, number = covariate.pair
    curve, followed = "a line", number.name
    if number.log:
        curve, followed = "a power of it", f"ln {number.name}"
    slopes = [f"slope[{label}]" for label in groups.labels]
    levels = [f"level[{label}]" for label in groups.labels[1:]]
    names = (*slopes, *levels)
    lines = make_size_from_columns(covariate.build_group_line_columns, names)
    change = SizedChange(move.change, lines)
    description = (
        f"{move.words} follows the {format_covariate_name(number)} along {curve} for each "
        f"{groups.name}, slopes, and levels above the first:"
    )
    return Law(
        f"trend_{slot}_{covariate.name}",
        f"{move.form}, g a straight line over {followed} for each {groups.name}",
        make_amplitudes(names),
        change,
        move.slot,
        covariate.name,
        named=False,
        rank=16,
        description=description,
        shape="group_lines",
        refines=(groups.name, number.name),
    )
