"""The files of an inspection: table, JSON, as-built record, filled sheet, and the plot of scan, limits and guard bands."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.artefacts.as_built import AsBuilt, AsBuiltValue, write_as_built
from stepblocks.artefacts.inspection_sheet import write_sheet_csv
from stepblocks.artefacts.scans.scan import Profile
from stepblocks.atomic import beside, replace_text
from stepblocks.inspect.conformity import Decision, Outcome
from stepblocks.inspect.result import InspectionResult
from stepblocks.parts.characteristics import Characteristic

_COLOUR = {Outcome.CONFORMS: "#2e7d4f", Outcome.DOES_NOT_CONFORM: "#b3261e", Outcome.NOT_PROVEN: "#b07d00"}
_MOST_DRAWN = 4000
_HEIGHTS = ("step_height", "ridge_height", "horizontal_discrepancy", "groove_depth")  # limits drawn beside the scan


def write_inspection(result: InspectionResult, folder: str | Path) -> list[Path]:
    """Write table, plot, JSON and as-built record of an inspection, and the inspection sheet filled in.

    Parameters
    ----------
    result : InspectionResult
        From `inspect_scan` or `inspect_standard`.
    folder : str or Path
        Made where it is missing; the files carry the identity of the part.

    Returns
    -------
    list of Path
        What was written.
    """
    base = Path(folder) / result.identity
    base.parent.mkdir(parents=True, exist_ok=True)

    def named(ending: str) -> Path:
        return base.with_name(f"{base.name}.{ending}")

    values = {one.key: AsBuiltValue(d.value, d.std, d.verdict.value) for one, d in result.judged}
    digest = hashlib.sha256(result.source.read_bytes()).hexdigest()
    inspected, shown = result.inspected, result.inspected.shown
    surface = Profile(shown.position, shown.height) if result.felt else None
    record = AsBuilt(result.identity, result.source.name, digest, inspected.convention, values, surface)
    paths = write_as_built(named("as-built.toml"), record)
    paths += [named(f"inspection.{ending}") for ending in ("json", "txt", "svg")]
    replace_text(paths[-3], json.dumps(result.as_record(), indent=2, allow_nan=False) + "\n")
    replace_text(paths[-2], f"{result}\n")
    draw_inspection(paths[-1], result)
    if result.stimulus is not None:
        paths.append(named("inspection-sheet.csv"))
        filled = {key: (one.value, one.std, one.verdict) for key, one in values.items()}
        write_sheet_csv(paths[-1], result.stimulus, filled)
    return paths


def draw_inspection(path: Path, result: InspectionResult) -> None:
    """Draw scan, windows, limits and guard bands into an SVG or PNG file."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    count = len(result.judged)
    with mpl.rc_context({"svg.hashsalt": "stepblocks", "font.family": "DejaVu Sans", "font.size": 9}):
        figure = Figure(figsize=(9.0, 4.6 + 0.62 * count), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(1 + count, 1, height_ratios=[5.0, *[1.0] * count], squeeze=False)[:, 0]
        _draw_scan(axes[0], result)
        title = f"{result.identity}: {result.verdict.value}"
        axes[0].set_title(title, color=_COLOUR[result.verdict], fontweight="bold", loc="left")
        for axis, (one, decision) in zip(axes[1:], result.judged, strict=True):
            _draw_limits(axis, one, decision)
        metadata = {"Date": None} if path.suffix == ".svg" else {}
        with beside(path) as draft:
            figure.savefig(draft, metadata=metadata, dpi=120)


def _draw_scan(axis: Any, result: InspectionResult) -> None:
    shown = result.inspected.shown
    thin = max(len(shown.position) // _MOST_DRAWN, 1)
    x, z = shown.position[::thin] * 1e6, shown.height[::thin] * 1e6
    axis.plot(x, z, color="#1d2a36", linewidth=0.9)
    for begin, end, name in shown.windows:
        axis.axvspan(begin * 1e6, end * 1e6, color="#1f6f8b", alpha=0.12, linewidth=0)
        place = (0.5e6 * (begin + end), 0.96)
        axis.annotate(name, place, xycoords=("data", "axes fraction"), ha="center", va="top", color="#1f6f8b")
    low, high = np.nanmin(z), np.nanmax(z)
    # of a feature that lies below the faces the limits are drawn below them
    falls = np.nanmedian(z) > 0.5 * (low + high) and low < -0.5 * np.ptp(z)
    for one, decision in result.judged:
        for limit in (decision.lower, decision.upper):
            if one.key in _HEIGHTS and math.isfinite(limit):
                axis.axhline((-1.0 if falls else 1.0) * limit * 1e6, color="#c8553d", linestyle="--", linewidth=0.8)
    axis.set_ylim(low - 0.08 * (high - low), high + 0.22 * (high - low))
    axis.set_xlim(x[0], x[-1])
    axis.set_xlabel("position / um")
    axis.set_ylabel("height / um")
    axis.spines[["top", "right"]].set_visible(False)


def _draw_limits(axis: Any, one: Characteristic, decision: Decision) -> None:
    value, std, upper, guard = decision.value, decision.std, decision.upper, decision.guard
    bounded = math.isfinite(decision.lower)
    lower = decision.lower if bounded else min(0.0, value - 3.0 * std)
    span = max(upper - lower, 8.0 * std, 1e-12)
    left = min(lower, value - 2.0 * std) - 0.15 * span
    right = max(upper, value + 2.0 * std) + 0.15 * span
    below = guard if bounded else 0.0
    axis.axvspan(left * 1e6, right * 1e6, color="#b3261e", alpha=0.10, linewidth=0)
    axis.axvspan((lower - below) * 1e6, (upper + guard) * 1e6, color="#f2d9a0", linewidth=0)
    if upper - guard > lower + below:
        axis.axvspan((lower + below) * 1e6, (upper - guard) * 1e6, color="#cfe8d8", linewidth=0)
    for limit in (decision.lower, decision.upper):
        if math.isfinite(limit):
            axis.axvline(limit * 1e6, color="#c8553d", linestyle="--", linewidth=0.9)
    colour = _COLOUR[decision.verdict]
    axis.errorbar(value * 1e6, 0.0, xerr=1.96e6 * std, fmt="o", color=colour, capsize=3, markersize=5)
    axis.set_xlim(left * 1e6, right * 1e6)
    axis.set_ylim(-1.0, 1.0)
    axis.set_yticks([])
    axis.set_ylabel(f"{one.label} / um", rotation=0, ha="right", va="center")
    axis.spines[["top", "right", "left"]].set_visible(False)
