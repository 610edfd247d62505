"""The page of an output folder: pictures, dimensions, predictions, verdicts, 3-D view."""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from stepblocks.build.manifest import RECORD, find_linked_files, list_outputs
from stepblocks.contact import Array, kernels
from stepblocks.contact.energy import Status
from stepblocks.declaration.set import StimulusSet
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.files.text import Document
from stepblocks.predict.columns import tabulate_prediction
from stepblocks.predict.predictions import Prediction
from stepblocks.quantities import format_span

# colours of the view
_MATERIALS = {"brass": "#d8b44e", "pmma": "#bfe3ee", "zirconia": "#f1ead8", "stainless": "#bcc6ce"}
# columns of predictions.csv that the page shows
_SHOWN = (
    "drag",
    "tip_radius_um",
    "step_height_um",
    "normal_load_n",
    "friction",
    "critical_angle_deg",
    "status",
    "pull_force_n",
    "vibration_energy_uj",
    "vibration_energy_95_low_uj",
    "vibration_energy_95_high_uj",
    "vibration_energy_low_uj",
    "vibration_energy_high_uj",
    "mean_power_uw",
    "threshold_ratio",
    "frequency_hz",
    "drag_vibration_energy_uj",
    "felt_by",
)
# files that the page links
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
}
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

    script = output / "assets" / "plotly.min.js"
    page = output / "index.html"
    source = get_plotlyjs()
    script.parent.mkdir(exist_ok=True)
    if not script.is_file() or script.read_text(encoding="utf-8") != source:
        replace_text(script, source)
    links = find_linked_files(
        output,
        [
            f"{one.stimuli.name}/{name}/{file}"
            for one in sections
            for name, record in one.records.items()
            for file in (RECORD, *list_outputs(record))
        ],
    )
    # the steps of the paper come first, else the user's own order
    sets = [
        _describe_section(section, links)
        for section in sorted(sections, key=lambda one: one.stimuli.name != "paper-ten")
    ]
    rows = [row for section in sets for row in section["rows"]]
    replace_text(
        page,
        render_page(
            "stepblocks.build",
            "index.html",
            sections=sets,
            rows=rows,
            total=len(rows),
            failed=sum(bool(row["failed"]) for row in rows),
            checks=sum(len(row["verdicts"]) for row in rows),
            kinds=sorted({row["kind"] for row in rows}),
            links=links[""],
            shown=_SHOWN,
        ),
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
        rows.append(
            {
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
                **{name: record[name] for name in ("kind", "dimensions", "derived", "verdicts")},
            }
        )
    return {
        "name": stimuli.name,
        "title": stimuli.title,
        "source": stimuli.source,
        "rows": rows,
        "figure": _compute_curves(stimuli),
        "files": section.files,
    }


def _summarise(predictions: Sequence[Prediction]) -> Iterator[str]:
    # Range of what is felt in each direction, and what locks
    for drag in dict.fromkeys(prediction.drag for prediction in predictions):
        releases = [prediction.release for prediction in predictions if prediction.drag == drag]
        released = [one for one in releases if one.status is Status.RELEASES]
        figures = {
            "force": [one.pull_force for one in released],
            "energy": [one.vibration_energy for one in released],
        }
        spans = (
            format_span(min(values), max(values), name)
            for name, values in figures.items()
            if values
        )
        counts = {
            words: sum(release.status is status for release in releases)
            for status, words in _WORDS.items()
        }
        others = [
            f"{words} in {count} of {len(releases)}" for words, count in counts.items() if count
        ]
        yield f"{drag}: " + "; ".join(filter(None, [", ".join(spans), *others]))


def _compute_curves(stimuli: StimulusSet) -> str | None:
    # Compute the curves of equations (1) and (2) and the step blocks on them, as JSON; the page
    # draws them. The curves hold for the first tip and the largest load.
    blocks = sorted(stimuli.step_block, key=lambda one: one.height.nominal)
    if not blocks:
        return None
    grid = stimuli.prediction
    radius = grid.tip_radii[0]
    load = max(grid.normal_loads)
    tool = grid.as_tool()
    limit, most = tool.limits.first
    marks = np.array([block.height.nominal for block in blocks])
    top = min(1.25 * marks[-1], radius)
    curves = []

    def add(name: str, least: float, y: Callable[[Array], Array]) -> None:
        # a curve up to a height, and the blocks on it
        grids = {"curve": np.linspace(0.002 * top, top, 300), "marks": marks}
        shown = {key: heights[heights <= least] for key, heights in grids.items()}
        curves.append(
            {"name": name}
            | {
                key: [_round_to_six_digits(x * 1e6), _round_to_six_digits(y(x))]
                for key, x in shown.items()
            }
        )

    def energy(heights: Array, friction: float) -> Array:
        force = kernels.compute_pull_force(
            load, kernels.compute_angle_on_step(heights, radius), friction
        )
        energies: Array = kernels.compute_stored_energy(force, tool.stiffness)
        return 1e6 * tool.conversion * energies

    add("critical angle", radius, lambda x: np.degrees(kernels.compute_angle_on_step(x, radius)))
    frictions = [grid.first_point(friction=one).friction for one in grid.coefficients]
    for friction in frictions:
        # where the pull reaches the limit: F = N tan(a + atan mu); beyond it there is no energy
        least = float(
            kernels.compute_height_at_angle(math.atan2(most, load) - math.atan(friction), radius)
        )
        add(f"E<sub>v</sub>, µ {friction:g}", least, partial(energy, friction=friction))
    locking = [float(kernels.compute_locking_height(radius, mu)) for mu in frictions]
    return json.dumps(
        {
            "title": f"Tip {radius * 1e6:g} µm, load {load:g} N; dotted: above it the tip locks; "
            f"no energy beyond {most:g} N ({limit})",
            "names": [block.id for block in blocks],
            "curves": curves,
            "locking": [height * 1e6 if height < 1.02 * top else None for height in locking],
            "highest": top * 1e6,
        },
        allow_nan=False,
    )


def _round_to_six_digits(values: Iterable[float]) -> list[float]:
    return [float(f"{value:.6g}") for value in values if math.isfinite(value)]
