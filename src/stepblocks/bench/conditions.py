"""The conditions of a session's trials under the names and in the units that an analysis asks for, whatever the table calls them."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.bench.session import Channel, Session, TrialColumns, inside, unit_of_name
from stepblocks.bench.trials import Trial, column_name, open_trials
from stepblocks.errors import BenchError

if TYPE_CHECKING:
    import pandas as pd

_HEIGHT = re.compile(r"(step_?)?height", re.IGNORECASE)
_STAMP = r"\d{4}-\d\d?-\d\d?|\d\d?[./]\d\d?[./]\d{2,4}|\d\d?:\d\d"  # how a date or a time of day begins
_STAMPS = 0.9  # share of the cells of a column that must be date and time
_NAMES = {"block": "block", "load": "load_n", "speed": "speed_mm_s", "height": "height_um"}


def conditions_of(session: Session) -> dict[str, tuple[str, pd.Series]]:
    """Read what an analysis needs beside the forces: by name, the column it takes the place of and one value per trial.

    What the table already has under that name and in that unit is left out. Raises `BenchError` where block, load, speed
    or height are neither in the table nor, for the height, known of the stimulus set.
    """
    import pandas as pd

    table, columns = open_trials(session), session.trials.columns
    rows = list(table)
    named = {
        part: column_name(getattr(columns, part).column, table.header, part) for part in ("block", "load", "speed")
    }
    values: dict[str, list[object]] = {
        "block": [row.block for row in rows],
        "load": [row.load for row in rows],
        "speed": [1e3 * row.speed for row in rows],
    }
    named["height"], values["height"] = _heights(session, table.header, rows)
    found = {
        name: (named[part], pd.Series(values[part]))
        for part, name in _NAMES.items()
        if named[part] != name
        or getattr(columns, part) != getattr(TrialColumns(), part)
        or session.trials.decimal != "."
    }
    for column in table.covariates:
        if column in named.values():
            continue
        text = pd.Series([row.cells.get(column, "").strip() for row in rows])
        if session.trials.decimal == "," and text.str.fullmatch(r"[-+]?\d*,?\d+([eE][-+]?\d+)?|").all():
            found[column] = (column, pd.to_numeric(text.str.replace(",", ".")))
        elif text.str.match(_STAMP).mean() > _STAMPS:
            stamps = pd.to_datetime(
                text, errors="coerce", format="mixed", dayfirst=bool(text.str.match(r"\d\d?\.").any())
            )
            if stamps.notna().mean() > _STAMPS:
                found[f"{column}_elapsed_s"] = (column, (stamps - stamps.min()).dt.total_seconds())
    return found


def with_conditions(features: pd.DataFrame, conditions: dict[str, tuple[str, pd.Series]]) -> pd.DataFrame:
    """Return a table of features of all trials with `conditions` in the places of the columns they come from."""
    table = features.copy()
    for name, (source, values) in conditions.items():
        place = list(table.columns).index(source) if source in table else list(table.columns).index("sliding_friction")
        table = table.drop(columns=[column for column in {source, name} if column in table])
        table.insert(min(place, len(table.columns)), name, values.to_numpy())
    return table


def _heights(session: Session, header: tuple[str, ...], rows: list[Trial]) -> tuple[str, list[object]]:
    """Column of the heights and their values [um]; of the stimulus set where the table has none."""
    channel = session.trials.columns.height
    if "height" in session.trials.columns.model_fields_set:
        column_name(channel.column, header, "height")
    elif channel.column not in header:
        others = [name for name in header if _HEIGHT.match(name) and unit_of_name(name, "length")]
        if not others:
            heights = _declared_heights(session)
            return "", [heights.get(row.block, math.nan) for row in rows]
        channel = Channel(column=others[0])
    name, place = column_name(channel.column, header, "height"), "trials.columns.height"
    scale, off = (1e6 * one("length", place) for one in (channel.scale, channel.taken_off))
    values: list[object] = []
    for row in rows:
        try:
            values.append(float(row.cells.get(name, "").strip().replace(session.trials.decimal, ".")) * scale - off)
        except ValueError:
            values.append(math.nan)
    return name, values


def _declared_heights(session: Session) -> dict[str, float]:
    """Heights of the blocks of the stimulus set by their names [um]."""
    from stepblocks.contact.counterface import Step
    from stepblocks.declare import load_declared

    stimuli = session.stimuli
    beside = Path("stimuli") / f"{stimuli.set}.toml"
    path = inside(session.folder, stimuli.file, "stimuli.file") if stimuli.file else beside
    if not (stimuli.set or stimuli.file) or not path.is_file():
        missing = f", and there is no {path}" if stimuli.set or stimuli.file else ""
        raise BenchError(
            f"table of trials must have a column 'height_um' or another length that begins with height, or "
            f"`stimuli.file` the stimulus set{missing} [{session.table}]"
        )
    faces = {part.id: part.counterface() for part in load_declared(path).stimuli if part.crossed}
    return {name: 1e6 * face.height for name, face in faces.items() if isinstance(face, Step)}
