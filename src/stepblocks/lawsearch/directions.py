"""Directions in which effects move the prediction, to first order, beside the nominal model."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.enlarged_law import EnlargedLaw, predict_at_points_and_enlarged
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.law import Law, SizedChange, map_names_to_starts
from stepblocks.lawsearch.problem import Fit, Problem

# length of a unit direction that must remain beside the nominal model: less of it is a derivative
# of the nominal model up to rounding
_LEAST_REMAINING = 2e-3
_LEAST_MOVE = 1e-12  # length of a whitened direction below which an effect moves nothing
_SINGULAR = 1e-8  # ratio of singular values below which constants move the same direction
_STEP = 0.02  # of differences, in units of a parameter's scale
_BATCH = 16  # effects or shapes in one product of matrices: all of them would fill the memory

# what laws share which change a state alike: the change, the step of its difference, and the
# covariate where the model computes it
_SlopeKey = tuple[Callable[..., object], float, str]

# sizes of laws that follow columns of a table, which each scoring needs again; those of a table go
# with it
_SIZES_BY_TABLE: WeakKeyDictionary[Trials, dict[Hashable, Floats]] = WeakKeyDictionary()


@dataclass(frozen=True)
class _SharedSlopes:
    """What laws share at one fit.

    Attributes
    ----------
    slopes : dict
        Slope of the prediction in the number by which a change moves every trial, shape (n, c).
    columns : dict
        What the laws follow, by the covariate; by the key of the slope where the model computes it.
    """

    slopes: dict[_SlopeKey, Floats] = field(default_factory=dict)
    columns: dict[Hashable, NDArray[np.generic]] = field(default_factory=dict)


@dataclass(frozen=True)
class Direction:
    """How an effect shows in a design.

    Attributes
    ----------
    effect : Law
    shape : Mapping[str, float]
        Values of its shape parameters.
    root : Floats
        Shape (a, k), from an orthonormal basis of what the design can see of the effect beside the
        nominal model, to the amplitudes, in units of their scales.
    along : Floats
        Shape (k, m), projections of some vectors on that basis.
    one_sided : bool
        Whether its only amplitude has one sign.
    """

    effect: Law
    shape: Mapping[str, float]
    root: Floats
    along: Floats
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
    changes = _compute_amplitude_changes(problem, base, _ShapedLaw(effect, shape), _SharedSlopes())
    return problem.noise.whiten(np.stack(changes, axis=2))


def compute_directions(
    problem: Problem,
    base: Fit,
    effects: Sequence[Law],
    known: Floats,
    vectors: Floats | None = None,
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
    vectors : Floats, optional
        Shape (n c + q, m), what is projected on the directions.
    """
    view = _WhitenedView.build(problem, known, vectors)
    shaped = _list_shaped_laws(effects)
    by_slope: dict[_SlopeKey, list[int]] = {}
    without_size: list[int] = []
    for number, member in enumerate(shaped):
        if isinstance(member.law.apply, SizedChange):
            by_slope.setdefault(_make_slope_key(problem, member.law), []).append(number)
        else:
            without_size.append(number)
    shared = _SharedSlopes()
    _add_slopes(problem, base, [shaped[numbers[0]] for numbers in by_slope.values()], shared)
    found: dict[int, Direction | None] = {}
    for numbers in by_slope.values():
        members = [shaped[number] for number in numbers]
        directions = _compute_sized_law_directions(problem, base, view, members, shared)
        found |= zip(numbers, directions, strict=True)
    for first in range(0, len(without_size), _BATCH):
        numbers = without_size[first : first + _BATCH]
        members = [shaped[number] for number in numbers]
        directions = _compute_other_law_directions(problem, base, view, members)
        found |= zip(numbers, directions, strict=True)
    in_order = []
    for number in range(len(shaped)):
        direction = found[number]
        if direction is not None:
            in_order.append(direction)
    return in_order


def compute_unit_directions(
    problem: Problem, base: Fit, effects: Sequence[Law], known: Floats
) -> dict[str, Floats]:
    """Find the unit vectors along which laws of one amplitude and shape show, by their names.

    A law that the constants imitate has none. Parameters are those of `compute_directions`.
    """
    shared = _SharedSlopes()
    units = {}
    for member in _list_shaped_laws(effects):
        (change,) = _compute_amplitude_changes(problem, base, member, shared)
        white = problem.noise.whiten(change)
        length = float(np.linalg.norm(white))
        if not length >= _LEAST_MOVE:
            continue
        remaining = np.concatenate([white / length, np.zeros(len(known) - len(white))])
        remaining -= known @ (known.T @ remaining)
        left = float(np.linalg.norm(remaining))
        if left > _LEAST_REMAINING:
            units[member.law.id] = remaining / left
    return units


