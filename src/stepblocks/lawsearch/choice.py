"""Choice among candidates: full fits of those that score best, and the rivals of the best fit."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from stepblocks.lawsearch.directions import compute_tangent
from stepblocks.lawsearch.fit import fit_with_effects
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.gate import Gate, Score, score_candidates
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.objective import HopelessFitError, is_hopeless
from stepblocks.lawsearch.problem import Fit, Problem, compute_effect_price

_EVALUATIONS = 25  # of the model in the fit of a candidate, at most
_FIRST_STEP = 8.0  # of an amplitude, at most, in units of its scale
_PLACES_TRIED = 3  # of a sudden change, from which its fit begins
# of the range, to either side of a fitted place, in which the readings are tried one by one
_SEARCHED_SHARE = 0.1
_PLACES_AT_ONCE = 16  # that are tried of those, evenly spread, before the next finer round
_GAIN_BY_PLACE = 3.0  # by which the gain of a sudden change may grow where its places are sought
_COST_DIGITS = 3  # to which costs are compared: last bits decide nothing
_AT_BOUND = 0.01  # share of a parameter's range within which it counts as driven to its bound
_CLOSE = 1.0  # of the criterion, within which the preferred of two named laws leads
# chance, by Schwarz's criterion, with which an effect and the rivals named with it hold the truth
_GROUP_CHANCE = 0.95


class Rival(NamedTuple):
    """An effect that may stand for another.

    Attributes
    ----------
    effect : Law
    fitted : Fit
        Fit with it in the place of the other.
    behind : float
        How far the criterion of that fit is behind.
    """

    effect: Law
    fitted: Fit
    behind: float


@dataclass(frozen=True)
class Choice:
    """The candidate that leads.

    Attributes
    ----------
    lead : Fit
        Its effect is the last of the effects of the fit.
    tried : tuple[Fit, ...]
        All candidates that were fitted, best first.
    """

    lead: Fit
    tried: tuple[Fit, ...]

    @property
    def effect(self) -> Law:
        """The candidate itself."""
        return self.lead.effects[-1]


def choose_candidate(
    problem: Problem,
    base: Fit,
    opened: Gate,
    fit_limit: int = 14,
    criterion_tolerance: float = 6.0,
    known_fits: Sequence[Fit] = (),
) -> Choice | None:
    """Fit the candidates that score best, and choose among them and fits that are known.

    Parameters
    ----------
    problem : Problem
    base : Fit
        Fit without any of the candidates.
    opened : Gate
        Scores of the candidates.
    fit_limit : int
        Laws, and as many smooths, that are fitted.
    criterion_tolerance : float
        Of the criterion, within which a named law leads a smooth of its place.
    known_fits : sequence of Fit
        Fits of further candidates.

    Returns
    -------
    Choice or None
        None where no candidate improves the criterion.
    """
    tried = list(known_fits)
    rival = base.criterion
    for known_fit in known_fits:
        rival = min(rival, known_fit.criterion)
    by_gain = sorted(_select_scores(opened.scores, fit_limit), key=lambda score: -score.gain)
    for coarse_score in by_gain:
        score = coarse_score
        price = compute_effect_price((*base.effects, score.effect), len(problem.trials))
        lacking = base.cost + price - rival
        if not is_hopeless(_GAIN_BY_PLACE * score.gain, lacking):
            score = _rescore_at_best_jump_places(problem, base, score)
        # what gains far less to first order than another gained in full cannot lead
        if is_hopeless(score.gain, lacking):
            continue
        fitted = _fit_candidate(problem, base, score, rival)
        if fitted is not None and not _has_shape_parameter_at_bound(score.effect, fitted):
            tried.append(fitted)
            rival = min(rival, fitted.criterion)
    tried.sort(key=lambda fitted: (fitted.criterion, fitted.effects[-1].rank))
    if not tried or tried[0].criterion >= base.criterion:
        return None
    return Choice(_prefer_named_law(tried, criterion_tolerance), tuple(tried))


def _prefer_named_law(tried: Sequence[Fit], criterion_tolerance: float) -> Fit:
    """Return the best fit, or that of a named law of its place that does about as well."""
    best = tried[0]
    place = best.effects[-1].place
    named = []
    for fitted in tried:
        law = fitted.effects[-1]
        if (
            law.named
            and law.place == place
            and fitted.criterion <= best.criterion + criterion_tolerance
        ):
            named.append(fitted)
    if not named:
        return best
    most_criterion = named[0].criterion + _CLOSE
    close = [fitted for fitted in named if fitted.criterion <= most_criterion]
    return min(close, key=lambda fitted: (fitted.effects[-1].rank, fitted.criterion))


def _select_scores(scores: Sequence[Score], fit_limit: int) -> list[Score]:
    """Select the laws and the smooths that are worth a fit; `scores` are in order, best first.

    Beside the best smooths, the best of each further place stands for that place.
    """
    named: list[Score] = []
    smooth: list[Score] = []
    further: list[Score] = []
    places = set()
    for score in scores:
        place = score.effect.place
        if score.effect.named:
            named.append(score)
        elif len(smooth) < fit_limit:
            smooth.append(score)
            places.add(place)
        elif place not in places:
            further.append(score)
            places.add(place)
    return [*named[:fit_limit], *smooth, *further[: fit_limit // 2]]


def _has_shape_parameter_at_bound(effect: Law, fitted: Fit) -> bool:
    """Tell whether a shape parameter of a named law was driven to the end of its range.

    A settling that never settles is a drift and no running-in.
    """
    if not effect.named:
        return False
    values = effect.pick_own_values(fitted.values)
    for p in effect.parameters:
        if p.name in effect.amplitudes:
            continue
        slack = _AT_BOUND * (p.high - p.low)
        # close to its lower end a length or a time counts in smaller steps
        inside = p.low + 0.1 * slack < values[p.name] < p.high - slack
        if not inside:
            return True
    return False


def _fit_candidate(problem: Problem, base: Fit, score: Score, rival_criterion: float) -> Fit | None:
    """Fit a candidate beside a base fit from where the first order has it.

    The result is None where the fit fails, or stays far behind the criterion of a rival.
    """
    effect = score.effect
    step = np.clip(score.step, -_FIRST_STEP, _FIRST_STEP)
    # the constants give way to first order, so that the fit begins near its valley
    change = compute_tangent(problem, base, effect, score.shape) @ step
    shift = base.covariance @ (base.jacobian[: len(change)].T @ change / base.scales)
    start = {}
    for p, of_constant in zip(base.parameters, shift.tolist(), strict=True):
        start[p.name] = base.values[p.name] - of_constant
    steps = dict(zip(effect.amplitudes, step.tolist(), strict=True))
    for p in effect.parameters:
        name = effect.name_in_fit(p.name)
        if p.name in steps:
            start[name] = p.start + steps[p.name] * p.scale
        else:
            start[name] = score.shape.get(p.name, p.start)
    try:
        found = fit_with_effects(
            problem, (*base.effects, effect), start, _EVALUATIONS, rival_criterion
        )
        # a change that lies far behind at its likeliest place does not lead from another one
        if effect.steps and not is_hopeless(0.0, found.criterion - rival_criterion):
            found = _fit_from_further_jump_places(problem, found, effect)
    except (np.linalg.LinAlgError, ValueError, FloatingPointError, HopelessFitError):
        return None
    return found


def _fit_from_further_jump_places(problem: Problem, found: Fit, effect: Law) -> Fit:
    """Fit a sudden change from the places that suit its size next best, and return the best fit.

    The cost has a valley between any two trials, and the deepest one need not be where the first
    order has it.
    """
    starts, costs = [], []
    for shape in effect.shapes:
        start = found.values | effect.name_values(shape)
        starts.append(start)
        costs.append(_compute_residual_cost(problem, found, start))
    order = np.argsort(np.round(costs, _COST_DIGITS), kind="stable")
    fits = [found]
    for i in order[1:_PLACES_TRIED]:
        with suppress(HopelessFitError):
            fits.append(
                fit_with_effects(problem, found.effects, starts[i], _EVALUATIONS, found.criterion)
            )
    return min(fits, key=lambda fitted: fitted.criterion)


def _rescore_at_best_jump_places(problem: Problem, base: Fit, score: Score) -> Score:
    """Score a sudden change at the readings about the places at which it was scored.

    Those places may lie many readings apart, and a fit sees no further than to the next reading.
    Any other law keeps its score.
    """
    best = score
    for name in score.effect.steps:
        places = _list_jump_places_nearby(problem, score.effect, best.shape, name)
        best = _rescore_at_best_jump_place(problem, base, best, name, places)
    return best


def _rescore_at_best_jump_place(
    problem: Problem, base: Fit, score: Score, jump_parameter: str, places: Floats
) -> Score:
    """Score a sudden change at several places, from coarse to fine.

    Parameters
    ----------
    problem : Problem
    base : Fit
    score : Score
        Whose other places stay; it is the result where no place gains more.
    jump_parameter : str
        Of the place.
    places : array of shape (n,)
        In order.
    """
    law = score.effect
    best = score
    stride = len(places)
    while stride > 1:
        stride = max(1, len(places) // _PLACES_AT_ONCE)
        shapes = []
        for place in places[::stride].tolist():
            shapes.append({**score.shape, jump_parameter: place})
        scores = score_candidates(problem, base, [replace(law, shapes=tuple(shapes))], draws=0)
        leading = scores.scores[:1]
        if not leading or leading[0].gain <= best.gain:
            return best
        best = replace(leading[0], effect=law)
        found = int(np.searchsorted(places, best.shape[jump_parameter]))
        places = places[max(found - stride, 0) : found + stride + 1]
    return best


def _list_jump_places_nearby(
    problem: Problem, law: Law, shape_values: Mapping[str, float], jump_parameter: str
) -> Floats:
    """List the middles between neighbouring readings near one place of a sudden change.

    They lie between the places before and after it. The shape is (n,), empty for labels.
    """
    column = problem.trials.covariates.get(law.covariate)
    if column is None:
        return np.empty(0)
    numbers = problem.trials.numeric(law.covariate)
    if numbers is None:
        return np.empty(0)
    readings = np.unique(numbers[np.isfinite(numbers)])
    middles = 0.5 * (readings[1:] + readings[:-1])
    is_near = np.abs(middles - shape_values[jump_parameter]) <= _SEARCHED_SHARE * (
        readings[-1] - readings[0]
    )
    for step in law.steps:
        if shape_values[step] < shape_values[jump_parameter]:
            is_near &= middles > shape_values[step]
        elif shape_values[step] > shape_values[jump_parameter]:
            is_near &= middles < shape_values[step]
    return np.asarray(middles[is_near])


def _compute_residual_cost(
    problem: Problem, found: Fit, parameter_values: Mapping[str, float]
) -> float:
    """Return the sum of squares of the whitened residuals of a fit at other values."""
    residual = problem.trials.values - problem.predict(found.effects, parameter_values)
    return float(np.sum(problem.noise.whiten(residual) ** 2))


def select_likeliest_rivals(
    rivals: Sequence[Rival], always_kept: Sequence[Rival]
) -> tuple[Rival, ...]:
    """Select as many rivals of an effect as hold the truth together with it by 95 %.

    Parameters
    ----------
    rivals : sequence of Rival
        In order, the likeliest first.
    always_kept : sequence of Rival
        Those among them that are kept however unlikely.
    """
    behind = np.array([rival.behind for rival in rivals])
    odds = np.exp(-0.5 * behind)
    # chance of the effect and all rivals before each one
    chance_before = (1.0 + np.cumsum(odds) - odds) / (1.0 + odds.sum())
    kept = []
    for rival, chance in zip(rivals, chance_before, strict=True):
        if chance < _GROUP_CHANCE or rival in always_kept:
            kept.append(rival)
    return tuple(kept)
