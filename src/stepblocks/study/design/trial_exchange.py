"""Designs that tell most: trials are moved between heights until no move tells more."""

# Exchange after Fedorov, V. V. (1972), Theory of Optimal Experiments, Academic Press; a criterion
# averaged over expected values after Chaloner, K., Larntz, K. (1989), Journal of Statistical
# Planning and Inference 21, 191-208, doi:10.1016/0378-3758(89)90004-9.

import itertools
from dataclasses import dataclass

import numpy as np

from stepblocks.contact import Array
from stepblocks.study.design.information import Sensitivity

_GAIN = 1e-6  # least gain of a move, in logarithms of a variance
_MOST_MOVES = 10_000
_SECOND_ORDER = 3.0  # see `Criterion`
_SPENT = 0.01  # of the logarithm of a variance, for which fewer heights are taken


@dataclass(frozen=True)
class Criterion:
    """The logarithm of the asymptotic variance of some parameters, which is to be small.

    Of several parameters it is the logarithm of the determinant of their covariance (D-optimal
    for these), of one that of its variance (c-optimal). It is a mean over the expected values.

    A threshold needs one term more. Its asymptotic variance is least with all trials at the
    threshold itself, where nothing is known of the spread and a fit finds no threshold either. For
    trials at two heights, the threshold between them in the middle, the fitted one is at
    ``-s d / D`` with the mean s and half the difference D of both fitted distances, which are
    independent; its variance is that of s times the mean of ``(d / D)**2``, which is
    ``1 + 3 var(ln spread)`` to the second order. This factor is part of the criterion. It is 1 for
    many trials, and keeps the criterion convex in the shares of trials.

    Attributes
    ----------
    sensitivity : Sensitivity
        How answers depend on the parameters.
    targets : tuple of int
        Places of the parameters that are asked for; the others are estimated beside them.
    spread : int or None
        Place of the logarithm of the spread where its error widens that of the target.
    """

    sensitivity: Sensitivity
    targets: tuple[int, ...]
    spread: int | None = None

    @property
    def nuisance_indices(self) -> tuple[int, ...]:
        """Indices of the parameters that are estimated and not asked for."""
        return self._list_other_parameter_indices(self.targets)

    def _list_other_parameter_indices(self, indices: tuple[int, ...]) -> tuple[int, ...]:
        """Return the places of all parameters but some."""
        number = self.sensitivity.known.shape[0]
        return tuple(place for place in range(number) if place not in indices)

    def compute_value(self, trials: Array) -> float:
        """Return the criterion of trials at each height, shape (heights,)."""
        information = self.sensitivity.compute_information(trials)
        logs = _compute_log_variance(information, self.nuisance_indices)
        if self.spread is not None:
            beside_spread = self._list_other_parameter_indices((self.spread,))
            variance = np.exp(_compute_log_variance(information, beside_spread))
            logs = logs + np.log1p(_SECOND_ORDER * variance)
        return float(self.sensitivity.weights @ logs)

    def compute_values_with_additions(self, trials: Array, added_trials: float) -> Array:
        """Return the criterion after some trials are added at each height in turn.

        The determinant with a further outer product is that without it times one plus a quadratic
        form.
        """
        information = self.sensitivity.compute_information(trials)
        slopes = self.sensitivity.slopes
        beside = _select_parameter_blocks(information, self.nuisance_indices)
        growth = np.log1p(added_trials * _compute_quadratic_forms(information, slopes))
        gain = growth - np.log1p(
            added_trials * _compute_quadratic_forms(beside, slopes[..., self.nuisance_indices])
        )
        if self.spread is not None:
            beside_spread = self._list_other_parameter_indices((self.spread,))
            of_spread = _select_parameter_blocks(information, beside_spread)
            log_variance = _compute_log_variance(information, beside_spread)[:, np.newaxis]
            forms = _compute_quadratic_forms(of_spread, slopes[..., beside_spread])
            less = log_variance - growth + np.log1p(added_trials * forms)
            gain += np.log1p(_SECOND_ORDER * np.exp(log_variance))
            gain -= np.log1p(_SECOND_ORDER * np.exp(less))
        # rounded, so that the least is the same on every processor
        return np.asarray(np.round(self.compute_value(trials) - self.sensitivity.weights @ gain, 9))


