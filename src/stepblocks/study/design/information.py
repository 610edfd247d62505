"""What trials at each height tell about a threshold, a JND or an exponent: Fisher information."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.special import expit, ndtr

from stepblocks.contact import Array
from stepblocks.study.analysis.psychometric import MAX_LAPSE, Z75
from stepblocks.study.design.adaptive import Prior

# places of the parameters of a curve and of a line
MIDDLE, LOG_SPREAD, _LAPSE = 0, 1, 2
SLOPE = 1

_QUARTILE_OF_LOGISTIC = math.log(3.0)
# nodes and weights of the rule of Gauss and Hermite for a mean over a standard normal
_NODES = np.array([-math.sqrt(3.0), 0.0, math.sqrt(3.0)])
_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
# A fit keeps the lapse rate from 0 to `MAX_LAPSE`, which counts as what a uniform distribution says
_LAPSE_DEVIATION = MAX_LAPSE / math.sqrt(12.0)
_CERTAIN = 1e-12  # distance of a probability from 0 and 1
# of every parameter, of which nothing is known: keeps a matrix invertible, and tells nothing
_UNKNOWN = 1e-10


class CurveShape(StrEnum):
    """How a psychometric function rises with the logarithm of the height."""

    NORMAL = "normal"
    LOGISTIC = "logistic"

    @property
    def quartile_distance(self) -> float:
        """Distance from the middle to three quarters of the rise, in spreads [1]."""
        if self is CurveShape.NORMAL:
            return Z75
        return _QUARTILE_OF_LOGISTIC

    def compute_rise_and_slope(self, distance: Array) -> tuple[Array, Array]:
        """Return the share of the rise and its slope at distances from the middle in spreads."""
        if self is CurveShape.NORMAL:
            density = np.exp(-0.5 * distance**2) / math.sqrt(2.0 * math.pi)
            return np.asarray(ndtr(distance)), density
        rise = np.asarray(expit(distance))
        return rise, rise * (1.0 - rise)


@dataclass(frozen=True)
class Sensitivity:
    """How the answer to a trial at each height depends on the parameters.

    Attributes
    ----------
    slopes : ndarray, shape (values, heights, parameters)
        Derivatives of the expected answer by the parameters over the standard deviation of the
        answer, for each set of expected values. The information of a trial is their outer product.
    weights : ndarray, shape (values,)
        Of the sets of expected values; their sum is 1.
    known : ndarray, shape (parameters, parameters)
        Information before the first trial.
    """

    slopes: Array
    weights: Array
    known: Array

    def compute_information(self, trials: Array) -> Array:
        """Return the information of trials at each height, shape (values, parameters, parameters).

        `trials` has shape (heights,).
        """
        used = np.flatnonzero(trials)
        slopes = self.slopes[:, used]
        weighted = trials[used, np.newaxis] * slopes
        return np.asarray(np.swapaxes(slopes, 1, 2) @ weighted + self.known)


def compute_line_sensitivity(heights: Array, noise: float) -> Sensitivity:
    """Compute how magnitudes depend on constant and exponent of a power law.

    Parameters
    ----------
    heights : ndarray, shape (heights,)
        Of the blocks [m].
    noise : float
        Standard deviation of the natural logarithm of a magnitude around the law [1].
    """
    logs = np.log(heights)
    # relative to the middle of the range, which changes the constant but not the exponent
    centred = logs - 0.5 * (logs.min() + logs.max())
    slopes = np.column_stack([np.ones_like(centred), centred]) / noise
    return Sensitivity(slopes[np.newaxis], np.ones(1), _UNKNOWN * np.eye(2))


def compute_curve_sensitivity(
    heights: Array, standard: float, prior: Prior, lapse: float, shape: CurveShape
) -> Sensitivity:
    """Compute how comparisons depend on threshold, spread and lapse rate.

    Parameters
    ----------
    heights : ndarray, shape (heights,)
        Of the blocks [m].
    standard : float
        Height of the block that all are compared with [m].
    prior : Prior
        Expected threshold over standard, expected Weber fraction, and how well both are known.
    lapse : float
        Expected rate of errors at either end [1]; where it is 0, no lapse rate is estimated.
    shape : CurveShape
        Of the psychometric function.
    """
    slopes = []
    weights = []
    for node, weight in _list_quadrature_nodes_and_weights(prior.equal_factor):
        middle = math.log(standard * prior.equal) + node * math.log(prior.equal_factor)
        for spread_node, spread_weight in _list_quadrature_nodes_and_weights(prior.weber_factor):
            log_spread = compute_log_spread(prior.weber, shape)
            log_spread += spread_node * math.log(prior.weber_factor)
            slopes.append(_compute_scaled_slopes(np.log(heights), middle, log_spread, lapse, shape))
            weights.append(weight * spread_weight)
    known = [_UNKNOWN, _UNKNOWN]
    if lapse > 0.0:
        known.append(_LAPSE_DEVIATION**-2)
    return Sensitivity(np.array(slopes), np.array(weights), np.diag(known))


def compute_log_spread(weber_fraction: float, shape: CurveShape) -> float:
    """Return ln(spread) of a curve with a Weber fraction [1]."""
    return math.log(math.log1p(weber_fraction) / shape.quartile_distance)


def _list_quadrature_nodes_and_weights(factor_per_std: float) -> list[tuple[float, float]]:
    """List quadrature nodes, in standard deviations, with weights; one if a value is certain.

    `factor_per_std` is that by which one standard deviation changes the value [1].
    """
    if factor_per_std == 1.0:
        return [(0.0, 1.0)]
    return list(zip(_NODES.tolist(), _WEIGHTS.tolist(), strict=True))


def _compute_scaled_slopes(
    log_heights: Array, middle: float, log_spread: float, lapse: float, shape: CurveShape
) -> Array:
    """Return slopes of a curve by its parameters, each over the standard deviation of an answer.

    Shape (heights, parameters).
    """
    spread = math.exp(log_spread)
    distance = (log_heights - middle) / spread
    rise, density = shape.compute_rise_and_slope(distance)
    span = 1.0 - 2.0 * lapse
    p = np.clip(lapse + span * rise, _CERTAIN, 1.0 - _CERTAIN)
    slopes = [-span * density / spread, -span * density * distance]
    if lapse > 0.0:
        slopes.append(1.0 - 2.0 * rise)
    return np.column_stack(slopes) / np.sqrt(p * (1.0 - p))[:, np.newaxis]
