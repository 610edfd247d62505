"""What will be felt: every stimulus of a set under every tip, load and friction asked for."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Release, Status, release_at
from stepblocks.contact.kernels import locking_height
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.contact.uncertainty import Interval, interval_of, rectangular
from stepblocks.errors import PipelineError
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.parts.set import StimulusSet, with_energy_tolerances
from stepblocks.parts.tolerance import Dimension

if TYPE_CHECKING:
    import pandas as pd

    from stepblocks.drag.ring import Ring
    from stepblocks.drag.simulate import DragTrace

_DRAWS = 2000  # of each interval: its ends scatter by 2 % of its width, and a thousand blocks still take seconds


@dataclass(frozen=True)
class Prediction:
    """One stimulus under one condition."""

    set_name: str
    stimulus: str
    face: Counterface  # what is met, at its nominal dimensions
    point: OperatingPoint  # under what
    backward: bool
    release: Release  # at the nominal dimensions
    limits: tuple[Release, Release]  # at the least and the greatest angle within the tolerances of the stimulus
    interval: Interval  # of 95 %, from the tolerances of the stimulus and of the setting
    conversion: float  # share of the stored energy that rings: C_v of the set, or the simulated one [1]

    @property
    def drag(self) -> str:
        """Direction: ``"up"`` a step, ``"tooth-to-crown"`` or ``"crown-to-tooth"``."""
        return self.face.ways[self.backward]


def tool_of(grid: PredictionGrid) -> Tool:
    """Return the tool that a grid declares."""
    return Tool(**grid.tool.model_dump())


def predictions_of(stimuli: StimulusSet) -> Iterator[Prediction]:
    """Predict a set over its grid, in the order stimulus, tip, step, direction, friction, load."""
    stimuli = with_energy_tolerances(stimuli)
    for part in stimuli.stimuli:
        grid, ring = stimuli.grid_of(part), stimuli.ring_of(part)
        tool = tool_of(grid) if ring is None else ring.as_tool(tool_of(grid))
        balls = [tip_of(grid, radius) for radius in grid.tip_radii] if part.ball is None else [part.ball]
        for ball, step_height in product(balls, (None,) if part.crossed else grid.step_heights):
            faces = list(part.corners(step_height))
            # the tolerance of a tip of the setting is no limit of the part
            radii = (ball.nominal,) if part.ball is None else ball.limits
            corners = [face.angles(radius) for face in faces for radius in radii]
            nominal = faces[0].angles(ball.nominal)
            # of a one-sided tolerance the expectation is not the nominal
            sizes = {name: middle_of(one) for name, one in part.sizes.items()}
            middle = part.sized(**sizes) if part.crossed else part.counterface(step_height)
            for backward in range(len(faces[0].ways)):
                spread = [angles[backward] for angles in corners]
                angles = nominal[backward], min(spread), max(spread)
                for friction, load in product(grid.frictions, grid.normal_loads):
                    point = OperatingPoint(ball.nominal, load, friction, tool)
                    release, low, high = (release_at(angle, load, friction, tool) for angle in angles)
                    interval = interval_of(
                        middle,
                        replace(point, ball_radius=middle_of(ball)),
                        uncertainty_of(part, grid, ball, load),
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
                        conversion=tool.conversion,
                    )


def tip_of(grid: PredictionGrid, radius: float) -> Dimension:
    """Return a tip of the setting with its tolerance [m]."""
    width = grid.tolerances.tip_radius
    return Dimension(radius, width, -width)


def uncertainty_of(part: Part, grid: PredictionGrid, ball: Dimension, load: float) -> dict[str, float]:
    """Take every tolerance as a rectangular distribution over its zone, in the names of `interval_of`."""
    off, tool = grid.tolerances, grid.tool
    # a profile without a closed form is taken as known; its corners still stand beside the interval
    known = part.counterface().dimensions if part.crossed else {}
    return rectangular(
        {name: half_width(one) for name, one in part.sizes.items() if name in known}
        | {
            "ball_radius": half_width(ball),
            "friction": off.friction,
            "normal_load": off.normal_load * load,
            "stiffness": off.stiffness * tool.stiffness,
            "conversion": off.conversion * tool.conversion,
        }
    )


def middle_of(dimension: Dimension) -> float:
    """Middle of the zone of a tolerance."""
    return dimension.nominal + 0.5 * (dimension.upper + dimension.lower)


def half_width(dimension: Dimension) -> float:
    """Half the width of the zone of a tolerance."""
    return 0.5 * (dimension.upper - dimension.lower)


def figures_of(prediction: Prediction) -> dict[str, float | str]:
    """Put a prediction into the columns of ``predictions.csv``, units in their names; NaN where there is no figure.

    ``low`` and ``high`` are the worst cases within the tolerances, ``95_low`` and ``95_high`` the ends of the drawn 95 %
    interval, ``analytic_95`` the same by first-order sensitivities.
    """
    release, (low, high), interval = prediction.release, prediction.limits, prediction.interval
    locking = float(locking_height(prediction.point.ball_radius, prediction.point.friction))
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
        "vibration_energy_low_uj": low.vibration_energy * 1e6,
        "vibration_energy_high_uj": high.vibration_energy * 1e6,
        "conversion": prediction.conversion,
        "mean_power_uw": release.mean_power * 1e6,
        "threshold_ratio": release.threshold_ratio,
        "locking_height_um": math.nan if release.status is Status.NO_CATCH else locking * 1e6,
        "pull_force_95_low_n": interval.force_low,
        "pull_force_95_high_n": interval.force_high,
        "vibration_energy_95_low_uj": interval.energy_low * 1e6,
        "vibration_energy_95_high_uj": interval.energy_high * 1e6,
        "vibration_energy_analytic_95_low_uj": interval.analytic_energy_low * 1e6,
        "vibration_energy_analytic_95_high_uj": interval.analytic_energy_high * 1e6,
        "held_probability": interval.held_probability,
        "intervals_agree": "yes" if interval.agrees else "no",
    }


def as_row(prediction: Prediction) -> dict[str, str]:
    """Format a prediction for a table."""
    return {name: one if isinstance(one, str) else six_digits(one) for name, one in figures_of(prediction).items()}


def six_digits(figure: float) -> str:
    """Format a figure for a table; nothing where there is none."""
    return "" if math.isnan(figure) else f"{figure:.6g}"


@dataclass(frozen=True)
class Predictions:
    """The predictions of a set, made once and handed on."""

    made: tuple[Prediction, ...]

    @classmethod
    def of(cls, stimuli: StimulusSet) -> Predictions:
        """Predict a set."""
        return cls(tuple(predictions_of(stimuli)))

    def __iter__(self) -> Iterator[Prediction]:
        """Go through them, in the order of `predictions_of`."""
        return iter(self.made)

    def __len__(self) -> int:
        """Count them."""
        return len(self.made)

    def by_stimulus(self, identity: str) -> list[Prediction]:
        """Those of one stimulus."""
        return [one for one in self.made if one.stimulus == identity]

    def rows(self, more: Callable[[Prediction], dict[str, str]] | None = None) -> list[dict[str, str]]:
        """Format them for a table, with further columns behind."""
        return [as_row(one) | (more(one) if more else {}) for one in self.made]

    def csv(self, more: Callable[[Prediction], dict[str, str]] | None = None) -> str:
        """Write them as ``predictions.csv``."""
        return as_csv(self.rows(more))

    @property
    def frame(self) -> pd.DataFrame:
        """The same columns with all digits; NaN where there is no figure."""
        import pandas as pd

        return pd.DataFrame([figures_of(one) for one in self.made])


def predict_set(stimuli: StimulusSet | str | Path) -> pd.DataFrame:
    """Predict every stimulus of a set under every tip, load and friction that it asks for.

    Parameters
    ----------
    stimuli : StimulusSet, str or Path
        The set, or its file.

    Returns
    -------
    pandas.DataFrame
        One row for each stimulus, tip, step, direction, friction and load, in that order; the columns of
        ``predictions.csv`` (docs/prediction.md), the unit in each name, with all digits.

    Raises
    ------
    StepblocksError
        If the file cannot be read or declares something impossible.

    Examples
    --------
    >>> frame = predict_set("stimuli/paper-four.toml")  # doctest: +SKIP
    >>> frame[frame.status == "releases"].vibration_energy_uj.max()  # doctest: +SKIP
    """
    if not isinstance(stimuli, StimulusSet):
        from stepblocks.declare import load_set

        stimuli = load_set(Path(stimuli))
    return Predictions.of(stimuli).frame


def as_csv(rows: Sequence[dict[str, str]]) -> str:
    """Write rows of one set of columns as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def shown(columns: Sequence[str]) -> tuple[str, ...]:
    """Choose the columns that fit a terminal: of the intervals only the drawn one of the energy."""
    ends = ("_low_n", "_high_n", "_low_uj", "_high_uj")
    return tuple(name for name in columns if not name.endswith(ends) or "energy_95" in name)


