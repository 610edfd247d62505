"""The path of the ball's centre over a stimulus: corners become circles, planes lines."""

import itertools
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact import Array
from stepblocks.errors import ContactError

Point = tuple[float, float]  # x and z [m]
STEEPEST = 1e9  # slope that stands for a vertical wall
# chord of a circle [rad]; the slope between knots is interpolated, so the notch itself is exact
_ANGLE_STEP = 2e-3
_LEAST_KNOTS = 16  # of one circle
_MOST_CORNERS = 2000  # of a profile
_PASSES = 3  # each adds the crossings that it finds
_MOST_KNOTS = 20_000  # of all circles together; a scan has hundreds of them
_CATCH = 1e-6  # a change of slope that counts as a notch
_CLOSE = 1e-15  # by which a place may lie beside the end of a shape [m]
_AT_ONCE = 100_000  # heights of all shapes, beyond which a path is looked at in parts


class Disc(NamedTuple):
    """A disc, or a corner of radius 0."""

    x: float  # of its centre [m]
    z: float  # of its centre [m]
    radius: float  # [m]


class Line(NamedTuple):
    """A line towards growing x."""

    start: Point
    end: Point


class Notch(NamedTuple):
    """Where a probe catches on the path of its centre."""

    x: float  # [m]
    z: float  # [m]
    angle: float  # critical angle [rad]; 0 for none


class FeatureRange(NamedTuple):
    """Where the edge lies that is asked about."""

    first: float  # of the positions that a ball touches [m]
    last: float
    ball_radius: float  # m


@dataclass(frozen=True)
class CentrePath:
    """Path of one point of a ball as pieces between knots.

    Each piece has slopes of its own at both ends.

    Attributes
    ----------
    x : ndarray
        Knots [m], ascending, shape (n,).
    z : ndarray
        Height of that point [m], shape (n,); the centre, unless a subclass says otherwise.
    slope_start, slope_end : ndarray
        Slope dz/dx where each piece begins and ends [1], shape (n - 1,).
    feature : FeatureRange, optional
        Where a catch is looked for; everywhere without it.
    """

    x: Array
    z: Array
    slope_start: Array
    slope_end: Array
    feature: FeatureRange | None = field(default=None, kw_only=True)

    def find_notch(self, direction: float) -> Notch:
        """Find where the probe catches: the steepest rise in the direction of the drag."""
        if direction > 0:
            first_knot = 0
            slope, x = self.slope_start, self.x[:-1]
        else:
            first_knot = 1
            slope, x = -self.slope_end, self.x[1:]
        if self.feature is not None:
            reach = self.feature.ball_radius * slope / np.hypot(1.0, slope)
            touched = x + math.copysign(1.0, direction) * reach
            is_behind_first = touched >= self.feature.first
            is_before_last = touched <= self.feature.last
            is_asked = is_behind_first & is_before_last
            slope = np.where(is_asked, slope, -np.inf)
        piece = int(np.argmax(slope))
        knot = piece + first_knot
        angle = _convert_slope_to_critical_angle(float(slope[piece]))
        return Notch(float(self.x[knot]), float(self.z[knot]), angle)

    def scaled(self, scale: float) -> "CentrePath":
        """Return the path magnified; slopes, and with them all forces, stay."""
        x, z = self.x * scale, self.z * scale
        feature = self.feature
        if feature is not None:
            first, last = scale * feature.first, scale * feature.last
            ball_radius = scale * feature.ball_radius
            feature = FeatureRange(first, last, ball_radius)
        return CentrePath(x, z, self.slope_start, self.slope_end, feature=feature)


def _convert_slope_to_critical_angle(slope: float) -> float:
    """Convert a slope to a critical angle [rad]; 0 where it is too small to catch."""
    if slope >= STEEPEST:
        return 0.5 * math.pi
    angle = math.atan(max(slope, 0.0))
    if angle > _CATCH:
        return angle
    return 0.0


