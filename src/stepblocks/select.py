"""Which stimuli are meant: files and folders of them, and patterns of names."""

import fnmatch
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.errors import PipelineError
from stepblocks.text_file import is_file

if TYPE_CHECKING:
    from stepblocks.parts.kind import Part
    from stepblocks.parts.set import StimulusSet


def find_stimulus_files(meant: str | Path | Sequence[str | Path] | None = None) -> list[Path]:
    """Find the stimulus files that a user means: files, those of folders, or of ``stimuli``."""
    files: list[Path] = []
    several = [meant] if isinstance(meant, str | Path) else meant
    for argument in map(Path, several or ("stimuli",)):
        what, found = "a stimulus file or a folder of them", [argument]
        if argument.is_dir():
            what = "a folder with stimulus files (*.toml)"
            found = sorted(argument.glob("*.toml"))
        if not found or not is_file(found[0]):
            other = (
                "there is none here, name one as FILE"
                if not several
                else _describe_nearby(argument)
            )
            raise PipelineError(f"expected {what}; {other} [{argument}]")
        files += found
    stems = [path.stem for path in files]
    if len(set(stems)) < len(stems):
        raise PipelineError(f"sets must have different names, got {', '.join(sorted(stems))}")
    return files


def _describe_nearby(path: Path) -> str:
    # Say what there is in place of a file that is not, and how one begins
    from difflib import get_close_matches

    there = (
        {one.stem: path.parent / one.name for one in path.parent.glob("*.toml") if one.is_file()}
        if path.parent.is_dir()
        else {}
    )
    near = get_close_matches(path.stem, there, 1, 0.6)
    begun = path / "mine.toml" if path.is_dir() else path
    return (
        f"did you mean {there[near[0]]}?" if near else f"'stepblocks new block {begun}' writes one"
    )


def matches_pattern(only: str, set_name: str, identity: str) -> bool:
    """Tell whether a pattern, ``step-02?`` or ``paper-*/step-02?``, means a stimulus."""
    of_set, slash, of_part = only.lower().rpartition("/")  # engraved identities are in capitals
    named = not slash or fnmatch.fnmatchcase(set_name, of_set)
    return named and fnmatch.fnmatchcase(identity, of_part)


def select_stimuli(
    sets: Iterable["StimulusSet"], only: str | None
) -> list[tuple["StimulusSet", "Part"]]:
    """List the stimuli that a pattern means, each with its set; without any, say what there is."""
    every = [(stimuli, part) for stimuli in sets for part in stimuli.stimuli]
    found = [
        (stimuli, part)
        for stimuli, part in every
        if only is None or matches_pattern(only, stimuli.name, part.id)
    ]
    if not found:
        names = [f"{stimuli.name}/{part.id}" for stimuli, part in every]
        more = f" and {len(names) - 12} more" if len(names) > 12 else ""
        raise PipelineError(
            f"--only must match at least one stimulus, got {only!r}; there are "
            f"{', '.join(names[:12])}{more}"
        )
    return found
