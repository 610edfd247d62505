"""What will be felt: every stimulus of a set under every tip, load and friction asked for."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import product
from typing import TYPE_CHECKING

from stepblocks.contact.counterface import Counterface, FurtherStep, Step
from stepblocks.contact.energy import Release, Status, find_release
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.contact.uncertainty import Interval, convert_half_widths_to_stds, estimate_interval
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import ContactError, PipelineError
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import Dimension

if TYPE_CHECKING:
    from stepblocks.drag.ring import Ring
    from stepblocks.drag.simulate import DragTrace

# draws of each interval: its ends scatter by 2 % of its width, and a thousand blocks take seconds
_DRAWS = 2000
# rows of a set that are dragged in time without being asked for: a few seconds
MOST_DRAGGED = 10_000
# factor between the formula's energy and the drag's beyond which the drag's is what is felt [1]
DIFFERS = 1.5


def differs_from_formula(drag_over_formula: float) -> bool:
    """Tell whether a drag's energy over the formula's [1] is beyond a factor of `DIFFERS`."""
    return drag_over_formula > DIFFERS or drag_over_formula < 1.0 / DIFFERS


class Model(StrEnum):
    """Which of the two predictions of a ring's energy counts."""

    FORMULA = "formula"
    DRAG = "drag"


@dataclass(frozen=True)
class InTime:
    """What the drag in time gives for the same condition."""

    status: str  # "releases", "no-catch", "locked", or why it could not be dragged
    peak_force: float = math.nan  # N
    energy: float = 0.0  # of the ring [J]; 0 where the tip walks over the edge and nothing rings
    share: float = 0.0  # of the stored energy that rings [1]


@dataclass(frozen=True)
class Prediction:
    """One stimulus under one condition."""

    set_name: str
    stimulus: str
    face: Counterface  # what is met, at its nominal dimensions
    point: OperatingPoint  # under what
    backward: bool
    release: Release  # at the nominal dimensions
    # at the least and the greatest angle within the tolerances of the stimulus
    limits: tuple[Release, Release]
    # of 95 %, from all tolerances of stimulus and setting; None where there are none
    interval: Interval | None
    in_time: InTime | None = None  # None where it was not dragged

    @property
    def drag_direction(self) -> str:
        """Direction: ``"up"`` a step, ``"tooth-to-crown"`` or ``"crown-to-tooth"``.

        Over the second edge of a block it is ``"second-up"``.
        """
        return self.face.ways[self.backward]

    @property
    def is_second_edge(self) -> bool:
        """Whether it is met at the second edge of a block."""
        return isinstance(self.face, FurtherStep)

    @property
    def edge_direction(self) -> str:
        """Direction over an edge, whichever of its block it is."""
        if self.is_second_edge:
            return Step.ways[self.backward]
        return self.drag_direction

    @property
    def edge_name(self) -> str:
        """Name of the stimulus, with the edge where it is the second one of a block."""
        if self.is_second_edge:
            return f"{self.stimulus}, second step"
        return self.stimulus

    @property
    def energy_over_formula(self) -> float:
        """Energy of the drag over that of the formula [1]; NaN where one of them is not known."""
        if self.in_time is None or self.release.status is not Status.RELEASES:
            return math.nan
        return self.in_time.energy / self.release.vibration_energy

    @property
    def drag_differs(self) -> bool:
        """Whether drag and formula are further apart than a factor of `DIFFERS`."""
        return differs_from_formula(self.energy_over_formula)

    @property
    def felt_model(self) -> Model:
        """The model whose energy is felt: the formula, or the drag where the two differ."""
        if self.drag_differs:
            return Model.DRAG
        return Model.FORMULA

    @property
    def felt_energy(self) -> float:
        """Energy that is felt [J], by the model of `felt_by`; NaN where nothing is known."""
        if self.drag_differs and self.in_time is not None:
            return self.in_time.energy
        return self.release.vibration_energy


def predict_and_drag_set(
    stimuli: StimulusSet, dragged: bool | None = None, speed: float = PAPER.speed
) -> tuple[Prediction, ...]:
    """Predict a set and drag its conditions in time at a speed [m/s].

    `dragged` asks for all or none; None for all of up to `MOST_DRAGGED`.
    """
    if not (math.isfinite(speed) and speed > 0.0):
        raise PipelineError(f"speed must be positive and finite, got {speed:g} m/s")
    predictions = tuple(predict_by_formula(stimuli))
    if dragged is None:
        dragged = len(predictions) <= MOST_DRAGGED
    if not dragged:
        return predictions
    with_drags = []
    for prediction in predictions:
        in_time = _predict_in_time(prediction, speed)
        with_drags.append(replace(prediction, in_time=in_time))
    return tuple(with_drags)


