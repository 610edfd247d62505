"""Read a TOML file into a validated stimulus set, or say what is wrong and where."""

from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path

from pydantic import ValidationError

from stepblocks.errors import StepblocksError, StimulusError
from stepblocks.mistakes import (
    Location,
    Mistake,
    format_mistakes,
    list_mistakes,
    shorten_value,
)
from stepblocks.parts.series import MAX_SERIES, expand_series, merge_tables
from stepblocks.parts.set import (
    StimulusSet,
    list_kinds,
    make_file_model,
    validate_set,
)
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
    raw, known = read_document(path, "a stimulus file", StimulusError, MAX_FILE_BYTES), list_kinds()
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
    defaults = raw.pop("defaults", {})
    if not isinstance(defaults, dict) or not set(defaults) <= set(known):
        mistakes.append(
            ("", f"defaults must be tables named {', '.join(known)}, got {shorten_value(defaults)}")
        )
        defaults = {}
    for kind in [kind for kind in known if kind in raw]:
        stanzas = _expand_stanzas(kind, raw[kind], defaults.get(kind, {}), mistakes, path.parent)
        raw[kind] = list(islice(stanzas, MAX_SERIES + 1))
    total = sum(len(raw.get(kind, ())) for kind in known)
    if total > MAX_SERIES:
        raise StimulusError(f"a set must have at most {MAX_SERIES} stimuli, got {total} [{path}]")
    declared = {"name": path.stem, "title": path.stem, **raw}

    def locate(location: Location) -> tuple[str, Location]:
        if len(location) < 2 or location[0] not in known or not isinstance(location[1], int):
            return "", location
        kind, number, *rest = location
        stanzas = declared.get(kind, ())  # none where the name of the kind was mended
        identity = stanzas[number].get("id", number + 1) if number < len(stanzas) else number + 1
        return f"{kind} {shorten_value(identity)}", tuple(rest)

    try:
        found = validate_set(declared)
    except ValidationError as error:
        # where stanzas could not be read, a set without any is no mistake of its own
        if total or not mistakes:
            mistakes += list_mistakes(error, make_file_model(), declared, locate, validate_set)
    if mistakes:
        raise StimulusError(format_mistakes(mistakes, path))
    return found


def _expand_stanzas(
    kind: str, raw: object, defaults: object, mistakes: list[Mistake], folder: Path
) -> Iterator[Mapping[str, object]]:
    # Expand the stanzas of a kind; those that cannot be are among the mistakes
    if not isinstance(raw, list) or not all(isinstance(stanza, dict) for stanza in raw):
        mistakes.append(("", f"{kind} must be written as [[{kind}]], got {shorten_value(raw)}"))
        return
    if not isinstance(defaults, dict):
        mistakes.append(("", f"defaults.{kind} must be a table, got {shorten_value(defaults)}"))
        return
    for number, stanza in enumerate(raw, start=1):
        place = f"{kind} {shorten_value(stanza.get('id', f'number {number}'))}"
        try:
            for one in expand_series(merge_tables(defaults, stanza)):
                yield from list_kinds()[kind].expand_stanza(one, folder)
        except (ValueError, StepblocksError) as error:
            mistakes.append((place, str(error)))
        except RecursionError:
            mistakes.append((place, "tables must not nest so deep"))
