"""What a command reports when it is done, how it is shown, and what it may replace."""

import atexit
import json
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.build.manifest import hash_file
from stepblocks.errors import PipelineError, ReadingWarning
from stepblocks.files.atomic import protect_files, replace_text
from stepblocks.files.progress import PROGRESS_FILE, ProgressStep, append_progress_step
from stepblocks.quantities import format_column, format_column_label, format_units

if TYPE_CHECKING:
    from rich.console import JustifyMethod, RenderableType

_WIDTH = 100  # letters of a line where the environment names no width
_UNLIMITED = 10_000  # letters of a line that is never broken
_GAP = 2  # letters between two columns
_LEAST_PERIOD = 0.1  # between two steps of progress that are written [s]
_FEW_FILES = 4  # that are named one by one
_EMPTY_CELLS = ("", "-")
_LETTERS_OF_NUMBERS = "-+.e∞0123456789"
_MEMORY = ".stepblocks.json"  # in a folder: hashes of the files that commands wrote there


@dataclass(frozen=True)
class ReadingNote:
    """What readers found out about some files, the same of each."""

    note: str
    files: tuple[str, ...]

    def __str__(self) -> str:
        """Name the first file, and count the others."""
        return f"note: {self.note} [{name_first_of_several(self.files)}]"

    def as_record(self) -> dict[str, object]:
        """Return plain data."""
        return {"note": self.note, "files": list(self.files)}


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
    reading : sequence of ReadingNote, optional
        What readers found out about their files; None of a command that reads no tables.
    """

    summary: str
    tables: dict[str, Sequence[Mapping[str, object]]] = field(default_factory=dict)
    notes: Sequence[str] = ()
    page: Path | None = None
    code: int = 0
    record: object = None
    failures: Sequence[str] = ()
    kept: Sequence[Path] = ()
    reading: "Sequence[ReadingNote] | None" = None


def name_first_of_several(names: Sequence[str]) -> str:
    """Name the first of several, and count the others."""
    if len(names) == 1:
        return names[0]
    return f"{names[0]} and {len(names) - 1} more"


def format_count(count: int, noun: str) -> str:
    """Write how many there are of what a noun names, such as "2 parts"."""
    if count == 1:
        return f"1 {noun}"
    return f"{count} {noun}s"


def show_outcome(
    outcome: Outcome, written: Sequence[Path], *, quiet: bool, as_json: bool, wide: bool
) -> None:
    """Print an outcome: as JSON, as nothing, or as tables with what was written where."""
    if as_json:
        record = outcome.record
        if record is None:
            record = _build_default_record(outcome, written)
        if outcome.reading and isinstance(record, Mapping):
            reading = [note.as_record() for note in outcome.reading]
            record = {**record, "reading": reading}
        print(json.dumps(record, indent=1, allow_nan=False, default=str))
        return
    if not quiet:
        _print_outcome(outcome, written, wide=wide)
    for failure in outcome.failures:
        print(format_units(failure), file=sys.stderr)


def _build_default_record(outcome: Outcome, written: Sequence[Path]) -> dict[str, object]:
    """Return what ``--json`` prints of a command that has no record of its own."""
    return {
        "summary": outcome.summary,
        "said": outcome.summary,  # the old name, until version 2
        **outcome.tables,
        "written": list(map(str, written)),
    }


def _print_outcome(outcome: Outcome, written: Sequence[Path], *, wide: bool) -> None:
    """Print tables, notes, summary, the files that were written and the page to open."""
    for title, rows in outcome.tables.items():
        print_table(title, rows, wide=wide)
    for found in outcome.reading or ():
        _print_with_rich(str(found))
    for note in outcome.notes:
        _print_with_rich(note)
    if outcome.summary:
        style = "bold"
        if outcome.code != 0:
            style = "bold red"
        _print_with_rich(outcome.summary, style)
    if written:
        _print_with_rich(_describe_written_files(written), "dim")
    if outcome.page is not None:
        _print_with_rich(f"open {outcome.page}", "cyan")


def _describe_written_files(written: Sequence[Path]) -> str:
    """List a few files by name, and many by their folders."""
    if len(written) <= _FEW_FILES:
        return "written: " + " ".join(map(str, written))
    folders = {path.parent for path in written}
    text = f"written: {len(written)} files in {os.path.commonpath(folders)}"
    if len(folders) > 1:
        text += f", {len(folders)} folders"
    return text


def _print_with_rich(
    content: "RenderableType", style: str | None = None, width: int | None = None
) -> None:
    """Print through rich, but by our own stream, whose early end `main` handles."""
    from rich.console import Console

    console = Console(width=width, highlight=False, soft_wrap=width is None)
    if isinstance(content, str):
        content = format_units(content)
    with console.capture() as captured:
        console.print(content, style=style, markup=False)
    sys.stdout.write(captured.get())


@dataclass(frozen=True)
class _Column:
    """A column of a table as it is printed."""

    name: str  # in the file
    cells: Sequence[str]

    @property
    def head(self) -> str:
        """What stands above it, with the unit."""
        return format_column_label(self.name)

    @property
    def width(self) -> int:
        """Its widest word or cell [letters]; a head is broken at its spaces."""
        return max(map(len, (*self.head.split(), *self.cells)))

    @property
    def is_number(self) -> bool:
        """Whether all its cells are numbers."""
        return not any(cell.strip(_LETTERS_OF_NUMBERS) for cell in self.cells)


def print_table(title: str, rows: Sequence[Mapping[str, object]], *, wide: bool = False) -> None:
    """Print rows as columns; one line names what all rows share, another what did not fit."""
    if not rows:
        return
    columns = [_make_printed_column(name, rows) for name in rows[0]]
    width = _UNLIMITED
    if not wide:
        width = _find_line_width()
    constants, varying = [], []
    for column in columns:
        is_shared = len(rows) > 1 and not wide and len(set(column.cells)) == 1
        if not is_shared:
            varying.append(column)
        elif column.cells[0] not in _EMPTY_CELLS:
            constants.append(f"{column.head.replace(',', '')} {column.cells[0]}")
    shown = _choose_fitting_columns(varying, width)
    if title:
        _print_with_rich(title, "bold")
    if constants:
        _print_with_rich(", ".join(constants), "dim")
    _print_with_rich(_lay_out_table(shown), width=width)
    if len(shown) < len(varying):
        print(f"({len(varying) - len(shown)} more columns: --wide)", file=sys.stderr)


def _make_printed_column(name: str, rows: Sequence[Mapping[str, object]]) -> _Column:
    """Make a column of the cells of a name, formatted; limits are not rounded."""
    # a limit is what was agreed, not a figure to be rounded
    is_limit = name.startswith(("lower", "upper"))
    values = [row.get(name) for row in rows]
    return _Column(name, format_column(values, exact=is_limit))


def _find_line_width() -> int:
    """Return the width of a line [letters]: that of COLUMNS in the environment, else `_WIDTH`."""
    return int(os.environ.get("COLUMNS", "0") or 0) or _WIDTH


def _choose_fitting_columns(columns: Sequence[_Column], width: int) -> list[_Column]:
    """Choose the columns that fit the width, in their order, and at least one."""
    left = width + _GAP
    chosen: list[_Column] = []
    for column in columns:
        left -= column.width + _GAP
        if left >= 0 or not chosen:
            chosen.append(column)
    return chosen


def _lay_out_table(columns: Sequence[_Column]) -> "RenderableType":
    """Lay columns out side by side, numbers to the right."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, _GAP, 0, 0))
    for column in columns:
        justify: JustifyMethod = "left"
        if column.is_number:
            justify = "right"
        head = Text(column.head.replace(" ", "\n"))
        table.add_column(head, justify=justify, no_wrap=True, vertical="bottom")
    cells_of_columns = [column.cells for column in columns]
    for cells in zip(*cells_of_columns, strict=True):
        table.add_row(*map(Text, cells))
    return table


