"""Pictures of the stages in which the apparatus is assembled, seen from above the front corner.

Solids are painted one over another, the farthest first. Boxes with sides along the axes that do not
overlap always have an order: along some axis one of them is nearer to the eye.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.files.figures import Axes, make_figure_and_axes, save_figure
from stepblocks.parts.apparatus.layout import Stage
from stepblocks.parts.apparatus.solids import Box, Cylinder
from stepblocks.parts.revolution import Point3

_TO_EYE: Point3 = (1.0, -1.4, 0.9)  # direction from the apparatus to the eye
_SIDES = 40  # of a circle
_SAME = 1e-9  # overlaps that are shorter are none [m]
_SHADES = (0.80, 0.90, 1.0)  # of faces square to x, y and z
_NEW = (1.0, 0.78, 0.42)  # colour of what a stage adds
_KNOWN = (0.80, 0.84, 0.88)  # of what stands already
_INK = "#1d2a36"
_NUMBER_ROOM = 7e-3  # from number to number, at least [m]
_SIZE = 7.0  # of a picture [inch]


@dataclass(frozen=True)
class _Face:
    """A visible face: its outline on the picture, shape (n, 2) [m], and its shade."""

    outline: NDArray[np.float64]
    shade: float


@dataclass(frozen=True)
class _Painted:
    """A solid that is painted: the box around it, its faces and its colour."""

    box: Box
    faces: Sequence[_Face]
    colour: tuple[float, float, float]


def write_stage_pictures(folder: Path, kit_name: str, stages: Sequence[Stage]) -> list[Path]:
    """Draw every stage on those before it, what is new in colour, with the numbers of the items.

    Parameters
    ----------
    folder : Path
        Where the files go.
    kit_name : str
        Of the kit.
    stages : sequence of Stage
        In the order of the assembly.

    Returns
    -------
    list of Path
        An SVG of each stage.
    """
    paths = []
    first_item = 1
    for number, stage in enumerate(stages, start=1):
        path = folder / f"{kit_name}.stage-{number}.svg"
        _write_stage_picture(path, stages[:number], first_item)
        first_item += len(stage.components)
        paths.append(path)
    return paths


def _write_stage_picture(path: Path, stages: Sequence[Stage], first_item: int) -> None:
    """Draw the last of several stages on the others; its items count from a number."""
    figure, axes = make_figure_and_axes(width=_SIZE, height=0.75 * _SIZE)
    for solid in _order_farthest_first(_list_painted_solids(stages)):
        _paint_faces(axes, solid)
    places: list[tuple[float, float]] = []
    for item, component in enumerate(stages[-1].components, start=first_item):
        place = _find_free_number_place(component.bounding_box.centre, places)
        places.append(place)
        _write_item_number(axes, place, item)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.axis("off")
    axes.set_title(f"{len(stages)}  {stages[-1].title}", fontsize=11, color=_INK)
    save_figure(figure, path)


def _list_painted_solids(stages: Sequence[Stage]) -> list[_Painted]:
    """List the solids to paint; those of the last stage have a colour of their own."""
    boxes: list[Box] = []
    for stage in stages:
        for component in stage.components:
            boxes += component.boxes
    solids = []
    for stage in stages:
        colour = _NEW if stage is stages[-1] else _KNOWN
        for component in stage.components:
            solids += [_Painted(box, _list_box_faces(box), colour) for box in component.boxes]
            for rod in component.rods:
                for piece in _list_uncovered_rod_pieces(rod, boxes):
                    solids.append(_Painted(piece.bounding_box, _list_rod_faces(piece), colour))
    return solids


def _list_uncovered_rod_pieces(rod: Cylinder, boxes: Sequence[Box]) -> list[Cylinder]:
    """List the pieces of a rod outside of boxes that it goes through or stands in."""
    ends = [(rod.start[rod.axis_index], rod.end[rod.axis_index])]
    for box in boxes:
        if _contains_rod_section(box, rod):
            ends = _cut_gap_out(ends, (box.low[rod.axis_index], box.high[rod.axis_index]))
    pieces = []
    for start, end in ends:
        coordinates = list(rod.start)
        coordinates[rod.axis_index] = start
        x, y, z = coordinates
        pieces.append(replace(rod, start=(x, y, z), length=end - start))
    return pieces


def _contains_rod_section(box: Box, rod: Cylinder) -> bool:
    """Tell whether a box has the section of a rod within it."""
    around = rod.bounding_box
    for axis in rod.cross_axis_indices:
        if around.low[axis] < box.low[axis] - _SAME or around.high[axis] > box.high[axis] + _SAME:
            return False
    return True


def _cut_gap_out(
    intervals: Sequence[tuple[float, float]], gap: tuple[float, float]
) -> list[tuple[float, float]]:
    """Cut a gap out of intervals; return what is left of them [m]."""
    left = []
    for start, end in intervals:
        before = (start, min(end, gap[0]))
        after = (max(start, gap[1]), end)
        for low, high in (before, after):
            if high - low > _SAME:
                left.append((low, high))
    return left


def _project_on_picture(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project points, shape (n, 3), on the picture, shape (n, 2) [m]."""
    to_eye = np.array(_TO_EYE) / math.hypot(*_TO_EYE)
    right = np.cross([0.0, 0.0, 1.0], to_eye)
    right /= math.hypot(*right.tolist())
    up = np.cross(to_eye, right)
    return np.column_stack([(points * right).sum(axis=1), (points * up).sum(axis=1)])


