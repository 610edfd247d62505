"""All effects that equations (1) and (2) lack and that have a name."""

from collections.abc import Sequence

from stepblocks.lawsearch.law import Law
from stepblocks.rig.effects.conversion import CONVERSION_LAWS
from stepblocks.rig.effects.friction import FRICTION_LAWS
from stepblocks.rig.effects.gauges import GAUGE_LAWS
from stepblocks.rig.effects.geometry import GEOMETRY_LAWS, make_height_error_law
from stepblocks.rig.effects.offered import list_offered_laws
from stepblocks.rig.effects.tool import TOOL_LAWS


def list_named_laws(blocks: Sequence[str] = ()) -> tuple[Law, ...]:
    """Return the laws that have names, the height error of each of `blocks` among them.

    Packages and users may offer their own, see `offered`. Laws without a name are composed, see
    `grammar`.
    """
    return (
        *GEOMETRY_LAWS,
        *FRICTION_LAWS,
        *TOOL_LAWS,
        *CONVERSION_LAWS,
        *GAUGE_LAWS,
        *list_offered_laws(),
        *(make_height_error_law(block) for block in blocks),
    )
