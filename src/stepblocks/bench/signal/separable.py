"""Least squares by variable projection (Golub and Pereyra 1973, doi:10.1137/0710036).

The covariance of all parameters comes with the fit.

A trace is a sum of known shapes whose weights enter linearly; only two or three times and
frequencies are searched.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from stepblocks.bench.signal import Array, Tool

_CLEAR = 12.0  # chi squared of one to three columns that noise alone hardly gives
# of the largest direction: what the data cannot tell apart, far above the rounding of the columns
_UNSEEN = 1e-7
_STEP = 1e-6  # of differences, in units of the scale of a shape
_LOWEST = 80.0  # [Hz] below lie hum and its first harmonic
_FEWEST_CORRELATED = 16  # residuals, fewer show no correlation
_CORRELATION_OF_NOISE = 2.5  # that noise alone can give, times the root of the number of residuals
_RANK_OF_SEARCH = 1e-12  # singular values of columns below this share count as zero
_DECAYS = (5e-3, 12e-3, 25e-3, 60e-3)  # [s] first guesses of the decay time


@dataclass(frozen=True)
class SeparableFit:
    """What a separable fit found.

    Attributes
    ----------
    shape : Array
        Shape (q,), parameters that enter nonlinearly.
    weights : Array
        Shape (p,), of the columns of the basis.
    covariance : Array
        Shape (q + p, q + p), of `shape` and `weights`, scaled by the scatter of the residuals.
    residuals : Array
        Shape (n,), data minus model.
    jacobian : Array
        Shape (n, q + p), slopes in `shape` and columns of the basis.
    """

    shape: Array
    weights: Array
    covariance: Array
    residuals: Array
    jacobian: Array

    def get_std(self, index: int) -> float:
        """Return the standard uncertainty of one of `shape` and `weights`, counted on."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))

    def would_gain_from(self, columns: Array) -> bool:
        """Whether further columns would clearly explain more: one Gauss-Newton step."""
        extended = np.column_stack([self.jacobian, columns])
        weights, covariance = fit_with_covariance(extended, self.residuals)
        added = slice(-columns.shape[1], None)
        precision = np.linalg.pinv(covariance[added, added], hermitian=True)
        chi_squared = weights[added] @ precision @ weights[added]
        return bool(chi_squared > _CLEAR)


def fit_separable(
    build_basis: Callable[[Array], Array],
    values: Array,
    start: Array,
    lower: Array,
    upper: Array,
    scale: Array,
    *,
    differentiate_model: Callable[[Array, Array, Array], Array] | None = None,
) -> SeparableFit:
    """Fit ``values = basis(shape) @ weights``.

    Parameters
    ----------
    build_basis : callable
        From a shape (q,) to columns (n, p).
    values : Array
        Shape (n,).
    start, lower, upper : Array
        Shape (q,), where the search for a shape begins and its bounds.
    scale : Array
        Shape (q,), steps in which the shape moves.
    differentiate_model : callable, optional
        From a shape (q,), its columns (n, p) and weights (p,), which stay, to the slopes (n, q) of
        their product in the shape; found by differences where omitted.
    """
    from scipy.optimize import least_squares

    @lru_cache(maxsize=1)
    def solve_for_weights(shape: bytes) -> _LinearFit:
        """Solve for the weights of a shape, given as bytes; the last solution is kept."""
        columns = build_basis(np.frombuffer(shape))
        weights, residuals = fit_linear(columns, values, rcond=_RANK_OF_SEARCH)
        return _LinearFit(columns, weights, residuals)

    def compute_residuals(shape: Array) -> Array:
        return solve_for_weights(shape.tobytes()).residuals

    def differentiate_residuals(shape: Array) -> Array:
        # the columns as a shape moves them, less what their own weights take up at once
        # (Kaufman 1975, doi:10.1007/bf01932995)
        fit = solve_for_weights(shape.tobytes())
        if differentiate_model is not None:
            moved = differentiate_model(shape, fit.columns, fit.weights)
        else:
            moved = _differentiate_in_shape(build_basis, shape, fit, scale, upper)
        _, remainder = fit_linear(fit.columns, moved, rcond=_RANK_OF_SEARCH)
        return -remainder

    search = least_squares(
        compute_residuals,
        np.clip(start, lower, upper),
        jac=differentiate_residuals,
        bounds=(lower, upper),
        x_scale=scale,
        xtol=1e-9,
        ftol=1e-9,
        max_nfev=60,
    )
    shape = search.x
    fit = solve_for_weights(shape.tobytes())

    def compute_model(shape: Array) -> Array:
        return np.asarray(build_basis(shape) @ fit.weights, dtype=float)

    if differentiate_model is not None:
        of_shape = differentiate_model(shape, fit.columns, fit.weights)
    else:
        of_shape = compute_numeric_jacobian(compute_model, shape, scale * 1e-4, lower, upper)
    jacobian = np.column_stack([of_shape, fit.columns])
    covariance = estimate_covariance(jacobian, fit.residuals)
    return SeparableFit(shape, fit.weights, covariance, fit.residuals, jacobian)


