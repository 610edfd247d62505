"""Boxes and cylinders along the axes, of which the components are made, in closed form."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

from stepblocks import cad
from stepblocks.parts.revolution import Point3

Axis: TypeAlias = Literal["x", "y", "z"]
AXES: tuple[Axis, Axis, Axis] = ("x", "y", "z")
_MILLIMETRE = 1e-3


class Deviations(NamedTuple):
    """Permitted deviations of a diameter [m]."""

    upper: float
    lower: float


class _FitRow(NamedTuple):
    """Upper deviation of H7 for diameters up to a limit (ISO 286-2:2010, table 6) [m]."""

    up_to: float
    upper: float


_H7 = (_FitRow(3e-3, 10e-6), _FitRow(6e-3, 12e-6), _FitRow(10e-3, 15e-6), _FitRow(18e-3, 18e-6))


@dataclass(frozen=True)
class Box:
    """A block with faces square to the axes, by its lower and upper corner [m]."""

    low: Point3
    high: Point3

    @property
    def volume(self) -> float:
        """Its volume [m^3]."""
        length, width, height = self.sizes
        return length * width * height

    @property
    def centre(self) -> Point3:
        """Its middle [m]."""
        return _compute_midpoint(self.low, self.high)

    @property
    def sizes(self) -> Point3:
        """Its lengths along x, y and z [m]."""
        low_x, low_y, low_z = self.low
        high_x, high_y, high_z = self.high
        return high_x - low_x, high_y - low_y, high_z - low_z

    def move(self, shift: Point3) -> "Box":
        """Return it elsewhere [m]."""
        return Box(add_points(self.low, shift), add_points(self.high, shift))

    def build_solid(self) -> cad.door.Body:
        """Build it as a solid."""
        return cad.kernel.make_box(self.low, self.high)


def enclose_boxes(boxes: Sequence[Box]) -> Box:
    """Return the box around some boxes."""
    low_corners = [box.low for box in boxes]
    high_corners = [box.high for box in boxes]
    low_x, low_y, low_z = zip(*low_corners, strict=True)
    high_x, high_y, high_z = zip(*high_corners, strict=True)
    low = min(low_x), min(low_y), min(low_z)
    high = max(high_x), max(high_y), max(high_z)
    return Box(low, high)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along an axis: a rod, or a bore that takes it away.

    Attributes
    ----------
    axis : str
        Along which it lies.
    start : tuple of float
        Middle of the end with the lower coordinate [m].
    diameter, length : float
        [m].
    deviations : Deviations or None
        Permitted deviations of the diameter; None where the general ones hold.
    thread : str
        Designation of the thread that is cut in it.
    inward : tuple of float or None
        Direction into the part where the axis lies in a face of it, so that half of the cylinder
        is outside; None for a whole one.
    """

    axis: Axis
    start: Point3
    diameter: float
    length: float
    deviations: Deviations | None = None
    thread: str = ""
    inward: Point3 | None = None

    @property
    def axis_index(self) -> int:
        """Index of its axis: 0 for x, 1 for y, 2 for z."""
        return AXES.index(self.axis)

    @property
    def cross_axis_indices(self) -> tuple[int, int]:
        """Indices of the axes that it is square to."""
        indices = [0, 1, 2]
        indices.remove(self.axis_index)
        first, second = indices
        return first, second

    @property
    def end(self) -> Point3:
        """Middle of the end with the higher coordinate [m]."""
        return _shift_along_axis(self.start, self.axis_index, self.length)

    @property
    def middle(self) -> Point3:
        """Middle of the whole cylinder [m]."""
        return _compute_midpoint(self.start, self.end)

    @property
    def bounding_box(self) -> Box:
        """The box around it."""
        low, high = self.start, self.end
        for k in self.cross_axis_indices:
            low = _shift_along_axis(low, k, -0.5 * self.diameter)
            high = _shift_along_axis(high, k, 0.5 * self.diameter)
        return Box(low, high)

    @property
    def inward_box(self) -> Box:
        """The box around what lies in the part."""
        box = self.bounding_box
        if self.inward is None:
            return box
        low, high = list(box.low), list(box.high)
        for k in self.cross_axis_indices:
            if self.inward[k] > 0.0:
                low[k] = self.start[k]
            elif self.inward[k] < 0.0:
                high[k] = self.start[k]
        return Box((low[0], low[1], low[2]), (high[0], high[1], high[2]))

    @property
    def volume(self) -> float:
        """Volume of what lies in the part [m^3]."""
        whole = 0.25 * math.pi * self.diameter**2 * self.length
        if self.inward is None:
            return whole
        return 0.5 * whole

    @property
    def centre(self) -> Point3:
        """Centre of mass of what lies in the part [m]: of half a disc 4 r / (3 pi) off its side."""
        if self.inward is None:
            return self.middle
        offset = 2.0 * self.diameter / (3.0 * math.pi)
        return add_points(self.middle, _scale_point(self.inward, offset))

    def move(self, shift: Point3) -> "Cylinder":
        """Return it elsewhere [m]."""
        return replace(self, start=add_points(self.start, shift))

    def build_solid(self) -> cad.door.Body:
        """Build it as a solid."""
        radius = 0.5 * self.diameter
        first, second = self.cross_axis_indices
        u = _shift_along_axis((0.0, 0.0, 0.0), first, radius)
        v = _shift_along_axis((0.0, 0.0, 0.0), second, radius)
        circle = cad.kernel.outline_circle(self.start, u, v)
        return cad.kernel.extrude(
            circle, _shift_along_axis((0.0, 0.0, 0.0), self.axis_index, self.length)
        )


