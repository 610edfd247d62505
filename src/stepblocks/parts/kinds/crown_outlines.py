"""Half sections of a prepared tooth and of the crown seated on it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from stepblocks.parts.revolution import Outline, Point

FinishKind = Literal["shoulder", "chamfer", "feather-edge"]


@dataclass(frozen=True)
class Preparation:
    """A prepared tooth at its nominal sizes; the finish line lies at height 0."""

    finish: FinishKind
    margin_radius: float  # [m]
    ledge: float  # width of the finish line [m]
    taper: float  # of the axial wall against the path of draw [rad]
    height: float  # over the finish line [m]
    root_length: float  # below the finish line [m]

    @property
    def slope(self) -> float:
        """How fast the axial wall leans inwards [1]."""
        return math.tan(self.taper)

    @property
    def wall_start(self) -> float:
        """Height at which the axial wall begins [m]."""
        if self.finish == "chamfer":
            return self.ledge
        return 0.0

    def compute_wall_radius(self, height: float) -> float:
        """Return the radius of the axial wall at a height [m]."""
        return self.margin_radius - self.ledge - (height - self.wall_start) * self.slope

    def outline(self) -> Outline:
        """Outline the half section of the tooth, from the root up."""
        radius = self.margin_radius
        ledge = self.ledge
        outline: Outline = [(0.0, -self.root_length), (radius, -self.root_length), (radius, 0.0)]
        if self.finish == "chamfer":
            middle = (radius - ledge * math.sqrt(0.5), ledge * (1.0 - math.sqrt(0.5)))
            outline.append((middle, (radius - ledge, ledge)))
        elif self.finish == "shoulder":
            outline.append((radius - ledge, 0.0))
        outline.append((self.compute_wall_radius(self.height), self.height))
        outline.append((0.0, self.height))
        return outline


@dataclass(frozen=True)
class SeatedCrown:
    """A crown at its nominal sizes, seated on a preparation with its gaps."""

    preparation: Preparation
    marginal_gap: float  # [m]
    opening: float  # of its margin along the path of draw [m]
    internal_gap: float  # across the wall [m]
    shell: float  # thickness over the preparation [m]
    outer_radius: float  # [m]
    corner: Sequence[Point]  # of its margin, as `CrownMargin.corner`: along the draw, outwards [m]

    @property
    def wall_offset(self) -> float:
        """How far its inner wall stands off the axial wall, square to the path of draw [m]."""
        return self.internal_gap / math.cos(self.preparation.taper)

    @property
    def inner_roof_height(self) -> float:
        """Height of its inner roof [m]."""
        return self.preparation.height + self.internal_gap

    @property
    def outer_roof_height(self) -> float:
        """Height of its outer roof [m]."""
        return self.inner_roof_height + self.shell

    def compute_wall_radius(self, height: float) -> float:
        """Return the radius of its inner wall at a height [m]."""
        return self.preparation.compute_wall_radius(height) + self.wall_offset

    def outline(self) -> Outline:
        """Outline the half section of the crown, from its inner roof down and round."""
        outline: Outline = [
            (0.0, self.inner_roof_height),
            (self.compute_wall_radius(self.inner_roof_height), self.inner_roof_height),
        ]
        if self.preparation.finish == "feather-edge":
            outline += self._outline_feather_edge_foot()
        else:
            outline += self._outline_ledge_foot()
        outline += [(self.outer_radius, self.outer_roof_height), (0.0, self.outer_roof_height)]
        return outline

    def _outline_feather_edge_foot(self) -> Outline:
        """Outline the foot of the crown that runs out on the axial wall."""
        preparation = self.preparation
        opening = self.opening
        gap = self.marginal_gap / math.cos(preparation.taper)
        foot = preparation.margin_radius - opening * preparation.slope + gap
        return [(foot, opening), (self.outer_radius, opening)]

    def _outline_ledge_foot(self) -> Outline:
        """Outline the foot of the crown over a shoulder or a quarter round."""
        preparation = self.preparation
        gap = self.marginal_gap
        outline: Outline = []
        if preparation.finish == "chamfer":
            foot = gap + preparation.ledge
            wall = (self.compute_wall_radius(foot), foot)
            margin = (preparation.margin_radius, gap)
            outline += [wall, (self._find_arc_middle(wall, margin), margin)]
        else:
            outline.append((self.compute_wall_radius(gap), gap))
        corner = [(preparation.margin_radius + z, x) for x, z in self.corner]
        outline += corner
        end_radius, end_height = corner[-1]
        if end_radius != self.outer_radius:
            outline.append((self.outer_radius, end_height))
        return outline

    def _find_arc_middle(self, start: Point, end: Point) -> Point:
        """Find the middle of an arc of the finish line's radius.

        It bulges towards the axis's foot, as that of the tooth does.
        """
        start_radius, start_height = start
        end_radius, end_height = end
        half_x = 0.5 * (end_radius - start_radius)
        half_z = 0.5 * (end_height - start_height)
        half_chord = math.hypot(half_x, half_z)
        radius = self.preparation.ledge
        sagitta = radius - math.sqrt(radius * radius - half_chord * half_chord)
        return (
            start_radius + half_x + sagitta * half_z / half_chord,
            start_height + half_z - sagitta * half_x / half_chord,
        )
