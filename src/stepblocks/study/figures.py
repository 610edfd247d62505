"""Figures of a study as SVG text, the same bytes from the same data."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np

_COLOURS = ("#1f6f8b", "#c8553d", "#588157", "#7b4fa3", "#b08900", "#5b6b79")


def study_figures(result: Any) -> list[tuple[str, str]]:
    """Draw what a study found."""
    return list(_figures(result))


def _figures(result: Any) -> Iterator[tuple[str, str]]:
    if result.f_test is not None and result.mixed is not None:
        yield "Estimates against height; bars: standard deviation of the judgements.", _svg(_estimates, result)
        yield "Differences between conditions with the intervals of both analyses.", _svg(_intervals, result)
        yield (
            "Residuals of the mixed model: against fitted values, and their quantiles against the normal's.",
            _svg(_residuals, result),
        )
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


def _estimates(figure: Any, result: Any) -> None:
    axes = figure.subplots()
    frame = result.frame
    groups = list(frame.groupby("condition"))
    top = float(max(frame["height"].max(), frame["estimate"].max())) * 1e6
    axes.plot([0, top], [0, top], color="#999999", lw=1, label="true height")
    step = 0.006 * top
    for index, (name, own) in enumerate(groups):
        cells = own.groupby("height")["estimate"].agg(["mean", "std"])
        shift = (index - 0.5 * (len(groups) - 1)) * step
        axes.errorbar(
            cells.index.to_numpy() * 1e6 + shift,
            cells["mean"] * 1e6,
            cells["std"].fillna(0.0) * 1e6,
            fmt="o-",
            ms=4,
            lw=1.2,
            capsize=3,
            color=_COLOURS[index % len(_COLOURS)],
            label=str(name),
        )
    axes.set_xlabel("height, um")
    axes.set_ylabel("estimate, um")
    axes.legend(frameon=False)


def _intervals(figure: Any, result: Any) -> None:
    axes = figure.subplots()
    assert result.f_test is not None  # drawn only where there are
    assert result.mixed is not None
    names = [f"{one.first} - {one.second}" for one in result.f_test.intervals]
    for offset, family, label in (
        (0.12, result.f_test.intervals, "Tukey after the F-test"),
        (-0.12, result.mixed.intervals, "mixed model"),
    ):
        middle = np.array([one.difference for one in family]) * 1e6
        reach = np.array([[one.difference - one.low, one.high - one.difference] for one in family]).T * 1e6
        axes.errorbar(
            middle,
            np.arange(len(family)) + offset,
            xerr=reach,
            fmt="o",
            capsize=4,
            label=label,
            color=_COLOURS[0 if offset > 0 else 1],
        )
    axes.axvline(0.0, color="#999999", lw=1)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xlabel("difference of errors, um")
    axes.legend(frameon=False)


def _residuals(figure: Any, result: Any) -> None:
    from scipy.stats import probplot

    assert result.mixed is not None  # drawn only where there is one
    left, right = figure.subplots(1, 2)
    left.plot(result.mixed.fitted * 1e6, result.mixed.residuals * 1e6, "o", ms=3, alpha=0.6, color=_COLOURS[0])
    left.axhline(0.0, color="#999999", lw=1)
    left.set_xlabel("fitted error, um")
    left.set_ylabel("residual, um")
    (quantiles, ordered), (slope, intercept, _) = probplot(result.mixed.residuals * 1e6)
    right.plot(quantiles, ordered, "o", ms=3, alpha=0.6, color=_COLOURS[0])
    right.plot(quantiles, intercept + slope * quantiles, color="#999999", lw=1)
    right.set_xlabel("normal quantile")
    right.set_ylabel("residual, um")


def _ratings(figure: Any, result: Any) -> None:
    axes = figure.subplots()
    ratings = np.arange(int(result.frame["rating"].min()), int(result.frame["rating"].max()) + 1)
    groups = list(result.frame.groupby("condition"))
    width = 0.8 / len(groups)
    for index, (name, own) in enumerate(groups):
        share = [float((own["rating"] == rating).mean()) for rating in ratings]
        axes.bar(
            ratings + (index - 0.5 * (len(groups) - 1)) * width,
            share,
            width,
            label=str(name),
            color=_COLOURS[index % len(_COLOURS)],
        )
    axes.set_xticks(ratings)
    axes.set_xlabel("rating of realism")
    axes.set_ylabel("share")
    axes.legend(frameon=False)


def _curves(figure: Any, result: Any) -> None:
    from scipy.special import ndtr

    axes = figure.subplots()
    for index, curve in enumerate(result.curves):
        colour, last = _COLOURS[index % len(_COLOURS)], index == len(result.curves) - 1
        levels, totals = np.array(curve.levels), np.array(curve.totals)
        if last:
            axes.scatter(
                levels * 1e6, np.array(curve.hits) / totals, s=60 * totals / totals.max(), color="#1d2a36", zorder=3
            )
        if curve.fit is None:
            continue
        x = np.geomspace(0.8 * levels.min(), 1.2 * levels.max(), 200)
        rise = ndtr(np.log(x / curve.fit.threshold) / curve.fit.spread)
        y = curve.fit.lapse + (1.0 - 2.0 * curve.fit.lapse) * rise
        axes.plot(
            x * 1e6,
            y,
            color="#1d2a36" if last else colour,
            lw=2.2 if last else 1,
            label=curve.who if len(result.curves) < 15 or last else None,
        )
    axes.set_xlabel("height, um")
    axes.set_ylabel('share "higher"')
    axes.legend(frameon=False, title="participant", ncols=2, fontsize=8)


def _magnitudes(figure: Any, result: Any) -> None:
    axes = figure.subplots()
    for index, (_, own) in enumerate(result.frame.groupby("participant", sort=False)):
        means = own.assign(log=np.log(own["magnitude"])).groupby("height")["log"].mean()
        axes.loglog(
            means.index.to_numpy() * 1e6, np.exp(means), "o-", ms=3, lw=1, color=_COLOURS[index % len(_COLOURS)]
        )
    axes.set_xlabel("height, um")
    axes.set_ylabel("geometric mean of magnitudes")
