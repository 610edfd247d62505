"""What other programs measured: results in QIF, or a filled inspection sheet."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TypeGuard

from stepblocks.errors import PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.inspect.budget import UNSTATED, Component, Measured, Source
from stepblocks.inspect.evaluation import Evaluation
from stepblocks.inspect.notes import NoteKind
from stepblocks.records.qif_read import QifResult, match_results_to_keys, read_qif_results
from stepblocks.records.sheet_read import is_filled_sheet, read_filled_sheet
from stepblocks.scans.read import Scan

_JUDGED = ("PASS", "FAIL")  # statuses of QIF that are a judgement


def has_results_of_others(scan: Scan) -> TypeGuard[str | Path]:
    """Tell whether a scan is a file of results, and not of heights."""
    if not isinstance(scan, str | Path):
        return False
    path = Path(scan)
    return _is_qif(path) or is_filled_sheet(path)


def read_results_of_others(
    path: Path, keys_by_name: Mapping[str, str], layout: TableLayout = UNDECLARED
) -> Evaluation:
    """Read what others measured, with the uncertainty that they state.

    Parameters
    ----------
    path : Path
        ``*.qif``, or an inspection sheet that is filled in.
    keys_by_name : dict of str
        Keys of the characteristics by number on the drawing, label and key.
    layout : TableLayout
        What is declared of a sheet.

    Returns
    -------
    Evaluation

    Raises
    ------
    PipelineError
        If no result is that of a characteristic.
    """
    if _is_qif(path):
        results = read_qif_results(path)
        origin = "as another program measured it, QIF 3.0"
    else:
        results = read_filled_sheet(path, layout)
        origin = "as the inspection sheet states it"
    matched = match_results_to_keys(results, keys_by_name)
    if not matched:
        names = ", ".join(_list_distinct_result_names(results))
        raise PipelineError(
            "results must measure a characteristic by its name or number on the drawing, got "
            f"{names:.120} [{path}]"
        )
    notes = [NoteKind.RESULTS_IN_FILE.make_note(measured=len(results), matched=len(matched))]
    not_judged = [key for key, result in matched.items() if result.status not in _JUDGED]
    if _is_qif(path) and not_judged:
        notes.append(NoteKind.NO_JUDGEMENT_IN_FILE.make_note(keys=", ".join(not_judged)))
    serials = [result.serial for result in results]
    for serial in dict.fromkeys(serials):
        if serial:
            notes.append(NoteKind.SERIAL_NUMBER.make_note(serial=serial))
    values = {key: _convert_to_measured(key, result) for key, result in matched.items()}
    return Evaluation(values, f"{origin}, {path.name}", tuple(notes))


def _is_qif(path: Path) -> bool:
    """Tell whether a file is one of QIF, by its name."""
    return path.suffix.lower() == ".qif"


def _list_distinct_result_names(results: list[QifResult]) -> list[str]:
    """Return the names or numbers of results, without repetition, in their order."""
    names = [result.name or result.designator or "?" for result in results]
    return list(dict.fromkeys(names))


def _convert_to_measured(key: str, result: QifResult) -> Measured:
    """Convert a result of QIF to a value with the uncertainty that its file states."""
    is_stated = not math.isnan(result.std)
    how = "combined standard uncertainty" if is_stated else f"{UNSTATED} in the file"
    stated = Component(Source.AS_STATED, result.std, how=how, decisive=True, assumed=not is_stated)
    return Measured(key.replace("_", " "), result.value, (stated,))
