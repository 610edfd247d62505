"""Values in the order of the run: random walks, and levels between sudden changes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from stepblocks.lawsearch.forward_model import Floats

_MOST_LEVELS = 5  # along a run
_SHORTEST_LEVEL = 6  # trials
# squares of the ratio of a walk's step to the scatter that are tried
_RATIOS = np.concatenate([[0.0], np.geomspace(1e-5, 30.0, 40)])


@dataclass(frozen=True)
class RandomWalk:
    """A random walk beside scatter.

    Attributes
    ----------
    gain : float
        Twice the log likelihood that the walk gains over scatter alone.
    step : float
        Standard deviation of the step from trial to trial.
    scatter : float
        Standard deviation of the scatter.
    """

    gain: float
    step: float
    scatter: float


def fit_random_walk(values: Floats) -> RandomWalk:
    """Fit a random walk beside scatter to values of shape (m,) in their order."""
    # the cosine transform diagonalises a walk whose mean is taken off, so that the likelihood costs
    # one transform
    n = len(values)
    power = np.asarray(dct(values - values.mean(), type=2, norm="ortho"))[1:] ** 2
    shape = 1.0 / (4.0 * np.sin(0.5 * np.pi * np.arange(1, n) / n) ** 2)
    spectrum = 1.0 + _RATIOS[:, None] * shape
    variance = np.mean(power / spectrum, axis=1)
    cost = (n - 1) * np.log(np.maximum(variance, 1e-300)) + np.sum(np.log(spectrum), axis=1)
    best = int(np.argmin(cost))
    scatter = float(np.sqrt(variance[best]))
    return RandomWalk(
        gain=float(cost[0] - cost[best]),
        step=scatter * float(np.sqrt(_RATIOS[best])),
        scatter=scatter,
    )


def compute_cosine_wave(run_positions: NDArray[np.intp], wave_number: int) -> Floats:
    """Compute a cosine along a run, of unit length: one of the directions in which walks vary.

    Parameters
    ----------
    run_positions : array of int
        Shape (n,), place of each trial in the run, from 0.
    wave_number : int
        Half periods over the run.
    """
    n = len(run_positions)
    return np.asarray(np.sqrt(2.0 / n) * np.cos(np.pi * wave_number * (run_positions + 0.5) / n))


def compute_wave_std(trial_count: int, wave_number: int, walk_step: float) -> float:
    """Compute the standard deviation of a walk along a wave.

    `walk_step` is the standard deviation of the walk's step from trial to trial.
    """
    return float(walk_step / (2.0 * np.sin(0.5 * np.pi * wave_number / trial_count)))


def find_level_starts_by_level_count(values: Floats) -> list[NDArray[np.intp]]:
    """Split values in order into two levels, three, and so on, by least squares.

    Returns
    -------
    list of arrays
        For each number of levels the places at which all levels but the first begin.
    """
    from ruptures import KernelCPD

    level_limit = min(_MOST_LEVELS, len(values) // _SHORTEST_LEVEL)
    search = KernelCPD(kernel="linear", min_size=_SHORTEST_LEVEL).fit(values)
    splits = []
    for count in range(1, level_limit):
        ends = search.predict(n_bkps=count)
        splits.append(np.array(ends[:-1]))
    return splits
