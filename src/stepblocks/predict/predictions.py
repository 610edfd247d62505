"""What will be felt: every stimulus of a set under every tip, load and friction asked for."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Release, Status, find_release
from stepblocks.contact.kernels import compute_locking_height
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.contact.uncertainty import Interval, convert_half_widths, estimate_interval
from stepblocks.declaration.set import StimulusSet, choose_operating_point
from stepblocks.errors import ContactError, PipelineError
from stepblocks.files.tables import format_csv
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import Dimension

if TYPE_CHECKING:
    from stepblocks.drag.ring import Ring
    from stepblocks.drag.simulate import DragTrace

# of each interval: its ends scatter by 2 % of its width, and a thousand blocks still take seconds
_DRAWS = 2000
MOST_DRAGGED = 10_000  # rows of a set that are dragged in time without being asked: a few seconds
# factor between the formula's energy and the drag's beyond which the drag's is what is felt [1]
DIFFERS = 1.5


_FIGURE = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")


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
    def drag(self) -> str:
        """Direction: ``"up"`` a step, ``"tooth-to-crown"`` or ``"crown-to-tooth"``."""
        return self.face.ways[self.backward]

    @property
    def over_formula(self) -> float:
        """Energy of the drag over that of the formula [1]; NaN where one of them is not known."""
        return (
            self.in_time.energy / self.release.vibration_energy
            if self.in_time is not None and self.release.status is Status.RELEASES
            else math.nan
        )

    @property
    def differs(self) -> bool:
        """Whether drag and formula are further apart than a factor of `DIFFERS`."""
        return self.over_formula > DIFFERS or self.over_formula < 1.0 / DIFFERS

    @property
    def felt_energy(self) -> float:
        """Energy that is felt [J]: the formula's, or the drag's where they differ; else NaN."""
        return (
            self.in_time.energy if self.differs and self.in_time else self.release.vibration_energy
        )


def predict_by_formula(stimuli: StimulusSet) -> Iterator[Prediction]:
    """Predict a set over its grid, in the order stimulus, tip, step, direction, friction, load."""
    for part in stimuli.stimuli:
        grid = stimuli.find_conditions(part)
        first = choose_operating_point(stimuli, part, {})
        worn = convert_half_widths({"stiffness": _compute_stiffness_tolerance(stimuli, part)})[
            "stiffness"
        ]
        balls = (
            [find_tip(grid, radius) for radius in grid.tip_radii]
            if part.ball is None
            else [part.ball]
        )
        for ball, step_height in product(balls, (None,) if part.crossed else grid.step_heights):
            faces = list(part.corners(step_height))
            # the tolerance of a tip of the setting is no limit of the part
            radii = (ball.nominal,) if part.ball is None else ball.limits
            corners = [face.angles(radius) for face in faces for radius in radii]
            nominal = faces[0].angles(ball.nominal)
            # of a one-sided tolerance the expectation is not the nominal
            sizes = {name: find_zone_middle(one) for name, one in part.sizes.items()}
            middle = (
                part.make_counterface(**sizes) if part.crossed else part.counterface(step_height)
            )
            for backward in range(len(faces[0].ways)):
                reached = [angles[backward] for angles in corners]
                angles = nominal[backward], min(reached), max(reached)
                for friction, load in product(grid.coefficients, grid.normal_loads):
                    point = replace(
                        first, ball_radius=ball.nominal, normal_load=load, friction=friction
                    )
                    release, low, high = (
                        find_release(angle, load, point.friction, point.tool) for angle in angles
                    )
                    spread = collect_uncertainties(part, grid, ball, load)
                    spread["stiffness"] = math.hypot(spread["stiffness"], worn)
                    at = replace(point, ball_radius=find_zone_middle(ball))
                    yield Prediction(
                        set_name=stimuli.name,
                        stimulus=part.id,
                        face=faces[0],
                        point=point,
                        backward=bool(backward),
                        release=release,
                        limits=(low, high),
                        interval=estimate_interval(
                            middle, at, spread, backward=bool(backward), draws=_DRAWS
                        )
                        if any(spread.values())
                        else None,
                    )


def _compute_stiffness_tolerance(stimuli: StimulusSet, part: Part) -> float:
    # Find how far the tolerances of a sheath move the spring [N/m], summed in quadrature
    if stimuli.probe is None or part.sleeve is None:
        return 0.0
    deviation = 0.0
    for name, one in part:
        if isinstance(one, Dimension) and one.upper > one.lower:
            ends = (
                part.model_copy(update={name: replace(one, nominal=end)}).sleeve
                for end in one.limits
            )
            low, high = (
                stimuli.probe.ring(sleeve).stiffness for sleeve in ends if sleeve is not None
            )
            deviation = math.hypot(deviation, 0.5 * (high - low))
    return deviation


def find_tip(grid: PredictionGrid, radius: float) -> Dimension:
    """Return a tip of the setting with its tolerance [m]."""
    width = grid.tolerances.tip_radius
    return Dimension(radius, width, -width)


def collect_uncertainties(
    part: Part, grid: PredictionGrid, ball: Dimension, load: float
) -> dict[str, float]:
    """Take every tolerance as rectangular over its zone, in the names of `estimate_interval`."""
    off = grid.tolerances
    # a profile without a closed form is taken as known; its corners still stand beside the interval
    known = part.counterface().dimensions if part.crossed else {}
    return convert_half_widths(
        {name: find_half_width(one) for name, one in part.sizes.items() if name in known}
        | {
            "ball_radius": find_half_width(ball),
            "friction": off.friction,
            "normal_load": off.normal_load * load,
            "stiffness": off.stiffness * grid.tool.stiffness,
            "conversion": off.conversion * grid.tool.conversion,
        }
    )


def find_zone_middle(dimension: Dimension) -> float:
    """Middle of the zone of a tolerance."""
    return dimension.nominal + 0.5 * (dimension.upper + dimension.lower)


def find_half_width(dimension: Dimension) -> float:
    """Half the width of the zone of a tolerance."""
    return 0.5 * (dimension.upper - dimension.lower)


def tabulate_prediction(prediction: Prediction) -> dict[str, float | str]:
    """Put a prediction into the columns of ``predictions.csv``; NaN where there is no figure."""
    # ``low`` and ``high`` are the worst cases within the tolerances, ``95_low`` and ``95_high`` the
    # ends of the drawn 95 % interval, ``analytic_95`` the same by first-order sensitivities; beyond
    # a limit there is no energy. ``drag`` is what the drag in time says, ``felt`` the formula's or,
    # where they differ by more than `DIFFERS`, the drag's.
    release = prediction.release
    low, high = prediction.limits
    interval = prediction.interval
    tool = prediction.point.tool
    dragged = prediction.in_time
    power = prediction.felt_energy / tool.ring_duration
    felt_by = "drag" if prediction.differs else "formula"
    agreement = (
        ("yes" if interval.agrees else "no")
        if interval is not None and not release.status.is_beyond_limit
        else ""
    )

    def read_bound(name: str) -> float:
        unknown = interval is None or (release.status.is_beyond_limit and "force" not in name)
        return math.nan if unknown else float(getattr(interval, name))

    def read_energy(one: Release) -> float:
        return math.nan if release.status.is_beyond_limit else one.vibration_energy * 1e6

    locking = float(compute_locking_height(prediction.point.ball_radius, prediction.point.friction))
    return {
        "set": prediction.set_name,
        "stimulus": prediction.stimulus,
        "drag": prediction.drag,
        "tip_radius_um": prediction.point.ball_radius * 1e6,
        "step_height_um": prediction.face.far_side * 1e6,
        "normal_load_n": prediction.point.normal_load,
        "friction": prediction.point.friction,
        "critical_angle_deg": math.degrees(release.angle),
        "status": release.status.value,
        "status_at_limits": "/".join(dict.fromkeys((low.status.value, high.status.value))),
        "pull_force_n": release.pull_force,
        "pull_force_low_n": low.pull_force,
        "pull_force_high_n": high.pull_force,
        "vibration_energy_uj": release.vibration_energy * 1e6,
        "vibration_energy_low_uj": read_energy(low),
        "vibration_energy_high_uj": read_energy(high),
        "conversion": tool.conversion,
        "mean_power_uw": release.mean_power * 1e6,
        "threshold_ratio": release.threshold_ratio,
        "locking_height_um": math.nan if release.status is Status.NO_CATCH else locking * 1e6,
        "pull_force_95_low_n": read_bound("force_low"),
        "pull_force_95_high_n": read_bound("force_high"),
        "vibration_energy_95_low_uj": read_bound("energy_low") * 1e6,
        "vibration_energy_95_high_uj": read_bound("energy_high") * 1e6,
        "vibration_energy_analytic_95_low_uj": read_bound("analytic_energy_low") * 1e6,
        "vibration_energy_analytic_95_high_uj": read_bound("analytic_energy_high") * 1e6,
        "held_probability": interval.held_probability if interval else math.nan,
        "intervals_agree": agreement,
        "limit_n": tool.limits.first[1] if release.status.is_beyond_limit else math.nan,
        "frequency_hz": tool.frequency,
        "frequency_low_hz": tool.frequency - tool.frequency_deviation,
        "frequency_high_hz": tool.frequency + tool.frequency_deviation,
        "drag_status": dragged.status if dragged else "",
        "drag_pull_force_n": dragged.peak_force if dragged else math.nan,
        "drag_vibration_energy_uj": dragged.energy * 1e6 if dragged else math.nan,
        "drag_conversion": dragged.share if dragged else math.nan,
        "drag_over_formula": prediction.over_formula,
        "felt_by": "" if math.isnan(power) else felt_by,
        "felt_energy_uj": prediction.felt_energy * 1e6,
        "felt_power_uw": power * 1e6,
    }


def format_row(row: Mapping[str, float | str]) -> dict[str, str]:
    """Format the figures of a table's row."""
    return {
        name: one if isinstance(one, str) else format_six_digits(one) for name, one in row.items()
    }


