"""The page about a session: what was found, why, and what is left to explain.

It is one file that opens offline.
"""

import base64
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stepblocks.files.figures import make_figure
from stepblocks.files.pages import render_page
from stepblocks.lawsearch.adequacy import LEVEL
from stepblocks.lawsearch.explain import Explanation
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import Law
from stepblocks.loop.bench_model import find_column
from stepblocks.loop.figures import AFTER, BEFORE, CHANNELS, plot_agreement
from stepblocks.loop.finding import (
    CHANNELS_IN_WORDS,
    describe_covariate,
    format_errors,
    format_value,
)
from stepblocks.loop.result import LoopResult
from stepblocks.quantities import format_column_label
from stepblocks.records.model import WIDE
from stepblocks.rig.forward import PEAK_FORCE, SPEED_OVER_LOAD

_UNASKED = {
    "separates": [],
    "calibration": [],
    "note": "",
    "trials": [],
    "channel": "",
    "repeats": 0,
    "width_after": {},
    "block": None,
}
_SHOWN_CHANNELS = ("ln_energy", "ln_peak_force", "sliding_friction")
_FINE = 12  # settings that are averaged one by one, not in groups


def render_loop_page(result: LoopResult, traces: Sequence[Path] = ()) -> str:
    """Render the page; `traces` are figures of the trials held apart."""
    return render_page(
        "stepblocks.loop",
        "loop.html.j2",
        title=result.title,
        asked=_UNASKED | (result.document["next_experiment"] or {}),
        words=CHANNELS_IN_WORDS,
        say=describe_covariate,
        value=format_value,
        residual_level=LEVEL,
        r=result.document,
        errors=format_errors(result.document),
        constants=[
            (n, p) for n, p in result.document["extended"]["parameters"].items() if "." not in n
        ],
        traces=[_encode(path.read_bytes()) for path in traces],
        agreement=_draw_agreement(result.found),
        residuals=[_draw_residuals(result.found, channel) for channel in _SHOWN_CHANNELS],
        curves=[
            _draw_effect(
                result,
                finding.effect,
                str(entry["id"]).removesuffix(f"_{entry['covariate']}").replace("_", " "),
            )
            # the names are those of the result: one that was withdrawn there is not claimed here
            for finding, entry in zip(
                result.found.findings, result.document["effects"], strict=True
            )
        ],
    )


def _encode_png(figure: "Figure") -> str:
    buffer = BytesIO()
    figure.set_dpi(110.0)
    # as `savefig` does, but laid out and drawn once
    FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
    return _encode(buffer.getvalue())


