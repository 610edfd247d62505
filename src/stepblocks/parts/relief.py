"""Relief at the root of a riser: a groove in the lower face along the whole of it."""

from collections.abc import Iterator
from typing import ClassVar

from stepblocks.contact.relieved_step import RelievedStep, format_least_riding_ball
from stepblocks.parts.body import Body
from stepblocks.parts.body_solid import compute_cutout_volume
from stepblocks.parts.characteristics import (
    MICROSCOPE,
    Characteristic,
    FaceRule,
    make_characteristic,
    make_plane_rule,
)
from stepblocks.parts.declared import LabelledText, Table, declare_default, describe_breach
from stepblocks.parts.kind import Manifold
from stepblocks.parts.revolution import Point
from stepblocks.parts.shapes import split_solid
from stepblocks.parts.tolerance import PositiveLength

# share of the lower face that a relief may take, and of the thickness of the block
_MOST_WIDTH = 0.1
_MOST_DEPTH = 0.1
# least width and depth [m]: of less the kernel loses faces
_LEAST = 0.5e-6
# why a relief has no such field
_UPRIGHT = (
    "walls and floor of a relief are square; nothing predicts what a ball feels that sinks into a "
    "sloped or a round one"
)


class Relief(Table):
    """A groove in the lower face, between it and the riser, so that tools run out at the root.

    Attributes
    ----------
    width : Dimension
        Width from the riser along x [m].
    depth : Dimension
        Depth below the lower face [m].
    """

    not_declared: ClassVar[dict[str, str]] = dict.fromkeys(
        ("angle", "flank_angle", "wall_angle", "slope", "flank", "radius"), _UPRIGHT
    )

    width: PositiveLength = declare_default(otherwise="0.05 mm")
    depth: PositiveLength = declare_default(otherwise="0.02 mm")

    @property
    def section_corners(self) -> list[Point]:
        """Corners (x, z) of its section from the riser to the lower face [m]."""
        width = self.width.nominal
        depth = self.depth.nominal
        return [(0.0, -depth), (-width, -depth), (-width, 0.0)]

    def yield_characteristics(self, lower_face: FaceRule) -> Iterator[Characteristic]:
        """Make width and depth, which hold below the lower face."""
        width = self.width.nominal
        depth = self.depth.nominal
        middle = -0.5 * depth
        yield make_characteristic(
            "relief_width",
            "distance",
            self.width,
            make_plane_rule(0, -width, z=middle),
            make_plane_rule(0, 0.0, z=middle),
            label="width of the relief at the root",
            method=MICROSCOPE,
        )
        yield make_characteristic(
            "relief_depth",
            "distance",
            self.depth,
            make_plane_rule(2, -depth, x=-0.5 * width),
            lower_face,
            label="depth of the relief at the root",
            method="profilometer",
        )

    def compute_removed_volume(self, body: Body) -> float:
        """Compute what it takes away, between the chamfered sides of the lower face [m^3]."""
        return compute_cutout_volume(body, 0.0, [(0.0, 0.0), *self.section_corners])

    def split_left_half(self, left_half: Manifold) -> list[Manifold]:
        """Cut the left half of a block into the piece before it and the piece under it."""
        before, beside_riser = split_solid(left_half, "x", -self.width.nominal)
        under, _ = split_solid(beside_riser, "z", -self.depth.nominal)
        return [before, under]

    def yield_breaches(self, body: Body) -> Iterator[str]:
        """Yield what keeps it from fitting the lower face."""
        for name, size in (("width", self.width), ("depth", self.depth)):
            if size.nominal < _LEAST:
                rule = "be at least what the kernel builds"
                yield describe_breach(f"relief.{name}", rule, _LEAST, size.nominal)
        widest = _MOST_WIDTH * body.half_length
        if self.width.nominal > widest:
            rule = "leave nine tenths of the lower face"
            yield describe_breach("relief.width", rule, widest, self.width.nominal)
        deepest = _MOST_DEPTH * body.thickness.nominal
        if self.depth.nominal > deepest:
            rule = "not exceed a tenth of the thickness"
            yield describe_breach("relief.depth", rule, deepest, self.depth.nominal)


def list_untouched_ball_rows(face: object) -> list[LabelledText]:
    """Return a row that says which balls do not touch the relief; no row for a plain step."""
    if not isinstance(face, RelievedStep):
        return []
    return [["balls that do not reach the relief", format_least_riding_ball(face)]]
