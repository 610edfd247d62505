"""The table of trials, row by row.

Columns have the names and units that an analysis asks for.
"""

import csv
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import pandas as pd

from stepblocks.bench.session import (
    Channel,
    Session,
    TrialColumns,
    find_unit_in_name,
    resolve_inside,
)
from stepblocks.errors import BenchError
from stepblocks.files.tables import escape_formula
from stepblocks.files.text import is_file
from stepblocks.mistakes import Mistake, collect_mistakes, format_mistakes

_HEIGHT = re.compile(r"(step_?)?height", re.IGNORECASE)
_STAMP = (
    r"\d{4}-\d\d?-\d\d?|\d\d?[./]\d\d?[./]\d{2,4}|\d\d?:\d\d"  # how a date or a time of day begins
)
_STAMPS = 0.9  # share of the cells of a column that must be date and time
_NAMES = {"block": "block", "load": "load_n", "speed": "speed_mm_s", "height": "height_um"}
_COMMENT = re.compile(r"\s*#\D")
_MOST_COLUMNS = 1000


@dataclass(frozen=True)
class Trial:
    """One row of the table of trials; not-a-number and empty where the table has no such column.

    Attributes
    ----------
    name : str
        As the table writes it.
    row : int
        Counted from 1 below the header.
    cells : dict[str, str]
        Every cell of the row, as written.
    speed : float
        Of the handle [m/s].
    load : float
        Normal load that the weights set [N].
    block : str
    fault : str
        Why the row cannot be used; empty where it can.
    record : str
        Name of the trial whose record belongs to the row: another where session.toml swaps them.
    """

    name: str
    row: int
    cells: dict[str, str] = field(default_factory=dict)
    speed: float = math.nan
    load: float = math.nan
    block: str = ""
    fault: str = ""
    record: str = ""


@dataclass(frozen=True)
class TrialTable:
    """A table of trials that was looked through once.

    Attributes
    ----------
    session : Session
    header : tuple[str, ...]
    key : str
        Name of the column that names the trial.
    count : int
        Of its rows.
    repeated : dict[int, str]
        Rows, from 1, whose trial another row has, and what is wrong with that.
    excluded : frozenset of str
        Trials that session.toml leaves out.
    swapped : mapping of str to str
        Trials whose records session.toml exchanges.
    """

    session: Session
    header: tuple[str, ...]
    key: str
    count: int
    repeated: dict[int, str]
    excluded: frozenset[str] = frozenset()
    swapped: Mapping[str, str] = field(default_factory=dict)

    @property
    def covariates(self) -> tuple[str, ...]:
        """Columns but that of the trial, as the table names them."""
        return tuple(column for column in self.header if column != self.key)

    def __iter__(self) -> Iterator[Trial]:
        columns = self.session.trials.columns
        read = [
            (
                str(one.column),
                one.scale(dimension, "trials.columns"),
                one.offset_in_si(dimension, "trials.columns"),
            )
            for one, dimension in ((columns.speed, "speed"), (columns.load, "force"))
        ]
        for number, cells in _read_rows(self.session):
            named = dict(zip(self.header, cells + [""] * len(self.header), strict=False))
            name = named[self.key].strip()
            fault = (
                self.repeated.get(
                    number, "" if name else f"row {number} of the table names no trial"
                )
                if len(cells) == len(self.header)
                else f"row {number} of the table has {len(cells)} cells, the header has "
                f"{len(self.header)}"
            )
            if name in self.excluded:
                fault = "left out by `trials.exclude` of session.toml"
            trial = Trial(
                name,
                number,
                named,
                block=named.get(str(columns.block.column), "").strip(),
                fault=fault,
                record=self.swapped.get(name, name),
            )
            try:
                speed, load = (self._read_number(named, *one) for one in read)
                yield replace(trial, speed=speed, load=load)
            except ValueError as error:
                yield replace(trial, fault=fault or str(error))

    def _read_number(
        self, cells: dict[str, str], column: str, scale: float, offset: float
    ) -> float:
        if column not in cells:
            return math.nan
        text = cells[column].strip().replace(self.session.trials.decimal, ".")
        try:
            value = float(text)
        except ValueError:
            raise ValueError(f"{column} must be a number, got {text[:40]!r}") from None
        if not math.isfinite(value) or value <= 0.0:
            raise ValueError(f"{column} must be positive and finite, got {text[:40]}")
        return value * scale - offset


