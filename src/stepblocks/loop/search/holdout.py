"""Deployed error: what the nominal and the extended model would have been wrong by on trials that chose neither."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.loop.search.effect import Effect, ForwardModel
from stepblocks.loop.search.explain import problem_of
from stepblocks.loop.search.fit import Problem, fit
from stepblocks.loop.search.trials import Floats, Trials

Select = Callable[[Trials], Sequence[Effect]]


@dataclass(frozen=True)
class Holdout:
    """Errors on held-out trials."""

    nominal: Floats  # shape (n, c); Measured less predicted; not-a-number where a trial was never held out
    extended: Floats
    selected: tuple[tuple[str, ...], ...]  # Effects that each fold chose

    def rms(self, channel: int) -> tuple[float, float]:
        """Root mean square of both errors in one channel."""
        found = []
        for error in (self.nominal, self.extended):
            column = error[np.isfinite(error[:, channel]), channel]
            found.append(float(np.sqrt(np.mean(column**2))) if column.size else float("nan"))
        return found[0], found[1]


def folds_within_blocks(trials: Trials, folds: int, seed: int = 0) -> list[np.ndarray[tuple[int], np.dtype[np.intp]]]:
    """Split trials so that each fold holds some of every block."""
    generator = np.random.default_rng(seed)
    fold = np.empty(len(trials), dtype=int)
    offset = 0
    for block in np.unique(trials.block):
        rows = generator.permutation(np.flatnonzero(trials.block == block))
        fold[rows] = (np.arange(len(rows)) + offset) % folds
        offset += len(rows)
    return [np.flatnonzero(fold == i) for i in range(folds)]


def blocks_left_out(trials: Trials) -> list[np.ndarray[tuple[int], np.dtype[np.intp]]]:
    """Return one fold per block."""
    return [np.flatnonzero(trials.block == block) for block in np.unique(trials.block)]


def held_out(
    model: ForwardModel, trials: Trials, folds: Sequence[np.ndarray[tuple[int], np.dtype[np.intp]]], select: Select
) -> Holdout:
    """Select and fit without each fold, predict it."""
    nominal, extended = np.full(trials.values.shape, np.nan), np.full(trials.values.shape, np.nan)
    chosen: list[tuple[str, ...]] = []
    for rows in folds:
        kept = np.setdiff1d(np.arange(len(trials)), rows)
        train, test = trials.take(kept), trials.take(rows)
        effects = tuple(select(train))
        problem = problem_of(model, train)
        base = fit(problem)
        best = fit(problem, effects, base.values) if effects else base
        # a block that was never seen keeps its prior height
        starts = {p.name: p.start for p in model.parameters(test)}
        nominal[rows] = test.values - Problem(model, test, problem.noise).predict((), starts | base.values)
        extended[rows] = test.values - Problem(model, test, problem.noise).predict(effects, starts | best.values)
        chosen.append(tuple(e.id for e in effects))
    return Holdout(nominal, extended, tuple(chosen))