def _list_box_faces(box: Box) -> list[_Face]:
    """List the three faces of a box that are seen."""
    faces = []
    for axis in range(3):
        seen = box.high if _TO_EYE[axis] > 0.0 else box.low
        first, second = (k for k in range(3) if k != axis)
        corners = []
        for a, b in ((box.low, box.low), (box.high, box.low), (box.high, box.high)):
            corners.append(_combine_face_corner(axis, seen, first, a, second, b))
        corners.append(_combine_face_corner(axis, seen, first, box.low, second, box.high))
        faces.append(_Face(_project_on_picture(np.array(corners)), _SHADES[axis]))
    return faces


def _combine_face_corner(
    axis: int,
    face_point: Point3,
    first_axis: int,
    first_point: Point3,
    second_axis: int,
    second_point: Point3,
) -> list[float]:
    """Make a corner of a face square to an axis, of coordinates of three points [m]."""
    corner = [0.0, 0.0, 0.0]
    corner[axis] = face_point[axis]
    corner[first_axis] = first_point[first_axis]
    corner[second_axis] = second_point[second_axis]
    return corner


def _list_rod_faces(rod: Cylinder) -> list[_Face]:
    """List the silhouette of a rod and the end that is seen."""
    angles = np.arange(_SIDES) * (math.tau / _SIDES)
    first, second = rod.cross_axis_indices
    circle = np.zeros((_SIDES, 3))
    circle[:, first] = 0.5 * rod.diameter * np.cos(angles)
    circle[:, second] = 0.5 * rod.diameter * np.sin(angles)
    start = _project_on_picture(circle + np.array(rod.start))
    end = _project_on_picture(circle + np.array(rod.end))
    seen = end if _TO_EYE[rod.axis_index] > 0.0 else start
    silhouette = _find_picture_hull(np.concatenate([start, end]))
    return [_Face(silhouette, _SHADES[1]), _Face(seen, _SHADES[rod.axis_index])]


def _find_picture_hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the convex hull of points on the picture, shape (n, 2) [m]."""
    from scipy.spatial import ConvexHull

    hull: NDArray[np.float64] = points[ConvexHull(points).vertices]
    return hull


def _order_farthest_first(solids: Sequence[_Painted]) -> list[_Painted]:
    """Order solids so that none is painted before one that it covers."""
    waiting = list(solids)
    ordered = []
    while waiting:
        farthest = next(
            (solid for solid in waiting if not _is_nearer_than_any(solid, waiting)), waiting[0]
        )
        waiting.remove(farthest)
        ordered.append(farthest)
    return ordered


def _is_nearer_than_any(solid: _Painted, waiting: Sequence[_Painted]) -> bool:
    """Tell whether a solid is nearer to the eye than one that is not painted yet."""
    return any(
        _is_nearer_to_eye(solid.box, behind.box) for behind in waiting if behind is not solid
    )


def _is_nearer_to_eye(box: Box, other: Box) -> bool:
    """Tell whether a box is nearer to the eye than another, along the first axis that parts them.

    Of two that overlap the one with the nearer middle is, as of a shaft and its bearing.
    """
    for axis in range(3):
        is_higher = box.low[axis] >= other.high[axis] - _SAME
        is_lower = box.high[axis] <= other.low[axis] + _SAME
        if is_higher or is_lower:
            return is_higher == (_TO_EYE[axis] > 0.0) and _overlap_on_picture(box, other)
    return _compute_nearness_to_eye(box) > _compute_nearness_to_eye(other)


def _overlap_on_picture(box: Box, other: Box) -> bool:
    """Tell whether the rectangles around two boxes on the picture overlap."""
    first = _project_on_picture(np.array(_list_box_corners(box)))
    second = _project_on_picture(np.array(_list_box_corners(other)))
    low = np.maximum(first.min(axis=0), second.min(axis=0))
    high = np.minimum(first.max(axis=0), second.max(axis=0))
    return bool((high > low).all())


def _list_box_corners(box: Box) -> list[Point3]:
    """List the corners of a box [m]."""
    corners = []
    for x in (box.low[0], box.high[0]):
        for y in (box.low[1], box.high[1]):
            for z in (box.low[2], box.high[2]):
                corners.append((x, y, z))
    return corners


def _compute_nearness_to_eye(box: Box) -> float:
    """Return how near to the eye the middle of a box lies."""
    return math.fsum(a * b for a, b in zip(box.centre, _TO_EYE, strict=True))


def _paint_faces(axes: Axes, solid: _Painted) -> None:
    """Paint the faces of a solid with their edges."""
    for face in solid.faces:
        colour = tuple(face.shade * share for share in solid.colour)
        x, y = face.outline.T
        axes.fill(x, y, facecolor=colour, edgecolor=_INK, linewidth=0.6, joinstyle="round")


def _find_free_number_place(
    item_centre: Point3, taken_places: Sequence[tuple[float, float]]
) -> tuple[float, float]:
    """Find a place for the number of an item at its centre, or under the numbers that are there."""
    ((x, y),) = _project_on_picture(np.array([item_centre])).tolist()
    while any(math.dist((x, y), place) < _NUMBER_ROOM for place in taken_places):
        y -= _NUMBER_ROOM
    return x, y


def _write_item_number(axes: Axes, place: tuple[float, float], item: int) -> None:
    """Write the number of an item at its place."""
    x, y = place
    box = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": _INK, "lw": 0.5}
    axes.text(x, y, str(item), fontsize=7, ha="center", va="center", color=_INK, bbox=box)
