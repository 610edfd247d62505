"""The path of a tip as the integrator needs it.

Cubic pieces between nodes, and the kinks where two contacts share the load.
"""

import math
from bisect import bisect
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact.counterface import Counterface, Profile, Step
from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.path.centre import Array, CentrePath, FeatureRange
from stepblocks.contact.path.profile import build_profile_path, find_interval_slopes
from stepblocks.errors import ContactError

_KINK = math.radians(
    2.0
)  # a turn at which two contacts share the load, on a surface that may be rough
_SHARED = 1e-3  # the same on a path whose notches are exact [rad]
NEAR = 0.1  # radii from a kink within which both sides may be touched
_FEW_KINKS = 4  # of a shape that was declared, not scanned
_LEVEL = 400.0  # radii by which a surface goes on level: a released spring may throw the tip far


@dataclass(frozen=True)
class Track(CentrePath):
    """Path of a ball's lowest point, cubic between its knots and level beyond them."""

    kinks: NDArray[np.int64]  # knots at which two contacts share the load
    ball_radius: float  # R [m]

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Slopes to the left and to the right of each knot [1]; they differ at a kink."""
        return np.pad(self.slope_end, (1, 0)), np.pad(self.slope_start, (0, 1))

    @cached_property
    def cubics(self) -> Array:
        """Coefficients of each piece in powers of the distance from its left knot.

        The shape is (n - 1, 4).
        """
        h, a, b = np.diff(self.x), self.slope_start, self.slope_end
        d = np.diff(self.z) / h
        return np.column_stack(
            [self.z[:-1], a, (3.0 * d - 2.0 * a - b) / h, (a + b - 2.0 * d) / (h * h)]
        )

    @cached_property
    def branches(self) -> Array:
        """Height, slope, half the curvature of both branches at each kink; shape (m, 2, 3)."""
        h = np.diff(self.x)[self.kinks - 1]
        k0, k1, k2, k3 = self.cubics[self.kinks - 1].T
        ends = (
            k0 + h * (k1 + h * (k2 + h * k3)),
            k1 + h * (2.0 * k2 + 3.0 * h * k3),
            k2 + 3.0 * h * k3,
        )
        both = np.stack([np.column_stack(ends), self.cubics[self.kinks, :3]], axis=1)
        # a branch is a line or an arc about a corner, which bends by 1 / R; the cubic of a piece
        # that is short beside the sampling may bend by far more
        bend = 0.5 * (1.0 + both[..., 1] ** 2) ** 1.5 / self.ball_radius
        both[..., 2] = np.clip(both[..., 2], -1.05 * bend, 0.05 * bend)
        return both

    def list_separate_kinks(self, depth: float) -> NDArray[np.int64]:
        """List the kinks at which two contacts share the load and part before the next one is near.

        One whose branches are not `depth` [m] apart half way to a sharper kink, or where a second
        contact is no longer looked for, is texture that the contact presses flat; the few kinks of
        a declared shape all count.
        """
        left, right = (np.arctan(one[self.kinks]) for one in self.slopes)
        if self.kinks.size <= _FEW_KINKS:
            return np.arange(self.kinks.size)
        near = NEAR * self.ball_radius
        places: list[float] = []
        kept: list[int] = []
        for n in np.argsort(left - right, kind="stable").tolist():
            x = float(self.x[self.kinks[n]])
            after = bisect(places, x)
            room = min((abs(x - one) for one in places[max(after - 1, 0) : after + 1]), default=1.0)
            if math.tan(right[n] - left[n]) * min(0.5 * room, near) >= depth:
                places.insert(after, x)
                kept.append(n)
        return np.array(sorted(kept), dtype=np.int64)

    @cached_property
    def steepest_angle(self) -> float:
        """Critical angle towards growing x [rad]."""
        return self.find_notch(+1.0)[2]

    @cached_property
    def features(self) -> tuple[float, float]:
        """Where the path first and last bends or slopes by more than a degree [m].

        The middle if it is flat.
        """
        found = np.flatnonzero(np.maximum(*np.abs(self.slopes)) > math.tan(math.radians(1.0)))
        if found.size == 0:
            middle = 0.5 * float(self.x[0] + self.x[-1])
            return middle, middle
        return float(self.x[found[0]]), float(self.x[found[-1]])


@lru_cache(maxsize=16)  # a track is long to compute and serves every load and friction
def build_track(face: Counterface, ball_radius: float, backward: bool = False) -> Track:
    """Track over a counterface: up a step in closed form, else by dilating its section."""
    if isinstance(face, Step) and not backward:
        return build_step_track(face.height, ball_radius, face.edge_radius)
    track = build_profile_track(*face.section(4.0 * ball_radius), ball_radius, backward=backward)
    if not isinstance(face, Profile) or face.feature is None:
        return track
    first, last = (-face.feature[1], -face.feature[0]) if backward else face.feature
    return replace(track, feature=FeatureRange(first, last, ball_radius))


def build_track_along_path(path: CentrePath, ball_radius: float, backward: bool = False) -> Track:
    """Track of a ball whose centre follows a path."""
    path = path.mirrored() if backward else path
    turns = np.arctan(path.slope_start[1:]) - np.arctan(path.slope_end[:-1])
    kinks = np.flatnonzero(turns > _SHARED) + 1
    return Track(
        path.x,
        path.z - ball_radius,
        path.slope_start,
        path.slope_end,
        kinks,
        ball_radius,
        feature=path.feature,
    )


def build_profile_track(
    x: ArrayLike, z: ArrayLike, ball_radius: float, *, backward: bool = False
) -> Track:
    """Track of a ball over any profile."""
    xs, zs = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    if backward:
        xs, zs = -xs[::-1], zs[::-1]
    span = float(xs.max() - xs.min())
    count = max(math.ceil(span / (0.01 * ball_radius)), 8)
    if count > 2_000_000:
        raise ContactError(
            f"profile of {span:g} m is too long to drag over with a ball of {ball_radius:g} m"
        )
    grid = np.linspace(xs.min(), xs.max(), count + 1)
    path = build_profile_path(xs, zs, ball_radius, positions=grid, edges="flat")
    if np.isnan(path.height).any():
        raise ContactError(
            "profile has a gap that is wider than the tip; it cannot be dragged over"
        )
    steep = find_interval_slopes(path, -math.inf)
    if np.isposinf(steep[:, 0]).any():
        raise ContactError(
            "profile has a riser as high as the ball (too-high); the tip would never climb it"
        )
    turns = np.arctan(steep[:, 0]) - np.arctan(path.slope[:-1])
    breaks = steep[turns > _KINK, 1]
    nodes = np.unique(np.concatenate([grid, breaks]))
    # two nodes closer than a millionth of the radius would make a cubic of rounding errors
    keep = np.concatenate([[True], np.diff(nodes) > 1e-6 * ball_radius]) | np.isin(nodes, breaks)
    nodes = nodes[keep]
    crowded = np.flatnonzero(np.diff(nodes) <= 1e-6 * ball_radius)
    nodes = np.delete(nodes, crowded[~np.isin(nodes[crowded], breaks)])
    right = build_profile_path(xs, zs, ball_radius, positions=nodes, edges="flat")
    before = np.maximum(nodes[1:] - 1e-9 * ball_radius, nodes[:-1] + 1e-12 * ball_radius)
    left = build_profile_path(xs, zs, ball_radius, positions=before, edges="flat")
    kinks = np.flatnonzero(np.isin(nodes, breaks))
    slope_left = right.slope.copy()
    slope_left[kinks] = left.slope[np.maximum(kinks - 1, 0)]
    ends = nodes[0] - _LEVEL * ball_radius, nodes[-1] + _LEVEL * ball_radius
    x, z = np.concatenate([ends[:1], nodes, ends[1:]]), np.pad(right.height, 1, "edge")
    return Track(
        x, z, np.pad(right.slope[:-1], 1), np.pad(slope_left[1:], 1), kinks + 1, ball_radius
    )


def build_step_track(height: float, ball_radius: float, edge_radius: float = 0.0) -> Track:
    """Track over one step up at x = 0, in closed form."""
    radius = ball_radius + edge_radius
    require_positive("ball radius", ball_radius, "m")
    require_positive("height", height, "m")
    require_not_negative("edge_radius", edge_radius, "m")
    if height >= radius:
        raise ContactError(
            f"height must be less than R + r ({radius:g} m), got {height:g} m: "
            "too-high, "
            "the "
            "tip "
            "is held"
        )
    length = _LEVEL * ball_radius
    angle = 2.0 * math.asin(math.sqrt(0.5 * height / radius))
    angles = np.linspace(angle, 0.0, 400)
    x = np.concatenate(
        [np.linspace(-length, -radius * math.sin(angle), 50)[:-1], -radius * np.sin(angles)]
    )
    x = np.concatenate([x, np.linspace(0.0, length, 50)[1:]])
    arc = slice(49, 449)
    z, slope = np.where(x < 0.0, 0.0, height), np.zeros_like(x)
    z[arc] = height - 2.0 * radius * np.square(np.sin(0.5 * angles))
    z[49], slope[arc] = 0.0, np.tan(angles)
    left = slope.copy()
    left[49] = 0.0  # the lower face ends level, the arc begins at the critical angle
    return Track(x, z, slope[:-1], left[1:], np.array([49]), ball_radius)
