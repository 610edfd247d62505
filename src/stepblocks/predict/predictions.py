"""What will be felt: every stimulus of a set under every tip, load and friction asked for."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

from stepblocks.contact.energy import Release, Status, release_at
from stepblocks.contact.kernels import locking_height
from stepblocks.contact.operating_point import Tool
from stepblocks.contact.uncertainty import Interval
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.parts.set import StimulusSet, with_energy_tolerances
from stepblocks.predict.intervals import ball_of, interval_over

# Columns of predictions.csv, units in their names: ``low`` and ``high`` are the worst cases within the tolerances,
# ``95_low`` and ``95_high`` the ends of the drawn 95 % interval, ``analytic_95`` the same by first-order
# sensitivities
COLUMNS = (
    "set",
    "stimulus",
    "drag",
    "tip_radius_um",
    "step_height_um",
    "normal_load_n",
    "friction",
    "critical_angle_deg",
    "status",
    "status_at_limits",
    "pull_force_n",
    "pull_force_low_n",
    "pull_force_high_n",
    "vibration_energy_uj",
    "vibration_energy_low_uj",
    "vibration_energy_high_uj",
    "conversion",
    "mean_power_uw",
    "threshold_ratio",
    "locking_height_um",
    "pull_force_95_low_n",
    "pull_force_95_high_n",
    "vibration_energy_95_low_uj",
    "vibration_energy_95_high_uj",
    "vibration_energy_analytic_95_low_uj",
    "vibration_energy_analytic_95_high_uj",
    "held_probability",
    "intervals_agree",
)

# Columns that fit a terminal: of the intervals only the drawn one of the energy
SHOWN = tuple(
    name for name in COLUMNS if not name.endswith(("_low_n", "_high_n", "_low_uj", "_high_uj")) or "energy_95" in name
)


@dataclass(frozen=True)
class Prediction:
    """One stimulus under one condition."""

    set_name: str  # What is felt
    stimulus: str
    drag: str  # Direction: ``"up"`` a step, ``"tooth-to-crown"`` or ``"crown-to-tooth"``
    tip_radius: float  # Radius of the ball R [m]
    step_height: float  # Height of the step, or of the crown over the tooth [m]
    normal_load: float  # F_py [N]
    friction: float  # mu [1]
    release: Release  # Status and figures at the nominal dimensions
    # The same at the least and the greatest angle within the tolerances of the stimulus
    limits: tuple[Release, Release]
    # 95 % interval from the tolerances of the stimulus and of the setting, drawn and by sensitivities
    interval: Interval
    conversion: float  # Share of the stored energy that rings: C_v of the set, or the simulated one [1]


def tool_of(grid: PredictionGrid) -> Tool:
    """Return the tool that a grid declares."""
    spec = grid.tool
    return Tool(spec.stiffness, spec.conversion, spec.ring_duration, spec.detection_threshold)


def predict_set(stimuli: StimulusSet) -> Iterator[Prediction]:
    """Predict a set over its grid.

    Parameters
    ----------
    stimuli : StimulusSet
        The set.

    Yields
    ------
    Prediction
        In the order stimulus, tip, direction, friction, load.
    """
    stimuli = with_energy_tolerances(stimuli)
    for stimulus in stimuli.stimuli:
        grid = stimuli.grid_of(stimulus)
        tool = tool_of(grid)
        for contact in _contacts(stimulus, grid):
            for friction in grid.frictions:
                for load in grid.normal_loads:
                    nominal, *limits = (release_at(angle, load, friction, tool) for angle in contact.angles)
                    yield Prediction(
                        stimuli.name,
                        stimulus.id,
                        contact.drag,
                        contact.ball,
                        contact.rise,
                        load,
                        friction,
                        nominal,
                        (limits[0], limits[1]),
                        contact.interval(friction, load),
                        tool.conversion,
                    )


@dataclass(frozen=True)
class _Contact:
    """One edge met by one tip: critical angle at the nominal, and the least and greatest within the tolerances [rad].

    `interval` gives the 95 % interval for a coefficient of friction and a load.
    """

    drag: str
    ball: float
    rise: float
    angles: tuple[float, float, float]
    interval: Callable[[float, float], Interval]


def _contacts(part: Part, grid: PredictionGrid) -> Iterator[_Contact]:
    balls = [ball_of(grid, radius) for radius in grid.tip_radii] if part.ball is None else [part.ball]
    for ball, step in product(balls, (None,) if part.crossed else grid.step_heights):
        faces = list(part.corners(step))
        radii = (
            (ball.nominal,) if part.ball is None else ball.limits
        )  # the tolerance of the setting is no limit of the part
        for way, drag in enumerate(faces[0].ways):
            angle = float(faces[0].angles(ball.nominal)[way])
            spread = [float(face.angles(radius)[way]) for face in faces for radius in radii]
            felt = interval_over(grid, part, step, ball, bool(way))
            yield _Contact(drag, ball.nominal, faces[0].far_side, (angle, min(spread), max(spread)), felt)


def as_row(prediction: Prediction) -> dict[str, str]:
    """Format a prediction for a table."""
    release, (low, high), interval = prediction.release, prediction.limits, prediction.interval
    locking = float(locking_height(prediction.tip_radius, prediction.friction))

    def number(value: float) -> str:
        return "" if math.isnan(value) else f"{value:.6g}"

    return {
        "set": prediction.set_name,
        "stimulus": prediction.stimulus,
        "drag": prediction.drag,
        "tip_radius_um": number(prediction.tip_radius * 1e6),
        "step_height_um": number(prediction.step_height * 1e6),
        "normal_load_n": number(prediction.normal_load),
        "friction": number(prediction.friction),
        "critical_angle_deg": number(math.degrees(release.angle)),
        "status": release.status.value,
        "status_at_limits": "/".join(dict.fromkeys((low.status.value, high.status.value))),
        "pull_force_n": number(release.pull_force),
        "pull_force_low_n": number(low.pull_force),
        "pull_force_high_n": number(high.pull_force),
        "vibration_energy_uj": number(release.vibration_energy * 1e6),
        "vibration_energy_low_uj": number(low.vibration_energy * 1e6),
        "vibration_energy_high_uj": number(high.vibration_energy * 1e6),
        "conversion": number(prediction.conversion),
        "mean_power_uw": number(release.mean_power * 1e6),
        "threshold_ratio": number(release.threshold_ratio),
        "locking_height_um": number(locking * 1e6) if release.status is not Status.NO_CATCH else "",
        "pull_force_95_low_n": number(interval.force_low),
        "pull_force_95_high_n": number(interval.force_high),
        "vibration_energy_95_low_uj": number(interval.energy_low * 1e6),
        "vibration_energy_95_high_uj": number(interval.energy_high * 1e6),
        "vibration_energy_analytic_95_low_uj": number(interval.analytic_energy_low * 1e6),
        "vibration_energy_analytic_95_high_uj": number(interval.analytic_energy_high * 1e6),
        "held_probability": number(interval.held_probability),
        "intervals_agree": "yes" if interval.agrees else "no",
    }


def as_csv(predictions: Iterator[Prediction], more: Callable[[Prediction], dict[str, str]] | None = None) -> str:
    """Write predictions as CSV."""
    rows = [as_row(prediction) | (more(prediction) if more else {}) for prediction in predictions]
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0] if rows else COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
