"""The page about a session: what was found, why, and what is left to explain.

It is one file that opens offline.
"""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stepblocks.files.figures import Axes, make_figure_and_axes
from stepblocks.files.pages import render_page
from stepblocks.lawsearch.adequacy import LEVEL
from stepblocks.lawsearch.findings import Explanation
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import Law
from stepblocks.loop.bench_model import get_covariate_column
from stepblocks.loop.channels import CHANNELS_IN_WORDS, JUDGED, is_logarithm
from stepblocks.loop.experiment import NextExperiment
from stepblocks.loop.figures import AFTER, BEFORE, CHANNELS, plot_agreement
from stepblocks.loop.finding import format_held_out_errors
from stepblocks.loop.record import Estimate, LoopRecord
from stepblocks.loop.result import LoopResult
from stepblocks.loop.words import (
    convert_name_to_words,
    describe_covariate,
    format_effect_name,
    format_in_readable_unit,
)
from stepblocks.quantities import format_column_label
from stepblocks.records.model import WIDE
from stepblocks.rig.forward import PEAK_FORCE, SPEED_OVER_LOAD

_SHOWN_CHANNELS = ("ln_energy", "ln_peak_force", "sliding_friction")
_DOTS_PER_INCH = 110.0
_COLUMNS = 3  # of figures side by side
_LETTERS = 32  # for which there is room under one of three figures side by side
_MOST_TICKS = 6  # five figures of seconds have room side by side
_FINE = 12  # settings that are averaged one by one, not in groups
_FEWEST_GROUPS, _MOST_GROUPS, _TRIALS_PER_GROUP = 2, 24, 5
# step of a difference, in standard uncertainties of a parameter, and where that is zero
_STEP, _LEAST_STEP = 0.05, 1e-12


@dataclass(frozen=True)
class Picture:
    """A figure of the page.

    Attributes
    ----------
    title : str
        What it shows.
    image : str
        PNG as a data URL.
    """

    title: str
    image: str


@dataclass(frozen=True)
class Abscissa:
    """Where trials are drawn.

    Attributes
    ----------
    places : Floats
        Shape (n,).
    ticks : dict[int, str]
        Labels by their places; empty where the places are numbers.
    """

    places: Floats
    ticks: dict[int, str]


@dataclass(frozen=True)
class EffectChange:
    """The change that an effect makes in the channel that it moves most.

    Attributes
    ----------
    channel : int
    change : Floats
        Shape (n,), trial by trial.
    std : Floats
        Shape (n,), standard uncertainties of the change.
    """

    channel: int
    change: Floats
    std: Floats


def render_loop_page(result: LoopResult, traces: Sequence[Path] = ()) -> str:
    """Render the page.

    Parameters
    ----------
    result : LoopResult
    traces : sequence of Path
        Figures of the trials that were held apart.
    """
    record, found = result.record, result.found
    encoded_traces = [_encode_data_url(path.read_bytes()) for path in traces]
    residuals = [_draw_channel_residuals(found, channel) for channel in _SHOWN_CHANNELS]
    return render_page(
        "stepblocks.loop",
        "loop.html.j2",
        title=result.title,
        asked=record.next_experiment or NextExperiment(()),
        plain=convert_name_to_words,
        say=describe_covariate,
        name_effect=format_effect_name,
        value=format_in_readable_unit,
        residual_level=LEVEL,
        r=record,
        errors=format_held_out_errors(record.nominal.error, record.extended.error),
        constants=_list_extended_model_constants(record),
        traces=encoded_traces,
        agreement=_draw_agreement(found),
        residuals=residuals,
        curves=_draw_effect_curves(result),
    )


def _list_extended_model_constants(record: LoopRecord) -> list[tuple[str, Estimate]]:
    """List the constants of the extended model by name, without the parameters of its effects."""
    parameters = record.extended.parameters.items()
    return [(name, estimate) for name, estimate in parameters if "." not in name]


def _draw_effect_curves(result: LoopResult) -> list[Picture]:
    """Draw the curve of every effect that was found."""
    pictures = []
    for finding, entry in zip(result.found.findings, result.record.effects, strict=True):
        # the name is that of the record: one that was withdrawn there is not claimed here
        name = entry.id.removesuffix(f"_{entry.covariate}").replace("_", " ")
        pictures.append(_draw_effect_curve(result, finding.effect, name))
    return pictures