def make_progress(label: str, *, quiet: bool, lines: int = 0) -> Callable[..., None]:
    """Return a function that shows how far a command is.

    It is called with done, total and a name, and draws a bar on a terminal; elsewhere it prints at
    most so many lines. What is done is counted where the caller does not. A program that started
    the command, such as the window, can name a file for the steps in its environment.
    """
    file = os.environ.get(PROGRESS_FILE)
    if file:
        return _make_step_writer(label, Path(file))
    if quiet:
        return _make_line_printer(label, 0)
    if not sys.stderr.isatty():
        return _make_line_printer(label, lines)
    return _make_bar_drawer(label)


def _make_step_writer(label: str, path: Path) -> Callable[..., None]:
    """Return a function that writes each step to a file, at most ten in a second."""
    number = count(1)
    last_time = -math.inf

    def write_step(done: int | None = None, total: int | None = None, name: str = "") -> None:
        nonlocal last_time
        done = done or next(number)
        now = time.monotonic()
        if now - last_time < _LEAST_PERIOD and done != total:
            return
        last_time = now
        append_progress_step(path, ProgressStep(done, total, f"{label} {name}".rstrip()))

    return write_step


def _make_line_printer(label: str, lines: int) -> Callable[..., None]:
    """Return a function that prints at most so many lines of progress, none where that is 0."""
    number = count(1)

    def print_line(done: int | None = None, total: int | None = None, name: str = "") -> None:
        done = done or next(number)
        if not lines or not _is_line_due(done, total, lines):
            return
        of_total = ""
        if total is not None:
            of_total = f"/{total}"
        print(f"[{done}{of_total}] {label} {name}".rstrip(), file=sys.stderr, flush=True)

    return print_line


