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
# standard deviation of a normal law over its median absolute deviation
_GAUSS_PER_MAD = 1.482602218505602
SPIKE = 5.0  # robust standard deviations beyond which a point is a spike
_LEAST_SPAN = 1e-10  # of columns' products, as a share of the largest: below lies rounding
# by which a variance is raised for what the fit swallowed; beyond it, nothing is known
_MOST_RESTORED = 4.0
# least part of the low frequencies that a fit may leave [1]; with less, the correlation cannot be
# distinguished from the form
_LEAST_LEFT = 0.25
# smallest variance as a part of that of white noise of the same scatter: a truncated sum over lags
# may fall below zero
_LEAST_OF_WHITE = 0.25
_DROWNED = 2.0  # standard deviations of white noise below which a correlation is drowned
_WINDOWS = 4  # widths of the taper over the lag at which the correlation drowns
_MOST_LOST = 0.5  # of the points that the parameters of a fit may swallow [1]
_LEAST_SEEN = 0.1  # of the degrees of freedom that a fit leaves at least [1]
_QUIET = 5  # lags in a row that are indistinguishable from none, from which noise is uncorrelated


@dataclass(frozen=True)
class Estimate:
    """A value with what noise leaves open of it."""

    value: float
    std: float  # standard uncertainty, in the unit of the value
    # its effective degrees of freedom; infinite where the residuals are zero up to rounding
    dof: float = math.inf


def average_values(estimates: Sequence[Estimate]) -> float:
    """Return the mean of the values of estimates, in their unit."""
    return float(np.mean([estimate.value for estimate in estimates]))


def average_stds(estimates: Sequence[Estimate]) -> float:
    """Return the mean of the standard uncertainties of estimates, in their unit."""
    return float(np.mean([estimate.std for estimate in estimates]))


@dataclass(frozen=True)
class Refit:
    """An estimate by all points, and by fewer of them."""

    all_points: Estimate
    fewer: Estimate


def estimate_refit_std(refits: Sequence[Refit], noise_allowance: float) -> float:
    """Estimate a standard uncertainty from how much a mean changes by a refit, a rectangle.

    Only the change beyond `noise_allowance` times what noise alone changes counts.
    """
    if not refits:
        return 0.0
    # a fit through fewer of the same points differs by what its variance has grown
    growths, changes = [], []
    for refit in refits:
        growths.append(max(refit.fewer.std**2 - refit.all_points.std**2, 0.0))
        changes.append(refit.fewer.value - refit.all_points.value)
    noise = sum(growths) / len(refits) ** 2
    change = float(np.mean(changes))
    return float(np.sqrt(max(change**2 - noise_allowance**2 * noise, 0.0) / 3.0))


def estimate_robust_scale(residuals: Array) -> float:
    """Return the standard deviation of the bulk of `residuals` [same unit].

    It follows from their median absolute deviation.
    """
    return float(_GAUSS_PER_MAD * np.median(np.abs(residuals - np.median(residuals))))


def find_outliers(residuals: Array, used: Mask) -> Mask:
    """Find the points that are spikes.

    Residuals [m] beyond five robust deviations from the median of those used; none without scatter.
    """
    bulk = residuals[used]
    scale = estimate_robust_scale(bulk)
    spikes = np.zeros_like(used)
    if scale > LEAST_SCATTER:
        spikes[used] = np.abs(bulk - np.median(bulk)) > SPIKE * scale
    return spikes


