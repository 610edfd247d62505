"""One servo tick, compiled: no allocation, no search beyond the pieces that the proxy really crosses.

The proxy is the ball's centre on its path; the hand pulls it through the spring. It stays where it is as long as the
spring's force lies within the friction cone, and slides to the next point where it does so again. At a notch the two
slopes differ, and the proxy holds until ``F_x (1 - mu t) > F_z (t + mu)``: equation (1) without its division, which
therefore also says that a locked proxy never moves.
"""

from __future__ import annotations

import math
from typing import Any

import numba

# Meaning of the parameter array, in order
PARAMETERS = (
    "stiffness",  # tangential spring of the rendering [N/m]
    "wall",  # spring along the normal load [N/m]
    "friction",  # mu [1]
    "damping",  # of the hand's velocity in contact [N s/m]
    "period",  # of a tick [s]
    "ring",  # amplitude of the ring over the force at release [1]; 0 switches the event off
    "omega",  # of the ring [rad/s]
    "decay",  # time constant of its amplitude [s]
)
# Meaning of the state array, in order
STATE = (
    "x",  # proxy across the edge [m]
    "y",  # proxy along the edge [m]
    "piece",  # index of the piece of the path that it is on
    "touching",  # 1 in contact, 0 free
    "pull",  # spring force of the last tick [N]
    "ring_time",  # since the last event [s]; negative before the first
    "ring_force",  # signed amplitude of the last event [N]
    "events",  # how many there were
    "release",  # spring force at the last event [N]
    "height",  # of a free proxy [m]
)
FLIGHT = 0.0  # Value of ``touching`` of a proxy that is free
_BISECTIONS = 40


@numba.njit(cache=True, fastmath=False, inline="always")  # type: ignore[untyped-decorator, unused-ignore]
def _height(x: Any, piece: Any, xs: Any, zs: Any) -> Any:
    return zs[piece] + (zs[piece + 1] - zs[piece]) * (x - xs[piece]) / (xs[piece + 1] - xs[piece])


