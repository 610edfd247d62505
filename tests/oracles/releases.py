"""Records of a drag whose release has a shape of its own, in closed form, as a gauge shows them.

Nothing here comes from the program. A tip slides at a level, is loaded along a straight ramp, and
is let go at a known instant. From there on the force is the level, a ring that begins as a cosine,
and a rest that dies in one of three ways: down a straight line, along a half cosine, or by an
exponential.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RATE = 10e3  # samples per second [Hz]
FINE = 40  # instants of the closed form per sample


class Fall(Enum):
    """How the rest of the peak dies."""

    STRAIGHT = "straight"
    HALF_COSINE = "half cosine"
    EXPONENTIAL = "exponential"


@dataclass(frozen=True)
class Release:
    """A drag and its gauge, SI.

    Attributes
    ----------
    fall : Fall
    duration : float
        In which the rest dies, of an exponential to 1/e [s].
    bandwidth : float
        Of a gauge of first order [Hz].
    """

    fall: Fall = Fall.EXPONENTIAL
    duration: float = 0.4e-3
    bandwidth: float = math.inf
    load: float = 0.5  # [N]
    friction: float = 0.15
    peak: float = 1.0  # [N]
    slope: float = 49.05  # [N/s]
    share: float = 0.45  # of the peak over sliding that rings
    frequency: float = 300.0  # [Hz]
    decay_time: float = 14e-3  # [s]
    noise: float = 3e-3  # of a sample [N]
    lead: float = 60e-3  # of sliding before the ramp [s]
    tail: float = 0.1  # recorded after the release [s]


@dataclass(frozen=True)
class Record:
    """What the gauges show, and what is true of it.

    Attributes
    ----------
    time, tangential, normal : Floats
        Shape (n,) [s], [N], [N].
    peak : float
        Highest force that the gauge shows, without noise, between samples too [N].
    release : float
        Instant of that force [s].
    """

    time: Floats
    tangential: Floats
    normal: Floats
    peak: float
    release: float


def record_release(release: Release, random: np.random.Generator) -> Record:
    """Record one drag; where its samples fall about the release is drawn."""
    lead = release.lead + random.uniform(0.0, 1.0 / RATE)
    level = release.friction * release.load
    let_go = lead + (release.peak - level) / release.slope
    step = 1.0 / (RATE * FINE)
    fine = step * np.arange(round((let_go + release.tail) * RATE) * FINE)
    force = level + np.maximum(release.slope * (fine - lead), 0.0)
    after = fine >= let_go
    force[after] = level + _fall(release, fine[after] - let_go, release.peak - level)
    shown = _filter(force, release.bandwidth, step)
    highest = int(np.argmax(shown))
    peak, instant = float(shown[highest]), float(fine[highest])
    if math.isinf(release.bandwidth):
        peak, instant = release.peak, let_go
    samples = shown[::FINE]
    noise = release.noise * random.standard_normal((2, samples.size))
    return Record(fine[::FINE], samples + noise[0], release.load + noise[1], peak, instant)


def _fall(release: Release, since: Floats, height: float) -> Floats:
    """Return the force over the level after the release [N]; it begins at `height`."""
    ring = release.share * height
    swing = np.exp(-since / release.decay_time) * np.cos(2.0 * np.pi * release.frequency * since)
    share = np.minimum(since / release.duration, 1.0)
    if release.fall is Fall.STRAIGHT:
        left = 1.0 - share
    elif release.fall is Fall.HALF_COSINE:
        left = 0.5 + 0.5 * np.cos(np.pi * share)
    else:
        left = np.exp(-since / release.duration)
    return np.asarray(ring * swing + (height - ring) * left)


def _filter(force: Floats, bandwidth: float, step: float) -> Floats:
    """Return what a gauge of first order shows of a force [N]."""
    if math.isinf(bandwidth):
        return force
    from scipy.signal import lfilter

    keep = math.exp(-2.0 * math.pi * bandwidth * step)
    shown, _ = lfilter([1.0 - keep], [1.0, -keep], force, zi=[keep * force[0]])
    return np.asarray(shown)
