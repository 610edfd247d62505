"""The junction of crown and tooth in the terms of Holmes et al. (1989), as a bench block and as a body of revolution.

Seen in a section through the tooth's axis, x runs along the path of draw from the root to the crown and z outwards. The
cavosurface angle of the tooth, where its finish line meets its outer surface, is the origin; the tooth's outer surface is z = 0.
The margin of the crown is the corner (v, h):

- marginal gap g: between the crown's fitting surface and the finish line, measured across the opening;
- vertical discrepancy v: from the cavosurface angle to the crown's margin along the path of draw. It equals g where the crown ends
  square; larger, its margin is bevelled back at 45 degrees; smaller, a lip narrows the gap; negative, the lip has slid over the tooth;
- horizontal discrepancy h: outwards; positive is an overextended margin, negative an underextended one;
- absolute marginal discrepancy: the hypotenuse of v and h.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, ClassVar

from pydantic import model_validator

from stepblocks.parts.declared import MaterialField
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import Dimension, PositiveLength, SignedLength
from stepblocks.quantities import format_quantity

if TYPE_CHECKING:
    from stepblocks.contact.counterface import Margin

# Largest absolute marginal discrepancy that is clinically acceptable [m] (the paper; McLean and von Fraunhofer 1971
# say 120 um)
CLINICAL_LIMIT = 100e-6


def crown_corner(gap: float, vertical: float, horizontal: float) -> list[tuple[float, float]]:
    """Outline of the crown's margin from inside the gap to its outer corner."""
    if vertical < 0.0:
        return [(gap, gap), (vertical, gap), (vertical, horizontal)]
    if vertical == gap:
        return [(gap, horizontal)]
    return [(gap, horizontal - abs(vertical - gap)), (vertical, horizontal)]


class CrownMargin(Part):
    """What both forms share."""

    felt_by: ClassVar[dict[str, str]] = {
        "gap": "marginal_gap",
        "rise": "horizontal_discrepancy",
        "opening": "vertical_discrepancy",
    }

    marginal_gap: PositiveLength  # g
    horizontal_discrepancy: SignedLength  # h; positive where the crown is overextended
    vertical_discrepancy: SignedLength | None = None  # v; the marginal gap where the file does not give it
    material: MaterialField

    @property
    @abstractmethod
    def floor(self) -> tuple[float, float]:
        """Depth of the gap [m] where it begins, and how steeply its floor falls from there [1]."""

    def sized(self, **sizes: float) -> Margin:
        from stepblocks.contact.counterface import Margin

        gap = sizes["gap"]
        opening = sizes.get("opening", gap)
        return Margin(max(gap, 0.0), opening, sizes["rise"], *self.floor)

    @property
    def opening(self) -> Dimension:
        """The vertical discrepancy in force: the one stated, or the marginal gap."""
        return self.marginal_gap if self.vertical_discrepancy is None else self.vertical_discrepancy

    @property
    def absolute_discrepancy(self) -> float:
        """Absolute marginal discrepancy [m]: from the crown's margin to the cavosurface angle."""
        return math.hypot(self.opening.nominal, self.horizontal_discrepancy.nominal)

    @property
    def clinically_acceptable(self) -> bool:
        """Whether the absolute marginal discrepancy is at most 100 um."""
        return self.absolute_discrepancy <= CLINICAL_LIMIT * (1.0 + 1e-12)

    @property
    def corner(self) -> list[tuple[float, float]]:
        """Outline of the crown's margin, see `crown_corner` [m]."""
        return crown_corner(self.marginal_gap.nominal, self.opening.nominal, self.horizontal_discrepancy.nominal)

    @model_validator(mode="after")
    def _lip_clears_the_tooth(self) -> CrownMargin:
        v, g, h = self.opening.nominal, self.marginal_gap.nominal, self.horizontal_discrepancy.nominal
        if v < 0.0 and h <= g:
            raise ValueError(
                "horizontal_discrepancy must exceed marginal_gap "
                f"({format_quantity(g, 'length')}) where vertical_discrepancy is negative, got {format_quantity(h, 'length')}"
            )
        return self

    def derived(self) -> list[list[str]]:
        grade = "clinically acceptable" if self.clinically_acceptable else "above the clinical limit of 100 um"
        return [["absolute marginal discrepancy", f"{self.absolute_discrepancy * 1e6:.4g} um, {grade}"]]
