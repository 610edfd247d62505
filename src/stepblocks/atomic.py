"""Nothing half-written: a file is made beside its place and renamed into it when it is whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


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
    draft = path.with_name(f".partial-{os.getpid()}-{path.name}")
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def replace_text(path: Path, text: str) -> None:
    """Write a text beside its place and rename it there."""
    replace_bytes(path, text.encode())


def replace_bytes(path: Path, content: bytes) -> None:
    """Write bytes beside their place and rename them there."""
    with beside(path) as draft:
        draft.write_bytes(content)