def predict_single_drag(
    face: Counterface, point: OperatingPoint, backward: bool = False
) -> Prediction:
    """Predict one drag by the formula and in time, without tolerances."""
    release = face.release(point, backward)
    prediction = Prediction(
        set_name="",
        stimulus="",
        face=face,
        point=point,
        backward=backward,
        release=release,
        limits=(release, release),
        interval=None,
    )
    return replace(prediction, in_time=_predict_in_time(prediction, point.speed))


def predict_by_formula(stimuli: StimulusSet) -> Iterator[Prediction]:
    """Predict a set over its grid.

    The order is stimulus, edge, tip, step, direction, friction, load.
    """
    for part in stimuli.stimuli:
        if not part.is_felt:
            continue
        grid = stimuli.find_conditions(part)
        for edge in part.list_felt_edges():
            for ball, step_height in product(
                _list_balls(part, grid), _list_step_heights(part, grid)
            ):
                yield from _iterate_predictions_under_ball(stimuli, edge, ball, step_height)


def find_felt_edge(part: Part, prediction: Prediction) -> Part:
    """Return the part that stands for the edge of a part that a prediction is of."""
    first, *further = part.list_felt_edges()
    if prediction.is_second_edge and further:
        return further[0]
    return first


def _list_balls(part: Part, grid: PredictionGrid) -> list[Dimension]:
    """List the balls that cross a part: those of the setting, or the part's own if it is a tip."""
    if part.ball is not None:
        return [part.ball]
    return [make_tip_dimension(grid, radius) for radius in grid.tip_radii]


def _list_step_heights(part: Part, grid: PredictionGrid) -> tuple[float | None, ...]:
    """List heights of the steps that a tip is dragged over [m]; None for a part that is crossed."""
    if part.crossed:
        return (None,)
    return tuple(grid.step_heights)


def _iterate_predictions_under_ball(
    stimuli: StimulusSet, part: Part, ball: Dimension, step_height: float | None
) -> Iterator[Prediction]:
    """Predict a part under one ball, in the order direction, friction, load."""
    grid = stimuli.find_conditions(part)
    setting = choose_operating_point(stimuli, part, {})
    faces = list(part.corners(step_height))
    # the tolerance of a tip of the setting is no limit of the part
    radii = (ball.nominal,) if part.ball is None else ball.limits
    nominal_angles = faces[0].angles(ball.nominal)
    corner_angles = [face.angles(radius) for face, radius in product(faces, radii)]
    middle = make_mid_tolerance_face(part, step_height)
    worn = _compute_stiffness_tolerance(stimuli, part)
    for backward in range(len(faces[0].ways)):
        reached = [angles[backward] for angles in corner_angles]
        angles = (nominal_angles[backward], min(reached), max(reached))
        for friction, load in product(grid.frictions_or_law, grid.normal_loads):
            point = replace(setting, ball_radius=ball.nominal, normal_load=load, friction=friction)
            releases = []
            for angle in angles:
                releases.append(find_release(angle, load, point.friction, point.tool))
            release, low, high = releases
            uncertainties = _collect_uncertainties_with_sheath(part, grid, ball, load, worn)
            interval = None
            if any(uncertainties.values()):
                interval = estimate_interval(
                    middle,
                    replace(point, ball_radius=compute_zone_middle(ball)),
                    uncertainties,
                    backward=bool(backward),
                    draws=_DRAWS,
                )
            yield Prediction(
                set_name=stimuli.name,
                stimulus=part.id,
                face=faces[0],
                point=point,
                backward=bool(backward),
                release=release,
                limits=(low, high),
                interval=interval,
            )


def make_mid_tolerance_face(part: Part, step_height: float | None) -> Counterface:
    """Make the counterface in the middle of all tolerance zones, one-sided ones included."""
    if not part.crossed:
        return part.counterface(step_height)
    sizes = {name: compute_zone_middle(dimension) for name, dimension in part.sizes.items()}
    return part.make_counterface(**sizes)


def make_tip_dimension(grid: PredictionGrid, radius: float) -> Dimension:
    """Return a tip of the setting with its tolerance [m]."""
    width = grid.tolerances.tip_radius
    return Dimension(radius, width, -width)


def _collect_uncertainties_with_sheath(
    part: Part, grid: PredictionGrid, ball: Dimension, load: float, stiffness_tolerance: float
) -> dict[str, float]:
    """Collect those of part and setting, with what a sheath's tolerances add to the spring."""
    uncertainties = collect_standard_uncertainties(part, grid, ball, load)
    worn = convert_half_widths_to_stds({"stiffness": stiffness_tolerance})["stiffness"]
    uncertainties["stiffness"] = math.hypot(uncertainties["stiffness"], worn)
    return uncertainties


