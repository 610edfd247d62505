"""The path of a tip as the integrator needs it.

Cubic pieces between nodes, and the kinks where two contacts share the load.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal, NamedTuple

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
_BENT_DOWN, _BENT_UP = 1.05, 0.05  # most that a branch bends, of the arc about a corner
_ROUGHNESS = 0.1  # of the indentation, by which a branch may stand above the path
_FLAT = math.tan(math.radians(1.0))  # slope below which a path counts as level
_GRID = 0.01  # radii between the positions at which a path is looked at first
_LEAST_PIECE = 1e-6  # radii between two nodes
_MOST_NODES = 2_000_000
_ARC_KNOTS, _FACE_KNOTS = 400, 50  # of a step in closed form: of its arc and of either face
_LEVEL = 400.0  # radii by which a surface goes on level: a released spring may throw the tip far


@dataclass(frozen=True)
class Track(CentrePath):
    """Path of a ball's lowest point, cubic between its knots and level beyond them."""

    kinks: NDArray[np.int64]  # knots at which two contacts share the load
    ball_radius: float  # R [m]

    @cached_property
    def one_sided_slopes(self) -> tuple[Array, Array]:
        """Slopes to the left and to the right of each knot [1]; they differ at a kink."""
        left = np.pad(self.slope_end, (1, 0))
        right = np.pad(self.slope_start, (0, 1))
        return left, right

    @cached_property
    def cubics(self) -> Array:
        """Coefficients of each piece in powers of the distance from its left knot.

        The shape is (n - 1, 4).
        """
        width = np.diff(self.x)
        first, last = self.slope_start, self.slope_end
        chord = np.diff(self.z) / width
        square = (3.0 * chord - 2.0 * first - last) / width
        cube = (first + last - 2.0 * chord) / (width * width)
        return np.column_stack([self.z[:-1], first, square, cube])

    @cached_property
    def branch_coefficients(self) -> Array:
        """Height, slope, half the curvature of both branches at each kink; shape (m, 2, 3)."""
        before = self.kinks - 1  # the pieces that end at a kink
        width = np.diff(self.x)[before]
        height, slope, square = _evaluate_cubics(self.cubics[before], width)
        left = np.column_stack([height, slope, square])
        right = self.cubics[self.kinks, :3]
        branches = np.stack([left, right], axis=1)
        # a branch is a line or an arc about a corner, which bends by 1 / R; the cubic of a piece
        # that is short beside the sampling may bend by far more
        level = 0.5 / self.ball_radius
        lowest = -_BENT_DOWN * level * (1.0 + branches[..., 1] ** 2) ** 1.5
        branches[..., 2] = np.clip(branches[..., 2], lowest, _BENT_UP * level)
        return branches

    def find_height_and_slope(
        self, x: Array, side: Literal["left", "right"] = "right"
    ) -> tuple[Array, Array]:
        """Height [m] and slope [1] at any positions; at a knot, of the piece on one side."""
        last = self.x.size - 2
        begun = np.searchsorted(self.x, x, side=side) - 1
        piece = np.clip(begun, 0, last)  # the first and the last go on beyond the path
        height, slope, _ = _evaluate_cubics(self.cubics[piece], x - self.x[piece])
        return height, slope

    def compute_landing_slope(self, place_number: int, landing_x: float) -> float:
        """Slope of the face behind a place where the tip lands after its release [1].

        It is the median over what the ball touches there; where it turns about an edge it touches
        nothing new. Down a face that falls it counts as far as the tip has come.
        """
        begin, end = self._find_landing_face(place_number, landing_x)
        width_on_face = np.diff(np.clip(self.x, begin, end))
        touched = self._compute_touched_length_ratios() * width_on_face
        face = 0.0
        if touched.sum() > _LEAST_FACE * self.ball_radius:
            face = _compute_weighted_median(np.diff(self.z) / np.diff(self.x), touched)
        slope_where_landed = float(self.find_height_and_slope(np.array(landing_x))[1])
        return max(face, min(slope_where_landed, 0.0))

    def _find_landing_face(self, place_number: int, landing_x: float) -> tuple[float, float]:
        """Find from where to where [m] the face behind a place counts."""
        radius, places = self.ball_radius, self.catch_places
        behind_edge = places.last[place_number] + radius * math.sin(places.angle[place_number])
        begin = max(behind_edge, landing_x - radius)
        is_steep = places.angle[place_number + 1 :] > 0.5 * places.angle[place_number]
        next_steep = places.x[place_number + 1 :][is_steep]
        end = next_steep.min(initial=begin + 2.0 * radius)
        return begin, max(begin, end)

    def _compute_touched_length_ratios(self) -> Array:
        """Return the length of surface newly touched along each piece, over that piece [1]."""
        radius, width = self.ball_radius, np.diff(self.x)
        sine_before = self.slope_start / np.hypot(1.0, self.slope_start)
        sine_behind = self.slope_end / np.hypot(1.0, self.slope_end)
        turned = radius * (sine_behind - sine_before)  # by which the contact runs ahead [m]
        return np.clip(1.0 + turned / width, 0.0, 1.0)

    def list_kinks_with_two_contacts(self, depth: float, window: float) -> NDArray[np.int64]:
        """List the kinks at which two contacts share the load and part before the next one is near.

        One whose branches, continued half way to a sharper kink or to the end of a window [m], do
        not fall below the path by `depth` [m], is texture that the contact presses flat. One
        without another in reach of the window and of the patch of contact is a low step.
        """
        places = self.x[self.kinks]
        gaps = _compute_gaps(places)
        patch = math.sqrt(self.ball_radius * depth)
        nearest = np.minimum(gaps[:-1], gaps[1:])
        is_alone = nearest > 2.0 * max(window, patch)
        left, right = self.one_sided_slopes
        turn = np.arctan(left[self.kinks]) - np.arctan(right[self.kinks])
        kept: list[int] = []
        for number in np.argsort(turn, kind="stable").tolist():  # the sharpest first
            distances = np.abs(places[kept] - places[number])
            distance = distances.min(initial=2.0 * window)
            apart = self._measure_branch_depths(number, 0.5 * distance * _PARTING)
            if apart.min() < -_ROUGHNESS * depth:
                continue
            if is_alone[number] or apart[:, -1].min() >= depth:
                kept.append(number)
        return np.array(sorted(kept), dtype=np.int64)

    def _measure_branch_depths(self, kink_number: int, reach: Array) -> Array:
        """Measure the depth of both branches at a kink below the path at a distance [m], (2, n)."""
        height, slope, square = self.branch_coefficients[kink_number].T[:, :, None]
        branch = height + reach * (slope + reach * square)
        kink = self.x[self.kinks][kink_number]
        height_of_path, _ = self.find_height_and_slope(kink + reach)
        return np.asarray(height_of_path - branch)

    def compute_branch_cubics(
        self, kept_kinks: NDArray[np.int64], depth: float, window: float
    ) -> Array:
        """Return coefficients of both branches at the `kept_kinks`, shape (k, 2, 4).

        A cubic term lets each part from the path by a `depth` [m] half way to the next kink, or at
        the end of a window [m]: a contact that ended there at once would make energy of nothing.
        """
        places = self.x[self.kinks[kept_kinks]]
        room = 0.5 * _compute_gaps(places).clip(max=2.0 * window)
        reach = np.column_stack([room[1:], -room[:-1]])
        height, slope, square = self.branch_coefficients[kept_kinks].transpose(2, 0, 1)
        branch = height + reach * (slope + reach * square)
        height_of_path, _ = self.find_height_and_slope(places[:, None] + reach)
        apart = height_of_path - branch
        # a face ends where the other one is touched: from there on the ball rolls off its corner,
        # by x^2 / 2R
        sine = slope / np.hypot(1.0, slope)
        width = self.ball_radius * np.diff(sine)
        beyond_face = np.maximum(np.abs(reach) - width, 0.0)
        rolled = 0.5 * beyond_face**2 / self.ball_radius
        needed = np.maximum(depth - apart, rolled + square * reach * reach)
        missing = np.maximum(needed, 0.0)
        cube = -missing / reach**3
        return np.stack([height, slope, square, cube], axis=-1)

    def flatten_kinks(self, kept_kinks: NDArray[np.int64], patch: float) -> "Track":
        """Return the track with a bend in the place of each kink but the `kept_kinks`.

        A bend reaches half way to the next kinks, at most as far as the `patch` of contact [m]: at
        a corner the normal would turn at once, and the energy of the contact jump.
        """
        if kept_kinks.size == self.kinks.size:
            return self
        places = self.x[self.kinks]
        room = _HALF * _compute_gaps(places)
        narrower = np.minimum(room[:-1], room[1:])
        width = np.clip(narrower, _BEND * self.ball_radius, patch)
        first = np.delete(places - width, kept_kinks)
        last = np.delete(places + width, kept_kinks)
        knots = np.unique(np.concatenate([self.x, first, last]))
        begun = np.searchsorted(np.sort(first), knots)
        ended = np.searchsorted(np.sort(last), knots, "right")
        is_bent = begun > ended
        is_kept = np.isin(knots, places[kept_kinks])
        knots = knots[~is_bent | is_kept]
        z, slope_behind = self.find_height_and_slope(knots)
        _, slope_before = self.find_height_and_slope(knots, "left")
        return replace(
            self,
            x=knots,
            z=z,
            slope_start=slope_behind[:-1],
            slope_end=slope_before[1:],
            kinks=np.searchsorted(knots, places[kept_kinks]),
        )

    @cached_property
    def catch_places(self) -> CatchPlaces:
        """Every place that may catch the tip, whatever the load."""
        return find_catch_places(self, self.ball_radius)

    @cached_property
    def feature_range(self) -> tuple[float, float]:
        """Where the path first and last bends or slopes by more than a degree [m].

        The middle if it is flat.
        """
        left, right = self.one_sided_slopes
        steepest = np.maximum(np.abs(left), np.abs(right))
        steep = np.flatnonzero(steepest > _FLAT)
        if steep.size == 0:
            middle = float(0.5 * (self.x[0] + self.x[-1]))
            return middle, middle
        return float(self.x[steep[0]]), float(self.x[steep[-1]])


