"""Write files whole: each is made beside its place, synced to the disk, and renamed.

A name that stands in a file is followed only where it stays in its folder.
"""

import fcntl
import filecmp
import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path

from stepblocks.errors import PipelineError

# tells what must not be replaced; nothing is kept where nobody asked
_kept: ContextVar[Callable[[Path], bool]] = ContextVar("kept", default=lambda _: False)


@contextmanager
def protect_files(is_protected: Callable[[Path], bool]) -> Iterator[None]:
    """Replace no file, within the block, that belongs to somebody else."""
    before = _kept.set(is_protected)
    try:
        yield
    finally:
        _kept.reset(before)


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Give a draft to write to; it replaces `path` when the block succeeds, else it is removed.

    The folder of `path` is made where there is none.
    """
    with make_draft_folder(path) as folder:
        PipelineError.require(
            # what lies in /dev may be a link to a plain file, as /dev/stdout is under a redirection
            (path.is_file() or path.is_dir() or not path.exists())
            and path.parent.resolve() != Path("/dev"),
            f"output must be a plain file, got a device, a pipe or a socket [{path}]",
        )
        draft = folder / path.name
        yield draft
        # what a killed run wrote, and had no time to note as ours, is the same again
        PipelineError.require(
            not (
                path.is_file() and _kept.get()(path) and not filecmp.cmp(draft, path, shallow=False)
            ),
            f"the file is not ours, or was changed since; --force replaces it [{path}]",
        )
        _sync_file(draft)
        draft.replace(path)
        _sync_file(path.parent)


@contextmanager
def make_draft_folder(path: Path) -> Iterator[Path]:
    """Give an empty folder beside a place to prepare files in; it is removed with the block.

    What the system refuses, here or to the user of the folder, is an error of ours.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_stale_drafts_once(path.parent)
        draft, number = _make_draft(path.parent)
        try:
            yield draft
        finally:
            shutil.rmtree(draft, ignore_errors=True)
            os.close(number)
    except OSError as error:
        named = str(error.filename2 or error.filename or path)
        place = str(path if "/.partial-" in named else named).partition("/.partial-")[0]
        what = (
            "a folder must stand here, got a file"
            if isinstance(error, FileExistsError)
            else error.strerror or error
        )
        raise PipelineError(f"output cannot be written: {what} [{place}]") from error


def _make_draft(folder: Path) -> tuple[Path, int]:
    # Make a folder that is locked while its process lives: the next run knows what was left
    while True:
        draft = folder / f".partial-{secrets.token_hex(8)}"
        draft.mkdir()
        try:
            number = os.open(draft, os.O_RDONLY)
        except FileNotFoundError:  # another process, which came to the folder just now, swept it
            continue
        with suppress(OSError):  # a file system without locks: nobody sweeps there
            fcntl.flock(number, fcntl.LOCK_EX)
        if draft.is_dir():  # nobody swept it before it was locked
            return draft, number
        os.close(number)


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold an output folder for one run; a second one is refused.

    The lock ends with its process, and the drafts of a process that ended are removed.
    """
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        number = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise PipelineError(
            "the output folder cannot be made: "
            f"{'a file is there' if isinstance(error, FileExistsError) else error.strerror} "
            f"[{folder}]"
        ) from error
    try:
        with suppress(OSError):  # a file system without locks: drafts are unique all the same
            try:
                fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise PipelineError(
                    "another run is writing into this folder: wait until it has ended, or "
                    f"choose another [{folder}]"
                ) from None
        _remove_stale_drafts(folder)
        yield
    finally:
        _remove_stale_drafts(folder)
        os.close(number)
        if made:
            with suppress(OSError):  # something was written
                folder.rmdir()


def resolve_inside(folder: Path, name: str) -> Path | None:
    """Follow a name that was read from a file; None where it may lead out of the folder.

    It may do so if it is empty or absolute, contains ``..``, or passes a link.
    """
    parts = Path(name).parts
    if not parts or Path(name).anchor or ".." in parts or "\0" in name:
        return None
    steps = [folder.joinpath(*parts[:end]) for end in range(1, len(parts) + 1)]
    return None if any(step.is_symlink() for step in steps) else steps[-1]


def _remove_stale_drafts(folder: Path) -> None:
    # Remove the drafts in a folder that killed runs left: those that nobody holds any more
    for left in folder.glob(".partial-*"):
        with suppress(OSError):  # it is held, or another run sweeps at the same time
            # a pipe of that name would be waited for
            number = os.open(left, os.O_RDONLY | os.O_NOFOLLOW | os.O_DIRECTORY)
            try:
                fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(left)
            finally:
                os.close(number)


# a process looks through a folder when it first writes there, not at every file
_remove_stale_drafts_once = lru_cache(_remove_stale_drafts)


def _sync_file(path: Path) -> None:
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def sync_folder(folder: Path) -> None:
    """Bring what was prepared in a folder to the disk, before it is moved into its place."""
    for path in (folder, *folder.rglob("*")):
        _sync_file(path)


def replace_text(path: Path, text: str) -> None:
    """Write a text beside its place and rename it there."""
    # a file's name in it need be no text
    replace_bytes(path, text.encode(errors="backslashreplace"))


def replace_bytes(path: Path, content: bytes) -> None:
    """Write bytes beside their place and rename them there."""
    with write_atomically(path) as draft:
        draft.write_bytes(content)
