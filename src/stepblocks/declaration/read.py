"""Read TOML files into validated stimulus sets, or say what is wrong and where."""

import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from stepblocks.declaration.select import find_stimulus_files
from stepblocks.declaration.set import StimulusSet, make_set_from_tables
from stepblocks.declaration.write import SCHEMA
from stepblocks.errors import PipelineError, StimulusError
from stepblocks.files.text import Document, escape_file_name, read_document
from stepblocks.mistakes import Mistake, shorten_value
from stepblocks.parts.declared import is_identity
from stepblocks.parts.kind import Part

Sets: TypeAlias = str | Path | StimulusSet | Sequence[str | Path | StimulusSet]

MAX_FILE_BYTES = 1_000_000  # largest stimulus file that is read [bytes]


def load_set(path: str | Path) -> StimulusSet:
    """Read and validate a stimulus file.

    Parameters
    ----------
    path : str or Path
        The TOML file. Its stem is the name of the set, unless it is no such name, as "My set v2"
        is none, and the file begins with ``set = "my-set"``.

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
    return validate_file_tables(raw, path, [])


def validate_file_tables(tables: Document, path: Path, mistakes: list[Mistake]) -> StimulusSet:
    """Validate the tables of a stimulus file and return its set; the file need not exist yet.

    Parameters
    ----------
    tables : dict
        Tables of the file; they are changed.
    path : Path
        The file; names of other files in it are relative to its folder.
    mistakes : list of Mistake
        What is wrong is added, each with its place.

    Raises
    ------
    StimulusError
        With all mistakes.
    """
    schema = tables.pop("schema", SCHEMA)
    if schema != SCHEMA:
        mistakes.append(("", f"schema must be {SCHEMA}, got {shorten_value(schema)}"))
    name = _choose_set_name(path, tables.pop("set", None), mistakes)
    return make_set_from_tables(name, tables, path.parent, path, mistakes)


def _choose_set_name(path: Path, declared: object, mistakes: list[Mistake]) -> str:
    """Return the name of a set: that of its file, or the declared one where the file's is none.

    Parameters
    ----------
    path : Path
    declared : object
        What the file says at ``set``; None where it says nothing.
    mistakes : list of Mistake
        What is wrong with the name is added.
    """
    stem = escape_file_name(path.stem)
    if is_identity(stem):
        if declared not in (None, stem):
            rule = f"set must be the name of its file, {stem!r}, or be left out"
            mistakes.append(("", f"{rule}, got {shorten_value(declared)}"))
        return stem
    if isinstance(declared, str) and is_identity(declared):
        return declared
    suggested = suggest_set_name(path.stem)
    rule = "a set needs a name of lower-case words and digits joined by hyphens"
    got = f"the file is called {shorten_value(stem)}"
    if declared is not None:
        got = f"got {shorten_value(declared)}"
    advice = f'rename it to {suggested}.toml, or begin it with set = "{suggested}"'
    mistakes.append(("", f"{rule}, {got}: {advice}"))
    return suggested


def suggest_set_name(stem: str) -> str:
    """Return a name that a set may have for the name of a file; ``"mine"`` where nothing is left.

    >>> suggest_set_name("Blöcke v2"), suggest_set_name("con")
    ('blocke-v2', 'mine')
    """
    plain = unicodedata.normalize("NFKD", stem.lower()).encode("ascii", "ignore").decode()
    words = re.findall("[a-z0-9]+", plain)
    suggested = "-".join(words).lstrip("0123456789-")[:40].rstrip("-")
    if not is_identity(suggested):
        return "mine"
    return suggested


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
