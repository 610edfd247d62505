"""Motion of the tip from breaking loose to its first swing.

It is in units of radius sum, load and the mass of the tool.
"""

from functools import lru_cache

import numpy as np
from numba import njit

from stepblocks.contact import Array
from stepblocks.contact.kernels import compute_softened_force

_STEPS_PER_RADIAN = 30.0  # of the tool's swing: E_v within 3 % of that of ever smaller steps
_MOST_RADIANS = 400.0  # a tip that is still on the edge climbs down with the handle
_HIGHEST = 0.97  # step over radius to which a fit may stray
_STEEPEST = np.deg2rad(89.0)  # slope to which a fit may stray
_LEAST_SHARE = 0.01  # of the peak, below which no gauge tells a swing from noise


# tips that move together: processors that take eight numbers at once move them as fast as one
_LANES = 8
_STEP = 1.0 / _STEPS_PER_RADIAN
_MOST_STEPS = _MOST_RADIANS * _STEPS_PER_RADIAN
# numbers that tell of one tip: what stays, what moves, what is kept of the way, and whether it is
# done and after how many steps
_NUMBERS = 19


@njit(cache=True, error_model="numpy")
def _move_tips(s: Array) -> None:
    # One step of as many tips as there are lanes; `s` holds every number of them side by side.
    # Without a branch, which would move them one by one.
    # The mass is lifted as well as moved: (1 + T tan a) x'' = F - T (1 + y'' x'^2), T = tan(a +
    # atan mu), while it is pressed on; it may fly off, stop on its way, and slip back. Time in
    # 1/omega, positions in R, forces in N, k R / N = stiffness.
    n = _LANES
    for j in range(n):
        friction, stiffness, give, drive = s[j], s[n + j], s[2 * n + j], s[3 * n + j]
        drag, cubic, reach = s[4 * n + j], s[5 * n + j], s[18 * n + j]
        force, x, velocity, handle = s[6 * n + j], s[7 * n + j], s[8 * n + j], s[9 * n + j]
        y, up, last, aloft = s[10 * n + j], s[11 * n + j], s[12 * n + j], s[13 * n + j]
        left = max(reach - x, 0.0)
        # the share of the step in which the tip is on the edge still
        on = min(left / (velocity * _STEP), 1.0) if velocity > 0.0 else 1.0
        sine = min(left, 1.0)
        square = 1.0 - sine * sine
        ground = np.sqrt(square)
        pull = force + drag * (drive - velocity)
        flies = (aloft > 0.0) & (y > ground)
        # one that lands does not bounce
        lost = friction * max(velocity * sine - up * ground, 0.0)
        along = max(velocity * ground + up * sine - lost, 0.0)
        velocity = along * ground if (aloft > 0.0) & (y <= ground) else velocity
        bend = on * velocity * velocity / square if left > 0.0 else 0.0
        leaves = flies | (ground - stiffness * bend + sine * pull <= 0.0)
        up = (up if flies else (ground - last) * _STEPS_PER_RADIAN) - _STEP * give
        # by how much the pull exceeds what holds it ahead, and back: over cos^2 of the slope with
        # the angle of friction added, or taken off
        rub, slip, lever = friction * ground, friction * sine, ground * give
        ahead = pull * (ground - slip) - (sine + rub)
        back = pull * (ground + slip) - (sine - rub)
        forward = ahead * lever + (sine + rub) * bend
        backward = back * lever + (sine - rub) * bend
        # where it stops, it sticks or slips back for the rest of the step
        loose = backward if back < 0.0 else forward if ahead > 0.0 else 0.0
        gained = backward if velocity < 0.0 else forward if velocity > 0.0 else loose
        climbed = velocity + gained * _STEP
        turned = loose * (_STEP + velocity / gained)
        climbed = turned if climbed * velocity < 0.0 else climbed
        velocity = velocity + pull * give * _STEP if leaves else climbed
        x += velocity * _STEP
        handle += drive * _STEP
        stretch = stiffness * (handle - x)
        force = stretch + cubic * stretch**3
        lowest = s[15 * n + j]
        swings = (x >= reach) | (force < friction)
        past = (force > lowest) & ((lowest < friction) | (velocity <= drive))
        s[6 * n + j], s[7 * n + j], s[8 * n + j], s[9 * n + j] = force, x, velocity, handle
        s[10 * n + j] = (y if flies else ground) + up * _STEP
        s[11 * n + j], s[12 * n + j] = up, ground
        s[13 * n + j] = 1.0 if leaves else 0.0
        s[14 * n + j] = max(s[14 * n + j], force)
        s[15 * n + j] = min(lowest, force) if swings else lowest
        s[16 * n + j] = 1.0 if (swings & past) | (s[17 * n + j] >= _MOST_STEPS) else 0.0
        s[17 * n + j] += 1.0


