"""Shares of the energy of loading and vibration in the bands that the paper looks at."""

from typing import NamedTuple

import numpy as np

from stepblocks.bench.signal import Array
from stepblocks.bench.signal.aftermath import Aftermath
from stepblocks.bench.signal.approach import Approach
from stepblocks.bench.signal.peak import Peak

LOADING_BAND = (0.0, 100.0)  # in which the paper finds more than 64 % of the energy of loading [Hz]
# in which the paper finds about 86 % of the energy of the vibration [Hz]
VIBRATION_BAND = (250.0, 350.0)
_RING_TIMES = 5.0  # decay times after which the ring counts as over


class BandShares(NamedTuple):
    """Shares of the energy that lie in `LOADING_BAND` and `VIBRATION_BAND` [1]."""

    loading: float
    vibration: float


def compute_loading_and_vibration_shares(
    time: Array, force: Array, approach: Approach, after: Aftermath, peak: Peak
) -> BandShares:
    """Compute the shares of loading and vibration; `time` [s] and `force` [N] have shape (n,)."""
    rate = (time.size - 1) / (time[-1] - time[0])
    clean = force - approach.compute_hum(time)
    end_of_ring = after.start + _RING_TIMES * after.decay_time.value
    begin_of_ring = max(after.start, peak.time)
    onset, release = np.searchsorted(time, (approach.onset, peak.time))
    begin, end = np.searchsorted(time, (begin_of_ring, end_of_ring))
    loading = clean[onset:release] - approach.sliding_force
    vibration = clean[begin:end] - after.level.value
    return BandShares(
        compute_energy_share_in_band(loading, rate, LOADING_BAND),
        compute_energy_share_in_band(vibration, rate, VIBRATION_BAND),
    )


def compute_energy_share_in_band(values: Array, rate: float, band: tuple[float, float]) -> float:
    """Return the share of the energy of a transient that lies in a band, by Parseval's theorem.

    Figures 4 and 5 of the paper show it.

    Parameters
    ----------
    values : Array
        Shape (n,), samples of the transient.
    rate : float
        Of its samples [Hz].
    band : tuple of float
        Lowest frequency, and the first above the band [Hz].
    """
    # no window: a transient ends by itself, and a window would move energy from the release into
    # the band
    from scipy.signal import periodogram

    if values.size < 2 or not np.any(values):
        return float("nan")
    lowest, highest = band
    four_times_as_long = 1 << (4 * values.size - 1).bit_length()
    one_second = 1 << int(np.ceil(np.log2(rate)))
    size = max(four_times_as_long, one_second)
    frequency, density = periodogram(
        values, fs=rate, window="boxcar", detrend=False, nfft=size, scaling="density"
    )
    in_band = (frequency >= lowest) & (frequency < highest)
    return float(density[in_band].sum() / density.sum())
