"""Name many scans with their parts, blocks and conditions."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import resolve_inside
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.tables import Table, find_misspelt_columns, read_table
from stepblocks.files.text_table import read_column_names
from stepblocks.inspect.attempts import evaluate_each
from stepblocks.records.sheet_read import is_filled_sheet, read_filled_sheet

SCAN, PART, BLOCK, FEATURE = "scan", "stimulus", "block", "feature"
_NO_CONDITIONS = (SCAN, PART, BLOCK, FEATURE)  # columns that are no condition
_TABLE_NAME = "scans.csv"  # of a table in a folder


def is_one_scan_table(paths: Sequence[Path]) -> bool:
    """Tell whether the paths are a single table that names scans."""
    return len(paths) == 1 and SCAN in read_column_names(paths[0])


def list_condition_columns(scans: Table) -> list[str]:
    """Return the columns of a list of scans that are conditions, such as a day."""
    return [name for name in scans.columns if name not in _NO_CONDITIONS]


def tabulate_scans(
    paths: Sequence[Path], stimulus: str | None, layout: TableLayout = UNDECLARED
) -> Table:
    """Tabulate scans with the parts, blocks and conditions that they are of.

    Parameters
    ----------
    paths : sequence of Path
        Scans, a folder of them, or a table that names them.
    stimulus : str or None
        Part of each scan, where the table does not say it.
    layout : TableLayout
        What is declared of the table and of inspection sheets.

    Returns
    -------
    DataFrame
        Columns ``scan`` (path), ``stimulus``, ``block``, and those of a table.

    Raises
    ------
    PipelineError
        If there are no scans, one lies outside the folder of the table, or a part is not known.
    """
    import pandas as pd

    if len(paths) == 1 and paths[0].is_dir():
        paths = _find_table_or_files(paths[0])
    if is_one_scan_table(paths):
        scans = _read_scan_table(paths[0], layout)
    else:
        scans = pd.DataFrame({SCAN: list(paths)})
    if PART not in scans:
        if not stimulus:
            raise PipelineError(
                "stimulus must be stated, by --stimulus or by a column of the table, got none"
            )
        scans = scans.assign(**{PART: stimulus})
    if BLOCK in scans:
        return scans
    return scans.assign(
        **{BLOCK: _determine_block_names(list(scans[SCAN]), list(scans[PART]), layout)}
    )


def _find_table_or_files(folder: Path) -> list[Path]:
    """Return the table of a folder, or its files where it has none."""
    table = folder / _TABLE_NAME
    if table.is_file():
        return [table]
    files = []
    for path in folder.iterdir():
        if path.is_file() and not path.name.startswith("."):
            files.append(path)
    if not files:
        raise PipelineError(f"folder must hold scans, got none [{folder}]")
    return sorted(files)


def _read_scan_table(path: Path, layout: TableLayout) -> Table:
    """Read a table that names scans; they must lie in its folder."""
    table = read_table(path, (SCAN, PART, BLOCK), layout)
    for column, likely in find_misspelt_columns(table, _NO_CONDITIONS).items():
        raise PipelineError(f"column {column!r} is not known, is it {likely!r}? [{path}]")
    scans = []
    for name in table[SCAN]:
        scan = resolve_inside(path.parent, str(name))
        if scan is None:
            raise PipelineError(f"scan must lie in the folder of the table, got {name!r} [{path}]")
        scans.append(scan)
    import pandas as pd

    listed = table.copy()
    listed[SCAN] = pd.Series(scans, listed.index, dtype=object)
    return listed


def _determine_block_names(scans: list[Path], parts: list[str], layout: TableLayout) -> list[str]:
    """Return the block of each scan.

    A sheet names its part by serial number; the only one named is that of the scans beside it.
    Without any, a block is named as its part.
    """
    serials = {}
    sheets = [path for path in scans if is_filled_sheet(path)]
    for success in evaluate_each(partial(read_filled_sheet, layout=layout), sheets).evaluated:
        serial = success.result[0].serial
        if serial:
            serials[success.item] = serial
    usual = parts
    if len(set(serials.values())) == 1:
        usual = list(serials.values())[:1] * len(scans)
    return [serials.get(path, name) for path, name in zip(scans, usual, strict=True)]
