"""One servo tick, compiled: no allocation, no search beyond the pieces that the proxy crosses.

The proxy is the ball's centre on its path; the hand pulls it through the spring. It stays where it
is as long as the spring's force lies within the friction cone, and slides to the next point where
it does so again. At a notch the two slopes differ, and the proxy holds until ``F_x (1 - mu t) > F_z
(t + mu)``: equation (1) without its division, which therefore also says that a locked proxy never
moves.

Between two ticks the hand goes straight from place to place, and the force left to move the proxy
out of a notch is linear along that way. Where it crosses zero the notch gives way: a release is the
same at any rate and speed.
"""

import math
from typing import Any

import numpy as np

from stepblocks.compute.compiled import numba
from stepblocks.contact import Array

Hand = tuple[float, float]  # across the edge and up [m]
Records = Any  # an array with one of the types below: what compiled code is handed fastest
_BISECTIONS = 40

_FLOAT, _TRUTH = np.float64, np.bool_

# The path of the ball's centre: one record per knot; what belongs to a piece stands at the knot
# where it begins. Place, x ascending [m], slopes where the piece begins and ends [1], and whether
# the knot is a notch that holds a drag up and down x
PATH = np.dtype(
    [(name, _FLOAT) for name in ("x", "z", "first", "last")] + [("up", _TRUTH), ("down", _TRUTH)]
)
# One record: springs along the drag and along the load [N/m], mu [1], damping of the hand's
# velocity in contact [N s/m], period of a tick [s]; of the ring its amplitude over the force at
# release [1] (0 switches the event off), [rad/s] and decay [s]
_SETTINGS = ("stiffness", "wall", "friction", "damping", "period", "ring", "omega", "decay")
SETTING = np.dtype([(name, _FLOAT) for name in _SETTINGS])
# What changes from tick to tick, one record: the proxy across and along the edge, the height of a
# free one [m], the spring force of the last tick [N]; since the last event [s], negative before the
# first, its signed amplitude and the spring force at it [N]; where the hand was at the last tick
# [m], known after the first; the piece of the path that the proxy is on, how many events there were
_STATES = (
    "x",
    "y",
    "height",
    "pull",
    "ring_time",
    "ring_force",
    "release",
    "hand_x",
    "hand_z",
)
STATE = np.dtype(
    [(name, _FLOAT) for name in _STATES]
    + [("piece", np.int64), ("events", np.int64), ("touching", _TRUTH), ("known", _TRUTH)]
)


@numba.njit(cache=True, inline="always")
def _compute_height(x: float, piece: int, path: Records) -> float:
    """Height of the path at a place on a piece of it [m]."""
    start, low = path.x[piece], path.z[piece]
    end, high = path.x[piece + 1], path.z[piece + 1]
    return low + (high - low) * (x - start) / (end - start)


@numba.njit(cache=True, inline="always")
def _compute_slope(x: float, piece: int, path: Records) -> float:
    """Slope of the path at a place on a piece of it [1]."""
    start, end = path.x[piece], path.x[piece + 1]
    share = (x - start) / (end - start)
    return path.first[piece] + share * (path.last[piece] - path.first[piece])


@numba.njit(cache=True, inline="always")
def _compute_drive(
    direction: float, x: float, z: float, slope: float, hand: Hand, setting: Records
) -> float:
    """Force left to move the proxy, times the cosine of the slope [N]; above 0 it slides."""
    pull = direction * setting.stiffness * (hand[0] - x)
    down = setting.wall * (z - hand[1])
    rise = direction * slope
    return pull * (1.0 - setting.friction * rise) - down * (rise + setting.friction)


@numba.njit(cache=True)
def _is_sliding(
    direction: float, x: float, piece: int, hand: Hand, setting: Records, path: Records
) -> bool:
    """Whether the hand moves a proxy on a piece of the path in a direction."""
    height = _compute_height(x, piece, path)
    slope = _compute_slope(x, piece, path)
    return _compute_drive(direction, x, height, slope, hand, setting) > 0.0