def _draw_as_data_url(figure: "Figure") -> str:
    """Draw a figure as a data URL, as `savefig` does, but laid out and drawn once."""
    buffer = BytesIO()
    figure.set_dpi(_DOTS_PER_INCH)
    FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
    return _encode_data_url(buffer.getvalue())


def _encode_data_url(png: bytes) -> str:
    """Turn a PNG into a data URL."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _draw_agreement(explanation: Explanation) -> str:
    """Draw measured against predicted energies and forces."""
    figure, axes = make_figure_and_axes(1, 2, width=10.0, height=4.4)
    for axis, channel in zip(axes, CHANNELS, strict=True):
        plot_agreement(explanation, axis, channel)
    return _draw_as_data_url(figure)


def _draw_channel_residuals(explanation: Explanation, channel: str) -> Picture:
    """Draw the residuals of one channel against every covariate that varies, before and after."""
    trials = explanation.problem.trials
    j = trials.channels.index(channel)
    before = trials.values[:, j] - explanation.nominal.predicted[:, j]
    after = trials.values[:, j] - explanation.extended.predicted[:, j]
    columns = _list_varying_columns(explanation)
    rows = -(-len(columns) // _COLUMNS)
    figure, grid = make_figure_and_axes(rows, _COLUMNS, width=11.0, height=2.6 * rows)
    axes = grid.ravel()
    for axis, (name, column) in zip(axes, columns.items(), strict=False):
        _draw_residuals_against_covariate(axis, name, column, before, after)
        axis.sharey(axes[0])
    for axis in axes[len(columns) :]:
        axis.set_visible(False)
    axes[0].legend(fontsize=8)
    unit = "ln of measured over predicted" if is_logarithm(channel) else "difference"
    axes[0].set_ylabel(unit)
    return Picture(CHANNELS_IN_WORDS[channel], _draw_as_data_url(figure))


def _list_varying_columns(explanation: Explanation) -> dict[str, NDArray[np.generic]]:
    """List the covariates that vary, and the predicted peak force, each of shape (n,)."""
    trials = explanation.problem.trials
    columns: dict[str, NDArray[np.generic]] = {}
    for name, column in trials.covariates.items():
        if len(np.unique(column)) > 1:
            columns[name] = column
    columns[PEAK_FORCE] = get_covariate_column(trials, explanation.extended.predicted, PEAK_FORCE)
    return columns


def _draw_residuals_against_covariate(
    axis: Axes, covariate: str, column: NDArray[np.generic], before: Floats, after: Floats
) -> None:
    """Draw residuals, of the nominal and of the extended model, against one covariate."""
    abscissa = compute_abscissa(np.asarray(column))
    axis.axhline(0.0, color="0.6", lw=0.8)
    axis.plot(abscissa.places, before, ".", ms=3, color=BEFORE, alpha=0.55, label="nominal")
    axis.plot(abscissa.places, after, ".", ms=3, color=AFTER, alpha=0.75, label="extended")
    axis.set_xlabel(format_column_label(covariate))
    if abscissa.ticks:
        axis.set_xticks(list(abscissa.ticks), list(abscissa.ticks.values()))
    else:
        axis.locator_params("x", nbins=_MOST_TICKS)


def compute_abscissa(column: NDArray[np.generic]) -> Abscissa:
    """Find where to draw the trials of a column of shape (n,).

    Numbers are drawn where they are, labels in a row, of which those are written that have room
    side by side.
    """
    if np.issubdtype(column.dtype, np.number):
        return Abscissa(np.asarray(column, dtype=np.float64), {})
    labels, inverse = np.unique(column.astype(str), return_inverse=True)
    longest = max(map(len, labels))
    step = -(-len(labels) * (longest + 2) // _LETTERS)  # rounded up
    ticks = {}
    for place in range(0, len(labels), step):
        ticks[place] = str(labels[place])
    return Abscissa(np.asarray(inverse, dtype=np.float64), ticks)


def _draw_effect_curve(result: LoopResult, effect: Law, effect_name: str) -> Picture:
    """Draw the change that an effect makes over what it follows, with its 95 % band."""
    shown = compute_effect_change(result.found, effect)
    covariate = choose_plotted_covariate(result, effect)
    trials = result.table.trials
    column = get_covariate_column(trials, result.found.extended.predicted, covariate)
    abscissa = compute_abscissa(column)
    x, curve, band = average_effect_by_setting(abscissa.places, shown.change, shown.std)
    channel = CHANNELS_IN_WORDS[result.found.problem.trials.channels[shown.channel]]
    low = _convert_log_change_to_percent(curve - WIDE * band)
    middle = _convert_log_change_to_percent(curve)
    high = _convert_log_change_to_percent(curve + WIDE * band)
    figure, axis = make_figure_and_axes(width=6.0, height=3.4)
    if abscissa.ticks:  # nothing lies between two labels
        axis.errorbar(x, middle, (middle - low, high - middle), fmt="o", color=AFTER)
        axis.set_xticks(list(abscissa.ticks), list(abscissa.ticks.values()))
    else:
        axis.fill_between(x, low, high, color=AFTER, alpha=0.25, lw=0)
        axis.plot(x, middle, color=AFTER)
    axis.axhline(0.0, color="0.6", lw=0.8)
    axis.set(xlabel=format_column_label(covariate), ylabel=f"change of {channel}, %")
    title = f"{effect_name}: change of {channel} that it makes, average over the other settings"
    return Picture(title, _draw_as_data_url(figure))


def _convert_log_change_to_percent(log_change: Floats) -> Floats:
    """Turn a change of a logarithm into percents of the number itself."""
    return np.asarray(100.0 * np.expm1(log_change))


def compute_effect_change(explanation: Explanation, effect: Law) -> EffectChange:
    """Compute the change that an effect makes in the channel that it moves most.

    The uncertainty follows to first order from that of the parameters of the effect.
    """
    problem, fitted = explanation.problem, explanation.extended
    other_effects = fitted.list_other_active_effects(effect)

    def predict_change(values: Mapping[str, float]) -> Floats:
        """Predict the channels with the effect less those without it, shape (n, c)."""
        active = [*other_effects, (effect, effect.pick_own_values(values))]
        with_effect = problem.model.predict(problem.trials, values, active)
        return np.asarray(
            with_effect - problem.model.predict(problem.trials, values, other_effects)
        )

    base = predict_change(fitted.values)
    channel = int(np.argmax(np.nanmean(np.abs(base[:, JUDGED]), axis=0)))
    slopes, rows = [], []
    for row, p in enumerate(fitted.parameters):
        if not p.name.startswith(f"{effect.id}."):
            continue
        step = _STEP * fitted.std[p.name] or _LEAST_STEP
        moved = predict_change(fitted.values | {p.name: fitted.values[p.name] + step})
        slopes.append((moved - base)[:, channel] / step)
        rows.append(row)
    covariance = fitted.covariance[np.ix_(rows, rows)]
    variance = np.einsum("in,ij,jn->n", slopes, covariance, slopes)
    return EffectChange(channel, base[:, channel], np.sqrt(np.maximum(variance, 0.0)))


def choose_plotted_covariate(result: LoopResult, effect: Law) -> str:
    """Choose over what an effect is drawn: what it follows, or the height where that is nothing."""
    known = (*result.table.trials.covariates, PEAK_FORCE, SPEED_OVER_LOAD)
    if effect.covariate in known:
        return effect.covariate
    return "height_um"


def average_effect_by_setting(
    abscissa_values: Floats, values: Floats, std: Floats
) -> tuple[Floats, Floats, Floats]:
    """Average values over trials of one setting, or of neighbouring settings where they are many.

    Parameters
    ----------
    abscissa_values, values, std : Floats
        Shape (n,): setting, value and uncertainty of each trial.

    Returns
    -------
    abscissa_values, values, std : arrays of shape (m,)
        Means of each group, in the order of the settings.
    """
    table = pd.DataFrame({"along": abscissa_values, "values": values, "std": std})
    groups = table["along"]
    if groups.nunique() > _FINE:
        count = min(_MOST_GROUPS, max(_FEWEST_GROUPS, len(table) // _TRIALS_PER_GROUP))
        groups = pd.qcut(groups.rank(method="first"), count, labels=False)
    x, mean, spread = table.groupby(groups.to_numpy()).mean().to_numpy().T
    return x, mean, spread
