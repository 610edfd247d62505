"""The next experiment: settings where rivals differ most, in units of the noise (T-optimality)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.loop.search.fit import Fit, Problem
from stepblocks.loop.search.forward_model import Effect, Floats, Trials

_TIE = 1e-4  # a fit knows its gain no better: its own tolerance is 1e-6 of the cost

Rival = tuple[Sequence[Effect], Fit]  # effects of a rival model and its fit


@dataclass(frozen=True)
class Proposal:
    """Settings that separate rivals."""

    # covariates of the trials to make, best first; where gains are one to 1e-4, in the order of the grid
    settings: tuple[dict[str, float | str], ...]
    gain: tuple[float, ...]  # expected difference of twice the log likelihood per trial at each
    trials: int  # at the best settings after which the difference is expected to reach 12 (odds of 400 to 1)
    channel: str  # the one that contributes most


def propose(
    problem: Problem, first: Rival, second: Rival, grid: Trials, shown: Sequence[str], count: int = 4
) -> Proposal | None:
    """Rank settings by how well they separate two fitted models."""
    starts = {p.name: p.start for p in problem.model.parameters(grid)}
    ahead = [_predict(problem, grid, rival, starts) for rival in (first, second)]
    scatter = problem.noise.scatter
    responses = problem.model.responses(grid, starts | first[1].values, _active(first))
    typical = np.nanmedian(np.where(problem.trials.seen, problem.trials.std, np.nan), axis=0)
    covariance = np.einsum("nik,k,njk->nij", responses, scatter.quantities, responses)
    c = len(problem.trials.channels)
    covariance[:, range(c), range(c)] += scatter.channels + np.nan_to_num(typical, nan=1.0) ** 2
    difference = ahead[0] - ahead[1]
    solved = np.linalg.solve(covariance, difference[:, :, None])[:, :, 0]
    gain = np.sum(difference * solved, axis=1)
    if not np.any(np.isfinite(gain)) or float(np.nanmax(gain)) < 1e-3:
        return None
    gain = np.where(np.isfinite(gain), gain, 0.0)
    order = _best_first(gain)[:count]
    own = difference**2 / covariance[:, range(c), range(c)]
    return Proposal(
        settings=tuple({name: _plain(grid.covariates[name][i]) for name in shown} for i in order),
        gain=tuple(float(gain[i]) for i in order),
        trials=int(np.ceil(12.0 / float(gain[order[0]]))),
        channel=problem.trials.channels[_best_first(own[order[0]])[0]],
    )


def _best_first(gain: Floats) -> list[int]:
    """Order by gain; gains within `_TIE` of the best of them are one, and the first of the grid leads: the least load."""
    left = np.argsort(-gain, kind="stable")
    order: list[int] = []
    while left.size:
        tied = int(np.sum(gain[left] >= gain[left[0]] - _TIE * abs(gain[left[0]])))
        order += sorted(left[:tied].tolist())
        left = left[tied:]
    return order


def _active(rival: Rival) -> list[tuple[Effect, Mapping[str, float]]]:
    return [(e, e.own(rival[1].values)) for e in rival[0]]


def _predict(problem: Problem, grid: Trials, rival: Rival, starts: Mapping[str, float]) -> Floats:
    return problem.model.predict(grid, dict(starts) | rival[1].values, _active(rival))


def _plain(value: object) -> float | str:
    return float(value) if isinstance(value, int | float | np.floating | np.integer) else str(value)
