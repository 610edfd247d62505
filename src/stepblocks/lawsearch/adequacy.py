"""Whether the extended model is adequate, and what this design cannot tell apart.

It also ranks the trials that would tell it apart.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import networkx as nx
import numpy as np
from scipy import stats
from scipy.linalg import block_diag, orth
from statsmodels.regression.linear_model import OLS

from stepblocks.lawsearch.fit import STEP, Fit, Problem, fit
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.gate import build_tangent_basis, compute_directions, compute_tangent
from stepblocks.lawsearch.law import Law, correct_by_holm

LEVEL = 0.005  # of the tests of residuals, after Holm
_SAME = 0.995  # cosine beyond which two effects imitate one another
_MOST_REPEATS = 1000  # of a next trial
_TIE = 1e-4  # of gains; a fit knows them no better: its own tolerance is 1e-6 of the cost


def _smooth_columns(trials: Trials, name: str) -> Floats | None:
    numbers = trials.numeric(name)
    if numbers is None:
        dummies = trials.dummies(name, most=8)
        return np.stack(dummies, axis=1) if dummies else None
    # twenty times 0.4 scatter by 5e-17, and are one number
    powers = min(4, len(np.unique(numbers)) - 1)
    if powers == 0 or not float(np.std(numbers)) < np.inf:
        return None
    x = (stats.rankdata(numbers) / len(numbers) - 0.5) * 2.0
    return np.stack([x ** (i + 1) for i in range(powers)], axis=1)


def find_largest_shares(
    problem: Problem, base: Fit, current: Fit
) -> tuple[tuple[int, float], tuple[int, float]]:
    """Find the trial with the largest share of a gain, and the channel without which most is lost.

    Both are shares of the whole gain, of which constants that come nearer to their certificates
    may be the most. Those of channels do not add up to one: what only two of them tell together is
    lost without either.
    """
    values, gain = problem.trials.values, max(base.cost - current.cost, 1e-12)
    each = (base.residual**2 - current.residual**2).reshape(values.shape).sum(axis=1)
    left = []
    for hidden in np.identity(len(values.T), dtype=np.bool_):
        trials = replace(problem.trials, values=np.where(hidden, np.nan, values))
        part = replace(problem, trials=trials).add_shared_errors(problem.common, current)
        before, after = (fit(part, one.effects, one.values) for one in (base, current))
        left.append(before.cost - after.cost)
    return (int(np.argmax(each)), float(each.max()) / gain), (
        int(np.argmin(left)),
        1.0 - min(left) / gain,
    )


def check_residuals(
    problem: Problem, fitted: Fit
) -> tuple[tuple[tuple[str, str, float], ...], bool]:
    """Test the whitened residual of every channel against a smooth of every covariate."""
    trials = problem.trials
    by_trial = fitted.residual.reshape(trials.values.shape)
    found: dict[tuple[str, str], float] = {}
    for name in trials.covariates:
        columns = _smooth_columns(trials, name)
        if columns is None:
            continue
        for j, channel in enumerate(trials.channels):
            rows = trials.seen[:, j]
            if rows.sum() > columns.shape[1] + 8:
                found[channel, name] = compute_smooth_p(by_trial[rows, j], columns[rows])
    if not found:
        return (), True
    corrected = correct_by_holm(list(found.values()))
    return (
        tuple((*pair, float(p)) for pair, p in zip(found, corrected, strict=True)),
        bool(corrected.min() > LEVEL),
    )


def compute_smooth_p(residual: Floats, columns: Floats) -> float:
    """F-test of what some columns explain of a residual beside its mean; 1 where it has none."""
    basis = orth(columns - columns.mean(axis=0))  # columns that say the same count once
    fitted = OLS(residual, np.column_stack([np.ones(len(residual)), basis])).fit()
    return float(fitted.f_pvalue) if fitted.df_model > 0.0 and fitted.ssr > 0.0 else 1.0


def depends_on_settings(values: Floats, trials: Trials) -> bool:
    """Tell whether a number of each trial, such as its chance to be bad, follows a covariate."""
    columns = [_smooth_columns(trials, name) for name in trials.covariates]
    found = [compute_smooth_p(values, one) for one in columns if one is not None]
    return len(found) * min(found, default=1.0) < LEVEL


def compare_with_replicates(
    residual: Floats, cells: Sequence[object], free: int
) -> dict[str, float]:
    """Test the misfit of a model against the scatter among trials of equal settings.

    `free` is the number of its constants.
    """
    seen = np.isfinite(residual)
    values = residual[seen]
    _, inverse = np.unique(
        [str(c) for c, s in zip(cells, seen, strict=True) if s], return_inverse=True
    )
    counts = np.bincount(inverse)
    dof = int(len(values) - len(counts))
    means = np.bincount(inverse, values) / counts
    inside = float(np.sum((values - means[inverse]) ** 2))
    std = p_value = float("nan")
    # copies of one trial are no replicates
    if dof >= 5 and inside > 0.0:
        between = max(len(counts) - free, 1)
        ratio = (float(np.sum(counts * means**2)) / between) / (inside / dof)
        std, p_value = float(np.sqrt(inside / dof)), float(stats.f.sf(ratio, between, dof))
    return {"replicate_std": std, "replicate_dof": dof, "lack_of_fit_p_value": p_value}


def compare_directions(problem: Problem, base: Fit, effects: Sequence[Law]) -> dict[str, object]:
    """Compare the directions in which effects and constants move the prediction.

    Where they agree, the design cannot tell them apart.
    """
    scaled = base.jacobian / np.maximum(np.linalg.norm(base.jacobian, axis=0), 1e-300)
    asked = [
        replace(e, shapes=(e.shapes[len(e.shapes) // 2],))
        for e in effects
        if len(e.amplitudes) == 1
    ]
    directions = {
        d.effect.id: d.basis[:, 0]
        for d in compute_directions(problem, base, asked, build_tangent_basis(base))
    }
    absorbed: dict[str, tuple[str, ...]] = {}
    for effect in (e for e in asked if e.id not in directions):
        raw = compute_tangent(problem, base, effect, effect.shapes[0])[:, 0]
        if not np.any(raw):
            continue
        # the constants that a least-squares imitation moves most
        full = np.concatenate([raw, np.zeros(len(scaled) - len(raw))])
        weights = np.abs(np.linalg.lstsq(scaled, full, rcond=None)[0])
        most = [i for i in np.argsort(-weights) if weights[i] > 0.2 * weights.max()]
        absorbed[effect.id] = tuple(base.parameters[i].name for i in most)
    alike = nx.Graph(
        (one, other)
        for one, other in combinations(directions, 2)
        if abs(directions[one] @ directions[other]) > _SAME
    )
    return {
        "imitated_by_constants": absorbed,
        "cannot_be_told_apart": [sorted(group) for group in nx.connected_components(alike)],
        # the data leave these open: their error stays that of the prior
        "left_to_their_prior": [
            p.name
            for p in base.parameters
            if np.isfinite(p.prior_std) and base.std[p.name] > 0.9 * p.prior_std
        ],
    }


def rank_settings(
    problem: Problem, first: Fit, second: Fit, grid: Trials, shown: Sequence[str], count: int = 4
) -> dict[str, Any] | None:
    """Rank the settings of a grid by how well they separate two fitted models, best first.

    Beside them stands how wide the intervals of the first model's effects will then be.
    """
    starts = {p.name: p.start for p in problem.model.parameters(grid)}
    # the height of a block that is yet to be made is known by its prior alone
    beside = {
        p.name: p.start + p.prior_std
        for p in problem.model.parameters(grid)
        if p.name not in first.values
    }
    ahead = [
        problem.model.predict(grid, starts | rival.values, rival.active)
        for rival in (first, second)
    ]
    scatter = problem.noise.scatter
    responses = problem.model.responses(grid, starts | first.values, first.active)
    typical = np.nanmedian(np.where(problem.trials.seen, problem.trials.std, np.nan), axis=0)
    covariance = np.einsum("nik,k,njk->nij", responses, scatter.quantities, responses)
    c = len(problem.trials.channels)
    covariance[:, range(c), range(c)] += scatter.channels + np.nan_to_num(typical, nan=1.0) ** 2
    moved = problem.model.predict(grid, first.values | beside, first.active) - ahead[0]
    common = moved[:, :, None] * moved[:, None, :]
    difference = ahead[0] - ahead[1]
    solved = np.linalg.solve(covariance + common, difference[:, :, None])[:, :, 0]
    gain = np.sum(difference * solved, axis=1)
    if not np.any(np.isfinite(gain)) or float(np.nanmax(gain)) < 1e-3:
        return None
    gain = np.where(np.isfinite(gain), gain, 0.0)
    order = _order_by_gain(gain)[:count]
    best = order[0]
    own = difference**2 / covariance[:, range(c), range(c)]
    # of the best, after which the difference is expected to reach 12 (odds of 400 to 1); none does
    # where the unknown height of a block explains the difference as well
    reached = [
        difference[best] @ np.linalg.solve(covariance[best] / n + common[best], difference[best])
        for n in range(1, _MOST_REPEATS)
    ]
    repeats = 0 if max(reached) < 12.0 else 1 + int(np.searchsorted(reached, 12.0))
    return {
        "criterion": "T-optimality: expected difference of twice the log likelihood per trial",
        "trials": [
            {name: grid.covariates[name][i].item() for name in shown}
            | {"expected_gain": float(gain[i])}
            for i in order
        ],
        "repeats": repeats,
        # of the intervals of its effects, as a share of now
        "width_after": _compute_width_after(
            problem, first, grid.take(np.array([best])), covariance[best] / max(repeats, 1)
        ),
        "channel": problem.trials.channels[
            _order_by_gain(own[best])[0]
        ],  # the one that contributes most
    }


def _compute_width_after(
    problem: Problem, fitted: Fit, setting: Trials, scatter: Floats
) -> dict[str, float]:
    # Standard uncertainty of each parameter when the mean of trials at one setting is known as
    # well, over that of now: to first order, a step of a Kalman filter (1960,
    # doi:10.1115/1.3662552). The height of a block that is yet to be made is known by its prior.
    new = [p for p in problem.model.parameters(setting) if p.name not in fitted.values]
    values = {p.name: p.start for p in new} | fitted.values
    ahead = replace(problem, trials=setting)
    base = ahead.predict(fitted.effects, values)[0]
    slopes = np.array(
        [
            (ahead.predict(fitted.effects, values | {p.name: values[p.name] + step})[0] - base)
            / step
            for p, step in ((p, STEP * p.scale) for p in (*fitted.parameters, *new))
        ]
    )
    before = block_diag(fitted.covariance, np.diag([p.prior_std**2 for p in new]))
    moved = before @ slopes
    left = before - moved @ np.linalg.solve(slopes.T @ moved + scatter, moved.T)
    shares = np.sqrt(np.diag(left) / np.maximum(np.diag(before), 1e-300))
    widths = dict(zip((p.name for p in fitted.parameters), shares.tolist(), strict=False))
    return {
        f"{e.id}.{name}": share
        for e in fitted.effects
        for name, share in e.pick_own_values(widths).items()
        if name not in e.steps
    }


def _order_by_gain(gain: Floats) -> list[int]:
    # Order by gain. Gains within `_TIE` of the best of them count as equal, and the first of the
    # grid leads: the least load.
    left = np.argsort(-gain, kind="stable")
    order: list[int] = []
    while left.size:
        tied = int(np.sum(gain[left] >= gain[left[0]] - _TIE * abs(gain[left[0]])))
        order += sorted(left[:tied].tolist())
        left = left[tied:]
    return order
