"""Many scans, sheets and results of others: one report for each block.

The report says how well readings repeat and reproduce.

A table names the scans (``scan``), their part and block, and every other column is a condition
under which they were taken: day, line, direction, operator. Of a block that was scanned several
times the scatter of its scans takes the place of what each scan says of its own noise; what the
instrument owes and the form of the surface do not average.
"""

import hashlib
import json
import re
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from stepblocks.errors import MetrologyError
from stepblocks.files.atomic import replace_text
from stepblocks.files.layout import UNDECLARED
from stepblocks.files.pages import render_page
from stepblocks.files.tables import Table, write_table
from stepblocks.files.text import escape_file_name
from stepblocks.inspect.batch import (
    MeasuredBatch,
    compute_batch_capabilities,
    describe_batch_limitations,
    draw_control_charts,
)
from stepblocks.inspect.budget import Measured
from stepblocks.inspect.conformity import Outcome, combine_verdicts
from stepblocks.inspect.evaluation import Extent
from stepblocks.inspect.notes import Note
from stepblocks.inspect.repeatability import (
    Repeatability,
    average_scans,
    estimate_repeatability,
)
from stepblocks.inspect.report import write_inspection
from stepblocks.inspect.result import InspectionResult
from stepblocks.inspect.results_of_others import has_results_of_others
from stepblocks.inspect.run import inspect_scan, inspect_standard, judge_part, judge_standard
from stepblocks.inspect.scan_list import (
    BLOCK,
    FEATURE,
    PART,
    SCAN,
    list_condition_columns,
    tabulate_scans,
)
from stepblocks.inspect.size_tables import format_table_rows, split_sizes_by_unit
from stepblocks.records.laboratory import Laboratory

_BLOCKS, _VARIATION, _SCANS = "blocks", "variation", "scans"
_CAPABILITY = "capability"
_OF_SCANS = ("unit", "channel")  # options that say how a scan is read, and no results of others
_LEAD = (
    "ISO 14253-1. Of a block that was scanned several times the scatter of its scans stands in "
    "the budget as repeatability; scans under one condition count as one reading. Scan a block "
    "four times or more: a certificate leaves out what two or three readings alone tell."
)


@dataclass(frozen=True, repr=False)
class ManyScans:
    """What many scans, sheets and results of others say together.

    Attributes
    ----------
    tables : dict of DataFrame
        ``blocks``, ``variation``, ``scans`` and, of five parts or more, ``capability``; lengths in
        micrometres and angles in degrees, each in columns that say so, such as ``value_um`` and
        ``value_deg``.
    left_out : tuple of str
        Files that could not be evaluated, and why.
    verdict : Outcome
        Over all blocks.
    reports : dict of InspectionResult
        One for each block, by its serial number; none of a standard.
    batches : tuple of MeasuredBatch
        What five parts or more tell of their process, one for each characteristic.
    """

    tables: Mapping[str, Table]
    left_out: tuple[str, ...]
    verdict: Outcome
    reports: Mapping[str, InspectionResult]
    batches: tuple[MeasuredBatch, ...] = ()

    @property
    def table_rows(self) -> dict[str, Sequence[Mapping[str, object]]]:
        """Rows of the tables as text, where the column ``unit`` says that of the row.

        Limits are not rounded, values to five digits, uncertainties to three.
        """
        shown: dict[str, Sequence[Mapping[str, object]]] = {}
        for name, table in self.tables.items():
            rows = format_table_rows(table)
            if rows:
                shown[name] = rows
        return shown

    def __repr__(self) -> str:
        return f"ManyScans({len(self.reports)} blocks: {self.verdict.value})"

    def as_record(self) -> dict[str, Any]:
        """Return plain data; what is infinite or does not exist is null."""
        record: dict[str, Any] = {
            "verdict": self.verdict.value,
            "left_out": list(self.left_out),
        }
        for name, table in self.tables.items():
            record[name] = json.loads(table.to_json(orient="records", double_precision=15))
        reports = {}
        for serial, report in self.reports.items():
            reports[serial] = report.as_record()
        return record | {"reports": reports}


