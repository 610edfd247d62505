"""Deployed error: what the nominal and the extended model would have been wrong by on trials that chose neither."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.loop.search.explain import problem_of
from stepblocks.loop.search.fit import Problem, fit
from stepblocks.loop.search.forward_model import Effect, Floats, ForwardModel, Trials

Rows = NDArray[np.intp]
Select = Callable[[Trials], Sequence[Effect]]


@dataclass(frozen=True)
class Holdout:
    """Errors on held-out trials, measured less predicted; not-a-number where a trial was never held out."""

    nominal: Floats  # shape (n, c)
    extended: Floats  # shape (n, c)
    selected: tuple[tuple[str, ...], ...]  # effects that each fold chose

    def rms(self, channel: int) -> tuple[float, float]:
        """Root mean square of both errors in one channel; not-a-number where nothing was held out."""
        seen = [error[np.isfinite(error[:, channel]), channel] for error in (self.nominal, self.extended)]
        nominal, extended = (float(np.sqrt(np.mean(e**2))) if e.size else float("nan") for e in seen)
        return nominal, extended


def folds_within_blocks(trials: Trials, folds: int, seed: int = 0) -> list[Rows]:
    """Split trials so that each fold holds some of every block."""
    generator = np.random.default_rng(seed)
    fold = np.empty(len(trials), dtype=int)
    offset = 0
    for block in np.unique(trials.block):
        rows = generator.permutation(np.flatnonzero(trials.block == block))
        fold[rows] = (np.arange(len(rows)) + offset) % folds
        offset += len(rows)
    return [np.flatnonzero(fold == i) for i in range(folds)]


def folds_of_blocks(trials: Trials, most: int) -> list[Rows]:
    """Split trials so that each fold holds whole blocks, at most so many folds."""
    _, number = np.unique(trials.block, return_inverse=True)
    return [np.flatnonzero(number % most == i) for i in range(min(most, int(number.max()) + 1))]


def hold_out(model: ForwardModel, trials: Trials, rows: Rows, select: Select) -> Holdout:
    """Select and fit without one fold, and predict it; the errors of its trials alone."""
    train, test = trials.take(np.setdiff1d(np.arange(len(trials)), rows)), trials.take(rows)
    effects = tuple(select(train))
    problem = problem_of(model, train)
    base = fit(problem)
    best = fit(problem, effects, base.values) if effects else base
    # a block that was never seen keeps its prior height
    starts = {p.name: p.start for p in model.parameters(test)}
    ahead = Problem(model, test, problem.noise)
    nominal, extended = (test.values - ahead.predict(f.effects, starts | f.values) for f in (base, best))
    return Holdout(nominal, extended, (tuple(e.id for e in effects),))


def gather(trials: Trials, folds: Sequence[Rows], parts: Iterable[Holdout]) -> Holdout:
    """Bring the errors of folds into the order of the trials."""
    nominal, extended = (np.full(trials.values.shape, np.nan) for _ in range(2))
    selected: list[tuple[str, ...]] = []
    for rows, part in zip(folds, parts, strict=True):
        nominal[rows], extended[rows] = part.nominal, part.extended
        selected.extend(part.selected)
    return Holdout(nominal, extended, tuple(selected))