def estimate_autocovariance(pieces: Sequence[Array], parameters: int = 3) -> Array:
    """Return the autocovariance of residuals that come in pieces.

    It is tapered, so that it is a valid covariance.

    Parameters
    ----------
    pieces : sequence of array
        Residuals in equal steps [m]; nan where a point is missing.
    parameters : int
        That were fitted.

    Returns
    -------
    array, shape (lags,)
        m^2.
    """
    # The sum over pairs is divided by the number of points at every lag, which keeps it positive
    # semidefinite, as does the product with Parzen's window. The window is four times as wide as
    # the lag at which the correlation drowns.
    count = sum(int(np.isfinite(piece).sum()) for piece in pieces)
    gamma = _sum_lagged_products(pieces) / max(count - parameters, 1)
    if gamma[0] <= LEAST_SCATTER**2:
        return np.zeros(1)
    longest = len(gamma)
    drowned = np.flatnonzero(gamma < _DROWNED / np.sqrt(count) * gamma[0])
    first = int(drowned[0]) if drowned.size else longest // 4
    width = int(np.clip(_WINDOWS * first, 4, max(longest // 2, 4)))
    lag = np.arange(min(width, longest)) / width
    parzen = np.where(lag <= 0.5, 1.0 - 6.0 * lag**2 * (1.0 - lag), 2.0 * (1.0 - lag) ** 3)
    gamma = gamma[: len(parzen)] * parzen
    # each fitted parameter swallows not one point but one correlation length of them
    together = max(1.0, float(2.0 * gamma.sum() / gamma[0] - 1.0))
    lost = min(parameters * together, _MOST_LOST * count)
    return np.asarray(gamma * (max(count - parameters, 1) / (count - lost)))


def _sum_lagged_products(pieces: Sequence[Array]) -> Array:
    """Return the sums of the products of pairs of residuals by their lag.

    Shape (longest piece,) [m^2]; a pair lies within one piece.
    """
    total = np.zeros(max(len(piece) for piece in pieces))
    for piece in pieces:
        filled = np.where(np.isfinite(piece), piece, 0.0)
        size = 2 ** int(np.ceil(np.log2(2 * len(filled))))
        spectrum = np.fft.rfft(filled, size)
        total[: len(filled)] += np.fft.irfft(np.abs(spectrum) ** 2, size)[: len(filled)]
    return total


def compute_estimator_covariance(weights: Array, gamma: Array) -> Array:
    """Compute the covariance of estimates ``weights @ z`` for noise of autocovariance `gamma`."""
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


def make_linear_estimate(
    value: float, weights: Array, residuals: Array, used: Mask, design: Array
) -> Estimate:
    """Return `value`, which is ``sum(weights * z)``, with its standard uncertainty.

    Parameters
    ----------
    value : float
        Estimate, in the unit of the result.
    weights, residuals : array
        Over a profile, shape (n,), or a map, shape (ny, nx): with which each height counts, and
        what the fit leaves of it [m].
    used : array of bool
        Points that were fitted.
    design : array, shape (k, ...)
        Columns of the fit.

    Returns
    -------
    Estimate
    """
    # With residuals ``r = M z``, M the projection of the fit, the estimate of the variance is a
    # quadratic form ``r Q r``; Q holds ``c(k) taper(k) / pairs(k)``. Its mean is ``tr(M Q M
    # Gamma)``, which gives the correction, and twice the square of its mean over its variance the
    # degrees of freedom (Satterthwaite 1946, Biometrics Bulletin 2:110, doi:10.2307/3002019), here
    # ``tr(Q Gamma)^2 / tr(Q Gamma Q Gamma)`` evaluated over frequencies. The taper is the flat top
    # of Politis and Romano (1995), its width by Politis (2003), J. Nonparametr. Stat. 15:375,
    # doi:10.1080/1048525031000157990.
    grid = _LagGrid(residuals.shape)
    noise = _estimate_noise_by_lag(grid, residuals, used)
    if noise.variance <= LEAST_SCATTER**2:
        return Estimate(value, 0.0)
    inside = used.astype(np.float64)
    count = float(inside.sum())
    correlation = grid.autocorrelate(np.where(used, weights, 0.0))
    white = float(correlation.flat[0] * noise.variance)
    tapered = correlation * noise.gamma * noise.taper
    variance = max(float(np.sum(tapered)), _LEAST_OF_WHITE * white)
    lifted = _restore_autocovariance(noise, len(design) / count)
    spectrum = np.maximum(grid.compute_spectrum(lifted * noise.taper).real, 0.0)
    pairs = noise.pairs
    quadratic = np.where(pairs > 0.0, correlation * noise.taper / np.maximum(pairs, 1.0), 0.0)
    form = grid.compute_spectrum(quadratic).real
    traces = _compute_quadratic_form_traces(grid, spectrum, form, pairs, inside, design)
    true_variance = float(np.sum(correlation * grid.invert_spectrum(spectrum)))
    restored = _compute_restoring_factor(true_variance, traces.after_fit)
    dof = _compute_variance_dof(grid, form * spectrum, count, traces)
    return Estimate(value, float(np.sqrt(variance * restored)), dof)


def _restore_autocovariance(noise: "_NoiseByLag", parameter_share: float) -> Array:
    """Return an autocovariance with what the fit has swallowed of it [m^2].

    Each column of the fit takes the mean power of one frequency, so every lag lies too low by the
    same amount; `parameter_share` is the number of columns over that of the points [1].
    """
    power = float(np.sum(noise.gamma * noise.taper))
    left = max(1.0 - parameter_share * float(noise.taper.sum()), _LEAST_LEFT)
    return np.asarray(noise.gamma + parameter_share * power / left)


def _compute_restoring_factor(true_variance: float, seen_variance: float) -> float:
    """Return the factor that restores what the fit removed of a variance [1]."""
    if seen_variance > 0.0:
        return min(max(true_variance / seen_variance, 1.0), _MOST_RESTORED)
    return _MOST_RESTORED


def _compute_variance_dof(
    grid: "_LagGrid", spectrum_product: Array, count: float, traces: "_Traces"
) -> float:
    """Return the degrees of freedom of a variance by Satterthwaite, 1 at least.

    `spectrum_product` is that of the spectra of the noise and of the quadratic form.
    """
    squares = grid.average_spectrum(spectrum_product**2)
    dof = float("inf")
    if squares > 0.0:
        dof = count * grid.average_spectrum(spectrum_product) ** 2 / squares
    left = _LEAST_SEEN
    if traces.before_fit > 0.0:
        left = max(traces.after_fit / traces.before_fit, _LEAST_SEEN)
    return max(dof * left, 1.0)


def _list_lags(size: int) -> NDArray[np.int_]:
    """List the lags of an autocorrelation of some length as FFT orders them, negative ones last."""
    lags: NDArray[np.int_] = np.rint(np.fft.fftfreq(size) * size).astype(int)
    return lags


def estimate_std_of_row_sums(weights: Iterable[Array], residuals: Array, used: Mask) -> Array:
    """Estimate the standard uncertainties of sums ``w . z`` over a map levelled row by row.

    Each of `weights` covers as many whole rows as it has, and holds what their lines take away.
    """
    noise = _estimate_noise_by_lag(_LagGrid(residuals.shape), residuals, used)
    # the two columns of its line take from each row the mean power of two frequencies along it
    share = 2.0 * len(residuals) / float(used.sum())
    power = (noise.gamma * noise.taper).sum(axis=1, keepdims=True)
    width = noise.taper.sum(axis=1, keepdims=True)
    lifted = noise.gamma + share * power / np.maximum(1.0 - share * width, _LEAST_LEFT)
    seen_variances = []
    true_variances = []
    for weight in weights:
        correlation = _LagGrid(weight.shape).autocorrelate(weight)
        shared = np.ix_(*map(_list_lags, correlation.shape))
        least = _LEAST_OF_WHITE * correlation.flat[0] * noise.variance
        seen = np.sum(correlation * (noise.gamma * noise.taper)[shared])
        true = np.sum(correlation * (lifted * noise.taper)[shared])
        seen_variances.append(max(seen, least))
        true_variances.append(max(true, least))
    # over all together: that of one sum scatters as much as it is
    seen_total = max(float(np.sum(seen_variances)), LEAST_SCATTER**2)
    ratio = float(np.sum(true_variances)) / seen_total
    restored = min(max(ratio, 1.0), _MOST_RESTORED)
    return np.asarray(np.sqrt(np.array(seen_variances) * restored))


class _LagGrid:
    """Fourier transforms over a grid that is padded so that lags do not wrap.

    They run over the last axes of what is stacked.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = tuple(fft.next_fast_len(2 * size, real=True) for size in shape)
        self._axes = tuple(range(-len(shape), 0))

    def compute_spectrum(self, values: Array) -> NDArray[np.complex128]:
        """Return the spectrum of values over the padded grid."""
        return np.asarray(fft.rfftn(values, self._shape, self._axes))

    def invert_spectrum(self, spectrum: Array | NDArray[np.complex128]) -> Array:
        """Return the values of a spectrum, over the padded grid."""
        return np.asarray(fft.irfftn(spectrum, self._shape, self._axes))

    def autocorrelate(self, values: Array) -> Array:
        """Return the sum of products of values by their lag."""
        return self.invert_spectrum(np.abs(self.compute_spectrum(values)) ** 2)

    def average_spectrum(self, spectrum: Array) -> float:
        """Return the mean over frequencies, which is the value at lag zero."""
        return float(self.invert_spectrum(spectrum).flat[0])


@dataclass(frozen=True)
class _NoiseByLag:
    """Noise of residuals by lag, arrays over the padded grid."""

    pairs: Array  # of points that were used
    gamma: Array  # autocovariance [m^2]
    taper: Array  # 1

    @property
    def variance(self) -> float:
        """Variance of the residuals [m^2]."""
        return float(self.gamma.flat[0])


def _estimate_noise_by_lag(grid: _LagGrid, residuals: Array, used: Mask) -> _NoiseByLag:
    """Estimate the noise from residuals [m] at the points that were used."""
    pairs = np.rint(grid.autocorrelate(used.astype(np.float64)))
    products = grid.autocorrelate(np.where(used, residuals, 0.0))
    gamma = np.where(pairs > 0.0, products / np.maximum(pairs, 1.0), 0.0)
    return _NoiseByLag(pairs, gamma, _compute_lag_taper(gamma, residuals.shape, float(used.sum())))


@dataclass(frozen=True)
class _Traces:
    """Expectations of a quadratic form of noise, times its variance [m^2]."""

    before_fit: float  # tr(Q Gamma)
    after_fit: float  # tr(M Q M Gamma), of what a fit leaves


def _compute_quadratic_form_traces(
    grid: _LagGrid, spectrum: Array, form: Array, pairs: Array, inside: Array, design: Array
) -> _Traces:
    """Compute the expectations of a quadratic form from the spectra of the noise and of the form.

    `inside` is 1 at points that were used, else 0. The projection has few columns, so no large
    matrix is ever formed.
    """
    trace = float(np.sum(grid.invert_spectrum(form) * pairs * grid.invert_spectrum(spectrum)))
    columns = design * inside
    turned = grid.compute_spectrum(columns)
    by_noise = _convolve_columns(grid, spectrum * turned, inside)
    by_form = _convolve_columns(grid, form * turned, inside)
    columns = columns.reshape(len(design), -1)
    # the projection is that of the columns' span: of columns that depend on each other where
    # outliers fell out, one counts
    size = np.sqrt(np.einsum("ij,ij->i", columns, columns))
    size = np.where(size > 0.0, size, 1.0)[:, np.newaxis]
    columns = columns / size
    by_noise = by_noise / size
    by_form = by_form / size
    inverse = np.linalg.pinv(columns @ columns.T, rcond=_LEAST_SPAN, hermitian=True)
    swallowed = 2.0 * np.trace(inverse @ (by_form @ by_noise.T))
    twice = np.trace(inverse @ (by_form @ columns.T) @ inverse @ (columns @ by_noise.T))
    return _Traces(trace, trace - float(swallowed) + float(twice))


def _convolve_columns(
    grid: _LagGrid, spectrum_product: NDArray[np.complex128], inside: Array
) -> Array:
    """Return columns convolved with what has a spectrum, shape (k, points).

    `spectrum_product` is that of both spectra; what the padding added is cut off.
    """
    convolved = grid.invert_spectrum(spectrum_product)
    without_padding = convolved[:, *map(slice, inside.shape)]
    return np.asarray((without_padding * inside).reshape(len(spectrum_product), -1))


def _compute_lag_taper(gamma: Array, shape: tuple[int, ...], count: float) -> Array:
    """Return a taper that is flat over the correlated lags of each axis [1].

    Beyond them it falls to zero at twice as far. `shape` is that of the residuals, of which `count`
    were used.
    """
    taper = np.ones(gamma.shape)
    limit = 2.0 * np.sqrt(np.log10(max(count, 10.0)) / count)
    variance = max(gamma.flat[0], LEAST_SCATTER**2)
    for axis, size in enumerate(shape):
        line: list[int | slice] = [0] * gamma.ndim
        line[axis] = slice(1, max(size // 3, 2))
        correlation = np.abs(gamma[tuple(line)]) / variance
        in_a_row = np.convolve(correlation < limit, np.ones(_QUIET))[_QUIET - 1 :]
        quiet = np.flatnonzero(in_a_row >= min(_QUIET, len(correlation)))
        correlated = int(quiet[0]) if quiet.size else len(correlation)
        flat = max(correlated, 1)
        lag = np.abs(np.fft.fftfreq(gamma.shape[axis]) * gamma.shape[axis])
        along = [1] * gamma.ndim
        along[axis] = -1
        taper = taper * np.clip(2.0 - lag / flat, 0.0, 1.0).reshape(along)
    return taper
