"""Which stimuli are meant: files and folders of them, and patterns of names."""

import fnmatch
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.errors import PipelineError
from stepblocks.files.text import is_file, suggest_similar_file

if TYPE_CHECKING:
    from stepblocks.declaration.set import StimulusSet
    from stepblocks.parts.kind import Part

_DEFAULT_FOLDER = Path("stimuli")
_LISTED_NAMES = 12  # in a message


def find_stimulus_files(sources: str | Path | Sequence[str | Path] | None = None) -> list[Path]:
    """Find the stimulus files that a user means: files, those of folders, or of ``stimuli``.

    Raises
    ------
    PipelineError
        If a file or folder is missing, or two files have the same name.
    """
    if isinstance(sources, str | Path):
        sources = [sources]
    files: list[Path] = []
    for argument in map(Path, sources or ()):
        found = _list_stimulus_files(argument)
        if not found:
            raise PipelineError(f"{_describe_missing_argument(argument)} [{argument}]")
        files += found
    if not sources:
        files = _list_stimulus_files(_DEFAULT_FOLDER)
        if not files:
            expected = _describe_expected_argument(_DEFAULT_FOLDER)
            raise PipelineError(
                f"expected {expected}; there is none here, name one as FILE [{_DEFAULT_FOLDER}]"
            )
    stems = sorted(path.stem for path in files)
    if len(set(stems)) < len(stems):
        raise PipelineError(f"sets must have different names, got {', '.join(stems)}")
    return files


def _list_stimulus_files(argument: Path) -> list[Path]:
    """List a file, or the stimulus files of a folder; empty if there is none."""
    files = [argument]
    if argument.is_dir():
        files = sorted(argument.glob("*.toml"))
    if not files or not is_file(files[0]):
        return []
    return files


def _describe_expected_argument(argument: Path) -> str:
    """Say what an argument should be."""
    if argument.is_dir():
        return "a folder with stimulus files (*.toml)"
    return "a stimulus file or a folder of them"


def _describe_missing_argument(argument: Path) -> str:
    """Say what an argument should be, and what may be meant or how to begin one."""
    new_file = argument
    if argument.is_dir():
        new_file = argument / "mine.toml"
    suggestion = suggest_similar_file(argument) or f"; 'stepblocks new block {new_file}' writes one"
    return f"expected {_describe_expected_argument(argument)}{suggestion}"


def matches_pattern(pattern: str, set_name: str, identity: str) -> bool:
    """Tell whether a pattern, ``step-02?`` or ``paper-*/step-02?``, means a stimulus."""
    # engraved identities are in capitals
    set_pattern, slash, part_pattern = pattern.lower().rpartition("/")
    if slash and not fnmatch.fnmatchcase(set_name, set_pattern):
        return False
    return fnmatch.fnmatchcase(identity, part_pattern)


def select_stimuli(
    sets: Iterable["StimulusSet"], only: str | None
) -> list[tuple["StimulusSet", "Part"]]:
    """List the stimuli that a pattern means, each with its set; all where there is none.

    Raises
    ------
    PipelineError
        If it means none; the message says what there is.
    """
    names = []
    selected = []
    for stimuli in sets:
        for part in stimuli.stimuli:
            names.append(f"{stimuli.name}/{part.id}")
            if only is None or matches_pattern(only, stimuli.name, part.id):
                selected.append((stimuli, part))
    if not selected:
        listed = ", ".join(names[:_LISTED_NAMES])
        if len(names) > _LISTED_NAMES:
            listed += f" and {len(names) - _LISTED_NAMES} more"
        raise PipelineError(
            f"--only must match at least one stimulus, got {only!r}; there are {listed}"
        )
    return selected
