"""The page about a session: what was found, on what grounds, and what is left; one file that opens offline."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.atomic import replace_text

Floats = NDArray[np.float64]

_BEFORE, _AFTER = "#b0506a", "#2f6f9f"


@dataclass(frozen=True)
class Panel:
    """Residuals of one channel against one covariate, before and after; labels instead of numbers where it has any."""

    channel: str
    covariate: str
    x: NDArray[Any]
    before: Floats
    after: Floats


@dataclass(frozen=True)
class Traced:
    """An effect as a curve with its 95 % band: change of a channel in percent over what the effect follows."""

    title: str
    xlabel: str
    ylabel: str
    x: Floats
    curve: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True)
class LoopReport:
    """Contents of the page."""

    title: str  # Name of the session
    result: Mapping[str, Any]  # Contents of result.json
    panels: Sequence[Panel]  # Residuals
    traced: Sequence[Traced]  # Effects as curves
    worst: Sequence[Mapping[str, Any]]  # Trials that the extended model misses most


def write_report(report: LoopReport, path: Path) -> None:
    """Write the page."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(loader=PackageLoader("stepblocks.loop"), autoescape=True, trim_blocks=True)
    environment.filters["figure"] = _figure
    text = environment.get_template("loop.html.j2").render(
        title=report.title,
        r=report.result,
        residuals=[_residuals(report.panels, channel) for channel in dict.fromkeys(p.channel for p in report.panels)],
        curves=[_curve(traced) for traced in report.traced],
        worst=report.worst,
    )
    replace_text(path, text)


def _figure(value: Any) -> str:
    """Four digits; a dash for what does not exist."""
    if isinstance(value, bool) or value is None:
        return "-" if value is None else str(value).lower()
    if isinstance(value, int | float):
        return f"{value:.4g}" if np.isfinite(value) else "-"
    return str(value)


def _png(figure: Any) -> str:
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _residuals(panels: Sequence[Panel], channel: str) -> dict[str, str]:
    from matplotlib.figure import Figure

    own = [p for p in panels if p.channel == channel]
    rows = -(-len(own) // 3)
    figure = Figure(figsize=(11.0, 2.6 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, 3, sharey=True)).ravel()
    for axis, panel in zip(axes, own, strict=False):
        x, ticks = _positions(panel.x)
        axis.axhline(0.0, color="0.6", lw=0.8)
        axis.plot(x, panel.before, ".", ms=3, color=_BEFORE, alpha=0.55, label="nominal")
        axis.plot(x, panel.after, ".", ms=3, color=_AFTER, alpha=0.75, label="extended")
        axis.set_xlabel(panel.covariate)
        if ticks:
            axis.set_xticks(range(len(ticks)), ticks)
    for axis in axes[len(own) :]:
        axis.set_visible(False)
    axes[0].legend(fontsize=8)
    axes[0].set_ylabel(f"residual of {channel}")
    return {"channel": channel, "image": _png(figure)}


def _positions(column: NDArray[Any]) -> tuple[Floats, list[str]]:
    if np.issubdtype(column.dtype, np.number):
        return np.asarray(column, dtype=np.float64), []
    labels, inverse = np.unique(column.astype(str), return_inverse=True)
    return np.asarray(inverse, dtype=np.float64), [str(label) for label in labels]


def _curve(traced: Traced) -> dict[str, str]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.4), layout="constrained")
    axis = figure.subplots()
    axis.fill_between(traced.x, traced.low, traced.high, color=_AFTER, alpha=0.25, lw=0)
    axis.plot(traced.x, traced.curve, color=_AFTER)
    axis.axhline(0.0, color="0.6", lw=0.8)
    axis.set_xlabel(traced.xlabel)
    axis.set_ylabel(traced.ylabel)
    return {"title": traced.title, "image": _png(figure)}
