"""What lies in the folder of the window, by kind; no name leads out of it."""

import os
import secrets
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import islice
from pathlib import Path
from urllib.parse import quote

from stepblocks.errors import PipelineError
from stepblocks.files.paths import describe_system_error, resolve_inside
from stepblocks.mistakes import shorten_value
from stepblocks.window import texts

OUTPUT = "out"  # folder that builds of a window are written to
_DEEPEST = 4  # folders that are looked into
_MOST = 2000  # files and folders of a kind that are shown
_MOST_SEEN = 50_000  # files and folders that are looked at
_LARGEST_DECLARATION = 1_000_000  # [bytes]

# what makes a folder one of a kind
_SESSION_FILE = "session.toml"
_STUDY_FILE = "design.csv"
_BUILD_FILE = "manifest.json"
_MODEL_FILE = "model.json"  # of a loop
# JSON may describe anything, and a mesh beside a build is an artefact
_NO_SCANS = (".json",)


class Kind(Enum):
    """What a file or folder is."""

    STIMULI = "stimuli"
    SCAN = "scan"
    SESSION = "session"
    STUDY = "study"
    OUTPUT = "output"


@dataclass(frozen=True)
class Entry:
    """A file or folder that a command takes.

    Attributes
    ----------
    name : str
        Within the folder of the window, with ``/`` between folders.
    kind : Kind
    """

    name: str
    kind: Kind


class Folder:
    """The folder that a window is opened on.

    Parameters
    ----------
    path : Path
        It must be there.

    Raises
    ------
    PipelineError
        If it is no folder, or cannot be read.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_dir():
            raise PipelineError(texts.NO_FOLDER.format(path=path))
        try:
            next(path.iterdir(), None)
        except OSError as error:
            reason = describe_system_error(error, path)
            raise PipelineError(
                texts.FOLDER_CANNOT_BE_READ.format(reason=reason, path=path)
            ) from error
        self.path = path.resolve()
        # a report runs without the cookie of the window: what its pictures are found by is secret
        self.address = f"/folder/{secrets.token_urlsafe(16)}/"

    def resolve(self, name: str) -> Path:
        """Return the path of a name that a user gave.

        Raises
        ------
        PipelineError
            If it may lead out of the folder, or can be no name.
        """
        try:
            path = resolve_inside(self.path, name)
        except OSError as error:  # too long a name, say
            reason = describe_system_error(error, Path(name))
            raise PipelineError(
                texts.NO_NAME_OF_SYSTEM.format(name=shorten_value(name), reason=reason)
            ) from error
        if path is None:
            raise PipelineError(texts.NAME_OUTSIDE.format(name=shorten_value(name)))
        return path

    def make_file_address(self, name: str) -> str:
        """Return the address at which the window serves a file."""
        return f"{self.address}{quote(name)}"

    def list_entries(self) -> list[Entry]:
        """List what commands take, in the order of names; of each kind at most two thousand.

        Of a folder with very many files, such as a home, only the first are looked at.
        """
        entries = []
        counts: Counter[Kind] = Counter()
        for path in islice(self._walk_unlinked_paths(self.path, 0), _MOST_SEEN):
            kind = _find_kind_of_path(path)
            if kind is None or counts[kind] == _MOST:
                continue
            counts[kind] += 1
            entries.append(Entry(path.relative_to(self.path).as_posix(), kind))
        return entries

    def list_names(self, kind: Kind) -> list[str]:
        """List the names of the entries of a kind, in their order."""
        return [entry.name for entry in self.list_entries() if entry.kind is kind]

    def list_felt_files(self) -> list[str]:
        """List the stimulus files that declare something to be felt, in the order of names."""
        from stepblocks.declaration.set import list_kinds

        felt = {name for name, kind in list_kinds().items() if kind.has_working_faces}
        names = []
        for name in self.list_names(Kind.STIMULI):
            if felt & _list_declared_kinds(self.path / name):
                names.append(name)
        return names

    def list_models(self) -> list[str]:
        """List the models of sessions, which loops left, in the order of names."""
        names = []
        for path in islice(self._walk_unlinked_paths(self.path, 0, (Kind.OUTPUT,)), _MOST_SEEN):
            if path.name == _MODEL_FILE and path.is_file():
                names.append(path.relative_to(self.path).as_posix())
        return names

    def _walk_unlinked_paths(
        self, folder: Path, depth: int, entered_kinds: Sequence[Kind] = ()
    ) -> Iterator[Path]:
        """Yield what is in a folder and in those below it; no link, and nothing in an entry.

        What lies in entries of the kinds `entered_kinds` is yielded, too.
        """
        for path in _list_folder_sorted(folder):
            if path.name.startswith(".") or path.is_symlink():
                continue
            yield path
            if path.is_dir() and depth < _DEEPEST:
                kind = _find_kind_of_folder(path)
                if kind is None or kind in entered_kinds:
                    yield from self._walk_unlinked_paths(path, depth + 1, entered_kinds)


def _list_folder_sorted(folder: Path) -> list[Path]:
    """List a folder by name; one that cannot be read is empty."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _find_kind_of_path(path: Path) -> Kind | None:
    """Find of what kind a file or folder is; None where no command takes it."""
    if path.is_dir():
        return _find_kind_of_folder(path)
    if not path.is_file():
        return None
    if path.suffix == ".toml":
        return Kind.STIMULI if _list_declared_kinds(path) else None
    from stepblocks.scans.read import FORMATS

    ending = path.suffix.lower()
    if ending in FORMATS and ending not in _NO_SCANS:
        return Kind.SCAN
    return None


def _find_kind_of_folder(path: Path) -> Kind | None:
    """Find of what kind a folder is, by the file that makes it one."""
    for name, kind in (
        (_SESSION_FILE, Kind.SESSION),
        (_STUDY_FILE, Kind.STUDY),
        (_BUILD_FILE, Kind.OUTPUT),
    ):
        if os.path.lexists(path / name):
            return kind
    return None


def _list_declared_kinds(path: Path) -> set[str]:
    """List the kinds of stimuli that a file of TOML declares; a broken one may mean them."""
    from stepblocks.declaration.set import list_kinds
    from stepblocks.window.toml_text import MalformedTomlError, parse_toml_tables

    try:
        if path.stat().st_size > _LARGEST_DECLARATION:
            return set()
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return set()
    try:
        return set(parse_toml_tables(text)).intersection(list_kinds())
    except MalformedTomlError:
        return {kind for kind in list_kinds() if f"[{kind}]" in text}
