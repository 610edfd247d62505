"""The body of a bench block as a solid: what is cut from it, its convex pieces, its volume."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from stepblocks import cad
from stepblocks.parts.body import DRILL_POINT, Body, Engraving, Mounting
from stepblocks.parts.lettering import outline_centred_text
from stepblocks.parts.revolution import Point, Point3

OVER = 1e-3  # how far a cutting body stands out of the block [m]
_SIDES = (-1.0, 1.0)  # left and right, or front and back


class WorkingFace(NamedTuple):
    """A working face right of an edge, up to the next edge or the right side."""

    edge_x: float  # x of its edge [m]
    height: float  # over the lower working face [m]


def make_body_cuts(
    body: Body, identity: str, right_faces: Sequence[WorkingFace]
) -> list[cad.door.Body]:
    """Make the bodies to cut from a block: edge breaks along x and z, holes, engraving.

    Parameters
    ----------
    body : Body
        The block without its stimulus.
    identity : str
        Of the block, which is engraved where no other text is declared.
    right_faces : sequence of WorkingFace
        Those right of the lower working face, from left to right.

    Returns
    -------
    list of cad.door.Body
        Solids that stand out of the block.
    """
    cuts: list[cad.door.Body] = []
    if body.edge_break.nominal > 0.0:
        highest = max(face.height for face in right_faces)
        for side in _SIDES:
            cuts += _make_long_edge_breaks(body, side, right_faces)
            cuts += _make_upright_edge_breaks(body, side, highest)
    if body.mounting is not None:
        for half_side in (-0.5, 0.5):
            cuts.append(_make_fixing_hole(body, body.mounting, half_side))
    if body.engraving is not None:
        cuts += _make_letters(body, body.engraving, identity)
    return cuts


def _make_letters(body: Body, engraving: Engraving, identity: str) -> Iterator[cad.door.Body]:
    """Make the letters that are cut into the front."""
    along, up = engraving.offset
    middle = -0.5 * body.thickness.nominal + up
    start = -body.half_width - 0.1 * OVER
    inwards = (0.0, engraving.depth.nominal + 0.1 * OVER, 0.0)
    for letter in outline_centred_text(engraving.choose_text(identity), engraving.height.nominal):
        rings = []
        for ring in letter:
            rings.append([(along + float(u), start, middle + float(v)) for u, v in ring])
        outer, *holes = rings
        yield cad.kernel.extrude(outer, inwards, holes)


def _make_long_edge_breaks(
    body: Body, side: float, right_faces: Sequence[WorkingFace]
) -> Iterator[cad.door.Body]:
    """Make the prisms that break the edges along x on the front (side -1) or the back (1)."""
    chamfer = body.edge_break.nominal
    length = body.half_length + OVER
    face = side * body.half_width
    inside = face - side * (chamfer + OVER)
    outside = face + side * OVER
    # start and length along x, height, and 1 of an upper edge, -1 of a lower one
    edges = [(-length, length, 0.0, 1.0), (-length, 2.0 * length, body.base, -1.0)]
    ends = [*(face.edge_x for face in right_faces[1:]), length]
    for working_face, end in zip(right_faces, ends, strict=True):
        begin = working_face.edge_x
        edges.append((begin, end - begin, working_face.height, 1.0))
    for x, run, z, up in edges:
        section = [
            (x, outside, z - up * chamfer - up * OVER),
            (x, inside, z + up * OVER),
            (x, outside, z + up * OVER),
        ]
        yield cad.kernel.extrude(section, (run, 0.0, 0.0))


def _make_upright_edge_breaks(body: Body, side: float, rise: float) -> Iterator[cad.door.Body]:
    """Make the prisms that break both upright edges of the front (side -1) or the back (1)."""
    chamfer = body.edge_break.nominal
    height = body.thickness.nominal + max(rise, 0.0) + 2.0 * OVER
    low = body.base - OVER
    face = side * body.half_width
    inside = face - side * (chamfer + OVER)
    outside = face + side * OVER
    for end in _SIDES:
        x = end * body.half_length
        section = [
            (x + end * OVER, inside, low),
            (x - end * (chamfer + OVER), outside, low),
            (x + end * OVER, outside, low),
        ]
        yield cad.kernel.extrude(section, (0.0, 0.0, height))


def _make_fixing_hole(body: Body, mounting: Mounting, half_side: float) -> cad.door.Body:
    """Make a fixing hole; `half_side` is -0.5 of the left one, 0.5 of the right one."""
    x = half_side * mounting.spacing.nominal
    if mounting.kind == "tapped":
        return cad.kernel.revolve_about_vertical(_outline_core_hole(mounting), (x, 0.0, body.base))
    return cad.kernel.revolve_about_vertical(
        _outline_clearance_hole(mounting, body.base), (x, 0.0, 0.0)
    )


def _outline_core_hole(mounting: Mounting) -> list[Point]:
    """Outline a core hole from the base up as (radius, height over the base) [m]."""
    drill = 0.5 * mounting.hole_diameter
    entry = 0.5 * mounting.entry_diameter
    depth = mounting.depth.nominal
    point = drill / math.tan(0.5 * DRILL_POINT)
    return [
        (0.0, -OVER),
        (entry + OVER, -OVER),
        (drill, entry - drill),  # a countersink of 90 degrees
        (drill, depth),
        (0.0, depth + point),
    ]


def _outline_clearance_hole(mounting: Mounting, base: float) -> list[Point]:
    """Outline a counterbored hole as (radius, height over the lower working face) [m]."""
    drill = 0.5 * mounting.hole_diameter
    entry = 0.5 * mounting.entry_diameter
    shoulder = -mounting.depth.nominal
    return [
        (0.0, base - OVER),
        (drill, base - OVER),
        (drill, shoulder),
        (entry, shoulder),
        (entry, OVER),
        (0.0, OVER),
    ]


def list_half_hull_points(
    body: Body, side: float, face_height: float, crest: Sequence[Point], edge_x: float = 0.0
) -> list[Point3]:
    """List points of which one chamfered half of a block, from an edge outwards, is the hull.

    Parameters
    ----------
    body : Body
        The block without its stimulus.
    side : float
        -1 of the left half, 1 of the right one.
    face_height : float
        Height of its working face [m].
    crest : sequence of tuple of float
        Its top at its edge as points (x, z) [m].
    edge_x : float
        x of its edge [m].

    Returns
    -------
    list of tuple of float
        Points (x, y, z) [m] in no order, some of them inside or twice.
    """
    outer = side * body.half_length
    half_width = body.half_width
    base = body.base
    chamfer = body.edge_break.nominal
    below_break = face_height - chamfer
    levels = (
        (base, chamfer),
        (base + chamfer, 0.0),
        (below_break, 0.0),
        (face_height, chamfer),
    )
    points: list[Point3] = []
    for y_side in _SIDES:
        for z, inset in levels:
            corner = max(chamfer - 2.0 * inset, 0.0)
            x = outer - side * inset
            width = half_width - inset
            points.append((x - side * corner, y_side * width, z))
            points.append((x, y_side * (width - corner), z))
            if z < face_height:
                points.append((edge_x, y_side * width, z))
        for x, z in crest:
            over_chamfer = max(0.0, z - below_break)
            points.append((x, y_side * (half_width - over_chamfer), z))
        # where a chamfer's corner triangle closes, half way up
        middle_x = outer - side * 0.5 * chamfer
        middle_y = y_side * (half_width - 0.5 * chamfer)
        points.append((middle_x, middle_y, base + 0.5 * chamfer))
        points.append((middle_x, middle_y, face_height - 0.5 * chamfer))
    return points


def compute_half_block_volume(body: Body, half_length: float, face_height: float) -> float:
    """Compute the volume of a block on one side of its edge [m^3].

    It is a box with every edge broken but the four at the section; `half_length` is its length [m].
    """
    width = body.width.nominal
    chamfer = body.edge_break.nominal
    height = face_height + body.thickness.nominal

    def integrate_slices(inset: float) -> float:
        """Integrate (half_length - s)(width - 2 s), the slice at an inset s of the chamfers."""
        return (
            half_length * width * inset
            - (2.0 * half_length + width) * inset * inset / 2.0
            + 2.0 * inset**3 / 3.0
        )

    upright = (height - 2.0 * chamfer) * (half_length * width - chamfer * chamfer)
    # less two corner triangles, leg^2 / 2 each with leg chamfer - 2 s; the leg vanishes at
    # s = chamfer / 2: chamfer^3 / 6 at a chamfer
    sloped = integrate_slices(chamfer) - chamfer**3 / 6.0
    return upright + 2.0 * sloped


def compute_slab_volume(body: Body, length: float, face_height: float) -> float:
    """Compute the volume of a block between two sections [m^3].

    `length` is their distance [m].
    """
    chamfer = body.edge_break.nominal
    height = face_height + body.thickness.nominal
    return length * (body.width.nominal * height - 2.0 * chamfer * chamfer)


@dataclass(frozen=True)
class _SectionEdge:
    """An edge of a section polygon, or a part of it: from (x0, z0) to (x1, z1) [m]."""

    x0: float
    z0: float
    x1: float
    z1: float

    def interpolate_point(self, share: float) -> Point:
        """Return the point at a share of the edge."""
        return self.x0 + share * (self.x1 - self.x0), self.z0 + share * (self.z1 - self.z0)


def compute_cutout_volume(body: Body, face_height: float, section: list[Point]) -> float:
    """Compute the volume that a section polygon (x, z) takes out of a half [m^3].

    The sides are chamfered from `edge_break` below the working face on: a contour integral of
    W(z) x dz.
    """
    knee = face_height - body.edge_break.nominal  # where the sides begin to lean
    total = 0.0
    following = [*section[1:], section[0]]
    for (x0, z0), (x1, z1) in zip(section, following, strict=True):
        edge = _SectionEdge(x0, z0, x1, z1)
        for first, last in itertools.pairwise(_list_shares_at_knee(edge, knee)):
            start_x, start_z = edge.interpolate_point(first)
            end_x, end_z = edge.interpolate_point(last)
            middle_x = 0.5 * (start_x + end_x)
            middle_z = 0.5 * (start_z + end_z)
            start = _compute_width_at_height(body, knee, start_z) * start_x
            middle = _compute_width_at_height(body, knee, middle_z) * middle_x
            end = _compute_width_at_height(body, knee, end_z) * end_x
            # Simpson, exact for a quadratic
            total += (end_z - start_z) * (start + 4.0 * middle + end) / 6.0
    return abs(total)


def _list_shares_at_knee(edge: _SectionEdge, knee_height: float) -> list[float]:
    """Return the shares of an edge at which its parts on either side of a height end."""
    shares = [0.0]
    if edge.z1 != edge.z0:
        crossing = (knee_height - edge.z0) / (edge.z1 - edge.z0)
        if 0.0 < crossing < 1.0:
            shares.append(crossing)
    shares.append(1.0)
    return shares


def _compute_width_at_height(body: Body, knee_height: float, height: float) -> float:
    """Return the breadth of the block at a height [m]."""
    return body.width.nominal - 2.0 * max(height - knee_height, 0.0)
