"""Nothing half-written: a file is made beside its place, brought to the disk, and renamed into its place when it is whole."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_STALE = 86_400.0  # a draft this old was left by a run that was killed [s]


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Give a draft to write to; it takes its place when the block ends well and is removed when it does not.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     target = Path(folder) / "table.csv"
    ...     with beside(target) as draft:
    ...         _ = draft.write_text("height_m")
    ...         before = target.exists()
    ...     before, target.read_text()
    (False, 'height_m')
    """
    # a process id is not unique where two containers share a folder
    draft = path.with_name(f".partial-{secrets.token_hex(6)}-{path.name}")
    try:
        yield draft
        _to_disk(draft)
        draft.replace(path)
        _to_disk(path.parent)
    finally:
        draft.unlink(missing_ok=True)
    for left in path.parent.glob(f".partial-*-{_escaped(path.name)}"):
        with suppress(FileNotFoundError):  # another run may sweep at the same time
            if time.time() - left.stat().st_mtime > _STALE:
                left.unlink()


def _to_disk(path: Path) -> None:
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def _escaped(name: str) -> str:
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)


def replace_text(path: Path, text: str) -> None:
    """Write a text beside its place and rename it there."""
    replace_bytes(path, text.encode())


def replace_bytes(path: Path, content: bytes) -> None:
    """Write bytes beside their place and rename them there."""
    with beside(path) as draft:
        draft.write_bytes(content)
