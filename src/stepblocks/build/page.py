"""The page of an output folder: pictures, dimensions, predictions, verdicts, 3-D view."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from stepblocks.atomic import replace_text
from stepblocks.build.manifest import RECORD, find_linked_files
from stepblocks.contact import Array, kernels
from stepblocks.contact.energy import Status
from stepblocks.page_file import render_page
from stepblocks.parts.set import StimulusSet
from stepblocks.predict.predictions import Prediction, tabulate_prediction
from stepblocks.quantities import format_span
from stepblocks.text_file import Document

# colours of the view
_MATERIALS = {"brass": "#d8b44e", "pmma": "#bfe3ee", "zirconia": "#f1ead8", "stainless": "#bcc6ce"}
# columns of predictions.csv that the page shows
_SHOWN = (
    *(
        "drag",
        "tip_radius_um",
        "step_height_um",
        "normal_load_n",
        "friction",
        "critical_angle_deg",
        "status",
    ),
    *(
        "pull_force_n",
        "vibration_energy_uj",
        "vibration_energy_95_low_uj",
        "vibration_energy_95_high_uj",
    ),
    *("vibration_energy_low_uj", "vibration_energy_high_uj", "mean_power_uw", "threshold_ratio"),
    *("frequency_hz", "drag_vibration_energy_uj", "felt_by"),
)
_LINKED = {
    ".step",
    ".stl",
    ".obj",
    ".ply",
    ".3mf",
    ".glb",
    ".tiff",
    ".npz",
    ".json",
}  # files that the page links
_INK, _COLOURS = "#71828f", ("#1f6f8b", "#c8553d", "#588157", "#7b4fa3", "#b08900")
_WORDS = {Status.LOCKED: "locked", Status.TOO_HIGH: "too high", Status.NO_CATCH: "no catch"} | {
    status: f"beyond the {status.removeprefix('beyond-')}, no energy,"
    for status in Status
    if status.is_beyond_limit
}


@dataclass(frozen=True)
class Section:
    """A set with what is predicted of it and what was made of it."""

    stimuli: StimulusSet
    predictions: Sequence[Prediction]
    records: Mapping[str, Document]  # by stimulus, of those that were made
    files: Sequence[str] = ()  # of the whole set


def write_page(sections: Sequence[Section], output: Path) -> list[Path]:
    """Write ``index.html`` with the script of plotly beside it, for use without a network."""
    from plotly.offline import get_plotlyjs

    script, page, source = (
        output / "assets" / "plotly.min.js",
        output / "index.html",
        get_plotlyjs(),
    )
    script.parent.mkdir(exist_ok=True)
    if not script.is_file() or script.read_text(encoding="utf-8") != source:
        replace_text(script, source)
    links = find_linked_files(
        output, [f"{one.stimuli.name}/{name}/{RECORD}" for one in sections for name in one.records]
    )
    # the steps of the paper come first, else the user's own order
    sets = [
        _describe_section(section, links)
        for section in sorted(sections, key=lambda one: one.stimuli.name != "paper-ten")
    ]
    rows = [row for section in sets for row in section["rows"]]
    values = {
        "total": len(rows),
        "failed": sum(bool(row["failed"]) for row in rows),
        "checks": sum(len(row["verdicts"]) for row in rows),
        "kinds": sorted({row["kind"] for row in rows}),
        "links": links[""],
        "shown": _SHOWN,
    }
    replace_text(
        page, render_page("stepblocks.build", "index.html", sections=sets, rows=rows, **values)
    )
    return [script, page]


def _describe_section(section: Section, links: Mapping[str, Sequence[Sequence[str]]]) -> Document:
    stimuli = section.stimuli
    materials = {part.id: part.material for part in stimuli.stimuli}
    rows = []
    for identity, record in section.records.items():
        predictions = [one for one in section.predictions if one.stimulus == identity]
        folder = f"{stimuli.name}/{identity}"
        material = materials.get(identity)
        row = {
            "id": identity,
            "set": stimuli.name,
            "folder": folder,
            "links": links.get(folder, []),
            "files": [name for name in record["outputs"] if Path(name).suffix in _LINKED],
            "failed": [verdict for verdict in record["verdicts"] if not verdict["passed"]],
            "predictions": list(map(tabulate_prediction, predictions)),
            "summary": list(_summarise(predictions)),
            "material": material.designation if material else "",
            "colour": _MATERIALS.get(material.name if material else "", "#b9c4ce"),
        }
        same = {name: record[name] for name in ("kind", "dimensions", "derived", "verdicts")}
        rows.append(row | same)
    return {
        **{"name": stimuli.name, "title": stimuli.title, "source": stimuli.source, "rows": rows},
        **{"figure": _draw_figure(stimuli), "files": section.files},
    }


def _summarise(predictions: Sequence[Prediction]) -> Iterator[str]:
    # Range of what is felt in each direction, and what locks
    for drag in dict.fromkeys(prediction.drag for prediction in predictions):
        releases = [prediction.release for prediction in predictions if prediction.drag == drag]
        felt = [one for one in releases if one.status is Status.RELEASES]
        figures = {
            "force": [one.pull_force for one in felt],
            "energy": [one.vibration_energy for one in felt],
        }
        spans = (
            format_span(min(values), max(values), name)
            for name, values in figures.items()
            if values
        )
        parts = [", ".join(spans)]
        for status, words in _WORDS.items():
            if count := sum(release.status is status for release in releases):
                parts.append(f"{words} in {count} of {len(releases)}")
        yield f"{drag}: " + "; ".join(filter(None, parts))


def _draw_figure(stimuli: StimulusSet) -> str | None:
    # Draw step blocks on the curves of equations (1) and (2), as JSON for plotly. The curves hold
    # for the first tip and the largest load.
    blocks = sorted(stimuli.step_block, key=lambda one: one.height.nominal)
    if not blocks:
        return None
    grid = stimuli.prediction
    radius, load, tool = grid.tip_radii[0], max(grid.normal_loads), grid.as_tool()
    limit, most = tool.limits.first
    marks = np.array([block.height.nominal for block in blocks])
    names = [block.id for block in blocks]
    top = min(1.25 * marks[-1], radius)
    curve = np.linspace(0.002 * top, top, 300)

    traces: list[Document] = []
    shapes = []

    def draw(y: Callable[[Array], Array], least: float, name: str, colour: str, axis: str) -> None:
        """Draw a curve up to a height, and mark the blocks on it."""
        for heights, kind in ((curve, "lines"), (marks, "markers")):
            x = heights[heights <= least]
            trace: dict[str, object] = {
                "type": "scatter",
                "mode": kind,
                "x": _shorten(x * 1e6),
                "y": _shorten(y(x)),
                "name": "",
            }
            trace |= {"yaxis": axis, "xaxis": axis.replace("y", "x"), "showlegend": False}
            if kind == "lines":
                trace |= {
                    "name": name,
                    "line": {"color": colour, "width": 2},
                    "showlegend": axis == "y2",
                }
            else:
                trace |= {"text": names[: len(x)], "marker": {"color": colour, "size": 8}}
                trace["hovertemplate"] = "%{text}: %{y:.4g}<extra></extra>"
            traces.append(trace)

    def energy(heights: Array, friction: float) -> Array:
        force = kernels.compute_pull_force(
            load, kernels.compute_angle_on_step(heights, radius), friction
        )
        energies: Array = kernels.compute_stored_energy(force, tool.stiffness)
        return 1e6 * tool.conversion * energies

    draw(
        lambda heights: np.degrees(kernels.compute_angle_on_step(heights, radius)),
        radius,
        "critical angle",
        _INK,
        "y",
    )
    for index, friction in enumerate(grid.frictions):
        colour, locking = (
            _COLOURS[index % len(_COLOURS)],
            float(kernels.compute_locking_height(radius, friction)),
        )
        # where the pull reaches the limit: F = N tan(a + atan mu); beyond it there is no energy
        least = float(
            kernels.compute_height_at_angle(math.atan2(most, load) - math.atan(friction), radius)
        )
        draw(
            partial(energy, friction=friction),
            least,
            f"E<sub>v</sub>, µ {friction:g}",
            colour,
            "y2",
        )
        if locking < 1.02 * top:
            ends = {"x0": locking * 1e6, "x1": locking * 1e6, "yref": "paper", "y0": 0, "y1": 1}
            shapes.append(
                {"type": "line", **ends, "line": {"color": colour, "dash": "dot", "width": 1.5}}
            )
    marked = [
        y
        for trace in traces
        if trace["yaxis"] == "y2" and trace["mode"] == "markers"
        for y in trace["y"]
    ]
    felt_range = [math.log10(0.3 * min(marked)), math.log10(3.0 * max(marked))] if marked else None
    decades = [10.0**power for power in range(-3, 5)]
    ticks = {
        "tickvals": decades,
        "ticktext": [format_span(1e-6 * one, 1e-6 * one, "energy") for one in decades],
    }
    title = (
        f"Tip {radius * 1e6:g} µm, load {load:g} N; dotted: above it the tip locks; no energy "
        f"beyond {most:g} N ({limit})"
    )
    height, across = {"text": "step height, µm"}, [0, top * 1e6]
    layout = {
        "height": 400,
        "margin": {"l": 70, "r": 20, "t": 40, "b": 80},
        "title": {"text": title, "font": {"size": 14}, "x": 0.01, "xanchor": "left"},
        "xaxis": {"title": height, "domain": [0.0, 0.44], "range": across},
        "yaxis": {"title": {"text": "critical angle, °"}},
        "xaxis2": {"title": height, "domain": [0.56, 1.0], "range": across, "anchor": "y2"},
        "yaxis2": {
            "title": {"text": "vibration energy", "standoff": 8},
            "type": "log",
            "anchor": "x2",
            "range": felt_range,
            **ticks,
        },
        "shapes": [shape | {"xref": axis} for shape in shapes for axis in ("x", "x2")],
        "legend": {"orientation": "h", "y": -0.22, "x": 0.56},
        "hovermode": "closest",
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "template": "none",
    }
    return json.dumps({"data": traces, "layout": layout}, allow_nan=False)


def _shorten(values: Iterable[float]) -> list[float]:
    return [float(f"{value:.6g}") for value in values if math.isfinite(value)]
