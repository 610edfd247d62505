"""The gate: whether the trials show any effect at all.

Score statistics of all candidates are judged together by a bootstrap of their maximum.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from stepblocks.lawsearch.directions import (
    Direction,
    build_tangent_basis,
    compute_directions,
)
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.problem import Fit, Problem

_LEAST_FREEDOM = 4  # degrees of freedom with which a scatter counts at least
_MAD_TO_STD = 1.4826  # ratio of standard and median absolute deviation of a normal distribution
_LEAST_LOG = -745.0  # logarithm of the smallest number above zero
_MOST_DEVIATIONS = 4.0  # to which residuals are clipped before they are drawn as noise
_NINE_IN_TEN = 1.2816  # standard normal deviate that nine of ten fall below


@dataclass(frozen=True)
class Score:
    """How a candidate would improve the fit, to first order.

    Attributes
    ----------
    effect : Law
    shape : Mapping[str, float]
        Values of its shape parameters that score best.
    log_p : float
        Logarithm of its own p value.
    gain : float
        Fall of the cost.
    step : Floats
        Shape (a,), of the amplitudes in units of their scales.
    """

    effect: Law
    shape: Mapping[str, float]
    log_p: float
    gain: float
    step: Floats


@dataclass(frozen=True)
class Gate:
    """Outcome of the gate.

    Attributes
    ----------
    p_value : float
        Of the whole family of candidates.
    scores : tuple[Score, ...]
        Best first.
    least_gain : float
        Of one amplitude that opens the gate.
    """

    p_value: float
    scores: tuple[Score, ...]
    least_gain: float = float("inf")


def score_candidates(
    problem: Problem,
    base: Fit,
    effects: Sequence[Law],
    draws: int = 400,
    seed: int = 0,
    alpha: float = 0.01,
) -> Gate:
    """Score every candidate and judge the best against what noise would do.

    Parameters
    ----------
    problem : Problem
    base : Fit
        Fit beside which the candidates are scored.
    effects : sequence of Law
    draws : int
        Of the bootstrap; with none the candidates are only scored, and the p value is 1.
    seed : int
        Of the bootstrap.
    alpha : float
        Chance of a false alarm at which the gate opens.
    """
    vectors = np.concatenate([base.residual, base.departure])[:, None]
    if draws:
        vectors = np.hstack([vectors, _draw_noise_vectors(problem, base, draws, seed)])
    known = build_tangent_basis(base)
    directions = compute_directions(problem, base, effects, known, vectors)
    if not directions:
        # what would open the gate of one candidate
        return Gate(1.0, (), float(stats.chi2.isf(alpha, 1)))
    dof = float(max(problem.noise.scatter.dof, _LEAST_FREEDOM))
    variance = _estimate_whitened_variance(base.residual)
    freedom = np.array([len(direction.along) for direction in directions], dtype=float)
    gains = _compute_gains_along_directions(directions)
    observed, null = gains[:, 0], gains[:, 1:]
    log_p = _compute_log_p_values(observed[:, None] / variance, freedom, dof)[:, 0]
    scores = _score_effects_at_best_shape(directions, log_p, observed)
    if not draws:
        return Gate(1.0, scores)
    # among directions of equal freedom the least p of a draw is that of the largest gain
    kinds = np.unique(freedom)
    largest = []
    for kind in kinds:
        largest.append(null[freedom == kind].max(axis=0))
    least_log_p = _compute_log_p_values(np.stack(largest), kinds, dof).min(axis=0)
    level = np.exp(np.quantile(least_log_p, alpha))
    least_gain = float(stats.f.isf(level, 1.0, dof)) * variance
    as_small = np.sum(least_log_p <= log_p.min())
    return Gate(float((1 + as_small) / (draws + 1)), scores, least_gain)


def _estimate_whitened_variance(residual: Floats) -> float:
    """Estimate the variance of whitened residuals, robustly and no less than the expected one."""
    existing = np.abs(residual[residual != 0.0])
    if not existing.size:
        return 1.0
    return max(1.0, float((_MAD_TO_STD * np.median(existing)) ** 2))


def _score_effects_at_best_shape(
    directions: Sequence[Direction], log_p: Floats, gains: Floats
) -> tuple[Score, ...]:
    """Score each effect at the shape that does best, best effects first.

    Parameters
    ----------
    directions : sequence of Direction
        The observed residual is the first vector along them.
    log_p, gains : Floats
        Shape (d,).
    """
    best: dict[str, Score] = {}
    rows = zip(directions, log_p.tolist(), gains.tolist(), strict=True)
    for direction, own_log_p, gain in rows:
        effect = direction.effect
        improves = effect.id not in best or own_log_p < best[effect.id].log_p
        if not improves:
            continue
        step = direction.root @ direction.along[:, 0]
        best[effect.id] = Score(effect, direction.shape, own_log_p, gain, step)
    return tuple(sorted(best.values(), key=lambda score: score.log_p))


def _compute_gains_along_directions(directions: Sequence[Direction]) -> Floats:
    """Compute what each of the m vectors would gain along each direction, shape (d, m)."""
    firsts = np.cumsum([0, *(len(direction.along) for direction in directions[:-1])])
    squares = np.concatenate([direction.along for direction in directions]) ** 2
    gains = np.add.reduceat(squares, firsts, axis=0)
    for direction, gain in zip(directions, gains, strict=True):
        if direction.one_sided:
            gain *= (direction.root[0] @ direction.along) > 0.0
    return gains


def _compute_log_p_values(gains: Floats, gain_dof: Floats, noise_dof: float) -> Floats:
    """Compute the logarithm of the p value of gains of shape (d, m), with freedom of shape (d,)."""
    log_p = np.asarray(stats.f.logsf(gains / gain_dof[:, None], gain_dof[:, None], noise_dof))
    # beyond the smallest number the leading term of the tail keeps the order
    tail = _LEAST_LOG - 0.5 * noise_dof * np.log1p(gains / noise_dof)
    return np.where(np.isneginf(log_p), tail, log_p)


def _draw_noise_vectors(problem: Problem, base: Fit, draw_count: int, seed: int) -> Floats:
    """Draw noise of the design: residual vectors of whole trials, shuffled and with random signs.

    The residuals have unit variance; priors and floors get normal deviates. The shape is
    (n c + q, draws).
    """
    generator = np.random.default_rng(seed)
    seen = problem.trials.seen
    n, count, total = len(seen), seen.size, len(base.jacobian)
    by_trial = base.residual.reshape(seen.shape)
    counts = np.maximum(seen.sum(axis=0), 1)
    mean_square = np.sum(by_trial**2, axis=0) / counts
    std = np.maximum(np.sqrt(mean_square), 1e-12)
    # the tails are those of the residuals, but a sheer misfit counts no more than four deviations
    pool = np.clip(by_trial / std, -_MOST_DEVIATIONS, _MOST_DEVIATIONS)
    shuffled = pool[generator.integers(0, n, (draw_count, n))]
    signs = generator.choice([-1.0, 1.0], (draw_count, n, 1))
    noise = np.where(seen, shuffled * signs, 0.0)
    of_priors = generator.standard_normal((total - count, draw_count))
    return np.vstack([noise.reshape(draw_count, count).T, of_priors])


def compute_detectable_amplitudes(
    problem: Problem, base: Fit, effects: Sequence[Law], needed_gain: float
) -> dict[str, float]:
    """Compute the amplitude at which each effect opens the gate nine times in ten.

    Parameters
    ----------
    problem : Problem
    base : Fit
    effects : sequence of Law
        Those of one amplitude are considered.
    needed_gain : float
        Gain that opens the gate.

    Returns
    -------
    dict
        Amplitude by the name of the law, in the unit of its amplitude.
    """
    considered = []
    for law in effects:
        if len(law.amplitudes) == 1:
            considered.append(law)
    known = build_tangent_basis(base)
    # the root of the expected gain exceeds that of the gain that opens the gate by 1.28 standard
    # deviations
    root_gain = np.sqrt(needed_gain) + _NINE_IN_TEN
    found: dict[str, float] = {}
    for direction in compute_directions(problem, base, considered, known):
        law = direction.effect
        amplitude = law.amplitude_parameters[0]
        size = root_gain * float(np.linalg.norm(direction.root)) * amplitude.scale
        found[law.id] = min(size, found.get(law.id, np.inf))
    return found