@dataclass(frozen=True)
class _InspectedScan:
    """A line of a list of scans, and what the scan says."""

    line: dict[Hashable, Any]  # by column
    result: InspectionResult

    @property
    def block_serial(self) -> str:
        """Serial number of the block."""
        return str(self.line[BLOCK])

    def list_reading_rows(self) -> list[dict[Hashable, Any]]:
        """Return a line of the table of readings for each characteristic with limits."""
        verdicts = {}
        for judgement in self.result.judged:
            verdicts[judgement.characteristic.key] = judgement.decision.verdict
        readings = []
        for key, measured in self.result.evaluation.values.items():
            if key not in verdicts:
                continue
            reading = {
                SCAN: escape_file_name(self.line[SCAN].name),
                "characteristic": key,
                "measured": measured,
                "bound": measured.bound.value,
                "value": measured.value,
                "u": measured.std,
                "verdict": verdicts[key].value,
            }
            readings.append(self.line | reading)
        return readings


@dataclass(frozen=True)
class _InspectedScans:
    """Scans that were inspected, and why the others could not be."""

    scans: list[_InspectedScan] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def list_reading_rows(self) -> list[dict[Hashable, Any]]:
        """Return the lines of the table of readings."""
        readings = []
        for scan in self.scans:
            readings += scan.list_reading_rows()
        return readings

    def list_results_of_block(self, block_serial: str) -> list[InspectionResult]:
        """Return the results of a block."""
        return [scan.result for scan in self.scans if scan.block_serial == block_serial]


@dataclass(frozen=True)
class _Averages:
    """What the readings of all blocks say together."""

    # by block and key of the characteristic
    values: dict[str, dict[str, Measured]] = field(default_factory=dict)
    counts: dict[str, dict[str, int]] = field(default_factory=dict)  # scans, by the same
    variation: list[dict[str, object]] = field(default_factory=list)  # lines of its table


def inspect_many(
    scans: str | Path | Sequence[str | Path],
    stimulus: str | None = None,
    *,
    standard: float | None = None,
    **options: Any,
) -> ManyScans:
    """Evaluate many scans of one block or of a batch, merged with sheets and results of others.

    Parameters
    ----------
    scans : str or Path, or a sequence of them
        Scans, filled inspection sheets and QIF results of one block; or a folder of them; or one
        table with a column ``scan`` (and a folder that holds ``scans.csv``), beside it ``stimulus``
        and ``block``, the serial number, where they differ, ``feature`` (edge or groove), and a
        column for every condition, such as ``day`` or ``direction``.
    stimulus : str, optional
        Identity of the part of every scan whose table does not say it.
    standard : float, optional
        Instead of a stimulus, the certified depth of a standard [m], as `inspect_standard` takes
        it.
    **options
        What `inspect_scan`, or `inspect_standard`, takes besides.

    Returns
    -------
    ManyScans
        One report for each block, with what repeats over its scans in the budgets; `write_many`
        writes them.

    Raises
    ------
    MetrologyError
        If no scan can be evaluated.
    PipelineError
        If the table does not name its scans, or a stimulus is not declared.
    """
    import pandas as pd

    paths = [scans] if isinstance(scans, str | Path) else scans
    if stimulus is None and standard is not None:
        stimulus = "standard"
    layout = options.get("layout", UNDECLARED)
    listed = tabulate_scans(list(map(Path, paths)), stimulus, layout)
    inspected = _inspect_listed_scans(listed, standard, options)
    readings = inspected.list_reading_rows()
    if not readings:
        raise MetrologyError(f"no scan can be evaluated: {inspected.left_out[0]}")
    table = pd.DataFrame(readings)
    averages = _average_readings(table, list_condition_columns(listed))
    reports = {}
    for block, values in averages.values.items():
        reports[block] = _merge_block_results(inspected.list_results_of_block(block), values)
    verdict = combine_verdicts(report.verdict for report in reports.values())
    blocks = _list_block_rows(reports, averages)
    batches: list[MeasuredBatch] = []
    if standard is None:
        batches = compute_batch_capabilities(reports)
    tables = {
        _BLOCKS: split_sizes_by_unit(pd.DataFrame(blocks)),
        _VARIATION: split_sizes_by_unit(pd.DataFrame(averages.variation)),
    }
    if batches:
        rows = [batch.make_capability_row() for batch in batches]
        tables[_CAPABILITY] = split_sizes_by_unit(pd.DataFrame(rows))
    tables[_SCANS] = split_sizes_by_unit(table).drop(columns="measured")
    return ManyScans(
        tables=tables,
        left_out=tuple(inspected.left_out),
        verdict=verdict,
        reports=reports if standard is None else {},
        batches=tuple(batches),
    )


