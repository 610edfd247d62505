"""The files of an inspection: page, plot, record, as-built record, sheet, QIF and certificate."""

from dataclasses import dataclass
from pathlib import Path

from stepblocks.files.atomic import replace_text
from stepblocks.files.figures import make_figure_and_axes, save_figure
from stepblocks.files.pages import render_page
from stepblocks.files.tables import write_table
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.drawing import draw_scan
from stepblocks.inspect.result import InspectionResult
from stepblocks.parts.kind import Part
from stepblocks.parts.on_paper import make_inspection_sheet_table
from stepblocks.records.as_built import AsBuilt, AsBuiltValue, write_as_built
from stepblocks.records.certificate import write_certificate
from stepblocks.records.inspection import InspectionRecord
from stepblocks.records.laboratory import Laboratory
from stepblocks.records.qif import write_qif

_MEASURED_COLOUR = "#1d2a36"
_COLOURS: dict[Outcome | None, str] = {
    None: _MEASURED_COLOUR,
    Outcome.CONFORMS: "#2e7d4f",
    Outcome.DOES_NOT_CONFORM: "#b3261e",
    Outcome.NOT_PROVEN: "#b07d00",
}
_NORMAL_95 = 1.96  # coverage factor of the normal law at 95 % [1]


@dataclass(frozen=True)
class _Folder:
    """Where the files of one part go: their names begin with its identity."""

    base: Path

    def build_path(self, ending: str) -> Path:
        """Return the path of a file, such as that of ``inspection.json``."""
        return self.base.with_name(f"{self.base.name}.{ending}")


def write_inspection(
    result: InspectionResult, folder: str | Path, laboratory: Laboratory | None = None
) -> list[Path]:
    """Write page, plot and JSON of an inspection, the as-built record and the filled sheet.

    A certificate is written where a part was inspected.

    Parameters
    ----------
    result : InspectionResult
        From `inspect_scan` or `inspect_standard`.
    folder : str or Path
        Made where it is missing; the files carry the identity of the part.
    laboratory : Laboratory, optional
        From `read_laboratory`; without it the certificate is a draft that the laboratory completes.

    Returns
    -------
    list of Path
    """
    place = _Folder(Path(folder) / result.identity)
    record = result.build_record()
    paths = _write_as_built(place, result)
    data = place.build_path("inspection.json")
    replace_text(data, record.to_json())
    plot = place.build_path("inspection.svg")
    _write_plot(plot, result)
    page = place.build_path("inspection.html")
    paths += [data, plot, page]
    if result.stimulus is not None:
        paths += _write_sheet_qif_and_certificates(
            place, result, result.stimulus, record, laboratory
        )
    links = [path.name for path in paths if path not in (page, plot)]
    _write_page(page, result, laboratory, plot.name, links)
    return paths


def _write_as_built(place: _Folder, result: InspectionResult) -> list[Path]:
    """Write the as-built record, and return its files; none where no length was judged."""
    values = {}
    for judgement in result.judged:
        if judgement.characteristic.quantity == "length":
            decision = judgement.decision
            value = AsBuiltValue(decision.value, decision.std, decision.verdict.value)
            values[judgement.characteristic.key] = value
    if not values:
        return []
    evaluation = result.evaluation
    built = AsBuilt(
        stimulus=result.identity,
        scan=result.source.name,
        scan_sha256=result.digest,
        convention=evaluation.convention,
        values=values,
        surface=evaluation.surface,
        arc=evaluation.arc,
    )
    return write_as_built(place.build_path("as-built.toml"), built)


def _write_sheet_qif_and_certificates(
    place: _Folder,
    result: InspectionResult,
    part: Part,
    record: InspectionRecord,
    laboratory: Laboratory | None,
) -> list[Path]:
    """Write the filled sheet, the results in QIF and both forms of the certificate."""
    filled = _collect_sheet_values(result)
    sheet = place.build_path("inspection-sheet.csv")
    write_table(make_inspection_sheet_table(part, filled), sheet)
    qif = place.build_path("qif")
    write_qif(qif, part, result.order, filled, result.is_complete)
    certificates = write_certificate(
        place.build_path("dcc.xml"), part, record, result.order, result.digest, laboratory
    )
    return [sheet, qif, *certificates]


def _collect_sheet_values(result: InspectionResult) -> dict[str, tuple[float, float, str]]:
    """Return value, standard uncertainty [m or rad] and verdict of what was judged, by key.

    Sheet and QIF know no degrees of freedom: the standard uncertainty is at least that whose
    1.96-fold is the expanded one, so that it reads back as it was.
    """
    filled = {}
    for judgement in result.judged:
        key = judgement.characteristic.key
        decision = judgement.decision
        expanded = result.evaluation.values[key].compute_expanded_uncertainty()
        std = max(expanded / _NORMAL_95, decision.std)
        filled[key] = (decision.value, std, decision.verdict.value)
    return filled


def _write_plot(path: Path, result: InspectionResult) -> None:
    """Draw scan, windows and limits into an SVG file; what others measured comes without a scan."""
    figure, axes = make_figure_and_axes(1, width=9.0, height=4.6)
    shown = result.evaluation.shown
    if shown is not None:
        draw_scan(axes, shown, result.judged)
    axes.set_title(
        f"{result.identity}: {result.conclusion}",
        color=_COLOURS[result.verdict],
        loc="left",
        fontsize=9,
    )
    save_figure(figure, path)


def _write_page(
    path: Path,
    result: InspectionResult,
    laboratory: Laboratory | None,
    picture: str,
    links: list[str],
) -> None:
    """Write the page of an inspection, with its picture and links to its files."""
    scan = f"scan: {result.source.name}"
    if laboratory is not None:
        scan += f" by {laboratory.instrument.name} on {laboratory.measured_to}"
    page = render_page(
        "stepblocks.inspect",
        "inspection.html.j2",
        title=f"Inspection of {result.identity}",
        lead=result.energy_statement or f"Measured on {result.source.name}.",
        alt=f"Scan of {result.identity}, what was fitted, limits and guard bands",
        tables=result.tables,
        notes=[scan, *result.remarks],
        conclusion=result.conclusion,
        picture=picture,
        links=links,
    )
    replace_text(path, page)
