"""The path of a tip as the integrator needs it.

Cubic pieces between nodes, and the kinks where two contacts share the load.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact import Array
from stepblocks.contact.counterface import Counterface, Profile, Step
from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.path.centre import CentrePath, FeatureRange
from stepblocks.contact.path.profile import TipPath, build_profile_path
from stepblocks.drag.catches import CatchPlaces, find_catch_places
from stepblocks.errors import ContactError

# a turn at which two contacts share the load, on a surface that may be rough
_KINK = math.radians(2.0)
NEAR = 0.3  # radii from a kink beyond which the other side is no longer touched
PATCHES = 5.0  # the same in radii of the patch of contact
# where both branches at a kink are held to part: the left one ahead of it, the right one behind it
_PARTING = np.array([[1.0], [-1.0]]) * np.linspace(0.25, 1.0, 4)
_HALVINGS = 34  # of an interval in which a notch lies
_HALF = 0.49  # of the way to the next kink: two bends shall not meet in one knot
_BEND = 5e-3  # radii: the least half width of a bend, where kinks crowd
_RISER = 0.5 * math.pi - 1e-5  # a path that is steeper jumps [rad]
_STEEPEST = 15.0  # slope at which a path falls at most [1]: along a wall no step is short enough
_WALL = 0.15  # radii from its foot over which a wall is spread
_LEAST_FACE = 1e-3  # radii: a narrower face carries no tip
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
        h = np.diff(self.x)
        a, b = self.slope_start, self.slope_end
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
        level = 0.5 / self.ball_radius
        both[..., 2] = np.clip(
            both[..., 2], -1.05 * level * (1.0 + both[..., 1] ** 2) ** 1.5, 0.05 * level
        )
        return both

    def evaluate(self, x: Array, side: Literal["left", "right"] = "right") -> tuple[Array, Array]:
        """Height [m] and slope [1] at any positions; at a knot, of the piece on one side."""
        piece = np.clip(np.searchsorted(self.x, x, side=side) - 1, 0, self.x.size - 2)
        k0, k1, k2, k3 = self.cubics.T[:, piece]
        d = x - self.x[piece]
        return k0 + d * (k1 + d * (k2 + d * k3)), k1 + d * (2.0 * k2 + 3.0 * d * k3)

    def find_landing_slope(self, place: int, landed: float) -> float:
        """Slope of the face behind a place where the tip has `landed` [m] after its release [1].

        It is the median over what the ball touches there; where it turns about an edge it touches
        nothing new. Down a face that falls it counts as far as the tip has come.
        """
        radius, places = self.ball_radius, self.catch_places
        begin = max(places.last[place] + radius * math.sin(places.angle[place]), landed - radius)
        steep = places.x[place + 1 :][places.angle[place + 1 :] > 0.5 * places.angle[place]]
        end = max(begin, steep.min(initial=begin + 2.0 * radius))
        width = np.diff(self.x)
        before, behind = (one / np.hypot(1.0, one) for one in (self.slope_start, self.slope_end))
        moved = np.clip(1.0 + radius * (behind - before) / width, 0.0, 1.0)
        touched = moved * np.diff(np.clip(self.x, begin, end))
        face = 0.0
        if touched.sum() > _LEAST_FACE * radius:
            slopes = np.diff(self.z) / width
            order = np.argsort(slopes)
            share = np.cumsum(touched[order])
            face = float(slopes[order[np.searchsorted(share, 0.5 * share[-1])]])
        return max(face, min(float(self.evaluate(np.array(landed))[1]), 0.0))

    def list_separate_kinks(self, depth: float, window: float) -> NDArray[np.int64]:
        """List the kinks at which two contacts share the load and part before the next one is near.

        One whose branches, continued half way to a sharper kink or to the end of a window [m], do
        not fall below the path by `depth` [m], is texture that the contact presses flat. One
        without another in reach of the window and of the patch of contact is a low step.
        """
        places = self.x[self.kinks]
        away = np.diff(places, prepend=-math.inf, append=math.inf)
        alone = np.minimum(away[:-1], away[1:]) > 2.0 * max(
            window, math.sqrt(self.ball_radius * depth)
        )
        kept: list[int] = []
        before, behind = (np.arctan(one[self.kinks]) for one in self.slopes)
        for n in np.argsort(before - behind, kind="stable").tolist():
            steps = 0.5 * np.abs(places[kept] - places[n]).min(initial=2.0 * window) * _PARTING
            c0, s0, b0 = self.branches[n].T[:, :, None]
            apart = self.evaluate(places[n] + steps)[0] - (c0 + steps * (s0 + steps * b0))
            if apart.min() >= -0.1 * depth and (alone[n] or apart[:, -1].min() >= depth):
                kept.append(n)
        return np.array(sorted(kept), dtype=np.int64)

    def part_branches(self, kept: NDArray[np.int64], depth: float, window: float) -> Array:
        """Coefficients of both branches at the kinks that are `kept`, shape (k, 2, 4).

        A cubic term lets each part from the path by a `depth` [m] half way to the next kink, or at
        the end of a window [m]: a contact that ended there at once would make energy of nothing.
        """
        places = self.x[self.kinks[kept]]
        room = 0.5 * np.diff(places, prepend=-math.inf, append=math.inf).clip(max=2.0 * window)
        reach = np.column_stack([room[1:], -room[:-1]])
        c0, s0, b0 = self.branches[kept].transpose(2, 0, 1)
        apart = self.evaluate(places[:, None] + reach)[0] - (c0 + reach * (s0 + reach * b0))
        # a face ends where the other one is touched: from there on the ball rolls off its corner,
        # by x^2 / 2R
        width = self.ball_radius * np.diff(s0 / np.hypot(1.0, s0))
        rolled = 0.5 * np.maximum(np.abs(reach) - width, 0.0) ** 2 / self.ball_radius
        short = np.maximum(np.maximum(depth - apart, rolled + b0 * reach * reach), 0.0)
        return np.stack([c0, s0, b0, -short / reach**3], axis=-1)

    def press_flat(self, kept: NDArray[np.int64], patch: float) -> "Track":
        """Return the track with a bend in the place of each kink that is not `kept`.

        A bend reaches half way to the next kinks, at most as far as the `patch` of contact [m]: at
        a corner the normal would turn at once, and the energy of the contact jump.
        """
        if kept.size == self.kinks.size:
            return self
        places = self.x[self.kinks]
        room = _HALF * np.diff(places, prepend=-math.inf, append=math.inf)
        width = np.clip(np.minimum(room[:-1], room[1:]), _BEND * self.ball_radius, patch)
        first, last = (np.delete(ends, kept) for ends in (places - width, places + width))
        knots = np.unique(np.concatenate([self.x, first, last]))
        bent = np.searchsorted(np.sort(first), knots) > np.searchsorted(
            np.sort(last), knots, "right"
        )
        knots = knots[~bent | np.isin(knots, places[kept])]
        (z, behind), (_, before) = self.evaluate(knots), self.evaluate(knots, "left")
        return replace(
            self,
            x=knots,
            z=z,
            slope_start=behind[:-1],
            slope_end=before[1:],
            kinks=np.searchsorted(knots, places[kept]),
        )

    @cached_property
    def catch_places(self) -> CatchPlaces:
        """Every place that may catch the tip, whatever the load."""
        return find_catch_places(self, self.ball_radius)

    @cached_property
    def features(self) -> tuple[float, float]:
        """Where the path first and last bends or slopes by more than a degree [m].

        The middle if it is flat.
        """
        found = np.flatnonzero(np.maximum(*np.abs(self.slopes)) > math.tan(math.radians(1.0)))
        places = self.x[found] if found.size else 0.5 * (self.x[:1] + self.x[-1:])
        return float(places[0]), float(places[-1])


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


def build_profile_track(
    x: ArrayLike, z: ArrayLike, ball_radius: float, *, backward: bool = False
) -> Track:
    """Track of a ball over any profile."""
    xs, zs = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    if backward:
        xs, zs = -xs[::-1], zs[::-1]
    # the ball meets the first point a radius before it, and leaves the last one as far behind
    first, last = float(xs.min()) - ball_radius, float(xs.max()) + ball_radius
    count = math.ceil((last - first) / (0.01 * ball_radius))
    ContactError.require(
        count <= 2_000_000,
        f"profile of {np.ptp(xs):g} m is too long to drag over with a ball of {ball_radius:g} m",
    )
    grid = np.linspace(first, last, count + 1)
    where, before, behind = _find_notches(
        xs, zs, build_profile_path(xs, zs, ball_radius, positions=grid)
    )
    ContactError.require(
        (behind <= _RISER).all(),
        "profile has a riser as high as the ball (too-high); the tip would never climb it",
    )
    # two nodes closer than a millionth of the radius would make a cubic of rounding errors
    room = 1e-6 * ball_radius
    sharp = (behind - before > _KINK) & (np.diff(where, append=math.inf) > room)
    nodes = np.unique(np.concatenate([grid, where[sharp]]))
    crowded = np.diff(nodes) <= room
    crowded = np.append(crowded, False) | np.append(False, crowded)
    # down a wall the tip falls along a slope that it crosses in several steps
    feet = np.append(where[sharp & (before < -math.atan(_STEEPEST))], math.inf)
    crowded |= feet[np.searchsorted(feet, nodes, "right")] - nodes < _WALL * ball_radius
    nodes = nodes[~crowded | np.isin(nodes, where[sharp])]
    right = build_profile_path(xs, zs, ball_radius, positions=nodes)
    kinks = np.searchsorted(nodes, where[sharp])
    left, slope = right.slope.copy(), right.slope.copy()
    left[kinks], slope[kinks] = np.tan(before[sharp]), np.tan(behind[sharp])
    left, slope = np.maximum(left, -_STEEPEST), np.maximum(slope, -_STEEPEST)
    ends = nodes[0] - _LEVEL * ball_radius, nodes[-1] + _LEVEL * ball_radius
    return Track(
        np.concatenate([ends[:1], nodes, ends[1:]]),
        np.pad(right.height, 1, "edge"),
        np.pad(slope[:-1], 1),
        np.pad(left[1:], 1),
        kinks + 1,
        ball_radius,
    )


def _find_notches(x: Array, z: Array, path: TipPath) -> tuple[Array, Array, Array]:
    # Place of the sharpest notch between neighbouring positions [m], and the angles of the path
    # before and behind it [rad]; arcs and lines only bend down, so the notch lies in the half that
    # turns up more
    low, high = path.position[:-1], path.position[1:]
    before, behind = np.arctan(path.slope[:-1]), np.arctan(path.slope[1:])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        angle = np.arctan(build_profile_path(x, z, path.ball_radius, positions=middle).slope)
        first = angle - before > behind - angle
        low, before = np.where(first, low, middle), np.where(first, before, angle)
        high, behind = np.where(first, middle, high), np.where(first, angle, behind)
    return high, before, behind


def build_step_track(height: float, ball_radius: float, edge_radius: float = 0.0) -> Track:
    """Track over one step up, its wall at x = 0, in closed form."""
    radius = ball_radius + edge_radius
    require_positive("ball radius", ball_radius, "m")
    require_positive("height", height, "m")
    require_not_negative("edge_radius", edge_radius, "m")
    ContactError.require(
        height < radius,
        f"height must be less than R + r ({radius:g} m), got {height:g} m: too-high, the tip "
        "is held",
    )
    length = _LEVEL * ball_radius
    angle = 2.0 * math.asin(math.sqrt(0.5 * height / radius))
    angles = np.linspace(angle, 0.0, 400)
    before = np.linspace(-length, -radius * math.sin(angle), 50)[:-1]
    # the arc of a round edge has its middle behind the wall
    x = edge_radius + np.concatenate(
        [before, -radius * np.sin(angles), np.linspace(0.0, length, 50)[1:]]
    )
    arc = slice(49, 449)
    z = np.where(x < edge_radius, 0.0, height)
    z[arc] = height - 2.0 * radius * np.square(np.sin(0.5 * angles))
    z[49] = 0.0
    slope = np.zeros_like(x)
    slope[arc] = np.tan(angles)
    left = slope.copy()
    left[49] = 0.0  # the lower face ends level, the arc begins at the critical angle
    return Track(x, z, slope[:-1], left[1:], np.array([49]), ball_radius)
