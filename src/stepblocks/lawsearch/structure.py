"""Structure in the residuals whose cause stands in no column of the table.

Trials may fall into two groups, or trials that follow one another may err together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import correct_p_values_by_holm
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.lawsearch.walk import fit_random_walk

LEVEL = 0.002  # of all tests for neighbours in a session together, after Holm
_FEWEST = 24  # trials that show a quantity, from which its errors are tested
_NO_SPREAD = 1e-9  # range of errors below which they are equal
_GROUP_BIC = 12.0  # fall of the criterion from one group to two: odds of 400 to 1
# distance of the means of two groups in their pooled spread times the root of two (Ashman's D)
_LEAST_SEPARATION = 2.2
_LEAST_GROUP = 0.1  # share of the trials in a group
_GROUP_STARTS = 4  # of the search for groups
_MOST_LOG_ODDS = 600.0  # of two groups against one, beyond which the chance underflows
_LAGS = 5  # trials over which neighbours are compared
_MOST_DEVIATIONS = 5.0  # ratio of the uncertainty of an error to its expected size
_PRIOR_WIDTH = 100.0  # variance of the prior of an error, in variances of the scatter


class HintKind(StrEnum):
    """Kinds of structure in the residuals, by their names in a record."""

    GROUPS = "heaps"
    NEIGHBOURS = "neighbours"


@dataclass(frozen=True)
class Hint:
    """Something that chance alone does not do.

    Attributes
    ----------
    kind : str
        A `HintKind`, or the kind of a hint that the caller of a search adds.
    quantity : str
        Quantity of the model that differs.
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


@dataclass(frozen=True)
class OrderedErrors:
    """Errors of a quantity, trial by trial in the order of the run.

    Attributes
    ----------
    rows : NDArray[np.intp]
        Shape (m,), rows of the trials that show the quantity.
    values : Floats
        Shape (m,).
    std : Floats
        Shape (m,), standard uncertainties.
    """

    rows: NDArray[np.intp]
    values: Floats
    std: Floats


def estimate_quantity_errors(problem: Problem, fitted: Fit) -> tuple[Floats, Floats]:
    """Estimate by how much the quantities of every trial differ from the model.

    Returns
    -------
    errors : array of shape (n, k)
        Not-a-number where a trial does not show the quantity.
    std : array of shape (n, k)
        Standard uncertainties.
    """
    trials, scatter = problem.trials, problem.noise.scatter
    responses = problem.model.responses(trials, fitted.values, fitted.active_effects)
    seen = trials.seen
    variance = np.where(seen, trials.std, 1.0) ** 2 + scatter.channels
    weight = np.where(seen, 1.0 / variance, 0.0)
    # errors that trials share would make two groups of trials at discrete settings
    residual = np.nan_to_num(problem.noise.subtract_shared_errors(problem.compute_residual(fitted)))
    filled = np.where(seen[:, :, None], responses, 0.0)
    # a quantity that no channel of a trial shows stays near zero
    prior = 1.0 / np.maximum(_PRIOR_WIDTH * scatter.quantities, 1e-10)
    normal = np.einsum("nci,nc,ncj->nij", filled, weight, filled) + np.diag(prior)
    inverse = np.linalg.inv(normal)
    errors = np.einsum("nij,ncj,nc,nc->ni", inverse, filled, weight, residual)
    std = np.sqrt(np.einsum("nii->ni", inverse))
    expected = np.sqrt(scatter.quantities + np.nanmedian(std, axis=0) ** 2)
    shown = std < _MOST_DEVIATIONS * expected
    return np.where(shown, errors, np.nan), std


def estimate_errors_in_order(problem: Problem, fitted: Fit) -> dict[str, OrderedErrors]:
    """Return the errors of each quantity, by its name, in the order of the run."""
    errors, std = estimate_quantity_errors(problem, fitted)
    order = np.argsort(problem.model.order(problem.trials), kind="stable")
    ordered = {}
    for k, name in enumerate(problem.model.quantities):
        rows = order[np.isfinite(errors[order, k])]
        ordered[name] = OrderedErrors(rows, errors[rows, k], std[rows, k])
    return ordered


