"""Channels of a drag, trial by trial: slots in, numbers out, nothing checked.

Written for a compiler: scalars and loops alone, since a search asks for them some ten thousand times.
`stepblocks.contact.state.observe` is the function to call.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_STEEPEST = math.radians(89.0)


@njit(cache=True, error_model="numpy")
def channels_of(
    height: Floats,
    radius: Floats,
    tilt: Floats,
    friction: Floats,
    load: Floats,
    set_load: Floats,
    climb_load: Floats,
    sensed_offset: Floats,
    speed: Floats,
    stiffness: Floats,
    ring_stiffness: Floats,
    hardening: Floats,
    conversion: Floats,
    lost_energy: Floats,
    drag: Floats,
    climb_drag: Floats,
    damping: Floats,
    gain: Floats,
    lag: Floats,
    frequency: Floats,
    decay_time: Floats,
    nominal_stiffness: float,
) -> Floats:
    """Channels of n trials, shape (n, 7); the slots are those of `DragState`."""
    count = height.size
    shown = np.empty((count, 7))
    for i in range(count):
        turn = math.atan(friction[i]) + tilt[i]
        share = min(max(height[i] / radius[i], 1e-9), 1.0)
        angle = min(max(2.0 * math.asin(math.sqrt(0.5 * share)) + turn, -1.0), _STEEPEST)
        lifted = max(load[i] + climb_load[i], 1e-3)
        force = max(lifted * math.tan(angle) + drag[i] + climb_drag[i], 1e-4)
        linear, cubic = force, hardening[i]
        if cubic > 1e-8:
            root = math.sqrt(3.0 * max(cubic, 1e-9))
            linear = 2.0 / root * math.sinh(math.asinh(1.5 * force * root) / 3.0)
        stored = (0.5 * linear**2 + 0.25 * cubic * linear**4) / stiffness[i]
        sliding = max(load[i], 1e-3) * math.tan(turn) + drag[i]
        slope, late = stiffness[i] * speed[i], max(lag[i], 1e-18)
        ramp = max(force - sliding, 0.0) / slope
        peak = max(force - slope * late * (1.0 - math.exp(-min(ramp / late, 50.0))), 1e-4)
        ringing = conversion[i] * stored
        # energy never turns negative: below a tenth of what would ring it fades out smoothly
        energy, floor = ringing - lost_energy[i], 0.1 * ringing
        if not energy > floor:
            energy = floor * math.exp(min(energy / floor - 1.0, 0.0))
        # an amplitude of force counts as A^2 / 2k with the nominal k, whatever k it rings with
        energy *= ring_stiffness[i] / nominal_stiffness
        # the same gauge shows the ring smaller
        energy /= 1.0 + (2.0 * math.pi * frequency[i] * late) ** 2
        sensed = max(set_load[i] + sensed_offset[i], 1e-3)
        shown[i, 0] = math.log(gain[i] ** 2 * energy)
        shown[i, 1] = math.log(gain[i] * peak)
        shown[i, 2] = gain[i] * sliding / sensed
        shown[i, 3] = gain[i] * stiffness[i] * (force / linear) / nominal_stiffness
        shown[i, 4] = math.log(frequency[i] * math.sqrt(ring_stiffness[i] / nominal_stiffness))
        shown[i, 5] = math.log(decay_time[i] / damping[i])
        shown[i, 6] = sensed / set_load[i]
    return shown
