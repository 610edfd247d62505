"""The conditions of the trials under the names and in the units that an analysis asks for."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from stepblocks.bench.channel import Channel, find_unit_in_name
from stepblocks.bench.patterns import resolve_path_inside_session
from stepblocks.bench.session import Session, TrialColumns
from stepblocks.bench.trials import Trial, find_declared_column, open_trials
from stepblocks.errors import BenchError
from stepblocks.files.dates import DateError, holds_dates, read_dates
from stepblocks.files.numbers import NumberNotation
from stepblocks.files.tables import escape_formula, warn_of_notes
from stepblocks.files.text import is_file
from stepblocks.files.text_table import TextTable

_HEIGHT = re.compile(r"(step_?)?height", re.IGNORECASE)
# names that an analysis asks for, by the fields of `TrialColumns`
_NAMES = {"block": "block", "load": "load_n", "speed": "speed_mm_s", "height": "height_um"}
_FIRST_FEATURE = "sliding_friction"  # before which a condition stands that replaces no column


class Condition(NamedTuple):
    """One condition of all trials.

    Attributes
    ----------
    column : str
        Column of the table of trials that it replaces; empty where it replaces none.
    values : Series
        One value per trial.
    """

    column: str
    values: pd.Series


def read_conditions(session: Session) -> dict[str, Condition]:
    """Read what an analysis needs beside the forces.

    Returns
    -------
    dict of str to Condition
        By the name that the analysis asks for. What the table has already under that name and in
        that unit is left out.
    """
    table = open_trials(session)
    columns = session.trials.columns
    trials = list(table)
    sources = {}
    for part in ("block", "load", "speed"):
        sources[part] = find_declared_column(getattr(columns, part).column, table.header, part)
    sources["height"], heights = find_block_heights(session, table.table, trials)
    rows = []
    for trial, height in zip(trials, heights, strict=True):
        rows.append((trial.block, trial.load, height, 1e3 * trial.speed))
    values = pd.DataFrame(rows, columns=["block", "load", "height", "speed"])
    usual = TrialColumns()
    conditions = {}
    for part, name in _NAMES.items():
        is_usual = getattr(columns, part) == getattr(usual, part)
        if sources[part] != name or not is_usual or table.table.notation.decimal != ".":
            conditions[name] = Condition(sources[part], values[part])
    for column in table.covariates:
        if column not in sources.values():
            conditions |= _read_covariate_condition(table.table, column)
    return conditions


def _read_covariate_condition(table: TextTable, column: str) -> dict[str, Condition]:
    """Read a column of numbers in another notation, or of dates as times since the first [s].

    The result is empty where the cells are neither.
    """
    index = table.names.index(column)
    cells = table.get_cells(index)
    if table.holds_numbers(index):
        found = table.require_numbers(index, BenchError)
        warn_of_notes(filter(None, [found.describe_missing_values(column)]), table.file)
        if not found.count and NumberNotation().parse_column(cells) is not None:
            return {}
        return {column: Condition(column, pd.Series(found.values))}
    if not holds_dates(cells):
        return {}
    try:
        dates = read_dates(cells, column)
    except DateError as error:
        place = (
            table.file
            if error.row is None
            else f"{table.file}, {table.name_place_of_row(error.row)}"
        )
        raise BenchError(f"{error} [{place}]") from error
    warn_of_notes(dates.notes, table.file)
    elapsed = dates.seconds - np.nanmin(dates.seconds)
    return {f"{column}_elapsed_s": Condition(column, pd.Series(elapsed))}


def replace_columns_by_conditions(
    features: pd.DataFrame, conditions: Mapping[str, Condition]
) -> pd.DataFrame:
    """Return a table of features with `conditions` in place of the columns they come from."""
    table = features.copy()
    for name, (column, values) in conditions.items():
        source = escape_formula(column)
        present = list(table.columns)
        neighbour = source if source in present else _FIRST_FEATURE
        place = present.index(neighbour)
        table = table.drop(columns=[source, name], errors="ignore")
        table.insert(min(place, len(table.columns)), name, values.to_numpy())
    return table


def find_block_heights(
    session: Session, trial_table: TextTable, trials: Sequence[Trial]
) -> tuple[str, list[float]]:
    """Find the heights of the blocks of trials.

    Parameters
    ----------
    session : Session
    trial_table : TextTable
        The table of trials.
    trials : sequence of Trial

    Returns
    -------
    column : str
        Column of the heights; empty where they are those of the stimulus set.
    heights : list of float
        One per trial [um]; NaN where unknown.

    Raises
    ------
    BenchError
        If the table has no column of heights and the session no stimulus set.
    """
    channel = _find_height_channel(session, trial_table.names)
    if channel is None:
        declared = _read_declared_heights_um(session)
        return "", [declared.get(trial.block, math.nan) for trial in trials]
    column = find_declared_column(channel.column, trial_table.names, "height")
    place = "trials.columns.height"
    scale = 1e6 * channel.find_factor_to_si("length", place)
    offset = 1e6 * channel.find_offset_in_si("length", place)
    heights = []
    for trial in trials:
        number = _parse_height_cell(trial.cells.get(column, ""), trial_table.notation)
        heights.append(number * scale - offset)
    return column, heights


def _parse_height_cell(text: str, notation: NumberNotation) -> float:
    """Return the height in a cell; NaN where the cell holds no number."""
    try:
        return notation.parse_number(text)
    except ValueError:
        return math.nan


def _find_height_channel(session: Session, header: tuple[str, ...]) -> Channel | None:
    """Return the column of the heights: declared, the default one, or one named like it."""
    columns = session.trials.columns
    if "height" in columns.model_fields_set or columns.height.column in header:
        return columns.height
    for name in header:
        if _HEIGHT.match(name) and find_unit_in_name(name, "length"):
            return Channel(column=name)
    return None


def _read_declared_heights_um(session: Session) -> dict[str, float]:
    """Return the heights of the blocks of the stimulus set by their names [um]."""
    from stepblocks.contact.counterface import Step
    from stepblocks.declaration.read import load_set

    path = _find_stimulus_file(session)
    if path is None or not is_file(path):
        missing = ""
        if path is not None:
            missing = f", and there is no {path}"
        raise BenchError(
            "table of trials must have a column 'height_um' or another length that begins with "
            f"height, or `stimuli.file` the stimulus set{missing} [{session.table}]"
        )
    heights = {}
    for part in load_set(path).stimuli:
        if part.crossed:
            counterface = part.counterface()
            if isinstance(counterface, Step):
                heights[part.id] = 1e6 * counterface.height
    return heights


def _find_stimulus_file(session: Session) -> Path | None:
    """Return where the stimulus set should lie; None where the session names none."""
    stimuli = session.stimuli
    if stimuli.file:
        return resolve_path_inside_session(session.folder, stimuli.file, "stimuli.file")
    if stimuli.set:
        return Path("stimuli") / f"{stimuli.set}.toml"
    return None
