"""From a TOML file to a validated stimulus set, or to one line that says what is wrong and where."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from stepblocks.errors import PipelineError, StepblocksError, StimulusError
from stepblocks.parts.series import MAX_SERIES, expand, merged
from stepblocks.parts.set import StimulusSet, kinds, set_of, with_energy_tolerances
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
        With file, stanza, field, rule and value, if the file cannot be read or asks for something impossible.
    """
    path = Path(path)
    raw = read_document(path, "a stimulus file", StimulusError, MAX_FILE_BYTES)
    schema = raw.pop("schema", None)
    if schema != SCHEMA:
        raise StimulusError(f"schema must be {SCHEMA}, got {schema!r} [{path}]")
    name = raw.pop("set", None)
    if name != path.stem:
        raise StimulusError(f"set must be the name of its file, {path.stem!r}, got {name!r} [{path}]")
    defaults = raw.pop("defaults", {})
    known = kinds()
    if not isinstance(defaults, dict) or not set(defaults) <= set(known):
        raise StimulusError(f"defaults must be tables named {', '.join(known)}, got {_brief(defaults)} [{path}]")
    declared = [kind for kind in known if kind in raw]
    for kind in declared:
        raw[kind] = list(_stanzas(path, kind, raw[kind], defaults.get(kind, {})))
    total = sum(len(raw[kind]) for kind in declared)
    if total > MAX_SERIES:
        raise StimulusError(f"a set must have at most {MAX_SERIES} stimuli, got {total} [{path}]")
    try:
        return set_of({"name": name, **raw})
    except ValidationError as error:
        raise StimulusError(_one_line(error, raw, path)) from error


def load_declared(path: str | Path) -> StimulusSet:
    """Read a stimulus file and work out the tolerances that follow from an energy."""
    stimuli = load_set(path)
    try:
        return with_energy_tolerances(stimuli)
    except StepblocksError as error:
        raise PipelineError(f"{error}".replace(f"[{stimuli.name},", f"[{path},")) from error


def _stanzas(path: Path, kind: str, raw: object, defaults: object) -> Iterator[dict[str, Any]]:
    if not isinstance(raw, list) or not all(isinstance(stanza, dict) for stanza in raw):
        raise StimulusError(f"{kind} must be written as [[{kind}]], got {_brief(raw)} [{path}]")
    if not isinstance(defaults, dict):
        raise StimulusError(f"defaults.{kind} must be a table, got {_brief(defaults)} [{path}]")
    for number, stanza in enumerate(raw, start=1):
        try:
            yield from expand(merged(defaults, stanza))
        except (ValueError, StepblocksError) as error:
            place = stanza.get("id", f"number {number}")
            raise StimulusError(f"{error} [{path}, {kind} {_brief(place)}]") from error
        except RecursionError as error:
            raise StimulusError(f"tables must not nest so deep [{path}, {kind} number {number}]") from error


def _one_line(error: ValidationError, raw: Mapping[str, Any], path: Path) -> str:
    """Say the first of pydantic's findings as name, rule, value and place."""
    first, *others = error.errors(include_url=False)
    location, place = list(first["loc"]), str(path)
    if len(location) >= 2 and location[0] in kinds() and isinstance(location[1], int):
        stanza = raw[str(location[0])][location[1]]
        place += f", {location[0]} {_brief(stanza.get('id', location[1] + 1))}"
        location = location[2:]
    more = f" (and {len(others)} more)" if others else ""
    return f"{_rule(first, '.'.join(map(str, location)))}{more} [{place}]"


def _rule(finding: Mapping[str, Any], name: str) -> str:
    kind, value = finding["type"], finding.get("input")
    if kind == "missing":
        return f"{name} is missing"
    if kind == "extra_forbidden":
        return f"{name} is not a known field, got {_brief(value)}"
    if kind in ("value_error", "quantity"):
        text = str(finding["ctx"]["error"]) if "ctx" in finding else finding["msg"]
        return f"{name}: {text}" if name and not text.startswith(name.rsplit(".", 1)[-1]) else text
    if kind == "string_pattern_mismatch":
        return f"{name} must be lower-case words and digits joined by hyphens, got {_brief(value)}"
    text = finding["msg"]
    return f"{name}: {text[:1].lower()}{text[1:]}, got {_brief(value)}"


def _brief(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
