"""The table of features: one row per trial, in a file or as a DataFrame."""

import csv
import io
import math
import pickle
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, NamedTuple, Protocol

import pandas as pd

from stepblocks.bench.examine import TrialResult, TrialStatus
from stepblocks.bench.faults import FaultKind, TrialFault
from stepblocks.bench.labels import find_shared_faults
from stepblocks.bench.signal.features import FEATURE_COLUMNS
from stepblocks.bench.trials import TrialTable
from stepblocks.errors import PipelineError
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
        One for each of `FEATURE_COLUMNS`, a number or a word; not-a-number where the trial does
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

    def mark(self, fault: TrialFault) -> "FeatureRow":
        """Return the row of a trial whose trace contradicts its label: flagged or excluded."""
        if fault.kind is FaultKind.MISLABELLED:
            return replace(self, status=TrialStatus.FLAGGED, fault=fault)
        nothing = (math.nan,) * len(FEATURE_COLUMNS)
        return replace(self, status=TrialStatus.EXCLUDED, fault=fault, values=nothing)


def build_row(result: TrialResult, covariates: Sequence[str]) -> FeatureRow:
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
    file : binary file
        Empty, to write to and to read from.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._count = 0

    def append(self, row: FeatureRow) -> None:
        """Add a row at the end."""
        pickle.dump(row, self._file)
        self._count += 1

    def __iter__(self) -> Iterator[FeatureRow]:
        """Go through the rows from the first; none may be added meanwhile."""
        self._file.seek(0)
        for _ in range(self._count):
            yield pickle.load(self._file)


class _Outcome(NamedTuple):
    """A status with the heading of its reason."""

    status: TrialStatus
    heading: str


@dataclass
class OutcomeCounts:
    """Counts what became of the trials of a session.

    Attributes
    ----------
    counts : Counter
        Of each status with the heading of its reason.
    examples : dict of str to str
        First reason of each heading, in full.
    """

    counts: Counter[_Outcome] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)

    def add(self, row: FeatureRow) -> None:
        """Count one row that is not in order."""
        if row.fault is None:
            return
        heading = row.fault.heading
        self.counts[_Outcome(row.status, heading)] += 1
        self.examples.setdefault(heading, row.reason)

    def count_excluded(self) -> Counter[str]:
        """Return how many trials are excluded, by the heading of the reason."""
        excluded: Counter[str] = Counter()
        for outcome, count in self.counts.items():
            if outcome.status is TrialStatus.EXCLUDED:
                excluded[outcome.heading] = count
        return excluded

    def list_notes(self) -> list[str]:
        """Say how many trials are flagged or censored, and why."""
        notes = []
        for (status, heading), count in self.counts.items():
            if status is not TrialStatus.EXCLUDED:
                notes.append(f"{count} {status.value}: {heading}")
        return notes


class LabelledRows:
    """Rows with the faults of their labels, but for those that a group of trials shares.

    Parameters
    ----------
    rows : RowStore
    table : TrialTable
    faults : mapping of int to TrialFault
        Contradictions between a trace and its row, by row.
    """

    def __init__(self, rows: RowStore, table: TrialTable, faults: Mapping[int, TrialFault]) -> None:
        self._rows = rows
        self._table = table
        self._faults = faults
        self._shared = find_shared_faults(self._list_measured(), faults)
        self.outcomes = OutcomeCounts()

    def _list_measured(self) -> Iterator[tuple[int, dict[str, str]]]:
        """Yield row and conditions of each trial that was measured whole."""
        covariates = self._table.covariates
        for row in self._rows:
            if row.status is TrialStatus.OK:
                yield row.row, dict(zip(covariates, row.conditions, strict=True))

    def __iter__(self) -> Iterator[FeatureRow]:
        """Go through the rows and count their outcomes.

        Raises
        ------
        PipelineError
            At the end, if not one trial was measured.
        """
        self.outcomes = OutcomeCounts()
        for row in self._rows:
            labelled = self._label(row)
            self.outcomes.add(labelled)
            yield labelled
        self._require_measured()

    def _label(self, row: FeatureRow) -> FeatureRow:
        fault = self._faults.get(row.row)
        if fault is None or row.status is not TrialStatus.OK or row.row in self._shared:
            return row
        return row.mark(fault)

    def _require_measured(self) -> None:
        excluded = self.outcomes.count_excluded()
        if excluded.total() < self._table.count:
            return
        ((heading, count),) = excluded.most_common(1)
        raise PipelineError(
            f"no trial of {self._table.count} could be measured; {count} times "
            f"{self.outcomes.examples[heading]} [{self._table.session.folder}]"
        )

    def list_notes(self) -> list[str]:
        """Say what a reader should know of the session; to be called after going through it."""
        notes = [f"all trials have one {name}" for name in _find_constant_conditions(self._table)]
        notes += self.outcomes.list_notes()
        for group, count in Counter(self._shared.values()).items():
            notes.append(f"{count} {group} are unlike their labels together and stay as data")
        return notes


def _find_constant_conditions(table: TrialTable) -> list[str]:
    """Return what the session does not vary, and of which it shows no effect."""
    levels: dict[str, set[str]] = {"block": set(), "speed": set(), "load": set()}
    for trial in table:
        levels["block"].add(trial.block)
        levels["speed"].add(str(trial.speed))
        levels["load"].add(str(trial.load))
    return [name for name, values in levels.items() if len(values) == 1]


def write_rows(rows: Iterable[FeatureRow], covariates: Sequence[str], path: Path) -> None:
    """Write a table of features as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        conditions = [escape_formula(name) for name in covariates]
        writer.writerow([*LEADING_COLUMNS, *conditions, *FEATURE_COLUMNS])
        for row in rows:
            texts = [row.trial, row.status.value, row.reason, *row.conditions]
            cells = [escape_formula(text) for text in texts]
            cells += [_format_value(value) for value in row.values]
            writer.writerow(cells)


def _format_value(value: float | str) -> str:
    """Write a feature to nine significant digits; empty where it is not known."""
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return ""
    return f"{value:.9g}"


def build_frame(rows: Sequence[FeatureRow], covariates: Sequence[str]) -> pd.DataFrame:
    """Return a table of features, with the values that its file holds."""
    leading = pd.DataFrame(
        {
            "status": [row.status.value for row in rows],
            "reason": [escape_formula(row.reason) for row in rows],
        }
    )
    conditions = _build_conditions(rows, covariates)
    columns = {}
    for index, name in enumerate(FEATURE_COLUMNS):
        columns[name] = pd.Series([_round_value(row.values[index]) for row in rows])
    features = pd.DataFrame(columns)
    return pd.concat(
        [conditions.iloc[:, :1], leading, conditions.iloc[:, 1:], features], axis="columns"
    )


def _round_value(value: float | str) -> float | str:
    """Round a feature to the nine significant digits of the file; infinities are not known."""
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return math.nan
    return float(_format_value(value))


def _build_conditions(rows: Sequence[FeatureRow], covariates: Sequence[str]) -> pd.DataFrame:
    """Return the trials and their conditions, with the types that pandas finds in their texts."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["trial", *(escape_formula(name) for name in covariates)])
    for row in rows:
        writer.writerow([escape_formula(cell) for cell in (row.trial, *row.conditions)])
    text.seek(0)
    return pd.read_csv(text, dtype=_TEXT_CONDITIONS)