def _is_line_due(done: int, total: int | None, lines: int) -> bool:
    """Tell whether a line is printed now, so that there are about so many in all."""
    if total is None or total <= lines:
        return True
    return done % (total // lines) == 0 or done == total


def _make_bar_drawer(label: str) -> Callable[..., None]:
    """Return a function that draws a bar on the terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    number = count(1)
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
def collect_reading_notes() -> Iterator[list[ReadingNote]]:
    """Give a list that takes, when the block ends, what readers found out about their files.

    Other warnings go on as they came.
    """
    notes: list[ReadingNote] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ReadingWarning)
        yield notes
    places: dict[str, list[str]] = {}
    for warning in caught:
        message = warning.message
        if isinstance(message, ReadingWarning):
            places.setdefault(message.note, []).append(str(message.place))
        else:
            warnings.warn_explicit(message, warning.category, warning.filename, warning.lineno)
    for note, files in places.items():
        notes.append(ReadingNote(note, tuple(dict.fromkeys(files))))


@contextmanager
def protect_outputs(places: Sequence[Path], *, force: bool) -> Iterator[list[Path]]:
    """Let a command write to places, but replace no file there that is not ours.

    Gives the list of written files; the command adds to it what it found and kept, and afterwards
    it names what was written.
    """
    written: list[Path] = []
    guards = [_OutputGuard(place, force=force) for place in places]

    def is_protected(path: Path) -> bool:
        """Tell whether a file at one of the places was there before and is not ours."""
        return any(guard.is_protected(path) for guard in guards)

    try:
        with protect_files(is_protected):
            yield written
    finally:
        kept = written[:]
        written.clear()
        for guard in guards:
            changed = [path for path in guard.list_changed_files() if path not in written]
            written += changed
            guard.record_written_files([*changed, *kept])


class _OutputGuard:
    """The files at a place to which a command writes, as they were before.

    What a build wrote stands in its ``manifest.json``; what another command wrote, in
    ``.stepblocks.json`` with its hash, so that a table which somebody filled in since is theirs.

    Parameters
    ----------
    place : Path
        A file or a folder; it need not exist.
    force : bool
        Whether files of others may be replaced.
    """

    def __init__(self, place: Path, *, force: bool) -> None:
        self._place = place
        self._force = force
        self._folder = _find_output_folder(place)
        self._before = {path: _read_time_and_size(path) for path in _list_output_files(place)}
        self._built = _read_recorded_hashes(self._folder / "manifest.json", "outputs")
        self._known = _read_recorded_hashes(self._folder / _MEMORY, "written")

    def is_protected(self, path: Path) -> bool:
        """Tell whether a file was there before and is not as a command wrote it."""
        if self._force or path not in self._before:
            return False
        name = path.relative_to(self._folder).as_posix()
        if name in self._built or name == "manifest.json":
            return False
        return self._known.get(name) != hash_file(path)

    def list_changed_files(self) -> list[Path]:
        """List the files that are new, or not as they were."""
        changed = []
        for path in sorted(_list_output_files(self._place)):
            if self._before.get(path) != _read_time_and_size(path):
                changed.append(path)
        return changed

    def record_written_files(self, written: Sequence[Path]) -> None:
        """Note which files in the folder are ours."""
        folder = _find_output_folder(self._place)
        inside = [path for path in written if path.is_relative_to(folder)]
        _remember_written_files(folder, inside)


def refuse_input_as_output(outputs: Mapping[str, Path], inputs: Sequence[Path]) -> None:
    """Refuse an output that would replace a file that the command reads, or another output.

    Parameters
    ----------
    outputs : mapping of str to Path
        Files to write by the options that name them, whether they are there or not.
    inputs : sequence of Path
        What is read.

    Raises
    ------
    PipelineError
        Also where the file is ours: what is read is never replaced by what is made of it.
    """
    option_by_place: dict[Path, str] = {}
    for option, output in outputs.items():
        if any(_is_same_file(output, path) for path in inputs):
            raise PipelineError(f"output must not replace what the command reads [{output}]")
        first = option_by_place.setdefault(output.resolve(), option)
        if first != option:
            raise PipelineError(f"{option} must be another file than {first}, got {str(output)!r}")


def _is_same_file(first: Path, second: Path) -> bool:
    """Tell whether two paths lead to one file that is there."""
    try:
        return first.is_file() and first.samefile(second)
    except OSError:  # the other is not there, or its name is too long
        return False


def _find_output_folder(output: Path) -> Path:
    """Return the folder that a place names; of a file, written or to be written, its folder."""
    is_file = output.is_file() or (output.suffix and not output.is_dir())
    if is_file:
        return output.parent
    return output


def _list_output_files(output: Path) -> list[Path]:
    """List the files at a place, but for our own note of what was written there."""
    paths = [output]
    if output.is_dir():
        paths = list(output.rglob("*"))
    return [path for path in paths if path.is_file() and path.name != _MEMORY]


def _read_time_and_size(path: Path) -> tuple[int, int]:
    """Return when a file was changed [ns] and its size [bytes]."""
    found = path.stat()
    return found.st_mtime_ns, found.st_size


def _read_recorded_hashes(file: Path, key: str) -> dict[str, str]:
    """Read hashes of files by their names; none where there is no such file."""
    try:
        return dict(json.loads(file.read_text(encoding="utf-8"))[key])
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _remember_written_files(folder: Path, written: Sequence[Path]) -> None:
    """Record the hashes of written files in a note in the folder, for `protect_outputs`.

    Files that a build's manifest names are left out.
    """
    built = _read_recorded_hashes(folder / "manifest.json", "outputs")
    before = _read_recorded_hashes(folder / _MEMORY, "written")
    hashes = dict(before)
    for path in written:
        hashes[path.relative_to(folder).as_posix()] = hash_file(path)
    kept = {}
    for name, digest in sorted(hashes.items()):
        if name not in built and name != "manifest.json" and (folder / name).is_file():
            kept[name] = digest
    if before and not kept:
        (folder / _MEMORY).unlink()
    elif kept != before:
        text = json.dumps({"written": kept}, indent=1)
        replace_text(folder / _MEMORY, text + "\n")
