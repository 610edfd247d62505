"""What a command tells when it is done, how it is shown, and what it may replace."""

import argparse
import atexit
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from stepblocks.build.manifest import hash_file
from stepblocks.quantities import format_column, format_column_label, format_units

_WIDTH = 100  # columns of a table where nobody asked for more
_MEMORY = ".stepblocks.json"  # in a folder: hashes of the files that commands wrote there


@dataclass
class Outcome:
    """What a command did and found."""

    said: str  # one sentence
    tables: dict[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)  # rows by title
    notes: Sequence[str] = ()
    look: Path | None = None  # what to open
    code: int = 0
    record: Any = None  # what ``--json`` prints, where it is not all of the above
    failures: Sequence[str] = ()  # printed whatever was asked, to the error stream
    kept: Sequence[Path] = ()  # files of an earlier run that were found whole


def show(outcome: Outcome, arguments: argparse.Namespace, written: Sequence[Path]) -> None:
    """Print an outcome: as JSON, as nothing, or as tables with what was written where."""
    if arguments.json:
        told = outcome.record
        if told is None:
            told = {
                "said": outcome.said,
                **outcome.tables,
                "written": [str(path) for path in written],
            }
        print(json.dumps(told, indent=1, allow_nan=False, default=str))
        return
    if not arguments.quiet:
        for title, rows in outcome.tables.items():
            print_table(title, rows, wide=arguments.wide)
        for note in outcome.notes:
            _print(note)
        if outcome.said:
            _print(outcome.said, "bold" if outcome.code == 0 else "bold red")
        if written:
            _print(_where(written), "dim")
        if outcome.look is not None:
            _print(f"open {outcome.look}", "cyan")
    for failure in outcome.failures:
        print(format_units(failure), file=sys.stderr)


def _where(written: Sequence[Path]) -> str:
    """Say files by their folders."""
    folders = {path.parent for path in written}
    top = Path(os.path.commonpath(folders))
    if len(written) <= 4:
        return "written: " + " ".join(map(str, written))
    return f"written: {len(written)} files in {top}" + (
        f", {len(folders)} folders" if len(folders) > 1 else ""
    )


def _print(shown: Any, style: str | None = None, width: int | None = None) -> None:
    """Print something through rich, but by our own stream, whose end `main` knows to meet."""
    from rich.console import Console

    console = Console(width=width, highlight=False, soft_wrap=width is None)
    with console.capture() as captured:
        console.print(
            format_units(shown) if isinstance(shown, str) else shown, style=style, markup=False
        )
    sys.stdout.write(captured.get())


def print_table(title: str, rows: Sequence[Mapping[str, Any]], *, wide: bool = False) -> None:
    """Print rows as columns; of what is alike in all of them and of what does not fit, a line tells."""
    from rich.table import Table
    from rich.text import Text

    if not rows:
        return
    cells = {name: format_column([row.get(name) for row in rows]) for name in rows[0]}
    heads = {name: format_column_label(name) for name in cells}
    alike = (
        {}
        if wide or len(rows) < 2
        else {name: column[0] for name, column in cells.items() if len({*column}) == 1}
    )
    room = 10_000 if wide else int(os.environ.get("COLUMNS", "0") or 0) or _WIDTH
    left, names = room + 2, list[str]()
    for name in (name for name in cells if name not in alike):
        left -= max(map(len, (*heads[name].split(), *cells[name]))) + 2
        if left >= 0 or not names:
            names.append(name)
    said = (
        f"{heads[name].replace(',', '')} {value}"
        for name, value in alike.items()
        if value not in ("", "-")
    )
    same = ", ".join(said)
    for line in (title, same):
        if line:
            _print(line, "bold" if line is title else "dim")
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for name in names:
        head = Text(heads[name].replace(" ", "\n"))
        table.add_column(
            head,
            justify="right"
            if not any(cell.strip("-+.e∞0123456789") for cell in cells[name])
            else "left",
            no_wrap=True,
            vertical="bottom",
        )
    for row in zip(*(cells[name] for name in names), strict=True):
        table.add_row(*map(Text, row))
    _print(table, width=room)
    if more := len(cells) - len(alike) - len(names):
        print(f"({more} more columns: --wide)", file=sys.stderr)


