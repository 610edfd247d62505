"""Least squares by variable projection (Golub and Pereyra 1973, doi:10.1137/0710036).

The covariance of all parameters comes with the fit.

A trace is a sum of known shapes whose weights enter linearly; only two or three times and
frequencies are searched.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stepblocks.bench.signal import Array, Tool

_CLEAR = 12.0  # chi squared of one to three columns that noise alone hardly gives
# of the largest direction: what the data cannot tell apart, far above the rounding of the columns
_UNSEEN = 1e-7
_STEP = 1e-6  # of differences, in units of the scale of a shape
_LOWEST = 80.0  # [Hz] below lie hum and its first harmonic
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

    def std(self, index: int) -> float:
        """Return the standard uncertainty of one of `shape` and `weights`, counted on."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))

    def would_gain_from(self, columns: Array) -> bool:
        """Whether further columns would clearly explain more: one Gauss-Newton step."""
        weights, covariance = fit_with_covariance(
            np.column_stack([self.jacobian, columns]), self.residuals
        )
        own = slice(-columns.shape[1], None)
        return bool(
            weights[own] @ np.linalg.pinv(covariance[own, own], hermitian=True) @ weights[own]
            > _CLEAR
        )


def fit_separable(
    basis: Callable[[Array], Array],
    values: Array,
    start: Array,
    lower: Array,
    upper: Array,
    scale: Array,
) -> SeparableFit:
    """Fit ``values = basis(shape) @ weights``.

    The shape moves in steps of `scale` between its bounds.
    """
    from scipy.optimize import least_squares

    @lru_cache(maxsize=1)
    def solve(shape: bytes) -> tuple[Array, Array, Array]:
        columns = basis(np.frombuffer(shape))
        return columns, *fit_linear(columns, values, rcond=1e-12)

    def differentiate(shape: Array) -> Array:
        # the columns as a shape moves them, less what their own weights take up at once
        # (Kaufman 1975, doi:10.1007/bf01932995)
        columns, weights, _ = solve(shape.tobytes())
        step = np.where(shape + _STEP * scale > upper, -_STEP, _STEP) * scale
        moved = [(basis(shape + one) - columns) @ weights for one in np.diag(step)]
        return -fit_linear(columns, np.stack(moved, axis=1) / step, rcond=1e-12)[1]

    shape = least_squares(
        lambda p: solve(p.tobytes())[2],
        np.clip(start, lower, upper),
        jac=differentiate,
        bounds=(lower, upper),
        x_scale=scale,
        xtol=1e-9,
        ftol=1e-9,
        max_nfev=60,
    ).x
    columns, weights, residuals = solve(shape.tobytes())
    slopes = compute_numeric_jacobian(
        lambda p: basis(p) @ weights, shape, scale * 1e-4, lower, upper
    )
    jacobian = np.column_stack([slopes, columns])
    return SeparableFit(
        shape, weights, estimate_covariance(jacobian, residuals), residuals, jacobian
    )


def fit_linear(columns: Array, values: Array, rcond: float | None = None) -> tuple[Array, Array]:
    """Return weights and residuals of ``values = columns @ weights``."""
    weights = np.linalg.lstsq(columns, values, rcond=rcond)[0]
    return np.asarray(weights, dtype=float), np.asarray(values - columns @ weights, dtype=float)


def compute_rest(columns: Array, values: Array) -> float:
    """Return the sum of squares that columns leave of values."""
    residuals = fit_linear(columns, values)[1]
    return float(residuals @ residuals)


def fit_with_covariance(columns: Array, values: Array) -> tuple[Array, Array]:
    """Return weights of ``values = columns @ weights`` and their covariance."""
    weights, residuals = fit_linear(columns, values)
    return weights, estimate_covariance(columns, residuals)


def build_damped_wave_columns(time: Array, frequency: float, decay_time: float) -> Array:
    """Columns of a cosine and a sine that die away."""
    return np.asarray(
        np.exp(-time / decay_time)[:, None] * build_wave_columns(time, frequency), dtype=float
    )


def build_wave_columns(time: Array, frequency: float) -> Array:
    """Columns of a cosine and a sine."""
    phase = 2.0 * np.pi * frequency * time
    return np.column_stack([np.cos(phase), np.sin(phase)])


def guess_ring(time: Array, values: Array) -> Tool:
    """Frequency [Hz] and decay time [s] of the strongest ring in `values`, roughly."""
    count = values.size
    rate = (count - 1) / (time[-1] - time[0])
    size = 1 << (4 * count - 1).bit_length()
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(2 * count)[count:], size))
    frequencies = np.fft.rfftfreq(size, 1.0 / rate)
    spectrum[frequencies < _LOWEST] = 0.0
    frequency = float(frequencies[int(np.argmax(spectrum))])
    since = time - time[0]
    return frequency, min(
        _DECAYS,
        key=lambda decay: compute_rest(
            np.column_stack(
                [np.ones_like(since), build_damped_wave_columns(since, frequency, decay)]
            ),
            values,
        ),
    )


def compute_numeric_jacobian(
    model: Callable[[Array], Array],
    point: Array,
    step: Array,
    lower: Array | float = -math.inf,
    upper: Array | float = math.inf,
) -> Array:
    """Differentiate `model` by differences that stay inside the bounds; shape (n, q)."""
    highest, lowest = np.minimum(point + step, upper), np.maximum(point - step, lower)
    columns = [
        (model(np.where(own, highest, point)) - model(np.where(own, lowest, point)))
        / (highest - lowest)[own]
        for own in np.identity(point.size, dtype=np.bool_)
    ]
    return np.column_stack(columns)


def estimate_covariance(jacobian: Array, residuals: Array, known: Array | None = None) -> Array:
    """Covariance of the parameters, widened by the autocorrelation of the residuals.

    Correlated residuals say less than their number.
    """
    # Rows of `known`, in the unit of the data per parameter, count as further exact measurements.
    count, parameters = jacobian.shape
    noise = float(np.sqrt(residuals @ residuals / max(count - parameters, 1)))
    if known is not None:
        jacobian = np.vstack([jacobian, known])
    size = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
    size[size == 0.0] = 1.0
    # from the rows, not from their squares: those lose half the digits, and with them the rank
    root = np.linalg.pinv(jacobian / size, rcond=_UNSEEN)
    inverse = root @ root.T
    return np.asarray(
        inverse / np.outer(size, size) * noise**2 * compute_correlation_inflation(residuals),
        dtype=float,
    )


def compute_correlation_inflation(residuals: Array) -> float:
    """Factor by which correlation between neighbours widens a variance.

    ``1 + 2 sum rho_k``, up to what noise can give.
    """
    count = residuals.size
    power = float(residuals @ residuals)
    total = 0.0
    if count < 16 or power == 0.0:
        return 1.0
    limit = 2.5 / np.sqrt(count)
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
    return math.sqrt(variance) if variance > 0.0 else 0.0


def compute_misfit(residuals: Array, parameters: int, begin: int, noise: float) -> float:
    """Return by how many standard errors a fit misses its noise.

    It is that of the whole or of its beginning, whichever is worse.
    """
    # a fit of a ring that is wrong is wrong where the ring is largest; over the whole record that
    # goes under
    if noise <= 0.0:
        return math.inf

    def missed(part: Array, used: int) -> float:
        freedom = max(part.size - used, 1)
        return (float(part @ part) / freedom / noise**2 - 1.0) / math.sqrt(2.0 / freedom)

    return max(missed(residuals, parameters), missed(residuals[:begin], 0))