def open_trials(session: Session, reserved: frozenset[str] = frozenset()) -> TrialTable:
    """Read the table of trials once: header, number of rows, duplicates.

    Only the names of its rows are kept.
    """
    columns = session.trials.columns
    header = tuple(cell.strip() for cell in next(_read_lines(session), []))
    BenchError.require(any(header), f"table of trials is empty [{session.table}]")
    BenchError.require(
        len(header) <= _MOST_COLUMNS,
        f"table of trials must have at most {_MOST_COLUMNS} columns, got {len(header)}",
    )
    required = (
        "trial",
        *(
            part
            for part in ("speed", "load", "block", "height")
            if part in columns.model_fields_set
        ),
    )
    found: dict[str, str] = {}
    mistakes: list[Mistake] = [
        ("", f"table of trials names the column {name!r} twice")
        for name in dict.fromkeys(name for name in header if header.count(name) > 1)
    ]
    for part in required:
        with collect_mistakes(mistakes):
            found[part] = find_column(getattr(columns, part).column, header, part)
    mistakes += [
        ("", f"column `{name}` of the table of trials has a name that features use")
        for name in sorted(set(header) & reserved - {found.get("trial")})
    ]
    BenchError.require(not mistakes, format_mistakes(mistakes, session.table))
    count = 0
    index = header.index(found["trial"])
    homes: dict[
        str, tuple[int, int]
    ] = {}  # of a trial its first row, and what tells that from another
    repeated: dict[int, str] = {}
    for count, cells in _read_rows(session):
        if index >= len(cells) or not (name := cells[index].strip()):
            continue
        whole = hash(tuple(cells))
        home, first = homes.setdefault(name, (count, whole))
        if home != count and first == whole:
            repeated[count] = "duplicate: an earlier row has this trial with the same conditions"
        elif home != count:
            repeated |= dict.fromkeys(
                (home, count), "duplicate: another row has this trial with other conditions"
            )
    BenchError.require(count != 0, f"table of trials has no rows [{session.table}]")
    excluded, swap = session.trials.exclude, session.trials.swap
    named = {
        # 73 may be written 0073 in the table; empty where no trial is called so
        name: next(
            (
                one
                for one in homes
                if one == str(name) or (one.isdigit() and one.lstrip("0") == str(name))
            ),
            "",
        )
        for name in (*excluded, *(one for pair in swap for one in pair))
    }
    pairs = [(named[one], named[other]) for one, other in swap]
    known = [name for pair in pairs for name in pair if name]
    mistakes = [
        ("", f"`trials.exclude` and `trials.swap` must name trials of the table, got {name!r}")
        for name in named
        if not named[name]
    ]
    if len(set(known)) < len(known):
        rule = "`trials.swap` must be pairs of two trials, none of them in two pairs"
        mistakes.append(("", f"{rule}, got {[list(pair) for pair in swap]}"))
    BenchError.require(not mistakes, format_mistakes(mistakes, session.folder / "session.toml"))
    return TrialTable(
        session,
        header,
        found["trial"],
        count,
        repeated,
        excluded=frozenset(named[name] for name in excluded),
        swapped={one: other for pair in pairs for one, other in (pair, pair[::-1])},
    )


def find_column(column: str | int, header: tuple[str, ...], part: str) -> str:
    """Name of a declared column, or say which there are."""
    if isinstance(column, int) and 0 <= column < len(header):
        return header[column]
    BenchError.require(
        column in header,
        f"table of trials must have a column {column!r} for the {part}, it has "
        + ", ".join(map(repr, header[:12])),
    )
    return str(column)


def _read_rows(session: Session) -> Iterator[tuple[int, list[str]]]:
    # Rows below the header, from 1; empty lines are none
    yield from enumerate(
        (
            cells
            for cells in islice(_read_lines(session), 1, None)
            if any(cell.strip() for cell in cells)
        ),
        start=1,
    )


def _read_lines(session: Session) -> Iterator[list[str]]:
    with session.table.open(newline="", encoding="utf-8-sig") as file:
        try:
            yield from (
                cells
                for cells in csv.reader(file, delimiter=session.trials.delimiter)
                if not _COMMENT.match("".join(cells[:1]))
            )
        except (csv.Error, UnicodeDecodeError) as error:
            raise BenchError(
                f"table of trials must be CSV in UTF-8: {error} [{session.table}]"
            ) from error


