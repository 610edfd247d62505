"""The figures of a study, each with the data that it draws."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from stepblocks.files.figures import Axes, take_axes
from stepblocks.quantities import format_column_label
from stepblocks.study import Table
from stepblocks.study.analysis.repeated import average_participants

Panels: TypeAlias = Any  # a figure of matplotlib, which is loaded when it draws, or its axes
Result: TypeAlias = Any  # a `StudyResult`, whose own method draws its first figure by this file

_COLOURS = ("#1f6f8b", "#c8553d", "#588157", "#7b4fa3", "#b08900", "#5b6b79")
# beside the colours, so that nobody needs them: marker and dash of lines, hatch of bars
_STYLES = ("o-", "s--", "^-.", "D:", "v-", "P--")
_HATCHES = ("", "////", "....", "xxxx", "----", "ooo")
_INK, _LINE = "#1d2a36", "#999999"
_SIZE = (7.0, 3.0)  # of a figure across both columns of a journal [inch]


def draw_study_figures(result: Result) -> Iterator[tuple[str, str, Panels, Table]]:
    """Draw what a study found: name, caption, figure, and the data that are drawn."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.rcsetup import cycler

    for name, (draw, part, caption) in _FIGURES.items():
        if getattr(result, part):
            with mpl.rc_context({"font.size": 8, "axes.prop_cycle": cycler(color=_COLOURS)}):
                figure = Figure(figsize=_SIZE, layout="constrained")
                FigureCanvasAgg(figure)
                data = draw(figure, result)
            yield name, caption, figure, data


def draw_main_figure(result: Result, ax: "Axes | None" = None) -> "Axes":
    """Draw the first figure of a study, which has one pair of axes, where it is wanted."""
    axes = take_axes(ax)
    draws = [draw for draw, part, _ in _FIGURES.values() if getattr(result, part)]
    draws[0](SimpleNamespace(subplots=lambda: axes), result)
    return axes


def _draw_estimates(figure: Panels, result: Result) -> Table:
    axes = figure.subplots()
    frame = result.frame
    top = float(max(frame["height"].max(), frame["estimate"].max())) * 1e6
    axes.plot([0, top], [0, top], color=_LINE, lw=1, label="true height")
    cells = (1e6 * frame["estimate"]).groupby([frame["condition"], _convert_heights(frame)])
    means = cells.agg(mean_um="mean", sd_um="std").reset_index()
    middle = 0.5 * (means["condition"].nunique() - 1)
    for index, (name, own) in enumerate(means.groupby("condition")):
        axes.errorbar(
            own["height_um"] + (index - middle) * 0.006 * top,  # side by side
            own["mean_um"],
            own["sd_um"].fillna(0.0),
            fmt=_STYLES[index % len(_STYLES)],
            ms=4,
            lw=1.2,
            capsize=3,
            label=str(name),
        )
    axes.set(xlabel=format_column_label("height_um"), ylabel=format_column_label("estimate_um"))
    axes.legend(frameon=False)
    return means


def _convert_heights(frame: Table) -> pd.Series:
    return (1e6 * frame["height"]).rename("height_um")


def _draw_participants(figure: Panels, result: Result) -> Table:
    rows = []
    panels = np.atleast_1d(figure.subplots(1, len(result.measures)))
    for axes, measure in zip(panels, result.measures, strict=True):
        shift, factor = (np.log(1e6), 1.0) if measure.logarithmic else (0.0, 1e6)
        table = average_participants(measure.frame) * factor + shift
        x = np.arange(table.shape[1])
        keys = measure.frame.groupby("participant").first()
        places, groups = pd.factorize(keys.get("group", keys.index == ""), sort=True)
        for place, (who, row) in zip(places, table.iterrows(), strict=True):
            colour, style = (kinds[place % len(kinds)] for kinds in (_COLOURS, _STYLES))
            axes.plot(x, row, style, color=colour, ms=3, lw=0.8, alpha=0.7, label=groups[place])
            axes.text(x[-1] + 0.06, row.iloc[-1], str(who), fontsize=6, color=colour, va="center")
        axes.plot(x, table.mean(), "s-", color=_INK, ms=5, lw=2)
        axes.set_xticks(x, table.columns, rotation=20 if len(x) > 3 else 0)
        axes.set(ylabel=measure.label, xlim=(-0.4, len(x) - 0.4))
        rows.append(table.stack().rename("value").reset_index().assign(measure=measure.label))
    if len(groups) > 1:
        by_group = {line.get_label(): line for line in axes.lines}
        figure.legend(
            [by_group[group] for group in groups],
            groups,
            loc="outside upper center",
            ncols=len(groups),
            frameon=False,
        )
    return pd.concat(rows)