class _LinearFit(NamedTuple):
    """Columns (n, p), their weights (p,), and what they leave of the values (n,)."""

    columns: Array
    weights: Array
    residuals: Array


def _differentiate_in_shape(
    build_basis: Callable[[Array], Array], shape: Array, fit: _LinearFit, scale: Array, upper: Array
) -> Array:
    """Find the slopes of a fit in its shape by one difference each, which stays below `upper`."""
    would_leave = shape + _STEP * scale > upper
    step = np.where(would_leave, -_STEP, _STEP) * scale
    changes = []
    for move in np.diag(step):
        change_of_columns = build_basis(shape + move) - fit.columns
        changes.append(change_of_columns @ fit.weights)
    return np.stack(changes, axis=1) / step


def fit_linear(columns: Array, values: Array, rcond: float | None = None) -> tuple[Array, Array]:
    """Return weights and residuals of ``values = columns @ weights``.

    Singular values below `rcond` times the largest count as zero.
    """
    weights, *_ = np.linalg.lstsq(columns, values, rcond=rcond)
    residuals = values - columns @ weights
    return np.asarray(weights, dtype=float), np.asarray(residuals, dtype=float)


def compute_residual_sum_of_squares(columns: Array, values: Array) -> float:
    """Return the sum of squares that columns leave of values."""
    _, residuals = fit_linear(columns, values)
    return float(residuals @ residuals)


def fit_with_covariance(columns: Array, values: Array) -> tuple[Array, Array]:
    """Return weights of ``values = columns @ weights`` and their covariance."""
    weights, residuals = fit_linear(columns, values)
    return weights, estimate_covariance(columns, residuals)


def build_damped_wave_columns(time: Array, frequency: float, decay_time: float) -> Array:
    """Columns of a cosine and a sine that die away."""
    decay = np.exp(-time / decay_time)[:, None]
    wave = build_wave_columns(time, frequency)
    return np.asarray(decay * wave, dtype=float)


def differentiate_damped_wave(
    time: Array, decay_time: float, columns: Array, weights: Array
) -> tuple[Array, Array]:
    """Find the slopes of a damped wave in its frequency and in its decay time, shapes (n,).

    `columns` are those of `build_damped_wave_columns`, `weights` (2,) those of the wave.
    """
    cosine, sine = weights
    quadrature = columns @ np.array([sine, -cosine])
    of_frequency = 2.0 * np.pi * time * quadrature
    of_decay_time = time / decay_time**2 * (columns @ weights)
    return of_frequency, of_decay_time


def build_wave_columns(time: Array, frequency: float) -> Array:
    """Columns of a cosine and a sine."""
    phase = 2.0 * np.pi * frequency * time
    return np.stack([np.cos(phase), np.sin(phase)]).T


def guess_ring_frequency_and_decay(time: Array, signal: Array) -> Tool:
    """Guess frequency [Hz] and decay time [s] of the strongest ring in `signal`."""
    since = time - time[0]
    frequency = _find_strongest_spectral_line(time, signal)

    def compute_rest_of_ring(decay_time: float) -> float:
        ring = build_damped_wave_columns(since, frequency, decay_time)
        return compute_residual_sum_of_squares(np.column_stack([np.ones_like(since), ring]), signal)

    return Tool(frequency, min(_DECAYS, key=compute_rest_of_ring))


