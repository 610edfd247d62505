"""Each part as convex pieces, for simulators that turn one concave mesh into its convex hull and a step into a ramp.

Pieces describe what the probe can touch: fixing holes and engraving are left out. They fill the part without overlapping.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.parts.arcs import arc_points
from stepblocks.parts.body import Body
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.mesh import CONTACT_DEFLECTION, Mesh
from stepblocks.parts.section import Outline, crown_outline, sheath_outline, tip_outline, tooth_outline
from stepblocks.parts.set import Stimulus
from stepblocks.parts.sheath.declaration import Sheath
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.tips.declaration import HookTip, StraightTip

SECTORS = 96  # Sectors of a shell of revolution; the chords of a 4 mm crown sag 2 um
_BEND_PIECES = 24
_AROUND = 96
Point3 = tuple[float, float, float]


def convex_pieces(stimulus: Stimulus) -> list[Mesh]:
    """Cut a stimulus into convex pieces.

    Parameters
    ----------
    stimulus : Stimulus
        What is asked for.

    Returns
    -------
    list of Mesh
        Closed convex meshes, outward-wound.
    """
    match stimulus:
        case StepBlock():
            hulls = _step_block(stimulus)
        case MarginBlock():
            hulls = _margin_block(stimulus)
        case CrownOnTooth():
            hulls = [*_stack(tooth_outline(stimulus)), *_shell(stimulus)]
        case StraightTip():
            hulls = [_hull(_ring_points(tip_outline(stimulus)))]
        case HookTip():
            hulls = _hook(stimulus)
        case Sheath():
            hulls = _sectors(np.array(sheath_outline(stimulus)))
    return [_mesh(f"{stimulus.id}-piece-{number:03}", hull) for number, hull in enumerate(hulls, start=1)]


def _hull(points: Iterable[Sequence[float]]) -> Any:
    import manifold3d

    return manifold3d.Manifold.hull_points(np.asarray(list(points)) * 1e3)


def _mesh(name: str, hull: Any) -> Mesh:
    """Put vertices and triangles in ascending order: the hull's own order varies with its threads."""
    mesh = hull.to_mesh64()
    vertices, index = np.unique(np.asarray(mesh.vert_properties)[:, :3], axis=0, return_inverse=True)
    triangles = index.reshape(-1)[np.asarray(mesh.tri_verts).astype(np.int64)]
    first = triangles.argmin(axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    return Mesh(name, vertices * 1e-3, triangles[np.lexsort(triangles.T[::-1])])


def _half_points(
    body: Body, side: float, top: float, start: float, crest: Sequence[tuple[float, float]]
) -> list[Point3]:
    """Corners of one chamfered half: from the section at `start` outwards, with a crest of (x, z) points at the section."""
    out, half = side * 0.5 * body.length.nominal, 0.5 * body.width.nominal
    base, c = -body.thickness.nominal, body.edge_break.nominal
    points: list[Point3] = []
    for y in (-1.0, 1.0):
        for z, inset in ((base, c), (base + c, 0.0), (top - c, 0.0), (top, c)):
            corner = max(c - 2.0 * inset, 0.0)
            x, w = out - side * inset, half - inset
            points += [(x - side * corner, y * w, z), (x, y * (w - corner), z), (start, y * w, z)]
        for x, z in crest:
            points.append((x, y * (half - max(0.0, z - (top - c))), z))
        # where a chamfer's corner triangle closes, half way up
        for z in (base + 0.5 * c, top - 0.5 * c):
            points.append((out - side * 0.5 * c, y * (half - 0.5 * c), z))
    return points


def _rounding(height: float, radius: float) -> list[tuple[float, float]]:
    """Points on the rounded edge whose chords keep the contact's chordal error."""
    if radius == 0.0:
        return [(0.0, height)]
    step = 2.0 * math.acos(max(1.0 - CONTACT_DEFLECTION / radius, 0.0))
    count = max(2, math.ceil(0.5 * math.pi / step) + 1)
    angles = np.linspace(0.0, 0.5 * math.pi, count)
    return [(float(radius * (1.0 - math.sin(a))), float(height - radius * (1.0 - math.cos(a)))) for a in angles]


def _step_block(block: StepBlock) -> list[Any]:
    body, height, feature = block.body, block.height.nominal, block.metrology
    left = _hull(_half_points(body, -1.0, 0.0, 0.0, [(0.0, 0.0)]))
    crest = _rounding(height, block.edge_radius.nominal)
    right_points = [p for p in _half_points(body, 1.0, height, 0.0, crest) if not (p[0] == 0.0 and p[2] == height)]
    if block.edge_radius.nominal == 0.0:
        right_points += [(0.0, y * (0.5 * body.width.nominal - body.edge_break.nominal), height) for y in (-1.0, 1.0)]
    right = _hull(right_points)
    near, lane = feature.distance.nominal, 0.5 * body.width.nominal - feature.lane.nominal
    if feature.kind == "ridge":
        y1 = 0.5 * body.width.nominal - body.edge_break.nominal
        xs = (-near - feature.width.nominal, -near)
        ridge = _hull(
            [(x, y, z) for x in xs for y, z in ((lane, 0.0), (lane, height), (y1, 0.0), (y1 - height, height))]
        )
        return [left, right, ridge]
    before, rest = _split(right, "x", near)
    middle, after = _split(rest, "x", near + feature.width.nominal)
    drag, groove = _split(middle, "y", lane)
    floor, _ = _split(groove, "z", 0.0)
    return [left, before, drag, floor, after]


def _split(solid: Any, axis: str, position: float) -> tuple[Any, Any]:
    """Split at a plane; the part below it comes first."""
    normal = tuple(1.0 if name == axis else 0.0 for name in "xyz")
    above, below = solid.split_by_plane(normal, position * 1e3)
    return below, above


def _margin_block(margin: MarginBlock) -> list[Any]:
    body, gap, depth = margin.body, margin.marginal_gap.nominal, margin.gap_depth.nominal
    rise, opening = margin.horizontal_discrepancy.nominal, margin.opening.nominal
    left = _hull(_half_points(body, -1.0, 0.0, 0.0, [(0.0, 0.0)]))
    right = _hull(_half_points(body, 1.0, rise, 0.0, [(0.0, rise)]))
    under, crown = _split(right, "x", gap)
    floor, _ = _split(under, "z", -depth)
    if opening > gap:  # bevelled: cut the corner off along 45 degrees
        normal = (-math.sqrt(0.5), 0.0, math.sqrt(0.5))
        crown = crown.trim_by_plane(tuple(-n for n in normal), -1e3 * (rise - opening) * math.sqrt(0.5))
        return [left, floor, crown]
    pieces = [left, floor, crown]
    half, c = 0.5 * body.width.nominal, body.edge_break.nominal
    if opening < 0.0:
        lip = [
            (x, y * (half - c - (z if x <= 0.0 else z - rise)), z)
            for x in (opening, 0.0)
            for z in (gap, rise)
            for y in (-1, 1)
        ]
        inner = [(x, y * (half - max(0.0, z - rise + c)), z) for x in (0.0, gap) for z in (gap, rise) for y in (-1, 1)]
        pieces += [_hull(lip), _hull(inner)]
    elif opening < gap:
        foot = rise - (gap - opening)
        section = [(gap, foot), (opening, rise), (gap, rise)]
        pieces.append(_hull((x, y * (half - max(0.0, z - rise + c)), z) for x, z in section for y in (-1, 1)))
    return pieces


def _points_of(outline: Outline, chord: float = 1e-6) -> list[tuple[float, float]]:
    """Outline as points, its arcs with a chordal error of at most `chord`."""
    points: list[tuple[float, float]] = [outline[0]]  # type: ignore[list-item]
    for item in outline[1:]:
        if isinstance(item[0], tuple):
            points += arc_points(points[-1], item[0], item[1], chord)
        else:
            points.append(item)
    return points


def _ring_points(outline: Outline) -> list[Point3]:
    return [point for r, z in _points_of(outline, CONTACT_DEFLECTION) for point in _ring(r, z)]


def _ring(radius: float, height: float) -> list[Point3]:
    if radius == 0.0:
        return [(0.0, 0.0, height)]
    angles = np.arange(_AROUND) * (2.0 * math.pi / _AROUND)
    return [(radius * math.cos(a), radius * math.sin(a), height) for a in angles]


def _stack(outline: Outline) -> list[Any]:
    """Frusta of a solid of revolution whose radius is a function of height."""
    points = [(r, z) for r, z in _points_of(outline, 5e-6) if r > 0.0]
    frusta = []
    for (r0, z0), (r1, z1) in itertools.pairwise(points):
        if z1 > z0:
            frusta.append(_hull([*_ring(r0, z0), *_ring(r1, z1)]))
    return frusta


def _shell(margin: CrownOnTooth) -> list[Any]:
    """Sectors of the crown's wall in horizontal slices, and its roof."""
    points = _points_of(crown_outline(margin), 5e-6)
    ceiling, roof, outer = points[0][1], points[-1][1], points[-2][0]
    fitting = points[1 : points.index((outer, roof))]
    pieces = [_hull([*_ring(outer, ceiling), *_ring(outer, roof)])]
    cells: list[NDArray[np.float64]] = []
    for (r0, z0), (r1, z1) in itertools.pairwise(fitting):
        if z0 > z1 and max(r0, r1) <= outer:
            cells.append(np.array([(r0, z0), (r1, z1), (outer, z1), (outer, z0)]))
    low = min(z for _, z in fitting)
    lip = [(r, z) for r, z in fitting if z < margin.marginal_gap.nominal] if low < 0.0 else []
    if lip:
        cells.append(
            np.array(
                [
                    (min(r for r, _ in lip), low),
                    (outer, low),
                    (outer, margin.marginal_gap.nominal),
                    (min(r for r, _ in lip), margin.marginal_gap.nominal),
                ]
            )
        )
    for cell in cells:
        pieces += _sectors(cell)
    return pieces


def _sectors(cell: NDArray[np.float64]) -> list[Any]:
    """Turn a convex cell of the half section into sectors."""
    pieces = []
    for sector in range(SECTORS):
        angles = (2.0 * math.pi * sector / SECTORS, 2.0 * math.pi * (sector + 1) / SECTORS)
        pieces.append(_hull((r * math.cos(a), r * math.sin(a), z) for r, z in cell for a in angles))
    return pieces


def _hook(tip: HookTip) -> list[Any]:
    top, bend, angle = tip.cone_end, tip.bend_radius.nominal, tip.bend_angle.nominal

    def section(turn: float, along: float = 0.0) -> list[Point3]:
        c, s = math.cos(turn), math.sin(turn)
        return [
            (bend - (bend - x) * c + along * s, y, top + (bend - x) * s + along * c)
            for x, y, _ in _ring(tip.shank_radius.nominal, 0.0)
        ]

    turns = np.linspace(0.0, angle, _BEND_PIECES + 1)
    bent = [_hull([*section(float(a)), *section(float(b))]) for a, b in itertools.pairwise(turns)]
    shank = _hull([*section(angle), *section(angle, tip.straight_length.nominal)])
    return [_hull(_ring_points(tip_outline(tip))), *bent, shank]
