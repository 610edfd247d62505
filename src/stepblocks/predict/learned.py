"""What a measured session has taught, for stimuli nobody has dragged over yet: a row of a trial table for each."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from stepblocks.artefacts.model_file import LearnedModel
from stepblocks.contact.energy import Status
from stepblocks.contact.forward import PEAK_FORCE
from stepblocks.contact.kernels import height_at_angle
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.contact.state import CHANNELS, observe
from stepblocks.predict.trials import predicted

if TYPE_CHECKING:
    from stepblocks.parts.set import StimulusSet
    from stepblocks.predict.predictions import Prediction

Interval = tuple[float, float, float]  # a value and its 95 % interval for a single trial


@dataclass(frozen=True)
class LearnedDrag:
    """One drag as the extended model sees it."""

    # ``ok``, ``locked``, or ``outside-range(...)`` with the columns that lie beyond the session's data
    status: str
    peak_force: Interval  # N
    energy: Interval  # J
    friction: float
    tool: Tool  # with the learnt spring, conversion and ring
    edge_radius: float  # what the model adds to the ball's radius [m]; 0 where it has no such effect


def learned_drag(learned: LearnedModel, block: str, height: float, condition: OperatingPoint) -> LearnedDrag:
    """Ask a learned model about one step; of the condition its friction and tool are not asked, they are learnt."""
    import pandas as pd

    row: dict[str, Any] = {
        "trial": "1",
        "block": block,
        "height_um": height * 1e6,
        "load_n": condition.normal_load,
        "speed_mm_s": condition.speed * 1e3,
        "tip": f"tip-{condition.ball_radius * 1e6:.6f}",
    }
    for place in learned.ranges:
        if place.name not in row and place.name != PEAK_FORCE:
            row[place.name] = place.labels[0] if place.labels else 0.5 * (place.low + place.high)
    table, state = predicted(pd.DataFrame([row]), learned)
    found = table.iloc[0]
    shown = dict(zip(CHANNELS, observe(state)[0], strict=True))

    def interval(name: str) -> Interval:
        value, low, high = (float(found[name.format(end)]) for end in ("", "_low", "_high"))
        return value, low, high

    return LearnedDrag(
        str(found["status"]),
        interval("peak_force{}_n"),
        interval("vibration_energy{}_j"),
        float(state.friction[0]),
        replace(
            condition.tool,
            stiffness=float(state.stiffness[0]),
            conversion=float(state.conversion[0]),
            frequency=math.exp(shown["ln_ring_frequency"]),
            decay_time=math.exp(shown["ln_decay_time"]),
        ),
        max(float(state.radius[0]) - condition.ball_radius, 0.0),
    )


def taught_set(stimuli: StimulusSet, learned: LearnedModel) -> StimulusSet:
    """Predict a set with the constants of a session: its friction, spring and conversion instead of the file's."""
    values, grid = learned.extended.values, stimuli.prediction
    spring = {
        "stiffness": learned.tool.stiffness * values["stiffness_ratio"],
        "conversion": math.exp(values["ln_conversion"]),
    }
    taught = {"frictions": (values["friction"],), "tool": grid.tool.model_copy(update=spring)}
    return stimuli.model_copy(update={"prediction": grid.model_copy(update=taught)})


def learned_columns(prediction: Prediction, learned: LearnedModel) -> dict[str, str]:
    """Say beside a prediction what the extended model, effects and all, predicts."""
    names = [
        f"learned_{what}{end}_{unit}"
        for what, unit in (("pull_force", "n"), ("vibration_energy", "uj"))
        for end in ("", "_low", "_high")
    ]
    if prediction.release.status is not Status.RELEASES:
        return {"learned_status": "", **dict.fromkeys(names, "")}
    # an edge that is no plain step counts as the step of the same critical angle
    plain = prediction.drag == "up"
    height = prediction.step_height if plain else height_at_angle(prediction.release.angle, prediction.tip_radius)
    found = learned_drag(learned, prediction.stimulus, float(height), prediction.point)
    values = [*found.peak_force, *(1e6 * energy for energy in found.energy)]
    texts = ["" if math.isnan(value) else f"{value:.6g}" for value in values]
    return {"learned_status": found.status, **dict(zip(names, texts, strict=True))}
