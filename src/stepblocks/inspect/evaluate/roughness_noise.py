"""What the residuals of a levelled profile say about its noise: scatter, and how far neighbours move together.

Machined faces carry roughness that is correlated over micrometres, so 4,000 points are not 4,000 observations. Each
uncertainty of this room is propagated through the autocovariance estimated here, not divided by the root of n.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matmul_toeplitz

Array = NDArray[np.float64]

# Scatter that counts as none [m]: a hundredth of an atom. Below it lies the rounding of a processor, not a surface
LEAST_SCATTER = 1e-12
# Standard deviation of a normal law over its median absolute deviation, 1 / Phi^-1(3/4)
_GAUSS_PER_MAD = 1.482602218505602


def robust_scale(residuals: Array) -> float:
    """Return the standard deviation of the bulk of `residuals`, from their median absolute deviation [same unit]."""
    return float(_GAUSS_PER_MAD * np.median(np.abs(residuals - np.median(residuals))))


def outlier_mask(residuals: Array, limit: float = 5.0) -> NDArray[np.bool_]:
    """Return true for spikes: residuals [m] further than `limit` robust deviations from the median; none without scatter."""
    scale = robust_scale(residuals)
    if scale <= LEAST_SCATTER:
        return np.zeros(residuals.shape, dtype=bool)
    return np.abs(residuals - np.median(residuals)) > limit * scale


def autocovariance(pieces: Sequence[Array], parameters: int = 3) -> Array:
    """Autocovariance of residuals that come in pieces, tapered so that it is a valid covariance.

    The sum over pairs is divided by the number of points at every lag, which keeps it positive semidefinite, as does
    the product with Parzen's window. The window is four times as wide as the lag at which the correlation drowns.
    """
    count = sum(int(np.isfinite(piece).sum()) for piece in pieces)
    longest = max(len(piece) for piece in pieces)
    total = np.zeros(longest)
    for piece in pieces:
        filled = np.where(np.isfinite(piece), piece, 0.0)
        size = 2 ** int(np.ceil(np.log2(2 * len(filled))))
        spectrum = np.fft.rfft(filled, size)
        total[: len(filled)] += np.fft.irfft(np.abs(spectrum) ** 2, size)[: len(filled)]
    gamma = total / max(count - parameters, 1)
    if gamma[0] <= LEAST_SCATTER**2:
        return np.zeros(1)
    drowned = np.flatnonzero(gamma < 2.0 / np.sqrt(count) * gamma[0])
    first = int(drowned[0]) if drowned.size else longest // 4
    width = int(np.clip(4 * first, 4, max(longest // 2, 4)))
    lag = np.arange(min(width, longest)) / width
    taper = np.where(lag <= 0.5, 1.0 - 6.0 * lag**2 * (1.0 - lag), 2.0 * (1.0 - lag) ** 3)
    gamma = gamma[: len(taper)] * taper
    # each fitted parameter swallows not one point but one correlation length of them
    together = max(1.0, float(2.0 * gamma.sum() / gamma[0] - 1.0))
    lost = min(parameters * together, 0.5 * count)
    return np.asarray(gamma * (max(count - parameters, 1) / (count - lost)))


def estimator_covariance(weights: Array, gamma: Array) -> Array:
    """Covariance of linear estimates ``weights @ z`` for noise of autocovariance `gamma`."""
    column = np.zeros(weights.shape[1])
    used = min(len(gamma), len(column))
    column[:used] = gamma[:used]
    return np.asarray(weights @ matmul_toeplitz(column, weights.T))
