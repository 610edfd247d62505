"""What the window says of a build is what the build finds, and its clicks are its commands."""

import asyncio
import shlex
from pathlib import Path

import pytest

pytest.importorskip("nicegui")

from nicegui import ui
from nicegui.testing.user_interaction import UserInteraction
from nicegui.testing.user_simulation import user_simulation

from stepblocks.build.manifest import RecordedVerdict, StimulusRecord, write_sealed_json
from stepblocks.build.run import build_sets, find_changes
from stepblocks.window import texts
from stepblocks.window.build_page import (
    list_quotation_archives,
    make_build_command,
    make_order_command,
    make_scenes_command,
)
from stepblocks.window.folder import Folder
from stepblocks.window.verdicts import list_file_verdicts
from stepblocks.window.window import Window

DECLARED = """[[step_block]]
id = "low"
height = "25 um"

[[step_block]]
id = "high"
height = "50 um"
"""


def test_the_verdict_of_each_file_counts_its_measurements_and_names_those_out_of_tolerance(
    tmp_path,
):
    verdicts = [
        RecordedVerdict("ok a", True, {"artefact": "low.step", "passed": True}),
        RecordedVerdict("FAIL height", False, {"artefact": "low.step", "passed": False}),
        RecordedVerdict("ok b", True, {"artefact": "low.stl", "passed": True}),
    ]
    record = StimulusRecord("key", "low", "step block", (), (), verdicts, {"low.step": "0"})
    (tmp_path / "set" / "low").mkdir(parents=True)
    write_sealed_json(tmp_path / "set" / "low" / "record.json", record.as_json())
    step, mesh = list_file_verdicts(tmp_path, ["set/low", "set/never-made"])
    assert (step.file, step.total, step.failures) == ("low.step", 2, ("FAIL height",))
    assert (mesh.file, mesh.total, mesh.failures) == ("low.stl", 1, ())


def test_nothing_is_up_to_date_before_the_first_build(tmp_path):
    (tmp_path / "two.toml").write_text(DECLARED)
    found = find_changes(tmp_path / "two.toml", tmp_path / "out")
    assert (found.outdated, found.current) == (("two/low", "two/high"), ())
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_what_a_build_would_make_is_what_it_makes(tmp_path):
    file = tmp_path / "two.toml"
    file.write_text(DECLARED)
    out = tmp_path / "out"
    assert build_sets(file, out).built
    assert find_changes(file, out).outdated == ()
    file.write_text(DECLARED.replace("50 um", "60 um"))
    expected = find_changes(file, out)
    assert expected.current == ("two/low",)
    assert build_sets(file, out).built == list(expected.outdated) == ["two/high"]


def test_a_bundle_is_found_where_the_command_writes_it(tmp_path):
    archive = tmp_path / "out" / "a b" / "a b.quotation.zip"
    archive.parent.mkdir(parents=True)
    archive.touch()
    found = list_quotation_archives(Folder(tmp_path), ["deep/a b.toml", "none.toml"])
    assert found == ["out/a b/a b.quotation.zip"]


async def open_build(folder):
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/build")
        await user.should_see("To be made", retries=100)
        await user.should_see("stepblocks export", retries=100)
        return [label.text for label in user.find(kind=ui.label).elements]


def test_the_page_says_what_changed_and_shows_its_commands(tmp_path):
    (tmp_path / "two.toml").write_text(DECLARED)
    shown = asyncio.run(open_build(tmp_path))
    assert "To be made, new or changed: two/low, two/high" in shown
    assert "Up to date: none" in shown
    for command in (make_build_command(["two.toml"]), make_order_command(["two.toml"])):
        assert shlex.split(command.line)[1:] == list(command.words)
        assert command.line in shown
    assert make_scenes_command(["two.toml"], "mujoco").line in shown


async def open_verdicts(folder):
    """Open the page to build, and return the rows of its table of verdicts."""
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/build")
        await user.should_see(marker="verdicts", retries=200)
        (table,) = user.find(marker="verdicts").elements
        return table.rows


@pytest.mark.long
def test_verdicts_of_an_earlier_build_are_shown_and_those_older_than_their_declaration_named(
    tmp_path,
):
    """The build was that of a command line, before the window was opened."""
    file = tmp_path / "two.toml"
    file.write_text(DECLARED)
    build_sets(file, tmp_path / "out")
    file.write_text(DECLARED.replace("50 um", "60 um"))
    rows = asyncio.run(open_verdicts(tmp_path))
    made_from = {(row["part"], row["made_from"]) for row in rows}
    assert made_from == {
        ("two/low", texts.MADE_AS_DECLARED),
        ("two/high", texts.MADE_BEFORE),
    }
    recorded = list_file_verdicts(tmp_path / "out", ["two/high", "two/low"])
    assert [(row["part"], row["file"]) for row in rows] == [
        (verdict.part, verdict.file) for verdict in recorded
    ]
    assert {row["failures"] for row in rows} == {""}


async def order(folder):
    """Build a set and write its bundle by clicks alone; return the names of what can be taken."""
    window = Window(folder)
    async with user_simulation(root=window.build) as user:
        await user.open("/build")
        await user.should_see("stepblocks export", retries=100)
        for number, seen in ((0, "Verdict of every file"), (1, "Take two.quotation.zip")):
            buttons = sorted(user.find("Run").elements, key=lambda element: element.id)
            UserInteraction(user, {buttons[number]}, "Run").click()
            await user.should_see(seen, retries=3000)
        links = [link.text for link in user.find(kind=ui.link).elements]
        table = next(iter(user.find(marker="verdicts").elements))
        window.jobs.close()
        return links, table.rows


@pytest.mark.long
def test_a_set_is_built_and_bundled_by_clicks_as_the_shown_commands_do(tmp_path, monkeypatch):
    from stepblocks.cli import main

    clicked, typed = tmp_path / "clicked", tmp_path / "typed"
    for folder in (clicked, typed):
        folder.mkdir()
        (folder / "two.toml").write_text(DECLARED)
    links, rows = asyncio.run(order(clicked))
    assert "Take two.quotation.zip" in links
    assert {row["part"] for row in rows} == {"two/low", "two/high"}
    assert all(row["failures"] == "" for row in rows)
    monkeypatch.chdir(typed)
    for command in (make_build_command(["two.toml"]), make_order_command(["two.toml"])):
        assert main(command.words) == 0
    archive = Path("out/two/two.quotation.zip")
    assert (clicked / archive).read_bytes() == (typed / archive).read_bytes()