def _list_shaped_laws(effects: Sequence[Law]) -> list[_ShapedLaw]:
    """List every law at each of its shapes."""
    shaped = []
    for law in effects:
        for shape in law.shapes:
            shaped.append(_ShapedLaw(law, shape))
    return shaped


@dataclass(frozen=True)
class _WhitenedView:
    """How a design sees changes of the prediction: beside errors that trials share and constants.

    With ``y`` a change turned by the factors of each trial, whitening leaves ``y - B (1 - s) B' y``
    of it, and the constants ``K`` imitate a part of that. All scores are made of inner products of
    what remains. Those of many changes follow from the products of ``y`` with a few vectors; the
    whitened changes themselves, each as long as all readings, are never needed.

    Attributes
    ----------
    factors : Floats
        Shape (n, c, c), see `Noise`.
    shared : Floats
        Shape (n, c, s), of which the squared products are what whitening takes off a square.
    known : Floats
        Shape (n, c, b), whose products are those of the whitened change with the constants.
    vectors : Floats
        Shape (n, c, m), whose products are those of what remains with the vectors.
    """

    factors: Floats
    shared: Floats
    known: Floats
    vectors: Floats

    @classmethod
    def build(cls, problem: Problem, known: Floats, vectors: Floats | None) -> "_WhitenedView":
        """Build the view of a problem; see `compute_directions`."""
        noise = problem.noise
        shape = (*problem.trials.values.shape, -1)
        count = problem.trials.values.size
        if vectors is None:
            vectors = np.zeros((len(known), 0))
        beside = vectors[:count] - known[:count] @ (known.T @ vectors)
        return cls(
            factors=noise.factors,
            shared=(noise.basis * np.sqrt(1.0 - noise.shrink**2)).reshape(shape),
            known=noise.shrink_shared_errors(known[:count]).reshape(shape),
            vectors=noise.shrink_shared_errors(beside).reshape(shape),
        )

    def decorrelate_by_trial(self, change: Floats) -> Floats:
        """Turn changes of shape (n, c, k) by the factors of each trial; what is missing is zero."""
        return np.asarray(self.factors @ np.where(np.isfinite(change), change, 0.0))

    def compute_inner_products(self, turned: Floats) -> "_InnerProducts":
        """Find the inner products of turned changes of shape (n, c, k)."""
        flat = turned.reshape(-1, turned.shape[2])

        def multiply_with_changes(rows: Floats) -> Floats:
            return np.asarray(rows.reshape(len(flat), -1).T @ flat)

        return self._combine_inner_products(flat.T @ flat, multiply_with_changes)

    def compute_sized_inner_products(self, turned: Floats, sizes: Floats) -> "_InnerProducts":
        """Find the inner products of changes by one number per trial.

        Parameters
        ----------
        turned : Floats
            Shape (n, c), turned slope in the number.
        sizes : Floats
            Shape (n, k), numbers of each change.
        """
        square = np.sum(turned**2, axis=1)

        def multiply_with_changes(rows: Floats) -> Floats:
            of_trials = (turned[:, None, :] @ rows)[:, 0]
            return np.asarray(of_trials.T @ sizes)

        return self._combine_inner_products(
            (sizes * square[:, None]).T @ sizes, multiply_with_changes
        )

    def _combine_inner_products(
        self, own: Floats, multiply: Callable[[Floats], Floats]
    ) -> "_InnerProducts":
        """Combine the products of changes with themselves and with the vectors of the view."""
        shared, known = multiply(self.shared), multiply(self.known)
        whitened = own - shared.T @ shared
        return _InnerProducts(whitened, whitened - known.T @ known, multiply(self.vectors).T)


class _InnerProducts(NamedTuple):
    """Inner products of k changes, whitened.

    Attributes
    ----------
    whitened : Floats
        Shape (k, k), of the changes.
    remaining : Floats
        Shape (k, k), of what of them the constants do not imitate.
    along : Floats
        Shape (k, m), of what remains with the vectors of a view.
    """

    whitened: Floats
    remaining: Floats
    along: Floats


