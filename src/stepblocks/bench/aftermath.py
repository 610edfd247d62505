"""After the slip: which kind of ring it is, and its figures carried back to the instant of release."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.approach import Approach
from stepblocks.bench.landmarks import Landmarks
from stepblocks.bench.ring import Ring, fit_ring, guess_ring, linear_decay, ring_amplitude
from stepblocks.bench.rubbing_ring import RubbingRing, fit_rubbing_ring

__all__ = ["Aftermath", "settle"]

Array = NDArray[np.float64]

_RELEASE_TIME = 0.3e-3  # [s] first samples after the peak, in which the sensor itself still follows
_GOOD = 1.6  # squared noise over white noise up to which a fit is taken at once
_TAIL_SHARE = 0.35  # last share of the record after the slip, in which only the tool's own ring is left
_MOST_TROUGHS = 8


@dataclass(frozen=True)
class Aftermath:
    """Figures of the ring at the release instant, each with its standard uncertainty.

    Attributes
    ----------
    kind : str
        ``"damped"`` or ``"rubbing"``.
    start : float
        Instant to which the amplitude is carried back [s].
    amplitude, frequency, decay_time, level, friction_decay : tuple of float
        Value and standard uncertainty [N, Hz, s, N, N/s].
    ring : Ring or RubbingRing
        The fit.
    """

    kind: str
    start: float
    amplitude: tuple[float, float]
    frequency: tuple[float, float]
    decay_time: tuple[float, float]
    level: tuple[float, float]
    friction_decay: tuple[float, float]
    ring: Ring | RubbingRing

    def carried_to(self, instant: float) -> Aftermath:
        """Return the same with the amplitude at another instant [s]."""
        ring = self.ring
        amplitude = ring_amplitude(ring, instant) if isinstance(ring, Ring) else ring.amplitude(instant)
        return replace(self, start=instant, amplitude=amplitude)

    @property
    def origin(self) -> float:
        """First instant [s] that the fit saw."""
        return self.ring.origin


def settle(time: Array, force: Array, marks: Landmarks, approach: Approach) -> Aftermath:
    """Fit the ring after a slip as that of a bell and, where that fails, as that of a tool whose tip rubs.

    Parameters
    ----------
    time, force : ndarray, shape (n,)
        The whole record [s, N].
    marks : Landmarks
        Coarse instants.
    approach : Approach
        Fit of sliding and ramp: hum and slope.

    Returns
    -------
    Aftermath
        Figures at the release instant.
    """
    top = float(time[marks.peak])
    first = int(np.searchsorted(time, top + _RELEASE_TIME))
    bell = fit_ring(time[first:], force[first:], top, approach.mains, marks.noise)
    if bell.chi_square < _GOOD:
        return _of_bell(bell, top)
    rubbing = _best_rubbing(time, force, marks, approach)
    if rubbing is None or rubbing[0].chi_square >= bell.chi_square:
        return _of_bell(bell, top)
    return _of_rubbing(*rubbing)


def _of_bell(bell: Ring, top: float) -> Aftermath:
    return Aftermath(
        kind="damped",
        start=top,
        amplitude=ring_amplitude(bell, top),
        frequency=(bell.frequency, bell.frequency_std),
        decay_time=(bell.decay_time, bell.decay_time_std),
        level=(bell.level, bell.level_std),
        friction_decay=linear_decay(bell),
        ring=bell,
    )


def _of_rubbing(fit: RubbingRing, start: float) -> Aftermath:
    level, gap, frequency, decay = (float(v) for v in fit.values[:4])
    known = fit.knows_gap
    return Aftermath(
        kind="rubbing",
        start=start,
        amplitude=fit.amplitude(start),
        frequency=(frequency, fit.std(2)),
        decay_time=(decay, fit.std(3)),
        level=(level, fit.std(0)),
        friction_decay=(2.0 * gap * frequency, 2.0 * frequency * fit.std(1)) if known else (np.nan, np.nan),
        ring=fit,
    )


def _best_rubbing(time: Array, force: Array, marks: Landmarks, approach: Approach) -> tuple[RubbingRing, float] | None:
    """Fit from one trough after the other, until the tip no longer climbs; with the begin of that ring."""
    clean = force - approach.hum(time)
    after = clean[marks.peak :]
    tail = after[int(after.size * (1.0 - _TAIL_SHARE)) :]
    level = float(np.median(tail))
    frequency, decay = _tool_guess(time, clean, marks)
    best: tuple[RubbingRing, float] | None = None
    for trough, crossing in _troughs(time, clean, marks, level, frequency)[:_MOST_TROUGHS]:
        origin = float(time[trough])
        fit = fit_rubbing_ring(
            time[trough:], clean[trough:], origin, (level, frequency, decay), approach.slope, marks.noise
        )
        start = max(float(time[marks.peak]), crossing - 0.25 / fit.values[2])
        if best is None or fit.chi_square < 0.7 * best[0].chi_square:
            best = (fit, start)
        if best[0].chi_square < _GOOD:
            break
    return best


def _tool_guess(time: Array, clean: Array, marks: Landmarks) -> tuple[float, float]:
    """Frequency and decay time of the tool from where nothing but its own ring is left."""
    after = marks.peak + int((time.size - marks.peak) * 0.25)
    return guess_ring(time[after:], clean[after:])


def _troughs(time: Array, clean: Array, marks: Landmarks, level: float, frequency: float) -> list[tuple[int, float]]:
    """Troughs after the slip, each with the instant at which the force fell through the level before it."""
    rate = (time.size - 1) / (time[-1] - time[0])
    half = max(int(0.5 * rate / frequency), 2)
    smooth = np.convolve(clean, np.full(5, 0.2), mode="same")
    found = []
    index = marks.peak
    while len(found) < _MOST_TROUGHS:
        below = np.flatnonzero(smooth[index : smooth.size - 2] < level)
        if not below.size:
            break
        crossing = index + int(below[0])
        trough = crossing + int(np.argmin(smooth[crossing : crossing + half]))
        found.append((trough, _crossing_time(time, smooth, crossing, level)))
        above = np.flatnonzero(smooth[trough : smooth.size - 2] > level)
        if not above.size or trough + int(above[0]) + 4 * half >= time.size:
            break
        index = trough + int(above[0])
    return found


def _crossing_time(time: Array, smooth: Array, index: int, level: float) -> float:
    high, low = smooth[index - 1] - level, smooth[index] - level
    share = high / (high - low) if high > low else 1.0
    return float(time[index - 1] + np.clip(share, 0.0, 1.0) * (time[index] - time[index - 1]))
