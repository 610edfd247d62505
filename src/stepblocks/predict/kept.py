"""Predictions of a set that somebody is changing: what stays as it was is not predicted again."""

from collections.abc import Callable, Sequence

from stepblocks.declaration.set import StimulusSet
from stepblocks.parts.kind import Part
from stepblocks.predict.as_built import PredictedSet
from stepblocks.predict.neighbours import make_prediction_rows
from stepblocks.predict.predictions import Prediction, predict_and_drag_set


class KeptPredictions:
    """The predictions of the parts that a set had when it was predicted last, part by part.

    A part under the same conditions is felt the same: of a set of which one part is changed, that
    one alone is predicted. The distances to neighbours follow from all of them each time.
    """

    def __init__(self) -> None:
        self._conditions: object = None
        self._by_part: dict[Part, Sequence[Prediction]] = {}

    def predict_reusing_kept(
        self,
        stimuli: StimulusSet,
        dragged: bool,
        speed: float,
        is_wanted: Callable[[], bool] = lambda: True,
    ) -> PredictedSet | None:
        """Predict a set as `predict_as_declared` does, at a speed [m/s].

        `is_wanted` tells before each part whether the rest is wanted still. The result is None
        where it is not; the parts that were predicted until then are kept.
        """
        conditions = (stimuli.name, stimuli.prediction, stimuli.probe, dragged, speed)
        if conditions != self._conditions:
            self._by_part = {}
        self._conditions = conditions
        kept: dict[Part, Sequence[Prediction]] = {}
        predictions: list[Prediction] = []
        for part in stimuli.stimuli:
            found = None
            if _is_part_hashable(part):
                found = self._by_part.get(part)
            if found is None and not is_wanted():
                self._by_part |= kept
                return None
            if found is None:
                found = predict_and_drag_set(stimuli.with_parts([part]), dragged, speed)
            if _is_part_hashable(part):
                kept[part] = found
            predictions += found
        self._by_part = kept
        rows = make_prediction_rows(stimuli, predictions)
        return PredictedSet(stimuli, tuple(predictions), rows)


def _is_part_hashable(part: Part) -> bool:
    """Tell whether a part can be found again; one that holds arrays, of a scan say, cannot."""
    try:
        hash(part)
    except TypeError:
        return False
    return True
