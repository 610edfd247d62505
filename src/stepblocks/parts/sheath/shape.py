"""Sheaths: tubes turned in one piece."""

from __future__ import annotations

from stepblocks.cad import kernel
from stepblocks.parts.section import sheath_outline
from stepblocks.parts.sheath.declaration import Sheath


def sheath(part: Sheath) -> list[tuple[str, kernel.Body]]:
    """Build a sheath."""
    return [(part.id, kernel.turned(sheath_outline(part), (0.0, 0.0, 0.0)))]