def telling(arguments: argparse.Namespace, did: str, *, lines: int = 0) -> Callable[..., None]:
    """Return what shows how far a command is, called with done, total and a name: a bar on a terminal, elsewhere so many lines."""
    # What is done is counted where the caller does not.
    quiet, number = arguments.quiet or arguments.json, count(1)

    def in_lines(done: int | None = None, total: int | None = None, name: str = "") -> None:
        done, of = done or next(number), "" if total is None else f"/{total}"
        some = lines and (
            total is None or total <= lines or done % (total // lines) == 0 or done == total
        )
        if some and not quiet:
            print(f"[{done}{of}] {did} {name}".rstrip(), file=sys.stderr, flush=True)

    if quiet or not sys.stderr.isatty():
        return in_lines

    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}", markup=False),
    )
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task(did, total=None)
    atexit.register(bar.stop)  # also where the command fails: a terminal must get its cursor back

    def on_terminal(done: int | None = None, total: int | None = None, name: str = "") -> None:
        bar.start()
        bar.update(task, completed=done or next(number), total=total, description=f"{did} {name}")
        if bar.finished:
            bar.stop()

    return on_terminal


@contextmanager
def writing(place: Path | None, force: bool) -> Iterator[list[Path]]:
    """Let a command write to a place, but replace nothing there that is not ours; gives the list of what it wrote."""
    # To that list the command adds what it found and kept; afterwards it names what was written.
    # What a build wrote stands in its ``manifest.json``; what another command wrote in
    # ``.stepblocks.json`` with its hash, so that a table somebody filled in since is theirs.
    from stepblocks.atomic import protect_files

    written: list[Path] = []
    if place is None:
        yield written
        return
    folder = place.parent if place.suffix and not place.is_dir() else place
    before = {path: _stamp(path) for path in _files(place)}
    built, known = _names(folder / "manifest.json", "outputs"), _names(folder / _MEMORY, "written")

    def theirs(path: Path) -> bool:
        if force or path not in before:
            return False
        name = path.relative_to(folder).as_posix()
        return name not in built and name != "manifest.json" and known.get(name) != hash_file(path)

    try:
        with protect_files(theirs):
            yield written
    finally:
        kept, written[:] = (
            written[:],
            sorted(path for path in _files(place) if before.get(path) != _stamp(path)),
        )
        _remember(folder, known, [*written, *kept])


def _files(place: Path) -> list[Path]:
    found = place.rglob("*") if place.is_dir() else [place]
    return [path for path in found if path.is_file() and path.name != _MEMORY]


def _stamp(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_mtime_ns, found.st_size


def _names(file: Path, key: str) -> dict[str, str]:
    """Read hashes of files by their names."""
    try:
        return dict(json.loads(file.read_text(encoding="utf-8"))[key])
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _remember(folder: Path, known: Mapping[str, str], written: Sequence[Path]) -> None:
    """Keep the hashes of what was written, where no manifest of a build does; what it has come to name is left to it."""
    from stepblocks.atomic import replace_text

    built = _names(folder / "manifest.json", "outputs") | {"manifest.json": ""}
    fresh = {path.relative_to(folder).as_posix(): hash_file(path) for path in written}
    every = {**known, **fresh}.items()
    total = {name: one for name, one in every if name not in built and (folder / name).is_file()}
    if known and not total:
        (folder / _MEMORY).unlink()
    elif total != known:
        replace_text(
            folder / _MEMORY, json.dumps({"written": dict(sorted(total.items()))}, indent=1) + "\n"
        )
