"""What a measured session has taught, for stimuli nobody has dragged over yet: a row of a trial table for each."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from stepblocks.contact.energy import Status, Tool
from stepblocks.contact.state import CHANNELS, observe
from stepblocks.pipeline.bench_model import PEAK_FORCE
from stepblocks.pipeline.model_file import LearnedModel
from stepblocks.pipeline.predict_model import predictions, state_of
from stepblocks.stimulus.block import StepBlock

if TYPE_CHECKING:
    from stepblocks.haptics.condition import Condition
    from stepblocks.haptics.event import VibrationEvent
    from stepblocks.haptics.renderer.path import Surface
    from stepblocks.pipeline.predict import Prediction
    from stepblocks.stimulus.set import StimulusSet

__all__ = ["LearnedDrag", "learned_columns", "learned_drag", "taught_set", "teach"]

Interval = tuple[float, float, float]


@dataclass(frozen=True)
class LearnedDrag:
    """One drag as the extended model sees it.

    Attributes
    ----------
    status : str
        ``"ok"``, ``"locked"``, or ``"outside-range(...)"`` with the columns that lie beyond the session's data.
    peak_force, energy : (float, float, float)
        Release force [N] and vibration energy [J], each with its 95 % interval for a single trial.
    friction, conversion : float
        Coefficient of friction and share of the stored energy that rings [1].
    stiffness, frequency, decay : float
        Of the tool [N/m], and of its ring [Hz], [s].
    edge_radius : float
        What the model adds to the ball's radius [m]; 0 where it has no such effect.
    """

    status: str
    peak_force: Interval
    energy: Interval
    friction: float
    conversion: float
    stiffness: float
    frequency: float
    decay: float
    edge_radius: float


def learned_drag(
    learned: LearnedModel, block: str, height: float, load: float, ball_radius: float, speed: float
) -> LearnedDrag:
    """Ask a learned model about one step.

    Parameters
    ----------
    learned : LearnedModel
        From model.json.
    block : str
        Name of the block; one that the session knew keeps its height error.
    height : float
        Height of the step [m].
    load, ball_radius, speed : float
        Normal load [N], R [m], speed of the handle [m/s].

    Returns
    -------
    LearnedDrag
        A covariate beyond these that the model's effects follow stands in the middle of its range.
    """
    import pandas as pd

    row: dict[str, Any] = {"trial": "1", "block": block, "height_um": height * 1e6, "load_n": load,
                           "speed_mm_s": speed * 1e3, "tip": f"tip-{ball_radius * 1e6:.6f}"}  # fmt: skip
    for place in learned.ranges:
        if place.name not in row and place.name != PEAK_FORCE:
            row[place.name] = place.labels[0] if place.labels else 0.5 * (place.low + place.high)
    table = pd.DataFrame([row])
    found, state = predictions(table, learned).iloc[0], state_of(table, learned)
    shown = dict(zip(CHANNELS, observe(state)[0], strict=True))
    ends = ("", "_low", "_high")
    peak, energy = ([float(found[f"{name}{end}_{unit}"]) for end in ends] for name, unit in
                    (("peak_force", "n"), ("vibration_energy", "j")))  # fmt: skip
    return LearnedDrag(
        str(found["status"]), (peak[0], peak[1], peak[2]), (energy[0], energy[1], energy[2]), float(state.friction[0]),
        float(state.conversion[0]), float(state.stiffness[0]), math.exp(shown["ln_ring_frequency"]),
        math.exp(shown["ln_decay_time"]), max(float(state.radius[0]) - ball_radius, 0.0),
    )  # fmt: skip


def taught_set(stimuli: StimulusSet, learned: LearnedModel) -> StimulusSet:
    """Predict a set with the constants of a session: its friction, spring and conversion instead of the file's.

    Parameters
    ----------
    stimuli : StimulusSet
        As read from its file.
    learned : LearnedModel
        From model.json.

    Returns
    -------
    StimulusSet
        With one coefficient of friction.
    """
    values, grid = learned.extended.values, stimuli.prediction
    tool = grid.tool.model_copy(update={
        "stiffness": learned.model.spring_constant * values["stiffness_ratio"], "conversion": math.exp(values["ln_conversion"]),
    })  # fmt: skip
    return stimuli.model_copy(
        update={"prediction": grid.model_copy(update={"frictions": (values["friction"],), "tool": tool})}
    )


def learned_columns(prediction: Prediction, learned: LearnedModel, speed: float = 5e-3) -> dict[str, str]:
    """Say beside a prediction what the extended model, effects and all, predicts.

    Parameters
    ----------
    prediction : Prediction
        Equation (1) with the learned constants.
    learned : LearnedModel
        From model.json.
    speed : float
        Speed of the handle [m/s].

    Returns
    -------
    dict of str
        Columns for predictions.csv; empty where the probe does not release.
    """
    names = [f"learned_{what}{end}_{unit}" for what, unit in (("pull_force", "n"), ("vibration_energy", "uj"))
             for end in ("", "_low", "_high")]  # fmt: skip
    if prediction.release.status is not Status.RELEASES:
        return {"learned_status": "", **dict.fromkeys(names, "")}
    # an edge that is no plain step counts as the step of the same critical angle
    plain = prediction.drag == "up"
    height = prediction.step_height if plain else prediction.tip_radius * (1.0 - math.cos(prediction.release.angle))
    found = learned_drag(learned, prediction.stimulus, height, prediction.normal_load, prediction.tip_radius, speed)
    values = [*found.peak_force, *(1e6 * energy for energy in found.energy)]
    texts = ["" if math.isnan(value) else f"{value:.6g}" for value in values]
    return {"learned_status": found.status, **dict(zip(names, texts, strict=True))}


def teach(
    learned: LearnedModel, surface: Surface, condition: Condition, speed: float, keep_friction: bool = False
) -> tuple[Surface, Condition, tuple[VibrationEvent, VibrationEvent]]:
    """Apply what was learnt to a surface, its condition and its events.

    Parameters
    ----------
    learned : LearnedModel
        From model.json.
    surface : StepBlock, MarginBlock or CrownOnTooth
        What is dragged over.
    condition : Condition
        Ball and load count; friction and tool are replaced.
    speed : float
        Speed of the handle [m/s].
    keep_friction : bool
        Whether the condition's friction was asked for and stays.

    Returns
    -------
    surface, condition, events
        A step with the learned edge radius, the learned friction and tool, and events that carry the learned energy,
        frequency and decay, with the model's prediction beside.
    """
    from stepblocks.haptics.event import RingLaw, vibration_events

    known = learned_drag(learned, surface.id, _height(surface, condition.ball_radius, 1), condition.normal_load,
                         condition.ball_radius, speed)  # fmt: skip
    tool = Tool(known.stiffness, known.conversion, condition.tool.ring_duration, condition.tool.detection_threshold)
    friction = condition.friction if keep_friction else known.friction
    taught = replace(condition, friction=friction, tool=tool)
    if isinstance(surface, StepBlock) and known.edge_radius > 0.0:
        radius = min(known.edge_radius, surface.height.nominal)
        surface = surface.model_copy(update={"edge_radius": replace(surface.edge_radius, nominal=radius)})
    up, down = vibration_events(surface, taught, RingLaw(known.frequency, known.decay))
    return (
        surface,
        taught,
        (_taught(learned, up, surface, taught, speed), _taught(learned, down, surface, taught, speed)),
    )


def _height(surface: Surface, ball_radius: float, direction: int) -> float:
    """Height of the step that this edge is for the ball [m]: its own, or that of the same critical angle."""
    from stepblocks.haptics.renderer.path import centre_path

    if isinstance(surface, StepBlock) and direction > 0:
        return surface.height.nominal
    angle = centre_path(surface, ball_radius).notch(float(direction))[2]
    return ball_radius * (1.0 - math.cos(angle))


def _taught(
    learned: LearnedModel, event: VibrationEvent, surface: Surface, condition: Condition, speed: float
) -> VibrationEvent:
    from stepblocks.haptics.event import Learned, with_energy

    if event.status is not Status.RELEASES:
        return event
    height = _height(surface, condition.ball_radius, event.direction)
    known = learned_drag(learned, surface.id, height, condition.normal_load, condition.ball_radius, speed)
    told = replace(event, learned=Learned(known.status, known.peak_force, known.energy))
    return with_energy(told, known.energy[0]) if np.isfinite(known.energy[0]) else told
