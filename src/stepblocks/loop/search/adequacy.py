"""Whether the extended model is enough, and what no trial of this design can tell apart.

The first is asked of residuals against every covariate, and of the misfit against pure error among replicates; the second of
derivatives alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import networkx as nx
import numpy as np
from scipy import stats
from statsmodels.stats.multitest import multipletests

from stepblocks.loop.search.fit import Fit, Problem
from stepblocks.loop.search.forward_model import Effect, Floats, Trials
from stepblocks.loop.search.gate import tangent

_LEVEL = 0.005  # of the tests of residuals, after Holm
_SAME = 0.995  # cosine beyond which two effects imitate one another
_ABSORBED = 2e-3  # share of a direction below which constants imitate it


@dataclass(frozen=True)
class PureError:
    """Replicates: standard deviation among trials of equal settings, and the test of misfit against it."""

    std: float
    dof: int
    p_value: float


def _columns(trials: Trials, name: str) -> Floats | None:
    numbers = trials.numeric(name)
    if numbers is None:
        dummies = trials.dummies(name, most=8)
        return np.stack(dummies, axis=1) if dummies else None
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


@dataclass(frozen=True)
class Identifiability:
    """Groups that the design cannot tell apart."""

    absorbed: dict[str, tuple[str, ...]]  # effects that constants of the nominal model imitate, with those constants
    groups: tuple[tuple[str, ...], ...]  # effects that imitate one another beside the nominal model
    weak: tuple[str, ...]  # constants that the data leave open: their error stays that of the prior


def identifiability(problem: Problem, base: Fit, effects: Sequence[Effect]) -> Identifiability:
    """Compare the directions in which effects and constants move the prediction."""
    rows = base.residual.size
    length = np.maximum(np.linalg.norm(base.jacobian, axis=0), 1e-300)
    known, _ = np.linalg.qr(base.jacobian / length)
    directions: dict[str, Floats] = {}
    absorbed: dict[str, tuple[str, ...]] = {}
    for effect in effects:
        if len(effect.amplitudes) != 1:
            continue
        raw = tangent(problem, base, effect, effect.shapes[len(effect.shapes) // 2])[:, 0]
        full = np.concatenate([raw, np.zeros(base.jacobian.shape[0] - rows)])
        size = float(np.linalg.norm(full))
        if size < 1e-9:
            continue
        rest = full / size - known @ (known.T @ (full / size))
        left = float(np.linalg.norm(rest))
        if left < _ABSORBED:
            absorbed[effect.id] = _imitators(base, full / size)
        else:
            directions[effect.id] = rest / left
    return Identifiability(absorbed, _groups(directions), _weak(base))


def _imitators(base: Fit, direction: Floats) -> tuple[str, ...]:
    """Constants that a least-squares imitation of a direction moves most."""
    length = np.maximum(np.linalg.norm(base.jacobian, axis=0), 1e-300)
    weights = np.abs(np.linalg.lstsq(base.jacobian / length, direction, rcond=None)[0])
    order = np.argsort(-weights)
    return tuple(base.parameters[i].name for i in order if weights[i] > 0.2 * weights[order[0]])


def _groups(directions: dict[str, Floats]) -> tuple[tuple[str, ...], ...]:
    graph = nx.Graph()
    names = list(directions)
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            if abs(float(directions[first] @ directions[second])) > _SAME:
                graph.add_edge(first, second)
    return tuple(tuple(sorted(group)) for group in nx.connected_components(graph))


def _weak(base: Fit) -> tuple[str, ...]:
    return tuple(p.name for p in base.parameters if np.isfinite(p.prior_std) and base.std[p.name] > 0.9 * p.prior_std)
