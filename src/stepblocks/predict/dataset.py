"""Tables of predictions as labelled arrays, and as a plot."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import pandas as pd

from stepblocks.errors import PipelineError
from stepblocks.files.figures import get_or_make_axes
from stepblocks.predict.renamed_columns import (
    find_current_column_name,
    format_renamed_column_hint,
    rename_old_columns,
)
from stepblocks.predict.table import list_input_columns
from stepblocks.quantities import format_column_label, format_units

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

# columns that a condition is known by, in the order of a set's predictions
_CONDITIONS = (
    "set",
    "stimulus",
    "tip_radius_um",
    "height_um",
    "drag",
    "friction",
    "normal_load_n",
    "load_n",
)
_MOST_EMPTY = 2  # cells of a grid for each row of its table
# what is drawn where no columns are named: the first of each that the table has
_HEIGHTS = ("height_um", "height_nm", "height_mm", "height_m")
_ENERGIES = ("felt_energy_uj", "vibration_energy_uj", "vibration_energy_j")


def to_dataset(table: pd.DataFrame) -> "xarray.Dataset":
    """Turn a table of predictions into an xarray Dataset.

    Parameters
    ----------
    table : pandas.DataFrame
        Of `predict_set` or `predict_table`, or any table whose columns end in their units.

    Returns
    -------
    xarray.Dataset
        A variable for each column, its ``units`` and ``long_name`` as attributes. The conditions
        that vary are the dimensions, ``(stimulus, tip_radius_um, drag, friction, normal_load_n)``
        or fewer, and of a table the columns that it is predicted from. Where they do not tell the
        rows apart, or make no grid, as in a random design, there is one dimension ``row``. A
        condition that the table lacks is NaN.

    Raises
    ------
    PipelineError
        If xarray is not installed, or `table` is no DataFrame.

    Examples
    --------
    >>> import stepblocks as sb  # doctest: +SKIP
    >>> found = sb.to_dataset(sb.predict_set("stimuli/paper-ten.toml"))  # doctest: +SKIP
    >>> found.felt_energy_uj.sel(normal_load_n=1.0).dims  # doctest: +SKIP
    ('stimulus',)
    """
    _refuse_unless_data_frame(table)
    try:
        dataset = _index_by_conditions(rename_old_columns(table)).to_xarray()
    except ImportError as error:
        raise PipelineError(
            "a Dataset needs xarray: install the extra with pip install 'stepblocks[xarray]'"
        ) from error
    for name in dataset.variables:
        dataset[name].attrs = _make_column_attributes(str(name))
    return dataset


def _index_by_conditions(table: pd.DataFrame) -> pd.DataFrame:
    """Index a table by the conditions that tell its rows apart, else by the number of the row."""
    names = _find_varying_conditions(table)
    if not names and "stimulus" in table:
        names = ["stimulus"]
    if not names or table.duplicated(names).any():
        return table.rename_axis("row")
    cells = math.prod(table[name].nunique(dropna=False) for name in names)
    if cells > _MOST_EMPTY * len(table):  # a random design, no grid
        return table.rename_axis("row")
    return table.set_index(names)


def _make_column_attributes(name: str) -> dict[str, str]:
    """Make the attributes of a variable: its label and, where its name says one, its unit."""
    label, _, unit = format_column_label(name).rpartition(", ")
    if not label:
        return {"long_name": unit}
    return {"long_name": label, "units": unit}


def plot_predictions(
    table: pd.DataFrame,
    x: str | None = None,
    y: str | None = None,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a column of predictions against another, a line for each condition.

    Parameters
    ----------
    table : pandas.DataFrame
        Of `predict_set` or `predict_table`.
    x, y : str, optional
        Columns of numbers; by default the energy that is felt, or that of the formula, against the
        height of the step.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    matplotlib Axes

    Raises
    ------
    PipelineError
        If `table` is no DataFrame or lacks a column.
    """
    _refuse_unless_data_frame(table)
    table = rename_old_columns(table)
    x = find_current_column_name(x or _choose_first_known_column(table, _HEIGHTS), table.columns)
    y = find_current_column_name(y or _choose_first_known_column(table, _ENERGIES), table.columns)
    for name in (x, y):
        if name not in table:
            known = ", ".join(map(str, table.columns))
            hint = format_renamed_column_hint(name, table.columns)
            raise PipelineError(f"{name!r} must be a column of the table: {known}{hint}")
    axes = get_or_make_axes(ax)
    drawn = {x, y, "stimulus", *_HEIGHTS}
    conditions = [name for name in _find_varying_conditions(table) if name not in drawn]
    for label, rows in _iterate_condition_groups(table, conditions):
        ordered = rows.sort_values(x)
        axes.plot(ordered[x], ordered[y], marker="o", label=label)
    if conditions:
        title = "; ".join(format_column_label(name) for name in conditions)
        axes.legend(title=format_units(title), fontsize=8)
    axes.set_xlabel(format_units(format_column_label(x)))
    axes.set_ylabel(format_units(format_column_label(y)))
    return axes


def _choose_first_known_column(table: pd.DataFrame, names: Sequence[str]) -> str:
    """Return the first of several columns that a table has, else the first of all."""
    for name in names:
        if name in table:
            return name
    return names[0]


def _iterate_condition_groups(
    table: pd.DataFrame, conditions: list[str]
) -> Iterator[tuple[str | None, pd.DataFrame]]:
    """Label and rows of each condition; one group without a label where there is none."""
    if not conditions:
        yield None, table
        return
    for condition, rows in table.groupby(conditions, sort=False):
        yield ", ".join(map(str, condition)), rows


def _refuse_unless_data_frame(table: object) -> None:
    """Refuse a table that is not a data frame; it would fail inside xarray or matplotlib."""
    if not isinstance(table, pd.DataFrame):
        raise PipelineError(f"table must be a pandas DataFrame, got {type(table).__name__}")
    repeated = table.columns[table.columns.duplicated()]
    if len(repeated):
        raise PipelineError(
            f"columns must have names of their own, got {str(repeated[0])!r:.60} twice"
        )


def _find_varying_conditions(table: pd.DataFrame) -> list[str]:
    """Find the conditions that vary over the rows and are not a matter of the stimulus alone."""
    known = [*_CONDITIONS, *list_input_columns()]
    varying = []
    for name in dict.fromkeys(known):
        if name in table and table[name].nunique() > 1:
            varying.append(name)
    if "stimulus" not in varying:
        return varying
    values_of_stimulus = table.groupby("stimulus").nunique()
    chosen = []
    for name in varying:
        is_identity = name in ("set", "stimulus")
        if is_identity or values_of_stimulus[name].max() > 1:
            chosen.append(name)
    return chosen