def _compute_log_variance(information: Array, nuisance_indices: tuple[int, ...]) -> Array:
    """Return ln(determinant of the covariance) of all but some parameters, shape (values,)."""
    beside = _select_parameter_blocks(information, nuisance_indices)
    return np.asarray(np.linalg.slogdet(beside)[1] - np.linalg.slogdet(information)[1])


def _select_parameter_blocks(matrices: Array, indices: tuple[int, ...]) -> Array:
    """Return the rows and columns of matrices that belong to some parameters."""
    return matrices[:, indices][:, :, indices]


def _compute_quadratic_forms(matrices: Array, vectors: Array) -> Array:
    """Compute v' inv(M) v of each vector with each matrix, shape (values, heights)."""
    return np.asarray(np.sum(vectors @ np.linalg.inv(matrices) * vectors, axis=-1))


def allocate_evenly_spaced_units(values: Array, height_count: int, unit_count: int) -> Array:
    """Share units of trials between the candidates nearest to equal spacing, shape (heights,).

    `values` are the values that are equally spaced, in rising order; the first heights get what
    does not divide.
    """
    wanted = np.linspace(values[0], values[-1], height_count)
    nearest = np.abs(values[:, np.newaxis] - wanted).argmin(axis=0)
    places = sorted(set(nearest.tolist()))
    shares = np.zeros(len(values))
    for turn in range(unit_count):
        shares[places[turn % len(places)]] += 1.0
    return shares


def exchange_trials(
    criterion: Criterion, start_units: Array, trials_per_unit: int, fewest_heights: int
) -> Array:
    """Move units of trials between heights until no move improves the criterion.

    Large moves come first; of equal ones the first, so that the outcome is always the same.

    Parameters
    ----------
    criterion : Criterion
        Which is to be small.
    start_units : ndarray, shape (heights,)
        Units of trials at each height, at `fewest_heights` heights or more.
    trials_per_unit : int
        Trials of a unit.
    fewest_heights : int
        Heights that keep at least one unit; with as many units, each has one.

    Returns
    -------
    ndarray, shape (heights,)
        Units of trials at each height.
    """
    units = start_units.copy()
    chunk = max(int(units.sum()) // 4, 1)
    while chunk:
        for _ in range(_MOST_MOVES):
            moved = _find_best_move(criterion, units, trials_per_unit, chunk, fewest_heights)
            if moved is None:
                break
            units = moved
        chunk //= 2
    return units


def merge_equivalent_heights(
    criterion: Criterion, units: Array, trials_per_unit: int, fewest_heights: int
) -> Array:
    """Give up heights whose trials tell as much at another one, to within 1 % of the variance.

    Parameters and outcome are those of `exchange_trials`.
    """
    limit = criterion.compute_value(trials_per_unit * units) + _SPENT * len(criterion.targets)
    merged = units
    while np.count_nonzero(merged) > fewest_heights:
        shorter = _list_neighbour_merges(merged)
        losses = []
        for shares in shorter:
            losses.append(round(criterion.compute_value(trials_per_unit * shares), 9))
        best = int(np.argmin(losses))
        if losses[best] > limit:
            break
        merged = shorter[best]
    return merged


def _list_neighbour_merges(units: Array) -> list[Array]:
    """Return what is left when all trials of a height go to one of its neighbours."""
    used = np.flatnonzero(units).tolist()
    merged = []
    for low, high in itertools.pairwise(used):
        for source, goal in ((low, high), (high, low)):
            left = units.copy()
            left[goal] += left[source]
            left[source] = 0.0
            merged.append(left)
    return merged


def _find_best_move(
    criterion: Criterion, units: Array, trials_per_unit: int, most_units: int, fewest_heights: int
) -> Array | None:
    """Return the units after the best move of at most a chunk; None where none improves."""
    best = criterion.compute_value(trials_per_unit * units) - _GAIN
    found = None
    for source in np.flatnonzero(units).tolist():
        amount = min(most_units, int(units[source]))
        left = units.copy()
        left[source] -= amount
        values = criterion.compute_values_with_additions(
            trials_per_unit * left, trials_per_unit * amount
        )
        if np.count_nonzero(left) < fewest_heights:
            values[left > 0.0] = np.inf  # a height that is used already makes no further one
        goal = int(values.argmin())
        if values[goal] < best and goal != source:
            best = float(values[goal])
            found = left
            found[goal] += amount
    return found
