"""Prepared tooth and crown as two bodies of revolution about the path of draw."""

from __future__ import annotations

from stepblocks.solids import kernel
from stepblocks.stimulus.margin import CrownOnTooth
from stepblocks.stimulus.section import crown_outline, tooth_outline

__all__ = ["crown_on_tooth"]


def crown_on_tooth(margin: CrownOnTooth) -> list[tuple[str, kernel.Body]]:
    """Build the tooth and its crown.

    Parameters
    ----------
    margin : CrownOnTooth
        What is asked for; its nominal dimensions are built.

    Returns
    -------
    list of (str, kernel.Body)
        Tooth and crown, seated; z runs along the path of draw, the finish line lies at z = 0.
    """
    origin = (0.0, 0.0, 0.0)
    return [
        (f"{margin.id}-tooth", kernel.turned(tooth_outline(margin), origin)),
        (f"{margin.id}-crown", kernel.turned(crown_outline(margin), origin)),
    ]
