"""Predict by the model that a session taught: friction, spring, ring and effects as learned."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.contact.event import LearnedPrediction
from stepblocks.contact.kernels import compute_height_at_angle
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_declared_layout
from stepblocks.files.tables import read_table, write_table
from stepblocks.predict.columns import format_six_digits
from stepblocks.predict.predictions import Prediction
from stepblocks.records.model import WIDE, LearnedFit, LearnedModel, read_model
from stepblocks.rig.forward import (
    PEAK_FORCE,
    BenchDesign,
    build_bench_design,
    build_extended_state,
    compute_channel_responses,
    make_height_error_name,
    parse_tip_radius_um,
    split_covariate_columns,
)
from stepblocks.rig.state import CHANNELS, DragState, Floats, compute_shown_channels

Columns = Mapping[str, NDArray[np.generic]]  # covariates of trials, by name

_POSITIVE = ("height_um", "load_n", "speed_mm_s")
_ROUNDED = 1e-3  # of the end of a range: 0.15 N is no extrapolation of 0.15004 N
_STEP = 0.05  # of a parameter's standard uncertainty, by which its slope is taken
_HEIGHT_STEP = 1e-8  # m, by which the slope of a block's height is taken
_HOURS = 40  # of a run, over which it is asked how much it changed
# columns of the result, and their channels
_FIGURES = {"peak_force{}_n": 1, "vibration_energy{}_j": 0}


def predict_trials(
    trials: str | Path | pd.DataFrame,
    model: str | Path | LearnedModel,
    output: str | Path | None = None,
    *,
    layout: TableLayout = UNDECLARED,
) -> pd.DataFrame:
    """Predict trials by the model of a session.

    Parameters
    ----------
    trials : str, Path or DataFrame
        A table as trials.csv: ``trial``, ``block``, ``height_um``, ``load_n``, ``speed_mm_s``, and
        what the effects of the model follow.
    model : str, Path or LearnedModel
        ``model.json`` of `stepblocks loop`.
    output : str or Path, optional
        CSV to write.
    layout : TableLayout
        What is declared of a table that is a file.

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
    if isinstance(trials, pd.DataFrame):
        refuse_declared_layout(layout, "a table in memory", PipelineError)
    else:
        trials = read_table(Path(trials), ("trial", "block", "tip"), layout)
    if not isinstance(model, LearnedModel):
        model = read_model(model)
    result, _ = predict_with_model(trials, model)
    if output is not None:
        write_table(result, Path(output), "%.9g")
    return result


def predict_with_model(
    table: pd.DataFrame, learned: LearnedModel
) -> tuple[pd.DataFrame, DragState]:
    """Predict a table of trials; beside the figures the slots of the extended model."""
    conditions = _read_conditions(table, learned)
    # a block is known by its name; a new height under an old name is a block of its own
    design = build_bench_design(
        table["block"].to_numpy(dtype=np.str_),
        conditions.columns,
        learned.tool.stiffness,
        learned.known_laws,
    )
    extended = _predict_channels(design, learned.extended, learned)
    nominal = _predict_channels(design, learned.nominal, learned)
    trials = table["trial"].to_numpy()
    result = {
        "trial": trials,
        "status": conditions.describe_statuses(extended.state.mark_locked_trials()),
    }
    # first the values, then their intervals
    for ends in ({"": 0.0}, {"_low": -WIDE, "_high": WIDE}):
        for prefix, channels in (("", extended), ("nominal_", nominal)):
            is_missing = channels.state.mark_locked_trials() | conditions.is_invalid
            for figure, channel in _FIGURES.items():
                for end, shift in ends.items():
                    name = prefix + figure.format(end)
                    result[name] = _compute_channel_values(channels, channel, shift, is_missing)
                    _refuse_infinite(result[name], name, trials, is_missing)
    return pd.DataFrame(result), extended.state


@dataclass(frozen=True)
class _ChannelPrediction:
    """Channels of single trials, shape (trials, channels): logarithms and their spread."""

    mean: Floats
    std: Floats
    state: DragState  # the slots that they were computed from


