"""All named laws that may be asked for; every slot over every covariate is in `stepblocks.contact.effects.smooth`."""

from __future__ import annotations

from collections.abc import Sequence

from stepblocks.contact.effects import contact_geometry, conversion, friction, normal_load, tool
from stepblocks.contact.effects.law import Law

_LAWS = (
    *contact_geometry.LAWS,
    *friction.LAWS,
    *tool.STIFFNESS,
    *normal_load.LAWS,
    *tool.DRAG,
    *conversion.LAWS,
    *tool.SENSOR,
)


def named_laws(blocks: Sequence[str] = ()) -> tuple[Law, ...]:
    """Return the laws with names; the height error of each of `blocks` among them."""
    return (*_LAWS, *(contact_geometry.height_error(block) for block in blocks))
