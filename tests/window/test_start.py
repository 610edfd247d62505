"""The start page shows what lies in the folder, and what can be done with it."""

import asyncio
import shlex
import shutil
from pathlib import Path

import pytest

from stepblocks.cli import make_root_command

pytest.importorskip("nicegui")

from nicegui import ui
from nicegui.testing.user_simulation import user_simulation

from stepblocks.errors import PipelineError
from stepblocks.window.folder import Entry, Folder, Kind
from stepblocks.window.suggestions import suggest_beginnings, suggest_commands
from stepblocks.window.window import Window

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def lab(tmp_path):
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "a.csv").write_text("x_um,z_um\n0,0\n")
    (tmp_path / "notes.toml").write_text("title = 'none of ours'\n")
    (tmp_path / "broken.toml").write_text("[[step_block]]\nid = \n")
    shutil.copy(ROOT / "stimuli" / "paper-four.toml", tmp_path)
    for folder, name in (
        ("bench", "session.toml"),
        ("people", "design.csv"),
        ("out", "manifest.json"),
    ):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text("")
        (tmp_path / folder / "inner.csv").write_text("")
    return tmp_path


def test_the_files_of_a_folder_are_listed_by_kind_and_what_lies_in_a_session_is_not(lab):
    assert Folder(lab).list_entries() == [
        Entry("bench", Kind.SESSION),
        Entry("broken.toml", Kind.STIMULI),  # meant as one; the command says what is wrong
        Entry("out", Kind.OUTPUT),
        Entry("paper-four.toml", Kind.STIMULI),
        Entry("people", Kind.STUDY),
        Entry("scans/a.csv", Kind.SCAN),
    ]


@pytest.mark.parametrize("name", ["", "..", "a/../../b", "/etc/passwd", "a\0b"])
def test_a_name_that_may_lead_out_of_the_folder_is_refused(tmp_path, name):
    with pytest.raises(PipelineError, match="a name must lie in the folder of the window"):
        Folder(tmp_path).resolve(name)


@pytest.fixture(scope="module")
def command_line():
    return make_root_command()


def parse(command, words):
    """Let the command line read a command, without running it."""
    rest = list(words)
    while hasattr(command, "commands"):
        command = command.commands[rest.pop(0)]
    return command.make_context("stepblocks", rest).params


@pytest.mark.parametrize("kind", Kind)
def test_every_command_that_is_shown_parses_and_its_python_names_a_public_function(
    kind, command_line, tmp_path, monkeypatch
):
    import stepblocks

    monkeypatch.chdir(tmp_path)
    for name in ("a b.toml", "-x.toml"):
        (tmp_path / name).touch()
        for command in suggest_commands(Entry(name, kind)) + suggest_beginnings():
            words = shlex.split(command.line)
            assert words[0] == "stepblocks"
            assert parse(command_line, words[1:])
            if command.python:
                function = command.python.split("stepblocks.")[-1].partition("(")[0]
                assert function in stepblocks.__all__


async def open_start(folder):
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/")
        shown = [label.text for label in user.find(kind=ui.label).elements]
        copied = [button.text for button in user.find(kind=ui.button).elements]
        return shown, copied


def test_the_start_page_shows_each_command_to_copy(lab):
    shown, copied = asyncio.run(open_start(lab))
    assert "stepblocks predict paper-four.toml" in shown
    assert "stepblocks loop bench -o out/bench-loop" in shown
    assert "stepblocks inspect scans/a.csv --list-channels" in shown
    assert copied.count("Copy as command") == copied.count("Copy as Python") == 12


def test_an_empty_folder_says_how_to_begin(tmp_path):
    shown, _ = asyncio.run(open_start(tmp_path))
    assert "stepblocks new block mine.toml" in shown


def test_of_stimulus_files_a_study_takes_those_that_declare_something_to_be_felt(tmp_path):
    """A kit of parts and a set of tips lie beside the blocks, and come before them by name."""
    for name in ("apparatus", "paper-ten", "probe-tips"):
        shutil.copy(ROOT / "stimuli" / f"{name}.toml", tmp_path)
    folder = Folder(tmp_path)
    assert len(folder.list_entries()) == 3
    assert folder.list_felt_files() == ["paper-ten.toml"]


def test_a_stimulus_file_is_listed_beside_thousands_of_scans_that_come_before_it(tmp_path):
    for number in range(2001):
        (tmp_path / f"scan-{number:04}.csv").touch()
    (tmp_path / "zero.toml").write_text('[[step_block]]\nid = "low"\nheight = "25 um"\n')
    entries = Folder(tmp_path).list_entries()
    assert [entry.name for entry in entries if entry.kind is Kind.STIMULI] == ["zero.toml"]
    assert len(entries) == 2001  # two thousand scans, and the file


async def open_full_start(folder):
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/")
        await user.should_see("... and 50 more")
        return len(user.find(kind=ui.expansion).elements)


def test_the_first_page_shows_a_hundred_files_of_a_kind(tmp_path):
    for number in range(150):
        (tmp_path / f"scan-{number:04}.csv").touch()
    assert asyncio.run(open_full_start(tmp_path)) == 100
