"""Effects that equations (1) and (2) lack: the laws of one slot in one file, each law one entry."""

from __future__ import annotations

from collections.abc import Sequence

from stepblocks.contact.effects import contact_geometry, conversion, friction, tool
from stepblocks.law import Law

# the parts of the model that an effect may change
SLOTS = ("contact_geometry", "friction", "normal_load", "stiffness", "conversion", "drag", "sensor")


def named_laws(blocks: Sequence[str] = ()) -> tuple[Law, ...]:
    """Return the laws with names (smooths are in `smooth`); the height error of each of `blocks` among them."""
    laws = (*contact_geometry.LAWS, *friction.LAWS, *tool.LAWS, *conversion.LAWS, *tool.SENSOR)
    return (*laws, *(contact_geometry.height_error(block) for block in blocks))