def collect_standard_uncertainties(
    part: Part, grid: PredictionGrid, ball: Dimension, load: float
) -> dict[str, float]:
    """Take every tolerance as rectangular over its zone, in the names of `estimate_interval`."""
    tolerances = grid.tolerances
    # a profile without a closed form is taken as known; its corners still stand beside the interval
    known = part.counterface().dimensions if part.crossed else {}
    half_widths = {}
    for name, dimension in part.sizes.items():
        if name in known:
            half_widths[name] = compute_zone_half_width(dimension)
    half_widths["ball_radius"] = compute_zone_half_width(ball)
    half_widths["friction"] = tolerances.friction
    half_widths["normal_load"] = tolerances.normal_load * load
    half_widths["stiffness"] = tolerances.stiffness * grid.tool.stiffness
    half_widths["conversion"] = tolerances.conversion * grid.tool.conversion
    return convert_half_widths_to_stds(half_widths)


def _compute_stiffness_tolerance(stimuli: StimulusSet, part: Part) -> float:
    """Compute how far the tolerances of a sheath move the spring [N/m], summed in quadrature."""
    if stimuli.probe is None or part.sleeve is None:
        return 0.0
    deviation = 0.0
    for name, dimension in part:
        if not isinstance(dimension, Dimension) or dimension.upper <= dimension.lower:
            continue
        stiffnesses = []
        for end in dimension.limits:
            changed = part.model_copy(update={name: replace(dimension, nominal=end)})
            if changed.sleeve is not None:
                stiffnesses.append(stimuli.probe.predict_ring(changed.sleeve).stiffness)
        low, high = stiffnesses
        deviation = math.hypot(deviation, 0.5 * (high - low))
    return deviation


def compute_zone_middle(dimension: Dimension) -> float:
    """Compute the middle of the zone of a tolerance."""
    return dimension.nominal + 0.5 * (dimension.upper + dimension.lower)


def compute_zone_half_width(dimension: Dimension) -> float:
    """Compute half the width of the zone of a tolerance."""
    return 0.5 * (dimension.upper - dimension.lower)


def drag_and_measure_ring(
    face: Counterface, point: OperatingPoint, backward: bool, speed: float, **probe: float
) -> "tuple[DragTrace, Ring | None]":
    """Drag in time and measure the ring of a tip that releases; `probe` overrides the tool."""
    from stepblocks.drag.events import drag_face
    from stepblocks.drag.ring import measure_ring

    trace = drag_face(face, point, backward, settings={"speed": speed}, probe=probe)
    if trace.status is not Status.RELEASES:
        return trace, None
    return trace, measure_ring(trace, with_spectra=False)


def _predict_in_time(prediction: Prediction, speed: float) -> InTime | None:
    """Drag a condition in time at a speed [m/s]; None where the formula lets nothing slip."""
    if prediction.release.status is not Status.RELEASES:
        return None
    try:
        trace, ring = drag_and_measure_ring(
            prediction.face, prediction.point, prediction.backward, speed
        )
    except ContactError as error:
        return InTime(f"not dragged: {error}", energy=math.nan, share=math.nan)
    if ring is None:
        return InTime(str(trace.status), trace.peak_force)
    return InTime(str(trace.status), trace.peak_force, ring.energy, ring.share)


def describe_felt_model(predictions: Iterable[Prediction]) -> list[str]:
    """Say which of the two energies is felt, where any row is felt by the drag."""
    predictions = list(predictions)
    by_drag = sum(prediction.felt_model is Model.DRAG for prediction in predictions)
    if not by_drag:
        return []
    rows = "rows are"
    if by_drag == 1:
        rows = "row is"
    return [
        f"{by_drag} of {len(predictions)} {rows} felt by the drag: felt_energy_uj is "
        "drag_vibration_energy_uj",
        "vibration_energy_uj is that of equation (1), with which the scenes of export ring",
    ]


def describe_predictions_beyond_limits(predictions: Iterable[Prediction]) -> list[str]:
    """Say by name what lies beyond a limit, and so in no mean, range or pair of neighbours."""
    stimuli_beyond: dict[tuple[Status, float], list[str]] = {}
    for prediction in predictions:
        status = prediction.release.status
        if status.is_beyond_limit:
            _, limit = prediction.point.tool.limits.first
            stimuli_beyond.setdefault((status, limit), []).append(prediction.stimulus)
    sentences = []
    for (status, limit), names in stimuli_beyond.items():
        distinct = ", ".join(dict.fromkeys(names))
        rows = "row" if len(names) == 1 else "rows"
        sentences.append(
            f"{status} ({limit:g} N), no energy, left out of every mean: {len(names)} {rows} of "
            f"{distinct}"
        )
    return sentences