def format_six_digits(figure: float) -> str:
    """Format a figure for a table; nothing where there is none."""
    return "" if math.isnan(figure) else f"{figure:.6g}"


def agree_to_last_digit(one: str, other: str) -> bool:
    """Whether two cells of a table agree, figures to one in the sixth digit."""
    return one == other or bool(
        _FIGURE.fullmatch(one)
        and _FIGURE.fullmatch(other)
        and abs(float(one) - float(other))
        < 1.5 * 10.0 ** (math.floor(math.log10(max(abs(float(one)), abs(float(other))))) - 5)
    )


def predict_all(
    stimuli: StimulusSet, dragged: bool | None = None, speed: float = PAPER.speed
) -> tuple[Prediction, ...]:
    """Predict a set and drag its conditions in time at a speed [m/s].

    `dragged` asks for all or none; None for all of up to `MOST_DRAGGED`.
    """
    PipelineError.require(
        math.isfinite(speed) and speed > 0.0,
        f"speed must be positive and finite, got {speed:g} m/s",
    )
    predictions = tuple(predict_by_formula(stimuli))
    if dragged is None:
        dragged = len(predictions) <= MOST_DRAGGED
    return (
        tuple(replace(one, in_time=_measure_drag(one, speed)) for one in predictions)
        if dragged
        else predictions
    )


