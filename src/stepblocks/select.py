"""Which stimuli are meant: files and folders of them, and patterns of names."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from pathlib import Path

from stepblocks.errors import PipelineError


def stimulus_files(meant: str | Path | Sequence[str | Path] | None = None) -> list[Path]:
    """Find the stimulus files that a user means: one, several, those of folders; of the folder ``stimuli`` where none is named."""
    files: list[Path] = []
    several = [meant] if isinstance(meant, str | Path) else meant
    for argument in map(Path, several or ("stimuli",)):
        what, found = "a stimulus file or a folder of them", [argument]
        if argument.is_dir():
            what, found = "a folder with stimulus files (*.toml)", sorted(argument.glob("*.toml"))
        if not found or not found[0].is_file():
            raise PipelineError(f"expected {what} [{argument}]")
        files += found
    stems = [path.stem for path in files]
    if len(set(stems)) < len(stems):
        raise PipelineError(f"sets must have different names, got {', '.join(sorted(stems))}")
    return files


def matches(only: str, set_name: str, identity: str) -> bool:
    """Tell whether a pattern, as ``paper-ten/*`` or ``step-02?``, means a stimulus."""
    return fnmatch.fnmatchcase(identity, only) or fnmatch.fnmatchcase(f"{set_name}/{identity}", only)
