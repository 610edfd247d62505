"""What the residuals of a fit say about its noise.

An estimate has its standard uncertainty from them.

Machined faces carry roughness that is correlated over micrometres, so 4,000 points are not 4,000
observations: each uncertainty of this room goes through the autocovariance of the residuals. A
height is a weighted sum ``w . z``; with stationary noise its variance is the sum over lags of
``c(k) gamma(k)``, c the autocorrelation of the weights and gamma the autocovariance of the noise.
Gamma is estimated from a few hundred residuals, so the variance carries degrees of freedom. Two
biases are taken out: the taper over lags is flat where the noise is correlated, and what the fit
has swallowed of the noise is put back by its expectation.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import matmul_toeplitz

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# scatter that counts as none [m]: a hundredth of an atom. Below it lies the rounding of a
# processor, not a surface
LEAST_SCATTER = 1e-12
_GAUSS_PER_MAD = (
    1.482602218505602  # standard deviation of a normal law over its median absolute deviation
)
SPIKE = 5.0  # robust standard deviations beyond which a point is a spike
_LEAST_SPAN = 1e-10  # of columns' products, as a share of the largest: below lies rounding
_MOST_RESTORED = (
    4.0  # by which a variance is raised for what the fit swallowed; beyond it, nothing is known
)
# least part of the low frequencies that a fit may leave [1]; with less, the correlation cannot be
# distinguished from the form
_LEAST_LEFT = 0.25
# smallest variance as a part of that of white noise of the same scatter: a truncated sum over lags
# may fall below zero
_LEAST_OF_WHITE = 0.25


@dataclass(frozen=True)
class Estimate:
    """A value with what noise leaves open of it."""

    value: float
    std: float  # standard uncertainty, in the unit of the value
    # its effective degrees of freedom; infinite where the residuals are zero up to rounding
    dof: float = math.inf


def compute_change(pairs: Sequence[tuple[Estimate, Estimate]], allowed: float) -> float:
    """Compute the standard uncertainty by what a mean changes between two fits, a rectangle.

    Only the change beyond `allowed` times what noise alone changes counts.
    """
    if not pairs:
        return 0.0
    # a fit through fewer of the same points differs by what its variance has grown
    grown = sum(max(other.std**2 - one.std**2, 0.0) for one, other in pairs) / len(pairs) ** 2
    change = float(np.mean([other.value - one.value for one, other in pairs]))
    return float(np.sqrt(max(change**2 - allowed**2 * grown, 0.0) / 3.0))


def estimate_robust_scale(residuals: Array) -> float:
    """Return the standard deviation of the bulk of `residuals` [same unit].

    It follows from their median absolute deviation.
    """
    return float(_GAUSS_PER_MAD * np.median(np.abs(residuals - np.median(residuals))))


def find_outliers(residuals: Array, used: Mask) -> Mask:
    """Return true for spikes.

    Residuals [m] beyond five robust deviations from the median of those used; none without scatter.
    """
    own = residuals[used]
    scale = estimate_robust_scale(own)
    spikes = np.zeros_like(used)
    if scale > LEAST_SCATTER:
        spikes[used] = np.abs(own - np.median(own)) > SPIKE * scale
    return spikes


def estimate_autocovariance(pieces: Sequence[Array], parameters: int = 3) -> Array:
    """Autocovariance of residuals that come in pieces, tapered so that it is a valid covariance."""
    # The sum over pairs is divided by the number of points at every lag, which keeps it positive
    # semidefinite, as does the product with Parzen's window. The window is four times as wide as
    # the lag at which the correlation drowns.
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


def compute_estimator_covariance(weights: Array, gamma: Array) -> Array:
    """Covariance of linear estimates ``weights @ z`` for noise of autocovariance `gamma`."""
    return np.asarray(
        weights @ matmul_toeplitz(pad_autocovariance(gamma, weights.shape[1]), weights.T)
    )


def pad_autocovariance(gamma: Array, count: int) -> Array:
    """Return an autocovariance over `count` lags, zero beyond those that are known."""
    return np.pad(gamma[:count], (0, max(count - len(gamma), 0)))


def factor_covariance(covariance: Array) -> Array:
    """Return rows whose products add up to a covariance.

    They come from its eigenvectors, because it may be singular.
    """
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))).T, dtype=np.float64)


def estimate_linear(
    value: float, weights: Array, residuals: Array, used: Mask, design: Array
) -> Estimate:
    """State the uncertainty of `value`, which is ``sum(weights * z)``.

    It follows from the residuals of the fit.
    """
    # With residuals ``r = M z``, M the projection of the fit, the estimate of the variance is a
    # quadratic form ``r Q r``; Q holds ``c(k) taper(k) / pairs(k)``. Its mean is ``tr(M Q M
    # Gamma)``, which gives the correction, and twice the square of its mean over its variance the
    # degrees of freedom (Satterthwaite 1946, Biometrics Bulletin 2:110, doi:10.2307/3002019), here
    # ``tr(Q Gamma)^2 / tr(Q Gamma Q Gamma)`` evaluated over frequencies. The taper is the flat top
    # of Politis and Romano (1995), its width by Politis (2003), J. Nonparametr. Stat. 15:375,
    # doi:10.1080/1048525031000157990.
    lags = _Lags(residuals.shape)
    inside = used.astype(np.float64)
    pairs, gamma, taper = _estimate_lags(lags, residuals, used)
    if gamma.flat[0] <= LEAST_SCATTER**2:
        return Estimate(value, 0.0)
    count = float(inside.sum())
    c = lags.autocorrelation(np.where(used, weights, 0.0))
    white = float(c.flat[0] * gamma.flat[0])
    variance = max(float(np.sum(c * gamma * taper)), _LEAST_OF_WHITE * white)
    # each column of the fit takes the mean power of one frequency: every lag lies too low by the
    # same amount
    share = len(design) / count
    lifted = gamma + share * float(np.sum(gamma * taper)) / max(
        1.0 - share * float(taper.sum()), _LEAST_LEFT
    )
    spectrum = np.maximum(lags.transform(lifted * taper).real, 0.0)
    form = lags.transform(np.where(pairs > 0.0, c * taper / np.maximum(pairs, 1.0), 0.0)).real
    trace, seen = _compute_expectations(lags, spectrum, form, pairs, inside, design)
    true = float(np.sum(c * lags.back(spectrum)))
    restored = min(max(true / seen, 1.0), _MOST_RESTORED) if seen > 0.0 else _MOST_RESTORED
    both = form * spectrum
    squares = lags.mean(both**2)
    dof = count * lags.mean(both) ** 2 / squares if squares > 0.0 else float("inf")
    lost = max(seen / trace, 0.1) if trace > 0.0 else 0.1
    return Estimate(value, float(np.sqrt(variance * restored)), max(dof * lost, 1.0))


def estimate_of_rows(weights: Iterable[Array], residuals: Array, used: Mask) -> Array:
    """State the standard uncertainties of sums ``w . z`` over a map levelled row by row.

    Each of `weights` covers as many whole rows as it has, and holds what their lines take away.
    """
    gamma, taper = _estimate_lags(_Lags(residuals.shape), residuals, used)[1:]
    # the two columns of its line take from each row the mean power of two frequencies along it
    share = 2.0 * len(residuals) / float(used.sum())
    power, width = (
        (one * taper).sum(axis=1, keepdims=True) for one in (gamma, np.ones_like(taper))
    )
    lifted = gamma + share * power / np.maximum(1.0 - share * width, _LEAST_LEFT)
    sums = []
    for own in weights:
        c = _Lags(own.shape).autocorrelation(own)
        at = np.ix_(*(np.rint(np.fft.fftfreq(size) * size).astype(int) for size in c.shape))
        white = _LEAST_OF_WHITE * c.flat[0] * gamma.flat[0]
        sums.append([max(np.sum(c * (one * taper)[at]), white) for one in (gamma, lifted)])
    seen, true = np.transpose(sums)
    # over all together: that of one sum scatters as much as it is
    restored = min(
        max(float(true.sum()) / max(float(seen.sum()), LEAST_SCATTER**2), 1.0), _MOST_RESTORED
    )
    return np.asarray(np.sqrt(seen * restored))


class _Lags:
    # Fourier transforms over a grid that is padded so that lags do not wrap; over the last axes of
    # what is stacked.
    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = tuple(fft.next_fast_len(2 * size, real=True) for size in shape)
        self._axes = tuple(range(-len(shape), 0))

    def transform(self, values: Array) -> NDArray[np.complex128]:
        return np.asarray(fft.rfftn(values, self._shape, self._axes))

    def back(self, spectrum: Array | NDArray[np.complex128]) -> Array:
        return np.asarray(fft.irfftn(spectrum, self._shape, self._axes))

    def autocorrelation(self, values: Array) -> Array:
        return self.back(np.abs(self.transform(values)) ** 2)

    def mean(self, spectrum: Array) -> float:
        # Mean over frequencies, which is the value at lag zero.
        return float(self.back(spectrum).flat[0])


def _estimate_lags(lags: _Lags, residuals: Array, used: Mask) -> tuple[Array, Array, Array]:
    # Pairs of used points at each lag, the autocovariance of their residuals, and its taper.
    pairs = np.rint(lags.autocorrelation(used.astype(np.float64)))
    products = lags.autocorrelation(np.where(used, residuals, 0.0))
    gamma = np.where(pairs > 0.0, products / np.maximum(pairs, 1.0), 0.0)
    return pairs, gamma, _compute_lag_taper(gamma, residuals.shape, float(used.sum()))


def _compute_expectations(
    lags: _Lags, spectrum: Array, form: Array, pairs: Array, inside: Array, design: Array
) -> tuple[float, float]:
    # Traces of Q Gamma and of M Q M Gamma; the projection has few columns, so no large matrix is
    # ever formed.
    trace = float(np.sum(lags.back(form) * pairs * lags.back(spectrum)))
    columns = design * inside
    turned = lags.transform(columns)
    # columns convolved with what has either spectrum, without what the padding added
    by_noise, by_form = (
        (lags.back(one * turned)[:, *map(slice, inside.shape)] * inside).reshape(len(design), -1)
        for one in (spectrum, form)
    )
    columns = columns.reshape(len(design), -1)
    # the projection is that of the columns' span: of columns that depend on each other where
    # outliers fell out, one counts
    size = np.sqrt(np.einsum("ij,ij->i", columns, columns))
    size = np.where(size > 0.0, size, 1.0)[:, np.newaxis]
    columns, by_noise, by_form = columns / size, by_noise / size, by_form / size
    inverse = np.linalg.pinv(columns @ columns.T, rcond=_LEAST_SPAN, hermitian=True)
    swallowed = 2.0 * np.trace(inverse @ (by_form @ by_noise.T))
    twice = np.trace(inverse @ (by_form @ columns.T) @ inverse @ (columns @ by_noise.T))
    return trace, trace - float(swallowed) + float(twice)


def _compute_lag_taper(gamma: Array, shape: tuple[int, ...], count: float) -> Array:
    # Flat top over the correlated lags of each axis, then linear to zero at twice as far.
    taper = np.ones(gamma.shape)
    limit = 2.0 * np.sqrt(np.log10(max(count, 10.0)) / count)
    for axis, size in enumerate(shape):
        line: list[int | slice] = [0] * gamma.ndim
        line[axis] = slice(1, max(size // 3, 2))
        correlation = np.abs(gamma[tuple(line)]) / max(gamma.flat[0], LEAST_SCATTER**2)
        # five in a row that are indistinguishable from none
        quiet = np.flatnonzero(
            np.convolve(correlation < limit, np.ones(5))[4:] >= min(5, len(correlation))
        )
        flat = max(int(quiet[0]) if quiet.size else len(correlation), 1)
        lag = np.abs(np.fft.fftfreq(gamma.shape[axis]) * gamma.shape[axis])
        along = [1] * gamma.ndim
        along[axis] = -1
        taper = taper * np.clip(2.0 - lag / flat, 0.0, 1.0).reshape(along)
    return taper
