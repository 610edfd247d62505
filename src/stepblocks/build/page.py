"""The page of an output folder: pictures, dimensions, predictions, verdicts and the interactive view."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.atomic import replace_text
from stepblocks.build.curves import set_figure
from stepblocks.contact.energy import Status
from stepblocks.parts.set import StimulusSet
from stepblocks.predict.predictions import Prediction, as_row
from stepblocks.predict.sheaths import conditions_of, decay_test_rows, ring_rows

_LINKED = {".step", ".stl", ".obj", ".ply", ".3mf", ".glb", ".tiff", ".npz", ".json"}  # files that the page links
_WORDS = {Status.LOCKED: "locked", Status.TOO_HIGH: "too high", Status.NO_CATCH: "no catch"}


@dataclass(frozen=True)
class Section:
    """A set with what is predicted of it and what was made of it."""

    stimuli: StimulusSet
    predictions: Sequence[Prediction]
    records: Mapping[str, Mapping[str, Any]]  # by stimulus, of those that were made


def write_page(sections: Sequence[Section], output: Path) -> list[Path]:
    """Write ``index.html`` and the script of plotly beside it, so that the page works without a network."""
    import jinja2
    from plotly.offline import get_plotlyjs

    script, page = output / "assets" / "plotly.min.js", output / "index.html"
    script.parent.mkdir(exist_ok=True)
    source = str(get_plotlyjs())
    if not script.is_file() or script.read_text(encoding="utf-8") != source:
        replace_text(script, source)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("stepblocks.build", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    shown = [_section(section) for section in sections]
    rows = [row for section in shown for row in section["rows"]]
    failed = sum(bool(row["failed"]) for row in rows)
    replace_text(page, environment.get_template("index.html").render(sections=shown, total=len(rows), failed=failed))
    return [script, page]


def _section(section: Section) -> dict[str, Any]:
    stimuli, rings = section.stimuli, _ring_lines(section.stimuli)
    rows = []
    for identity, record in section.records.items():
        predictions = [one for one in section.predictions if one.stimulus == identity]
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
    return head | {"rows": rows, "figure": set_figure(stimuli), "tables": tables}


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
        "folder": folder,
        "id": record["stimulus"],
        "kind": record["kind"],
        "dimensions": record["dimensions"],
        "derived": record["derived"],
        "verdicts": record["verdicts"],
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
