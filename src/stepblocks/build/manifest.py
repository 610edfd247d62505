"""The documents of a build: what was made of which inputs, with hashes of every file.

Uses the standard library only, so that an up-to-date build costs nothing.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from stepblocks.compute.fingerprint import Environment
from stepblocks.files.atomic import replace_text, resolve_inside
from stepblocks.files.text import measure_file_size

MANIFEST = "manifest.json"  # in the output folder
RECORD = "record.json"  # in the folder of each stimulus
MODEL_INPUT = "--model"  # stands among the inputs for the model of a session

_SCHEMA = 1
_MOST_BYTES = 500_000_000  # of a manifest


class Link(NamedTuple):
    """A file that the page links: title, and name below the output folder."""

    title: str
    name: str


@dataclass(frozen=True)
class Manifest:
    """What stands in the output folder.

    Attributes
    ----------
    stepblocks : str
        Version of this package.
    code : str
        Its fingerprint, and that of the libraries.
    made_with : Environment
        With what it was made.
    inputs : mapping of str to str
        Hash of every stimulus file, and of the model; empty where only a part was built.
    stimuli : int
        How many were made.
    failures : sequence of str
        Failed checks, a line each.
    linked : mapping of str to sequence of Link
        Files of other commands, as `find_linked_files` gives them.
    outputs : mapping of str to str
        Hash of every file by its name.
    """

    stepblocks: str
    code: str
    made_with: Environment
    inputs: Mapping[str, str]
    stimuli: int
    failures: Sequence[str]
    linked: Mapping[str, Sequence[Link]]
    outputs: Mapping[str, str]

    def as_json(self) -> dict[str, object]:
        """Return it as JSON holds it."""
        return {
            "schema": _SCHEMA,
            "stepblocks": self.stepblocks,
            "code": self.code,
            "made_with": self.made_with.as_json(),
            "inputs": dict(self.inputs),
            "stimuli": self.stimuli,
            "failures": list(self.failures),
            "linked": {part: list(links) for part, links in self.linked.items()},
            "outputs": dict(sorted(self.outputs.items())),
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Manifest":
        """Read what `as_json` gives; what an older version did not write is empty."""
        linked = {}
        for part, links in content.get("linked", {}).items():
            linked[part] = [Link(*link) for link in links]
        return cls(
            stepblocks=content.get("stepblocks", ""),
            code=content.get("code", ""),
            made_with=Environment.from_json(content.get("made_with", {})),
            inputs=content.get("inputs", {}),
            stimuli=content.get("stimuli", 0),
            failures=content.get("failures", []),
            linked=linked,
            outputs=content.get("outputs", {}),
        )


@dataclass(frozen=True)
class RecordedVerdict:
    """What a check found, as it is recorded.

    Attributes
    ----------
    text : str
        The line that a person reads.
    passed : bool
        Whether it is within its limit.
    values : mapping of str to object
        The measured value, its nominal and its limit, with units in the names.
    """

    text: str
    passed: bool
    values: Mapping[str, object] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """Return it as JSON holds it."""
        return {**self.values, "text": self.text}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "RecordedVerdict":
        """Read what `as_json` gives."""
        values = {name: value for name, value in content.items() if name != "text"}
        return cls(content["text"], content["passed"], values)


class NamedText(NamedTuple):
    """A dimension or a derived figure of a stimulus, for people."""

    name: str
    text: str


@dataclass(frozen=True)
class StimulusRecord:
    """What was made of one stimulus.

    Attributes
    ----------
    key : str
        Hash of its inputs.
    stimulus : str
        Its id.
    kind : str
        What people call its kind.
    dimensions, derived : sequence of NamedText
        What was declared, and what follows from it.
    verdicts : sequence of RecordedVerdict
        What the checks of its files found.
    outputs : mapping of str to str
        Hash of every file by its name.
    """

    key: str
    stimulus: str
    kind: str
    dimensions: Sequence[NamedText]
    derived: Sequence[NamedText]
    verdicts: Sequence[RecordedVerdict]
    outputs: Mapping[str, str]

    def as_json(self) -> dict[str, object]:
        """Return it as JSON holds it."""
        return {
            "schema": _SCHEMA,
            "key": self.key,
            "stimulus": self.stimulus,
            "kind": self.kind,
            "dimensions": list(self.dimensions),
            "derived": list(self.derived),
            "verdicts": [verdict.as_json() for verdict in self.verdicts],
            "outputs": dict(self.outputs),
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "StimulusRecord":
        """Read what `as_json` gives; what an older version did not write is empty."""
        verdicts = content.get("verdicts", [])
        return cls(
            key=content.get("key", ""),
            stimulus=content.get("stimulus", ""),
            kind=content.get("kind", ""),
            dimensions=[NamedText(*entry) for entry in content.get("dimensions", [])],
            derived=[NamedText(*entry) for entry in content.get("derived", [])],
            verdicts=[RecordedVerdict.from_json(verdict) for verdict in verdicts],
            outputs=content.get("outputs", {}),
        )


def hash_bytes(content: bytes) -> str:
    """Return the SHA-256 of bytes, in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits; an empty text if it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def write_sealed_json(path: Path, content: Mapping[str, object]) -> None:
    """Write JSON with a hash of its content, by which `load_sealed_json` notices a later change."""
    sealed = {**content, "seal": _compute_seal(content)}
    replace_text(path, json.dumps(sealed, indent=1, allow_nan=False) + "\n")


def _compute_seal(content: Mapping[str, object]) -> str:
    """Hash a JSON object, whatever the order of its keys."""
    return hash_bytes(json.dumps(content, sort_keys=True).encode())


def load_sealed_json(path: Path) -> dict[str, Any] | None:
    """Read a JSON object that `write_sealed_json` wrote; None for anything else."""
    try:
        if measure_file_size(path) >= _MOST_BYTES:
            return None
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict):
        return None
    seal = content.pop("seal", None)
    if seal != _compute_seal(content):
        return None
    return content


def load_manifest(output: Path) -> Manifest | None:
    """Read the manifest of an output folder; None where there is none that is whole."""
    content = load_sealed_json(output / MANIFEST)
    if content is None:
        return None
    return Manifest.from_json(content)


def load_stimulus_record(folder: Path) -> StimulusRecord | None:
    """Read the record of a stimulus; None where it was not made or is not whole."""
    content = load_sealed_json(folder / RECORD)
    if content is None or not content.get("outputs"):
        return None
    return StimulusRecord.from_json(content)


def find_unaltered_file(folder: Path, name: str, digest: str) -> Path | None:
    """Return the path of a file in a folder if its hash is `digest`, else None."""
    path = resolve_inside(folder, name)
    if path is None or hash_file(path) != digest:
        return None
    return path


def are_outputs_intact(folder: Path, outputs: Mapping[str, str]) -> bool:
    """Tell whether files are listed, and each lies in the folder with the hash that is listed."""
    unchanged = (find_unaltered_file(folder, name, digest) for name, digest in outputs.items())
    return bool(outputs) and None not in unchanged