def _evaluate_cubics(cubics: Array, distance: Array) -> tuple[Array, Array, Array]:
    """Return height [m], slope [1] and half the curvature [1/m] of cubics at a distance [m].

    `cubics` has the coefficients in its last axis, of length 4.
    """
    c0, c1, c2, c3 = np.moveaxis(cubics, -1, 0)
    height = c0 + distance * (c1 + distance * (c2 + distance * c3))
    slope = c1 + distance * (2.0 * c2 + 3.0 * distance * c3)
    square = c2 + 3.0 * distance * c3
    return height, slope, square


def _compute_gaps(positions: Array) -> Array:
    """Measure the gaps between places, infinite before the first and after the last, (n + 1,)."""
    return np.diff(positions, prepend=-math.inf, append=math.inf)


def _compute_weighted_median(values: Array, weights: Array) -> float:
    """Find the weighted median of values."""
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    middle = np.searchsorted(share, 0.5 * share[-1])
    return float(values[order[middle]])


@lru_cache(maxsize=16)  # a track is long to compute and serves every load and friction
def build_track(face: Counterface, ball_radius: float, backward: bool = False) -> Track:
    """Track over a counterface: up a step in closed form, else by dilating its section."""
    if isinstance(face, Step) and not backward:
        return build_step_track(face.height, ball_radius, face.edge_radius)
    x, z = face.section(4.0 * ball_radius)
    track = build_profile_track(x, z, ball_radius, backward=backward)
    if not isinstance(face, Profile) or face.feature is None:
        return track
    first, last = face.feature
    if backward:
        first, last = -last, -first
    return replace(track, feature=FeatureRange(first, last, ball_radius))


