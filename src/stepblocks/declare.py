"""Read a TOML file into a validated stimulus set, or say what is wrong and where."""

from pathlib import Path

from stepblocks.errors import StimulusError
from stepblocks.mistakes import Mistake, shorten_value
from stepblocks.parts.set import StimulusSet, make_set
from stepblocks.text_file import read_document

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
