"""The table of features as a file: one row per trial, its conditions as written, its features in SI."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from typing import TextIO

from stepblocks.bench.measuring import TrialResult
from stepblocks.bench.signal.features import FEATURE_COLUMNS
from stepblocks.bench.trial_table import TrialTable

LEADING_COLUMNS = ("trial", "status", "reason")  # First columns of a table of features

OK, EXCLUDED = "ok", "excluded"  # Values of the column ``status``

RESERVED_COLUMNS = frozenset(LEADING_COLUMNS) | frozenset(FEATURE_COLUMNS)  # Names that a covariate may not have


def header_of(table: TrialTable) -> list[str]:
    """Columns of the table of features of a session."""
    return [*LEADING_COLUMNS, *table.covariates, *FEATURE_COLUMNS]


def write_rows(file: TextIO, table: TrialTable, results: Iterable[TrialResult], header: bool = True) -> None:
    """Write results as CSV; not-a-number and the features of an excluded trial are empty cells."""
    writer = csv.writer(file, lineterminator="\n")
    if header:
        writer.writerow(header_of(table))
    for result in results:
        status = EXCLUDED if result.reason else OK
        cells = [result.trial.cells.get(name, "") for name in table.covariates]
        values = [_number(result.features.get(name, math.nan)) for name in FEATURE_COLUMNS]
        if result.reason:
            values = [""] * len(FEATURE_COLUMNS)
        writer.writerow([result.trial.name, status, result.reason, *cells, *values])


def _number(value: float) -> str:
    return f"{value:.9g}" if math.isfinite(value) else ""