def build_profile_track(
    x: ArrayLike, z: ArrayLike, ball_radius: float, *, backward: bool = False
) -> Track:
    """Track of a ball over any profile.

    Parameters
    ----------
    x, z : array_like
        Positions and heights of the profile [m], shape (n,).
    ball_radius : float
        R [m].
    backward : bool
        Whether the drag is towards falling x.

    Returns
    -------
    Track
        Towards growing x; a profile that is dragged over backward is mirrored.

    Raises
    ------
    ContactError
        If the profile is too long for the ball, or has a riser as high as the ball.
    """
    xs, zs = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    if backward:
        xs, zs = -xs[::-1], zs[::-1]
    grid = _choose_coarse_grid(xs, ball_radius)
    coarse_path = build_profile_path(xs, zs, ball_radius, positions=grid)
    notches = _find_sharpest_notches(xs, zs, coarse_path)
    if not (notches.behind <= _RISER).all():
        raise ContactError(
            "profile has a riser as high as the ball (too-high); the tip would never climb it"
        )
    # two nodes closer than that would make a cubic of rounding errors
    room = _LEAST_PIECE * ball_radius
    is_apart = np.diff(notches.position, append=math.inf) > room
    is_kink = notches.behind - notches.before > _KINK
    kinks = notches.select_notches(is_kink & is_apart)
    nodes = _choose_nodes(grid, kinks, room, ball_radius)
    path = build_profile_path(xs, zs, ball_radius, positions=nodes)
    numbers = np.searchsorted(nodes, kinks.position)
    left, right = path.slope.copy(), path.slope.copy()
    left[numbers] = np.tan(kinks.before)
    right[numbers] = np.tan(kinks.behind)
    left = np.maximum(left, -_STEEPEST)
    right = np.maximum(right, -_STEEPEST)
    # a level piece before the first node and another behind the last
    first = nodes[0] - _LEVEL * ball_radius
    last = nodes[-1] + _LEVEL * ball_radius
    return Track(
        x=np.concatenate([[first], nodes, [last]]),
        z=np.pad(path.height, 1, "edge"),
        slope_start=np.pad(right[:-1], 1),
        slope_end=np.pad(left[1:], 1),
        kinks=numbers + 1,
        ball_radius=ball_radius,
    )