@numba.njit(cache=True)
def _note_release(
    direction: float,
    knot: int,
    slope: float,
    state: Records,
    hand: Hand,
    setting: Records,
    path: Records,
) -> None:
    """Note the release where the proxy leaves a notch that held it, at the moment it gave way.

    The hand [m] went straight from where it was a tick ago; `slope` is that of the path beyond the
    knot.
    """
    is_notch = path.up[knot] if direction > 0.0 else path.down[knot]
    if not is_notch:
        return
    x, z = path.x[knot], path.z[knot]
    came_from = (state.hand_x, state.hand_z)
    before = _compute_drive(direction, x, z, slope, came_from, setting)
    after = _compute_drive(direction, x, z, slope, hand, setting)
    if before > 0.0 and x != state.x:  # passed without being held
        return
    share = 0.0  # of the tick, until the notch gave way
    if before < 0.0 and after > before:
        share = min(before / (before - after), 1.0)
    held_until = state.hand_x + share * (hand[0] - state.hand_x)
    state.release = setting.stiffness * (held_until - x)
    state.events += 1
    if setting.ring > 0.0:
        state.ring_time = (1.0 - share) * setting.period
        state.ring_force = setting.ring * state.release


@numba.njit(cache=True)
def _slide(
    direction: float,
    piece: int,
    landed: bool,
    state: Records,
    hand: Hand,
    setting: Records,
    path: Records,
) -> tuple[float, int]:
    """Move the proxy along the path until friction holds it; note every notch that it leaves."""
    x = state.x
    while _is_sliding(direction, x, piece, hand, setting, path):
        if direction > 0.0:
            start, knot, after = piece, piece + 1, piece + 1
            rise, slope = path.first[piece], path.last[piece]
        else:
            start, knot, after = piece + 1, piece, piece - 1
            rise, slope = path.last[piece], path.first[piece]
        if x == path.x[start] and not landed:
            _note_release(direction, start, rise, state, hand, setting, path)
        far = path.x[knot]
        if _compute_drive(direction, far, path.z[knot], slope, hand, setting) > 0.0:
            x = far
            if after < 0 or after > len(path.x) - 2:
                break
            piece = after
            continue
        for _ in range(_BISECTIONS):
            middle = 0.5 * (x + far)
            if _is_sliding(direction, middle, piece, hand, setting, path):
                x = middle
            else:
                far = middle
        break
    return x, piece


@numba.njit(cache=True)
def _find_landing(
    x: float, z: float, piece: int, hand: Hand, path: Records
) -> tuple[float, int, bool]:
    """Walk from a free proxy at (x, z) straight to the hand, to where the path is met, if it is."""
    hand_x, hand_z = hand
    span = hand_x - x
    while True:
        end = min(path.x[piece + 1], hand_x) if span >= 0.0 else max(path.x[piece], hand_x)
        line = hand_z if end == hand_x else z + (hand_z - z) * (end - x) / span
        if line < _compute_height(end, piece, path):
            near = max(x, path.x[piece]) if span >= 0.0 else min(x, path.x[piece + 1])
            for _ in range(_BISECTIONS):
                middle = 0.5 * (near + end)
                line = hand_z if span == 0.0 else z + (hand_z - z) * (middle - x) / span
                if line < _compute_height(middle, piece, path):
                    end = middle
                else:
                    near = middle
            return near, piece, True
        after = piece + 1 if span >= 0.0 else piece - 1
        if end == hand_x or after < 0 or after > len(path.x) - 2:
            return end, piece, False
        piece = after


