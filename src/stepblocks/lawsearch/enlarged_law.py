"""Laws whose number of each trial is enlarged, to find the slope of a prediction in that number."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import Law, SizedChange
from stepblocks.lawsearch.problem import Problem

_ENLARGEMENT = "enlargement"  # value of an enlarged law beside those of its parameters


@dataclass(frozen=True)
class EnlargedLaw:
    """A law that changes each trial by one number, with a step of that number.

    Attributes
    ----------
    effect : Law
    apply : SizedChange
        Of the law.
    step : float
        In the unit of the number.
    columns : list of arrays
        What the law followed in each prediction since it was enlarged.
    """

    effect: Law
    apply: SizedChange
    step: float
    columns: list[NDArray[np.generic]] = field(default_factory=list)

    def enlarge_at_point(
        self, values: Mapping[str, float], point: int, point_count: int
    ) -> tuple[Law, dict[str, float | Floats]]:
        """Return the law and its values at some points, enlarged by the step at one of them.

        Parameters
        ----------
        values : Mapping[str, float]
            Values of a fit, which hold at all points.
        point : int
            Number of the point at which the law is enlarged.
        point_count : int
            Number of points.
        """
        steps = np.zeros(point_count)
        steps[point] = self.step

        def compute_enlarged_size(
            column: NDArray[np.generic], law_values: Mapping[str, float]
        ) -> Floats:
            """Return the numbers of the law, larger by the enlargement, shape (n,)."""
            self.columns.append(column)
            return np.asarray(self.apply.size(column, law_values) + law_values[_ENLARGEMENT])

        law = replace(self.effect, apply=replace(self.apply, size=compute_enlarged_size))
        return law, {**self.effect.pick_own_values(values), _ENLARGEMENT: steps}

    def select_followed_column(self, point: int, trial_count: int) -> NDArray[np.generic]:
        """Return what the law followed at one of the points, each of as many trials."""
        return np.concatenate(self.columns)[point * trial_count : (point + 1) * trial_count]

    def differentiate_prediction(
        self, values: Mapping[str, float], change: Floats, point: int, step: float
    ) -> Floats:
        """Find the slopes of the prediction in each parameter of the law, shape (n, c, q).

        Each is the slope in the number of a trial times the slope of that number in the parameter,
        in units of its scale.

        Parameters
        ----------
        values : Mapping[str, float]
            Values of the fit.
        change : array of shape (n, c)
            Of the prediction, where the law is enlarged.
        point : int
            Number of the point at which it is enlarged.
        step : float
            By which parameters are moved, in units of their scales.
        """
        followed = self.select_followed_column(point, len(change))
        own_values = self.effect.pick_own_values(values)
        size = self.apply.size(followed, own_values)
        growths = []
        for p in self.effect.parameters:
            moved = {**own_values, p.name: own_values[p.name] + step * p.scale}
            growths.append(self.apply.size(followed, moved) - size)
        of_size = np.stack(growths, axis=1) / step
        slope = change / self.step
        return np.asarray(slope[:, :, None] * of_size[:, None])


def enlarge_sized_laws(effects: Sequence[Law], step: float) -> list[EnlargedLaw]:
    """Enlarge the laws that change each trial by one number, by a step in units of their scale."""
    enlarged = []
    for law in effects:
        if isinstance(law.apply, SizedChange):
            enlarged.append(EnlargedLaw(law, law.apply, step * law.parameters[0].scale))
    return enlarged


def predict_at_points_and_enlarged(
    problem: Problem,
    effects: Sequence[Law],
    values: Mapping[str, float],
    points: Mapping[str, Floats],
    enlarged: Sequence[EnlargedLaw],
) -> tuple[Floats, Floats]:
    """Predict all channels at points near a fit, and at the fit with one law enlarged at a time.

    One difference serves all trials, since a trial shows its own state alone.

    Parameters
    ----------
    problem : Problem
    effects : sequence of Law
        Those of the enlarged laws are among them.
    values : Mapping[str, float]
        Values of the fit.
    points : Mapping[str, Floats]
        Shape (m,), values of each constant of the model at the points; may be empty.
    enlarged : sequence of EnlargedLaw
        In the order of the effects.

    Returns
    -------
    at_points : array of shape (m, n, c)
    of_laws : array of shape (e, n, c)
    """
    shifted = len(next(iter(points.values()), ()))
    count = shifted + len(enlarged)
    columns = {}
    for p in problem.model.parameters(problem.trials):
        of_laws = np.full(len(enlarged), values[p.name])
        columns[p.name] = np.append(points.get(p.name, ()), of_laws)
    enlarged_by_id = {law.effect.id: law for law in enlarged}
    point = shifted
    active: list[tuple[Law, Mapping[str, float | Floats]]] = []
    for effect in effects:
        law = enlarged_by_id.get(effect.id)
        if law is None:
            active.append((effect, effect.pick_own_values(values)))
        else:
            active.append(law.enlarge_at_point(values, point, count))
            point += 1
    predicted = problem.predict_stack(count, columns, active)
    return predicted[:shifted], predicted[shifted:]
