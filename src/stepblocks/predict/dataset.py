"""Tables of predictions as labelled arrays, and as a plot."""

from typing import TYPE_CHECKING

import pandas as pd

from stepblocks.errors import PipelineError
from stepblocks.files.figures import take_axes
from stepblocks.quantities import format_column_label, format_units

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

# columns that a condition is known by, in the order of a set's predictions
_CONDITIONS = (
    *("set", "stimulus", "tip_radius_um", "step_height_um"),
    *("drag", "friction", "normal_load_n", "load_n"),
)


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
        or fewer; where they do not tell the rows apart, there is one dimension ``row``. A condition
        that the table lacks is NaN.

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
    _require_frame(table)
    # the conditions that tell all rows apart, or none
    names = _find_varying(table) or [name for name in ("stimulus",) if name in table]
    told_apart = names and not table.duplicated(names).any()
    indexed = table.set_index(names) if told_apart else table.rename_axis("row")
    try:
        found = indexed.to_xarray()
    except ImportError as error:
        raise PipelineError(
            "a Dataset needs xarray: install the extra with pip install 'stepblocks[xarray]'"
        ) from error
    for name in found.variables:
        label, _, unit = format_column_label(str(name)).rpartition(", ")
        found[name].attrs = {"long_name": label or unit} | ({"units": unit} if label else {})
    return found


def plot_predictions(
    table: pd.DataFrame,
    x: str = "step_height_um",
    y: str = "felt_energy_uj",
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a column of predictions against another, a line for each condition.

    Parameters
    ----------
    table : pandas.DataFrame
        Of `predict_set` or `predict_table`.
    x, y : str
        Columns of numbers; by default the energy that is felt against the height of the step.
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
    _require_frame(table)
    if missing := [name for name in (x, y) if name not in table]:
        raise PipelineError(
            f"{missing[0]!r} must be a column of the table: {', '.join(map(str, table.columns))}"
        )
    axes = take_axes(ax)
    own = {x, y, "stimulus", "step_height_um"}
    by = [name for name in _find_varying(table) if name not in own]
    for condition, rows in table.groupby(by, sort=False) if by else [((), table)]:
        ordered = rows.sort_values(x)
        axes.plot(ordered[x], ordered[y], marker="o", label=", ".join(map(str, condition)) or None)
    if by:
        axes.legend(title=format_units("; ".join(map(format_column_label, by))), fontsize=8)
    axes.set(
        xlabel=format_units(format_column_label(x)), ylabel=format_units(format_column_label(y))
    )
    return axes


def _require_frame(table: object) -> None:
    PipelineError.require(
        isinstance(table, pd.DataFrame),
        f"table must be a pandas DataFrame, got {type(table).__name__}",
    )


def _find_varying(frame: pd.DataFrame) -> list[str]:
    # Find the conditions that are not alike in all rows, nor a matter of the stimulus alone
    names = [name for name in _CONDITIONS if name in frame and frame[name].nunique() > 1]
    if "stimulus" not in names:
        return names
    counts = frame.groupby("stimulus").nunique()
    return [name for name in names if name in ("set", "stimulus") or counts[name].max() > 1]
