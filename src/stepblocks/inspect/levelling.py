"""Levelling: least squares without spikes, and two planes beside an edge."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    Array,
    Estimate,
    Mask,
    estimate_robust_scale,
    find_outliers,
    make_linear_estimate,
)

LEAST_FACE = 20  # points of a face or shoulder that is fitted
LEVELS = {"line": 1, "parabola": 2, "cubic": 3}
DEGREES = tuple(LEVELS.values())  # of a polynomial that a profile is levelled by
_UNEVEN = 0.01  # spread of the steps of a profile over their mean, at most [1]
_STARTS = 5  # of a fit, each nearer to the least sum of distances
_MOST_FITS = 5  # of a fit, each without the spikes of the one before


def refuse_unusable_profile(x: Array, z: Array, least_count: int) -> None:
    """Refuse a profile with fewer than `least_count` measured points, or without equal steps."""
    count = int(np.isfinite(z).sum())
    if count < least_count:
        raise MetrologyError(
            f"profile must have at least {least_count} measured points, got {count}"
        )
    steps = np.diff(x)
    if not ((steps > 0.0).all() and np.ptp(steps) < _UNEVEN * np.mean(steps)):
        raise MetrologyError("positions of the profile must increase in equal steps within 1 %")


def filter_by_running_median(heights: Array) -> Array:
    """Return heights as their running median over five points, which keeps edges; NaN stays."""
    calm = np.array(heights, dtype=np.float64)
    known = np.isfinite(heights)
    calm[known] = median_filter(calm[known], size=5, mode="nearest")
    return calm


def solve_for_weights_and_coefficients(design: Array, z: Array, used: Mask) -> tuple[Array, Array]:
    """Return the weights of the points in a least-squares fit over those used, and its solution."""
    try:
        inverse = np.linalg.inv(design[:, used] @ design[:, used].T)
    except np.linalg.LinAlgError as error:
        raise MetrologyError(
            f"points must determine what is fitted to them, got {int(used.sum())} of one face"
        ) from error
    weights = np.where(used, inverse @ design, 0.0)
    return weights, weights[:, used] @ z[used]


@dataclass(frozen=True)
class Fit:
    """Least squares over the points that are no spikes."""

    design: Array  # shape (k, n)
    weights: Array  # shape (k, n); with which each point counts in the solution
    solution: Array  # shape (k,)
    residuals: Array  # shape (n,); m
    used: Mask  # shape (n,); points that took part
    rejected: int  # points left out as spikes

    def estimate_term(self, index: int, factor: float = 1.0) -> Estimate:
        """Return the term of an index of the solution, times a factor, with its uncertainty."""
        return make_linear_estimate(
            factor * float(self.solution[index]),
            factor * self.weights[index],
            self.residuals,
            self.used,
            self.design,
        )


def fit_without_spikes(design: Array, z: Array, used: Mask) -> Fit:
    """Fit the rows of `design`, shape (k, n), to the heights [m] of the points that are no spikes.

    `used` are the points that are asked for.
    """
    residuals = _compute_robust_residuals(design, z, used)
    kept = used & ~find_outliers(residuals, used)
    for _ in range(_MOST_FITS):
        weights, solution = solve_for_weights_and_coefficients(design, z, kept)
        residuals = z - solution @ design
        spikes = find_outliers(residuals, kept)
        if not spikes.any():
            break
        kept = kept & ~spikes
    return Fit(design, weights, solution, residuals, kept, int(used.sum()) - int(kept.sum()))


def _compute_robust_residuals(design: Array, z: Array, used: Mask) -> Array:
    """Return residuals of a fit by distances instead of squares, shape (n,) [m].

    So neither spikes nor stray points pull at it: far points are weighted by one over their
    distance.
    """
    root = np.ones(len(z))
    for _ in range(_STARTS):
        _, solution = solve_for_weights_and_coefficients(design * root, z * root, used)
        residuals = z - solution @ design
        scale = max(estimate_robust_scale(residuals[used]), LEAST_SCATTER)
        root = np.maximum(np.abs(residuals) / scale, 1.0) ** -0.5
    return residuals


@dataclass(frozen=True)
class TwoPlanes:
    """Two parallel faces, the one behind the middle of a profile higher by a step."""

    tilt: float  # common slope [1]
    offset: float  # height of the first face at position 0 [m]
    height: Estimate  # m
    fit: Fit  # of slope, offset at the middle, and height


def fit_two_planes(x: Array, z: Array, middle: float, used: Mask) -> TwoPlanes:
    """Fit ``z = a (x - middle) + b + h s(x)``, s = 0 before and 1 after the middle, without spikes.

    ISO 5436-1 leaves a single edge to convention; this is the two-plane one, which has no feature
    to level through.
    """
    scale = float(max(abs(x[0] - middle), abs(x[-1] - middle)))
    design = np.stack([(x - middle) / scale, np.ones_like(x), (x > middle).astype(float)])
    fit = fit_without_spikes(design, z, used)
    height = fit.estimate_term(2)
    tilt = float(fit.solution[0]) / scale
    offset = float(fit.solution[1]) - tilt * middle
    # of the slope per metre, where the design counts positions from -1 to 1
    weights = fit.weights.copy()
    weights[0] /= scale
    return TwoPlanes(tilt, offset, height, replace(fit, weights=weights))
