"""Structure in the residuals: how trials err, each by itself and beside its neighbours.

Its causes stand in no column of the table.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.fft import dct

from stepblocks.lawsearch.fit import Fit, Problem, fit, fit_without
from stepblocks.lawsearch.forward_model import Floats, Systematic
from stepblocks.lawsearch.law import Law, correct_by_holm

LEVEL = 0.002  # of all tests of a session together, after Holm
_FEWEST = 24  # trials
_GROUP_BIC = 12.0  # by which two groups must beat one: odds of 400 to 1
_APART = (
    2.2  # of the middles of two groups, in their pooled spread times the root of two (Ashman's D)
)
_MOST_LEVELS = 5  # along a run
_SHORTEST_LEVEL = 6  # trials
_LEAST_GROUP = 0.1  # share of the trials
_DRIFTS = (
    0.5  # correlation of a reading with the one before, from which it counts as going with the hour
)
_OVER_WALK = 8.0  # of the criterion, by which a law along the hour must beat a walk
_DIRECTIONS = 24  # slow waves that make up a wandering quantity in the noise
# by which twice the log likelihood may fall within the 95 % interval of a place of a sudden change
# (Hansen 2000, doi:10.1111/1468-0262.00124)
_PLACE = 7.35
# of a walk's step to the scatter, squared
_RATIOS = np.concatenate([[0.0], np.geomspace(1e-5, 30.0, 40)])


@dataclass(frozen=True)
class Hint:
    """Something that chance alone does not do.

    Attributes
    ----------
    kind : str
        ``heaps`` or ``neighbours``.
    quantity : str
        Which quantity of the model differs.
    p_value : float
        After Holm over all tests; of groups the odds by the criterion.
    sentence : str
        One sentence.
    clusters : tuple[tuple[int, ...], ...]
        Rows of the trials of each group, where there are several.
    """

    kind: str
    quantity: str
    p_value: float
    sentence: str
    clusters: tuple[tuple[int, ...], ...] = ()

    def as_record(self, names: NDArray[np.str_]) -> dict[str, object]:
        """Write it out for JSON with the names of its trials; the old keys go in version 2."""
        groups = [[str(names[row]) for row in group] for group in self.clusters]
        return {
            "kind": self.kind,
            "quantity": self.quantity,
            "p_value": self.p_value,
            "text": self.sentence,
            "said": self.sentence,
            "groups": groups,
            "heaps": groups,
        }


def estimate_quantity_errors(problem: Problem, fitted: Fit) -> tuple[Floats, Floats]:
    """Estimate for every trial by how much its quantities differ from the model, shape (n, k).

    The uncertainty has the same shape.
    """
    trials, scatter = problem.trials, problem.noise.scatter
    responses = problem.model.responses(trials, fitted.values, fitted.active)
    seen = trials.seen
    weight = np.where(seen, 1.0 / (np.where(seen, trials.std, 1.0) ** 2 + scatter.channels), 0.0)
    # discrete settings would make two groups of errors that trials share
    residual = np.nan_to_num(
        problem.noise.subtract_shared(np.where(seen, trials.values - fitted.predicted, np.nan))
    )
    filled = np.where(seen[:, :, None], responses, 0.0)
    # a quantity that no channel of a trial shows stays near zero with a deviation of its scatter
    prior = 1.0 / np.maximum(100.0 * scatter.quantities, 1e-10)
    normal = np.einsum("nci,nc,ncj->nij", filled, weight, filled) + np.diag(prior)
    inverse = np.linalg.inv(normal)
    found = np.einsum("nij,ncj,nc,nc->ni", inverse, filled, weight, residual)
    std = np.sqrt(np.einsum("nii->ni", inverse))
    return (
        np.where(
            std < 5.0 * np.sqrt(scatter.quantities + np.nanmedian(std, axis=0) ** 2), found, np.nan
        ),
        std,
    )


def estimate_errors_in_order(
    problem: Problem, fitted: Fit
) -> dict[str, tuple[NDArray[np.intp], Floats, Floats]]:
    """Return the trials that show each quantity, in the order of the run, and their errors of it.

    The uncertainty of each error stands behind them.
    """
    errors, std = estimate_quantity_errors(problem, fitted)
    order = np.argsort(problem.model.order(problem.trials), kind="stable")
    shown = [order[known] for known in np.isfinite(errors[order]).T]
    return {
        name: (rows, errors[rows, k], std[rows, k])
        for k, (name, rows) in enumerate(zip(problem.model.quantities, shown, strict=True))
    }


def find_hints(problem: Problem, fitted: Fit) -> tuple[Hint, ...]:
    """Look for causes that no column describes."""
    found: list[Hint] = []
    tests: list[Hint] = []
    for name, (rows, values, std) in estimate_errors_in_order(problem, fitted).items():
        if len(rows) < _FEWEST or np.ptp(values) < 1e-9:
            continue
        found += filter(None, [_find_clusters(name, values, float(np.median(std)), rows)])
        tests.append(_test_neighbours(name, values))
    if tests:
        corrected = correct_by_holm([t.p_value for t in tests])
        found += [
            replace(test, p_value=p)
            for test, p in zip(tests, corrected.tolist(), strict=True)
            if p < LEVEL
        ]
    return _select_plainest(found)


def _select_plainest(found: Sequence[Hint]) -> tuple[Hint, ...]:
    # One cause shows in several tests: a walk has groups, too
    wandering = {hint.quantity for hint in found if hint.kind == "neighbours"}
    kept = [h for h in found if h.kind == "neighbours" or h.quantity not in wandering]
    names = [hint.quantity for hint in found]
    return tuple(sorted(kept, key=lambda hint: names.index(hint.quantity)))


def _find_clusters(name: str, values: Floats, std: float, rows: NDArray[np.intp]) -> Hint | None:
    # Two groups instead of one, by the criterion of Schwarz, and well apart
    from sklearn.mixture import GaussianMixture

    scaled = ((values - np.median(values)) / np.std(values))[:, None]
    one, two = (GaussianMixture(n, n_init=4, random_state=0).fit(scaled) for n in (1, 2))
    gain = float(one.bic(scaled) - two.bic(scaled))
    # errors below their own uncertainty are shrunk, and no groups of any size
    spread = np.maximum(np.sqrt(two.covariances_[:, 0, 0]), std / np.std(values))
    apart = abs(float(two.means_[0, 0] - two.means_[1, 0])) * np.sqrt(
        2.0 / float(np.sum(spread**2))
    )
    if gain < _GROUP_BIC or apart < _APART or float(two.weights_.min()) < _LEAST_GROUP:
        return None
    member = two.predict(scaled) == int(np.argmin(two.means_[:, 0]))
    groups = tuple(tuple(sorted(rows[m].tolist())) for m in (member, ~member))
    return Hint(
        "heaps",
        name,
        float(np.exp(-0.5 * min(gain, 600.0))),
        f"{name} falls into two groups of {len(groups[0])} and {len(groups[1])} trials, "
        f"{values[~member].mean() - values[member].mean():.3g} apart",
        groups,
    )


def fit_random_walk(values: Floats) -> tuple[float, float, float]:
    """Fit a random walk beside scatter.

    The result is twice the log likelihood that it gains, with the standard deviations of step and
    scatter.
    """
    # The cosine transform diagonalises a walk whose mean is taken off, so that the likelihood costs
    # one transform.
    n = len(values)
    power = np.asarray(dct(values - values.mean(), type=2, norm="ortho"))[1:] ** 2
    shape = 1.0 / (4.0 * np.sin(0.5 * np.pi * np.arange(1, n) / n) ** 2)
    spectrum = 1.0 + _RATIOS[:, None] * shape
    variance = np.mean(power / spectrum, axis=1)
    cost = (n - 1) * np.log(np.maximum(variance, 1e-300)) + np.sum(np.log(spectrum), axis=1)
    best = int(np.argmin(cost))
    scatter = float(np.sqrt(variance[best]))
    return float(cost[0] - cost[best]), scatter * float(np.sqrt(_RATIOS[best])), scatter


def split_into_levels(values: Floats) -> list[NDArray[np.intp]]:
    """Split values in order into two to `_MOST_LEVELS` levels, by the least squares of each number.

    Each entry holds the places at which the levels but the first begin.
    """
    from ruptures import KernelCPD

    most = min(_MOST_LEVELS, len(values) // _SHORTEST_LEVEL)
    search = KernelCPD(kernel="linear", min_size=_SHORTEST_LEVEL).fit(values)
    return [np.array(search.predict(n_bkps=count)[:-1]) for count in range(1, most)]


def _test_neighbours(name: str, values: Floats) -> Hint:
    from statsmodels.stats.diagnostic import acorr_ljungbox

    gain, _, _ = fit_random_walk(values)
    together = float(acorr_ljungbox(values, lags=[min(5, len(values) // 8)])["lb_pvalue"].iloc[0])
    return describe_wandering(
        name, min(1.0, 2.0 * min(together, 0.5 * float(stats.chi2.sf(gain, 1))))
    )


def describe_wandering(name: str, p_value: float = 0.0) -> Hint:
    """Say that a quantity goes its own way along the run."""
    return Hint(
        "neighbours",
        name,
        p_value,
        f"{name} wanders: trials that follow one another err together",
    )


def build_wandering_errors(
    problem: Problem, fitted: Fit, wanders: Mapping[str, Floats]
) -> list[Systematic]:
    """Directions of the noise in which quantities wander along the run.

    `wanders` gives the values of the wanderings that were found.
    """
    trials = problem.trials
    responses = problem.model.responses(trials, fitted.values, fitted.active)
    place = np.argsort(np.argsort(problem.model.order(trials), kind="stable"), kind="stable")
    n = len(trials)
    found = []
    for name, values in wanders.items():
        k = list(problem.model.quantities).index(name)
        step = fit_random_walk(values)[1]
        for wave in range(1, min(_DIRECTIONS, n // 3)):
            column = np.sqrt(2.0 / n) * np.cos(np.pi * wave * (place + 0.5) / n)
            found.append(
                Systematic(
                    "",
                    responses[:, :, k] * column[:, None],
                    step / (2.0 * np.sin(0.5 * np.pi * wave / n)),
                )
            )
    return found


def add_jump_places(
    problem: Problem, base: Fit, quantities: Container[str], candidates: Sequence[Law]
) -> list[Law]:
    """Let a search look for sudden changes of quantities where their errors fall apart best."""
    order = problem.model.order(problem.trials)
    places = {
        (name, len(first)): 0.5 * (order[rows][first - 1] + order[rows][first])
        for name, (rows, errors, _) in estimate_errors_in_order(problem, base).items()
        if name in quantities
        for first in split_into_levels(errors)
    }
    return [
        replace(e, shapes=(*e.shapes, dict(zip(e.steps, found.tolist(), strict=True))))
        if follows_run_order(problem, e)
        and (found := places.get((e.slot, len(e.steps)))) is not None
        else e
        for e in candidates
    ]


def bound_jump_place(
    problem: Problem, fitted: Fit, effect: Law, name: str, column: NDArray[np.generic]
) -> tuple[float, float]:
    """Find the 95 % interval of a place at which an effect changes at once.

    The likelihood is the same wherever between two values of the `column` that the effect follows
    the place lies. The other parameters follow to first order.
    """
    own = f"{effect.id}.{name}"
    seen = np.unique(np.asarray(column, dtype=np.float64))
    moving = [i for i, p in enumerate(fitted.parameters) if p.name != own]
    basis, _ = np.linalg.qr(fitted.jacobian[:, moving])
    costs = np.empty(len(seen) - 1)
    for i, place in enumerate(0.5 * (seen[1:] + seen[:-1])):
        predicted = problem.predict(fitted.effects, fitted.values | {own: float(place)})
        left = np.append(problem.noise.whiten(problem.trials.values - predicted), fitted.departure)
        costs[i] = left @ left - np.sum((basis.T @ left) ** 2)
    kept = np.flatnonzero(costs <= costs.min() + _PLACE)
    return float(seen[kept[0]]), float(seen[kept[-1] + 1])


def follows_run_order(problem: Problem, effect: Law) -> bool:
    """Tell whether an effect follows the order of the run itself."""
    column = problem.trials.covariates.get(effect.covariate)
    return column is not None and np.array_equal(column, problem.model.order(problem.trials))


def fit_without_time_effects(problem: Problem, current: Fit) -> Fit:
    """Fit again without what goes with the hour."""
    return fit(
        problem,
        tuple(e for e in current.effects if not _follows_time(problem, e)),
        current.values,
    )


def find_random_walks(problem: Problem, current: Fit) -> set[str]:
    """Find quantities whose law along the run explains no more than a random walk would.

    Their neighbours err together, and no law is claimed.
    """
    found = set()
    for effect in current.effects:
        if effect.slot not in problem.model.quantities or not _follows_time(problem, effect):
            continue
        own, bare = (
            estimate_errors_in_order(problem, f)[effect.slot][1]
            for f in (current, fit_without(problem, current, effect))
        )
        law = len(own) * float(np.log(np.var(own) / np.var(bare))) + np.log(len(own)) * len(
            effect.parameters
        )
        if law > -fit_random_walk(bare)[0] + np.log(len(own)) - _OVER_WALK:
            found.add(effect.slot)
    return found


def _follows_time(problem: Problem, effect: Law) -> bool:
    # Whether an effect follows what drifts with the hour. The run itself, or a reading that goes
    # along with it.
    trials = problem.trials
    numbers = trials.numeric(effect.covariate) if effect.covariate in trials.covariates else None
    if numbers is None or np.ptp(numbers) == 0.0:
        return False
    sorted_ = numbers[np.argsort(problem.model.order(trials), kind="stable")]
    return float(np.corrcoef(sorted_[:-1], sorted_[1:])[0, 1]) > _DRIFTS
