"""What a command reports when it is done, how it is shown, and what it may replace."""

import atexit
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.build.manifest import hash_file
from stepblocks.files.atomic import protect_files, replace_text
from stepblocks.quantities import format_column, format_column_label, format_units

if TYPE_CHECKING:
    from rich.console import RenderableType

_WIDTH = 100  # columns of a table where the environment names no width
_MEMORY = ".stepblocks.json"  # in a folder: hashes of the files that commands wrote there


@dataclass
class Outcome:
    """What a command did and found.

    Attributes
    ----------
    summary : str
        One sentence.
    tables : dict
        Rows by the title of their table.
    notes : sequence of str
        Lines printed before the summary.
    page : Path, optional
        The page or picture to open.
    code : int
        Exit code.
    record : object, optional
        What ``--json`` prints, where it is not all of the above.
    failures : sequence of str
        Lines printed to the error stream, whatever was asked.
    kept : sequence of Path
        Files of an earlier run that were found whole.
    """

    summary: str
    tables: dict[str, Sequence[Mapping[str, object]]] = field(default_factory=dict)
    notes: Sequence[str] = ()
    page: Path | None = None
    code: int = 0
    record: object = None
    failures: Sequence[str] = ()
    kept: Sequence[Path] = ()


def show(
    outcome: Outcome, written: Sequence[Path], *, quiet: bool, as_json: bool, wide: bool
) -> None:
    """Print an outcome: as JSON, as nothing, or as tables with what was written where."""
    if as_json:
        record = outcome.record
        if record is None:
            record = {
                "summary": outcome.summary,
                "said": outcome.summary,  # the old name, until version 2
                **outcome.tables,
                "written": [str(path) for path in written],
            }
        print(json.dumps(record, indent=1, allow_nan=False, default=str))
        return
    if not quiet:
        for title, rows in outcome.tables.items():
            print_table(title, rows, wide=wide)
        for note in outcome.notes:
            _print(note)
        if outcome.summary:
            _print(outcome.summary, "bold" if outcome.code == 0 else "bold red")
        if written:
            _print(_describe_written(written), "dim")
        if outcome.page is not None:
            _print(f"open {outcome.page}", "cyan")
    for failure in outcome.failures:
        print(format_units(failure), file=sys.stderr)


def _describe_written(written: Sequence[Path]) -> str:
    # List a few files by name, and many by their folders
    folders = {path.parent for path in written}
    if len(written) <= 4:
        return "written: " + " ".join(map(str, written))
    return f"written: {len(written)} files in {os.path.commonpath(folders)}" + (
        f", {len(folders)} folders" if len(folders) > 1 else ""
    )


def _print(content: "RenderableType", style: str | None = None, width: int | None = None) -> None:
    # Print through rich, but by our own stream, whose early end `main` handles
    from rich.console import Console

    console = Console(width=width, highlight=False, soft_wrap=width is None)
    with console.capture() as captured:
        console.print(
            format_units(content) if isinstance(content, str) else content,
            style=style,
            markup=False,
        )
    sys.stdout.write(captured.get())


def print_table(title: str, rows: Sequence[Mapping[str, object]], *, wide: bool = False) -> None:
    """Print rows as columns; one line names what is alike in all, another what did not fit."""
    from rich.table import Table
    from rich.text import Text

    if not rows:
        return
    cells = {
        # a limit is what was agreed, not a figure to be rounded
        name: format_column(
            [row.get(name) for row in rows], exact=name.startswith(("lower", "upper"))
        )
        for name in rows[0]
    }
    heads = {name: format_column_label(name) for name in cells}
    # what is alike in all rows is said once
    alike = {
        name: column[0]
        for name, column in cells.items()
        if len(rows) > 1 and not wide and len({*column}) == 1
    }
    width = 10_000 if wide else int(os.environ.get("COLUMNS", "0") or 0) or _WIDTH
    names = _choose_columns(cells, heads, alike, width)
    constants = (
        f"{heads[name].replace(',', '')} {value}"
        for name, value in alike.items()
        if value not in ("", "-")
    )
    if title:
        _print(title, "bold")
    if same := ", ".join(constants):
        _print(same, "dim")
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for name in names:
        is_number = not any(cell.strip("-+.e∞0123456789") for cell in cells[name])
        table.add_column(
            Text(heads[name].replace(" ", "\n")),
            justify="right" if is_number else "left",
            no_wrap=True,
            vertical="bottom",
        )
    for row in zip(*(cells[name] for name in names), strict=True):
        table.add_row(*map(Text, row))
    _print(table, width=width)
    if more := len(cells) - len(alike) - len(names):
        print(f"({more} more columns: --wide)", file=sys.stderr)