def _compute_channel_values(
    channels: _ChannelPrediction, channel: int, shift_in_stds: float, is_missing: NDArray[np.bool_]
) -> Floats:
    """Return a channel, shifted by so many standard deviations; NaN where it is missing."""
    logarithm = channels.mean[:, channel] + shift_in_stds * channels.std[:, channel]
    return np.where(is_missing, np.nan, np.exp(logarithm))


def _refuse_infinite(
    values: Floats, name: str, trials: NDArray[np.generic], is_missing: NDArray[np.bool_]
) -> None:
    """Refuse a table of which a trial is predicted as infinite."""
    is_infinite = ~np.isfinite(values) & ~is_missing
    if is_infinite.any():
        raise PipelineError(
            f"{name} of trial {trials[is_infinite][0]!r} is not finite: its conditions "
            "or the model lie beyond all bounds [model.json]"
        )


@dataclass(frozen=True)
class _Conditions:
    """The columns to predict from, and for each trial what is wrong with its row."""

    columns: dict[str, NDArray[np.generic]]
    invalid: NDArray[np.object_]  # names of columns that hold no number, joined by "; "
    outside: NDArray[np.object_]  # names of columns beyond the range of the data, joined by "; "

    @property
    def is_invalid(self) -> NDArray[np.bool_]:
        """Trials that cannot be predicted."""
        return self.invalid.astype(bool)

    def describe_statuses(self, is_locked: NDArray[np.bool_]) -> NDArray[np.object_]:
        """Return the status of each trial in words, shape (n,)."""
        status = np.where(self.outside.astype(bool), "outside-range(" + self.outside + ")", "ok")
        status = np.where(is_locked, "locked", status)
        return np.where(self.is_invalid, "invalid(" + self.invalid + ")", status)


def _read_conditions(table: pd.DataFrame, learned: LearnedModel) -> _Conditions:
    """Read the columns that a model needs from a table of trials."""
    covariates: set[str] = set()
    for law in learned.extended.laws:
        covariates.update(split_covariate_columns(law.covariate))
    needed = ("trial", "block", *_POSITIVE, *sorted(covariates))
    missing = [name for name in needed if name not in table.columns]
    if missing:
        raise PipelineError(
            f"trials must have the columns {', '.join(missing)}, which the model needs"
        )
    must_be_known = {*_POSITIVE, *covariates}
    ranges = {place.name: place for place in learned.ranges}
    columns: dict[str, NDArray[np.generic]] = {}
    invalid = np.full(len(table), "", dtype=object)
    outside = np.full(len(table), "", dtype=object)
    for name in sorted(must_be_known | (set(ranges) & set(table.columns))):
        place = ranges.get(name)
        if place is not None and place.labels:
            labels = table[name].astype(str).to_numpy()
            _append_column_name(outside, ~np.isin(labels, place.labels), name)
            columns[name] = labels
            continue
        numbers = np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=np.float64)
        is_good = np.isfinite(numbers)
        if name in _POSITIVE:
            is_good &= numbers > 0.0
        if name in must_be_known:
            _append_column_name(invalid, ~is_good, name)
        if place is not None:
            slack = _ROUNDED * max(abs(place.low), abs(place.high))
            is_beyond = (numbers < place.low - slack) | (numbers > place.high + slack)
            _append_column_name(outside, is_good & is_beyond, name)
        columns[name] = np.where(is_good, numbers, 1.0)
    columns["tip_radius_um"] = _read_tip_radii_um(table, learned)
    return _Conditions(columns, invalid, outside)


def _append_column_name(texts: NDArray[np.object_], rows: NDArray[np.bool_], name: str) -> None:
    """Add a column's name to the texts of some rows."""
    texts[rows] = np.where(texts[rows] == "", name, texts[rows] + f"; {name}")