def _inspect_listed_scans(
    scan_list: Table, standard: float | None, options: Mapping[str, Any]
) -> _InspectedScans:
    """Inspect each scan of a list; what cannot be evaluated is left out, with the reason."""
    inspected = _InspectedScans()
    for line in scan_list.to_dict("records"):
        asked = dict(options)
        if has_results_of_others(line[SCAN]):
            for name in _OF_SCANS:
                asked.pop(name, None)
        if line.get(FEATURE):
            asked[FEATURE] = line[FEATURE]
        try:
            if standard is None:
                result = inspect_scan(line[SCAN], line[PART], **asked)
            else:
                result = inspect_standard(line[SCAN], standard, **asked)
        except MetrologyError as error:
            inspected.left_out.append(f"{escape_file_name(line[SCAN].name)}: {error}")
            continue
        inspected.scans.append(_InspectedScan(line, result))
    return inspected


def _average_readings(table: Table, conditions: list[str]) -> _Averages:
    """Average the readings of each characteristic over the scans of each block."""
    averages = _Averages()
    for (part, key), readings in table.groupby([PART, "characteristic"], sort=False):
        # what states its uncertainty counts before what does not
        is_decidable = [measured.is_decidable for measured in readings["measured"]]
        decidable = readings[is_decidable]
        if len(decidable):
            readings = decidable
        repeatability = estimate_repeatability(readings[["value", BLOCK, *conditions]])
        averages.variation.append(
            {
                PART: part,
                "characteristic": key,
                "source": "repeatability",
                "std": repeatability.std,
                "dof": repeatability.dof,
            }
        )
        for block, of_block in readings.groupby(BLOCK, sort=False):
            average = _average_block_readings(of_block, conditions, repeatability)
            averages.values.setdefault(str(block), {})[str(key)] = average
            averages.counts.setdefault(str(block), {})[str(key)] = len(of_block)
    return averages


def _average_block_readings(
    readings: Table, conditions: list[str], repeatability: Repeatability
) -> Measured:
    """Average the readings of one characteristic of one block.

    Scans under one condition count as one reading, unless there is one condition alone.
    """
    groups = 1
    if conditions:
        groups = readings.groupby(conditions, sort=False).ngroups
    count = groups if groups > 1 else len(readings)
    mean = float(readings["value"].mean())
    return average_scans(list(readings["measured"]), mean, count, repeatability)


def _list_block_rows(
    reports: Mapping[str, InspectionResult], averages: _Averages
) -> list[dict[str, object]]:
    """List the rows of the table of blocks, one for each characteristic of each."""
    lines: list[dict[str, object]] = []
    for block, report in reports.items():
        for judgement in report.judged:
            key = judgement.characteristic.key
            decision = judgement.decision
            measured = report.evaluation.values[key]
            lines.append(
                {
                    PART: report.identity,
                    "characteristic": key,
                    BLOCK: block,
                    "scans": averages.counts[block].get(key, 1),
                    "bound": measured.bound.value,
                    "value": decision.value,
                    "u": decision.std,
                    "u95": measured.compute_expanded_uncertainty(),
                    "lower": decision.lower,
                    "upper": decision.upper,
                    "verdict": decision.verdict.value,
                }
            )
    return lines


