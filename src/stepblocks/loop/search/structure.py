"""Structure in the residuals: how trials err, each by itself and beside its neighbours.

Its causes stand in no column of the table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.fft import dct
from statsmodels.stats.multitest import multipletests

from stepblocks.loop.search.fit import Fit, Problem
from stepblocks.loop.search.forward_model import Floats, Systematic

LEVEL = 0.002  # of all tests of a session together, after Holm
_FEWEST = 24  # trials
_HEAP_BIC = 12.0  # by which two heaps must beat one: odds of 400 to 1
_APART = (
    2.2  # of the middles of two groups, in their pooled spread times the root of two (Ashman's D)
)
_LEAST_HEAP = 0.1  # share of the trials
_DIRECTIONS = 24  # slow waves that make up a wandering quantity in the noise
_RATIOS = np.concatenate(
    [[0.0], np.geomspace(1e-5, 30.0, 40)]
)  # of a walk's step to the scatter, squared


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
    said : str
        One sentence.
    clusters : tuple[tuple[int, ...], ...]
        Rows of the trials of each heap, where they fall apart.
    """

    kind: str
    quantity: str
    p_value: float
    said: str
    clusters: tuple[tuple[int, ...], ...] = ()


def estimate_quantity_errors(problem: Problem, fitted: Fit) -> tuple[Floats, Floats]:
    """Estimate for every trial by how much its quantities differ from the model, shape (n, k).

    The uncertainty has the same shape.
    """
    trials, scatter = problem.trials, problem.noise.scatter
    responses = problem.model.responses(trials, fitted.values, fitted.active)
    seen = trials.seen
    weight = np.where(seen, 1.0 / (np.where(seen, trials.std, 1.0) ** 2 + scatter.channels), 0.0)
    residual = np.where(seen, trials.values - fitted.predicted, 0.0)
    filled = np.where(seen[:, :, None], responses, 0.0)
    # a quantity that no channel of a trial shows stays near zero with a deviation of its scatter
    prior = 1.0 / np.maximum(100.0 * scatter.quantities, 1e-10)
    normal = np.einsum("nci,nc,ncj->nij", filled, weight, filled) + np.diag(prior)
    inverse = np.linalg.inv(normal)
    found = np.einsum("nij,ncj,nc,nc->ni", inverse, filled, weight, residual)
    std = np.sqrt(np.einsum("nii->ni", inverse))
    known = std < 5.0 * np.sqrt(scatter.quantities + np.nanmedian(std, axis=0) ** 2)
    return np.where(known, found, np.nan), std


def find_hints(
    problem: Problem, fitted: Fit, names: Sequence[str], order: Floats
) -> tuple[Hint, ...]:
    """Look for causes that no column describes."""
    errors, _ = estimate_quantity_errors(problem, fitted)
    found: list[Hint] = []
    tests: list[Hint] = []
    for k, name in enumerate(names):
        rows = np.flatnonzero(np.isfinite(errors[:, k]))
        if len(rows) < _FEWEST or np.ptp(errors[rows, k]) < 1e-9:
            continue
        rows = rows[np.argsort(order[rows], kind="stable")]
        values = errors[rows, k]
        found += filter(None, [_find_clusters(name, values, rows)])
        tests.append(_test_neighbours(name, values))
    if tests:
        corrected = multipletests([t.p_value for t in tests], method="holm")[1]
        for test, p_value in zip(tests, corrected.tolist(), strict=True):
            if p_value < LEVEL:
                found.append(replace(test, p_value=p_value))
    return _select_plainest(found)


def _select_plainest(found: Sequence[Hint]) -> tuple[Hint, ...]:
    # One cause shows in several tests: a walk has groups, too
    kept = []
    for name in dict.fromkeys(hint.quantity for hint in found):
        own = [hint for hint in found if hint.quantity == name]
        kept += [h for h in own if h.kind == "neighbours"] or own
    return tuple(kept)


def _find_clusters(name: str, values: Floats, rows: NDArray[np.intp]) -> Hint | None:
    # Two groups instead of one, by the criterion of Schwarz, and well apart
    from sklearn.mixture import GaussianMixture

    scaled = ((values - np.median(values)) / np.std(values))[:, None]
    one, two = (GaussianMixture(n, n_init=4, random_state=0).fit(scaled) for n in (1, 2))
    gain = float(one.bic(scaled) - two.bic(scaled))
    spread = np.sqrt(two.covariances_[:, 0, 0])
    apart = abs(float(two.means_[0, 0] - two.means_[1, 0])) * np.sqrt(
        2.0 / float(np.sum(spread**2))
    )
    if gain < _HEAP_BIC or apart < _APART or float(two.weights_.min()) < _LEAST_HEAP:
        return None
    low = int(np.argmin(two.means_[:, 0]))
    member = two.predict(scaled) == low
    heaps = tuple(tuple(sorted(rows[m].tolist())) for m in (member, ~member))
    step = float(values[~member].mean() - values[member].mean())
    said = (
        f"{name} falls into two groups of {len(heaps[0])} and {len(heaps[1])} trials, {step:.3g} "
        "apart"
    )
    return Hint("heaps", name, float(np.exp(-0.5 * min(gain, 600.0))), said, heaps)


def fit_walk(values: Floats) -> tuple[float, float, float]:
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


def _test_neighbours(name: str, values: Floats) -> Hint:
    from statsmodels.stats.diagnostic import acorr_ljungbox

    gain, _, _ = fit_walk(values)
    lags = min(5, len(values) // 8)
    together = float(acorr_ljungbox(values, lags=[lags])["lb_pvalue"].iloc[0])
    p_value = min(1.0, 2.0 * min(together, 0.5 * float(stats.chi2.sf(gain, 1))))
    return describe_wandering(name, p_value)


def describe_wandering(name: str, p_value: float = 0.0) -> Hint:
    """Say that a quantity goes its own way along the run."""
    said = f"{name} wanders: trials that follow one another err together"
    return Hint("neighbours", name, p_value, said)


def build_wandering(
    problem: Problem, fitted: Fit, wanders: Mapping[int, Floats]
) -> list[Systematic]:
    """Directions of the noise in which quantities wander along the run.

    `wanders` gives the values of the wanderings that were found.
    """
    trials = problem.trials
    responses = problem.model.responses(trials, fitted.values, fitted.active)
    place = np.argsort(np.argsort(problem.model.order(trials), kind="stable"), kind="stable")
    n, found = len(trials), []
    for k, values in wanders.items():
        _, step, _ = fit_walk(values)
        for wave in range(1, min(_DIRECTIONS, n // 3)):
            column = np.sqrt(2.0 / n) * np.cos(np.pi * wave * (place + 0.5) / n)
            std = step / (2.0 * np.sin(0.5 * np.pi * wave / n))
            found.append(Systematic("", responses[:, :, k] * column[:, None], std))
    return found