def add_points(point: Point3, offset: Point3) -> Point3:
    """Add two points, coordinate by coordinate."""
    return point[0] + offset[0], point[1] + offset[1], point[2] + offset[2]


def _scale_point(point: Point3, factor: float) -> Point3:
    """Multiply each coordinate of a point by a factor."""
    x, y, z = point
    return factor * x, factor * y, factor * z


def _compute_midpoint(low: Point3, high: Point3) -> Point3:
    """Find the point halfway between two others."""
    return _scale_point(add_points(low, high), 0.5)


def _shift_along_axis(point: Point3, axis_index: int, distance: float) -> Point3:
    """Shift a point along an axis [m]."""
    coordinates = list(point)
    coordinates[axis_index] += distance
    x, y, z = coordinates
    return x, y, z


def convert_from_millimetres(point: Point3) -> Point3:
    """Convert a point from millimetres to metres."""
    x, y, z = point
    return _MILLIMETRE * x, _MILLIMETRE * y, _MILLIMETRE * z


def make_box_mm(low: Point3, high: Point3) -> Box:
    """Make a box by two corners in millimetres."""
    return Box(convert_from_millimetres(low), convert_from_millimetres(high))


def make_rod_mm(
    axis: Axis, start: Point3, diameter: float, length: float, deviations: Deviations | None = None
) -> Cylinder:
    """Make a rod from its start, diameter and length in millimetres; `deviations` are in metres."""
    return Cylinder(
        axis,
        convert_from_millimetres(start),
        _MILLIMETRE * diameter,
        _MILLIMETRE * length,
        deviations,
    )


def make_bore_mm(
    axis: Axis, start: Point3, diameter: float, length: float, fit: str = ""
) -> Cylinder:
    """Make a bore from its start, diameter and length in millimetres.

    `fit` is ``"H7"`` (ISO 286-2), or the thread that is cut in the bore, such as ``"M4"``.
    """
    deviations = None
    thread = ""
    if fit == "H7":
        deviations = find_h7_deviations(_MILLIMETRE * diameter)
    elif fit:
        thread = fit
    return Cylinder(
        axis,
        convert_from_millimetres(start),
        _MILLIMETRE * diameter,
        _MILLIMETRE * length,
        deviations,
        thread,
    )


def repeat_bore_along_axis(
    bore: Cylinder, axis: Axis, places_mm: Iterable[float]
) -> list[Cylinder]:
    """Repeat a bore at several places.

    They differ from `bore` in the coordinate along an axis, which is one of `places_mm`.
    """
    bores = []
    for place in places_mm:
        coordinates = dict(zip(AXES, bore.start, strict=True))
        coordinates[axis] = _MILLIMETRE * place
        start = coordinates["x"], coordinates["y"], coordinates["z"]
        bores.append(replace(bore, start=start))
    return bores


def find_h7_deviations(diameter: float) -> Deviations:
    """Find the deviations of a bore H7 of a diameter up to 18 mm [m]."""
    for row in _H7:
        if diameter <= row.up_to:
            return Deviations(row.upper, 0.0)
    raise ValueError(f"H7 must be for a diameter up to {_H7[-1].up_to} m, got {diameter}")