def _compute_sized_law_directions(
    problem: Problem,
    base: Fit,
    view: _WhitenedView,
    members: Sequence[_ShapedLaw],
    shared: _SharedSlopes,
) -> list[Direction | None]:
    """Find the directions of laws that share a slope; see `compute_directions`."""
    sizes = []
    counts = []
    for member in members:
        slope, of_law = _compute_slope_and_sizes(problem, base, member, shared)
        sizes.append(of_law)
        counts.append(of_law.shape[1])
    # the last slope is that of all members
    turned = view.decorrelate_by_trial(slope[:, :, None])[:, :, 0]
    together = np.concatenate(sizes, axis=1)
    finite = np.where(np.isfinite(together), together, 0.0)
    seen = view.compute_sized_inner_products(turned, finite)
    return _build_directions(members, counts, seen)


def _compute_other_law_directions(
    problem: Problem, base: Fit, view: _WhitenedView, members: Sequence[_ShapedLaw]
) -> list[Direction | None]:
    """Find the directions of laws that change a state in their own way."""
    changes: list[Floats] = []
    widths = []
    for member in members:
        of_law = _compute_amplitude_changes(problem, base, member, _SharedSlopes())
        changes += of_law
        widths.append(len(of_law))
    seen = view.compute_inner_products(view.decorrelate_by_trial(np.stack(changes, axis=2)))
    return _build_directions(members, widths, seen)


def _build_directions(
    members: Sequence[_ShapedLaw], widths: Sequence[int], seen: _InnerProducts
) -> list[Direction | None]:
    """Build the directions of laws from the inner products of their changes side by side.

    `widths` are the numbers of amplitudes. The direction is None where the constants imitate a law.
    """
    lengths = np.sqrt(np.maximum(np.diagonal(seen.whitened), 0.0))
    moves = lengths >= _LEAST_MOVE
    divisors = np.where(moves, lengths, 1.0)
    of_unit_changes = seen.remaining / np.outer(divisors, divisors)
    scales = _compute_single_scales(np.diagonal(of_unit_changes), moves) / divisors
    along_single = scales[:, None] * seen.along
    directions: list[Direction | None] = []
    first = 0
    for member, width in zip(members, widths, strict=True):
        part = slice(first, first + width)
        root: Floats | None = None
        if width == 1 and scales[first]:
            root = scales[part, None]
            along = along_single[part]
        elif width > 1 and moves[part].all():
            to_basis = _find_orthonormal_combinations(of_unit_changes[part, part])
            if to_basis is not None:
                root = to_basis / lengths[part, None]
                along = root.T @ seen.along[part]
        first += width
        if root is None:
            directions.append(None)
            continue
        one_sided = _has_one_sided_amplitude(member.law)
        directions.append(Direction(member.law, member.shape, root, along, one_sided))
    return directions


def _compute_single_scales(squared_lengths: Floats, moves: NDArray[np.bool_]) -> Floats:
    """Compute the factor that makes each remaining change a unit vector, shape (k,).

    `squared_lengths` are those of the remaining changes. The factor is zero where nothing remains.
    """
    remains = moves & (squared_lengths > _LEAST_REMAINING**2)
    scales = np.zeros(len(squared_lengths))
    scales[remains] = [squared**-0.5 for squared in squared_lengths[remains].tolist()]
    return scales


def _compute_amplitude_changes(
    problem: Problem, base: Fit, shaped: _ShapedLaw, shared: _SharedSlopes
) -> list[Floats]:
    """Find the change of the prediction per unit of each amplitude, each of shape (n, c).

    `shared` keeps the slopes that are known.
    """
    effect = shaped.law
    if isinstance(effect.apply, SizedChange):
        slope, sizes = _compute_slope_and_sizes(problem, base, shaped, shared)
        return [slope * size[:, None] for size in sizes.T]
    neutral = map_names_to_starts(effect.parameters) | dict(shaped.shape)
    effects = [*base.effects, effect]
    values = base.values | effect.name_values(neutral)
    changes = []
    for p in effect.amplitude_parameters:
        moved = values | {effect.name_in_fit(p.name): p.start + _STEP * p.scale}
        changes.append((problem.predict(effects, moved) - base.predicted) / _STEP)
    return changes


