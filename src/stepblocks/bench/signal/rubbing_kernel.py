"""The course of a tool whose tip rubs, half cycle by half cycle: numbers in, numbers out, nothing checked.

Written for a compiler: scalars and loops alone. `stepblocks.bench.signal.rubbing_ring.rubbing_force` is the function to call.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_MOST_PHASES = 5000


def rubbing_kernel(
    time: NDArray[np.float64],
    level: float,
    gap: float,
    frequency: float,
    decay: float,
    force: float,
    rate: float,
    slope: float,
) -> NDArray[np.float64]:
    """Force at the instants `time`, ascending from 0; `force` and `rate` are those at 0. See `rubbing_force`."""
    omega = 2.0 * math.pi * frequency
    result = np.empty_like(time)
    count = time.size
    step = 2.0 * math.pi / omega / 20.0
    # at the speed of the ramp the damping alone pulls as much as this deflection; it shifts where the tip sticks
    shift = 2.0 / decay * slope / (omega * omega + 1.0 / (decay * decay))
    begin, done = 0.0, 0
    forward = rate < slope
    for _ in range(_MOST_PHASES):
        rest = level if forward else level - gap
        a = force - rest
        b = (rate + a / decay) / omega
        p, q = b * omega - a / decay, a * omega + b / decay
        sign = 1.0 if forward else -1.0
        # the tip turns where the force climbs as fast as the ramp; too small a ring never does
        horizon = time[count - 1] - begin + step
        if gap <= 0.0 or (forward and math.hypot(p, q) <= slope):
            turn = math.inf
        else:
            turn = math.inf
            low, high = 0.0, step
            while low <= horizon:
                rise = math.exp(-high / decay) * (p * math.cos(omega * high) - q * math.sin(omega * high))
                if sign * (rise - slope) > 0.0:
                    for _ in range(36):
                        middle = 0.5 * (low + high)
                        rise = math.exp(-middle / decay) * (p * math.cos(omega * middle) - q * math.sin(omega * middle))
                        if sign * (rise - slope) > 0.0:
                            high = middle
                        else:
                            low = middle
                    turn = high
                    break
                low, high = high, high + step
        while done < count and time[done] - begin < turn:
            t = time[done] - begin
            result[done] = rest + math.exp(-t / decay) * (a * math.cos(omega * t) + b * math.sin(omega * t))
            done += 1
        if done >= count:
            return result
        shrink, c, s = math.exp(-turn / decay), math.cos(omega * turn), math.sin(omega * turn)
        force = rest + shrink * (a * c + b * s)
        rate = shrink * ((b * omega - a / decay) * c - (a * omega + b / decay) * s)
        begin += turn
        if forward and force >= level - gap - shift and slope > 0.0:
            # it sticks, and is loaded along the ramp until it slips forward again
            wait = max(level - shift - force, 0.0) / slope
            while done < count and time[done] - begin < wait:
                result[done] = force + slope * (time[done] - begin)
                done += 1
            force, rate, begin = max(level - shift, force), slope * (1.0 - 1e-9), begin + wait
        else:
            forward = not forward
    # not-a-number, or a tip that chatters without end: no model, and a fit must see that by its size
    result[done:] = 1e6
    return result