def format_predictions_csv(
    predictions: Iterable[Prediction], more: Callable[[Prediction], dict[str, str]] | None = None
) -> str:
    """Write predictions as ``predictions.csv``, with further columns behind."""
    return format_csv(
        [format_row(tabulate_prediction(one)) | (more(one) if more else {}) for one in predictions]
    )


_HIDDEN = (
    *(
        "set",
        "critical_angle_deg",
        "status_at_limits",
        "conversion",
        "mean_power_uw",
        "threshold_ratio",
    ),
    *(
        "locking_height_um",
        "held_probability",
        "intervals_agree",
        "drag_status",
        "drag_over_formula",
        "felt_power_uw",
    ),
    *("_low_n", "_high_n", "_low_uj", "_high_uj", "_hz", "drag_pull_force_n"),
)


def choose_terminal_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Choose the columns that fit a terminal: status, force and energy by formula and drag."""
    return tuple(name for name in columns if not name.endswith(_HIDDEN) or "energy_95" in name)


def describe_left_out(predictions: Iterable[Prediction]) -> list[str]:
    """Say by name what lies beyond a limit, and so in no mean, range or pair of neighbours."""
    found: dict[tuple[Status, float], list[str]] = {}
    for one in predictions:
        if one.release.status.is_beyond_limit:
            found.setdefault((one.release.status, one.point.tool.limits.first[1]), []).append(
                one.stimulus
            )
    return [
        f"{status} ({limit:g} N), no energy, left out of every mean: {len(names)} rows of "
        f"{', '.join(dict.fromkeys(names))}"
        for (status, limit), names in found.items()
    ]


def drag_in_time(
    face: Counterface, point: OperatingPoint, backward: bool, speed: float, **probe: float
) -> "tuple[DragTrace, Ring | None]":
    """Drag in time and measure the ring of a tip that releases; `probe` overrides the tool."""
    from stepblocks.drag.events import drag_face
    from stepblocks.drag.ring import measure_ring

    trace = drag_face(face, point, backward, settings={"speed": speed}, probe=probe)
    return trace, measure_ring(trace, spectra=False) if trace.status is Status.RELEASES else None


def predict_one(face: Counterface, point: OperatingPoint, backward: bool = False) -> Prediction:
    """Predict one drag by the formula and in time, without tolerances."""
    release = face.release(point, backward)
    prediction = Prediction("", "", face, point, backward, release, (release, release), None)
    return replace(prediction, in_time=_measure_drag(prediction, point.speed))


def _measure_drag(prediction: Prediction, speed: float) -> InTime | None:
    if prediction.release.status is not Status.RELEASES:
        return None
    try:
        trace, ring = drag_in_time(prediction.face, prediction.point, prediction.backward, speed)
    except ContactError as error:
        return InTime(f"not dragged: {error}", energy=math.nan, share=math.nan)
    return InTime(str(trace.status), trace.peak_force, *((ring.energy, ring.share) if ring else ()))
