"""The verdict of every file of a build, from the records that the build left."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from stepblocks.build.manifest import RecordedVerdict, load_stimulus_record


@dataclass(frozen=True)
class FileVerdict:
    """What the check of one file found.

    Attributes
    ----------
    part : str
        Its stimulus, ``"set/id"``.
    file : str
        Its name.
    total : int
        Measurements of it.
    failures : tuple of str
        Those out of tolerance, a line each.
    """

    part: str
    file: str
    total: int
    failures: tuple[str, ...]


def list_file_verdicts(output: Path, parts: Iterable[str]) -> list[FileVerdict]:
    """List the verdicts on the files of stimuli in an output folder; of what is not made none."""
    found = []
    for part in parts:
        record = load_stimulus_record(output / part)
        if record is None:
            continue
        by_file: dict[str, list[RecordedVerdict]] = {}
        for verdict in record.verdicts:
            by_file.setdefault(str(verdict.values.get("artefact", "")), []).append(verdict)
        for file, verdicts in by_file.items():
            failures = tuple(verdict.text for verdict in verdicts if not verdict.passed)
            found.append(FileVerdict(part, file, len(verdicts), failures))
    return found
