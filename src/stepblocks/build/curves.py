"""Critical angle and vibration energy against step height, with the limit beyond which the probe locks."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from stepblocks.contact import kernels
from stepblocks.contact.operating_point import Tool

_COLOURS = ("#1f6f8b", "#c8553d", "#588157", "#7b4fa3", "#b08900")


def set_figure(
    heights: Sequence[float],
    names: Sequence[str],
    ball_radius: float,
    frictions: Sequence[float],
    load: float,
    tool: Tool,
) -> str:
    """Draw the curves of a set."""
    top = min(1.25 * max(heights), ball_radius)
    curve = np.linspace(0.002 * top, top, 300)
    traces: list[dict[str, Any]] = [
        _line(curve * 1e6, np.degrees(kernels.angle_on_step(curve, ball_radius)), "critical angle", "#1d2a36", "y")
    ]
    marks = np.array(sorted(heights))
    order = np.argsort(heights)
    inside = marks < ball_radius
    angles = np.degrees(kernels.angle_on_step(marks[inside], ball_radius))
    traces.append(_dots(marks[inside] * 1e6, angles, [names[i] for i in order[inside]], "#1d2a36", "y"))
    shapes = []
    for friction, colour in zip(frictions, _COLOURS * (1 + len(frictions) // len(_COLOURS)), strict=False):
        locking = float(kernels.locking_height(ball_radius, friction))
        below = curve[curve < 0.9995 * locking]
        energy = _energy(below, ball_radius, friction, load, tool)
        traces.append(_line(below * 1e6, energy, f"E<sub>v</sub>, mu {friction:g}", colour, "y2"))
        felt = marks[marks < locking]
        labels = [names[i] for i in order[marks < locking]]
        traces.append(_dots(felt * 1e6, _energy(felt, ball_radius, friction, load, tool), labels, colour, "y2"))
        if locking < 1.02 * top:
            line = {"color": colour, "dash": "dot", "width": 1.5}
            shapes.append(
                {
                    "type": "line",
                    "x0": locking * 1e6,
                    "x1": locking * 1e6,
                    "yref": "paper",
                    "y0": 0,
                    "y1": 1,
                    "line": line,
                }
            )
    layout = {
        "height": 400,
        "margin": {"l": 70, "r": 20, "t": 40, "b": 80},
        "title": {
            "text": f"Tip {ball_radius * 1e6:g} um, load {load:g} N; dotted: locking height",
            "font": {"size": 14},
            "x": 0.01,
            "xanchor": "left",
        },
        "xaxis": {"title": {"text": "step height, um"}, "domain": [0.0, 0.44], "range": [0, top * 1e6]},
        "yaxis": {"title": {"text": "critical angle, deg"}},
        "xaxis2": {
            "title": {"text": "step height, um"},
            "domain": [0.56, 1.0],
            "range": [0, top * 1e6],
            "anchor": "y2",
        },
        "yaxis2": {"title": {"text": "vibration energy, uJ"}, "type": "log", "anchor": "x2", "exponentformat": "none"},
        "shapes": [shape | {"xref": axis} for shape in shapes for axis in ("x", "x2")],
        "legend": {"orientation": "h", "y": -0.22, "x": 0.56},
        "hovermode": "closest",
        "template": "none",
    }
    return json.dumps({"data": traces, "layout": layout}, allow_nan=False)


def _energy(heights: np.ndarray[Any, Any], radius: float, friction: float, load: float, tool: Tool) -> Any:
    force = kernels.pull_force(load, kernels.angle_on_step(heights, radius), friction)
    return 1e6 * tool.conversion * kernels.stored_energy(force, tool.stiffness)


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
    return _line(x, y, "", colour, axis) | {
        "mode": "markers",
        "text": list(names),
        "hovertemplate": "%{text}: %{y:.4g}<extra></extra>",
        "marker": {"color": colour, "size": 8},
        "showlegend": False,
    }


def _short(values: Any) -> list[float]:
    return [float(f"{value:.6g}") for value in values if math.isfinite(value)]
