"""Motion of the tip over an edge, from breaking loose to the upper face, in units of radius sum, load and the tool's mass."""

from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_HEIGHT = np.array([0.02, 0.05, 0.1, 0.16, 0.24, 0.32, 0.4, 0.48, 0.56, 0.64, 0.72])
_FRICTION = np.array([0.02, 0.1, 0.18, 0.28, 0.4])
_LN_STIFFNESS = np.log(np.array([0.4, 0.8, 1.4, 2.2, 3.5, 6.0]))
_LN_SPEED = np.log(np.array([0.006, 0.015, 0.035, 0.08, 0.17, 0.4]))
_AXES = (_HEIGHT, _FRICTION, _LN_STIFFNESS, _LN_SPEED)
_STEPS_PER_RADIAN = 60.0
_MOST_STEPS = 400_000
_LEAST_SHARE = 1e-3  # below it the tip climbs down instead of jumping, and what rings is not the release


@njit(cache=True)
def _climb(height: float, friction: float, stiffness: float, speed: float) -> tuple[float, float]:
    """Peak force over its quasi-static value, and amplitude of the ring as a force over the load."""
    # the mass is lifted as well as moved: (1 + T tan a) x'' = F - T (1 + y'' x'^2), T = tan(a + atan mu)
    turn = np.arctan(friction)
    angle = np.arccos(1.0 - height)
    reach = np.sin(angle)
    force = np.tan(angle + turn)
    start, peak = force, force
    # time in 1/omega, positions in R: x'' = stiffness-scaled forces with k R / N = stiffness
    x, velocity, handle = 0.0, 0.0, force / stiffness
    step = 1.0 / _STEPS_PER_RADIAN
    drive = speed / stiffness
    for _ in range(_MOST_STEPS):
        slope_angle = np.arcsin(min(max(reach - x, 0.0), 1.0))
        resist = np.tan(slope_angle + turn)
        rise = np.tan(slope_angle)
        bend = -1.0 / np.cos(slope_angle) ** 3
        lifted = max(1.0 + stiffness * bend * velocity * velocity, 0.0)
        acceleration = (force - resist * lifted) / stiffness
        if lifted > 0.0:
            acceleration /= 1.0 + resist * rise
        velocity = max(velocity + acceleration * step, 0.0)
        x += velocity * step
        handle += drive * step
        force = stiffness * (handle - x)
        peak = max(peak, force)
        if x >= reach:
            break
    return peak / start, np.hypot(force - friction, (velocity - drive) * stiffness)


@lru_cache(maxsize=1)
def _release_table() -> Floats:
    """Tabulate the climb: ln of the peak's excess, ln of the ringing share of the stored energy."""
    table = np.zeros((*(axis.size for axis in _AXES), 2))
    for i, height in enumerate(_HEIGHT):
        for j, friction in enumerate(_FRICTION):
            start = np.tan(np.arccos(1.0 - height) + np.arctan(friction))
            if not 0.0 < start < 60.0:
                # locked: the corner of the table repeats its neighbour
                table[i, j] = table[i, j - 1]
                continue
            for k, stiffness in enumerate(np.exp(_LN_STIFFNESS)):
                for m, speed in enumerate(np.exp(_LN_SPEED)):
                    peak, amplitude = _climb(height, friction, stiffness, speed)
                    share = max((amplitude / (start * peak)) ** 2, _LEAST_SHARE)
                    table[i, j, k, m] = np.log(peak), np.log(share)
    return table


@njit(cache=True)
def _between(points: Floats, axes: Any, table: Floats) -> Floats:
    """Linear between the points of the table, beyond it at its end; compiled, as a fit asks for it thousands of times."""
    found = np.zeros((points.shape[1], 2))
    cell, share = np.zeros(4, np.int64), np.zeros(4)
    for n in range(points.shape[1]):
        for d in range(4):
            held = min(max(points[d, n], axes[d][0]), axes[d][-1])
            cell[d] = min(np.searchsorted(axes[d], held, side="right") - 1, axes[d].size - 2)
            share[d] = (held - axes[d][cell[d]]) / (axes[d][cell[d] + 1] - axes[d][cell[d]])
        for corner in range(16):
            weight = 1.0
            for d in range(4):
                weight *= share[d] if corner >> d & 1 else 1.0 - share[d]
            a, b, c, e = corner & 1, corner >> 1 & 1, corner >> 2 & 1, corner >> 3 & 1
            own = table[cell[0] + a, cell[1] + b, cell[2] + c, cell[3] + e]
            found[n, 0] += weight * own[0]
            found[n, 1] += weight * own[1]
    return found


def released(height: Floats, friction: Floats, stiffness: Floats, speed: Floats) -> tuple[Floats, Floats]:
    """Logarithms of the peak's excess and of the share that rings, of H/R, mu, k R / N and v k / (omega N), held to the table."""
    asked = np.stack([height, friction, np.log(stiffness), np.log(speed)])
    excess, share = _between(asked, _AXES, _release_table()).T
    return excess, share
