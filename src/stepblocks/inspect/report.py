"""Table and plot of an inspection: every value with its limits and guard band, and where on the scan it was taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.atomic import beside
from stepblocks.inspect.conformity import Decision, Outcome
from stepblocks.inspect.inspection import Inspected
from stepblocks.parts.characteristics import Characteristic

_COLOUR = {Outcome.CONFORMS: "#2e7d4f", Outcome.DOES_NOT_CONFORM: "#b3261e", Outcome.NOT_PROVEN: "#b07d00"}
_MOST_DRAWN = 4000
Judged = Sequence[tuple[Characteristic, Decision]]


def inspection_table(identity: str, inspected: Inspected, judged: Judged, verdict: Outcome, felt: str) -> str:
    """Return the table as text."""
    names = f"{'value um':>10} {'u um':>8} {'U95 um':>8} {'lower um':>10} {'upper um':>10} {'guard um':>9}"
    head = f"{'characteristic':30} {names}  verdict"
    lines = [f"{identity}: {verdict.value}", "", head, "-" * len(head)]
    for one, decision in judged:
        lines.append(
            f"{one.label:30} {decision.value * 1e6:10.4f} {decision.std * 1e6:8.4f} "
            f"{inspected.values[one.key].expanded() * 1e6:8.4f} {_limit(decision.lower):>10} "
            f"{_limit(decision.upper):>10} {decision.guard * 1e6:9.4f}  {decision.verdict.value}"
        )
    known = {one.key for one, _ in judged}
    for key, measured in inspected.values.items():
        if key not in known:
            lines.append(
                f"{measured.name:30} {measured.value * 1e6:10.4f} {measured.std * 1e6:8.4f} "
                f"{measured.expanded() * 1e6:8.4f}  (no limits)"
            )
    lines += ["", "uncertainty budget, standard uncertainties in um"]
    for measured in inspected.values.values():
        parts = ", ".join(
            f"{part.name} {'not stated' if math.isnan(part.std) else f'{part.std * 1e6:.4f}'}"
            for part in measured.components
        )
        lines.append(f"  {measured.name}: {parts}")
    unstated = sorted({name for measured in inspected.values.values() for name in measured.unstated})
    if unstated:
        lines.append(f"  not stated counts as zero: {', '.join(unstated)}")
    lines += [
        "",
        f"convention: {inspected.convention}",
        "decision: ISO 14253-1, guard band 1.65 u, or Student's 95 % point where u has few degrees of freedom",
    ]
    lines += [f"note: {note}" for note in inspected.notes]
    if felt:
        lines.append(f"felt: {felt}")
    return "\n".join(lines)


def _limit(value: float) -> str:
    return "-" if math.isinf(value) else f"{value * 1e6:.4f}"


def draw_inspection(path: Path, identity: str, inspected: Inspected, judged: Judged, verdict: Outcome) -> None:
    """Draw scan, windows, limits and guard bands into an SVG or PNG file."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "stepblocks", "font.family": "DejaVu Sans", "font.size": 9}):
        figure = Figure(figsize=(9.0, 4.6 + 0.62 * len(judged)), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(1 + len(judged), 1, height_ratios=[5.0, *[1.0] * len(judged)])
        axes = np.atleast_1d(axes)
        _draw_scan(axes[0], inspected, judged)
        axes[0].set_title(f"{identity}: {verdict.value}", color=_COLOUR[verdict], fontweight="bold", loc="left")
        for axis, (one, decision) in zip(axes[1:], judged, strict=True):
            _draw_limits(axis, one, decision)
        metadata = {"Date": None} if path.suffix == ".svg" else {}
        with beside(path) as draft:
            figure.savefig(draft, metadata=metadata, dpi=120)


def _draw_scan(axis: Any, inspected: Inspected, judged: Judged) -> None:
    shown = inspected.shown
    thin = max(len(shown.position) // _MOST_DRAWN, 1)
    x, z = shown.position[::thin] * 1e6, shown.height[::thin] * 1e6
    axis.plot(x, z, color="#1d2a36", linewidth=0.9)
    for begin, end, name in shown.windows:
        axis.axvspan(begin * 1e6, end * 1e6, color="#1f6f8b", alpha=0.12, linewidth=0)
        axis.annotate(
            name,
            (0.5e6 * (begin + end), 0.96),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="top",
            color="#1f6f8b",
        )
    heights = [
        decision for one, decision in judged if one.key in ("step_height", "ridge_height", "horizontal_discrepancy")
    ]
    heights += [decision for one, decision in judged if one.key == "groove_depth"]
    for decision in heights:
        sign = (
            -1.0 if np.nanmedian(z) > 0.5 * (np.nanmin(z) + np.nanmax(z)) and np.nanmin(z) < -0.5 * np.ptp(z) else 1.0
        )
        for limit in (decision.lower, decision.upper):
            if math.isfinite(limit):
                axis.axhline(sign * limit * 1e6, color="#c8553d", linestyle="--", linewidth=0.8)
    low, high = np.nanmin(z), np.nanmax(z)
    axis.set_ylim(low - 0.08 * (high - low), high + 0.22 * (high - low))
    axis.set_xlim(x[0], x[-1])
    axis.set_xlabel("position / um")
    axis.set_ylabel("height / um")
    axis.spines[["top", "right"]].set_visible(False)


def _draw_limits(axis: Any, one: Characteristic, decision: Decision) -> None:
    lower, upper = decision.lower, decision.upper
    if math.isinf(lower):
        lower = min(0.0, decision.value - 3.0 * decision.std)
    span = max(upper - lower, 8.0 * decision.std, 1e-12)
    left = min(lower, decision.value - 2.0 * decision.std) - 0.15 * span
    right = max(upper, decision.value + 2.0 * decision.std) + 0.15 * span
    guard = decision.guard
    inner = lower + (guard if math.isfinite(decision.lower) else 0.0)
    axis.axvspan(left * 1e6, right * 1e6, color="#b3261e", alpha=0.10, linewidth=0)
    outer = lower - (guard if math.isfinite(decision.lower) else 0.0)
    axis.axvspan(outer * 1e6, (upper + guard) * 1e6, color="#f2d9a0", linewidth=0)
    if upper - guard > inner:
        axis.axvspan(inner * 1e6, (upper - guard) * 1e6, color="#cfe8d8", linewidth=0)
    for limit in (decision.lower, decision.upper):
        if math.isfinite(limit):
            axis.axvline(limit * 1e6, color="#c8553d", linestyle="--", linewidth=0.9)
    axis.errorbar(
        decision.value * 1e6,
        0.0,
        xerr=1.96e6 * decision.std,
        fmt="o",
        color=_COLOUR[decision.verdict],
        capsize=3,
        markersize=5,
    )
    axis.set_xlim(left * 1e6, right * 1e6)
    axis.set_ylim(-1.0, 1.0)
    axis.set_yticks([])
    axis.set_ylabel(f"{one.label} / um", rotation=0, ha="right", va="center")
    axis.spines[["top", "right", "left"]].set_visible(False)
