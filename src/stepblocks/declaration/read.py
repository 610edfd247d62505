"""Read TOML files into validated stimulus sets, or say what is wrong and where."""

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from stepblocks.declaration.select import find_stimulus_files
from stepblocks.declaration.set import StimulusSet, make_set
from stepblocks.errors import PipelineError, StimulusError
from stepblocks.files.text import read_document
from stepblocks.mistakes import Mistake, shorten_value

Sets: TypeAlias = str | Path | StimulusSet | Sequence[str | Path | StimulusSet]

SCHEMA = 1  # version of the stimulus file format
MAX_FILE_BYTES = 1_000_000  # largest stimulus file that is read [bytes]


def load_set(path: str | Path) -> StimulusSet:
    """Read and validate a stimulus file.

    Parameters
    ----------
    path : str or Path
        The TOML file; its stem must be the name of the set.

    Returns
    -------
    StimulusSet
        Frozen, every series expanded, all values in SI.

    Raises
    ------
    StimulusError
        With file, stanza, field, rule and value, if the file cannot be read or asks for something
        impossible.
    """
    path = Path(path)
    StimulusError.require(
        path.suffix.lower() != ".csv",
        "a stimulus file must be TOML; 'stepblocks drag' takes a profile, and a table of heights "
        f"'stepblocks predict' [{path}]",
    )
    raw = read_document(path, "a stimulus file", StimulusError, MAX_FILE_BYTES)
    name = raw.pop("set", path.stem)
    mistakes: list[Mistake] = []
    if (schema := raw.pop("schema", SCHEMA)) != SCHEMA:
        mistakes.append(("", f"schema must be {SCHEMA}, got {shorten_value(schema)}"))
    if name != path.stem:
        mistakes.append(
            (
                "",
                f"set must be the name of its file, {path.stem!r}, or be left out, got "
                f"{shorten_value(name)}",
            )
        )
    return make_set(path.stem, raw, path.parent, path, mistakes)


def load_sets(sources: Sets | None = None) -> list[tuple[StimulusSet, str]]:
    """Load sets from files, folders or as they are, each with where it comes from.

    Without any they are those of the folder ``stimuli``.
    """
    several = [sources] if isinstance(sources, str | Path | StimulusSet) else list(sources or ())
    PipelineError.require(
        all(isinstance(one, str | Path | StimulusSet) for one in several),
        f"a set must be a path or a StimulusSet, got {shorten_value(several)}",
    )
    declared = [(one, one.name) for one in several if isinstance(one, StimulusSet)]
    paths = [one for one in several if not isinstance(one, StimulusSet)]
    files = find_stimulus_files(paths) if paths or not declared else []
    return [*declared, *((load_set(path), str(path)) for path in files)]
