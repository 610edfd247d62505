"""The page of an output folder: pictures, dimensions, predictions, verdicts, 3-D view."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepblocks.build.curves import compute_curves
from stepblocks.build.linked import WHOLE_FOLDER, find_linked_files
from stepblocks.build.manifest import RECORD, Link, NamedText, RecordedVerdict, StimulusRecord
from stepblocks.contact.energy import Status
from stepblocks.declaration.set import StimulusSet
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.parts.kind import Part
from stepblocks.predict.columns import make_prediction_row
from stepblocks.predict.predictions import Prediction
from stepblocks.quantities import format_span

# Colours of the view
_COLOUR_BY_MATERIAL = {
    "brass": "#d8b44e",
    "pmma": "#bfe3ee",
    "zirconia": "#f1ead8",
    "stainless": "#bcc6ce",
}
_COLOUR = "#b9c4ce"
# Columns of predictions.csv that the page shows
_SHOWN_COLUMNS = (
    "drag",
    "tip_radius_um",
    "height_um",
    "normal_load_n",
    "friction",
    "critical_angle_deg",
    "status",
    "peak_force_n",
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
# Endings of the files that the page links
_LINKED_ENDINGS = {".step", ".stl", ".obj", ".ply", ".3mf", ".glb", ".tiff", ".npz", ".json"}
_FIRST_SET = "paper-ten"  # the steps of the paper come first, then the user's own order
_STATUS_WORDS = {
    Status.LOCKED: "locked",
    Status.TOO_HIGH: "too high",
    Status.NO_CATCH: "no catch",
}


@dataclass(frozen=True)
class Section:
    """A set with what is predicted of it and what was made of it.

    Attributes
    ----------
    stimuli : StimulusSet
        The set.
    predictions : sequence of Prediction
        Of all its stimuli.
    records : mapping of str to StimulusRecord
        By id, of those that were made.
    files : sequence of str
        Names of the files of the whole set.
    """

    stimuli: StimulusSet
    predictions: Sequence[Prediction]
    records: Mapping[str, StimulusRecord]
    files: Sequence[str] = ()


@dataclass(frozen=True)
class _Row:
    """What the page shows of one stimulus."""

    id: str
    set: str
    folder: str
    links: Sequence[Link]
    files: Sequence[str]
    predictions: Sequence[Mapping[str, object]]
    summary: Sequence[str]
    material: str
    colour: str
    kind: str
    dimensions: Sequence[NamedText]
    derived: Sequence[NamedText]
    verdicts: Sequence[RecordedVerdict]

    @property
    def failed_checks(self) -> list[RecordedVerdict]:
        """The checks that failed."""
        return [verdict for verdict in self.verdicts if not verdict.passed]


@dataclass(frozen=True)
class _ShownSection:
    """What the page shows of one set; its figure is JSON, None for a set without step blocks."""

    name: str
    title: str
    source: str
    rows: Sequence[_Row]
    figure: str | None
    files: Sequence[str]


def write_page(sections: Sequence[Section], output: Path) -> list[Path]:
    """Write ``index.html`` with the script of plotly beside it, for use without a network.

    Parameters
    ----------
    sections : sequence of Section
        The sets, in the user's order.
    output : Path
        The output folder.

    Returns
    -------
    list of Path
        The script and the page.
    """
    script = _write_plot_script(output)
    links = find_linked_files(output, _yield_built_files(sections))
    ordered = sorted(sections, key=lambda section: section.stimuli.name != _FIRST_SET)
    shown = [_collect_section(section, links) for section in ordered]
    rows = [row for section in shown for row in section.rows]
    text = render_page(
        "stepblocks.build",
        "index.html",
        sections=shown,
        rows=rows,
        total=len(rows),
        failed=sum(bool(row.failed_checks) for row in rows),
        checks=sum(len(row.verdicts) for row in rows),
        kinds=sorted({row.kind for row in rows}),
        links=links[WHOLE_FOLDER],
        shown=_SHOWN_COLUMNS,
    )
    page = output / "index.html"
    replace_text(page, text)
    return [script, page]


def _write_plot_script(output: Path) -> Path:
    """Write the script of plotly, where it is not there already."""
    from plotly.offline import get_plotlyjs

    script = output / "assets" / "plotly.min.js"
    source = get_plotlyjs()
    script.parent.mkdir(exist_ok=True)
    if not script.is_file() or script.read_text(encoding="utf-8") != source:
        replace_text(script, source)
    return script


def _yield_built_files(sections: Sequence[Section]) -> Iterator[str]:
    """Yield the names of all files of all stimuli below the output folder."""
    for section in sections:
        for identity, record in section.records.items():
            folder = f"{section.stimuli.name}/{identity}"
            yield f"{folder}/{RECORD}"
            for name in record.outputs:
                yield f"{folder}/{name}"


def _collect_section(section: Section, links: Mapping[str, Sequence[Link]]) -> _ShownSection:
    """Collect what the page shows of a set; `links` stand by ``set/id``."""
    stimuli = section.stimuli
    parts = {part.id: part for part in stimuli.stimuli}
    rows = []
    for identity, record in section.records.items():
        predictions = [
            prediction for prediction in section.predictions if prediction.stimulus == identity
        ]
        linked = links.get(f"{stimuli.name}/{identity}", [])
        rows.append(_collect_row(stimuli.name, parts[identity], record, predictions, linked))
    curves = compute_curves(stimuli)
    return _ShownSection(
        name=stimuli.name,
        title=stimuli.title,
        source=stimuli.source,
        rows=rows,
        figure=None if curves is None else curves.to_json(),
        files=section.files,
    )


def _collect_row(
    set_name: str,
    part: Part,
    record: StimulusRecord,
    predictions: Sequence[Prediction],
    links: Sequence[Link],
) -> _Row:
    """Collect what the page shows of one stimulus."""
    material = part.material
    return _Row(
        id=part.id,
        set=set_name,
        folder=f"{set_name}/{part.id}",
        links=links,
        files=[name for name in record.outputs if Path(name).suffix in _LINKED_ENDINGS],
        predictions=[make_prediction_row(prediction) for prediction in predictions],
        summary=list(yield_felt_range_lines(predictions)),
        material=material.designation,
        colour=_COLOUR_BY_MATERIAL.get(material.name, _COLOUR),
        kind=record.kind,
        dimensions=record.dimensions,
        derived=record.derived,
        verdicts=record.verdicts,
    )


def yield_felt_range_lines(predictions: Sequence[Prediction]) -> Iterator[str]:
    """Describe for each direction the ranges of pull and energy, and the cases without vibration.

    A line reads ``up: 0.5 to 2 N, 1 to 30 µJ; locked in 2 of 4``.
    """
    for drag in dict.fromkeys(prediction.drag_direction for prediction in predictions):
        releases = [
            prediction.release for prediction in predictions if prediction.drag_direction == drag
        ]
        released = [release for release in releases if release.status is Status.RELEASES]
        clauses = []
        if released:
            forces = [release.pull_force for release in released]
            energies = [release.vibration_energy for release in released]
            force = format_span(min(forces), max(forces), "force")
            energy = format_span(min(energies), max(energies), "energy")
            clauses.append(f"{force}, {energy}")
        clauses += _yield_unfelt_clauses([release.status for release in releases])
        yield f"{drag}: {'; '.join(clauses)}"


def _yield_unfelt_clauses(statuses: Sequence[Status]) -> Iterator[str]:
    """Say how often each status occurs that gives no vibration."""
    for status in (*_STATUS_WORDS, *(status for status in Status if status.is_beyond_limit)):
        count = statuses.count(status)
        if count:
            yield f"{_format_no_vibration_status(status)} in {count} of {len(statuses)}"


def _format_no_vibration_status(status: Status) -> str:
    """Return the words for a status that gives no vibration."""
    if status in _STATUS_WORDS:
        return _STATUS_WORDS[status]
    return f"beyond the {status.removeprefix('beyond-')}, no energy,"