def _read_tip_radii_um(table: pd.DataFrame, learned: LearnedModel) -> Floats:
    """Read the radius of each trial's tip [um]; without a column that of the session."""
    tips = table.get("tip", pd.Series("", table.index)).astype(str)
    return np.array([parse_tip_radius_um(tip, learned.tip_radius_um) for tip in tips])


def _predict_channels(
    design: BenchDesign, fitted: LearnedFit, learned: LearnedModel
) -> _ChannelPrediction:
    """Predict channels of single trials, with all that is uncertain about them."""
    state = build_extended_state(design, fitted.values, fitted.list_active_effects())
    mean = compute_shown_channels(state)
    jacobian = _compute_jacobian(design, fitted, mean)
    variance = (
        np.einsum("nci,ij,ncj->nc", jacobian, fitted.covariance, jacobian)
        + np.einsum("nck,k->nc", compute_channel_responses(state) ** 2, learned.quantity_std**2)
        + learned.channel_std**2
    )
    for unseen in _iterate_unseen_variances(design, fitted, learned, mean):
        variance += unseen
    known_blocks = []
    for block in learned.blocks:
        if make_height_error_name(block) in fitted.values:
            known_blocks.append(block)
    is_unknown = ~np.isin(design.block, known_blocks)
    if np.any(is_unknown):
        # the height of a block that was never measured is as uncertain as its prior
        higher = compute_shown_channels(state.changed(height=state.height + _HEIGHT_STEP))
        slope = (higher - mean) / _HEIGHT_STEP
        variance += np.where(is_unknown[:, None], (slope * learned.height_std) ** 2, 0.0)
    return _ChannelPrediction(mean, np.sqrt(variance), state)


def _compute_channels_at_values(
    design: BenchDesign,
    fitted: LearnedFit,
    values: Mapping[str, float],
    columns: Columns | None = None,
) -> Floats:
    """Compute the channels at other parameters, or other covariates, than those fitted."""
    if columns:
        design = replace(design, covariates=columns)
    return compute_shown_channels(
        build_extended_state(design, values, fitted.list_active_effects(values))
    )


def _compute_jacobian(design: BenchDesign, fitted: LearnedFit, mean: Floats) -> Floats:
    """Return slopes of the channels by the parameters, shape (trials, channels, parameters)."""
    jacobian = np.zeros((*mean.shape, len(fitted.values)))
    sizes = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    for i, (name, value) in enumerate(fitted.values.items()):
        step = _STEP * sizes[i]
        if step > 0.0:
            changed = _compute_channels_at_values(
                design, fitted, {**fitted.values, name: value + step}
            )
            jacobian[:, :, i] = (changed - mean) / step
    return jacobian


def _iterate_unseen_variances(
    design: BenchDesign, fitted: LearnedFit, learned: LearnedModel, mean: Floats
) -> Iterator[Floats]:
    """Yield variances of the channels for a day, a batch or an hour not in the session.

    Such a value is as uncertain as those that the session had differ.
    """
    followed = {law.covariate for law in fitted.laws} & set(design.covariates)
    for place in learned.ranges:
        is_stepped = bool(place.labels) or place.name == "run_order"
        if not is_stepped or place.name not in followed:
            continue
        column = design.covariates[place.name]
        if place.labels:
            seen = np.array(place.labels)
            is_new = ~np.isin(column, seen)
        else:
            seen = np.linspace(place.low, place.high, _HOURS)
            is_new = np.clip(column, place.low, place.high) != column
        predictions = []
        for value in seen:
            columns = {**design.covariates, place.name: np.full(len(mean), value)}
            predictions.append(_compute_channels_at_values(design, fitted, fitted.values, columns))
        spread = np.mean((np.array(predictions) - mean) ** 2, axis=0)
        yield np.where(is_new[:, None], spread, 0.0)


@dataclass(frozen=True)
class LearnedDrag(LearnedPrediction):
    """One drag as the extended model sees it: ``ok``, ``locked``, or ``outside-range(columns)``."""

    friction: float
    tool: Tool  # with the learned spring, conversion and ring
    # what the model adds to the ball's radius [m]; 0 where it has no such effect
    edge_radius: float


