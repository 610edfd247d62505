"""Critical angle and vibration energy against step height, with the limit beyond which the probe locks."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import kernels
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.set import StimulusSet

_INK, _COLOURS = "#1d2a36", ("#1f6f8b", "#c8553d", "#588157", "#7b4fa3", "#b08900")


def set_figure(stimuli: StimulusSet) -> str | None:
    """Draw the step blocks of a set on the curves of equations (1) and (2), as JSON for plotly; None without blocks.

    Of the set's grid, the curves take the first tip and the largest load, each coefficient of friction in its colour.
    """
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
    layout = {
        "height": 400,
        "margin": {"l": 70, "r": 20, "t": 40, "b": 80},
        "title": {
            "text": f"Tip {radius * 1e6:g} um, load {load:g} N; dotted: locking height",
            "font": {"size": 14},
            "x": 0.01,
            "xanchor": "left",
        },
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
        "type": "scatter",
        "mode": "lines",
        "x": _short(x),
        "y": _short(y),
        "name": name,
        "line": {"color": colour, "width": 2},
        "yaxis": axis,
        "xaxis": axis.replace("y", "x"),
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