@numba.njit(cache=True)
def _is_pressed(x: float, piece: int, hand: Hand, setting: Records, path: Records) -> bool:
    """Whether the hand presses the proxy on either side of where it is."""
    ahead = behind = _compute_slope(x, piece, path)
    if x == path.x[piece]:
        if piece > 0:
            behind = path.last[piece - 1]
    elif x == path.x[piece + 1]:
        behind = path.last[piece]
        if piece + 2 < len(path.x):
            ahead = path.first[piece + 1]
    pull = setting.stiffness * (hand[0] - x)
    down = setting.wall * (_compute_height(x, piece, path) - hand[1])
    return not (pull * ahead + down < 0.0 and pull * behind + down < 0.0)


@numba.njit(cache=True)
def _slide_proxy(state: Records, landed: bool, hand: Hand, setting: Records, path: Records) -> None:
    """Slide in either direction; leaving a notch uphill is a release, unless it has just landed."""
    x, piece = state.x, state.piece
    at_start = x == path.x[piece]
    at_end = x == path.x[piece + 1]
    right = piece + 1 if at_end and piece + 2 < len(path.x) else piece
    new_x, new_piece = _slide(1.0, right, landed, state, hand, setting, path)
    if new_x == x:
        left = piece - 1 if at_start and piece > 0 else piece
        new_x, new_piece = _slide(-1.0, left, landed, state, hand, setting, path)
    if new_x != x:
        state.x, state.piece = new_x, new_piece


@numba.njit(cache=True)
def tick(
    position: Array,
    velocity: Array,
    force: Array,
    states: Records,
    settings: Records,
    path: Records,
) -> None:
    """Advance the proxy of one record `states` by a tick of the hand; write the force on it."""
    state, setting = states[0], settings[0]
    hand = (min(max(position[0], path.x[0]), path.x[-1]), position[2])
    if not state.known:
        state.hand_x, state.hand_z, state.known = hand[0], hand[1], True
    landed = not state.touching or not _is_pressed(state.x, state.piece, hand, setting, path)
    if landed:
        z = _compute_height(state.x, state.piece, path)
        if not state.touching:  # the proxy was where the hand was, which may be high above the path
            z = max(z, state.height)
        state.x, state.piece, state.touching = _find_landing(state.x, z, state.piece, hand, path)
        state.y, state.height = position[1], position[2]
    if state.touching:
        _slide_proxy(state, landed, hand, setting, path)
        state.pull = setting.stiffness * (hand[0] - state.x)
        down = setting.wall * (_compute_height(state.x, state.piece, path) - hand[1])
        # along the edge the friction has its own limit: a box instead of the cone, exact for drags
        # along x or y
        limit = setting.friction * max(down, 0.0)
        slack = min(max(setting.stiffness * (position[1] - state.y), -limit), limit)
        state.y = position[1] - slack / setting.stiffness
        force[0] = -state.pull - setting.damping * velocity[0]
        force[1] = -slack - setting.damping * velocity[1]
        force[2] = down - setting.damping * velocity[2]
    else:
        force[0] = force[1] = force[2] = state.pull = 0.0
    if state.ring_time >= 0.0:
        swing = math.exp(-state.ring_time / setting.decay) * math.sin(
            setting.omega * state.ring_time
        )
        force[0] += state.ring_force * swing
        state.ring_time += setting.period
    state.hand_x, state.hand_z = hand


@numba.njit(cache=True)
def drag(
    record: Array,
    position: Array,
    step: float,
    load: float,
    resolution: float,
    states: Records,
    settings: Records,
    path: Records,
) -> None:
    """Drive `tick` with a hand of steady speed and load; rows: hand, spring, force along x."""
    start = position[0]
    read, force = position.copy(), np.zeros(3)
    velocity = np.array([step / settings[0].period, 0.0, 0.0])
    for index in range(record.shape[1]):
        position[0] = start + index * step
        for axis in range(3):
            value = position[axis]
            read[axis] = round(value / resolution) * resolution if resolution > 0.0 else value
        tick(read, velocity, force, states, settings, path)
        record[:, index] = (position[0], states[0].pull, force[0])
        # the wall is a known spring, so one correction along z is exact until the proxy moves
        position[2] += (force[2] - load) / settings[0].wall