def _encode(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _draw_agreement(explanation: Explanation) -> str:
    figure, axes = make_figure(1, 2, width=10.0, height=4.4)
    for axis, channel in zip(axes, CHANNELS, strict=True):
        plot_agreement(explanation, axis, channel)
    return _encode_png(figure)


def _draw_residuals(explanation: Explanation, channel: str) -> dict[str, str]:
    # Residuals of one channel against every covariate that varies, before and after
    trials = explanation.problem.trials
    j = trials.channels.index(channel)
    before, after = (
        trials.values[:, j] - fitted.predicted[:, j]
        for fitted in (explanation.nominal, explanation.extended)
    )
    columns = {
        name: column for name, column in trials.covariates.items() if len(np.unique(column)) > 1
    } | {PEAK_FORCE: find_column(trials, explanation.extended.predicted, PEAK_FORCE)}
    rows = -(-len(columns) // 3)
    figure, grid = make_figure(rows, 3, width=11.0, height=2.6 * rows)
    axes = grid.ravel()
    for axis, (name, column) in zip(axes, columns.items(), strict=False):
        x, ticks = _find_plot_positions(np.asarray(column))
        axis.axhline(0.0, color="0.6", lw=0.8)
        axis.plot(x, before, ".", ms=3, color=BEFORE, alpha=0.55, label="nominal")
        axis.plot(x, after, ".", ms=3, color=AFTER, alpha=0.75, label="extended")
        axis.set_xlabel(format_column_label(name))
        axis.sharey(axes[0])
        if ticks:
            axis.set_xticks(list(ticks), list(ticks.values()))
        else:  # five figures of seconds have room side by side
            axis.locator_params("x", nbins=6)
    for axis in axes[len(columns) :]:
        axis.set_visible(False)
    axes[0].legend(fontsize=8)
    axes[0].set_ylabel("ln of measured over predicted" if "ln_" in channel else "difference")
    return {"channel": CHANNELS_IN_WORDS[channel], "image": _encode_png(figure)}


def _find_plot_positions(column: NDArray[np.generic]) -> tuple[Floats, dict[int, str]]:
    # Where to draw a column: numbers where they are, labels in a row, of which those are written
    # that have room side by side
    if np.issubdtype(column.dtype, np.number):
        return np.asarray(column, dtype=np.float64), {}
    labels, inverse = np.unique(column.astype(str), return_inverse=True)
    # under one of three figures side by side there is room for 32 letters
    every = -(-len(labels) * (max(map(len, labels)) + 2) // 32)
    return np.asarray(inverse, dtype=np.float64), {
        place: str(labels[place]) for place in range(0, len(labels), every)
    }


def _draw_effect(result: LoopResult, effect: Law, name_shown: str) -> dict[str, str]:
    # Draw the change that an effect makes in the channel that it moves most, over what it follows,
    # with its 95 % band.
    j, change, std = _compute_change(result.found, effect)
    (along, ticks), name = _find_abscissa(result, effect)
    x, curve, band = _average_by_setting(along, change, std)
    unit = CHANNELS_IN_WORDS[result.found.problem.trials.channels[j]]
    low, middle, high = (100.0 * np.expm1(curve + side * band) for side in (-WIDE, 0.0, WIDE))
    figure, axis = make_figure(width=6.0, height=3.4)
    if ticks:  # nothing lies between two labels
        axis.errorbar(x, middle, (middle - low, high - middle), fmt="o", color=AFTER)
        axis.set_xticks(list(ticks), list(ticks.values()))
    else:
        axis.fill_between(x, low, high, color=AFTER, alpha=0.25, lw=0)
        axis.plot(x, middle, color=AFTER)
    axis.axhline(0.0, color="0.6", lw=0.8)
    axis.set(xlabel=format_column_label(name), ylabel=f"change of {unit}, %")
    return {
        "title": f"{name_shown}: change of {unit} that it makes, average over the other settings",
        "image": _encode_png(figure),
    }


def _compute_change(explanation: Explanation, effect: Law) -> tuple[int, Floats, Floats]:
    # Return the channel that an effect moves most, its change trial by trial, and the standard
    # deviation of that change.
    trials, fitted, model = (
        explanation.problem.trials,
        explanation.extended,
        explanation.problem.model,
    )
    others = [(e, own) for e, own in fitted.active if e is not effect]

    def change(values: Mapping[str, float]) -> Floats:
        return np.asarray(
            model.predict(trials, values, [*others, (effect, effect.pick_own_values(values))])
            - model.predict(trials, values, others)
        )

    base = change(fitted.values)
    j = int(np.argmax(np.nanmean(np.abs(base[:, :2]), axis=0)))
    index = [i for i, p in enumerate(fitted.parameters) if p.name.startswith(f"{effect.id}.")]
    steps = {
        p.name: 0.05 * fitted.std[p.name] or 1e-12 for p in (fitted.parameters[i] for i in index)
    }
    slopes = [
        (change(fitted.values | {name: fitted.values[name] + step}) - base)[:, j] / step
        for name, step in steps.items()
    ]
    variance = np.einsum("in,ij,jn->n", slopes, fitted.covariance[np.ix_(index, index)], slopes)
    return j, base[:, j], np.sqrt(np.maximum(variance, 0.0))


def _find_abscissa(result: LoopResult, effect: Law) -> tuple[tuple[Floats, dict[int, str]], str]:
    # Return what an effect follows, as numbers with their labels, and its name. The height where it
    # follows nothing.
    trials, fitted = result.table.trials, result.found.extended
    known = (*trials.covariates, PEAK_FORCE, SPEED_OVER_LOAD)
    name = effect.covariate if effect.covariate in known else "height_um"
    return _find_plot_positions(find_column(trials, fitted.predicted, name)), name


def _average_by_setting(
    along: Floats, values: Floats, std: Floats
) -> tuple[Floats, Floats, Floats]:
    table = pd.DataFrame({"along": along, "values": values, "std": std})
    groups = table["along"]
    if groups.nunique() > _FINE:
        groups = pd.qcut(
            groups.rank(method="first"), min(24, max(2, len(table) // 5)), labels=False
        )
    x, mean, spread = table.groupby(groups.to_numpy()).mean().to_numpy().T
    return x, mean, spread
