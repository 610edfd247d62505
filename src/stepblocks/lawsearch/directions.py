"""Directions in which effects move the prediction, to first order, beside the nominal model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import Law, SizedChange, list_starts
from stepblocks.lawsearch.objective import differentiate_size
from stepblocks.lawsearch.problem import Fit, Problem

# length of a unit direction that must remain beside the nominal model: less of it is a derivative
# of the nominal model up to rounding
_LEAST_REMAINING = 2e-3
_LEAST_MOVE = 1e-12  # length of a whitened direction below which an effect moves nothing
_SINGULAR = 1e-8  # ratio of singular values below which constants move the same direction
_STEP = 0.02  # of differences, in units of a parameter's scale
BATCH = 16  # effects or shapes in one product of matrices: all of them would fill the memory

# slope of the prediction in the number by which a change moves every trial, and the column that a
# law follows; by the change, the step, and the covariate where the model computes it
_SlopeKey = tuple[Callable[..., object], float, str]
_Slopes = dict[_SlopeKey, tuple[Floats, NDArray[np.generic]]]


@dataclass(frozen=True)
class Direction:
    """How an effect shows in a design.

    Attributes
    ----------
    effect : Law
    shape : Mapping[str, float]
        Values of its shape parameters.
    basis : Floats
        Shape (n c + q, k), of what the design can see of the effect beside the nominal model.
    root : Floats
        Shape (a, k), from that basis to the amplitudes, in units of their scales.
    one_sided : bool
        Whether its only amplitude has one sign.
    """

    effect: Law
    shape: Mapping[str, float]
    basis: Floats
    root: Floats
    one_sided: bool


@dataclass(frozen=True)
class _ShapedLaw:
    """A law at fixed values of its shape parameters."""

    law: Law
    shape: Mapping[str, float]


def build_tangent_basis(base: Fit) -> Floats:
    """Build a basis of the directions in which the constants of a fit move the prediction.

    The shape is (n c + q, b).
    """
    length = np.linalg.norm(base.jacobian, axis=0)
    left, singular, _ = np.linalg.svd(
        base.jacobian / np.maximum(length, 1e-300), full_matrices=False
    )
    return np.asarray(left[:, singular > _SINGULAR * singular[0]])


def compute_tangent(problem: Problem, base: Fit, effect: Law, shape: Mapping[str, float]) -> Floats:
    """Compute the whitened change of the prediction per unit of each amplitude.

    Amplitudes are in units of their scales; the shape is (n c, a).
    """
    changes = _compute_changes(problem, base, _ShapedLaw(effect, shape), {})
    return problem.noise.whiten(np.stack(changes, axis=2))


def compute_directions(
    problem: Problem, base: Fit, effects: Sequence[Law], known: Floats
) -> list[Direction]:
    """Find what the design sees of every effect and shape beside the constants of the model.

    An effect that the constants imitate has no direction.

    Parameters
    ----------
    problem : Problem
    base : Fit
        Fit at which the directions are taken.
    effects : sequence of Law
    known : Floats
        Shape (n c + q, b), basis of the directions in which the constants move the prediction.
    """
    shaped = []
    for law in effects:
        for shape in law.shapes:
            shaped.append(_ShapedLaw(law, shape))
    slopes: _Slopes = {}
    directions: list[Direction] = []
    for first in range(0, len(shaped), BATCH):
        batch = shaped[first : first + BATCH]
        directions += _compute_batch(problem, base, batch, known, slopes)
    return directions


def _compute_changes(
    problem: Problem, base: Fit, shaped: _ShapedLaw, slopes: _Slopes
) -> list[Floats]:
    """Find the change of the prediction per unit of each amplitude, each of shape (n, c).

    `slopes` keeps the slopes that are known.
    """
    effect = shaped.law
    neutral = list_starts(effect.parameters) | dict(shaped.shape)
    amplitudes = effect.amplitude_parameters
    if isinstance(effect.apply, SizedChange):
        step = _STEP * amplitudes[0].scale
        slope, column = _find_size_slope(problem, base, effect, neutral, step, slopes)
        changes = []
        for p in amplitudes:
            size = effect.apply.size(column, neutral | {p.name: p.start + p.scale})
            changes.append(slope * size[:, None])
        return changes
    effects = [*base.effects, effect]
    values = base.values | effect.name_values(neutral)
    changes = []
    for p in amplitudes:
        moved = values | {effect.name_in_fit(p.name): p.start + _STEP * p.scale}
        changes.append((problem.predict(effects, moved) - base.predicted) / _STEP)
    return changes


def _find_size_slope(
    problem: Problem,
    base: Fit,
    effect: Law,
    neutral: Mapping[str, float],
    step: float,
    slopes: _Slopes,
) -> tuple[Floats, NDArray[np.generic]]:
    """Find the slope of the prediction in the number by which a law changes each trial.

    What a trial shows depends on its own state alone, so that laws which change the state alike
    share the slope, which `slopes` keeps.

    Parameters
    ----------
    problem : Problem
    base : Fit
    effect : Law
        Its `apply` is a `SizedChange`.
    neutral : Mapping[str, float]
        Values of its parameters at which it changes nothing.
    step : float
        Of the difference, in the unit of the number.
    slopes : dict

    Returns
    -------
    slope : array of shape (n, c)
    column : array
        What the law follows.
    """
    apply = effect.apply
    assert isinstance(apply, SizedChange)
    column = problem.trials.covariates.get(effect.covariate)
    key = apply.change, step, ""
    if column is None:
        # only a law that follows it sees what the model computes
        key = apply.change, step, effect.covariate
    if key not in slopes:
        effects = [*base.effects, effect]
        values = base.values | effect.name_values(neutral)
        slopes[key] = differentiate_size(problem, effects, values, apply, base.predicted, step)
    slope, followed = slopes[key]
    if column is None:
        column = followed
    return slope, column


def _compute_batch(
    problem: Problem, base: Fit, batch: Sequence[_ShapedLaw], known: Floats, slopes: _Slopes
) -> list[Direction]:
    """Find the directions of some laws in one product of matrices; see `compute_directions`."""
    changes = []
    columns = []
    for shaped in batch:
        of_law = _compute_changes(problem, base, shaped, slopes)
        changes.append(of_law)
        columns += of_law
    if not columns:
        return []
    white = problem.noise.whiten(np.stack(columns, axis=2))
    length = np.linalg.norm(white, axis=0)
    moves = np.all(np.isfinite(white), axis=0) & (length >= _LEAST_MOVE)
    scaled = np.where(moves, white / np.where(moves, length, 1.0), 0.0)
    prior_rows = np.zeros((known.shape[0] - len(white), white.shape[1]))
    remaining = np.vstack([scaled, prior_rows])
    remaining -= known @ (known.T @ remaining)
    directions = []
    first = 0
    for shaped, of_law in zip(batch, changes, strict=True):
        part = slice(first, first + len(of_law))
        first += len(of_law)
        if not of_law or not np.all(moves[part]):
            continue
        direction = _span_direction(shaped, remaining[:, part], length[part])
        if direction is not None:
            directions.append(direction)
    return directions


def _span_direction(shaped: _ShapedLaw, remaining: Floats, length: Floats) -> Direction | None:
    """Build the direction of a law, or None where the constants imitate it.

    Parameters
    ----------
    shaped : _ShapedLaw
    remaining : Floats
        Shape (n c + q, a), unit changes per amplitude less what the constants imitate.
    length : Floats
        Shape (a,), of the whitened changes.
    """
    to_basis = _find_basis(remaining)
    if to_basis is None:
        return None
    return Direction(
        effect=shaped.law,
        shape=shaped.shape,
        basis=remaining @ to_basis,
        root=to_basis / length[:, None],
        one_sided=_is_one_sided(shaped.law),
    )


def _find_basis(remaining: Floats) -> Floats | None:
    """Find the combinations of changes, shape (a, k), that make orthonormal columns of them.

    The result is None where nothing of the changes remains.
    """
    if remaining.shape[1] == 1:
        length = np.linalg.norm(remaining)
        return np.array([[1.0 / length]]) if length > _LEAST_REMAINING else None
    squared, turn = np.linalg.eigh(remaining.T @ remaining)
    squared, turn = squared[::-1], turn[:, ::-1]
    kept = squared > _LEAST_REMAINING**2
    if not np.any(kept):
        return None
    return np.asarray(turn[:, kept] / np.sqrt(squared[kept]))


def _is_one_sided(law: Law) -> bool:
    """Tell whether the only amplitude of a law cannot be negative."""
    if len(law.amplitudes) != 1:
        return False
    amplitude = law.amplitude_parameters[0]
    return amplitude.low >= amplitude.start
