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
        return self._list_places_beside(self.targets)

    def _list_places_beside(self, places: tuple[int, ...]) -> tuple[int, ...]:
        """Return the places of all parameters but some."""
        number = self.sensitivity.known.shape[0]
        return tuple(place for place in range(number) if place not in places)

    def compute_value(self, trials: Array) -> float:
        """Return the criterion of trials at each height, shape (heights,)."""
        information = self.sensitivity.add_up(trials)
        logs = _compute_log_variance(information, self.nuisance_indices)
        if self.spread is not None:
            beside_spread = self._list_places_beside((self.spread,))
            variance = np.exp(_compute_log_variance(information, beside_spread))
            logs = logs + np.log1p(_SECOND_ORDER * variance)
        return float(self.sensitivity.weights @ logs)

    def assess_additions(self, trials: Array, added: float) -> Array:
        """Return the criterion after some trials are added at each height in turn.

        The determinant with a further outer product is that without it times one plus a quadratic
        form.
        """
        information = self.sensitivity.add_up(trials)
        slopes = self.sensitivity.slopes
        beside = _select_parameters(information, self.nuisance_indices)
        growth = np.log1p(added * _compute_quadratic_forms(information, slopes))
        gain = growth - np.log1p(
            added * _compute_quadratic_forms(beside, slopes[..., self.nuisance_indices])
        )
        if self.spread is not None:
            beside_spread = self._list_places_beside((self.spread,))
            of_spread = _select_parameters(information, beside_spread)
            log_variance = _compute_log_variance(information, beside_spread)[:, np.newaxis]
            forms = _compute_quadratic_forms(of_spread, slopes[..., beside_spread])
            less = log_variance - growth + np.log1p(added * forms)
            gain += np.log1p(_SECOND_ORDER * np.exp(log_variance))
            gain -= np.log1p(_SECOND_ORDER * np.exp(less))
        # rounded, so that the least is the same on every processor
        return np.asarray(np.round(self.compute_value(trials) - self.sensitivity.weights @ gain, 9))


def _compute_log_variance(information: Array, nuisance_indices: tuple[int, ...]) -> Array:
    """Return ln(determinant of the covariance) of all but some parameters, shape (values,)."""
    beside = _select_parameters(information, nuisance_indices)
    return np.asarray(np.linalg.slogdet(beside)[1] - np.linalg.slogdet(information)[1])


def _select_parameters(matrices: Array, places: tuple[int, ...]) -> Array:
    """Return the rows and columns of matrices that belong to some parameters."""
    return matrices[:, places][:, :, places]


def _compute_quadratic_forms(matrices: Array, vectors: Array) -> Array:
    """Compute v' inv(M) v of each vector with each matrix, shape (values, heights)."""
    return np.asarray(np.sum(vectors @ np.linalg.inv(matrices) * vectors, axis=-1))


def spread_evenly(logs: Array, number: int, units: int) -> Array:
    """Share units of trials between the candidates nearest to equal spacing, shape (heights,).

    `logs` are the values that are equally spaced, in rising order; the first heights get what
    does not divide.
    """
    wanted = np.linspace(logs[0], logs[-1], number)
    nearest = np.abs(logs[:, np.newaxis] - wanted).argmin(axis=0)
    places = sorted(set(nearest.tolist()))
    shares = np.zeros(len(logs))
    for turn in range(units):
        shares[places[turn % len(places)]] += 1.0
    return shares


def exchange_trials(criterion: Criterion, start: Array, unit: int, fewest: int) -> Array:
    """Move units of trials between heights until no move improves the criterion.

    Large moves come first; of equal ones the first, so that the outcome is always the same.

    Parameters
    ----------
    criterion : Criterion
        Which is to be small.
    start : ndarray, shape (heights,)
        Units of trials at each height, at `fewest` heights or more.
    unit : int
        Trials of a unit.
    fewest : int
        Heights that keep at least one unit; with as many units, each has one.

    Returns
    -------
    ndarray, shape (heights,)
        Units of trials at each height.
    """
    units = start.copy()
    chunk = max(int(units.sum()) // 4, 1)
    while chunk:
        for _ in range(_MOST_MOVES):
            moved = _find_best_move(criterion, units, unit, chunk, fewest)
            if moved is None:
                break
            units = moved
        chunk //= 2
    return units


def merge_heights(criterion: Criterion, units: Array, unit: int, fewest: int) -> Array:
    """Give up heights whose trials tell as much at another one, to within 1 % of the variance.

    Parameters and outcome are those of `exchange_trials`.
    """
    limit = criterion.compute_value(unit * units) + _SPENT * len(criterion.targets)
    merged = units
    while np.count_nonzero(merged) > fewest:
        shorter = _list_merged(merged)
        losses = []
        for shares in shorter:
            losses.append(round(criterion.compute_value(unit * shares), 9))
        best = int(np.argmin(losses))
        if losses[best] > limit:
            break
        merged = shorter[best]
    return merged


def _list_merged(units: Array) -> list[Array]:
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
    criterion: Criterion, units: Array, unit: int, chunk: int, fewest: int
) -> Array | None:
    """Return the units after the best move of at most a chunk; None where none improves."""
    best = criterion.compute_value(unit * units) - _GAIN
    found = None
    for source in np.flatnonzero(units).tolist():
        amount = min(chunk, int(units[source]))
        left = units.copy()
        left[source] -= amount
        values = criterion.assess_additions(unit * left, unit * amount)
        if np.count_nonzero(left) < fewest:
            values[left > 0.0] = np.inf  # a height that is used already makes no further one
        goal = int(values.argmin())
        if values[goal] < best and goal != source:
            best = float(values[goal])
            found = left
            found[goal] += amount
    return found
