"""The table of features: one row per trial, in a file or as a DataFrame."""

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Protocol

import pandas as pd

from stepblocks.bench.examine import TrialResult, TrialStatus
from stepblocks.bench.faults import FaultKind, TrialFault
from stepblocks.bench.labels import find_shared_label_faults
from stepblocks.bench.signal.features import FEATURE_COLUMNS
from stepblocks.files.tables import escape_formula

LEADING_COLUMNS = ("trial", "status", "reason")
# names that look like numbers stay texts, beside blank cells too
_TEXT_CONDITIONS = {"trial": str, "block": str, "tip": str}


@dataclass(frozen=True)
class FeatureRow:
    """One row of the table of features.

    Attributes
    ----------
    row : int
        Of the table of trials, from 1.
    trial : str
    status : TrialStatus
    fault : TrialFault or None
        Reason for the status; None where the trial is in order.
    conditions : tuple of str
        Cells of the table of trials, as written, one for each of its covariates.
    values : tuple
        One for each of `FEATURE_COLUMNS`, a number or a word; NaN where the trial does
        not show it.
    """

    row: int
    trial: str
    status: TrialStatus
    fault: TrialFault | None
    conditions: tuple[str, ...]
    values: tuple[float | str, ...]

    @property
    def reason(self) -> str:
        """Reason for the status, as the table shows it."""
        if self.fault is None:
            return ""
        return str(self.fault)

    def with_fault(self, fault: TrialFault) -> "FeatureRow":
        """Return the row flagged where the label is wrong, else excluded and without values."""
        if fault.kind is FaultKind.MISLABELLED:
            return replace(self, status=TrialStatus.FLAGGED, fault=fault)
        nothing = (math.nan,) * len(FEATURE_COLUMNS)
        return replace(self, status=TrialStatus.EXCLUDED, fault=fault, values=nothing)


def build_feature_row(result: TrialResult, covariates: Sequence[str]) -> FeatureRow:
    """Return the row of one result."""
    trial = result.trial
    conditions = tuple(trial.cells.get(name, "") for name in covariates)
    values = tuple(result.features.get(name, math.nan) for name in FEATURE_COLUMNS)
    return FeatureRow(trial.row, trial.name, result.status, result.fault, conditions, values)


class RowStore(Protocol):
    """Rows in the order of the table, which can be gone through more than once."""

    def append(self, row: FeatureRow, /) -> None:
        """Add a row at the end."""

    def __iter__(self) -> Iterator[FeatureRow]:
        """Go through the rows from the first."""


class RowSpool:
    """Rows in a temporary file: a session of any number of trials needs little memory.

    Parameters
    ----------
    file : text file
        Empty, to write to and to read from; it gets a line of JSON for each row.
    """

    def __init__(self, file: IO[str]) -> None:
        self._file = file

    def append(self, row: FeatureRow) -> None:
        """Add a row at the end."""
        self._file.write(_format_row_as_json(row) + "\n")

    def __iter__(self) -> Iterator[FeatureRow]:
        """Go through the rows from the first; none may be added meanwhile."""
        self._file.seek(0)
        for line in self._file:
            yield _parse_json_row(line)


def _format_row_as_json(row: FeatureRow) -> str:
    """Return a row as a line of JSON with all digits of its numbers."""
    fault = None
    if row.fault is not None:
        fault = {"kind": row.fault.kind.name, "details": row.fault.details}
    return json.dumps(
        {
            "row": row.row,
            "trial": row.trial,
            "status": row.status.name,
            "fault": fault,
            "conditions": row.conditions,
            "values": row.values,
        }
    )


def _parse_json_row(line: str) -> FeatureRow:
    """Return the row of a line of JSON, without the bound of a censored trial."""
    fields = json.loads(line)
    fault = None
    if fields["fault"] is not None:
        fault = TrialFault(FaultKind[fields["fault"]["kind"]], fields["fault"]["details"])
    return FeatureRow(
        fields["row"],
        fields["trial"],
        TrialStatus[fields["status"]],
        fault,
        tuple(fields["conditions"]),
        tuple(fields["values"]),
    )


