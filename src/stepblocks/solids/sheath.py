"""Sheaths: tubes turned in one piece."""

from __future__ import annotations

from stepblocks.solids import kernel
from stepblocks.stimulus.section import sheath_outline
from stepblocks.stimulus.sheath import Sheath

__all__ = ["sheath"]


def sheath(part: Sheath) -> list[tuple[str, kernel.Body]]:
    """Build a sheath.

    Parameters
    ----------
    part : Sheath
        What is asked for; its nominal dimensions are built.

    Returns
    -------
    list of (str, kernel.Body)
        One solid; the end near the clamp lies at z = 0, the axis is z.
    """
    return [(part.id, kernel.turned(sheath_outline(part), (0.0, 0.0, 0.0)))]
