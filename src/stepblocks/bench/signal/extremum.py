"""A bottom or a top of the force, measured by a quartic about it."""

from typing import NamedTuple

import numpy as np

from stepblocks.bench.signal import Array
from stepblocks.bench.signal.separable import fit_linear, propagate_std

_SCATTER = 2.4  # reduced chi squared of four degrees of freedom, 95 %
# an extremum less high than this many standard deviations has no place that noise would not choose
FAINT = 6.0


class Extremum(NamedTuple):
    """A bottom or a top of the force.

    Attributes
    ----------
    force : float
        [N].
    std : float
        Its standard uncertainty [N].
    instant : float
        [s].
    """

    force: float
    std: float
    instant: float


def find_extremum(
    time: Array, force: Array, index: int, half_width: float, noise: float
) -> Extremum:
    """Measure a bottom or top by a quartic about it.

    Parameters
    ----------
    time, force : Array
        Shape (n,), instants [s] and force [N].
    index : int
        Sample about which the quartic is fitted.
    half_width : float
        Time up to which samples on either side count [s].
    noise : float
        Standard deviation of a sample [N].
    """
    sample = float(np.median(np.diff(time)))
    near = np.abs(time - time[index]) <= max(half_width, 4.0 * sample)
    place = (time[near] - time[index]) / half_width
    columns = np.vander(place, 5, increasing=True)
    weights, residuals = fit_linear(columns, force[near])
    # so few samples do not tell their own noise, unless they scatter as noise does in one of twenty
    # cases
    freedom = max(place.size - 5, 1)
    excess = float(residuals @ residuals) / noise**2 / freedom
    if not excess > _SCATTER:
        excess = 1.0
    covariance = np.linalg.inv(columns.T @ columns) * noise**2 * excess
    grid = np.linspace(-0.9, 0.9, 361)
    curve = np.vander(grid, 5, increasing=True) @ weights
    turn = np.argmax(curve)
    if 2.0 * weights[0] < curve[0] + curve[-1]:
        turn = np.argmin(curve)
    # one that hardly stands out of the noise stays where it was looked for: noise would choose its
    # own
    turning_place = 0.0
    if np.ptp(curve) > FAINT * noise:
        turning_place = float(grid[turn])
    gradient = np.asarray(turning_place ** np.arange(5), dtype=float)
    height = float(gradient @ weights)
    std = propagate_std(gradient, covariance)
    instant = float(time[index]) + turning_place * half_width
    return Extremum(height, std, instant)