def _choose_coarse_grid(x: Array, ball_radius: float) -> Array:
    """Choose the positions at which a path is evaluated first [m].

    The ball meets the first point a radius before it, and leaves the last one as far behind.
    """
    first = float(x.min()) - ball_radius
    last = float(x.max()) + ball_radius
    count = math.ceil((last - first) / (_GRID * ball_radius))
    if count > _MOST_NODES:
        raise ContactError(
            f"profile of {np.ptp(x):g} m is too long to drag over with a ball of {ball_radius:g} m"
        )
    return np.linspace(first, last, count + 1)


def _choose_nodes(grid: Array, kinks: "_Notches", room: float, ball_radius: float) -> Array:
    """Merge a grid and the kinks [m]; only the kinks keep a node nearer than `room` to another.

    Down a wall the tip falls along a slope that it crosses in several steps.
    """
    nodes = np.unique(np.concatenate([grid, kinks.position]))
    is_close = np.diff(nodes) <= room
    is_crowded = np.append(is_close, False) | np.append(False, is_close)
    is_foot = kinks.before < -math.atan(_STEEPEST)
    feet = np.append(kinks.position[is_foot], math.inf)
    next_foot = feet[np.searchsorted(feet, nodes, "right")]
    is_crowded |= next_foot - nodes < _WALL * ball_radius
    is_at_kink = np.isin(nodes, kinks.position)
    return np.asarray(nodes[~is_crowded | is_at_kink])


class _Notches(NamedTuple):
    """Notches of a path, arrays of shape (n,)."""

    position: Array  # [m]
    before: Array  # angle of the path to the left [rad]
    behind: Array  # angle of the path to the right [rad]

    def select_notches(self, wanted: NDArray[np.bool_]) -> "_Notches":
        """Return the notches of which `wanted`, shape (n,), is true."""
        return _Notches(self.position[wanted], self.before[wanted], self.behind[wanted])


def _find_sharpest_notches(x: Array, z: Array, path: TipPath) -> _Notches:
    """Find the sharpest notch between each two neighbouring positions of a path.

    Arcs and lines only bend down, so it lies in the half that turns up more.
    """
    low, high = path.position[:-1], path.position[1:]
    before, behind = np.arctan(path.slope[:-1]), np.arctan(path.slope[1:])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        halved = build_profile_path(x, z, path.ball_radius, positions=middle)
        angle = np.arctan(halved.slope)
        is_left = angle - before > behind - angle
        low = np.where(is_left, low, middle)
        before = np.where(is_left, before, angle)
        high = np.where(is_left, middle, high)
        behind = np.where(is_left, angle, behind)
    return _Notches(high, before, behind)


def build_step_track(height: float, ball_radius: float, edge_radius: float = 0.0) -> Track:
    """Track over one step up, its wall at x = 0, in closed form.

    Parameters
    ----------
    height, ball_radius, edge_radius : float
        H, R and r [m].

    Raises
    ------
    ContactError
        If a length is not positive, or the step as high as ball and edge together.
    """
    radius = ball_radius + edge_radius
    require_positive("ball radius", ball_radius, "m")
    require_positive("height", height, "m")
    require_not_negative("edge_radius", edge_radius, "m")
    if not height < radius:
        raise ContactError(
            f"height must be less than R + r ({radius:g} m), got {height:g} m: too-high, the tip "
            "is held"
        )
    length = _LEVEL * ball_radius
    angle = 2.0 * math.asin(math.sqrt(0.5 * height / radius))
    angles = np.linspace(angle, 0.0, _ARC_KNOTS)
    lower = np.linspace(-length, -radius * math.sin(angle), _FACE_KNOTS)[:-1]
    upper = np.linspace(0.0, length, _FACE_KNOTS)[1:]
    # the arc of a round edge has its middle behind the wall
    x = edge_radius + np.concatenate([lower, -radius * np.sin(angles), upper])
    kink = lower.size
    arc = slice(kink, kink + _ARC_KNOTS)
    z = np.where(x < edge_radius, 0.0, height)
    z[arc] = height - 2.0 * radius * np.square(np.sin(0.5 * angles))
    z[kink] = 0.0
    right = np.zeros_like(x)
    right[arc] = np.tan(angles)
    left = right.copy()
    left[kink] = 0.0  # the lower face ends level, the arc begins at the critical angle
    return Track(x, z, right[:-1], left[1:], np.array([kink]), ball_radius)
