"""The next trials: settings ranked by how well they separate two fitted models."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.law import Parameter, map_names_to_starts
from stepblocks.lawsearch.objective import STEP
from stepblocks.lawsearch.problem import Fit, Problem

CRITERION = "T-optimality: expected difference of twice the log likelihood per trial"
_MOST_REPEATS = 1000  # of a next trial
_DECISIVE = 12.0  # difference of twice the log likelihood: odds of 400 to 1
_LEAST_GAIN = 1e-3  # of the best setting, below which no setting separates the models
# share of a gain within which gains tie: a fit knows them no better, since its own tolerance is
# 1e-6 of the cost
_TIE = 1e-4


@dataclass(frozen=True)
class RankedSetting:
    """One setting of a next trial.

    Attributes
    ----------
    settings : dict[str, float | str]
        Values of the covariates that are shown.
    expected_gain : float
        Expected difference of twice the log likelihood of one trial.
    """

    settings: dict[str, float | str]
    expected_gain: float


@dataclass(frozen=True)
class Ranking:
    """Settings that separate two models.

    Attributes
    ----------
    settings : tuple[RankedSetting, ...]
        Best first.
    repeats : int
        Trials at the best setting after which the difference is expected to be decisive; 0 where
        no number of trials is enough.
    width_after : dict[str, float]
        Expected width of the interval of each parameter of the first model's effects after these
        trials, as a share of the width now.
    channel : str
        Channel that contributes most.
    """

    settings: tuple[RankedSetting, ...]
    repeats: int
    width_after: dict[str, float]
    channel: str


def rank_settings(
    problem: Problem,
    first: Fit,
    second: Fit,
    grid: Trials,
    shown_covariates: Sequence[str],
    setting_count: int = 4,
) -> Ranking | None:
    """Rank the settings of a grid by how well they separate two fitted models.

    Parameters
    ----------
    problem : Problem
    first, second : Fit
        The two models.
    grid : Trials
        Settings; nothing is measured in them.
    shown_covariates : sequence of str
        Covariates that are given for each setting.
    setting_count : int
        Settings that are kept.

    Returns
    -------
    Ranking or None
        None where no setting separates the models.
    """
    model = problem.model
    starts = map_names_to_starts(model.parameters(grid))
    ahead = model.predict(grid, starts | first.values, first.active_effects)
    difference = ahead - model.predict(grid, starts | second.values, second.active_effects)
    scatter = _compute_trial_covariance(problem, first, grid)
    unknown = _compute_unknown_shift(problem, first, grid, ahead)
    # what is unknown of a specimen is common to all its trials
    common = unknown[:, :, None] * unknown[:, None, :]
    solved = np.linalg.solve(scatter + common, difference[:, :, None])[:, :, 0]
    gain = np.sum(difference * solved, axis=1)
    known = np.isfinite(gain)
    if not np.any(known) or float(np.nanmax(gain)) < _LEAST_GAIN:
        return None
    gain = np.where(known, gain, 0.0)
    order = _order_rows_by_gain(gain)[:setting_count]
    best = order[0]
    repeats = _count_decisive_repeats(difference[best], scatter[best], common[best])
    by_channel = difference[best] ** 2 / np.diag(scatter[best])
    leading_channel = _order_rows_by_gain(by_channel)[0]
    setting = grid.take(np.array([best]))
    scatter_of_mean = scatter[best] / max(repeats, 1)
    settings = [_build_ranked_setting(grid, row, shown_covariates, gain) for row in order]
    return Ranking(
        settings=tuple(settings),
        repeats=repeats,
        width_after=_compute_relative_widths_after(problem, first, setting, scatter_of_mean),
        channel=problem.trials.channels[leading_channel],
    )


def _build_ranked_setting(
    grid: Trials, row: int, shown_covariates: Sequence[str], gains: Floats
) -> RankedSetting:
    """Return one row of a grid with its gain, as plain values of `shown_covariates`."""
    settings = {}
    for name in shown_covariates:
        settings[name] = grid.covariates[name][row].item()
    return RankedSetting(settings, float(gains[row]))


def _compute_trial_covariance(problem: Problem, fitted: Fit, grid: Trials) -> Floats:
    """Compute the covariance of one trial at each setting of a grid, shape (m, c, c)."""
    scatter = problem.noise.scatter
    starts = map_names_to_starts(problem.model.parameters(grid))
    responses = problem.model.responses(grid, starts | fitted.values, fitted.active_effects)
    std = np.where(problem.trials.seen, problem.trials.std, np.nan)
    typical = np.nan_to_num(np.nanmedian(std, axis=0), nan=1.0)
    covariance = np.einsum("nik,k,njk->nij", responses, scatter.quantities, responses)
    channels = range(len(problem.trials.channels))
    covariance[:, channels, channels] += scatter.channels + typical**2
    return np.asarray(covariance)


def _compute_unknown_shift(
    problem: Problem, fitted: Fit, grid: Trials, predicted: Floats
) -> Floats:
    """Compute by how much what is unknown of new specimens may move the prediction.

    The shift is that of one prior standard deviation, shape (m, c).
    """
    new = _list_unfitted_parameters(problem, fitted, grid)
    shifted = {}
    for parameter in new:
        shifted[parameter.name] = parameter.start + parameter.prior_std
    moved = problem.model.predict(grid, fitted.values | shifted, fitted.active_effects)
    return np.asarray(moved - predicted)


def _list_unfitted_parameters(problem: Problem, fitted: Fit, grid: Trials) -> list[Parameter]:
    """List the parameters of a grid that no trial has known yet, such as those of a new block."""
    new = []
    for parameter in problem.model.parameters(grid):
        if parameter.name not in fitted.values:
            new.append(parameter)
    return new


def _count_decisive_repeats(difference: Floats, scatter: Floats, common: Floats) -> int:
    """Count the trials after which a difference is expected to be decisive; 0: never.

    It never is where what is unknown of a specimen explains the difference as well. `difference`
    has the shape (c,); the covariances `scatter` of one trial and `common` of all have (c, c).
    """
    expected = []
    for n in range(1, _MOST_REPEATS):
        expected.append(difference @ np.linalg.solve(scatter / n + common, difference))
    if max(expected) < _DECISIVE:
        return 0
    return 1 + int(np.searchsorted(expected, _DECISIVE))


def _compute_relative_widths_after(
    problem: Problem, fitted: Fit, setting: Trials, scatter: Floats
) -> dict[str, float]:
    """Compute how wide the intervals of the effects are after trials at one setting.

    To first order the new trials are a step of a Kalman filter (1960, doi:10.1115/1.3662552).

    Parameters
    ----------
    problem : Problem
    fitted : Fit
    setting : Trials
        One row.
    scatter : Floats
        Shape (c, c), covariance of the mean of the new trials.

    Returns
    -------
    dict
        Width as a share of the width now, by ``law.parameter``; places of sudden changes are left
        out.
    """
    new = _list_unfitted_parameters(problem, fitted, setting)
    values = map_names_to_starts(new) | fitted.values
    ahead = replace(problem, trials=setting)
    base = ahead.predict(fitted.effects, values)[0]
    rows = []
    for p in (*fitted.parameters, *new):
        step = STEP * p.scale
        shifted = values | {p.name: values[p.name] + step}
        moved = ahead.predict(fitted.effects, shifted)[0]
        rows.append((moved - base) / step)
    slopes = np.array(rows)
    # the height of a block that is yet to be made is known by its prior alone
    prior_std = np.array([p.prior_std for p in new])
    before = block_diag(fitted.covariance, np.diag(prior_std**2))
    gained = before @ slopes
    after = before - gained @ np.linalg.solve(slopes.T @ gained + scatter, gained.T)
    shares = np.sqrt(np.diag(after) / np.maximum(np.diag(before), 1e-300))
    share_of = {}
    for p, share in zip(fitted.parameters, shares[: len(fitted.parameters)].tolist(), strict=True):
        share_of[p.name] = share
    widths = {}
    for law in fitted.effects:
        for name, share in law.pick_own_values(share_of).items():
            if name not in law.steps:
                widths[law.name_in_fit(name)] = share
    return widths


def _order_rows_by_gain(gains: Floats) -> list[int]:
    """Order the rows of gains of shape (m,), the largest first.

    Gains that tie with the largest of them keep the order of the grid, which begins with the least
    load.
    """
    remaining = np.argsort(-gains, kind="stable")
    order: list[int] = []
    while remaining.size:
        largest = gains[remaining[0]]
        tied = int(np.sum(gains[remaining] >= largest - _TIE * abs(largest)))
        order += sorted(remaining[:tied].tolist())
        remaining = remaining[tied:]
    return order
