"""The path of a probe tip over a profile: exact dilation, contact points and the slope that a drag meets.

The lower side of a tip is the function ``t(v) >= 0`` that a dilation needs: the height of its surface over its lowest
point at the lateral distance `v` from its axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact.domain import require_positive
from stepblocks.contact.path import profile_kernels as kernels
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]
Surface = Literal["polyline", "samples"]
Edges = Literal["strict", "flat"]


@dataclass(frozen=True)
class Ball:
    """A spherical tip; its arcs are handled in closed form."""

    radius: float  # R [m]

    def __post_init__(self) -> None:
        require_positive("ball radius", self.radius, "m")

    @property
    def shape(self) -> kernels.TipShape:
        """As the kernels take it."""
        return kernels.TipShape(self.radius, -self.radius, self.radius, np.zeros(2), np.zeros(2), True)

    def height(self, distance: Floats) -> Floats:
        """Height t [m] over the lowest point; infinite beyond the reach."""
        inside = np.abs(distance) <= self.radius
        squared = np.where(inside, np.square(distance), 0.0)
        # R - sqrt(R^2 - v^2) written without the difference of two near numbers
        tip = squared / (self.radius + np.sqrt(self.radius * self.radius - squared))
        return np.where(inside, tip, np.inf)


class TipProfile:
    """A tip given as a polyline, for example one that was worn and scanned.

    The profile need not be convex. One that is convex costs N log N on a surface of N points, any other one
    N times the number of points under the tip.
    """

    def __init__(self, distance: ArrayLike, height: ArrayLike) -> None:
        v, t = np.asarray(distance, dtype=np.float64), np.asarray(height, dtype=np.float64)
        if v.ndim != 1 or v.shape != t.shape or v.size < 2:
            raise ContactError(f"tip profile needs two equal columns of at least 2 points, got {v.shape} and {t.shape}")
        if not (np.isfinite(v).all() and np.isfinite(t).all()):
            raise ContactError("tip profile must be finite, got a NaN or an infinity")
        if not (np.diff(v) > 0.0).all():
            raise ContactError("tip profile distances must increase strictly")
        if not v[0] < 0.0 < v[-1]:
            raise ContactError(f"tip profile must reach to both sides of its axis, got {v[0]:g} m to {v[-1]:g} m")
        self.distance: Floats = v
        self.elevation: Floats = t - t.min()
        slopes = np.diff(self.elevation) / np.diff(v)
        # a slope may fall by rounding alone where the profile was computed from a circle
        self.convex: bool = bool((np.diff(slopes) >= -1e-9 * max(1.0, float(np.abs(slopes).max()))).all())

    @property
    def shape(self) -> kernels.TipShape:
        """As the kernels take it."""
        low, high = float(self.distance[0]), float(self.distance[-1])
        return kernels.TipShape(0.0, low, high, self.distance, self.elevation, self.convex)

    def height(self, distance: Floats) -> Floats:
        """Height t [m] over the lowest point; infinite beyond the reach."""
        return np.interp(distance, self.distance, self.elevation, left=np.inf, right=np.inf)


Tip = Ball | TipProfile


def flattened_ball(radius: float, flat_width: float, points: int = 2001) -> TipProfile:
    """Profile of a ball whose lowest part is worn to a flat.

    Examples
    --------
    >>> worn = flattened_ball(125e-6, 40e-6)
    >>> float(worn.height(np.array([15e-6]))[0])
    0.0
    """
    ball = Ball(radius)
    if not 0.0 <= flat_width < 2.0 * radius:
        raise ContactError(f"flat_width must lie between 0 and the diameter ({2 * radius:g} m), got {flat_width:g} m")
    start = math.asin(0.5 * flat_width / radius)
    angles = np.linspace(start, 0.5 * math.pi, max(points // 2, 8))
    v = radius * np.sin(angles)
    t = ball.height(np.minimum(v, radius))
    t -= t[0]
    right = slice(1, None) if flat_width == 0.0 else slice(None)
    return TipProfile(np.concatenate([-v[::-1], v[right]]), np.concatenate([t[::-1], t[right]]))


@dataclass(frozen=True)
class TipPath:
    """Where the tip's lowest point runs while the tip is dragged over a profile."""

    position: Floats  # shape (n,); of the tip's axis along the drag [m], increasing
    height: Floats  # shape (n,); of the tip's lowest point [m]; NaN where the tip has no surface under it
    contact: Floats  # shape (n,); position of the point that is touched [m]
    slope: Floats  # shape (n,); of the path just ahead of the tip [1], exact: from the contact, not from differences
    supported: NDArray[np.bool_]  # shape (n,); False where missing samples or a levelled end lie within the tip's reach
    element: NDArray[np.int64]  # shape (n,); which row of `elements` is touched; -1 for none
    elements: Floats  # shape (m, 5); the surface as segments (x0, z0, x1, z1, contact offset) [m]
    tip: Tip


