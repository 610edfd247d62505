"""Is the extended model enough? Residuals against every covariate, and misfit against pure error among replicates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from statsmodels.stats.multitest import multipletests

from stepblocks.loop.search.fit import Fit, Problem
from stepblocks.loop.search.trials import Floats, Trials

_LEVEL = 0.005


@dataclass(frozen=True)
class PureError:
    """Replicates: standard deviation among trials of equal settings, and the test of misfit against it."""

    std: float
    dof: int
    p_value: float


def _columns(trials: Trials, name: str) -> Floats | None:
    numbers = trials.numeric(name)
    if numbers is None:
        labels = np.unique(trials.covariates[name])
        if not 1 < len(labels) <= 8:
            return None
        return np.stack([np.asarray(trials.covariates[name] == label, float) for label in labels[1:]], axis=1)
    spread = float(np.std(numbers))
    if spread == 0.0 or not np.isfinite(spread):
        return None
    x = (stats.rankdata(numbers) / len(numbers) - 0.5) * 2.0
    powers = min(4, len(np.unique(numbers)) - 1)
    return np.stack([x ** (i + 1) for i in range(powers)], axis=1)


def independence(problem: Problem, fitted: Fit) -> tuple[tuple[tuple[str, str, float], ...], bool]:
    """Test the whitened residual of every channel against a smooth of every covariate."""
    trials = problem.trials
    by_trial = fitted.residual.reshape(trials.values.shape)
    named, raw = [], []
    for name in trials.covariates:
        columns = _columns(trials, name)
        if columns is None:
            continue
        for j, channel in enumerate(trials.channels):
            rows = trials.seen[:, j]
            if rows.sum() > columns.shape[1] + 8:
                named.append((channel, name))
                raw.append(_smooth_p(by_trial[rows, j], columns[rows]))
    if not raw:
        return (), True
    corrected = multipletests(raw, method="holm")[1]
    checks = tuple((c, v, float(p)) for (c, v), p in zip(named, corrected, strict=True))
    return checks, bool(corrected.min() > _LEVEL)


def _smooth_p(residual: Floats, columns: Floats) -> float:
    design = np.column_stack([np.ones(len(residual)), columns])
    solution, _, rank, _ = np.linalg.lstsq(design, residual, rcond=None)
    rest = residual - design @ solution
    dof = len(residual) - rank
    whole = float(np.sum((residual - residual.mean()) ** 2))
    left = float(np.sum(rest**2))
    if rank < 2 or left <= 0.0:
        return 1.0
    return float(stats.f.sf((whole - left) / (rank - 1) / (left / dof), rank - 1, dof))


def pure_error(residual: Floats, cells: Sequence[object], free: int) -> PureError:
    """Compare the misfit of a model with the scatter among replicates."""
    seen = np.isfinite(residual)
    values = residual[seen]
    _, inverse = np.unique([str(c) for c, s in zip(cells, seen, strict=True) if s], return_inverse=True)
    counts = np.bincount(inverse)
    dof = int(len(values) - len(counts))
    if dof < 5:
        return PureError(float("nan"), dof, float("nan"))
    means = np.bincount(inverse, values) / counts
    inside = float(np.sum((values - means[inverse]) ** 2))
    between = len(counts) - free
    misfit = float(np.sum(counts * means**2))
    if inside <= 0.0:
        # copies of one trial are no replicates
        return PureError(float("nan"), dof, float("nan"))
    ratio = (misfit / max(between, 1)) / (inside / dof)
    return PureError(float(np.sqrt(inside / dof)), dof, float(stats.f.sf(ratio, max(between, 1), dof)))