def find_structure_hints(problem: Problem, fitted: Fit) -> tuple[Hint, ...]:
    """Look for causes that no column of the table describes."""
    found: list[Hint] = []
    tests: list[Hint] = []
    for name, errors in estimate_errors_in_order(problem, fitted).items():
        if len(errors.rows) < _FEWEST or np.ptp(errors.values) < _NO_SPREAD:
            continue
        groups = find_two_group_hint(name, errors)
        if groups is not None:
            found.append(groups)
        tests.append(make_neighbour_correlation_hint(name, errors.values))
    if tests:
        corrected = correct_p_values_by_holm([test.p_value for test in tests])
        for test, p_value in zip(tests, corrected.tolist(), strict=True):
            if p_value < LEVEL:
                found.append(replace(test, p_value=p_value))
    return _drop_groups_of_wandering_quantities(found)


def _drop_groups_of_wandering_quantities(found: Sequence[Hint]) -> tuple[Hint, ...]:
    """Drop the groups of quantities that wander, since a walk shows groups, too."""
    wandering = list_wandering_quantities(found)
    kept = []
    for hint in found:
        if hint.kind == HintKind.NEIGHBOURS or hint.quantity not in wandering:
            kept.append(hint)
    quantities = [hint.quantity for hint in found]
    return tuple(sorted(kept, key=lambda hint: quantities.index(hint.quantity)))


def list_wandering_quantities(hints: Sequence[Hint]) -> set[str]:
    """List the quantities whose errors wander along the run, according to the hints."""
    quantities = set()
    for hint in hints:
        if hint.kind == HintKind.NEIGHBOURS:
            quantities.add(hint.quantity)
    return quantities


def find_two_group_hint(quantity: str, errors: OrderedErrors) -> Hint | None:
    """Find two groups of trials that differ in a quantity.

    Parameters
    ----------
    quantity : str
        Of the quantity.
    errors : OrderedErrors

    Returns
    -------
    Hint or None
        None unless two normal distributions beat one by Schwarz's criterion and lie well apart.
    """
    from sklearn.mixture import GaussianMixture

    values = errors.values
    std = float(np.median(errors.std))
    scaled = ((values - np.median(values)) / np.std(values))[:, None]
    single = GaussianMixture(1, n_init=_GROUP_STARTS, random_state=0).fit(scaled)
    pair = GaussianMixture(2, n_init=_GROUP_STARTS, random_state=0).fit(scaled)
    gain = float(single.bic(scaled) - pair.bic(scaled))
    # errors below their own uncertainty are shrunk: their groups have no size
    spread = np.maximum(np.sqrt(pair.covariances_[:, 0, 0]), std / np.std(values))
    distance = abs(float(pair.means_[0, 0] - pair.means_[1, 0]))
    separation = distance * np.sqrt(2.0 / float(np.sum(spread**2)))
    least_share = float(pair.weights_.min())
    if gain < _GROUP_BIC or separation < _LEAST_SEPARATION or least_share < _LEAST_GROUP:
        return None
    in_low = pair.predict(scaled) == int(np.argmin(pair.means_[:, 0]))
    low = tuple(sorted(errors.rows[in_low].tolist()))
    high = tuple(sorted(errors.rows[~in_low].tolist()))
    apart = values[~in_low].mean() - values[in_low].mean()
    chance = float(np.exp(-0.5 * min(gain, _MOST_LOG_ODDS)))
    sentence = (
        f"{quantity} falls into two groups of {len(low)} and {len(high)} trials, {apart:.3g} apart"
    )
    return Hint(HintKind.GROUPS, quantity, chance, sentence, (low, high))


def make_neighbour_correlation_hint(quantity: str, errors_in_order: Floats) -> Hint:
    """Test whether trials that follow one another err together.

    Parameters
    ----------
    quantity : str
        Of the quantity.
    errors_in_order : Floats
        Shape (m,), its errors in the order of the run.

    Returns
    -------
    Hint
        With the p value of two tests together: Ljung and Box's, and that of a random walk.
    """
    from statsmodels.stats.diagnostic import acorr_ljungbox

    walk = fit_random_walk(errors_in_order)
    lags = min(_LAGS, len(errors_in_order) // 8)
    portmanteau_p = float(acorr_ljungbox(errors_in_order, lags=[lags])["lb_pvalue"].iloc[0])
    walk_p = 0.5 * float(stats.chi2.sf(walk.gain, 1))
    return make_wandering_hint(quantity, min(1.0, 2.0 * min(portmanteau_p, walk_p)))


def make_wandering_hint(quantity: str, p_value: float = 0.0) -> Hint:
    """Make the hint that a quantity wanders along the run."""
    sentence = f"{quantity} wanders: trials that follow one another err together"
    return Hint(HintKind.NEIGHBOURS, quantity, p_value, sentence)
