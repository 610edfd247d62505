"""Whether an extended model is adequate, and which trials and channels carry an effect."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.linalg import orth
from statsmodels.regression.linear_model import OLS

from stepblocks.lawsearch.fit import fit_with_effects
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.law import correct_p_values_by_holm
from stepblocks.lawsearch.problem import Fit, Problem

LEVEL = 0.005  # of the tests of residuals, after Holm
_MOST_LABELS = 8  # of a covariate that gets a column for each label
_MOST_POWERS = 4  # of a numeric covariate
_SPARE_TRIALS = 8  # trials more than a smooth has columns, from which a residual is tested
_LEAST_FREEDOM = 5  # degrees of freedom among replicates from which they tell a scatter


class Share(NamedTuple):
    """The trial or channel that carries most of a gain.

    Attributes
    ----------
    number : int
        Row of the trial, or number of the channel.
    share : float
        Of the gain.
    """

    number: int
    share: float


class LargestShares(NamedTuple):
    """The trial and the channel that carry most of a gain."""

    trial: Share
    channel: Share


class ResidualCheck(NamedTuple):
    """Test of one channel's residual against a smooth function of one covariate.

    Attributes
    ----------
    channel : str
    covariate : str
    p_value : float
        After Holm.
    """

    channel: str
    covariate: str
    p_value: float


class ResidualChecks(NamedTuple):
    """Tests of the residuals.

    Attributes
    ----------
    checks : tuple[ResidualCheck, ...]
    adequate : bool
        Whether the residual follows no covariate.
    """

    checks: tuple[ResidualCheck, ...]
    adequate: bool


@dataclass(frozen=True)
class ReplicateTest:
    """Test of a model's misfit against the scatter among replicates.

    Attributes
    ----------
    replicate_std : float
        Standard deviation among replicates; not-a-number where there are too few.
    replicate_dof : int
        Its degrees of freedom.
    lack_of_fit_p_value : float
        Not-a-number where there are too few replicates.
    """

    replicate_std: float
    replicate_dof: int
    lack_of_fit_p_value: float


@dataclass(frozen=True)
class HiddenChannel:
    """A fit that sees all channels but one.

    Attributes
    ----------
    problem : Problem
        Without the readings of the channel.
    fitted : Fit
        Of all effects.
    """

    problem: Problem
    fitted: Fit


def fit_without_each_channel(problem: Problem, current: Fit) -> list[HiddenChannel]:
    """Fit the effects of a fit again without the readings of each channel."""
    values = problem.trials.values
    fits = []
    for hidden in np.identity(len(values.T), dtype=np.bool_):
        trials = replace(problem.trials, values=np.where(hidden, np.nan, values))
        part = replace(problem, trials=trials).add_shared_errors(problem.common, current)
        fits.append(HiddenChannel(part, fit_with_effects(part, current.effects, current.values)))
    return fits


def find_largest_gain_shares(
    base: Fit, current: Fit, without_channel: Sequence[HiddenChannel]
) -> LargestShares:
    """Find the trial with the largest share of a gain, and the channel without which most is lost.

    Both are shares of the whole gain, of which constants that come nearer to their certificates
    may be the most. The shares of channels do not add up to one: what only two channels tell
    together is lost without either.

    Parameters
    ----------
    base : Fit
        Fit without an effect.
    current : Fit
        Fit with it.
    without_channel : sequence of HiddenChannel
        The latter without each channel; see `fit_without_each_channel`.
    """
    gain = max(base.cost - current.cost, 1e-12)
    by_value = (base.residual**2 - current.residual**2).reshape(current.predicted.shape)
    by_trial = by_value.sum(axis=1)
    gain_without = []
    for hidden in without_channel:
        without_effect = fit_with_effects(hidden.problem, base.effects, base.values)
        gain_without.append(without_effect.cost - hidden.fitted.cost)
    return LargestShares(
        trial=Share(int(np.argmax(by_trial)), float(by_trial.max()) / gain),
        channel=Share(int(np.argmin(gain_without)), 1.0 - min(gain_without) / gain),
    )


def run_residual_checks(problem: Problem, fitted: Fit) -> ResidualChecks:
    """Test the whitened residual of every channel against a smooth function of every covariate."""
    trials = problem.trials
    by_trial = fitted.residual.reshape(trials.values.shape)
    p_values: dict[tuple[str, str], float] = {}
    for name in trials.covariates:
        columns = build_smooth_columns(trials, name)
        if columns is None:
            continue
        for j, channel in enumerate(trials.channels):
            rows = trials.seen[:, j]
            if rows.sum() > columns.shape[1] + _SPARE_TRIALS:
                p_values[channel, name] = compute_smooth_p_value(by_trial[rows, j], columns[rows])
    if not p_values:
        return ResidualChecks((), True)
    corrected = correct_p_values_by_holm(list(p_values.values()))
    checks = []
    for (channel, name), p_value in zip(p_values, corrected, strict=True):
        checks.append(ResidualCheck(channel, name, float(p_value)))
    return ResidualChecks(tuple(checks), bool(corrected.min() > LEVEL))


def build_smooth_columns(trials: Trials, name: str) -> Floats | None:
    """Build the columns of a smooth function of a covariate.

    Parameters
    ----------
    trials : Trials
    name : str
        Of the covariate.

    Returns
    -------
    array of shape (n, p), or None
        Powers of the ranks of numbers, or a column for each label but the first; None where the
        covariate does not vary or has too many labels.
    """
    numbers = trials.numeric(name)
    if numbers is None:
        dummies = trials.dummies(name, most=_MOST_LABELS)
        return np.stack(dummies, axis=1) if dummies else None
    # counted, not told from the scatter: that of equal numbers may be a rounding error and no zero
    powers = min(_MOST_POWERS, len(np.unique(numbers)) - 1)
    if powers == 0 or not float(np.std(numbers)) < np.inf:
        return None
    x = (stats.rankdata(numbers) / len(numbers) - 0.5) * 2.0
    columns = [x**power for power in range(1, powers + 1)]
    return np.stack(columns, axis=1)


def compute_smooth_p_value(residual: Floats, columns: Floats) -> float:
    """Compute the p value of what columns explain of a residual beside its mean, by an F-test.

    Parameters
    ----------
    residual : Floats
        Shape (n,).
    columns : Floats
        Shape (n, p).

    Returns
    -------
    float
        1 where there is nothing to explain.
    """
    basis = orth(columns - columns.mean(axis=0))  # dependent columns count once
    fitted = OLS(residual, np.column_stack([np.ones(len(residual)), basis])).fit()
    if not (fitted.df_model > 0.0 and fitted.ssr > 0.0):
        return 1.0
    return float(fitted.f_pvalue)


def depends_on_covariates(values: Floats, trials: Trials) -> bool:
    """Tell whether a number of each trial, such as its chance to be bad, follows a covariate.

    `values` has the shape (n,).
    """
    p_values = []
    for name in trials.covariates:
        columns = build_smooth_columns(trials, name)
        if columns is not None:
            p_values.append(compute_smooth_p_value(values, columns))
    return len(p_values) * min(p_values, default=1.0) < LEVEL


def compare_misfit_with_replicates(
    residual: Floats, replicate_labels: Sequence[object], constant_count: int
) -> ReplicateTest:
    """Test the misfit of a model against the scatter among trials of equal settings.

    Parameters
    ----------
    residual : Floats
        Shape (n,), of one channel; NaN where it is unknown.
    replicate_labels : sequence
        Label of each trial; trials of equal labels are replicates.
    constant_count : int
        Number of constants of the model.
    """
    seen = np.isfinite(residual)
    values = residual[seen]
    labels = []
    for cell, is_seen in zip(replicate_labels, seen, strict=True):
        if is_seen:
            labels.append(str(cell))
    _, number = np.unique(labels, return_inverse=True)
    counts = np.bincount(number)
    dof = int(len(values) - len(counts))
    means = np.bincount(number, values) / counts
    inside = float(np.sum((values - means[number]) ** 2))
    # copies of one trial are no replicates
    if dof < _LEAST_FREEDOM or not inside > 0.0:
        return ReplicateTest(float("nan"), dof, float("nan"))
    between = max(len(counts) - constant_count, 1)
    ratio = (float(np.sum(counts * means**2)) / between) / (inside / dof)
    return ReplicateTest(
        replicate_std=float(np.sqrt(inside / dof)),
        replicate_dof=dof,
        lack_of_fit_p_value=float(stats.f.sf(ratio, between, dof)),
    )