class LabelledRows:
    """Rows with the faults of their labels, but for those that a group of trials shares.

    Parameters
    ----------
    rows : RowStore
    covariates : sequence of str
        Columns of the conditions of the rows.
    faults : mapping of int to TrialFault
        Contradictions between a trace and its row, by row.

    Attributes
    ----------
    shared : dict of int to str
        Rows that contradict their traces together and stay as data, with the name of their group.
    """

    def __init__(
        self, rows: RowStore, covariates: Sequence[str], faults: Mapping[int, TrialFault]
    ) -> None:
        self._rows = rows
        self._faults = faults
        self.shared = find_shared_label_faults(
            _iterate_measured_conditions(rows, covariates), faults
        )

    def __iter__(self) -> Iterator[FeatureRow]:
        for row in self._rows:
            yield self._flag_mislabelled_row(row)

    def _flag_mislabelled_row(self, row: FeatureRow) -> FeatureRow:
        """Mark a sound row by the fault of its label, unless the fault is shared."""
        fault = self._faults.get(row.row)
        if fault is None or row.status is not TrialStatus.OK or row.row in self.shared:
            return row
        return row.with_fault(fault)


def _iterate_measured_conditions(
    row_store: RowStore, covariates: Sequence[str]
) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield row and conditions of each trial that was measured whole."""
    for row in row_store:
        if row.status is TrialStatus.OK:
            yield row.row, dict(zip(covariates, row.conditions, strict=True))


def write_feature_rows(rows: Iterable[FeatureRow], covariates: Sequence[str], path: Path) -> None:
    """Write a table of features as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        conditions = map(escape_formula, covariates)
        writer.writerow([*LEADING_COLUMNS, *conditions, *FEATURE_COLUMNS])
        for row in rows:
            texts = [row.trial, row.status.value, row.reason, *row.conditions]
            values = map(_format_feature_value, row.values)
            writer.writerow([*map(escape_formula, texts), *values])


def _format_feature_value(feature: float | str) -> str:
    """Write a feature to nine significant digits; empty where it is not known."""
    if isinstance(feature, str):
        return feature
    if not math.isfinite(feature):
        return ""
    return f"{feature:.9g}"


def build_feature_frame(rows: Sequence[FeatureRow], covariates: Sequence[str]) -> pd.DataFrame:
    """Return a table of features, with the values that its file holds."""
    statuses = [row.status.value for row in rows]
    reasons = [escape_formula(row.reason) for row in rows]
    leading = pd.DataFrame({"status": statuses, "reason": reasons})
    conditions = _build_condition_frame(rows, covariates)
    columns = {}
    for index, name in enumerate(FEATURE_COLUMNS):
        values = [_round_feature_value(row.values[index]) for row in rows]
        columns[name] = pd.Series(values)
    features = pd.DataFrame(columns)
    return pd.concat(
        [conditions.iloc[:, :1], leading, conditions.iloc[:, 1:], features], axis="columns"
    )


def _round_feature_value(feature: float | str) -> float | str:
    """Round a feature to the nine significant digits of the file; infinities are not known."""
    if isinstance(feature, str):
        return feature
    if not math.isfinite(feature):
        return math.nan
    return float(_format_feature_value(feature))


def _build_condition_frame(rows: Sequence[FeatureRow], covariates: Sequence[str]) -> pd.DataFrame:
    """Return the trials and their conditions, with the types that pandas finds in their texts."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["trial", *map(escape_formula, covariates)])
    for row in rows:
        writer.writerow(map(escape_formula, (row.trial, *row.conditions)))
    text.seek(0)
    return pd.read_csv(text, dtype=_TEXT_CONDITIONS)
