"""The public face: every promised name is there, and importing the package costs nothing."""

import dataclasses
import importlib
import inspect
import itertools
import re
import runpy
import subprocess
import sys
from enum import Enum
from pathlib import Path
from types import SimpleNamespace

import pytest

import stepblocks


def test_every_public_name_is_described_and_there():
    for name in stepblocks.__all__:
        assert getattr(stepblocks, name) is not None
        assert f"`{name}`" in stepblocks.__doc__


def test_every_public_name_stands_in_the_reference():
    page = SimpleNamespace(file=SimpleNamespace(src_uri="reference/library.md"))
    hook = runpy.run_path(str(Path(__file__).resolve().parents[1] / "docs" / "reference_page.py"))
    text = hook["on_page_markdown"]("# Reference", page)
    shown = {line.rsplit(".", 1)[1] for line in text.splitlines() if line.startswith("::: ")}
    assert set(stepblocks.__all__) <= shown
    # and the classes of what public functions return, with what they hold
    others = shown - set(stepblocks.__all__)
    assert {"Drag", "InspectionResult", "Interval", "LoopResult", "Mesh", "StudyResult"} <= others
    for module, name in set(hook["results"]()):
        kind = getattr(importlib.import_module(f"stepblocks.{module}"), name)
        if not issubclass(kind, Enum):
            assert re.search(r"(Attributes|Parameters)\n----------", inspect.getdoc(kind)), name


def test_importing_the_package_loads_nothing_else():
    code = (
        "import sys, stepblocks; print(sorted({'numpy', 'pydantic', 'pint', 'OCP'} & "
        "set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_no_public_name_is_hidden_by_the_room_of_the_same_name():
    # once a room is imported, its name on the package means the room, never a function
    rooms = {path.name for path in Path(stepblocks.__file__).parent.iterdir() if path.is_dir()}
    assert not rooms & set(stepblocks.__all__)


def test_every_public_function_says_what_it_takes_and_gives():
    for name in stepblocks.__all__:
        found = getattr(stepblocks, name)
        if inspect.isfunction(found):
            assert "Returns\n-------" in inspect.getdoc(found) or "Yields" in inspect.getdoc(
                found
            ), name
            if inspect.signature(found).parameters:
                assert "Parameters\n----------" in inspect.getdoc(found), name
            absent = [
                one
                for one in inspect.signature(found).parameters
                if not re.search(rf"\b{one}\b", inspect.getdoc(found))
            ]
            assert absent == [], name


@pytest.mark.parametrize("old", ["build", "measure", "registered", "sweep", "no_such_name"])
def test_a_name_that_is_not_public_is_an_attribute_error(old):
    assert old not in stepblocks.__all__
    with pytest.raises(AttributeError, match=old):
        stepblocks.__getattr__(old)


def list_fields(kind):
    """Return what an instance of a class holds: fields of dataclasses and models, members."""
    if issubclass(kind, Enum):
        return [member.name for member in kind]
    if dataclasses.is_dataclass(kind):
        return [one.name for one in dataclasses.fields(kind)]
    return list(getattr(kind, "model_fields", ()))


CLASSES = [name for name in stepblocks.__all__ if inspect.isclass(getattr(stepblocks, name))]


@pytest.mark.parametrize("name", CLASSES)
def test_every_public_class_describes_its_fields(name):
    kind = getattr(stepblocks, name)
    lines = inspect.cleandoc(kind.__doc__).splitlines()
    described = {
        name
        for line, below in itertools.pairwise(lines)
        if re.match(r"\w+(, \w+)*( : |$)", line) and below.startswith("    ")
        for name in line.partition(" : ")[0].split(", ")
    }
    fields = list_fields(kind)
    assert not fields or {"Attributes", "Parameters"} & set(lines)
    assert set(fields) - described == set()


@pytest.mark.parametrize("name", CLASSES)
def test_every_number_of_a_public_class_has_its_unit(name):
    lines = inspect.cleandoc(getattr(stepblocks, name).__doc__).splitlines()
    starts = [row for row, line in enumerate(lines) if re.match(r"[\w, ]+ : ", line)]
    for start in starts:
        below = itertools.takewhile(lambda line: line[:1] in (" ", ""), lines[start + 1 :])
        if re.search(r"\b(float|Dimension)\b", lines[start].partition(" : ")[2]):
            assert re.search(r"\[[^\]]+\]", " ".join(below)), lines[start]
