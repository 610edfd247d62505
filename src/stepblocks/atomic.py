"""Nothing half-written: a file is made beside its place, brought to the disk, and renamed into its place when it is whole.

And nothing outside: a name that stands in a file is followed only where it stays in its folder.
"""

from __future__ import annotations

import filecmp
import glob
import hashlib
import os
import platform
import secrets
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from pathlib import Path

from stepblocks.errors import PipelineError

# tells what must not be replaced; nothing is kept where nobody asked
_kept: ContextVar[Callable[[Path], bool]] = ContextVar("kept", default=lambda _: False)

_STALE = 86_400.0  # a draft of another machine this old was left by a run that was killed [s]


@contextmanager
def keeping(theirs: Callable[[Path], bool]) -> Iterator[None]:
    """Replace no file, within the block, that belongs to somebody else."""
    before = _kept.set(theirs)
    try:
        yield
    finally:
        _kept.reset(before)


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Give a draft to write to; it takes its place when the block ends well and is removed when it does not."""
    draft = _draft(path)
    try:
        yield draft
        # what a killed run wrote, and had no time to note as ours, is the same again
        if path.is_file() and _kept.get()(path) and not filecmp.cmp(draft, path, shallow=False):
            raise PipelineError(f"the file is not ours, or was changed since; --force replaces it [{path}]")
        _to_disk(draft)
        draft.replace(path)
        _to_disk(path.parent)
    finally:
        draft.unlink(missing_ok=True)
    _sweep(path.parent, path.name)


@contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """Give an empty folder beside a place to prepare files in; it is gone when the block ends, whatever is in it."""
    draft = _draft(path)
    draft.mkdir(parents=True)
    try:
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    _sweep(path.parent, path.name)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Hold an output folder for one run: a second one is told so; the lock ends with its process, whose drafts are swept."""
    import fcntl

    try:
        folder.mkdir(parents=True, exist_ok=True)
        number = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise PipelineError(f"the output folder cannot be made: {error.strerror} [{folder}]") from error
    try:
        with suppress(OSError):  # a file system without locks: drafts are unique all the same
            try:
                fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                rule = "another run is writing into this folder: wait until it has ended, or choose another"
                raise PipelineError(f"{rule} [{folder}]") from None
        _sweep(folder)
        yield
    finally:
        _sweep(folder)
        os.close(number)


def inside(folder: Path, name: str) -> Path | None:
    """Follow a name that was read from a file, or None: empty, absolute, with ``..``, or a link on the way or at its end."""
    parts = Path(name).parts
    if not parts or Path(name).anchor or ".." in parts or "\0" in name:
        return None
    path = folder
    for part in parts:
        path /= part
        if path.is_symlink():
            return None
    return path


@cache
def _machine() -> str:
    """Name machine, boot and container: where two share a folder, neither knows the processes of the other."""
    told = [platform.node()]
    with suppress(OSError):
        told += [Path("/proc/sys/kernel/random/boot_id").read_text(), str(Path("/proc/self/ns/pid").readlink())]
    return hashlib.sha256("".join(told).encode()).hexdigest()[:8]


def _draft(path: Path) -> Path:
    return path.with_name(f".partial-{_machine()}-{os.getpid()}-{secrets.token_hex(4)}-{path.name}")


def _sweep(folder: Path, name: str | None = None) -> None:
    """Remove what killed runs left of drafts, of one place or of all in a folder."""
    for left in folder.glob(".partial-*" if name is None else f".partial-*-{glob.escape(name)}"):
        with suppress(FileNotFoundError):  # another run may sweep at the same time
            if not _abandoned(left):
                continue
            if left.is_dir() and not left.is_symlink():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink()


def _abandoned(draft: Path) -> bool:
    """Tell whether the process that made a draft has ended; one of another machine, after a day."""
    machine, process, *_ = [*draft.name.removeprefix(".partial-").split("-"), ""]
    if machine != _machine() or not process.isdigit():
        return time.time() - draft.lstat().st_mtime > _STALE
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        pass  # it is another user's
    return False


def _to_disk(path: Path) -> None:
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def replace_text(path: Path, text: str) -> None:
    """Write a text beside its place and rename it there."""
    replace_bytes(path, text.encode())


def replace_bytes(path: Path, content: bytes) -> None:
    """Write bytes beside their place and rename them there."""
    with beside(path) as draft:
        draft.write_bytes(content)
