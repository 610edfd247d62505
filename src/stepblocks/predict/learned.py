"""What a measured session has taught, for stimuli nobody has dragged over yet: a row of a trial table for each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stepblocks.artefacts.model_file import LearnedModel
from stepblocks.contact.energy import Status
from stepblocks.contact.state import CHANNELS, observe
from stepblocks.loop.bench_model import PEAK_FORCE
from stepblocks.predict.trials import predictions, state_of

if TYPE_CHECKING:
    from stepblocks.parts.set import StimulusSet
    from stepblocks.predict.predictions import Prediction

Interval = tuple[float, float, float]


@dataclass(frozen=True)
class LearnedDrag:
    """One drag as the extended model sees it."""

    # ``"ok"``, ``"locked"``, or ``"outside-range(...)"`` with the columns that lie beyond the session's data
    status: str
    peak_force: Interval  # Release force [N] and vibration energy [J], each with its 95 % interval for a single trial
    energy: Interval
    friction: float  # Coefficient of friction and share of the stored energy that rings [1]
    conversion: float
    stiffness: float  # Of the tool [N/m], and of its ring [Hz], [s]
    frequency: float
    decay: float
    edge_radius: float  # What the model adds to the ball's radius [m]; 0 where it has no such effect


def learned_drag(
    learned: LearnedModel, block: str, height: float, load: float, ball_radius: float, speed: float
) -> LearnedDrag:
    """Ask a learned model about one step."""
    import pandas as pd

    row: dict[str, Any] = {
        "trial": "1",
        "block": block,
        "height_um": height * 1e6,
        "load_n": load,
        "speed_mm_s": speed * 1e3,
        "tip": f"tip-{ball_radius * 1e6:.6f}",
    }
    for place in learned.ranges:
        if place.name not in row and place.name != PEAK_FORCE:
            row[place.name] = place.labels[0] if place.labels else 0.5 * (place.low + place.high)
    table = pd.DataFrame([row])
    found, state = predictions(table, learned).iloc[0], state_of(table, learned)
    shown = dict(zip(CHANNELS, observe(state)[0], strict=True))
    ends = ("", "_low", "_high")
    peak, energy = (
        [float(found[f"{name}{end}_{unit}"]) for end in ends]
        for name, unit in (("peak_force", "n"), ("vibration_energy", "j"))
    )
    return LearnedDrag(
        str(found["status"]),
        (peak[0], peak[1], peak[2]),
        (energy[0], energy[1], energy[2]),
        float(state.friction[0]),
        float(state.conversion[0]),
        float(state.stiffness[0]),
        math.exp(shown["ln_ring_frequency"]),
        math.exp(shown["ln_decay_time"]),
        max(float(state.radius[0]) - ball_radius, 0.0),
    )


def taught_set(stimuli: StimulusSet, learned: LearnedModel) -> StimulusSet:
    """Predict a set with the constants of a session: its friction, spring and conversion instead of the file's."""
    values, grid = learned.extended.values, stimuli.prediction
    tool = grid.tool.model_copy(
        update={
            "stiffness": learned.model.spring_constant * values["stiffness_ratio"],
            "conversion": math.exp(values["ln_conversion"]),
        }
    )
    return stimuli.model_copy(
        update={"prediction": grid.model_copy(update={"frictions": (values["friction"],), "tool": tool})}
    )


def learned_columns(prediction: Prediction, learned: LearnedModel, speed: float = 5e-3) -> dict[str, str]:
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
    height = prediction.step_height if plain else prediction.tip_radius * (1.0 - math.cos(prediction.release.angle))
    found = learned_drag(learned, prediction.stimulus, height, prediction.normal_load, prediction.tip_radius, speed)
    values = [*found.peak_force, *(1e6 * energy for energy in found.energy)]
    texts = ["" if math.isnan(value) else f"{value:.6g}" for value in values]
    return {"learned_status": found.status, **dict(zip(names, texts, strict=True))}
