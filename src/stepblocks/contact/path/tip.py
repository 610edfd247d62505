"""The lower side of a probe tip, as the function t(v) >= 0 that a dilation needs.

``t(v)`` is the height of the tip's surface over its lowest point at the lateral distance `v` from the axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact.domain import require_positive
from stepblocks.errors import ContactError


@dataclass(frozen=True)
class Ball:
    """A spherical tip; its arcs are handled in closed form."""

    radius: float  # R [m]

    def __post_init__(self) -> None:
        require_positive("ball radius", self.radius, "m")

    @property
    def reach(self) -> tuple[float, float]:
        """Lateral distances between which the tip exists [m]."""
        return -self.radius, self.radius

    def height(self, distance: NDArray[np.float64]) -> NDArray[np.float64]:
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
        self.distance: NDArray[np.float64] = v
        self.elevation: NDArray[np.float64] = t - t.min()
        slopes = np.diff(self.elevation) / np.diff(v)
        # a slope may fall by rounding alone where the profile was computed from a circle
        self.convex: bool = bool((np.diff(slopes) >= -1e-9 * max(1.0, float(np.abs(slopes).max()))).all())

    @property
    def reach(self) -> tuple[float, float]:
        """Lateral distances between which the tip exists [m]."""
        return float(self.distance[0]), float(self.distance[-1])

    def height(self, distance: NDArray[np.float64]) -> NDArray[np.float64]:
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
