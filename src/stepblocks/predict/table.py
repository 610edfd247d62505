"""Predict the rows of a table with intervals: by the equations, or by a learned model."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.event import LearnedPrediction
from stepblocks.contact.kernels import compute_height_at_angle
from stepblocks.contact.operating_point import PAPER, SHIPPED_LIMITS, OperatingPoint, Tool
from stepblocks.contact.uncertainty import estimate_interval
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import ContactError, PipelineError
from stepblocks.files.tables import read_si_columns, read_table, write_table
from stepblocks.predict.predictions import Prediction, format_six_digits
from stepblocks.records.model import WIDE, LearnedFit, LearnedModel, read_model
from stepblocks.rig.forward import (
    PEAK_FORCE,
    BenchDesign,
    build_bench_design,
    build_extended_state,
    compute_responses,
    format_height_name,
    list_covariate_columns,
    parse_tip_radius_um,
)
from stepblocks.rig.state import CHANNELS, DragState, Floats, compute_channels

_COLUMNS: dict[str, tuple[tuple[str, ...], str, float | None]] = {
    "height": (("height", "step_height"), "length", None),
    "edge_radius": (("edge_radius",), "length", 0.0),
    "ball_radius": (("tip_radius", "ball_radius"), "length", PAPER.ball_radius),
    "friction": (("friction",), "ratio", None),
    "normal_load": (("normal_load", "load"), "force", None),
    "stiffness": (("stiffness",), "stiffness", PAPER.tool.stiffness),
    "conversion": (("conversion",), "ratio", PAPER.tool.conversion),
}
_HOURS = 40  # of a run, over which it is asked how much it changed
_DRAWS = 4000  # of each interval
_POSITIVE = ("height_um", "load_n", "speed_mm_s")
_ROUNDED = 1e-3  # of the end of a range: 0.15 N is no extrapolation of 0.15004 N
# columns of the result, and their channels
_FIGURES = {
    "peak_force{}_n": 1,
    "vibration_energy{}_j": 0,
}


def predict_table(
    table: pd.DataFrame | str | Path, output: str | Path | None = None
) -> pd.DataFrame:
    """Predict each row of a table, with an interval.

    Parameters
    ----------
    table : pandas.DataFrame, str or Path
        Table or CSV with ``height_um``, ``normal_load_n`` (or ``load_n``), ``friction`` and, where
        they differ from the paper, ``edge_radius_um``, ``tip_radius_um``, ``stiffness_n_m``,
        ``conversion``, in any unit that the name of the column says; standard uncertainties in
        columns of the same names with ``u_`` before them.
    output : str or Path, optional
        CSV to write.

    Returns
    -------
    pandas.DataFrame
        The table with ``critical_angle_deg``, ``status``, ``peak_force_n``, ``vibration_energy_j``
        and their ends ``_low`` and ``_high``, ``held_probability`` and ``problem``, which says why
        a row is ``invalid``; beyond one of the limits of docs/explanation/model.md its ``status``
        names it, and there is no energy.

    Raises
    ------
    PipelineError
        If the table or one of its columns is wrong.
    """
    if hasattr(table, "to_pandas"):  # of polars or Arrow
        table = table.to_pandas()
    place = "table" if isinstance(table, pd.DataFrame) else Path(table)
    frame = table if isinstance(table, pd.DataFrame) else read_table(Path(table))
    uncertain = {
        f"u_{name}": ([f"u_{n}" for n in names], of, 0.0)
        for name, (names, of, _) in _COLUMNS.items()
    }
    columns = read_si_columns(frame, {**_COLUMNS, **uncertain}, place)
    rows: list[dict[str, object]] = []
    for k in range(len(frame)):
        at = {name: float(columns[name][k]) for name in _COLUMNS}
        spread = {name: float(columns[f"u_{name}"][k]) for name in _COLUMNS}
        stream = int(np.random.SeedSequence([0, k]).generate_state(1)[0])
        try:
            point = OperatingPoint(
                at["ball_radius"],
                at["normal_load"],
                at["friction"],
                Tool(at["stiffness"], at["conversion"], limits=SHIPPED_LIMITS),
            )
            face = Step(at["height"], at["edge_radius"])
            interval = estimate_interval(face, point, spread, draws=_DRAWS, seed=stream)
            angle = face.angles(point.ball_radius)[0]
        except ContactError as error:
            rows.append({"status": "invalid", "problem": str(error)})
            continue
        rows.append(
            {
                "critical_angle_deg": math.degrees(angle),
                "status": str(interval.status),
                "peak_force_n": interval.force,
                "peak_force_low_n": interval.force_low,
                "peak_force_high_n": interval.force_high,
                "vibration_energy_j": interval.energy,
                "vibration_energy_low_j": math.nan
                if interval.status.is_beyond_limit
                else interval.energy_low,
                "vibration_energy_high_j": math.nan
                if interval.status.is_beyond_limit
                else interval.energy_high,
                "held_probability": interval.held_probability,
                "problem": "",
            }
        )
    added = pd.DataFrame(rows, index=frame.index)
    result = pd.concat(
        [frame.drop(columns=[c for c in added.columns if c in frame.columns]), added], axis=1
    )
    if output is not None:
        write_table(result, Path(output))
    return result


def predict_trials(
    trials: str | Path | pd.DataFrame,
    model: str | Path | LearnedModel,
    output: str | Path | None = None,
) -> pd.DataFrame:
    """Predict trials by the model of a session.

    Parameters
    ----------
    trials : str, Path or DataFrame
        A table as trials.csv: ``trial``, ``block``, ``height_um``, ``load_n``, ``speed_mm_s``, and
        what the effects of the model follow.
    model : str, Path or LearnedModel
        ``model.json`` of `stepblocks loop`.

    Returns
    -------
    DataFrame
        A row for each trial: its ``status`` (``ok``, ``locked``, ``outside-range(...)``,
        ``invalid(...)``), peak force [N] and vibration energy [J] with 95 % intervals for a single
        trial, by the extended and by the nominal model.

    Raises
    ------
    PipelineError
        If the table or the model cannot be read, a column is missing, or the output cannot be
        written.
    """
    if not isinstance(trials, pd.DataFrame):
        trials = read_table(Path(trials), ("trial", "block", "tip"))
    result = predict_with_model(
        trials, model if isinstance(model, LearnedModel) else read_model(model)
    )[0]
    if output is not None:
        write_table(result, Path(output), "%.9g")
    return result


def predict_with_model(
    table: pd.DataFrame, learned: LearnedModel
) -> tuple[pd.DataFrame, DragState]:
    """Predict a table of trials; beside the figures the slots of the extended model."""
    used = {name for law in learned.extended.laws for name in list_covariate_columns(law.covariate)}
    needed = ("trial", "block", *_POSITIVE, *sorted(used))
    missing = [name for name in needed if name not in table.columns]
    PipelineError.require(
        not missing, f"trials must have the columns {', '.join(missing)}, which the model needs"
    )
    columns, invalid, outside = _read_conditions(table, learned, {*_POSITIVE, *used})
    columns["tip_radius_um"] = np.array(
        [
            parse_tip_radius_um(tip, learned.tip_radius_um)
            for tip in table.get("tip", pd.Series("", table.index)).astype(str)
        ]
    )
    # a block is known by its name; a new height under an old name is a block of its own
    design = build_bench_design(
        table["block"].astype(str).to_numpy(),
        columns,
        learned.tool.stiffness,
        learned.known_laws,
    )
    models = {
        "": _predict_channels(design, learned.extended, learned),
        "nominal_": _predict_channels(design, learned.nominal, learned),
    }
    wrong = invalid.astype(bool)
    state = models[""][2]
    status = np.where(outside.astype(bool), "outside-range(" + outside + ")", "ok")
    status = np.where(state.locked(), "locked", status)
    result = {
        "trial": table["trial"].to_numpy(),
        "status": np.where(wrong, "invalid(" + invalid + ")", status),
    }
    # first the values, then their intervals
    for ends in ({"": 0.0}, {"_low": -WIDE, "_high": WIDE}):
        each = product(models.items(), _FIGURES.items(), ends.items())
        for (prefix, (mean, std, slots)), (name, channel), (end, shift) in each:
            value = np.where(
                slots.locked() | wrong, np.nan, np.exp(mean[:, channel] + shift * std[:, channel])
            )
            result[prefix + name.format(end)] = value
            infinite = ~np.isfinite(value) & ~(slots.locked() | wrong)
            if infinite.any():
                trial = table["trial"].to_numpy()[infinite][0]
                raise PipelineError(
                    f"{prefix}{name.format(end)} of trial {trial!r} is not finite: its conditions "
                    "or the model lie beyond all bounds [model.json]"
                )
    return pd.DataFrame(result), state


def _read_conditions(
    table: pd.DataFrame, learned: LearnedModel, names: set[str]
) -> tuple[dict[str, NDArray[np.generic]], NDArray[np.object_], NDArray[np.object_]]:
    # Read the columns to predict from. Also gives, for each trial, the names of columns that hold
    # no number, and of those beyond the range of the data.
    ranges = {place.name: place for place in learned.ranges}
    invalid, outside = (np.full(len(table), "", dtype=object) for _ in range(2))
    columns: dict[str, NDArray[np.generic]] = {}

    def note(texts: NDArray[np.object_], rows: NDArray[np.bool_], name: str) -> None:
        texts[rows] = np.where(texts[rows] == "", name, texts[rows] + f"; {name}")

    for name in sorted(names | (set(ranges) & set(table.columns))):
        place = ranges.get(name)
        if place is not None and place.labels:
            columns[name] = table[name].astype(str).to_numpy()
            note(outside, ~np.isin(columns[name], place.labels), name)
            continue
        numbers = np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=np.float64)
        good = np.isfinite(numbers) & ((numbers > 0.0) | (name not in _POSITIVE))
        if name in names:
            note(invalid, ~good, name)
        if place is not None:
            slack = _ROUNDED * max(abs(place.low), abs(place.high))
            note(
                outside,
                good & ((numbers < place.low - slack) | (numbers > place.high + slack)),
                name,
            )
        columns[name] = np.where(good, numbers, 1.0)
    return columns, invalid, outside


def _predict_channels(
    design: BenchDesign, fitted: LearnedFit, learned: LearnedModel
) -> tuple[Floats, Floats, DragState]:
    # Predict channels of single trials, their standard deviations, and the slots behind
    def at(
        values: Mapping[str, float], columns: Mapping[str, NDArray[np.generic]] | None = None
    ) -> Floats:
        here = replace(design, covariates=columns) if columns else design
        return compute_channels(build_extended_state(here, values, fitted.active(values)))

    state = build_extended_state(design, fitted.values, fitted.active())
    mean = compute_channels(state)
    jacobian = np.zeros((*mean.shape, len(fitted.values)))
    sizes = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    for i, (name, value) in enumerate(fitted.values.items()):
        step = 0.05 * sizes[i]
        if step > 0.0:
            jacobian[:, :, i] = (at({**fitted.values, name: value + step}) - mean) / step
    variance = (
        np.einsum("nci,ij,ncj->nc", jacobian, fitted.covariance, jacobian)
        + np.einsum("nck,k->nc", compute_responses(state) ** 2, learned.quantity_std**2)
        + learned.channel_std**2
    )
    unknown = ~np.isin(
        design.block, [b for b in learned.blocks if format_height_name(b) in fitted.values]
    )
    followed = {law.covariate for law in fitted.laws} & set(design.covariates)
    stepped = (one for one in learned.ranges if one.labels or one.name == "run_order")
    for place in (one for one in stepped if one.name in followed):
        # a day, a batch or an hour that the session had not is as uncertain as those it had differ
        seen = np.array(place.labels)
        column = design.covariates[place.name]
        new = ~np.isin(column, seen)
        if not place.labels:
            seen = np.linspace(place.low, place.high, _HOURS)
            new = np.clip(column, place.low, place.high) != column
        each = [
            at(fitted.values, {**design.covariates, place.name: np.full(len(mean), one)})
            for one in seen
        ]
        variance += np.where(new[:, None], np.mean((np.array(each) - mean) ** 2, axis=0), 0.0)
    if np.any(unknown):
        # the height of a block that was never measured is as uncertain as its prior
        step = 1e-8
        slope = (compute_channels(state.changed(height=state.height + step)) - mean) / step
        variance += np.where(unknown[:, None], (slope * learned.height_std) ** 2, 0.0)
    return mean, np.sqrt(variance), state


@dataclass(frozen=True)
class LearnedDrag(LearnedPrediction):
    """One drag as the extended model sees it: ``ok``, ``locked``, or ``outside-range(columns)``."""

    friction: float
    tool: Tool  # with the learned spring, conversion and ring
    edge_radius: (
        float  # what the model adds to the ball's radius [m]; 0 where it has no such effect
    )


def make_learned_drag(
    learned: LearnedModel, block: str, height: float, condition: OperatingPoint
) -> LearnedDrag:
    """Ask a learned model about one step; friction and tool of the condition are learned."""
    row: dict[str, object] = {
        "trial": "1",
        "block": block,
        "tip": f"tip-{condition.ball_radius * 1e6:.6f}",
        "height_um": height * 1e6,
        "load_n": condition.normal_load,
        "speed_mm_s": condition.speed * 1e3,
    }
    for place in learned.ranges:
        if place.name not in row and not place.pair and place.name != PEAK_FORCE:
            row[place.name] = place.labels[0] if place.labels else 0.5 * (place.low + place.high)
    table, state = predict_with_model(pd.DataFrame([row]), learned)
    found = table.iloc[0]
    shown = dict(zip(CHANNELS, compute_channels(state)[0], strict=True))
    tool = replace(
        condition.tool,
        stiffness=float(state.stiffness[0]),
        conversion=float(state.conversion[0]),
        frequency=float(np.exp(shown["ln_ring_frequency"])),
        decay_time=float(np.exp(shown["ln_decay_time"])),
    )
    edge_radius = max(float(state.radius[0]) - condition.ball_radius, 0.0)
    # the value, and the ends of its interval
    force, energy = (
        (
            float(found[name.format("")]),
            float(found[name.format("_low")]),
            float(found[name.format("_high")]),
        )
        for name in _FIGURES
    )
    return LearnedDrag(
        str(found["status"]), force, energy, float(state.friction[0]), tool, edge_radius
    )


def apply_model(stimuli: StimulusSet, learned: LearnedModel) -> StimulusSet:
    """Put the constants of a session into a set: friction, spring and conversion."""
    values = learned.extended.values
    grid = stimuli.prediction
    spring = {
        "stiffness": learned.tool.stiffness * values["stiffness_ratio"],
        "conversion": float(np.exp(values["ln_conversion"])),
    }
    return stimuli.model_copy(
        update={
            "prediction": grid.model_copy(
                update={
                    "frictions": (values["friction"],),
                    "tool": grid.tool.model_copy(update=spring),
                }
            )
        }
    )


def format_learned_columns(prediction: Prediction, learned: LearnedModel) -> dict[str, str]:
    """Say beside a prediction what the extended model, effects and all, predicts."""
    names = [
        f"learned_{name.format(end)}"
        for name in ("pull_force{}_n", "vibration_energy{}_uj")
        for end in ("", "_low", "_high")
    ]
    if prediction.release.status is not Status.RELEASES:
        return {"learned_status": "", **dict.fromkeys(names, "")}
    # an edge that is no plain step counts as the step of the same critical angle
    plain = prediction.drag == "up"
    face, point = prediction.face, prediction.point
    height = (
        face.far_side
        if plain
        else compute_height_at_angle(prediction.release.angle, point.ball_radius)
    )
    found = make_learned_drag(learned, prediction.stimulus, float(height), point)
    values = [*found.peak_force, *(1e6 * energy for energy in found.energy)]
    return {
        "learned_status": found.status,
        **dict(zip(names, map(format_six_digits, values), strict=True)),
    }
