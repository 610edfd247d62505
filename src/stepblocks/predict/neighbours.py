"""How well the stimuli of a set are told apart: each pair under each tip, load and friction."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd

from stepblocks.contact import Array
from stepblocks.contact.counterface import Counterface, FurtherStep, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER
from stepblocks.contact.uncertainty import compute_deviated_releases, draw_standard_normal_inputs
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError
from stepblocks.mistakes import shorten_value
from stepblocks.parts.kind import Part
from stepblocks.predict.columns import Cell, make_prediction_row
from stepblocks.predict.perception import (
    DRAWS,
    LITERATURE,
    Discrimination,
    JndDistance,
    choose_compared_energies,
    compute_jnd_distance,
)
from stepblocks.predict.predictions import (
    Prediction,
    collect_standard_uncertainties,
    find_felt_edge,
    make_mid_tolerance_face,
    make_tip_dimension,
    predict_and_drag_set,
)

# kind of counterface, direction, radius of the tip [m], friction [1], load [N]
Condition: TypeAlias = tuple[str, str, float, float, float]

# inputs that two stimuli under one tip share: what is not known of them is the same for both
_SHARED = ("ball_radius", "friction", "normal_load", "stiffness", "conversion")
_MOST_DIMENSIONS = 8  # of a stimulus that deviate by themselves
_FEWEST_DRAWS = 100  # in which both stimuli ring, for an interval
_MOST_PAIRS = 100_000
_KEPT_DRAWS = 32  # stimuli whose draws are kept, of 64 kB each
_PAIR_COLUMNS = (
    "set",
    "drag",
    "tip_radius_um",
    "normal_load_n",
    "friction",
    "stimulus",
    "compared_with",
    "neighbours",
    "felt_by",
    "felt_energy_uj",
    "compared_energy_uj",
    "jnd",
    "jnd_95_low",
    "jnd_95_high",
    "correct_share",
)


@dataclass(frozen=True)
class Pair:
    """Two stimuli that a person compares under one tip, load and friction.

    Attributes
    ----------
    first, second : Prediction
        In rising order of height, of other stimuli than steps in rising order of energy.
    energies : tuple of float
        That are felt of both [J].
    felt_by : str
        ``"formula"`` or ``"drag"``: which gives them, the same for both.
    neighbours : bool
        Whether no other stimulus of the set that rings lies between the two.
    distance : JndDistance
        In just noticeable differences.
    """

    first: Prediction
    second: Prediction
    energies: tuple[float, float]
    felt_by: str
    neighbours: bool
    distance: JndDistance

    def make_pair_row(self) -> dict[str, Cell | bool]:
        """Put the pair into the columns of the table of pairs."""
        first = self.first
        point = first.point
        distance = self.distance
        felt_energy, compared_energy = self.energies
        return {
            "set": first.set_name,
            "drag": first.edge_direction,
            "tip_radius_um": point.ball_radius * 1e6,
            "normal_load_n": point.normal_load,
            "friction": point.friction,
            "stimulus": first.edge_name,
            "compared_with": self.second.edge_name,
            "neighbours": self.neighbours,
            "felt_by": self.felt_by,
            "felt_energy_uj": felt_energy * 1e6,
            "compared_energy_uj": compared_energy * 1e6,
            "jnd": distance.jnd,
            "jnd_95_low": distance.low,
            "jnd_95_high": distance.high,
            "correct_share": distance.correct_share,
        }


def compare_stimuli(
    stimuli: StimulusSet | str | Path,
    discrimination: Discrimination = LITERATURE,
    *,
    dragged: bool | None = None,
    speed: float = PAPER.speed,
) -> pd.DataFrame:
    """Tell how well each pair of a set is told apart, under every tip, load and friction.

    Parameters
    ----------
    stimuli : StimulusSet, str or Path
        The set, or its file.
    discrimination : Discrimination
        Of the person, by default 1.5 dB of power within a factor of two; `read_discrimination`
        reads what was measured.
    dragged : bool, optional
        Whether each condition is dragged in time; by default up to 10,000 of them.
    speed : float
        Of the handle in those drags [m/s].

    Returns
    -------
    pandas.DataFrame
        One row for each pair that rings: ``jnd``, the just noticeable differences from
        ``stimulus`` to ``compared_with``, negative where the higher block rings less, with its
        95 % interval, and ``correct_share``, the share of judgements that tell them apart.

    Raises
    ------
    StepblocksError
        If the file cannot be read, or there are more than 100,000 pairs.

    Examples
    --------
    >>> import stepblocks as sb
    >>> pairs = sb.compare_stimuli("stimuli/paper-ten.toml")  # doctest: +SKIP
    >>> pairs[pairs.neighbours & (pairs.jnd < 1)]  # doctest: +SKIP
    """
    if not isinstance(stimuli, StimulusSet | str | Path):
        raise PipelineError(f"stimuli must be a set or its file, got {shorten_value(stimuli)}")
    if not isinstance(stimuli, StimulusSet):
        stimuli = load_set(Path(stimuli))
    return tabulate_pairs(
        iterate_pairs(stimuli, predict_and_drag_set(stimuli, dragged, speed), discrimination)
    )


def tabulate_pairs(pairs: Iterable[Pair]) -> pd.DataFrame:
    """Make a table of pairs; its columns stand even where there is no pair."""
    rows = [pair.make_pair_row() for pair in pairs]
    return pd.DataFrame(rows, columns=list(_PAIR_COLUMNS))


def make_prediction_rows(
    stimuli: StimulusSet,
    predictions: Sequence[Prediction],
    discrimination: Discrimination = LITERATURE,
) -> list[dict[str, Cell]]:
    """Put the predictions of a set into rows, with the distance to the next stimulus behind.

    The next one is the neighbour that is higher; the cells are NaN where there is none.
    """
    pairs = iterate_pairs(stimuli, predictions, discrimination, only_neighbours=True)
    distances = {id(pair.first): pair.distance for pair in pairs}
    unknown = JndDistance(math.nan, math.nan, math.nan)
    rows = []
    for prediction in predictions:
        distance = distances.get(id(prediction), unknown)
        rows.append(
            {
                **make_prediction_row(prediction),
                "jnd_to_next": distance.jnd,
                "jnd_to_next_95_low": distance.low,
                "jnd_to_next_95_high": distance.high,
            }
        )
    return rows


def iterate_pairs(
    stimuli: StimulusSet,
    predictions: Iterable[Prediction],
    discrimination: Discrimination = LITERATURE,
    *,
    only_neighbours: bool = False,
) -> Iterator[Pair]:
    """Yield the pairs of a set's stimuli that ring under the same condition.

    Tips and sheaths are no stimuli to compare: what is felt of them depends on the step.
    """
    parts = {part.id: part for part in stimuli.stimuli if part.crossed}
    groups = _group_releases_by_condition(predictions, parts)
    count = sum(_count_pairs(len(group), only_neighbours) for group in groups)
    if count > _MOST_PAIRS:
        raise PipelineError(f"a set must have at most {_MOST_PAIRS} pairs, got {count}")
    for group in groups:
        yield from _iterate_pairs_of_condition(
            stimuli, parts, group, discrimination, only_neighbours
        )


def _count_pairs(stimulus_count: int, only_neighbours: bool) -> int:
    """Count the pairs of so many stimuli."""
    if only_neighbours:
        return max(stimulus_count - 1, 0)
    return math.comb(stimulus_count, 2)


def _group_releases_by_condition(
    predictions: Iterable[Prediction], parts: dict[str, Part]
) -> list[list[Prediction]]:
    """Group what releases by kind of counterface, direction, tip, friction and load."""
    groups: dict[Condition, list[Prediction]] = {}
    for prediction in predictions:
        is_compared = prediction.stimulus in parts
        if not is_compared or prediction.release.status is not Status.RELEASES:
            continue
        point = prediction.point
        condition = (
            _get_face_kind_name(prediction.face),
            prediction.edge_direction,
            point.ball_radius,
            point.friction,
            point.normal_load,
        )
        groups.setdefault(condition, []).append(prediction)
    return list(groups.values())


def _get_face_kind_name(face: Counterface) -> str:
    """Name the kind of a counterface; a second step of a block is compared as any step."""
    if isinstance(face, FurtherStep):
        return Step.__name__
    return type(face).__name__


def _iterate_pairs_of_condition(
    stimuli: StimulusSet,
    parts: dict[str, Part],
    group: list[Prediction],
    discrimination: Discrimination,
    only_neighbours: bool,
) -> Iterator[Pair]:
    """Yield the pairs under one condition, in rising order."""
    energies, felt_by = choose_compared_energies(group)
    ringing = []
    for prediction, energy in zip(group, energies, strict=True):
        if energy > 0.0:
            ringing.append((prediction, energy))
    ringing.sort(key=lambda found: _get_sort_key(*found))
    draws = []
    for place, (prediction, _) in enumerate(ringing):
        part = parts[prediction.stimulus]
        draws.append(_sample_log_energies(stimuli, part, prediction, place))
    for first, second in combinations(range(len(ringing)), 2):
        are_neighbours = second == first + 1
        if only_neighbours and not are_neighbours:
            continue
        (lower, low), (higher, high) = ringing[first], ringing[second]
        yield Pair(
            first=lower,
            second=higher,
            energies=(low, high),
            felt_by=felt_by,
            neighbours=are_neighbours,
            distance=_compute_distance_with_interval(
                low, high, discrimination, draws[second] - draws[first]
            ),
        )


def _get_sort_key(prediction: Prediction, energy: float) -> float:
    """Return the key by which stimuli are sorted: the height [m] of steps, else the energy [J]."""
    if isinstance(prediction.face, Step):
        return prediction.face.height
    return energy


def get_pair_sort_key(pair: Pair) -> float:
    """Return the key by which pairs are sorted: that of the lower stimulus."""
    return _get_sort_key(pair.first, pair.energies[0])


def _compute_distance_with_interval(
    low: float, high: float, discrimination: Discrimination, drawn_differences: Array
) -> JndDistance:
    """Compute a distance with the interval of both stimuli over the draws in which both ring.

    `drawn_differences` are of ln E, about the middle of the zones of the tolerances; the interval
    lies about what is felt, which the drag may say.
    """
    known = drawn_differences[np.isfinite(drawn_differences)]
    if len(known) < _FEWEST_DRAWS:
        distance = compute_jnd_distance(low, high, discrimination)
        return JndDistance(distance.jnd, math.nan, math.nan)
    log_ratio = math.log(high / low)
    deviations = known - float(np.median(known))
    return compute_jnd_distance(low, high, discrimination, log_ratios=log_ratio + deviations)


def _sample_log_energies(
    stimuli: StimulusSet, part: Part, prediction: Prediction, stimulus_index: int
) -> Array:
    """Draw ln(E / J) of a stimulus within its tolerances and those of the setting, shape (draws,).

    The setting deviates alike for all stimuli, the dimensions of each by themselves; infinite or
    NaN where the drawn stimulus is held or does not ring.
    """
    point = prediction.point
    grid = stimuli.find_conditions(part)
    edge = find_felt_edge(part, prediction)
    ball = make_tip_dimension(grid, point.ball_radius)
    uncertainties = collect_standard_uncertainties(edge, grid, ball, point.normal_load)
    shared = draw_standard_normal_inputs(len(_SHARED), DRAWS, seed=0)
    alone = _sample_dimension_deviates(stimulus_index)
    normal = dict(zip(_SHARED, shared, strict=True))
    dimensions = [name for name in uncertainties if name not in _SHARED]
    normal |= dict(zip(dimensions, alone, strict=False))
    deviations = {}
    for name, width in uncertainties.items():
        deviations[name] = width * normal[name]
    _, energies = compute_deviated_releases(
        make_mid_tolerance_face(edge, None), point, deviations, prediction.backward
    )
    with np.errstate(divide="ignore"):
        logs: Array = np.log(np.broadcast_to(energies, DRAWS))
    return np.where(np.isfinite(logs), logs, math.nan)


@lru_cache(maxsize=_KEPT_DRAWS)
def _sample_dimension_deviates(stimulus_index: int) -> Array:
    """Draw standard normal numbers for the dimensions of the stimulus at a place of its order."""
    return draw_standard_normal_inputs(_MOST_DIMENSIONS, DRAWS, seed=stimulus_index + 1)