@njit(cache=True)
def _move_all_tips(tips: Array) -> None:
    # Move every tip to its end, a row of `tips` each; a lane whose tip is done takes the next
    lanes = np.zeros((_NUMBERS, _LANES))
    lanes[16] = 1.0
    owner = np.full(_LANES, len(tips))
    waiting = done = 0
    while done < len(tips):
        for j in range(_LANES):
            if lanes[16, j] > 0.0:
                if owner[j] < len(tips):
                    tips[owner[j]] = lanes[:, j]
                    done += 1
                owner[j] = waiting
                lanes[:, j] = tips[min(waiting, len(tips) - 1)]
                waiting += 1
        _move_tips(lanes.reshape(-1))


@lru_cache(maxsize=64)  # most parameters of a fit do not change the motion
def _integrate_climbs(cases: bytes) -> Array:
    # Peak force over that at which the tip breaks loose. Energy of the first swing below sliding
    # over that stored, undamped.
    height, friction, stiffness, speed, damping, cubic = np.frombuffer(cases).reshape(6, -1)
    edge = np.arccos(1.0 - height)
    friction = np.minimum(friction, np.tan(_STEEPEST - edge))
    drive, drag = speed / stiffness, 2.0 * damping * stiffness
    start = np.maximum(np.tan(edge + np.arctan(friction)) - drag * drive, _LEAST_SHARE)
    tips = np.zeros((len(height), _NUMBERS))
    tips[:, :6] = np.stack([friction, stiffness, 1.0 / stiffness, drive, drag, cubic], axis=1)
    tips[:, [6, 14, 15]] = start[:, None]
    tips[:, 9] = compute_softened_force(start, cubic) / stiffness
    tips[:, 12] = 1.0 - height
    tips[:, 18] = np.sin(edge)
    # the slowest first: one that climbs down with the handle at last would move in a lane alone
    slow = np.argsort(drive, kind="stable")
    moved = tips[slow]
    _move_all_tips(moved)
    tips[slow] = moved
    peak, lowest = tips[:, 14], tips[:, 15]
    level, low, top = compute_softened_force(np.stack([friction, lowest, peak]), cubic)
    swing = (
        0.5 * (low**2 - level**2) + 0.25 * cubic * (low**4 - level**4) - friction * (low - level)
    )
    # half a period of the damper lies between the swing above sliding, which counts, and the one
    # below
    share = swing / (0.5 * top**2 + 0.25 * cubic * top**4) * np.exp(2.0 * np.pi * damping)
    return np.stack([peak / start, np.where(lowest < friction, share, 0.0)])


def compute_release(
    height: Array,
    friction: Array,
    stiffness: Array,
    speed: Array,
    damping: Array,
    cubic: Array,
) -> tuple[Array, Array]:
    """Compute the logarithms of the peak's excess and of the share that rings.

    They depend on V k / (omega N), the damping ratio and g N^2.
    """
    excess, share = _integrate_climbs(
        np.stack(
            [np.clip(height, 1e-6, _HIGHEST), friction, stiffness, speed, damping, cubic]
        ).tobytes()
    )
    return np.log(excess), np.log(np.maximum(share, _LEAST_SHARE**2))
