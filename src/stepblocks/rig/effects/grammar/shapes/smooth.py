"""A smooth over numbers, which claims no law, and a level for each label."""

from stepblocks.lawsearch.law import Law, SizedChange
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.grammar.parts import make_amplitudes, make_size_from_columns
from stepblocks.rig.effects.grammar.slots import JUMPING_SLOTS, SLOT_MOVES


def list_smooth_laws(slot: str, covariate: CovariateRange) -> list[Law]:
    """List the smooth of a slot over numbers, or its levels over labels."""
    if covariate.pair:
        return []
    if covariate.labels and covariate.name != "block":
        return [_make_label_levels_law(slot, covariate)]
    return [_make_smooth_law(slot, covariate)]


def _make_label_levels_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that has a level for each label."""
    move = SLOT_MOVES[slot]
    reference, *further = covariate.labels
    names = tuple(f"g[{label}]" for label in further)
    change = SizedChange(move.change, make_size_from_columns(covariate.build_smooth_columns, names))
    description = (
        f"{move.words} has a level for each {covariate.name}, by ln above that of {reference}:"
    )
    return Law(
        f"smooth_{slot}_{covariate.name}",
        f"{move.form}, g a level for each {covariate.name}",
        make_amplitudes(names),
        change,
        move.slot,
        covariate.name,
        named=slot in JUMPING_SLOTS,
        rank=20,
        description=description,
        shape="levels",
    )


def _make_smooth_law(slot: str, covariate: CovariateRange) -> Law:
    """Make the law of a slot that follows a covariate smoothly, or has any level on each block."""
    move = SLOT_MOVES[slot]
    names = tuple(f"g{number}" for number in range(1, covariate.smooth_column_count + 1))
    change = SizedChange(move.change, make_size_from_columns(covariate.build_smooth_columns, names))
    return Law(
        f"smooth_{slot}_{covariate.name}",
        f"{move.form}, g smooth over {covariate.name}",
        make_amplitudes(names),
        change,
        move.slot,
        covariate.name,
        named=False,
        rank=20,
    )
