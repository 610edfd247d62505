"""The path of the ball's centre over a stimulus, what a point-like proxy slides on.

Corners become circles, planes lines.
"""

import itertools
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact import Array
from stepblocks.errors import ContactError

Disc = tuple[float, float, float]  # centre and radius [m]
Line = tuple[tuple[float, float], tuple[float, float]]  # from one point to another [m]
STEEPEST = 1e9  # slope that stands for a vertical wall
# chord of a circle [rad]; the slope between knots is interpolated, so the notch itself is exact
_ANGLE_STEP = 2e-3
_MOST_KNOTS = 20_000  # of all circles together; a scan has hundreds of them
_CATCH = 1e-6  # a change of slope that counts as a notch
_CLOSE = 1e-15  # by which a place may lie beside the end of a shape [m]
_AT_ONCE = 100_000  # heights of all shapes, beyond which a path is looked at in parts


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

    def find_notch(self, direction: float) -> tuple[float, float, float]:
        """Find where the probe catches: x, z and the critical angle, 0 for none."""
        slope, knots = (
            (self.slope_start, slice(0, -1)) if direction > 0 else (-self.slope_end, slice(1, None))
        )
        if self.feature is not None:
            reach = self.feature.ball_radius * slope / np.hypot(1.0, slope)
            touched = self.x[knots] + math.copysign(1.0, direction) * reach
            slope = np.where(
                (touched >= self.feature.first) & (touched <= self.feature.last), slope, -np.inf
            )
        index = int(np.argmax(slope))
        rise = float(slope[index])
        knot = index + (direction <= 0)
        angle = 0.5 * math.pi if rise >= STEEPEST else math.atan(max(rise, 0.0))
        return float(self.x[knot]), float(self.z[knot]), angle if angle > _CATCH else 0.0

    def scaled(self, scale: float) -> "CentrePath":
        """Return the path magnified; slopes, and with them all forces, stay."""
        return CentrePath(
            self.x * scale,
            self.z * scale,
            self.slope_start,
            self.slope_end,
            feature=self.feature and FeatureRange(*(scale * one for one in self.feature)),
        )


def find_outline(points: ArrayLike) -> tuple[list[Disc], list[Line]]:
    """Discs at the corners and lines between them, of a profile of shape (n, 2) [m].

    Equal x make a vertical wall.
    """
    flat = np.asarray(points, dtype=np.float64)
    # every corner becomes a circle, and every circle is compared with every other
    ContactError.require(
        2 <= len(flat) <= 2000 and np.isfinite(flat).all() and (np.diff(flat[:, 0]) >= 0.0).all(),
        f"a profile must have 2 to 2000 finite points that do not descend in x, got {len(flat)}",
    )
    corners = [(float(x), float(z)) for x, z in flat]
    lines = [(a, b) for a, b in itertools.pairwise(corners) if b[0] > a[0]]
    return [(x, z, 0.0) for x, z in corners[1:-1]], lines


def build_envelope_path(discs: list[Disc], lines: list[Line], ball_radius: float) -> CentrePath:
    """Upper envelope of circles grown by the ball and of lines lifted by it."""
    start, end = lines[0][0][0], lines[-1][1][0]
    shapes = _Shapes(discs, lines, ball_radius)
    knots = np.unique(np.clip(np.concatenate([[start, end], shapes.knots()]), start, end))
    for _ in range(3):  # each pass adds the crossings that it finds between neighbouring pieces
        middle = 0.5 * (knots[1:] + knots[:-1])
        top = shapes.top(middle)
        changes = np.flatnonzero(top[1:] != top[:-1])
        found = [shapes.crossing(top[i : i + 2], middle[i], middle[i + 1]) for i in changes]
        merged = np.unique(np.concatenate([knots, found])) if found else knots
        merged = merged[np.concatenate([[True], np.diff(merged) > _CLOSE])]
        if len(merged) == len(knots):
            break
        knots = merged
    top = shapes.top(0.5 * (knots[1:] + knots[:-1]))
    return CentrePath(
        knots,
        shapes.heights(shapes.top(knots), knots),
        shapes.slopes(top, knots[:-1]),
        shapes.slopes(top, knots[1:]),
    )


class _Shapes:
    # Circles, then lines: middle or first point, radius and slope, and from where to where
    def __init__(self, discs: list[Disc], lines: list[Line], ball_radius: float) -> None:
        self.circles = len(discs)
        rows = [
            (x, z, r + ball_radius, 0.0, x - r - ball_radius, x + r + ball_radius)
            for x, z, r in discs
        ]
        for (x0, z0), (x1, z1) in lines:
            slope = (z1 - z0) / (x1 - x0)
            length = math.hypot(1.0, slope)
            shift = -ball_radius * slope / length
            rows.append((x0 + shift, z0 + ball_radius / length, 0.0, slope, x0 + shift, x1 + shift))
        self.x, self.z, self.r, self.slope, self.begin, self.end = np.array(rows).T

    def knots(self) -> Array:
        count = max(16, min(math.ceil(math.pi / _ANGLE_STEP), _MOST_KNOTS // max(self.circles, 1)))
        circles: Array = (
            self.x[: self.circles, None]
            + self.r[: self.circles, None]
            * np.sin(np.linspace(-0.5 * math.pi, 0.5 * math.pi, count))
        ).ravel()
        return np.concatenate([circles, self.begin[self.circles :], self.end[self.circles :]])

    def heights(self, index: NDArray[np.int64], x: Array | float) -> Array:
        # Heights of shapes, by number, at their places
        run = x - self.x[index]
        across = self.r[index] ** 2 - run**2
        height = self.z[index] + self.slope[index] * run + np.sqrt(np.maximum(across, 0.0))
        is_there = (
            (x >= self.begin[index] - _CLOSE)
            & (x <= self.end[index] + _CLOSE)
            & ((across >= 0.0) | (index >= self.circles))
        )
        return np.where(is_there, height, -np.inf)

    def top(self, x: Array) -> NDArray[np.int64]:
        # Highest shape at each place: in a short part of the path few shapes lie
        found = []
        for part in np.array_split(x, max(1, len(x) * len(self.x) // _AT_ONCE)):
            is_near = (self.begin <= part[-1] + _CLOSE) & (self.end >= part[0] - _CLOSE)
            near = np.union1d(0, np.flatnonzero(is_near))  # where none is, the first
            found.append(near[self.heights(near[:, None], part).argmax(axis=0)])
        return np.concatenate(found)

    def crossing(self, pair: NDArray[np.int64], low: float, high: float) -> float:
        from scipy.optimize import brentq

        def difference(x: float) -> float:
            a, b = self.heights(pair, x).tolist()
            return math.copysign(1.0, a) if math.isinf(a) or math.isinf(b) else a - b

        if difference(low) * difference(high) >= 0.0:
            return low
        return float(brentq(difference, low, high, xtol=1e-16, rtol=8.9e-16))

    def slopes(self, index: NDArray[np.int64], x: Array) -> Array:
        run = self.x[index] - x
        across = np.sqrt(np.maximum(self.r[index] ** 2 - run**2, _CLOSE**2))
        return np.asarray(
            np.where(
                index < self.circles, np.clip(run / across, -STEEPEST, STEEPEST), self.slope[index]
            )
        )
