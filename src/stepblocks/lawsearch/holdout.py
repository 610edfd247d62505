"""Errors on trials that took no part in a fit, and what searches choose without them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.lawsearch.findings import Rules
from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.lawsearch.search import search_effects_and_structure

# median errors by which the unknown of a new specimen may move a prediction; from there on one
# trial weighs in the mean square as twenty-five others do
_MOST_OPEN = 5.0
_PLACE_SLACK = 1e-6  # by which the place of a sudden change may move while it is held

RowIndices = NDArray[np.intp]
ListCandidates = Callable[[Trials], Sequence[Law]]  # effects that may be asked of a table


class HeldOutErrors(NamedTuple):
    """Errors on held-out trials, measured less predicted, for one way of holding out.

    They are NaN where a trial was never held out, or is left open.

    Attributes
    ----------
    nominal : Floats
        Shape (n, c).
    extended : Floats
        Shape (n, c), of the model that is delivered.
    left_open : NDArray[np.bool_]
        Shape (n, c), where the unknown of a new specimen decides the value.
    """

    nominal: Floats
    extended: Floats
    left_open: NDArray[np.bool_]


@dataclass(frozen=True)
class Holdout:
    """Errors on held-out trials, and what each fold chose; see `HeldOutErrors`.

    Attributes
    ----------
    nominal : Floats
        Shape (n, c).
    extended : Floats
        Shape (n, c).
    left_open : NDArray[np.bool_]
        Shape (n, c).
    selected : tuple[tuple[str, ...], ...]
        Names of the effects that each fold chose.
    """

    nominal: Floats
    extended: Floats
    left_open: NDArray[np.bool_]
    selected: tuple[tuple[str, ...], ...]

    def compute_nominal_and_extended_rms(self, channel: int) -> tuple[float, float]:
        """Compute the root mean square of the nominal and the extended error in one channel.

        Both are NaN where nothing was held out.
        """
        nominal = _compute_rms(self.nominal[:, channel])
        extended = _compute_rms(self.extended[:, channel])
        return nominal, extended


def _compute_rms(errors: Floats) -> float:
    """Compute the root mean square of the finite errors; NaN where there are none."""
    finite = errors[np.isfinite(errors)]
    if not finite.size:
        return float("nan")
    return float(np.sqrt(np.mean(finite**2)))


def split_within_blocks(trials: Trials, fold_count: int, seed: int = 0) -> list[RowIndices]:
    """Split trials at random so that each fold holds some of every block.

    Returns
    -------
    list of arrays
        Rows of the trials that each fold holds out.
    """
    generator = np.random.default_rng(seed)
    fold = np.empty(len(trials), dtype=int)
    offset = 0
    for block in np.unique(trials.block):
        rows = generator.permutation(np.flatnonzero(trials.block == block))
        fold[rows] = (np.arange(len(rows)) + offset) % fold_count
        offset += len(rows)
    return _list_rows_by_fold(fold, fold_count)


def _list_rows_by_fold(fold_of_row: RowIndices, fold_count: int) -> list[RowIndices]:
    """List the rows of each fold, by the fold of each row, shape (n,)."""
    return [np.flatnonzero(fold_of_row == number) for number in range(fold_count)]


def split_by_block(trials: Trials, fold_limit: int) -> list[RowIndices]:
    """Split trials so that each fold holds whole blocks.

    Returns
    -------
    list of arrays
        Rows of the trials that each fold holds out; at most `fold_limit` arrays.
    """
    _, number = np.unique(trials.block, return_inverse=True)
    folds = min(fold_limit, int(number.max()) + 1)
    return _list_rows_by_fold(number % fold_limit, folds)


@dataclass(frozen=True)
class Fold:
    """Trials that are held out, and the problem of all others.

    Attributes
    ----------
    rows : array of int
        Those held out, among all trials.
    problem : Problem
        Of all others.
    """

    rows: RowIndices
    problem: Problem


def build_folds(whole: Problem, rows_of_folds: Sequence[RowIndices]) -> list[Fold]:
    """Build folds, each with the problem of the trials that it leaves.

    Parameters
    ----------
    whole : Problem
        Of all trials.
    rows_of_folds : sequence of arrays of int
        The trials that each fold holds out.
    """
    folds = []
    for rows in rows_of_folds:
        others = np.setdiff1d(np.arange(len(whole.trials)), rows)
        problem = build_problem(whole.model, whole.trials.take(others))
        folds.append(Fold(rows, problem))
    return folds


def select_effects_without_fold(
    fold: Fold,
    list_candidates: ListCandidates,
    rules: Rules,
    fitted_values: Mapping[str, float],
) -> tuple[str, ...]:
    """Name the effects that a search chooses without the trials of one fold.

    Where the effects of all trials do as well within the margin, they are named instead: the
    trials held out may be the only ones that tell two effects apart.

    Parameters
    ----------
    fold : Fold
    list_candidates : callable
        Effects that may be asked of a table.
    rules : Rules
    fitted_values : Mapping[str, float]
        Values of the fit of all trials.
    """
    laws = list_candidates(fold.problem.trials)
    found = search_effects_and_structure(fold.problem, laws, rules)
    chosen = tuple(law.id for law in found.extended.effects)
    of_all_trials = {}
    for law in laws:
        if law.name_in_fit(law.parameters[0].name) in fitted_values:
            of_all_trials[law.id] = law
    if not set(chosen) - set(of_all_trials):
        return chosen
    whole = fit_with_effects(found.problem, list(of_all_trials.values()), fitted_values)
    if whole.criterion <= found.extended.criterion + rules.margin:
        return tuple(of_all_trials)
    return chosen


class HeldOutPredictor:
    """Predicts held-out trials with models whose numbers are fitted without them.

    Parameters
    ----------
    problem : Problem
        Of all trials.
    nominal : Fit
        Of all trials, without effects.
    fold_splits : sequence of sequences of Fold
        The folds of each way of holding out.
    list_candidates : callable
        Effects that may be asked of a table: one of a specimen that a fold never saw is not.
    """

    def __init__(
        self,
        problem: Problem,
        nominal: Fit,
        fold_splits: Sequence[Sequence[Fold]],
        list_candidates: ListCandidates,
    ) -> None:
        self._problem = problem
        self._nominal = nominal
        self._model = problem.model
        self._trials = problem.trials
        self._ways: list[list[_FoldWithLaws]] = []
        for folds in fold_splits:
            self._ways.append([_FoldWithLaws(fold, list_candidates) for fold in folds])

    def compute_held_out_errors(
        self,
        effects: Sequence[Law],
        start_values: Mapping[str, float] | None = None,
        prior_shift: float = 0.0,
    ) -> list[Floats]:
        """Compute errors on held-out trials, measured less predicted.

        Parameters
        ----------
        effects : sequence of Law
            Effects of the model.
        start_values : Mapping[str, float], optional
            Where fits begin. Places of sudden changes are held there.
        prior_shift : float
            Prior standard deviations by which the unknown of new specimens is moved.

        Returns
        -------
        list of arrays of shape (n, c)
            One for each way of holding out, then that of the fit of all trials.
        """
        errors = []
        for folds in self._ways:
            error = np.full(self._trials.values.shape, np.nan)
            for with_laws in folds:
                rows = with_laws.fold.rows
                predicted = self._predict_fold(with_laws, effects, start_values, prior_shift)
                error[rows] = self._trials.values[rows] - predicted
            errors.append(error)
        whole = self._nominal
        if effects:
            whole = fit_with_effects(self._problem, effects, start_values)
        return [*errors, self._trials.values - whole.predicted]

    def _predict_fold(
        self,
        with_laws: "_FoldWithLaws",
        effects: Sequence[Law],
        start_values: Mapping[str, float] | None,
        prior_shift: float,
    ) -> Floats:
        """Predict the trials that a fold holds out; see `compute_held_out_errors`."""
        fold = with_laws.fold
        known = _list_effects_known_to_fold(with_laws.laws, effects)
        held = [_fix_jump_places(law, start_values or {}) for law in known]
        fitted = fit_with_effects(fold.problem, held, start_values)
        test = self._trials.take(fold.rows)
        starts = {}
        for p in self._model.parameters(test):
            starts[p.name] = p.start
            # without a prior the deviation is infinite, and may not be multiplied by zero
            if prior_shift:
                starts[p.name] = p.start + prior_shift * p.prior_std
        ahead = Problem(self._model, test, fold.problem.noise)
        return ahead.predict(known, starts | fitted.values)

    def mark_errors_left_open(self, nominal: Sequence[Floats]) -> list[NDArray[np.bool_]]:
        """Find the errors that the unknown of new specimens decides, and no model.

        An example is 1 um of an unscanned block that nearly locks.

        Parameters
        ----------
        nominal : sequence of arrays
            Errors of the nominal model, as `compute_held_out_errors` returns them.
        """
        lowered = self.compute_held_out_errors((), prior_shift=-1.0)
        raised = self.compute_held_out_errors((), prior_shift=1.0)
        left_open = []
        for error, error_lowered, error_raised in zip(nominal, lowered, raised, strict=True):
            left_open.append(_mark_errors_left_open(error, error_lowered, error_raised))
        return left_open


class _FoldWithLaws:
    """A fold, and the laws that the trials it leaves may show, listed when they are asked for."""

    def __init__(self, fold: Fold, list_candidates: ListCandidates) -> None:
        self.fold = fold
        self._candidates = list_candidates

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """Laws by their names."""
        return {law.id: law for law in self._candidates(self.fold.problem.trials)}


def _list_effects_known_to_fold(laws: Mapping[str, Law], effects: Sequence[Law]) -> list[Law]:
    """List the effects that the trials of a fold can tell of, as laws of these trials.

    What differs by specimen is known of those alone that took part.

    Parameters
    ----------
    laws : Mapping[str, Law]
        Laws that these trials may show, by name.
    effects : sequence of Law
    """
    known = []
    for law in effects:
        if law.id in laws:
            known.append(laws[law.id])
        elif law.covariate != "block":
            known.append(law)
    return known


def _mark_errors_left_open(error: Floats, lowered: Floats, raised: Floats) -> NDArray[np.bool_]:
    """Mark errors that move by more than a few typical errors; all have the shape (n, c).

    `lowered` and `raised` are the errors with the unknown moved either way.
    """
    typical = pd.DataFrame(np.abs(error)).median().to_numpy()
    reach = np.maximum(np.abs(lowered - error), np.abs(raised - error))
    # the reach is NaN where the specimen locks once it is moved: that is open, too
    decided = reach <= _MOST_OPEN * typical
    return np.asarray(np.isfinite(error) & ~decided)


def _fix_jump_places(law: Law, fitted_values: Mapping[str, float]) -> Law:
    """Hold the places of sudden changes where all trials have put them.

    No slope leads a fit of fewer trials back to such a place.
    """
    parameters = []
    for p in law.parameters:
        if p.name in law.steps:
            place = fitted_values[law.name_in_fit(p.name)]
            parameters.append(replace(p, low=place - _PLACE_SLACK, high=place + _PLACE_SLACK))
        else:
            parameters.append(p)
    return replace(law, parameters=tuple(parameters))
