"""Prepared tooth and crown as two bodies of revolution about the path of draw."""

from __future__ import annotations

from stepblocks.cad import kernel
from stepblocks.parts.margins.declaration import CrownOnTooth
from stepblocks.parts.section import crown_outline, tooth_outline


def crown_on_tooth(margin: CrownOnTooth) -> list[tuple[str, kernel.Body]]:
    """Build the tooth and its crown."""
    origin = (0.0, 0.0, 0.0)
    return [
        (f"{margin.id}-tooth", kernel.turned(tooth_outline(margin), origin)),
        (f"{margin.id}-crown", kernel.turned(crown_outline(margin), origin)),
    ]
