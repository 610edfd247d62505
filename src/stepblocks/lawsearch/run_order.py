"""Effects along the run: those that a random walk explains as well, and sudden changes."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.fit import fit_with_effects, fit_without
from stepblocks.lawsearch.forward_model import Floats, Systematic
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.lawsearch.structure import estimate_errors_in_order
from stepblocks.lawsearch.walk import (
    compute_cosine_wave,
    compute_wave_std,
    find_level_starts_by_level_count,
    fit_random_walk,
)

# correlation of a reading with the one before, from which it counts as going with time
_DRIFT_CORRELATION = 0.5
_LEAD_OVER_WALK = 8.0  # of the criterion, by which a law along the run must beat a walk
_DIRECTIONS = 24  # slow waves that make up a wandering quantity in the noise
# by which twice the log likelihood may fall within the 95 % interval of a place of a sudden change
# (Hansen 2000, doi:10.1111/1468-0262.00124)
_PLACE_DROP = 7.35


def follows_run_order(problem: Problem, effect: Law) -> bool:
    """Tell whether an effect follows the order of the run itself."""
    column = problem.trials.covariates.get(effect.covariate)
    return column is not None and np.array_equal(column, problem.model.order(problem.trials))


def follows_time(problem: Problem, effect: Law) -> bool:
    """Tell whether an effect follows the run, or a reading that drifts along with it."""
    trials = problem.trials
    if effect.covariate not in trials.covariates:
        return False
    numbers = trials.numeric(effect.covariate)
    if numbers is None or np.ptp(numbers) == 0.0:
        return False
    in_order = numbers[np.argsort(problem.model.order(trials), kind="stable")]
    correlation = float(np.corrcoef(in_order[:-1], in_order[1:])[0, 1])
    return correlation > _DRIFT_CORRELATION


def fit_without_time_effects(problem: Problem, current: Fit) -> Fit:
    """Fit again without the effects that follow time."""
    remaining = []
    for law in current.effects:
        if not follows_time(problem, law):
            remaining.append(law)
    return fit_with_effects(problem, remaining, current.values)


def find_quantities_like_random_walks(problem: Problem, current: Fit) -> set[str]:
    """Find the quantities whose law along the run explains no more than a random walk would.

    Their neighbours err together, and no law is claimed.
    """
    found = set()
    for effect in current.effects:
        if effect.slot not in problem.model.quantities or not follows_time(problem, effect):
            continue
        without_law = fit_without(problem, current, effect)
        left = estimate_errors_in_order(problem, current)[effect.slot].values
        bare = estimate_errors_in_order(problem, without_law)[effect.slot].values
        n = len(left)
        of_law = n * float(np.log(np.var(left) / np.var(bare))) + np.log(n) * len(effect.parameters)
        of_walk = -fit_random_walk(bare).gain + np.log(n)
        if of_law > of_walk - _LEAD_OVER_WALK:
            found.add(effect.slot)
    return found


def build_wandering_errors(
    problem: Problem, fitted: Fit, wandering_values: Mapping[str, Floats]
) -> list[Systematic]:
    """Build the directions of the noise in which quantities wander along the run.

    Parameters
    ----------
    problem : Problem
    fitted : Fit
    wandering_values : Mapping[str, Floats]
        For each quantity that wanders its errors in the order of the run.
    """
    trials = problem.trials
    n = len(trials)
    responses = problem.model.responses(trials, fitted.values, fitted.active_effects)
    order = np.argsort(problem.model.order(trials), kind="stable")
    place = np.argsort(order, kind="stable")
    quantities = list(problem.model.quantities)
    errors = []
    for name, values in wandering_values.items():
        response = responses[:, :, quantities.index(name)]
        step = fit_random_walk(values).step
        for wave in range(1, min(_DIRECTIONS, n // 3)):
            column = compute_cosine_wave(place, wave)
            std = compute_wave_std(n, wave, step)
            errors.append(Systematic("", response * column[:, None], std))
    return errors


def add_jump_places_to_laws(
    problem: Problem, base: Fit, quantities: Container[str], candidates: Sequence[Law]
) -> list[Law]:
    """Let a search look for sudden changes where the errors of quantities split best.

    Parameters
    ----------
    problem : Problem
    base : Fit
        Fit whose errors are split.
    quantities : container of str
        Quantities that change along the run.
    candidates : sequence of Law

    Returns
    -------
    list of Law
        The candidates; those that change suddenly along the run have one more shape.
    """
    order = problem.model.order(problem.trials)
    places: dict[tuple[str, int], Floats] = {}
    for name, errors in estimate_errors_in_order(problem, base).items():
        if name not in quantities:
            continue
        for first in find_level_starts_by_level_count(errors.values):
            before, after = order[errors.rows][first - 1], order[errors.rows][first]
            places[name, len(first)] = 0.5 * (before + after)
    extended = []
    for law in candidates:
        found = places.get((law.slot, len(law.steps)))
        if found is None or not follows_run_order(problem, law):
            extended.append(law)
            continue
        shape = dict(zip(law.steps, found.tolist(), strict=True))
        extended.append(replace(law, shapes=(*law.shapes, shape)))
    return extended


def compute_jump_place_interval(
    problem: Problem,
    fitted: Fit,
    effect: Law,
    jump_parameter: str,
    covariate_column: NDArray[np.generic],
) -> tuple[float, float]:
    """Find the 95 % interval of the place of a sudden change.

    Between two neighbouring values of the covariate the likelihood is constant. The other
    parameters follow to first order.

    Parameters
    ----------
    problem : Problem
    fitted : Fit
    effect : Law
    jump_parameter : str
        Parameter of the effect that gives the place.
    covariate_column : array of shape (n,)
        What the effect follows.

    Returns
    -------
    low, high : float
        In the unit of the column.
    """
    parameter = effect.name_in_fit(jump_parameter)
    seen = np.unique(np.asarray(covariate_column, dtype=np.float64))
    is_moving = [p.name != parameter for p in fitted.parameters]
    basis, _ = np.linalg.qr(fitted.jacobian[:, is_moving])
    costs = np.empty(len(seen) - 1)
    for i, place in enumerate(0.5 * (seen[1:] + seen[:-1])):
        predicted = problem.predict(fitted.effects, fitted.values | {parameter: float(place)})
        white = problem.noise.whiten(problem.trials.values - predicted)
        residual = np.append(white, fitted.departure)
        costs[i] = residual @ residual - np.sum((basis.T @ residual) ** 2)
    kept = np.flatnonzero(costs <= costs.min() + _PLACE_DROP)
    return float(seen[kept[0]]), float(seen[kept[-1] + 1])
