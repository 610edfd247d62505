"""Read TOML files into validated stimulus sets, or say what is wrong and where."""

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from stepblocks.declaration.select import find_stimulus_files
from stepblocks.declaration.set import StimulusSet, make_set
from stepblocks.declaration.write import SCHEMA
from stepblocks.errors import PipelineError, StimulusError
from stepblocks.files.text import read_document
from stepblocks.mistakes import Mistake, shorten_value
from stepblocks.parts.kind import Part

Sets: TypeAlias = str | Path | StimulusSet | Sequence[str | Path | StimulusSet]

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
    if path.suffix.lower() == ".csv":
        raise StimulusError(
            "a stimulus file must be TOML; 'stepblocks drag' takes a profile, and a table of "
            f"heights 'stepblocks predict' [{path}]"
        )
    raw = read_document(path, "a stimulus file", StimulusError, MAX_FILE_BYTES)
    mistakes: list[Mistake] = []
    schema = raw.pop("schema", SCHEMA)
    if schema != SCHEMA:
        mistakes.append(("", f"schema must be {SCHEMA}, got {shorten_value(schema)}"))
    name = raw.pop("set", path.stem)
    if name != path.stem:
        rule = f"set must be the name of its file, {path.stem!r}, or be left out"
        mistakes.append(("", f"{rule}, got {shorten_value(name)}"))
    return make_set(path.stem, raw, path.parent, path, mistakes)


def load_sets(sources: Sets | None = None) -> list[tuple[StimulusSet, str]]:
    """Load sets from files, folders or as they are, each with where it comes from.

    Without any they are those of the folder ``stimuli``. Sets that are given as such come first.

    Raises
    ------
    StepblocksError
        If a source is no set and no path, or a file cannot be read.
    """
    if isinstance(sources, str | Path | StimulusSet):
        sources = [sources]
    loaded: list[tuple[StimulusSet, str]] = []
    paths: list[str | Path] = []
    for source in sources or ():
        if isinstance(source, StimulusSet):
            loaded.append((source, source.name))
        elif isinstance(source, str | Path):
            paths.append(source)
        else:
            raise PipelineError(
                f"a set must be a path or a StimulusSet, got {shorten_value(list(sources or ()))}"
            )
    if paths or not loaded:
        for path in find_stimulus_files(paths):
            loaded.append((load_set(path), str(path)))
    return loaded


def find_declared_part(identity: str, stimuli: Sets) -> tuple[Part, StimulusSet]:
    """Find a stimulus by its identity, also as engraved, and the set that declares it.

    Raises
    ------
    PipelineError
        If it is not declared.
    """
    names = []
    for declared, _ in load_sets(stimuli):
        for part in declared.stimuli:
            if part.id.lower() == identity.strip().lower():
                return part, declared
            names.append(part.id)
    raise PipelineError(
        f"stimulus must be declared in {stimuli}, got {identity!r}; declared are "
        f"{', '.join(names):.400}"
    )