def predicted_in_time(predictions: Predictions, speed: float) -> Predictions:
    """Drag every condition in time once [m/s] to see what share of the stored energy rings."""
    if not (math.isfinite(speed) and speed > 0.0):
        raise PipelineError(f"speed must be positive and finite, got {speed:g} m/s")
    return Predictions(tuple(_in_time(one, speed) for one in predictions))


def dragged(
    face: Counterface, point: OperatingPoint, backward: bool, speed: float, **probe: float
) -> tuple[DragTrace, Ring | None]:
    """Drag in time, with what of the probe is other than the tool says, and measure the ring of a tip that releases."""
    from stepblocks.drag.ring import ring_of
    from stepblocks.drag.simulate import DragSettings, probe_for, simulate
    from stepblocks.drag.track import track_over

    own = probe_for(point.tool, point.ball_radius, **probe)
    trace = simulate(track_over(face, point.ball_radius, backward), own, DragSettings.under(point, speed=speed))
    return trace, ring_of(trace, spectra=False) if trace.status is Status.RELEASES else None


def _in_time(one: Prediction, speed: float) -> Prediction:
    if one.release.status is not Status.RELEASES:
        return one
    _, ring = dragged(one.face, one.point, one.backward, speed)
    share = ring.share if ring else 0.0
    factor = share / one.point.tool.conversion
    release, low, high, interval = (_scaled(found, factor) for found in (one.release, *one.limits, one.interval))
    return replace(one, release=release, limits=(low, high), interval=interval, conversion=share)


def _scaled(found: Any, factor: float) -> Any:
    of_energy = [name for name in vars(found) if "energy" in name or name in ("mean_power", "threshold_ratio")]
    # an end that is infinite, because draws are held, stays so
    scaled = {name: value if math.isinf(value := getattr(found, name)) else factor * value for name in of_energy}
    return replace(found, **scaled)