def _compute_slope_and_sizes(
    problem: Problem, base: Fit, shaped: _ShapedLaw, shared: _SharedSlopes
) -> tuple[Floats, Floats]:
    """Find the slope of the prediction in the number by which a law changes each trial.

    What a trial shows depends on its own state alone, so that laws which change the state alike
    share the slope, which `shared` keeps.

    Returns
    -------
    slope : array of shape (n, c)
    sizes : array of shape (n, a)
        That number per unit of each amplitude.
    """
    law = shaped.law
    apply = law.apply
    assert isinstance(apply, SizedChange)
    slope_key = _make_slope_key(problem, law)
    follows_table = _follows_table_columns(problem, law)
    kept: dict[Hashable, Floats] = {}
    if follows_table:
        kept = _SIZES_BY_TABLE.setdefault(problem.trials, kept)
    scales = tuple(p.scale for p in law.amplitude_parameters)
    size_key = apply, law.covariate, scales, tuple(shaped.shape.items())
    if slope_key in shared.slopes and size_key in kept:
        return shared.slopes[slope_key], kept[size_key]
    followed = _name_followed(problem, law)
    column = problem.trials.covariates.get(law.covariate, shared.columns.get(followed))
    if slope_key not in shared.slopes or column is None:
        _add_slopes(problem, base, [shaped], shared)
        column = shared.columns[followed]
    if size_key not in kept:
        kept[size_key] = _compute_amplitude_sizes(shaped, column)
    return shared.slopes[slope_key], kept[size_key]


def _add_slopes(
    problem: Problem, base: Fit, members: Sequence[_ShapedLaw], shared: _SharedSlopes
) -> None:
    """Add the slopes of laws to those that are shared, and what the laws follow.

    All laws are asked of the model at once, each at a point of its own.
    """
    effects = list(base.effects)
    values = dict(base.values)
    enlarged = []
    for member in members:
        law = member.law
        assert isinstance(law.apply, SizedChange)
        effects.append(law)
        values |= law.name_values(map_names_to_starts(law.parameters) | dict(member.shape))
        enlarged.append(EnlargedLaw(law, law.apply, _make_slope_key(problem, law)[1]))
    if not enlarged:
        return
    _, predicted = predict_at_points_and_enlarged(problem, effects, values, {}, enlarged)
    for point, (own, ahead) in enumerate(zip(enlarged, predicted, strict=True)):
        slope = (ahead - base.predicted) / own.step
        shared.slopes.setdefault(_make_slope_key(problem, own.effect), slope)
        followed = own.select_followed_column(point, len(ahead))
        shared.columns.setdefault(_name_followed(problem, own.effect), followed)


def _name_followed(problem: Problem, law: Law) -> Hashable:
    """Name what a law follows: its covariate, or its slope where the model computes that."""
    if _follows_table_columns(problem, law):
        return law.covariate
    return _make_slope_key(problem, law)


def _follows_table_columns(problem: Problem, law: Law) -> bool:
    """Tell whether what a law follows is made of the table alone, whatever the model computes."""
    return law.covariate in problem.trials.covariates or bool(law.columns)


def _compute_amplitude_sizes(shaped: _ShapedLaw, column: NDArray[np.generic]) -> Floats:
    """Compute the numbers of a law per unit of each amplitude, shape (n, a)."""
    law = shaped.law
    assert isinstance(law.apply, SizedChange)
    neutral = map_names_to_starts(law.parameters) | dict(shaped.shape)
    sizes = []
    for p in law.amplitude_parameters:
        sizes.append(law.apply.size(column, neutral | {p.name: p.start + p.scale}))
    return np.stack(sizes, axis=1)


def _make_slope_key(problem: Problem, law: Law) -> _SlopeKey:
    """Name the slope that a law shares with others which change the state alike."""
    apply = law.apply
    assert isinstance(apply, SizedChange)
    step = _STEP * law.amplitude_parameters[0].scale
    if _follows_table_columns(problem, law):
        return apply.change, step, ""
    # only a law that follows it sees what the model computes
    return apply.change, step, law.covariate


def _find_orthonormal_combinations(remaining: Floats) -> Floats | None:
    """Find the combinations of changes, shape (a, k), that make orthonormal columns of them.

    `remaining` are their inner products, shape (a, a), each change of unit length before the
    constants took their part of it. The result is None where nothing of the changes remains.
    """
    squared, turn = np.linalg.eigh(remaining)
    squared, turn = squared[::-1], turn[:, ::-1]
    kept = squared > _LEAST_REMAINING**2
    if not np.any(kept):
        return None
    return np.asarray(turn[:, kept] / np.sqrt(squared[kept]))


def _has_one_sided_amplitude(law: Law) -> bool:
    """Tell whether the only amplitude of a law cannot be negative."""
    if len(law.amplitudes) != 1:
        return False
    amplitude = law.amplitude_parameters[0]
    return amplitude.low >= amplitude.start