def profile_path(
    x: ArrayLike,
    z: ArrayLike,
    tip: Tip,
    *,
    positions: ArrayLike | None = None,
    surface: Surface = "polyline",
    edges: Edges = "strict",
) -> TipPath:
    """Path of a tip over a profile by exact dilation, ``h(x) = max_u z(u) - t(u - x)``.

    Points [m] come in order of `x`, two equal ones are a riser; NaN heights were not measured. Between them the surface is
    joined by straight lines, or (``samples``) is not there: a tip sinks up to ``dx^2 / 8R`` between samples. ``strict``
    keeps to positions at which nothing beyond the ends could be touched, ``flat`` lets the surface go on level. Without
    `positions` those of the profile are taken, and points between them at most a 25th of the tip's width apart.

    Examples
    --------
    A ball meets a sharp step of 25 um at the critical angle of equation (2).

    >>> path = profile_path([-1e-3, 0, 0, 1e-3], [0, 0, 25e-6, 25e-6], Ball(125e-6))
    >>> from stepblocks.contact.path.catches import steepest
    >>> round(float(np.degrees(steepest(path).angle)), 6)
    36.869898
    """
    xs, zs = _checked(x, z)
    shape, finite = tip.shape, np.isfinite(zs)
    width = shape.high - shape.low
    elements = _elements(xs, zs, tip, surface)
    used = _effective_reach(tip, float(np.ptp(zs[finite])))
    if edges == "flat":
        (first, last), (start, end) = xs[finite][[0, -1]], zs[finite][[0, -1]]
        before = [first - 2.0 * width, start, first, start, 0.0]
        elements = np.vstack([before, elements, [last, end, last + 2.0 * width, end, 0.0]])
    elif xs[-1] - xs[0] < used[1] - used[0]:
        raise ContactError(
            f"tip reaches over {used[1] - used[0]:.3g} m and must not be larger than the profile "
            f"({xs[-1] - xs[0]:.3g} m); shorten it or use edges='flat'"
        )
    where = _positions(xs, positions, width, used, edges)
    height, contact, which = kernels.dilate_profile(where, elements, shape)
    slope = kernels.path_slopes(where, contact, which, elements, shape)
    return TipPath(where, height, contact, slope, _supported(xs, finite, where, used), which, elements, tip)


def _elements(x: Floats, z: Floats, tip: Tip, surface: Surface) -> Floats:
    """Segments of a profile with the offset at which the tip is as steep as each, shape (m, 5) [m]."""
    finite = np.isfinite(z)
    if surface == "samples":
        xs, zs = x[finite], z[finite]
        pieces = [xs, zs, xs, zs]
    else:
        joined = finite[:-1] & finite[1:]
        lone = finite & ~np.concatenate([[False], joined]) & ~np.concatenate([joined, [False]])
        ends = x[:-1], z[:-1], x[1:], z[1:]
        pieces = [np.concatenate([end[joined], own[lone]]) for end, own in zip(ends, (x, z, x, z), strict=True)]
    order = np.argsort(pieces[0], kind="stable")
    x0, z0, x1, z1 = (piece[order] for piece in pieces)
    return np.ascontiguousarray(np.column_stack([x0, z0, x1, z1, _offset_of_slope(x1 - x0, z1 - z0, tip)]))


