"""Motion of the tip from breaking loose to its first swing.

It is in units of radius sum, load and the mass of the tool.
"""

from functools import lru_cache
from typing import cast

import numpy as np
from numba import njit

from stepblocks.contact import Array
from stepblocks.contact.kernels import compute_softened_force

_STEPS_PER_RADIAN = 30.0  # of the tool's swing: E_v within 3 % of that of ever smaller steps
_MOST_RADIANS = 400.0  # a tip that is still on the edge climbs down with the handle
_HIGHEST = 0.97  # step over radius to which a fit may stray
_STEEPEST = np.deg2rad(89.0)  # slope to which a fit may stray
_LEAST_SHARE = 0.01  # of the peak, below which no gauge tells a swing from noise


_softened = njit(cache=True)(compute_softened_force)


@njit(cache=True, error_model="numpy")
def _integrate_climb(
    height: float, friction: float, stiffness: float, speed: float, damping: float, cubic: float
) -> tuple[float, float]:
    # Peak force over that at which the tip breaks loose. Energy of the first swing below sliding
    # over that stored, undamped.
    # The mass is lifted as well as moved: (1 + T tan a) x'' = F - T (1 + y'' x'^2), T = tan(a +
    # atan mu), while it is pressed on; it may fly off, stop on its way, and slip back. Time in
    # 1/omega, positions in R, forces in N, k R / N = stiffness.
    edge = np.arccos(1.0 - height)
    friction = min(friction, np.tan(_STEEPEST - edge))
    reach = np.sin(edge)
    step = 1.0 / _STEPS_PER_RADIAN
    drive = speed / stiffness
    drag = 2.0 * damping * stiffness
    start = max(np.tan(edge + np.arctan(friction)) - drag * drive, _LEAST_SHARE)
    force, peak, lowest = start, start, start
    x = velocity = y = up = 0.0
    flies = False
    last = 1.0 - height
    handle = _softened(start, cubic) / stiffness
    for _ in range(int(_MOST_RADIANS * _STEPS_PER_RADIAN)):
        sine = min(max(reach - x, 0.0), 1.0)
        ground = np.sqrt(1.0 - sine * sine)
        rise = sine / ground
        pull = force + drag * (drive - velocity)
        # the share of the step in which the tip is on the edge still
        on = 1.0 if x < reach else 0.0
        if velocity > 0.0:
            on = min(max((reach - x) / (velocity * step), 0.0), 1.0)
        if flies and y <= ground:  # it lands and does not bounce
            closing = max(velocity * sine - up * ground, 0.0)
            flies = False
            velocity = max(velocity * ground + up * sine - friction * closing, 0.0) * ground
        lifted = 1.0 - on * stiffness * velocity * velocity / (ground * ground * ground)
        if flies or lifted + rise * pull <= 0.0:
            if not flies:
                flies = True
                y = ground
                up = (ground - last) / step
            velocity += pull / stiffness * step
            up -= step / stiffness
            y += up * step
        else:
            left = step
            ahead, back = (
                (rise + friction) / (1.0 - rise * friction),
                (rise - friction) / (1.0 + rise * friction),
            )
            for _ in range(2):  # where it stops, it sticks or slips back for the rest of the step
                moves = velocity != 0.0 or pull > ahead or pull < back
                resist = back if velocity < 0.0 or (velocity == 0.0 and pull < back) else ahead
                gained = (
                    (pull - resist * lifted) / (stiffness * (1.0 + resist * rise)) if moves else 0.0
                )
                if (velocity + gained * left) * velocity >= 0.0:
                    velocity += gained * left
                    break
                left += velocity / gained
                velocity = 0.0
        x += velocity * step
        handle += drive * step
        last = ground
        stretch = stiffness * (handle - x)
        force = stretch + cubic * stretch**3
        peak = max(peak, force)
        if x >= reach or force < friction:
            if force > lowest and (lowest < friction or velocity <= drive):
                break
            lowest = min(lowest, force)
    if lowest >= friction:
        return peak / start, 0.0
    level, low, top = _softened(friction, cubic), _softened(lowest, cubic), _softened(peak, cubic)
    swing = (
        0.5 * (low**2 - level**2) + 0.25 * cubic * (low**4 - level**4) - friction * (low - level)
    )
    # half a period of the damper lies between the swing above sliding, which counts, and the one
    # below
    return peak / start, swing / (0.5 * top**2 + 0.25 * cubic * top**4) * np.exp(
        2.0 * np.pi * damping
    )


@njit(cache=True)
def _integrate_climbs(cases: Array) -> Array:
    found = np.empty((cases.shape[1], 2))
    for n in range(cases.shape[1]):
        found[n] = _integrate_climb(
            cases[0, n], cases[1, n], cases[2, n], cases[3, n], cases[4, n], cases[5, n]
        )
    return found


@lru_cache(maxsize=64)  # most parameters of a fit do not change the motion
def _compute_climbs(cases: bytes) -> Array:
    return cast(Array, _integrate_climbs(np.frombuffer(cases).reshape(6, -1)))


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
    excess, share = _compute_climbs(
        np.stack(
            [np.clip(height, 1e-6, _HIGHEST), friction, stiffness, speed, damping, cubic]
        ).tobytes()
    ).T
    return np.log(excess), np.log(np.maximum(share, _LEAST_SHARE**2))
