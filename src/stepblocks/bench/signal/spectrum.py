"""Where in the spectrum the energy of a piece of a record lies, as in figures 4 and 5 of the paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LOADING_BAND = (0.0, 100.0)  # Band in which the paper finds more than 64 % of the energy of loading [Hz]

VIBRATION_BAND = (250.0, 350.0)  # Band in which the paper finds about 86 % of the energy of the vibration [Hz]


def band_share(values: NDArray[np.float64], rate: float, band: tuple[float, float]) -> float:
    """Share of the energy of a transient that lies in a band.

    The energy spectrum of the zero-padded transient is integrated (Parseval). No window: a transient ends by itself,
    and a window would move energy from the release into the band.

    Examples
    --------
    >>> t = np.arange(4000) / 10e3
    >>> ring = np.exp(-t / 0.05) * np.cos(2 * np.pi * 300.0 * t)
    >>> round(band_share(ring, 10e3, (250.0, 350.0)), 2)
    0.96
    """
    from scipy.signal import periodogram

    if values.size < 2 or not np.any(values):
        return float("nan")
    size = max(1 << (4 * values.size - 1).bit_length(), 1 << int(np.ceil(np.log2(rate))))
    frequency, density = periodogram(values, fs=rate, window="boxcar", detrend=False, nfft=size, scaling="density")
    inside = (frequency >= band[0]) & (frequency < band[1])
    return float(density[inside].sum() / density.sum())
