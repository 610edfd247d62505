"""The page of an output folder: pictures, dimensions, predictions with their curves, verdicts and the interactive view."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.atomic import replace_text
from stepblocks.contact import kernels
from stepblocks.contact.energy import Status
from stepblocks.page_file import render_page
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.set import StimulusSet
from stepblocks.predict.predictions import Prediction, Predictions, as_row
from stepblocks.predict.sheaths import conditions_of, decay_test_rows, ring_rows

_LINKED = {".step", ".stl", ".obj", ".ply", ".3mf", ".glb", ".tiff", ".npz", ".json"}  # files that the page links
_INK, _COLOURS = "#1d2a36", ("#1f6f8b", "#c8553d", "#588157", "#7b4fa3", "#b08900")
_WORDS = {Status.LOCKED: "locked", Status.TOO_HIGH: "too high", Status.NO_CATCH: "no catch"}


@dataclass(frozen=True)
class Section:
    """A set with what is predicted of it and what was made of it."""

    stimuli: StimulusSet
    predictions: Predictions
    records: Mapping[str, Mapping[str, Any]]  # by stimulus, of those that were made


def write_page(sections: Sequence[Section], output: Path) -> list[Path]:
    """Write ``index.html`` and the script of plotly beside it, so that the page works without a network."""
    from plotly.offline import get_plotlyjs

    script, page = output / "assets" / "plotly.min.js", output / "index.html"
    script.parent.mkdir(exist_ok=True)
    source = str(get_plotlyjs())
    if not script.is_file() or script.read_text(encoding="utf-8") != source:
        replace_text(script, source)
    shown = [_section(section) for section in sections]
    rows = [row for section in shown for row in section["rows"]]
    failed = sum(bool(row["failed"]) for row in rows)
    replace_text(page, render_page("build", "index.html", sections=shown, total=len(rows), failed=failed))
    return [script, page]


def _section(section: Section) -> dict[str, Any]:
    stimuli, rings = section.stimuli, _ring_lines(section.stimuli)
    rows = []
    for identity, record in section.records.items():
        predictions = section.predictions.by_stimulus(identity)
        summary = [*_summary(predictions), *rings.get(identity, [])]
        rows.append(_row(f"{stimuli.name}/{identity}", record, predictions) | {"summary": summary})
    tables = [
        {"title": title, "file": f"{stimuli.name}/{name}", "rows": found}
        for title, name, found in (
            ("How the probe rings", "rings.csv", ring_rows(stimuli)),
            ("What the damping test will measure", "damping-test.csv", decay_test_rows(stimuli)),
        )
        if found
    ]
    head = {"name": stimuli.name, "title": stimuli.title, "source": stimuli.source}
    return head | {"rows": rows, "figure": _figure(stimuli), "tables": tables}


def _ring_lines(stimuli: StimulusSet) -> dict[str, list[str]]:
    """Frequency and decay with each sheath, beside those of the bare probe."""
    lines: dict[str, list[str]] = {}
    conditions = conditions_of(stimuli)
    for one in conditions[1:]:
        bare, ring = conditions[0].ring, one.ring
        lines.setdefault(one.sheath, []).append(
            f"{one.use}: rings at {ring.frequency:.1f} Hz, decays in {ring.decay_time * 1e3:.2f} ms; "
            f"bare {bare.frequency:.1f} Hz, {bare.decay_time * 1e3:.2f} ms"
        )
    return lines


def _row(folder: str, record: Mapping[str, Any], predictions: Sequence[Prediction]) -> dict[str, Any]:
    return {
        **{name: record[name] for name in ("kind", "dimensions", "derived", "verdicts")},
        "id": record["stimulus"],
        "folder": folder,
        "failed": [verdict for verdict in record["verdicts"] if not verdict["passed"]],
        "files": [name for name in record["outputs"] if Path(name).suffix in _LINKED],
        "predictions": [as_row(prediction) for prediction in predictions],
    }


def _summary(predictions: Sequence[Prediction]) -> Iterator[str]:
    """Range of what is felt in each direction, and what locks."""
    for drag in dict.fromkeys(prediction.drag for prediction in predictions):
        releases = [prediction.release for prediction in predictions if prediction.drag == drag]
        felt = [release for release in releases if release.status is Status.RELEASES]
        parts = []
        if felt:
            forces, energies = [one.pull_force for one in felt], [one.vibration_energy * 1e6 for one in felt]
            parts.append(f"{min(forces):.3g} to {max(forces):.3g} N, {min(energies):.3g} to {max(energies):.3g} uJ")
        for status, words in _WORDS.items():
            if count := sum(release.status is status for release in releases):
                parts.append(f"{words} in {count} of {len(releases)}")
        yield f"{drag}: " + "; ".join(parts)


def _figure(stimuli: StimulusSet) -> str | None:
    """Draw step blocks on the curves of equations (1) and (2) at the first tip and largest load, as JSON for plotly."""
    blocks = sorted(stimuli.of(StepBlock), key=lambda one: one.height.nominal)
    if not blocks:
        return None
    grid = stimuli.prediction
    radius, load, tool = grid.tip_radii[0], max(grid.normal_loads), grid.tool
    marks = np.array([block.height.nominal for block in blocks])
    names = [block.id for block in blocks]
    top = min(1.25 * marks[-1], radius)
    curve = np.linspace(0.002 * top, top, 300)

    def angle(heights: NDArray[np.float64]) -> Any:
        return np.degrees(kernels.angle_on_step(heights, radius))

    def energy(heights: NDArray[np.float64], friction: float) -> Any:
        force = kernels.pull_force(load, kernels.angle_on_step(heights, radius), friction)
        return 1e6 * tool.conversion * kernels.stored_energy(force, tool.stiffness)

    inside = marks[marks < radius]
    traces = [
        _line(curve * 1e6, angle(curve), "critical angle", _INK, "y"),
        _dots(inside * 1e6, angle(inside), names, _INK, "y"),
    ]
    shapes = []
    for index, friction in enumerate(grid.frictions):
        colour, locking = _COLOURS[index % len(_COLOURS)], float(kernels.locking_height(radius, friction))
        below, felt = curve[curve < 0.9995 * locking], marks[marks < locking]
        traces.append(_line(below * 1e6, energy(below, friction), f"E<sub>v</sub>, mu {friction:g}", colour, "y2"))
        traces.append(_dots(felt * 1e6, energy(felt, friction), names, colour, "y2"))
        if locking < 1.02 * top:
            ends = {"x0": locking * 1e6, "x1": locking * 1e6, "yref": "paper", "y0": 0, "y1": 1}
            shapes.append({"type": "line", **ends, "line": {"color": colour, "dash": "dot", "width": 1.5}})
    title = f"Tip {radius * 1e6:g} um, load {load:g} N; dotted: locking height"
    layout = {
        "height": 400,
        "margin": {"l": 70, "r": 20, "t": 40, "b": 80},
        "title": {"text": title, "font": {"size": 14}, "x": 0.01, "xanchor": "left"},
        "xaxis": _axis("step height, um", domain=[0.0, 0.44], range=[0, top * 1e6]),
        "yaxis": _axis("critical angle, deg"),
        "xaxis2": _axis("step height, um", domain=[0.56, 1.0], range=[0, top * 1e6], anchor="y2"),
        "yaxis2": _axis("vibration energy, uJ", type="log", anchor="x2", exponentformat="none"),
        "shapes": [shape | {"xref": axis} for shape in shapes for axis in ("x", "x2")],
        "legend": {"orientation": "h", "y": -0.22, "x": 0.56},
        "hovermode": "closest",
        "template": "none",
    }
    return json.dumps({"data": traces, "layout": layout}, allow_nan=False)


def _axis(title: str, **more: Any) -> dict[str, Any]:
    return {"title": {"text": title}, **more}


def _line(x: Any, y: Any, name: str, colour: str, axis: str) -> dict[str, Any]:
    return {
        **{"type": "scatter", "mode": "lines", "x": _short(x), "y": _short(y), "name": name},
        **{"line": {"color": colour, "width": 2}, "yaxis": axis, "xaxis": axis.replace("y", "x")},
        "showlegend": axis == "y2",
    }


def _dots(x: Any, y: Any, names: Sequence[str], colour: str, axis: str) -> dict[str, Any]:
    """Mark blocks, in the order of their heights; those of the names that have a value."""
    return _line(x, y, "", colour, axis) | {
        "mode": "markers",
        "text": list(names[: len(x)]),
        "hovertemplate": "%{text}: %{y:.4g}<extra></extra>",
        "marker": {"color": colour, "size": 8},
        "showlegend": False,
    }


def _short(values: Any) -> list[float]:
    return [float(f"{value:.6g}") for value in values if math.isfinite(value)]
