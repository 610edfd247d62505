"""Which effect: full fits of the candidates that score best, and which of them the data cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.loop.search.fit import Fit, Problem, fit
from stepblocks.loop.search.forward_model import Effect
from stepblocks.loop.search.gate import Gate, Score


@dataclass(frozen=True)
class Trial:
    """A candidate with its full fit and its criterion, cost plus ``p ln n``."""

    effect: Effect
    fit: Fit
    criterion: float


@dataclass(frozen=True)
class Choice:
    """The candidate chosen, and the others in order."""

    best: Trial
    tried: tuple[Trial, ...]


def choose(
    problem: Problem, base: Fit, opened: Gate, most: int = 14, tie: float = 6.0, keep: Sequence[str] = ()
) -> Choice | None:
    """Fit the candidates that score best and choose among them."""
    tried = []
    for score in _shortlist(opened.scores, most, keep):
        fitted = _refine(problem, base, score)
        if fitted is not None and not _driven_out(score.effect, fitted):
            tried.append(Trial(score.effect, fitted, problem.criterion(fitted)))
    if not tried:
        return None
    tried.sort(key=lambda t: (t.criterion, t.effect.rank))
    lead = tried[0]
    if lead.criterion >= problem.criterion(base):
        return None
    near = [t for t in tried if t.criterion <= lead.criterion + tie and t.effect.place == lead.effect.place]
    named = [t for t in near if t.effect.named]
    if named:
        close = [t for t in named if t.criterion <= named[0].criterion + 1.0]
        lead = min(close, key=lambda t: (t.effect.rank, t.criterion))
    return Choice(lead, tuple(tried))


def _shortlist(scores: Sequence[Score], most: int, keep: Sequence[str]) -> list[Score]:
    named = [s for s in scores if s.effect.named][:most]
    smooth = [s for s in scores if not s.effect.named][:most]
    # the first smooth of each place among the leaders stands for that place
    places = {s.effect.place for s in smooth}
    extra = [s for s in scores if s.effect.id in keep and s not in named and s not in smooth]
    more: list[Score] = []
    for s in scores:
        if not s.effect.named and s.effect.place not in places and len(more) < most // 2:
            places.add(s.effect.place)
            more.append(s)
    return [*named, *smooth, *more, *extra]


def _driven_out(effect: Effect, fitted: Fit) -> bool:
    """Whether a law was driven to the end of its form: a settling that never settles is a drift, not a running-in."""
    for parameter in effect.parameters:
        if effect.named and parameter.name not in effect.amplitudes:
            value, slack = fitted.values[f"{effect.id}.{parameter.name}"], 0.01 * (parameter.high - parameter.low)
            if not parameter.low + 0.1 * slack < value < parameter.high - slack:
                return True
    return False


def _refine(problem: Problem, base: Fit, score: Score) -> Fit | None:
    effect = score.effect
    start = dict(base.values)
    for parameter in effect.parameters:
        value = score.shape.get(parameter.name, parameter.start)
        if parameter.name in effect.amplitudes:
            step = float(score.step[effect.amplitudes.index(parameter.name)]) * parameter.scale
            value = parameter.start + float(np.clip(step, -8.0 * parameter.scale, 8.0 * parameter.scale))
        start[f"{effect.id}.{parameter.name}"] = value
    try:
        return fit(problem, (*base.effects, effect), start, evaluations=25)
    except (np.linalg.LinAlgError, ValueError, FloatingPointError):
        return None