def build_outline(points: ArrayLike) -> tuple[list[Disc], list[Line]]:
    """Discs at the corners and lines between them, of a profile of shape (n, 2) [m].

    Equal x make a vertical wall.
    """
    corners = np.asarray(points, dtype=np.float64)
    if not _is_usable_profile(corners):
        raise ContactError(
            f"a profile must have 2 to {_MOST_CORNERS} finite points that do not descend in x, got "
            f"{len(corners)}"
        )
    discs = [Disc(x, z, 0.0) for x, z in corners[1:-1].tolist()]
    lines = []
    for (x0, z0), (x1, z1) in itertools.pairwise(corners.tolist()):
        if x1 > x0:
            lines.append(Line((x0, z0), (x1, z1)))
    return discs, lines


def _is_usable_profile(corners: Array) -> bool:
    """Tell whether corners, shape (n, 2), are finite, few enough, and do not descend in x."""
    # every corner becomes a circle, and every circle is compared with every other
    if not 2 <= len(corners) <= _MOST_CORNERS:
        return False
    if not np.isfinite(corners).all():
        return False
    return bool((np.diff(corners[:, 0]) >= 0.0).all())


def build_envelope_path(discs: list[Disc], lines: list[Line], ball_radius: float) -> CentrePath:
    """Upper envelope of circles grown by the ball and of lines lifted by it."""
    start, end = lines[0].start[0], lines[-1].end[0]
    shapes = _GrownShapes(discs, lines, ball_radius)
    places = np.concatenate([[start, end], shapes.compute_knot_positions()])
    knots = np.unique(np.clip(places, start, end))
    for _ in range(_PASSES):
        refined = _add_crossing_knots(shapes, knots)
        if len(refined) == len(knots):
            break
        knots = refined
    heights = shapes.compute_heights(shapes.find_highest_shapes(knots), knots)
    top_of_piece = shapes.find_highest_shapes(_compute_middles(knots))
    slope_start = shapes.compute_slopes(top_of_piece, knots[:-1])
    slope_end = shapes.compute_slopes(top_of_piece, knots[1:])
    return CentrePath(knots, heights, slope_start, slope_end)


def _compute_middles(knots: Array) -> Array:
    """Find the middle between neighbouring knots [m], shape (n - 1,)."""
    return np.asarray(0.5 * (knots[1:] + knots[:-1]))


def _add_crossing_knots(shapes: "_GrownShapes", knots: Array) -> Array:
    """Add the crossings between neighbouring pieces whose highest shapes differ."""
    middle = _compute_middles(knots)
    top = shapes.find_highest_shapes(middle)
    changes_to_next = top[1:] != top[:-1]
    crossings = []
    for piece in np.flatnonzero(changes_to_next).tolist():
        pair = top[piece : piece + 2]
        crossing = shapes.find_crossing(pair, middle[piece], middle[piece + 1])
        crossings.append(crossing)
    merged = np.unique(np.concatenate([knots, crossings]))
    is_apart = np.concatenate([[True], np.diff(merged) > _CLOSE])
    return np.asarray(merged[is_apart])


class _ShapeRow(NamedTuple):
    """A circle or a line as one row of `_GrownShapes`."""

    x: float  # of the middle, or of the first point [m]
    z: float  # of the same [m]
    radius: float  # 0 for a line [m]
    slope: float  # 0 for a circle [1]
    begin: float  # from where [m]
    end: float  # to where [m]


