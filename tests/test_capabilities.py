"""The table of capabilities names every command and kind of file: nothing leaves unannounced."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from stepblocks.artefacts.check import ARTEFACT_ENDINGS
from stepblocks.bench.traces import READERS as TRACE_READERS
from stepblocks.cli import make_root_command
from stepblocks.declaration.set import SHIPPED
from stepblocks.files.text_table import TABLE_ENDINGS
from stepblocks.rehearse.trace_files import TRACE_FILES
from stepblocks.scans.read import FORMATS as SCAN_FORMATS
from stepblocks.simulators.scenes import SCENE_FORMATS
from stepblocks.study.analysis.exchange import FORMATS as SHARED_FORMATS
from stepblocks.study.experiments.registry import EXPERIMENTS
from stepblocks.study.programs.conditions import WRITTEN
from stepblocks.study.programs.records import PROGRAMS
from stepblocks.workshop.rendering import FORMATS as DRAWING_FORMATS

ROOT = Path(__file__).resolve().parents[1]
INDEX = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
REMOVED = re.compile(r"~~`?([^`~]+)`?~~")
# a name that leaves the page is struck out there, so that this number never falls
NAMES_LISTED = 121
KINDS = {
    "stimuli that are declared": [kind.stanza for kind in SHIPPED],
    "artefacts that are written and read back": ARTEFACT_ENDINGS,
    "scans that are read": SCAN_FORMATS,
    "tables that are read": TABLE_ENDINGS,
    "traces that are read": TRACE_READERS,
    "traces that are rehearsed": TRACE_FILES,
    "simulators": SCENE_FORMATS,
    "drawings": DRAWING_FORMATS,
    "experiments": EXPERIMENTS,
    "studies that are shared": SHARED_FORMATS,
    "programs that trials are written for": WRITTEN,
    "programs whose records are read": [program.title for program in PROGRAMS],
}


def list_rows() -> dict[str, str]:
    """Return the rows of both tables, the second cell by the first."""
    section = INDEX.split("## Table of capabilities")[1]
    rows = {}
    for line in section.splitlines():
        if line.startswith("| "):
            first, second = line.strip("| ").split(" | ", 1)
            rows[first] = second
    return rows


def list_commands(command, words=()) -> Iterator[str]:
    """Yield the names of all commands."""
    if not hasattr(command, "commands"):
        yield " ".join(words)
        return
    for word, child in command.commands.items():
        yield from list_commands(child, (*words, word))


def find_names(text: str) -> set[str]:
    """Return the names in a text that are not struck out."""
    return set(re.findall(r"`([^`]+)`", REMOVED.sub("", text)))


def test_every_command_is_listed_and_no_other():
    listed = set()
    for first in list_rows():
        if first not in KINDS:
            listed |= find_names(first)
    assert listed == set(list_commands(make_root_command()))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_file_is_listed_and_no_other(kind):
    assert find_names(list_rows()[kind]) == set(KINDS[kind])


def test_what_is_struck_out_is_announced_as_removed_and_nothing_else_leaves():
    section = INDEX.split("## Table of capabilities")[1]
    removed = REMOVED.findall(section.split("\n\n", 2)[2])
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    announced = "".join(part.split("\n#")[0] for part in changelog.split("### Removed")[1:])
    assert [name for name in removed if name not in announced] == []
    names = sum(len(find_names(cell)) for row in list_rows().items() for cell in row)
    assert names + len(removed) >= NAMES_LISTED
