"""Write files whole: each is made beside its place, synced to the disk, and renamed.

A run holds its output folder. What a killed run left behind is removed by the next one.
"""

import filecmp
import os
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path

from stepblocks.errors import PipelineError
from stepblocks.files.locks import LockState, try_lock
from stepblocks.files.paths import describe_system_error, resolve_inside

__all__ = [
    "lock_folder",
    "make_draft_folder",
    "move_into_place",
    "protect_files",
    "replace_bytes",
    "replace_text",
    "resolve_inside",
    "sync_folder",
    "write_atomically",
]

# beside an output: a folder with a lock, and what is prepared under that lock
_DRAFT_PREFIX = ".partial-"
_DRAFT_LOCK = "lock"
_DRAFT_CONTENT = "files"
# in an output folder, while a run writes to it
_FOLDER_LOCK = ".stepblocks.lock"

# Windows refuses to rename a file that a virus scanner or an indexer has open at that moment
_RENAME_ATTEMPTS = 10
_RENAME_PAUSE = 0.1  # between two attempts [s]
_SYSTEM_SHARES_OPEN_FILES = os.name != "nt"
# where the names in a folder, too, are brought to the disk by a sync
_FOLDERS_CAN_BE_SYNCED = os.name == "posix"


def _protect_nothing(_: Path) -> bool:
    return False


# tells which files must not be replaced
_is_protected: ContextVar[Callable[[Path], bool]] = ContextVar(
    "is_protected", default=_protect_nothing
)


@contextmanager
def protect_files(is_protected: Callable[[Path], bool]) -> Iterator[None]:
    """Replace no file, within the block, that belongs to somebody else."""
    before = _is_protected.set(is_protected)
    try:
        yield
    finally:
        _is_protected.reset(before)


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Give a draft to write to; it replaces `path` when the block succeeds, else it is removed.

    The folder of `path` is made where there is none.
    """
    with make_draft_folder(path) as folder:
        _refuse_special_file(path)
        draft = folder / path.name
        yield draft
        _refuse_protected_file(path, draft)
        _sync_file(draft)
        move_into_place(draft, path)
        _sync_folder_entry(path.parent)


def _refuse_special_file(path: Path) -> None:
    """Raise where an output would take the place of a device, a pipe or a socket."""
    is_special = path.exists() and not (path.is_file() or path.is_dir())
    # what lies in /dev may be a link to a plain file, as /dev/stdout is under a redirection
    if is_special or path.parent.resolve() == Path("/dev"):
        raise PipelineError(
            f"output must be a plain file, got a device, a pipe or a socket [{path}]"
        )


def _refuse_protected_file(path: Path, draft: Path) -> None:
    """Raise where a draft would replace another content that is not ours."""
    if not path.is_file() or not _is_protected.get()(path):
        return
    # a killed run had no time to note its file as ours, but wrote the same content
    if not filecmp.cmp(draft, path, shallow=False):
        raise PipelineError(
            f"the file is not ours, or was changed since; --force replaces it [{path}]"
        )


def move_into_place(draft: Path, path: Path) -> None:
    """Rename a file or a folder that is ready; a file replaces the one that is there."""
    if _SYSTEM_SHARES_OPEN_FILES:
        draft.replace(path)
        return
    if draft.is_dir() and path.is_dir():
        path.rmdir()  # only on POSIX does an empty folder give way by itself
    for _ in range(_RENAME_ATTEMPTS - 1):
        try:
            draft.replace(path)
        except PermissionError:
            time.sleep(_RENAME_PAUSE)
        else:
            return
    draft.replace(path)


@contextmanager
def make_draft_folder(path: Path) -> Iterator[Path]:
    """Give an empty folder beside a place to prepare files in; it is removed with the block.

    What the system refuses, here or in the block, is raised as a `PipelineError`.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale_drafts_once(path.parent)
        with ExitStack() as held:
            yield _make_locked_draft_folder(path.parent, held)
    except OSError as error:
        place = _find_refused_place(error, path)
        reason = describe_system_error(error, place)
        if isinstance(error, FileExistsError):
            reason = "a folder must stand here, got a file"
        raise PipelineError(f"output cannot be written: {reason} [{place}]") from error


def _find_refused_place(error: OSError, path: Path) -> Path:
    """Return the place that an error is about, which is never one within a draft."""
    named = Path(str(error.filename2 or error.filename or path))
    if _find_folder_of_draft(named) != named:
        named = path
    return _find_folder_of_draft(named)


