"""The first gate: whether the trials show any effect at all.

Score statistics of all candidates are judged together by a bootstrap of their maximum.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from stepblocks.lawsearch.fit import (
    Fit,
    HopelessFitError,
    Problem,
    differentiate_size,
    fit,
    is_hopeless,
)
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import Law, SizedChange

# a direction of which less is left beside the nominal model is its derivative, up to rounding
_UNSEEN = 2e-3
_PLACES = 3  # of a jump, that its fit begins from
# chance, by Schwarz's criterion, with which an effect and the rivals named with it hold the truth
_GROUP = 0.95
_TOGETHER = 16  # effects or shapes in one product of matrices: all of them fill the memory

# of the prediction in the number by which a change moves every trial, and what a law follows, by
# the change, its step, and the covariate where the model computes it
Slopes = dict[tuple[Callable[..., object], float, str], tuple[Floats, NDArray[np.generic]]]
# an effect that may stand for another, its fit, and how far its criterion is behind
Rival = tuple[Law, Fit, float]


@dataclass(frozen=True)
class Score:
    """How a candidate would improve the fit, to first order.

    Attributes
    ----------
    effect : Law
    shape : Mapping[str, float]
        Values of its other parameters that did best.
    log_p : float
        Logarithm of its own p value.
    gain : float
        Fall of the cost.
    step : Floats
        Of the amplitudes.
    """

    effect: Law
    shape: Mapping[str, float]
    log_p: float
    gain: float
    step: Floats


@dataclass(frozen=True)
class Gate:
    """Outcome of the gate: its p value for the whole family, and the scores in order.

    Attributes
    ----------
    p_value : float
    scores : tuple[Score, ...]
    least_gain : float
        Of one amplitude, that opens the gate at a level.
    """

    p_value: float
    scores: tuple[Score, ...]
    least_gain: float = float("inf")


@dataclass(frozen=True)
class Direction:
    """How an effect shows in a design.

    Attributes
    ----------
    effect : Law
    shape : Mapping[str, float]
    basis : Floats
        Shape (n c + q, k), of what the design can see of it beside the nominal model.
    root : Floats
        From that basis to the amplitudes.
    one_sided : bool
        Its amplitude has one sign alone.
    """

    effect: Law
    shape: Mapping[str, float]
    basis: Floats
    root: Floats
    one_sided: bool


def compute_tangent(problem: Problem, base: Fit, effect: Law, shape: Mapping[str, float]) -> Floats:
    """Whitened change of the prediction per unit of each amplitude, in units of its scale.

    The shape is (n c, p).
    """
    return problem.noise.whiten(
        np.stack(_compute_changes(problem, base, effect, shape, {}), axis=2)
    )


def _compute_changes(
    problem: Problem, base: Fit, effect: Law, shape: Mapping[str, float], slopes: Slopes
) -> list[Floats]:
    # Change of the prediction per unit of each amplitude, in units of its scale; each has the shape
    # (n, c). What a trial shows depends on its own state alone: laws that change it by one number
    # per trial share its slope in that number.
    neutral = {p.name: p.start for p in effect.parameters} | dict(shape)
    asked = [p for p in effect.parameters if p.name in effect.amplitudes]
    effects, apply = [*base.effects, effect], effect.apply
    values = base.values | {f"{effect.id}.{name}": value for name, value in neutral.items()}
    if not isinstance(apply, SizedChange):
        moved = [values | {f"{effect.id}.{p.name}": p.start + 0.02 * p.scale} for p in asked]
        return [(problem.predict(effects, one) - base.predicted) / 0.02 for one in moved]
    step = 0.02 * asked[0].scale
    # what the model computes is seen only by a law that follows it
    known = problem.trials.covariates.get(effect.covariate)
    key = apply.change, step, effect.covariate if known is None else ""
    if key not in slopes:
        slopes[key] = differentiate_size(problem, effects, values, apply, base.predicted, step)
    slope, computed = slopes[key]
    column = computed if known is None else known
    return [
        slope * apply.size(column, neutral | {p.name: p.start + p.scale})[:, None] for p in asked
    ]


def compute_directions(
    problem: Problem, base: Fit, effects: Sequence[Law], known: Floats
) -> list[Direction]:
    """Find what the design sees of every effect and shape beside `known`, that of the constants.

    An effect that the constants imitate has none.
    """
    asked = [(effect, shape) for effect in effects for shape in effect.shapes]
    slopes: Slopes = {}
    return [
        direction
        for i in range(0, len(asked), _TOGETHER)
        for direction in _compute_together(problem, base, asked[i : i + _TOGETHER], known, slopes)
    ]


def _compute_together(
    problem: Problem,
    base: Fit,
    asked: Sequence[tuple[Law, Mapping[str, float]]],
    known: Floats,
    slopes: Slopes,
) -> list[Direction]:
    changes = [_compute_changes(problem, base, effect, shape, slopes) for effect, shape in asked]
    if not any(changes):
        return []
    last = np.cumsum([len(columns) for columns in changes])
    raw = problem.noise.whiten(np.stack([c for columns in changes for c in columns], axis=2))
    size = np.linalg.norm(raw, axis=0)
    alive = np.all(np.isfinite(raw), axis=0) & (size >= 1e-12)
    scaled = np.where(alive, raw / np.where(alive, size, 1.0), 0.0)
    full = np.vstack([scaled, np.zeros((known.shape[0] - len(raw), raw.shape[1]))])
    full -= known @ (known.T @ full)
    directions = []
    for (effect, shape), columns in zip(
        asked, np.split(np.arange(len(size)), last[:-1]), strict=True
    ):
        if not columns.size or not np.all(alive[columns]):
            continue
        own = full[:, columns[0] : columns[-1] + 1]
        squared, turn = np.linalg.eigh(own.T @ own)
        squared, turn = squared[::-1], turn[:, ::-1]
        kept = squared > _UNSEEN**2
        if not np.any(kept):
            continue
        part = turn[:, kept] / np.sqrt(squared[kept])
        bounded = len(effect.amplitudes) == 1 and any(
            p.name in effect.amplitudes and p.low >= p.start for p in effect.parameters
        )
        directions.append(Direction(effect, shape, own @ part, part / size[columns, None], bounded))
    return directions


def build_tangent_basis(base: Fit) -> Floats:
    """Build a basis of the directions in which the constants move the prediction."""
    length = np.linalg.norm(base.jacobian, axis=0)
    left, singular, _ = np.linalg.svd(
        base.jacobian / np.maximum(length, 1e-300), full_matrices=False
    )
    return np.asarray(left[:, singular > 1e-8 * singular[0]])


def _compute_gains(directions: Sequence[Direction], vectors: Floats) -> tuple[Floats, list[Floats]]:
    # Gains of all directions on all vectors, shape (d, m), and the projections on each direction.
    parts = []
    for i in range(0, len(directions), _TOGETHER):
        bases = [d.basis for d in directions[i : i + _TOGETHER]]
        ends = np.cumsum([basis.shape[1] for basis in bases[:-1]])
        parts += np.split(np.concatenate(bases, axis=1).T @ vectors, ends)
    gains = np.stack([np.sum(part**2, axis=0) for part in parts])
    for d, gain, part in zip(directions, gains, parts, strict=True):
        if d.one_sided:
            gain *= (d.root[0] @ part) > 0.0
    return gains, parts


def _compute_log_p(gains: Floats, freedom: Floats, noise_dof: float) -> Floats:
    found = np.asarray(stats.f.logsf(gains / freedom[:, None], freedom[:, None], noise_dof))
    # beyond the smallest number the leading term of the tail keeps the order
    return np.where(
        np.isneginf(found), -745.0 - 0.5 * noise_dof * np.log1p(gains / noise_dof), found
    )


def score_candidates(
    problem: Problem,
    base: Fit,
    effects: Sequence[Law],
    draws: int = 400,
    seed: int = 0,
    alpha: float = 0.01,
) -> Gate:
    """Score every candidate and judge the best against what noise would do."""
    known = build_tangent_basis(base)
    directions = compute_directions(problem, base, effects, known)
    if not directions:
        # what would open the gate of one candidate
        return Gate(1.0, (), float(stats.chi2.isf(alpha, 1)))
    observed = np.concatenate([base.residual, base.departure])
    observed -= known @ (known.T @ observed)
    dof = float(max(problem.noise.scatter.dof, 4))
    # scores are relative to the scatter found, never to less than the scatter expected
    alive = np.abs(base.residual[base.residual != 0.0])
    spread = max(1.0, float((1.4826 * np.median(alive)) ** 2)) if alive.size else 1.0
    gains, projected = _compute_gains(directions, observed[:, None])
    freedom = np.array([d.basis.shape[1] for d in directions], dtype=float)
    own = _compute_log_p(gains / spread, freedom, dof)[:, 0]
    best: dict[str, Score] = {}
    for d, log_p, gain, part in zip(
        directions, own.tolist(), gains[:, 0].tolist(), projected, strict=True
    ):
        if d.effect.id not in best or log_p < best[d.effect.id].log_p:
            best[d.effect.id] = Score(d.effect, d.shape, log_p, gain, d.root @ part[:, 0])
    scores = tuple(sorted(best.values(), key=lambda s: s.log_p))
    if not draws:
        return Gate(1.0, scores)
    null, _ = _compute_gains(directions, _draw_noise(problem, base, draws, seed))
    # among directions of equal freedom the least p of a draw is that of the largest gain
    kinds = np.unique(freedom)
    least = _compute_log_p(
        np.stack([null[freedom == kind].max(axis=0) for kind in kinds]), kinds, dof
    ).min(axis=0)
    needed = float(stats.f.isf(np.exp(np.quantile(least, alpha)), 1.0, dof)) * spread
    return Gate(float((1 + np.sum(least <= own.min())) / (draws + 1)), scores, needed)


def compute_detectable(
    problem: Problem, base: Fit, effects: Sequence[Law], needed: float
) -> dict[str, float]:
    """Return the amplitude at which each effect opens the gate nine times in ten.

    These are the effects of one amplitude.
    """
    # the root of its expected gain exceeds that of the gain that opens the gate by 1.28 standard
    # deviations
    asked = [e for e in effects if len(e.amplitudes) == 1]
    found: dict[str, float] = {}
    for direction in compute_directions(problem, base, asked, build_tangent_basis(base)):
        scale = next(
            p.scale for p in direction.effect.parameters if p.name == direction.effect.amplitudes[0]
        )
        size = (np.sqrt(needed) + 1.2816) * float(np.linalg.norm(direction.root)) * scale
        found[direction.effect.id] = min(size, found.get(direction.effect.id, np.inf))
    return found


def _draw_noise(problem: Problem, base: Fit, draws: int, seed: int) -> Floats:
    # Noise of the design: residual vectors of whole trials at unit variance, shuffled and signed.
    generator = np.random.default_rng(seed)
    seen = problem.trials.seen
    n, count, total = len(seen), seen.size, len(base.jacobian)
    by_trial = base.residual.reshape(seen.shape)
    # tails are those of the residuals; one that is a sheer misfit counts no more than four
    # deviations
    pool = np.clip(
        by_trial
        / np.maximum(np.sqrt(np.sum(by_trial**2, axis=0) / np.maximum(seen.sum(axis=0), 1)), 1e-12),
        -4.0,
        4.0,
    )
    shuffled = pool[generator.integers(0, n, (draws, n))]
    signed = np.where(seen, shuffled * generator.choice([-1.0, 1.0], (draws, n, 1)), 0.0)
    return np.vstack(
        [signed.reshape(draws, count).T, generator.standard_normal((total - count, draws))]
    )


def choose_candidate(
    problem: Problem,
    base: Fit,
    opened: Gate,
    most: int = 14,
    tie: float = 6.0,
    known: Sequence[Fit] = (),
) -> tuple[Fit, list[Fit]] | None:
    """Fit the candidates that score best and choose among them and those whose fits are known.

    The result holds the choice, and all of them in order. A candidate is the last of the effects
    of its fit.
    """
    tried = list(known)
    for score in sorted(_select_candidates(opened.scores, most), key=lambda s: -s.gain):
        # what gains far less to first order than another gained in full cannot lead
        rival = min([base.cost, *(one.cost for one in tried)])
        if is_hopeless(score.gain, base.cost - rival):
            continue
        fitted = _fit_candidate(problem, base, score, rival)
        if fitted is not None and not _is_at_bound(score.effect, fitted):
            tried.append(fitted)
    tried.sort(key=lambda t: (t.criterion, t.effects[-1].rank))
    if not tried or tried[0].criterion >= base.criterion:
        return None
    lead = tried[0]
    near = [
        t
        for t in tried
        if t.criterion <= lead.criterion + tie and t.effects[-1].place == lead.effects[-1].place
    ]
    if named := [t for t in near if t.effects[-1].named]:
        close = [t for t in named if t.criterion <= named[0].criterion + 1.0]
        lead = min(close, key=lambda t: (t.effects[-1].rank, t.criterion))
    return lead, tried


def _select_candidates(scores: Sequence[Score], most: int) -> list[Score]:
    named = [s for s in scores if s.effect.named][:most]
    smooth = [s for s in scores if not s.effect.named]
    # the first smooth of each further place stands for that place
    places = {s.effect.place: s for s in reversed(smooth)}
    leading = {s.effect.place for s in smooth[:most]}
    more = [s for s in smooth if s is places[s.effect.place] and s.effect.place not in leading][
        : most // 2
    ]
    return [*named, *smooth[:most], *more]


def _is_at_bound(effect: Law, fitted: Fit) -> bool:
    # Whether a law was driven to the end of its form. A settling that never settles is a drift, not
    # a running-in.
    own = effect.pick_own_values(fitted.values)
    shapes = (
        [p for p in effect.parameters if p.name not in effect.amplitudes] if effect.named else []
    )
    reach = [(p.low, p.high, 0.01 * (p.high - p.low), own[p.name]) for p in shapes]
    return any(not low + 0.1 * slack < value < high - slack for low, high, slack, value in reach)


def _fit_candidate(problem: Problem, base: Fit, score: Score, rival: float) -> Fit | None:
    effect = score.effect
    held = np.clip(score.step, -8.0, 8.0)
    steps = dict(zip(effect.amplitudes, held.tolist(), strict=True))
    # the constants give way to first order, so that the fit begins near its valley
    moved = compute_tangent(problem, base, effect, score.shape) @ held
    way = base.covariance @ (
        base.jacobian[: len(moved)].T @ moved / [p.scale for p in base.parameters]
    )
    start = {
        p.name: base.values[p.name] - shift
        for p, shift in zip(base.parameters, way.tolist(), strict=True)
    } | {
        f"{effect.id}.{p.name}": p.start + steps[p.name] * p.scale
        if p.name in steps
        else score.shape.get(p.name, p.start)
        for p in effect.parameters
    }
    try:
        found = fit(problem, (*base.effects, effect), start, 25, rival)
        return _try_places(problem, found, effect) if effect.steps else found
    except (np.linalg.LinAlgError, ValueError, FloatingPointError, HopelessFitError):
        return None


def _try_places(problem: Problem, found: Fit, effect: Law) -> Fit:
    # Fit a jump from the places that suit its size next best, too: the cost has a valley between
    # any two trials, and the deepest need not be where the first order has it
    places = [
        found.values | {f"{effect.id}.{name}": place for name, place in shape.items()}
        for shape in effect.shapes
    ]
    costs = [
        np.sum(
            problem.noise.whiten(problem.trials.values - problem.predict(found.effects, one)) ** 2
        )
        for one in places
    ]
    order = np.argsort(np.round(costs, 3), kind="stable")  # last bits decide nothing
    return min(
        [found, *(fit(problem, found.effects, places[i], 25) for i in order[1:_PLACES])],
        key=lambda one: one.criterion,
    )


def select_likeliest(rivals: Sequence[Rival], always: Sequence[Rival]) -> tuple[Rival, ...]:
    """Return the likeliest rivals of an effect, and those in `always`.

    As many are kept as hold the truth together with the effect by `_GROUP`.
    """
    odds = np.exp([-0.5 * behind for _, _, behind in rivals])
    before = (1.0 + np.cumsum(odds) - odds) / (1.0 + odds.sum())
    return tuple(
        r for r, share in zip(rivals, before, strict=True) if share < _GROUP or r in always
    )
