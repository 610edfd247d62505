"""Columns and rows of a table by the names that its own files gave them: texts."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


def list_column_names(table: "pd.DataFrame") -> list[str]:
    """List the names of the columns of a table."""
    return list(map(str, table.columns))


def list_rows_by_column_name(table: "pd.DataFrame") -> list[dict[str, object]]:
    """List the rows of a table, each by the names of its columns."""
    rows = []
    for record in table.to_dict("records"):
        rows.append({str(name): value for name, value in record.items()})
    return rows
