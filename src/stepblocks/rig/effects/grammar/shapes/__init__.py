"""The registry of shapes: one file each, and each names all slots."""

from collections.abc import Callable

from stepblocks.lawsearch.law import Law
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.grammar.shapes.group_lines import list_group_line_laws
from stepblocks.rig.effects.grammar.shapes.jump import list_jump_laws
from stepblocks.rig.effects.grammar.shapes.line import list_line_laws
from stepblocks.rig.effects.grammar.shapes.power import list_power_laws
from stepblocks.rig.effects.grammar.shapes.pulse import list_pulse_laws
from stepblocks.rig.effects.grammar.shapes.reciprocal import list_reciprocal_laws
from stepblocks.rig.effects.grammar.shapes.settling import list_settling_laws
from stepblocks.rig.effects.grammar.shapes.smooth import list_smooth_laws
from stepblocks.rig.effects.grammar.shapes.swing import list_swing_laws
from stepblocks.rig.effects.grammar.shapes.threshold import list_threshold_and_saturation_laws

# takes the name of a slot and a covariate; lists no law where the shape makes no sense
ListLaws = Callable[[str, CovariateRange], list[Law]]

SHAPES: tuple[ListLaws, ...] = (
    list_line_laws,
    list_smooth_laws,
    list_power_laws,
    list_reciprocal_laws,
    list_settling_laws,
    list_threshold_and_saturation_laws,
    list_jump_laws,
    list_pulse_laws,
    list_swing_laws,
    list_group_line_laws,
)
