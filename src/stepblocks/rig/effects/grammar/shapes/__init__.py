"""The registry of shapes: one file each, and each names all slots."""

from collections.abc import Callable

from stepblocks.lawsearch.law import Law
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.grammar.shapes.group_lines import list_group_lines
from stepblocks.rig.effects.grammar.shapes.jump import list_jumps
from stepblocks.rig.effects.grammar.shapes.line import list_lines
from stepblocks.rig.effects.grammar.shapes.power import list_powers
from stepblocks.rig.effects.grammar.shapes.pulse import list_pulses
from stepblocks.rig.effects.grammar.shapes.reciprocal import list_reciprocals
from stepblocks.rig.effects.grammar.shapes.settling import list_settlings
from stepblocks.rig.effects.grammar.shapes.smooth import list_smooths
from stepblocks.rig.effects.grammar.shapes.swing import list_swings
from stepblocks.rig.effects.grammar.shapes.threshold import list_thresholds

# takes the name of a slot and a covariate; lists no law where the shape makes no sense
ListLaws = Callable[[str, CovariateRange], list[Law]]

SHAPES: tuple[ListLaws, ...] = (
    list_lines,
    list_smooths,
    list_powers,
    list_reciprocals,
    list_settlings,
    list_thresholds,
    list_jumps,
    list_pulses,
    list_swings,
    list_group_lines,
)
