"""A figure of one trial with what was fitted drawn in: given curves and marks, it knows no fit."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.atomic import beside

Array = NDArray[np.float64]

_LINE, _FIT, _SECOND, _FAINT = "#1f4e79", "#c0392b", "#7f8c8d", "#b0b7bd"


@dataclass(frozen=True)
class TrialPicture:
    """What there is to draw of a trial."""

    title: str  # Over the figure
    time: Array  # shape (n,); The record [s, N]
    tangential: Array
    normal: Array
    # Name, instants [s] and force [N] of each fitted piece
    curves: list[tuple[str, Array, Array]] = field(default_factory=list)
    marks: dict[str, tuple[float, float]] = field(default_factory=dict)  # Named points: instant [s] and force [N]
    envelope: tuple[Array, float, Array] | None = None  # Instants [s], middle and amplitude [N] of the ring
    notes: list[str] = field(default_factory=list)  # Figures in words, with their uncertainties


def draw_trial(picture: TrialPicture, path: Path) -> None:
    """Draw a trial to a file; the suffix of `path` says the format."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    whole, near, normal = figure.subplots(3, 1, height_ratios=[2.0, 2.6, 1.0])
    figure.suptitle(picture.title, fontsize=11)
    _tangential(whole, picture)
    _tangential(near, picture)
    release = picture.marks.get("release", (float(picture.time[0]), 0.0))[0]
    near.set_xlim(1e3 * (release - 12e-3), 1e3 * (release + 40e-3))
    if picture.notes:
        near.text(
            0.99,
            0.97,
            "\n".join(picture.notes),
            transform=near.transAxes,
            ha="right",
            va="top",
            fontsize=8,
            bbox={"facecolor": "white", "edgecolor": _FAINT, "alpha": 0.9},
        )
    whole.legend(loc="upper right", fontsize=8, frameon=False)
    normal.plot(1e3 * picture.time, picture.normal, color=_LINE, linewidth=0.6)
    normal.set_ylabel("normal force / N")
    normal.set_xlabel("time / ms")
    metadata = {"Software": None} if path.suffix == ".png" else None
    with beside(path) as draft:
        figure.savefig(draft, format=path.suffix.lstrip(".") or "png", dpi=130, metadata=metadata)


def _tangential(axes: Any, picture: TrialPicture) -> None:
    axes.plot(1e3 * picture.time, picture.tangential, ".", color=_LINE, markersize=1.8, label="measured")
    if picture.envelope is not None:
        instants, middle, size = picture.envelope
        for sign in (1.0, -1.0):
            axes.plot(1e3 * instants, middle + sign * size, color=_SECOND, linewidth=0.9, linestyle="--")
    for index, (name, instants, force) in enumerate(picture.curves):
        style = "-" if index % 2 == 0 else "-."
        axes.plot(1e3 * instants, force, color=_FIT, linewidth=1.1, linestyle=style, label=name)
    for name, (at, height) in picture.marks.items():
        axes.plot([1e3 * at], [height], marker="o", color=_FIT, markersize=4, fillstyle="none")
        axes.annotate(name, (1e3 * at, height), textcoords="offset points", xytext=(5, 4), fontsize=8)
    axes.set_ylabel("tangential force / N")