def read_conditions(session: Session) -> dict[str, tuple[str, pd.Series]]:
    """Read what an analysis needs beside the forces.

    The result gives, by name, the column that it replaces and one value per trial.
    """
    # What the table already has under that name and in that unit is left out.

    table = open_trials(session)
    columns = session.trials.columns
    usual = TrialColumns()
    rows = list(table)
    named = {
        key: find_column(getattr(columns, key).column, table.header, key)
        for key in _NAMES
        if key != "height"
    }
    named["height"], heights = find_heights(session, table.header, rows)
    values = pd.DataFrame(
        {
            "block": [row.block for row in rows],
            "load": [row.load for row in rows],
            "height": heights,
            "speed": [1e3 * row.speed for row in rows],
        }
    )
    found = {
        name: (named[part], values[part])
        for part, name in _NAMES.items()
        if named[part] != name
        or getattr(columns, part) != getattr(usual, part)
        or session.trials.decimal != "."
    }
    for column in (name for name in table.covariates if name not in named.values()):
        text = pd.Series([row.cells.get(column, "").strip() for row in rows])
        if (
            session.trials.decimal == ","
            and text.str.fullmatch(r"[-+]?\d*,?\d+([eE][-+]?\d+)?|").all()
        ):
            found[column] = (column, pd.to_numeric(text.str.replace(",", ".")))
        elif text.str.match(_STAMP).mean() > _STAMPS:
            stamps = pd.to_datetime(
                text,
                errors="coerce",
                format="mixed",
                dayfirst=bool(text.str.match(r"\d\d?\.").any()),
            )
            if stamps.notna().mean() > _STAMPS:
                found[f"{column}_elapsed_s"] = (column, (stamps - stamps.min()).dt.total_seconds())
    return found


def insert_conditions(
    features: pd.DataFrame, conditions: dict[str, tuple[str, pd.Series]]
) -> pd.DataFrame:
    """Return a table of features with `conditions` in place of the columns they come from."""
    table = features.copy()
    for name, (column, values) in conditions.items():
        source = escape_formula(column)
        there = list(table.columns)
        place = there.index(source) if source in there else there.index("sliding_friction")
        table = table.drop(columns=[one for one in {source, name} if one in there])
        table.insert(min(place, len(table.columns)), name, values.to_numpy())
    return table


def find_heights(
    session: Session, header: tuple[str, ...], rows: list[Trial]
) -> tuple[str, list[float]]:
    """Column of the heights and their values [um]; of the stimulus set where the table has none."""
    channel = session.trials.columns.height
    if "height" in session.trials.columns.model_fields_set:
        find_column(channel.column, header, "height")
    elif channel.column not in header:
        others = [
            name for name in header if _HEIGHT.match(name) and find_unit_in_name(name, "length")
        ]
        if not others:
            heights = _read_declared_heights(session)
            return "", [heights.get(row.block, math.nan) for row in rows]
        channel = Channel(column=others[0])
    name = find_column(channel.column, header, "height")
    place = "trials.columns.height"
    scale, off = (
        1e6 * channel.scale("length", place),
        1e6 * channel.offset_in_si("length", place),
    )
    texts = [row.cells.get(name, "").strip().replace(session.trials.decimal, ".") for row in rows]
    return name, (pd.to_numeric(pd.Series(texts), errors="coerce") * scale - off).tolist()


def _read_declared_heights(session: Session) -> dict[str, float]:
    # Heights of the blocks of the stimulus set by their names [um]
    from stepblocks.contact.counterface import Step
    from stepblocks.declaration.read import load_set

    stimuli = session.stimuli
    path = (
        resolve_inside(session.folder, stimuli.file, "stimuli.file")
        if stimuli.file
        else Path("stimuli") / f"{stimuli.set}.toml"
    )
    named = stimuli.set or stimuli.file
    BenchError.require(
        named and is_file(path),
        "table of trials must have a column 'height_um' or another length that begins with height, "
        f"or `stimuli.file` the stimulus set{f', and there is no {path}' if named else ''} "
        f"[{session.table}]",
    )
    faces = {part.id: part.counterface() for part in load_set(path).stimuli if part.crossed}
    return {name: 1e6 * face.height for name, face in faces.items() if isinstance(face, Step)}
