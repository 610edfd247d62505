"""Many scans, sheets and results of others: one report for each block.

The report says how well readings repeat and reproduce.

A table names the scans (``scan``), their part and block, and every other column is a condition
under which they were taken: day, line, direction, operator. Of a block that was scanned several
times the scatter of its scans takes the place of what each scan says of its own noise; what the
instrument owes and the form of the surface do not average.
"""

import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.files.atomic import replace_text, resolve_inside
from stepblocks.files.pages import render_page
from stepblocks.files.tables import Table, find_misspelt_columns, read_table, write_table
from stepblocks.files.text import escape_file_name
from stepblocks.inspect.budget import Component, Measured, Outcome, combine_verdicts, judge
from stepblocks.inspect.measure import evaluate_each
from stepblocks.inspect.report import InspectionResult, write_inspection
from stepblocks.inspect.run import inspect_scan, inspect_standard, judge_part
from stepblocks.records.laboratory import Laboratory
from stepblocks.records.sheet_read import is_filled_sheet, read_filled_sheet

_OWN = ["scan", "stimulus", "block", "feature"]  # columns that are no condition
_SIZES = ("value", "u", "u95", "lower", "upper", "std")
_SCATTER = ("noise", "repeatability", "scatter")  # of one scan, which several show together
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
        ``blocks``, ``variation`` and ``scans``; lengths in micrometres and angles in degrees, each
        in columns that say so, such as ``value_um`` and ``value_deg``.
    left_out : tuple of str
        Files that could not be evaluated, and why.
    verdict : Outcome
        Over all blocks.
    reports : dict of InspectionResult
        One for each block, by its serial number; none of a standard.
    """

    tables: Mapping[str, Table]
    left_out: tuple[str, ...]
    verdict: Outcome
    reports: Mapping[str, InspectionResult]

    @property
    def table_rows(self) -> dict[str, Sequence[Mapping[str, object]]]:
        """Rows of the tables as text, where the column ``unit`` says that of the row.

        Limits are not rounded, values to five digits, uncertainties to three.
        """
        return {
            name: [
                {
                    key.removesuffix(f"_{row['unit']}"): _show_cell(key, cell)
                    for key, cell in row.items()
                    if key.rpartition("_")[0] not in _SIZES or key.endswith(f"_{row['unit']}")
                }
                for row in rows
            ]
            for name, table in self.tables.items()
            if (rows := table.to_dict("records"))
        }

    def __repr__(self) -> str:
        return f"ManyScans({len(self.reports)} blocks: {self.verdict.value})"

    def as_record(self) -> dict[str, object]:
        """Return plain data; what is infinite or does not exist is null."""
        return {
            "verdict": self.verdict.value,
            "left_out": list(self.left_out),
            **{
                name: json.loads(one.to_json(orient="records", double_precision=15))
                for name, one in self.tables.items()
            },
            "reports": {serial: one.as_record() for serial, one in self.reports.items()},
        }


def _show_cell(key: str, cell: object) -> object:
    name = key.rpartition("_")[0]
    if name not in _SIZES or not isinstance(cell, float):
        return cell
    digits = {"value": 5, "lower": 7, "upper": 7}.get(name, 3)
    return f"{round(cell, 9):.{digits}g}" if math.isfinite(cell) else None


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

    several = [scans] if isinstance(scans, str | Path) else scans
    asked = _list_scans(
        [Path(one) for one in several], stimulus or ("standard" if standard is not None else None)
    )
    factors = [name for name in asked.columns if name not in _OWN]
    results, rows, left_out = list[tuple[str, InspectionResult]](), [], []
    for own in asked.to_dict("records"):
        name = escape_file_name(own["scan"].name)
        given = options | ({"feature": own["feature"]} if own.get("feature") else {})
        try:
            result = (
                inspect_scan(own["scan"], own["stimulus"], **given)
                if standard is None
                else inspect_standard(own["scan"], standard, **given)
            )
        except MetrologyError as error:
            left_out.append(f"{name}: {error}")
            continue
        results.append((str(own["block"]), result))
        limits = {one.key: decision for one, decision in result.judged}
        rows += [
            {
                **own,
                "scan": name,
                "characteristic": key,
                "measured": measured,
                "bound": measured.bound,
                "value": measured.value,
                "u": measured.std,
                "verdict": limits[key].verdict.value,
            }
            for key, measured in result.evaluation.values.items()
            if key in limits
        ]
    if not rows:
        raise MetrologyError(f"no scan can be evaluated: {left_out[0]}")
    table = pd.DataFrame(rows)
    merged: dict[str, dict[str, Measured]] = {}
    counts: dict[tuple[str, str], int] = {}
    variation = []
    for (part, key), own in table.groupby(["stimulus", "characteristic"], sort=False):
        # what states its uncertainty counts before what does not
        decidable = own[[one.is_decidable for one in own["measured"]]]
        own = decidable if len(decidable) else own
        std, dof = estimate_repeatability(own[["value", "block", *factors]])
        variation.append(
            {
                "stimulus": part,
                "characteristic": key,
                "source": "repeatability",
                "std": std,
                "dof": dof,
            }
        )
        for block, its in own.groupby("block", sort=False):
            groups = its.groupby(factors, sort=False).ngroups if factors else 1
            readings = groups if groups > 1 else len(its)
            merged.setdefault(str(block), {})[key] = _average_block(its, readings, std, dof)
            counts[str(block), key] = len(its)
    reports = {
        block: _merge_reports([one for own, one in results if own == block], values)
        for block, values in merged.items()
    }
    blocks = [
        {
            "stimulus": report.identity,
            "characteristic": one.key,
            "block": block,
            "scans": counts.get((block, one.key), 1),
            "bound": report.evaluation.values[one.key].bound,
            "value": decision.value,
            "u": decision.std,
            "u95": report.evaluation.values[one.key].expanded(),
            "lower": decision.lower,
            "upper": decision.upper,
            "verdict": decision.verdict.value,
        }
        for block, report in reports.items()
        for one, decision in report.judged
    ]
    tables = {
        "blocks": _state_units(pd.DataFrame(blocks)),
        "variation": _state_units(pd.DataFrame(variation)),
        "scans": _state_units(table).drop(columns="measured"),
    }
    return ManyScans(
        tables,
        tuple(left_out),
        combine_verdicts(one.verdict for one in reports.values()),
        reports if standard is None else {},
    )


def _merge_reports(
    results: Sequence[InspectionResult], averaged: Mapping[str, Measured]
) -> InspectionResult:
    # Return one report of a block from all that was measured of it.
    first = next((one for one in results if one.evaluation.surface), None)
    first = first or next((one for one in results if one.evaluation.shown), results[0])
    values, missing = dict[str, Measured](), dict[str, str]()
    covered, notes = dict[str, tuple[float, float]](), list[str]()
    for one in results:
        values |= one.evaluation.values
        covered |= one.evaluation.covered
        missing |= {absent.key: why for absent, why in one.missing}
        notes += [f"{escape_file_name(one.source.name)}: {note}" for note in one.evaluation.notes]
    evaluation = replace(
        first.evaluation,
        values=values | dict(averaged),
        convention="; ".join(dict.fromkeys(one.evaluation.convention for one in results)),
        notes=tuple(notes),
        missing=missing,
        covered=covered,
    )
    if len(results) > 1:
        digests = hashlib.sha256("".join(one.digest for one in results).encode())
        first = replace(first, source=Path(f"{len(results)} files"), digest=digests.hexdigest())
    if first.stimulus is None:
        asked = first.judged[0][0]
        decision = judge(evaluation.values[asked.key], asked.nominal, asked.lower, asked.upper)
        return replace(
            first, evaluation=evaluation, judged=((asked, decision),), verdict=decision.verdict
        )
    return judge_part(
        first.stimulus, evaluation, first.source, first.digest, first.order, first.asked
    )


def _state_units(table: Table) -> Table:
    # Give each size a column for lengths and one for angles; a row has it in that of its unit.
    sizes = [name for name in table if name in _SIZES]
    is_angle = table["characteristic"].str.endswith("_angle").to_numpy()
    table.insert(table.columns.get_loc(sizes[0]), "unit", np.where(is_angle, "deg", "um"))
    for name in sizes:
        at = table.columns.get_loc(name)
        own = table.pop(name).astype(float)
        table.insert(at, f"{name}_deg", np.degrees(own).where(is_angle))
        table.insert(at, f"{name}_um", 1e6 * own.mask(is_angle))
    return table


def _list_scans(paths: Sequence[Path], stimulus: str | None) -> Table:
    # Name the scans with their parts, blocks and conditions.
    import pandas as pd

    if len(paths) == 1 and paths[0].is_dir():
        table = paths[0] / "scans.csv"
        within = sorted(
            one for one in paths[0].iterdir() if one.is_file() and not one.name.startswith(".")
        )
        paths = [table] if table.is_file() else within
        PipelineError.require(paths, f"folder must hold scans, got none [{table.parent}]")
    if is_table(paths):
        frame = read_table(paths[0])
        for column, likely in find_misspelt_columns(frame, _OWN).items():
            raise PipelineError(f"column {column!r} is not known, is it {likely!r}? [{paths[0]}]")
        found = [resolve_inside(paths[0].parent, str(name)) for name in frame["scan"]]
        if None in found:
            name = frame["scan"].iloc[found.index(None)]
            raise PipelineError(
                f"scan must lie in the folder of the table, got {name!r} [{paths[0]}]"
            )
        frame = frame.assign(scan=found)
    else:
        frame = pd.DataFrame({"scan": list(paths)})
    if "stimulus" not in frame:
        PipelineError.require(
            stimulus, "stimulus must be said, by --stimulus or by a column of the table, got none"
        )
        frame = frame.assign(stimulus=stimulus)
    # a sheet names its part by serial number; the only one named is that of the scans beside it
    named = {
        path: lines[0].serial
        for path, lines in evaluate_each(read_filled_sheet, filter(is_filled_sheet, frame["scan"]))[
            0
        ]
        if lines[0].serial
    }
    usual = frame["stimulus"] if len({*named.values()}) != 1 else [*named.values()] * len(frame)
    pairs = zip(frame["scan"], usual, strict=False)
    return (
        frame
        if "block" in frame
        else frame.assign(block=[named.get(path, other) for path, other in pairs])
    )


def is_table(paths: Sequence[Path]) -> bool:
    """Say whether what is given is one table that names scans."""
    if len(paths) != 1 or paths[0].suffix.lower() != ".csv" or not paths[0].is_file():
        return False
    with paths[0].open(encoding="utf-8-sig", errors="replace") as file:
        return "scan" in [name.strip() for name in file.readline(10_000).split(",")]


def estimate_repeatability(table: Table) -> tuple[float, float]:
    """Return the standard deviation of a reading of a block and its degrees of freedom.

    Both are pooled over blocks.

    Columns of `table` are ``value``, ``block`` and conditions. Where readings were repeated under a
    condition, their mean is one reading: so what a day or an operator changes counts as well.
    """
    means = (
        table.groupby([name for name in table.columns if name != "value"], sort=False)["value"]
        .mean()
        .reset_index()
    )
    readings = means if means["block"].duplicated().any() else table
    within = readings["value"] - readings.groupby("block")["value"].transform("mean")
    dof = len(readings) - readings["block"].nunique()
    return math.sqrt(float((within**2).sum()) / dof) if dof else 0.0, float(dof)


def _average_block(its: Table, readings: int, std: float, dof: float) -> Measured:
    # Mean over the scans of a block: the scatter over all scans in place of their own, and what
    # does not average.
    budgets: list[Measured] = list(its["measured"])
    if not dof or len(its) == 1:
        return budgets[0]
    parts = [
        Component(
            "repeatability",
            std / math.sqrt(readings),
            dof,
            f"scatter over all blocks, {readings} readings of this one",
        )
    ]
    for part in budgets[0].components:
        stds = [own.std for one in budgets for own in one.components if own.name == part.name]
        if part.name not in _SCATTER:  # all scans share what they have of it
            parts.append(replace(part, std=sum(stds) / len(stds)))
    return replace(budgets[0], value=float(its["value"].mean()), components=tuple(parts))


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
        Scans (CSV), the page with all tables (HTML), and what `write_inspection` writes of each
        block.
    """
    base = Path(folder)
    table, page = base / "inspections.csv", base / "inspections.html"
    write_table(result.tables["scans"], table)
    paths = [table, page]
    for serial, report in result.reports.items():
        # of a block that nothing names but its part, the laboratory may know the number
        own = laboratory.serial if laboratory and serial == report.identity else ""
        lab = laboratory and laboratory.model_copy(update={"serial": own or serial})
        paths += write_inspection(report, base / re.sub(r"[^\w.-]+", "_", serial).strip("."), lab)
    links = [path.relative_to(base).as_posix() for path in paths if path.suffix == ".html"]
    replace_text(
        page,
        render_page(
            "stepblocks.inspect",
            "inspection.html.j2",
            title=f"Inspection of {len(result.tables['scans'])} measurements",
            conclusion=result.verdict.value,
            lead=_LEAD,
            tables=result.table_rows,
            picture="",
            alt="",
            notes=[
                *(f"{serial}: {one.conclusion}" for serial, one in result.reports.items()),
                *(f"left out: {one}" for one in result.left_out),
            ],
            links=links[1:],
        ),
    )
    return paths
