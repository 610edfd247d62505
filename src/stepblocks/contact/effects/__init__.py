"""Effects that equations (1) and (2) lack, each a `Law`."""

from __future__ import annotations

from collections.abc import Sequence

from stepblocks.contact.effects import named
from stepblocks.law import Law

# the parts of the model that an effect may change
SLOTS = ("contact_geometry", "friction", "normal_load", "stiffness", "conversion", "drag", "sensor")


def named_laws(blocks: Sequence[str] = ()) -> tuple[Law, ...]:
    """Return the laws with names (smooths are in `smooth`); the height error of each of `blocks` among them."""
    laws = (*named.GEOMETRY, *named.FRICTION, *named.TOOL, *named.CONVERSION, *named.SENSOR)
    return (*laws, *(named.height_error(block) for block in blocks))