class _GrownShapes:
    """Circles, then lines, as arrays of shape (n,)."""

    def __init__(self, discs: list[Disc], lines: list[Line], ball_radius: float) -> None:
        self.circles = len(discs)
        rows = []
        for disc in discs:
            rows.append(_grow_disc_by_ball(disc, ball_radius))
        for line in lines:
            rows.append(_lift_line_by_ball(line, ball_radius))
        columns = np.array(rows).T
        self.x, self.z, self.radius, self.slope, self.begin, self.end = columns

    def compute_knot_positions(self) -> Array:
        """Return x of knots on every circle, and at both ends of every line, in no order [m]."""
        wanted = math.ceil(math.pi / _ANGLE_STEP)
        affordable = _MOST_KNOTS // max(self.circles, 1)
        count = max(_LEAST_KNOTS, min(wanted, affordable))
        angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, count)
        sines = np.sin(angles)
        middle = self.x[: self.circles, None]
        radius = self.radius[: self.circles, None]
        on_circles = (middle + radius * sines).ravel()
        lines = slice(self.circles, None)
        return np.concatenate([on_circles, self.begin[lines], self.end[lines]])

    def compute_heights(self, shape_indices: NDArray[np.int64], x: Array | float) -> Array:
        """Heights of shapes, by number, at their places [m]; minus infinity beyond their ends."""
        run = x - self.x[shape_indices]
        square = (
            self.radius[shape_indices] ** 2 - run**2
        )  # of the height over the middle of a circle
        arc = np.sqrt(np.maximum(square, 0.0))
        climb = self.slope[shape_indices] * run
        height = self.z[shape_indices] + climb + arc
        is_behind_begin = x >= self.begin[shape_indices] - _CLOSE
        is_before_end = x <= self.end[shape_indices] + _CLOSE
        is_line = shape_indices >= self.circles
        is_on_shape = (square >= 0.0) | is_line
        is_there = is_behind_begin & is_before_end & is_on_shape
        return np.where(is_there, height, -np.inf)

    def find_highest_shapes(self, x: Array) -> NDArray[np.int64]:
        """Find the highest shape at each place, part by part: few shapes lie in each."""
        parts = max(1, len(x) * len(self.x) // _AT_ONCE)
        highest = []
        for part in np.array_split(x, parts):
            first, last = part[0], part[-1]
            is_near = (self.begin <= last + _CLOSE) & (self.end >= first - _CLOSE)
            near = np.union1d(0, np.flatnonzero(is_near))  # where none is, the first
            heights = self.compute_heights(near[:, None], part)
            highest.append(near[heights.argmax(axis=0)])
        return np.concatenate(highest)

    def find_crossing(self, shape_pair: NDArray[np.int64], low: float, high: float) -> float:
        """Find where two shapes cross between two places [m]; the lower place if they do not."""
        from scipy.optimize import brentq

        def compute_difference(x: float) -> float:
            """Return the height of the first shape over the second at a place [m]."""
            first, second = self.compute_heights(shape_pair, x).tolist()
            if math.isinf(first) or math.isinf(second):
                return math.copysign(1.0, first)
            return float(first - second)

        if compute_difference(low) * compute_difference(high) >= 0.0:
            return low
        return float(brentq(compute_difference, low, high, xtol=1e-16, rtol=8.9e-16))

    def compute_slopes(self, shape_indices: NDArray[np.int64], x: Array) -> Array:
        """Slopes of shapes, by number, at their places [1]."""
        run = self.x[shape_indices] - x
        square = self.radius[shape_indices] ** 2 - run**2
        arc = np.sqrt(np.maximum(square, _CLOSE**2))
        on_circle = np.clip(run / arc, -STEEPEST, STEEPEST)
        is_circle = shape_indices < self.circles
        return np.asarray(np.where(is_circle, on_circle, self.slope[shape_indices]))


def _grow_disc_by_ball(disc: Disc, ball_radius: float) -> _ShapeRow:
    """Grow a disc by the ball."""
    radius = disc.radius + ball_radius
    begin = disc.x - disc.radius - ball_radius
    end = disc.x + disc.radius + ball_radius
    return _ShapeRow(disc.x, disc.z, radius, slope=0.0, begin=begin, end=end)


def _lift_line_by_ball(line: Line, ball_radius: float) -> _ShapeRow:
    """Lift a line by the ball along its normal."""
    (x0, z0), (x1, z1) = line
    slope = (z1 - z0) / (x1 - x0)
    length = math.hypot(1.0, slope)
    shift = -ball_radius * slope / length
    lift = ball_radius / length
    begin, end = x0 + shift, x1 + shift
    return _ShapeRow(begin, z0 + lift, radius=0.0, slope=slope, begin=begin, end=end)
