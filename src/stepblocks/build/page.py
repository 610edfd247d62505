"""The page of an output folder: pictures, dimensions, predictions, verdicts and the interactive view."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from stepblocks.atomic import replace_text
from stepblocks.build.curves import set_figure
from stepblocks.build.manifest import RECORD, load_json
from stepblocks.build.page_file import plotly_script, render_page
from stepblocks.contact.energy import Status
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.set import StimulusSet
from stepblocks.predict.predictions import Prediction, Predictions, as_row, tool_of
from stepblocks.predict.sheaths import conditions_of, decay_test_rows, ring_rows


def write_page(sets: Sequence[StimulusSet], predicted: Mapping[str, Predictions], output: Path) -> list[Path]:
    """Write ``index.html`` and what it loads."""
    assets = output / "assets"
    assets.mkdir(exist_ok=True)
    script = assets / "plotly.min.js"
    source = plotly_script()
    if not script.is_file() or script.read_text(encoding="utf-8") != source:
        replace_text(script, source)
    page = output / "index.html"
    replace_text(page, render_page([_section(stimuli, predicted[stimuli.name], output) for stimuli in sets]))
    return [script, page]


def _section(stimuli: StimulusSet, predicted: Predictions, output: Path) -> dict[str, Any]:
    rows = []
    rings = _ring_lines(stimuli)
    for stimulus in stimuli.stimuli:
        folder = f"{stimuli.name}/{stimulus.id}"
        record = load_json(output / folder / RECORD)
        if record:
            rows.append(_row(folder, record, predicted.by_stimulus(stimulus.id)))
            rows[-1]["summary"] += rings.get(stimulus.id, [])
    blocks = stimuli.of(StepBlock)
    grid = stimuli.prediction
    figure = (
        set_figure(
            [block.height.nominal for block in blocks],
            [block.id for block in blocks],
            grid.tip_radii[0],
            grid.frictions,
            max(grid.normal_loads),
            tool_of(grid),
        )
        if blocks
        else None
    )
    tables = [
        {"title": title, "file": f"{stimuli.name}/{name}", "rows": found}
        for title, name, found in (
            ("How the probe rings", "rings.csv", ring_rows(stimuli)),
            ("What the damping test will measure", "damping-test.csv", decay_test_rows(stimuli)),
        )
        if found
    ]
    head = {"name": stimuli.name, "title": stimuli.title, "source": stimuli.source}
    return head | {"rows": rows, "figure": figure, "tables": tables}


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


def _row(folder: str, record: dict[str, Any], predictions: Sequence[Prediction]) -> dict[str, Any]:
    verdicts = record["verdicts"]
    failed = [verdict for verdict in verdicts if not verdict["passed"]]
    shown = {".step", ".stl", ".obj", ".ply", ".3mf", ".glb", ".tiff", ".npz", ".json"}
    return {
        "folder": folder,
        "id": record["stimulus"],
        "kind": record["kind"],
        "dimensions": record["dimensions"],
        "derived": record["derived"],
        "verdicts": verdicts,
        "failed": failed,
        "files": [name for name in record["outputs"] if Path(name).suffix in shown],
        "predictions": [as_row(prediction) for prediction in predictions],
        "summary": list(_summary(predictions)),
    }


def _summary(predictions: Sequence[Prediction]) -> Iterator[str]:
    """Range of what is felt in each direction, and what locks."""
    for drag in dict.fromkeys(prediction.drag for prediction in predictions):
        chosen = [prediction for prediction in predictions if prediction.drag == drag]
        felt = [p.release for p in chosen if p.release.status is Status.RELEASES]
        text = f"{drag}: "
        if felt:
            forces, energies = [r.pull_force for r in felt], [r.vibration_energy * 1e6 for r in felt]
            text += f"{min(forces):.3g} to {max(forces):.3g} N, {min(energies):.3g} to {max(energies):.3g} uJ"
        for status, words in ((Status.LOCKED, "locked"), (Status.TOO_HIGH, "too high"), (Status.NO_CATCH, "no catch")):
            count = sum(prediction.release.status is status for prediction in chosen)
            if count:
                text += f"{'; ' if not text.endswith(': ') else ''}{words} in {count} of {len(chosen)}"
        yield text