def _find_strongest_spectral_line(time: Array, signal: Array) -> float:
    """Return the frequency of the highest line of the spectrum above hum [Hz]."""
    count = signal.size
    rate = (count - 1) / (time[-1] - time[0])
    size = 1 << (4 * count - 1).bit_length()
    falling_window = np.hanning(2 * count)[count:]
    windowed = (signal - signal.mean()) * falling_window
    spectrum = np.abs(np.fft.rfft(windowed, size))
    frequencies = np.fft.rfftfreq(size, 1.0 / rate)
    spectrum[frequencies < _LOWEST] = 0.0
    return float(frequencies[int(np.argmax(spectrum))])


def compute_numeric_jacobian(
    model: Callable[[Array], Array],
    point: Array,
    step: Array,
    lower: Array | float = -math.inf,
    upper: Array | float = math.inf,
) -> Array:
    """Differentiate `model` by differences that stay inside the bounds; shape (n, q)."""
    highest = np.minimum(point + step, upper)
    lowest = np.maximum(point - step, lower)
    columns = []
    for index in range(point.size):
        above = np.array(point, dtype=float)
        below = np.array(point, dtype=float)
        above[index] = highest[index]
        below[index] = lowest[index]
        change = model(above) - model(below)
        width = highest[index] - lowest[index]
        columns.append(change / width)
    return np.column_stack(columns)


def estimate_covariance(
    jacobian: Array, residuals: Array, prior_rows: Array | None = None
) -> Array:
    """Estimate the covariance of the parameters, widened by the autocorrelation of the residuals.

    Correlated residuals say less than their number.

    Parameters
    ----------
    jacobian : Array
        Shape (n, q), of the model.
    residuals : Array
        Shape (n,).
    prior_rows : Array, optional
        Shape (m, q), in the unit of the data per parameter: further exact measurements.

    Returns
    -------
    Array
        Shape (q, q).
    """
    count, parameters = jacobian.shape
    noise = float(np.sqrt(residuals @ residuals / max(count - parameters, 1)))
    if prior_rows is not None:
        jacobian = np.vstack([jacobian, prior_rows])
    size = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
    size[size == 0.0] = 1.0
    # from the rows, not from their squares: those lose half the digits, and with them the rank
    root = np.linalg.pinv(jacobian / size, rcond=_UNSEEN)
    inverse = root @ root.T
    covariance = inverse / np.outer(size, size) * noise**2
    return np.asarray(covariance * compute_correlation_inflation(residuals), dtype=float)


def compute_correlation_inflation(residuals: Array) -> float:
    """Return the factor by which correlation between neighbours widens a variance.

    ``1 + 2 sum rho_k``, up to what noise can give.
    """
    count = residuals.size
    power = float(residuals @ residuals)
    if count < _FEWEST_CORRELATED or power == 0.0:
        return 1.0
    limit = _CORRELATION_OF_NOISE / np.sqrt(count)
    total = 0.0
    for lag in range(1, count // 4):
        rho = float(residuals[:-lag] @ residuals[lag:]) / power
        if rho < limit:
            break
        total += rho
    return 1.0 + 2.0 * total


def propagate_std(gradient: Array, covariance: Array) -> float:
    """Return the standard uncertainty of a quantity by its gradient.

    The gradient is taken in the parameters of a covariance.
    """
    variance = float(gradient @ covariance @ gradient)
    if variance > 0.0:
        return math.sqrt(variance)
    return 0.0


def compute_chi_squared_excess(
    residuals: Array, parameter_count: int, first_samples: int, noise: float
) -> float:
    """Return by how many standard errors a fit misses its noise.

    It is that of the whole or of its beginning, whichever is worse.

    Parameters
    ----------
    residuals : Array
        Shape (n,).
    parameter_count : int
        Number of fitted values.
    first_samples : int
        Number of samples of the beginning.
    noise : float
        Standard deviation, in the unit of the residuals.
    """
    # a fit of a ring that is wrong is wrong where the ring is largest; over the whole record that
    # goes under
    if noise <= 0.0:
        return math.inf
    whole = _compute_partial_chi_squared_excess(residuals, parameter_count, noise)
    beginning = _compute_partial_chi_squared_excess(residuals[:first_samples], 0, noise)
    return max(whole, beginning)


def _compute_partial_chi_squared_excess(
    residuals: Array, parameter_count: int, noise: float
) -> float:
    """Return by how many of its standard errors the reduced chi squared exceeds one."""
    freedom = max(residuals.size - parameter_count, 1)
    reduced_chi_squared = float(residuals @ residuals) / freedom / noise**2
    return (reduced_chi_squared - 1.0) / math.sqrt(2.0 / freedom)
