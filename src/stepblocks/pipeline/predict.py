"""What will be felt: every stimulus of a set under every tip, load and friction asked for."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

from stepblocks.contact.critical_angle import margin_angles, step_angle
from stepblocks.contact.energy import Release, Status, Tool, release_at
from stepblocks.contact.kernels import locking_height
from stepblocks.stimulus.block import StepBlock
from stepblocks.stimulus.margin import CrownOnTooth, MarginBlock, crown_corner
from stepblocks.stimulus.set import PredictionGrid, Stimulus, StimulusSet
from stepblocks.stimulus.tip import HookTip, StraightTip

__all__ = ["COLUMNS", "Prediction", "as_csv", "as_row", "predict_set", "tool_of"]

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
    "mean_power_uw",
    "threshold_ratio",
    "locking_height_um",
)
"""Columns of predictions.csv, units in their names."""


@dataclass(frozen=True)
class Prediction:
    """One stimulus under one condition.

    Attributes
    ----------
    set_name, stimulus : str
        What is felt.
    drag : str
        Direction: ``"up"`` a step, ``"tooth-to-crown"`` or ``"crown-to-tooth"``.
    tip_radius : float
        Radius of the ball R [m].
    step_height : float
        Height of the step, or of the crown over the tooth [m].
    normal_load : float
        F_py [N].
    friction : float
        mu [1].
    release : Release
        Status and figures at the nominal dimensions.
    limits : (Release, Release)
        The same at the least and the greatest angle within the tolerances of the stimulus.
    """

    set_name: str
    stimulus: str
    drag: str
    tip_radius: float
    step_height: float
    normal_load: float
    friction: float
    release: Release
    limits: tuple[Release, Release]


def tool_of(grid: PredictionGrid) -> Tool:
    """Return the tool that a grid declares.

    Parameters
    ----------
    grid : PredictionGrid
        As read from the file.

    Returns
    -------
    Tool
        For the equations.
    """
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
    grid, tool = stimuli.prediction, tool_of(stimuli.prediction)
    for stimulus in stimuli.stimuli:
        for contact in _contacts(stimulus, grid):
            for friction in grid.frictions:
                for load in grid.normal_loads:
                    nominal, *limits = (release_at(angle, load, friction, tool) for angle in contact.angles)
                    yield Prediction(
                        stimuli.name, stimulus.id, contact.drag, contact.ball, contact.rise, load, friction, nominal,
                        (limits[0], limits[1]),
                    )  # fmt: skip


@dataclass(frozen=True)
class _Contact:
    """One edge met by one tip: critical angle at the nominal, and the least and greatest within the tolerances [rad]."""

    drag: str
    ball: float
    rise: float
    angles: tuple[float, float, float]


def _contacts(stimulus: Stimulus, grid: PredictionGrid) -> Iterator[_Contact]:
    match stimulus:
        case StepBlock():
            height, radius = stimulus.height, stimulus.edge_radius
            for tip in grid.tip_radii:
                corners = [step_angle(h, tip, max(r, 0.0)) for h, r in product(height.limits, radius.limits)]
                angle = step_angle(height.nominal, tip, radius.nominal)
                yield _Contact("up", tip, height.nominal, (angle, min(corners), max(corners)))
        case MarginBlock() | CrownOnTooth():
            for tip in grid.tip_radii:
                both_ways = [_margin_angles(*sizes, tip) for sizes in _margin_sizes(stimulus)]
                rise = stimulus.horizontal_discrepancy.nominal
                for drag, way in (("tooth-to-crown", 0), ("crown-to-tooth", 1)):
                    spread = [both[way] for both in both_ways]
                    yield _Contact(drag, tip, rise, (spread[0], min(spread), max(spread)))
        case StraightTip() | HookTip():
            for height_of_step in grid.step_heights:
                ball = stimulus.ball_radius
                low, high = sorted(step_angle(height_of_step, R) for R in ball.limits)
                angle = step_angle(height_of_step, ball.nominal)
                yield _Contact("up", ball.nominal, height_of_step, (angle, low, high))


def _margin_sizes(margin: MarginBlock | CrownOnTooth) -> Iterator[tuple[float, float, float]]:
    """Gap, opening and rise: the nominal, then every corner of the tolerances [m]."""
    gap, rise, opening = margin.marginal_gap, margin.horizontal_discrepancy, margin.vertical_discrepancy
    yield gap.nominal, margin.opening.nominal, rise.nominal
    for g, h in product(gap.limits, rise.limits):
        for v in (g,) if opening is None else opening.limits:
            yield max(g, 0.0), v, h


def _margin_angles(gap: float, opening: float, rise: float, tip: float) -> tuple[float, float]:
    """Angles over a margin: in closed form, or by the path of the tip where a bevel may be met before its corner."""
    if opening <= gap:
        return margin_angles(max(opening, 0.0), rise, tip)
    import numpy as np

    from stepblocks.contact.catches import steepest
    from stepblocks.contact.tip import Ball
    from stepblocks.contact.tip_path import profile_path

    floor = -4.0 * tip  # deep enough that the ball never touches it
    corner = crown_corner(gap, opening, rise)
    section = [(-4.0 * tip, 0.0), (0.0, 0.0), (0.0, floor), (gap, floor), *corner, (opening + 4.0 * tip, rise)]
    x, z = np.array(section).T
    path = profile_path(x, z, Ball(tip), edges="flat")
    return steepest(path, "forward").angle, steepest(path, "backward").angle


def as_row(prediction: Prediction) -> dict[str, str]:
    """Format a prediction for a table.

    Parameters
    ----------
    prediction : Prediction
        One prediction.

    Returns
    -------
    dict of str
        One text per column; empty where there is no number.
    """
    release, (low, high) = prediction.release, prediction.limits
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
        "mean_power_uw": number(release.mean_power * 1e6),
        "threshold_ratio": number(release.threshold_ratio),
        "locking_height_um": number(locking * 1e6) if release.status is not Status.NO_CATCH else "",
    }


def as_csv(predictions: Iterator[Prediction], more: Callable[[Prediction], dict[str, str]] | None = None) -> str:
    """Write predictions as CSV.

    Parameters
    ----------
    predictions : iterator of Prediction
        What to write.
    more : callable, optional
        Further columns of each row, the same for all.

    Returns
    -------
    str
        The table with a header.
    """
    rows = [as_row(prediction) | (more(prediction) if more else {}) for prediction in predictions]
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0] if rows else COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