def _draw_ratings(figure: Panels, result: Result) -> Table:
    axes = figure.subplots()
    shares = pd.crosstab(result.frame["rating"], result.frame["condition"], normalize="columns")
    width = 0.8 / shares.shape[1]
    for index, name in enumerate(shares):
        axes.bar(
            shares.index + (index - 0.5 * (shares.shape[1] - 1)) * width,
            shares[name],
            width,
            label=str(name),
            hatch=_HATCHES[index % len(_HATCHES)],
            edgecolor="white",
        )
    axes.set_xticks(shares.index)
    axes.set(xlabel="rating of realism", ylabel="share of the ratings")
    axes.legend(frameon=False)
    return shares.reset_index()


def _draw_curves(figure: Panels, result: Result) -> Table:
    from scipy.special import ndtr

    axes = figure.subplots()
    rows = []
    for index, found in enumerate(result.comparisons):
        colour, style = (kinds[index % len(kinds)] for kinds in (_COLOURS, _STYLES))
        levels = np.array(sorted({level for one in found.curves for level in one.levels}))
        x = np.geomspace(0.8 * levels.min(), 1.2 * levels.max(), 200)
        for curve in found.curves:
            axes.plot(
                np.array(curve.levels) * 1e6,
                np.array(curve.hits) / np.array(curve.totals),
                style[0],
                ms=3,
                alpha=0.5,
                color=colour,
            )
            rows += [
                (found.setting, curve.who, level * 1e6, hits, total)
                for level, hits, total in zip(curve.levels, curve.hits, curve.totals, strict=True)
            ]
            if fit := curve.fit:
                y = fit.lapse + (1.0 - 2.0 * fit.lapse) * ndtr(
                    np.log(x / fit.threshold[0]) / fit.spread
                )
                axes.plot(x * 1e6, y, color=colour, lw=0.7, alpha=0.6)
                axes.text(x[-1] * 1e6, y[-1], f" {curve.who}", fontsize=6, va="center")
        if found.equal and found.spread:
            away = (np.log(x / found.standard) - found.equal.value) / np.exp(found.spread.value)
            axes.plot(
                x * 1e6,
                ndtr(away),
                style[1:],
                color=colour,
                lw=2.4,
                label=found.setting or "mean participant",
            )
    axes.set(xlabel=format_column_label("height_um"), ylabel='share of answers "higher"')
    if axes.get_legend_handles_labels()[1]:
        axes.legend(frameon=False)
    return pd.DataFrame(rows, columns=["setting", "participant", "height_um", "higher", "trials"])


def _draw_magnitudes(figure: Panels, result: Result) -> Table:
    axes = figure.subplots()
    frame = result.frame
    means = np.exp(
        np.log(frame["magnitude"])
        .groupby([frame["condition"], frame["participant"], _convert_heights(frame)])
        .mean()
    ).reset_index()
    for index, (condition, some) in enumerate(means.groupby("condition")):
        place = index % len(_COLOURS)
        look = {"color": _COLOURS[place], "ms": 3, "lw": 1}
        axes.plot([], [], _STYLES[place], label=condition, **look)
        for _, own in some.groupby("participant"):
            axes.loglog(own["height_um"], own["magnitude"], _STYLES[place], **look)
    axes.set(xlabel=format_column_label("height_um"), ylabel="geometric mean of magnitudes")
    if means["condition"].nunique() > 1:
        axes.legend(frameon=False)
    return means


# by the name of the file: what draws, the part of the result that it needs, and the caption
_FIGURES = {
    "estimates": (
        _draw_estimates,
        "measures",
        "Estimates against height; bars: standard deviation of the judgements.",
    ),
    "curves": (
        _draw_curves,
        "comparisons",
        'Share of answers "higher": thin, with its name, each participant; bold, the mean '
        "participant.",
    ),
    "magnitudes": (
        _draw_magnitudes,
        "power_laws",
        "Magnitudes against height, one line per participant.",
    ),
    "participants": (
        _draw_participants,
        "measures",
        "Every participant: a line each, with its name; black: the mean.",
    ),
    "ratings": (_draw_ratings, "ordinal", "Share of each rating of realism."),
}
