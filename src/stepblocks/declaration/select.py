"""Which stimuli are meant: files and folders of them, and patterns of names."""

import fnmatch
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.errors import PipelineError
from stepblocks.files.text import is_file, suggest_file

if TYPE_CHECKING:
    from stepblocks.declaration.set import StimulusSet
    from stepblocks.parts.kind import Part


def find_stimulus_files(meant: str | Path | Sequence[str | Path] | None = None) -> list[Path]:
    """Find the stimulus files that a user means: files, those of folders, or of ``stimuli``."""
    files: list[Path] = []
    several = [meant] if isinstance(meant, str | Path) else meant
    for argument in map(Path, several or ("stimuli",)):
        what = "a stimulus file or a folder of them"
        begun = argument
        found = [argument]
        if argument.is_dir():
            what = "a folder with stimulus files (*.toml)"
            begun = argument / "mine.toml"
            found = sorted(argument.glob("*.toml"))
        if not found or not is_file(found[0]):
            other = (
                suggest_file(argument) or f"; 'stepblocks new block {begun}' writes one"
                if several
                else "; there is none here, name one as FILE"
            )
            raise PipelineError(f"expected {what}{other} [{argument}]")
        files += found
    stems = [path.stem for path in files]
    PipelineError.require(
        len(set(stems)) == len(stems),
        f"sets must have different names, got {', '.join(sorted(stems))}",
    )
    return files


def matches_pattern(only: str, set_name: str, identity: str) -> bool:
    """Tell whether a pattern, ``step-02?`` or ``paper-*/step-02?``, means a stimulus."""
    of_set, slash, of_part = only.lower().rpartition("/")  # engraved identities are in capitals
    return fnmatch.fnmatchcase(identity, of_part) and (
        not slash or fnmatch.fnmatchcase(set_name, of_set)
    )


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