def _find_folder_of_draft(path: Path) -> Path:
    """Return the folder in which the draft stands that holds a path; else the path itself."""
    for number, part in enumerate(path.parts):
        if part.startswith(_DRAFT_PREFIX):
            return Path(*path.parts[:number])
    return path


def _make_locked_draft_folder(folder: Path, held: ExitStack) -> Path:
    """Make a folder for drafts that is locked while its process lives, until `held` is closed.

    The lock tells the next run which drafts were left behind.
    """
    while True:
        draft = folder / f"{_DRAFT_PREFIX}{secrets.token_hex(8)}"
        content = draft / _DRAFT_CONTENT
        with ExitStack() as attempt:
            attempt.callback(shutil.rmtree, draft, ignore_errors=True)
            draft.mkdir()
            state = attempt.enter_context(try_lock(draft / _DRAFT_LOCK))
            if state is LockState.TAKEN:  # a run that sweeps the folder took it for a stale one
                continue
            attempt.callback(shutil.rmtree, content, ignore_errors=True)
            with suppress(FileNotFoundError):  # swept before it was locked
                content.mkdir()
                held.push(attempt.pop_all())
                return content


@contextmanager
def lock_folder(folder: Path, share: str = "") -> Iterator[None]:
    """Hold an output folder for one run; a second one is refused.

    The lock ends with its process, and the drafts of a process that ended are removed.

    Parameters
    ----------
    folder : Path
        The folder; it is made where it is missing.
    share : str
        Name of the share of the folder that the run writes, where several runs write shares that
        do not overlap; the whole folder where empty.

    Raises
    ------
    PipelineError
        If another run holds the folder, or it cannot be made.
    """
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = describe_system_error(error, folder)
        if isinstance(error, FileExistsError):
            reason = "a file is there"
        raise PipelineError(f"the output folder cannot be made: {reason} [{folder}]") from error
    try:
        with try_lock(folder / f"{_FOLDER_LOCK}{share}") as state:
            if state is LockState.TAKEN:
                raise PipelineError(
                    "another run is writing into this folder: wait until it has ended, or "
                    f"choose another [{folder}]"
                )
            # without locks, drafts have names of their own all the same
            _remove_stale_drafts(folder)
            try:
                yield
            finally:
                _remove_stale_drafts(folder)
    finally:
        if is_new:
            with suppress(OSError):  # something was written
                folder.rmdir()


def _remove_stale_drafts(folder: Path) -> None:
    """Remove the drafts in a folder that killed runs left: those that nobody holds any more."""
    for draft in folder.glob(f"{_DRAFT_PREFIX}*"):
        # links are not followed; opening a pipe of that name would wait for ever
        if draft.is_symlink() or not draft.is_dir():
            continue
        with suppress(OSError):  # another run sweeps at the same time
            _remove_stale_draft(draft)


def _remove_stale_draft(draft: Path) -> None:
    """Remove a draft unless its process lives."""
    with try_lock(draft / _DRAFT_LOCK) as state:
        if state is not LockState.OURS:
            return
        for entry in draft.iterdir():
            if entry.name == _DRAFT_LOCK:
                continue
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry)
            else:
                entry.unlink()
    draft.rmdir()


# a process looks through a folder when it first writes there, not at every file
_remove_stale_drafts_once = lru_cache(_remove_stale_drafts)


def _sync_file(path: Path) -> None:
    """Bring the content of a file to the disk."""
    # Windows syncs only what may be written
    number = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def _sync_folder_entry(folder: Path) -> None:
    """Bring the names in a folder to the disk, where the system can."""
    if _FOLDERS_CAN_BE_SYNCED:
        _sync_file(folder)


def sync_folder(folder: Path) -> None:
    """Bring what was prepared in a folder to the disk, before it is moved into its place."""
    for path in (folder, *folder.rglob("*")):
        if path.is_dir():
            _sync_folder_entry(path)
        else:
            _sync_file(path)


def replace_text(path: Path, text: str) -> None:
    """Write a text to a temporary file and rename it into place; line endings are kept."""
    # a file's name that stands in it need be no text
    replace_bytes(path, text.encode(errors="backslashreplace"))


def replace_bytes(path: Path, content: bytes) -> None:
    """Write bytes beside their place and rename them there."""
    with write_atomically(path) as draft:
        draft.write_bytes(content)
