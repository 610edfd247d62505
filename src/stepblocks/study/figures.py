"""Figures of a study as SVG text, the same bytes from the same data."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np

_COLOURS = ("#1f6f8b", "#c8553d", "#588157", "#7b4fa3", "#b08900", "#5b6b79")
_INK, _LINE = "#1d2a36", "#999999"


def study_figures(result: Any) -> Iterator[tuple[str, str]]:
    """Draw what a study found: captions and SVG."""
    if result.f_test is not None and result.mixed is not None:
        yield "Estimates against height; bars: standard deviation of the judgements.", _svg(_estimates, result)
        yield "Differences between conditions with the intervals of both analyses.", _svg(_intervals, result)
        caption = "Residuals of the mixed model: against fitted values, and their quantiles against the normal's."
        yield caption, _svg(_residuals, result)
    if result.ordinal is not None:
        yield "Share of each rating of realism.", _svg(_ratings, result)
    if result.curves:
        yield 'Share of answers "higher", with the fitted functions; area of a dot: trials.', _svg(_curves, result)
    if result.power_law is not None:
        yield "Magnitudes against height, one line per participant.", _svg(_magnitudes, result)


def _svg(draw: Any, result: Any) -> str:
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": draw.__name__, "svg.fonttype": "path", "font.size": 10}):
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure, result)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    content = text.getvalue()
    return content[content.index("<svg") :]


def _colour(index: int) -> str:
    return _COLOURS[index % len(_COLOURS)]


def _estimates(figure: Any, result: Any) -> None:
    axes, frame = figure.subplots(), result.frame
    groups = list(frame.groupby("condition"))
    top = float(max(frame["height"].max(), frame["estimate"].max())) * 1e6
    axes.plot([0, top], [0, top], color=_LINE, lw=1, label="true height")
    for index, (name, own) in enumerate(groups):
        cells = own.groupby("height")["estimate"].agg(["mean", "std"])
        x = cells.index.to_numpy() * 1e6 + (index - 0.5 * (len(groups) - 1)) * (0.006 * top)  # beside each other
        style = {"fmt": "o-", "ms": 4, "lw": 1.2, "capsize": 3, "color": _colour(index), "label": str(name)}
        axes.errorbar(x, cells["mean"] * 1e6, cells["std"].fillna(0.0) * 1e6, **style)
    axes.set(xlabel="height, um", ylabel="estimate, um")
    axes.legend(frameon=False)


def _intervals(figure: Any, result: Any) -> None:
    axes = figure.subplots()
    names = [f"{one.first} - {one.second}" for one in result.f_test.intervals]
    for index, (offset, family, label) in enumerate(
        ((0.12, result.f_test.intervals, "Tukey after the F-test"), (-0.12, result.mixed.intervals, "mixed model"))
    ):
        middle = np.array([one.difference for one in family]) * 1e6
        reach = np.array([[one.difference - one.low, one.high - one.difference] for one in family]).T * 1e6
        style = {"fmt": "o", "capsize": 4, "label": label, "color": _colour(index)}
        axes.errorbar(middle, np.arange(len(family)) + offset, xerr=reach, **style)
    axes.axvline(0.0, color=_LINE, lw=1)
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(-0.6, len(names) - 0.4), xlabel="difference of errors, um")
    axes.legend(frameon=False)


def _residuals(figure: Any, result: Any) -> None:
    from scipy.stats import probplot

    left, right = figure.subplots(1, 2)
    dots = {"ms": 3, "alpha": 0.6, "color": _COLOURS[0]}
    left.plot(result.mixed.fitted * 1e6, result.mixed.residuals * 1e6, "o", **dots)
    left.axhline(0.0, color=_LINE, lw=1)
    left.set(xlabel="fitted error, um", ylabel="residual, um")
    (quantiles, ordered), (slope, intercept, _) = probplot(result.mixed.residuals * 1e6)
    right.plot(quantiles, ordered, "o", **dots)
    right.plot(quantiles, intercept + slope * quantiles, color=_LINE, lw=1)
    right.set(xlabel="normal quantile", ylabel="residual, um")


def _ratings(figure: Any, result: Any) -> None:
    axes, frame = figure.subplots(), result.frame
    ratings = np.arange(int(frame["rating"].min()), int(frame["rating"].max()) + 1)
    groups = list(frame.groupby("condition"))
    width = 0.8 / len(groups)
    for index, (name, own) in enumerate(groups):
        share = [float((own["rating"] == rating).mean()) for rating in ratings]
        x = ratings + (index - 0.5 * (len(groups) - 1)) * width
        axes.bar(x, share, width, label=str(name), color=_colour(index))
    axes.set_xticks(ratings)
    axes.set(xlabel="rating of realism", ylabel="share")
    axes.legend(frameon=False)


def _curves(figure: Any, result: Any) -> None:
    from scipy.special import ndtr

    axes = figure.subplots()
    for index, curve in enumerate(result.curves):
        last = index == len(result.curves) - 1
        levels, totals = np.array(curve.levels), np.array(curve.totals)
        if last:
            share, area = np.array(curve.hits) / totals, 60 * totals / totals.max()
            axes.scatter(levels * 1e6, share, s=area, color=_INK, zorder=3)
        if curve.fit is None:
            continue
        x = np.geomspace(0.8 * levels.min(), 1.2 * levels.max(), 200)
        rise = ndtr(np.log(x / curve.fit.threshold) / curve.fit.spread)
        y = curve.fit.lapse + (1.0 - 2.0 * curve.fit.lapse) * rise
        style = {"color": _INK, "lw": 2.2} if last else {"color": _colour(index), "lw": 1}
        axes.plot(x * 1e6, y, **style, label=curve.who if len(result.curves) < 15 or last else None)
    axes.set(xlabel="height, um", ylabel='share "higher"')
    if any(curve.fit for curve in result.curves):
        axes.legend(frameon=False, title="participant", ncols=2, fontsize=8)


def _magnitudes(figure: Any, result: Any) -> None:
    axes = figure.subplots()
    for index, (_, own) in enumerate(result.frame.groupby("participant", sort=False)):
        means = own.assign(log=np.log(own["magnitude"])).groupby("height")["log"].mean()
        axes.loglog(means.index.to_numpy() * 1e6, np.exp(means), "o-", ms=3, lw=1, color=_colour(index))
    axes.set(xlabel="height, um", ylabel="geometric mean of magnitudes")