def _offset_of_slope(run: Floats, rise: Floats, tip: Tip) -> Floats:
    if isinstance(tip, Ball):
        length = np.hypot(run, rise)
        return np.divide(tip.radius * rise, length, out=np.zeros_like(run), where=length > 0.0)
    slopes = np.diff(tip.elevation) / np.diff(tip.distance)
    slope = np.divide(rise, run, out=np.zeros_like(run), where=run > 0.0)
    return tip.distance[np.searchsorted(slopes, slope)]


def _checked(x: ArrayLike, z: ArrayLike) -> tuple[Floats, Floats]:
    xs, zs = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    if xs.ndim != 1 or xs.shape != zs.shape:
        raise ContactError(f"profile needs x and z of one equal length, got shapes {xs.shape} and {zs.shape}")
    if xs.size < 2:
        raise ContactError(f"profile needs at least 2 points, got {xs.size}")
    if not np.isfinite(xs).all():
        raise ContactError("profile positions must be finite, got a NaN or an infinity")
    if np.isinf(zs).any():
        raise ContactError("profile heights must be finite or NaN for missing, got an infinity")
    if np.isfinite(zs).sum() < 2:
        raise ContactError("profile needs at least 2 heights that are not NaN")
    if (np.diff(xs) < 0.0).any():
        raise ContactError(f"profile positions must not decrease, they do at point {int(np.argmin(np.diff(xs))) + 1}")
    if xs[-1] == xs[0]:
        raise ContactError("profile must extend along x, got a single position")
    return xs, zs


def _effective_reach(tip: Tip, span: float) -> tuple[float, float]:
    """Find the part of the tip that can touch a surface of this height range."""
    _, low, high, *_ = tip.shape
    if isinstance(tip, Ball):
        if span >= tip.radius:
            return low, high
        half = float(np.sqrt(span * (2.0 * tip.radius - span)))
        return -half, half
    near = tip.distance[tip.elevation <= span]
    step = float(np.diff(tip.distance).max())
    return max(low, float(near.min()) - step), min(high, float(near.max()) + step)


def _positions(x: Floats, wanted: ArrayLike | None, reach: float, used: tuple[float, float], edges: Edges) -> Floats:
    if wanted is None:
        pieces = np.maximum(np.ceil(np.diff(x) / (0.04 * reach)), 1).astype(int)
        if pieces.max() == 1:
            where = np.unique(x)
        else:
            parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(x[:-1], x[1:], pieces, strict=True)]
            where = np.unique(np.concatenate([*parts, x[-1:]]))
        if edges == "strict":
            # the first and last tip positions that the profile fully decides are always among them
            ends = [x[0] - used[0], x[-1] - used[1]]
            inner = (where > ends[0]) & (where < ends[1])
            where = np.unique(np.concatenate([ends[:1], where[inner], ends[1:]]))
        return np.ascontiguousarray(where)
    given = np.asarray(wanted, dtype=np.float64)
    if given.ndim != 1 or given.size == 0 or not np.isfinite(given).all() or (np.diff(given) <= 0.0).any():
        raise ContactError("positions must be finite and increase strictly, and there must be at least one")
    first, last = (x[0] - used[0], x[-1] - used[1]) if edges == "strict" else (x[0], x[-1])
    if given[0] < first or given[-1] > last:
        raise ContactError(
            f"positions must lie between {first:.6g} m and {last:.6g} m with edges={edges!r}, "
            f"got {given[0]:.6g} m to {given[-1]:.6g} m"
        )
    return np.ascontiguousarray(given)


def _supported(x: Floats, finite: NDArray[np.bool_], where: Floats, used: tuple[float, float]) -> NDArray[np.bool_]:
    inside = (where + used[0] >= x[0] * (1 - 1e-12 * np.sign(x[0]))) & (where + used[1] <= x[-1] + 1e-12 * abs(x[-1]))
    if finite.all():
        return np.asarray(inside)
    holes = x[~finite]
    first = np.searchsorted(holes, where + used[0], side="left")
    last = np.searchsorted(holes, where + used[1], side="right")
    return np.asarray(inside & (first == last))
