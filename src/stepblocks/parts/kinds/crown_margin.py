"""The margin of a crown at its tooth, which margin blocks and crowns share.

Terms are those of Holmes et al. 1989; see docs/reference/stimulus-file.md.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar

from stepblocks.contact.counterface import Margin
from stepblocks.contact.operating_point import Tissue, Tool
from stepblocks.parts.conditions import Gum
from stepblocks.parts.declared import LabelledText, declare_default, make_rules_validator
from stepblocks.parts.kind import (
    NANOMETRE,
    CloseUp,
    Finding,
    MeasuredMesh,
    Part,
    Verdict,
    choose_exaggeration,
)
from stepblocks.parts.material import MaterialField
from stepblocks.parts.revolution import Point
from stepblocks.parts.tolerance import Dimension, PositiveLength, SignedLength
from stepblocks.quantities import format_quantity

# largest clinically acceptable absolute marginal discrepancy [m] (the paper; McLean and von
# Fraunhofer 1971 say 120 um)
_CLINICAL_LIMIT = 100e-6
_ROUNDING = 1e-12  # relative, by which a discrepancy at the limit may exceed it


class CrownMargin(Part):
    """What all forms share: x along the path of draw from root to crown, z outwards.

    The cavosurface angle of the tooth is the origin.
    """

    counterface_fields: ClassVar = {
        "gap": "marginal_gap",
        "rise": "horizontal_discrepancy",
        "opening": "vertical_discrepancy",
    }

    marginal_gap: PositiveLength = declare_default(otherwise="10 um")  # g
    # h; positive: overextended
    horizontal_discrepancy: SignedLength = declare_default("0 um", otherwise="10 um")
    # v; left out, it is g
    vertical_discrepancy: SignedLength | None = declare_default(None, otherwise="10 um")
    gum: Gum | None = None  # beside the margin; none where the file does not say
    material: MaterialField = declare_default("zirconia")

    def tissue(self, tool: Tool) -> Tissue:
        if self.gum is None:
            return Tissue()
        return self.gum.make_tissue(tool.frequency)

    @property
    @abstractmethod
    def floor_depth_and_slope(self) -> tuple[float, float]:
        """Depth of the gap [m] where it begins, and how steeply its floor falls from there [1]."""

    def make_counterface(self, **sizes: float) -> Margin:
        gap = sizes["gap"]
        depth, slope = self.floor_depth_and_slope
        return Margin(max(gap, 0.0), sizes.get("opening", gap), sizes["rise"], depth, slope)

    @property
    def opening(self) -> Dimension:
        """The vertical discrepancy in force: the one stated, or the marginal gap."""
        if self.vertical_discrepancy is None:
            return self.marginal_gap
        return self.vertical_discrepancy

    @property
    def absolute_discrepancy(self) -> float:
        """Absolute marginal discrepancy [m]: from the crown's margin to the cavosurface angle."""
        return math.hypot(self.opening.nominal, self.horizontal_discrepancy.nominal)

    @property
    def corner(self) -> list[Point]:
        """Outline of the crown's margin from inside the gap to its outer corner [m]."""
        gap = self.marginal_gap.nominal
        opening = self.opening.nominal
        rise = self.horizontal_discrepancy.nominal
        if opening < 0.0:  # a lip over the tooth
            return [(gap, gap), (opening, gap), (opening, rise)]
        if opening == gap:
            return [(gap, rise)]
        return [(gap, rise - abs(opening - gap)), (opening, rise)]

    @make_rules_validator
    def _yield_lip_breaches(self) -> Iterator[str]:
        """Yield that a crown which reaches below the finish line would meet the tooth."""
        gap = self.marginal_gap.nominal
        rise = self.horizontal_discrepancy.nominal
        if self.opening.nominal < 0.0 and rise <= gap:
            yield (
                f"horizontal_discrepancy must exceed marginal_gap "
                f"({format_quantity(gap, 'length')}) where vertical_discrepancy is negative, got "
                f"{format_quantity(rise, 'length')}"
            )

    def measure_gap(self, mesh: MeasuredMesh, length: Dimension) -> Verdict:
        """Measure the marginal gap on the mesh of a body of this length."""
        reach = 0.25 * length.nominal
        crown_wall = mesh.measure_wall_position(-1, reach)
        tooth_wall = mesh.measure_wall_position(+1, reach)
        gap = crown_wall - tooth_wall
        return Finding("marginal gap", self.marginal_gap.nominal, gap, NANOMETRE)

    def choose_close_up(self) -> CloseUp:
        rise = abs(self.horizontal_discrepancy.nominal)
        gap = self.marginal_gap.nominal
        width = 2.5 * max(rise, gap, abs(self.opening.nominal))
        exaggeration = 1.0
        if rise > 0.0:
            exaggeration = choose_exaggeration(rise)
        return CloseUp(exaggeration, width, (0.5 * gap, 0.0, 0.0))

    def derived(self) -> list[LabelledText]:
        discrepancy = self.absolute_discrepancy
        grade = "above the clinical limit of 100 um"
        if discrepancy <= _CLINICAL_LIMIT * (1.0 + _ROUNDING):
            grade = "clinically acceptable"
        return [["absolute marginal discrepancy", f"{discrepancy * 1e6:.4g} um, {grade}"]]