def _choose_columns(
    cells: Mapping[str, Sequence[str]],
    heads: Mapping[str, str],
    alike: Mapping[str, str],
    width: int,
) -> list[str]:
    # Choose the columns that fit the width, at least one
    left = width + 2
    names = list[str]()
    for name in (name for name in cells if name not in alike):
        left -= max(map(len, (*heads[name].split(), *cells[name]))) + 2
        if left >= 0 or not names:
            names.append(name)
    return names


def make_progress(label: str, *, quiet: bool, lines: int = 0) -> Callable[..., None]:
    """Return a function that shows how far a command is.

    It is called with done, total and a name, and draws a bar on a terminal; elsewhere it prints at
    most so many lines. What is done is counted where the caller does not.
    """
    number = count(1)

    def print_line(done: int | None = None, total: int | None = None, name: str = "") -> None:
        done = done or next(number)
        of = "" if total is None else f"/{total}"
        is_due = lines and (
            total is None or total <= lines or done % (total // lines) == 0 or done == total
        )
        if is_due and not quiet:
            print(f"[{done}{of}] {label} {name}".rstrip(), file=sys.stderr, flush=True)

    if quiet or not sys.stderr.isatty():
        return print_line

    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    bar = Progress(
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}", markup=False),
        console=Console(stderr=True),
        transient=True,
    )
    task = bar.add_task(label, total=None)
    atexit.register(bar.stop)  # also where the command fails: a terminal must get its cursor back

    def draw_bar(done: int | None = None, total: int | None = None, name: str = "") -> None:
        bar.start()
        bar.update(task, completed=done or next(number), total=total, description=f"{label} {name}")
        if bar.finished:
            bar.stop()

    return draw_bar


@contextmanager
def protect_output(place: object, *, force: bool) -> Iterator[list[Path]]:
    """Let a command write to a place, but replace no file there that is not ours.

    Gives the list of written files; the command adds to it what it found and kept, and afterwards
    it names what was written. What a build wrote stands in its ``manifest.json``; what another
    command wrote, in ``.stepblocks.json`` with its hash, so that a table which somebody filled in
    since is theirs.
    """
    written: list[Path] = []
    if not isinstance(place, Path):
        yield written
        return
    folder = _find_folder(place)
    before = {path: _read_stamp(path) for path in _list_files(place)}
    built = _read_hashes(folder / "manifest.json", "outputs")
    known = _read_hashes(folder / _MEMORY, "written")

    def is_protected(path: Path) -> bool:
        if force or path not in before:
            return False
        name = path.relative_to(folder).as_posix()
        return name not in built and name != "manifest.json" and known.get(name) != hash_file(path)

    try:
        with protect_files(is_protected):
            yield written
    finally:
        kept = written[:]
        written[:] = sorted(
            path for path in _list_files(place) if before.get(path) != _read_stamp(path)
        )
        _record_hashes(_find_folder(place), [*written, *kept])


def _find_folder(place: Path) -> Path:
    # Return the folder that a place names or, of a file, written or to be written, lies in
    return place.parent if place.is_file() or (place.suffix and not place.is_dir()) else place


def _list_files(place: Path) -> list[Path]:
    return [
        path
        for path in (place.rglob("*") if place.is_dir() else [place])
        if path.is_file() and path.name != _MEMORY
    ]


def _read_stamp(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_mtime_ns, found.st_size


def _read_hashes(file: Path, key: str) -> dict[str, str]:
    # Read hashes of files by their names
    try:
        return dict(json.loads(file.read_text(encoding="utf-8"))[key])
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _record_hashes(folder: Path, written: Sequence[Path]) -> None:
    # Keep the hashes of what was written, but for the files that a build's manifest names
    built = _read_hashes(folder / "manifest.json", "outputs") | {"manifest.json": ""}
    known = _read_hashes(folder / _MEMORY, "written")
    fresh = {path.relative_to(folder).as_posix(): hash_file(path) for path in written}
    total = {
        name: one
        for name, one in {**known, **fresh}.items()
        if name not in built and (folder / name).is_file()
    }
    if known and not total:
        (folder / _MEMORY).unlink()
    elif total != known:
        replace_text(
            folder / _MEMORY,
            json.dumps({"written": dict(sorted(total.items()))}, indent=1) + "\n",
        )