@numba.njit(cache=True, inline="always")  # type: ignore[untyped-decorator, unused-ignore]
def _drive(direction: Any, x: Any, z: Any, slope: Any, hand_x: Any, hand_z: Any, k: Any, wall: Any, mu: Any) -> Any:
    """Force that is left to move the proxy in a direction, times the cosine of the slope; positive where it slides."""
    pull, down = direction * k * (hand_x - x), wall * (z - hand_z)
    rise = direction * slope
    return pull * (1.0 - mu * rise) - down * (rise + mu)


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _slide(
    direction: Any,
    x: Any,
    piece: Any,
    hand_x: Any,
    hand_z: Any,
    k: Any,
    wall: Any,
    mu: Any,
    xs: Any,
    zs: Any,
    first: Any,
    last: Any,
) -> Any:
    """Move the proxy along the path until friction holds it."""
    while True:
        x0, x1 = xs[piece], xs[piece + 1]
        share = (x - x0) / (x1 - x0)
        slope = first[piece] + share * (last[piece] - first[piece])
        z = _height(x, piece, xs, zs)
        if _drive(direction, x, z, slope, hand_x, hand_z, k, wall, mu) <= 0.0:
            return x, piece
        far = x1 if direction > 0.0 else x0
        slope_far = last[piece] if direction > 0.0 else first[piece]
        z_far = zs[piece + 1] if direction > 0.0 else zs[piece]
        if _drive(direction, far, z_far, slope_far, hand_x, hand_z, k, wall, mu) > 0.0:
            x = far
            if direction > 0.0:
                if piece + 2 >= len(xs):
                    return x, piece
                piece += 1
            else:
                if piece == 0:
                    return x, piece
                piece -= 1
            continue
        near = x
        for _ in range(_BISECTIONS):
            x = 0.5 * (near + far)
            share = (x - x0) / (x1 - x0)
            slope = first[piece] + share * (last[piece] - first[piece])
            z = _height(x, piece, xs, zs)
            if _drive(direction, x, z, slope, hand_x, hand_z, k, wall, mu) > 0.0:
                near = x
            else:
                far = x
        return near, piece


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _land(x: Any, z: Any, piece: Any, hand_x: Any, hand_z: Any, xs: Any, zs: Any) -> Any:
    """Walk from a free proxy at (x, z) straight to the hand; stop where the path is met. Third value: 1 if it was."""
    span = hand_x - x
    while True:
        end = min(xs[piece + 1], hand_x) if span >= 0.0 else max(xs[piece], hand_x)
        line = hand_z if end == hand_x else z + (hand_z - z) * (end - x) / span
        if line < _height(end, piece, xs, zs):
            near, far = x, end
            near = max(near, xs[piece]) if span >= 0.0 else min(near, xs[piece + 1])
            for _ in range(_BISECTIONS):
                middle = 0.5 * (near + far)
                line = hand_z if span == 0.0 else z + (hand_z - z) * (middle - x) / span
                if line < _height(middle, piece, xs, zs):
                    far = middle
                else:
                    near = middle
            return near, piece, 1.0
        if end == hand_x:
            return hand_x, piece, 0.0
        step = 1 if span >= 0.0 else -1
        if piece + step < 0 or piece + step > len(xs) - 2:
            return end, piece, 0.0
        piece += step


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def tick(
    position: Any,
    velocity: Any,
    force: Any,
    state: Any,
    parameters: Any,
    xs: Any,
    zs: Any,
    first: Any,
    last: Any,
    catch_up: Any,
    catch_down: Any,
) -> None:
    """Advance the proxy by one tick and write the force on the hand."""
    k, wall, mu, damping = parameters[0], parameters[1], parameters[2], parameters[3]
    period, ring, omega, decay = parameters[4], parameters[5], parameters[6], parameters[7]
    hand_x = min(max(position[0], xs[0]), xs[-1])
    hand_z = position[2]
    x, piece = state[0], int(state[2])
    z = _height(x, piece, xs, zs)
    rise_ahead = first[piece] + (x - xs[piece]) / (xs[piece + 1] - xs[piece]) * (last[piece] - first[piece])
    rise_behind = rise_ahead
    knot = -1
    if x == xs[piece]:
        knot = piece
        if piece > 0:
            rise_behind = last[piece - 1]
    elif x == xs[piece + 1]:
        knot = piece + 1
        rise_behind = last[piece]
        if piece + 2 < len(xs):
            rise_ahead = first[piece + 1]
    pull, down = k * (hand_x - x), wall * (z - hand_z)
    lost = pull * rise_ahead + down < 0.0 and pull * rise_behind + down < 0.0  # neither side of the notch is pressed
    if state[3] == FLIGHT or lost:
        if state[3] == FLIGHT:  # the proxy was where the hand was, which may be high above the path
            z = max(z, state[9])
        x, piece, state[3] = _land(x, z, piece, hand_x, hand_z, xs, zs)
        knot = -1
        state[1] = position[1]
        state[9] = hand_z
    if state[3] == FLIGHT:
        force[0] = force[1] = force[2] = 0.0
        state[0], state[2], state[4] = x, piece, 0.0
    else:
        x, piece = _move(
            x, piece, knot, hand_x, hand_z, k, wall, mu, xs, zs, first, last, catch_up, catch_down, state, ring
        )
        pull, down = k * (hand_x - x), wall * (_height(x, piece, xs, zs) - hand_z)
        # along the edge the friction has its own limit: a box instead of the cone, exact for drags along x or y
        slack = k * (position[1] - state[1])
        limit = mu * max(down, 0.0)
        slack = min(max(slack, -limit), limit)
        state[1] = position[1] - slack / k
        state[0], state[2], state[4] = x, piece, pull
        force[0] = -pull - damping * velocity[0]
        force[1] = -slack - damping * velocity[1]
        force[2] = down - damping * velocity[2]
    if state[5] >= 0.0:
        force[0] += state[6] * math.exp(-state[5] / decay) * math.sin(omega * state[5])
        state[5] += period


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _move(
    x: Any,
    piece: Any,
    knot: Any,
    hand_x: Any,
    hand_z: Any,
    k: Any,
    wall: Any,
    mu: Any,
    xs: Any,
    zs: Any,
    first: Any,
    last: Any,
    catch_up: Any,
    catch_down: Any,
    state: Any,
    ring: Any,
) -> Any:
    """Slide in either direction; leaving a notch uphill is the event."""
    right = piece + 1 if (x == xs[piece + 1] and piece + 2 < len(xs)) else piece
    new_x, new_piece = _slide(1.0, x, right, hand_x, hand_z, k, wall, mu, xs, zs, first, last)
    direction = 1.0
    if new_x == x:
        left = piece - 1 if (x == xs[piece] and piece > 0) else piece
        new_x, new_piece = _slide(-1.0, x, left, hand_x, hand_z, k, wall, mu, xs, zs, first, last)
        direction = -1.0
        if new_x == x:
            return x, piece
    if ring > 0.0 and knot >= 0 and ((direction > 0.0 and catch_up[knot]) or (direction < 0.0 and catch_down[knot])):
        state[5] = 0.0
        state[6] = ring * state[4]  # the pull of the last tick: what the notch held
        state[7] += 1.0
        state[8] = state[4]
    return new_x, new_piece


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def drag(
    record: Any,
    start: Any,
    step: Any,
    load: Any,
    resolution: Any,
    force: Any,
    state: Any,
    parameters: Any,
    xs: Any,
    zs: Any,
    first: Any,
    last: Any,
    catch_up: Any,
    catch_down: Any,
) -> None:
    """Drive `tick` with a hand that moves steadily along x and keeps its load; rows: hand, spring, force along x."""
    position, read, velocity = start.copy(), start.copy(), start * 0.0
    velocity[0] = step / parameters[4]
    for index in range(record.shape[1]):
        position[0] = start[0] + index * step
        for axis in range(3):
            value = position[axis]
            read[axis] = round(value / resolution) * resolution if resolution > 0.0 else value
        tick(read, velocity, force, state, parameters, xs, zs, first, last, catch_up, catch_down)
        record[0, index], record[1, index], record[2, index] = position[0], state[4], force[0]
        # the wall is a known spring, so one correction along z is exact until the proxy moves
        position[2] += (force[2] - load) / parameters[1]