def predict_learned_drag(
    learned: LearnedModel, block: str, height: float, condition: OperatingPoint
) -> LearnedDrag:
    """Predict a drag over one step by a learned model, with its friction and tool."""
    row: dict[str, object] = {
        "trial": "1",
        "block": block,
        "tip": f"tip-{condition.ball_radius * 1e6:.6f}",
        "height_um": height * 1e6,
        "load_n": condition.normal_load,
        "speed_mm_s": condition.speed * 1e3,
    }
    for place in learned.ranges:
        if place.name in row or place.pair or place.name == PEAK_FORCE:
            continue
        if place.labels:
            row[place.name] = place.labels[0]
        else:
            row[place.name] = 0.5 * (place.low + place.high)
    table, state = predict_with_model(pd.DataFrame([row]), learned)
    found = table.iloc[0]
    shown = dict(zip(CHANNELS, compute_shown_channels(state)[0], strict=True))
    tool = replace(
        condition.tool,
        stiffness=float(state.stiffness[0]),
        conversion=float(state.conversion[0]),
        frequency=float(np.exp(shown["ln_ring_frequency"])),
        decay_time=float(np.exp(shown["ln_decay_time"])),
    )
    force_figure, energy_figure = _FIGURES
    force = _read_figure_with_bounds(found, force_figure)
    energy = _read_figure_with_bounds(found, energy_figure)
    return LearnedDrag(
        status=str(found["status"]),
        peak_force=force,
        energy=energy,
        friction=float(state.friction[0]),
        tool=tool,
        edge_radius=max(float(state.radius[0]) - condition.ball_radius, 0.0),
    )


def _read_figure_with_bounds(row: pd.Series, figure: str) -> tuple[float, float, float]:
    """Read a figure of a row, and the ends of its interval."""
    return (
        float(row[figure.format("")]),
        float(row[figure.format("_low")]),
        float(row[figure.format("_high")]),
    )


def apply_learned_constants(stimuli: StimulusSet, learned: LearnedModel) -> StimulusSet:
    """Return a set with friction, spring and conversion of a session in place of its own."""
    values = learned.extended.values
    grid = stimuli.prediction
    tool = grid.tool.model_copy(
        update={
            "stiffness": learned.tool.stiffness * values["stiffness_ratio"],
            "conversion": float(np.exp(values["ln_conversion"])),
        }
    )
    learned_grid = grid.model_copy(update={"frictions": (values["friction"],), "tool": tool})
    return stimuli.model_copy(update={"prediction": learned_grid})


def format_learned_columns(prediction: Prediction, learned: LearnedModel) -> dict[str, str]:
    """Say beside a prediction what the extended model, effects and all, predicts."""
    if prediction.release.status is not Status.RELEASES:
        nothing = (math.nan, math.nan, math.nan)
        return _format_learned_figures("", nothing, nothing)
    height = prediction.face.far_side
    if prediction.edge_direction != "up":
        # an edge that is no plain step counts as the step of the same critical angle
        angle, radius = prediction.release.angle, prediction.point.ball_radius
        height = float(compute_height_at_angle(angle, radius))
    drag = predict_learned_drag(learned, prediction.edge_name, float(height), prediction.point)
    energy_uj = [1e6 * energy for energy in drag.energy]
    return _format_learned_figures(drag.status, drag.peak_force, energy_uj)


def _format_learned_figures(
    status: str, force: Iterable[float], energy: Iterable[float]
) -> dict[str, str]:
    """Format a learned drag as columns: a force [N] and an energy [uJ], each with its ends."""
    row = {"learned_status": status}
    for figure, values in (("peak_force{}_n", force), ("vibration_energy{}_uj", energy)):
        for end, value in zip(("", "_95_low", "_95_high"), values, strict=True):
            row[f"learned_{figure.format(end)}"] = format_six_digits(value)
    return row