def _merge_block_results(
    results: Sequence[InspectionResult], averaged_values: Mapping[str, Measured]
) -> InspectionResult:
    """Return one report of a block from all that was measured of it, with averaged values."""
    first = _choose_shown_result(results)
    values: dict[str, Measured] = {}
    missing: dict[str, str] = {}
    covered: dict[str, Extent] = {}
    notes: list[Note] = []
    conventions: list[str] = []
    digests = ""
    for result in results:
        evaluation = result.evaluation
        if evaluation.convention not in conventions:
            conventions.append(evaluation.convention)
        digests += result.digest
        values |= evaluation.values
        covered |= evaluation.covered
        for absent in result.missing:
            missing[absent.characteristic.key] = absent.reason
        source = escape_file_name(result.source.name)
        notes += [note.prefix_source(source) for note in evaluation.notes]
    merged = replace(
        first.evaluation,
        values=values | dict(averaged_values),
        convention="; ".join(conventions),
        notes=tuple(notes),
        missing=missing,
        covered=covered,
    )
    if len(results) > 1:
        first = replace(
            first,
            source=Path(f"{len(results)} files"),
            digest=hashlib.sha256(digests.encode()).hexdigest(),
        )
    if first.stimulus is None:
        certified = first.judged[0].characteristic
        return judge_standard(replace(first, evaluation=merged), certified)
    return judge_part(first.stimulus, merged, first.source, first.digest, first.order, first.asked)


def _choose_shown_result(results: Sequence[InspectionResult]) -> InspectionResult:
    """Return the first result with a surface, else the first with a scan, else the first."""
    for result in results:
        if result.evaluation.surface:
            return result
    for result in results:
        if result.evaluation.shown:
            return result
    return results[0]


def write_many(
    result: ManyScans, folder: str | Path, laboratory: Laboratory | None = None
) -> list[Path]:
    """Write one table and one page of what many scans say, and the report of each block.

    Parameters
    ----------
    result : ManyScans
        From `inspect_many`.
    folder : str or Path
        Made where it is missing; the files of a block lie in a folder of its serial number.
    laboratory : Laboratory, optional
        For the certificates, as `write_inspection` takes it; its serial number is the block's.

    Returns
    -------
    list of Path
        Scans (CSV), the page with all tables (HTML), of five parts or more their capability (CSV)
        and control charts (SVG), and what `write_inspection` writes of each block.
    """
    base = Path(folder)
    table = base / "inspections.csv"
    page = base / "inspections.html"
    write_table(result.tables[_SCANS], table)
    written = []
    for number, (serial, report) in enumerate(result.reports.items(), start=1):
        subfolder = base / re.sub(r"[^\w.-]+", "_", serial).strip(".")
        of_block = _fill_in_serial(laboratory, serial, report.identity)
        if of_block is not None and len(result.reports) > 1:
            # ISO/IEC 17025, 7.8.2.1 d: the number of a certificate is its own
            of_block = of_block.model_copy(
                update={"certificate": f"{of_block.certificate}-{number}"}
            )
        written += write_inspection(report, subfolder, of_block)
    batch_files = []
    if result.batches:
        batch_files = [base / "capability.csv", base / "control-charts.svg"]
        write_table(result.tables[_CAPABILITY], batch_files[0])
        draw_control_charts(batch_files[1], result.batches)
    pages = [path for path in written if path.suffix == ".html"]
    _write_overview_page(page, result, [*pages, *batch_files])
    return [table, page, *batch_files, *written]


def _fill_in_serial(laboratory: Laboratory | None, serial: str, identity: str) -> Laboratory | None:
    """Return what a laboratory states, with the serial number of a block filled in.

    The laboratory's own number stays where `serial` is nothing but the name of the part.
    """
    if laboratory is None:
        return None
    known = laboratory.serial if serial == identity else ""
    return laboratory.model_copy(update={"serial": known or serial})


def _write_overview_page(path: Path, result: ManyScans, pages: list[Path]) -> None:
    """Write the page with all tables and links to the pages of the blocks."""
    notes = [f"{serial}: {report.conclusion}" for serial, report in result.reports.items()]
    notes += [f"left out: {reason}" for reason in result.left_out]
    notes += describe_batch_limitations(result.reports, result.batches)
    links = [page.relative_to(path.parent).as_posix() for page in pages]
    page = render_page(
        "stepblocks.inspect",
        "inspection.html.j2",
        title=f"Inspection of {len(result.tables[_SCANS])} measurements",
        conclusion=result.verdict.value,
        lead=_LEAD,
        tables=result.table_rows,
        picture="",
        alt="",
        notes=notes,
        links=links,
    )
    replace_text(path, page)
