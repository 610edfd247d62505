"""A scan is looked at before it is judged: what its file leaves open is asked, not guessed."""

import ast
import asyncio
import shlex
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui")

from nicegui import ui
from nicegui.elements.upload_files import SmallFileUpload
from nicegui.testing.user_interaction import UserInteraction
from nicegui.testing.user_simulation import user_simulation

import stepblocks
from stepblocks.cli import main
from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.window import texts
from stepblocks.window.batch_form import ListedScan, write_scan_list
from stepblocks.window.folder import Folder
from stepblocks.window.inspect_page import InspectForm, InspectionAnswers
from stepblocks.window.jobs import JobList
from stepblocks.window.scan_picture import read_and_draw_scan
from stepblocks.window.window import Window

DECLARED = '[[step_block]]\nid = "low"\nheight = "25 um"\n'


def make_scan(header):
    """A profile over a sharp step of 25 um, as text."""
    x = np.arange(-1000.0, 1000.0, 2.0)
    rows = [f"{position:g},{25.0 * (position > 0.0):g}" for position in x]
    return "\n".join([header, *rows]) + "\n"


def test_a_scan_without_a_unit_asks_for_it_and_with_it_is_shown(tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text(make_scan("x,z"))
    with pytest.raises(MetrologyError, match="unit"):
        read_and_draw_scan(path, None, None)
    picture = read_and_draw_scan(path, "um", None)
    assert picture.description == (
        "Profile of 1000 points over 1.998 mm, heights from 0 um to 25 um"
    )
    assert picture.image.startswith("data:image/png;base64,iVBOR")  # the signature of a PNG


def test_a_map_is_shown_with_its_sides(tmp_path):
    path = tmp_path / "scan.csv"
    rows = [f"{10 * x},{10 * y},{25 * (x > 20)}" for y in range(20) for x in range(40)]
    path.write_text("\n".join(["x_um,y_um,z_um", *rows]) + "\n")
    text = read_and_draw_scan(path, None, None).description
    assert text.startswith("Map of 40 x 20 points over 400 um x 200 um")


def make_two_steps():
    """A profile with steps of 25 um at 500 um and of 40 um at 1500 um, as text."""
    x = np.arange(0.0, 2000.0, 2.0)
    rows = [f"{place:g},{25.0 * (place > 500.0) + 40.0 * (place > 1500.0):g}" for place in x]
    return "\n".join(["x_um,z_um", *rows]) + "\n"


def test_edges_are_named_and_a_click_picks_the_nearest_with_the_part_that_holds_it_alone(tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text(make_two_steps())
    picture = read_and_draw_scan(path, None, None)
    assert [edge.name for edge in picture.edges] == ["1: +25 µm at 501 µm", "2: +40 µm at 1500 µm"]
    low, high = picture.edges
    assert (low.begin, high.end) == ("", "")
    assert 501.0 < float(low.end.removesuffix(" um")) < 1500.0
    assert 501.0 < float(high.begin.removesuffix(" um")) < 1500.0
    left, right = picture.columns
    middle = 0.5 * (left + right)
    assert picture.find_nearest_edge(middle - 5.0) is low
    assert picture.find_nearest_edge(middle + 5.0) is high
    assert picture.find_nearest_edge(0.0) is low


def test_the_picked_part_is_what_the_command_evaluates():
    answers = InspectionAnswers("a.csv", "low", "b.toml", begin="1010 um", end="-3 um")
    assert answers.make_command().words[-4:-2] == ("--from=1010 um", "--to=-3 um")


def test_the_python_of_an_inspection_has_every_answer_in_si():
    answers = InspectionAnswers(
        "a.csv", "low", "b.toml", "um", stylus_radius="2 um", calibration="0.1 %", end="1010 um"
    )
    call = ast.parse(answers.make_command().python).body[1].value
    options = {option.arg: ast.unparse(option.value) for option in call.keywords}
    made = {name: eval(options[name]) for name in ("instrument", "options")}
    assert made["instrument"] == stepblocks.Instrument(calibration_std=0.001)
    assert made["options"] == stepblocks.EvaluationOptions(
        end=pytest.approx(1010e-6), stylus_radius=2e-6
    )
    wrong = InspectionAnswers("a.csv", "low", "b.toml", stylus_radius="2 kg")
    assert wrong.make_command().python == ""


@pytest.mark.parametrize("name", ["evil.exe", ".csv", ".hidden.csv", "", "..", "a\0.csv"])
def test_a_dropped_file_that_is_no_scan_is_not_taken(name, tmp_path):
    with pytest.raises(PipelineError):
        InspectForm(Folder(tmp_path), JobList(tmp_path)).choose_scan_name(name)


@pytest.mark.parametrize("name", ["../../a.csv", "/etc/a.csv", "..\\..\\a.csv", "C:\\x\\a.csv"])
def test_a_dropped_file_lies_in_the_folder_whatever_it_is_called_and_replaces_none(name, tmp_path):
    page = InspectForm(Folder(tmp_path), JobList(tmp_path))
    assert page.choose_scan_name(name) == "scans/a.csv"
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "a.csv").touch()
    with pytest.raises(PipelineError, match="there is such a file already"):
        page.choose_scan_name(name)


def test_an_answer_that_begins_like_an_option_stays_the_answer_of_its_question():
    answers = InspectionAnswers("-a.csv", "low", "-b.toml", unit="--force", channel="a b")
    words = answers.make_command().words
    assert words[1] == "./-a.csv"
    assert "--units=--force" in words
    assert "--force" not in words
    assert shlex.split(answers.make_command().line)[1:] == list(words)


def find_part(user):
    """Return the choice of the part of one scan; scans together have choices of their own."""
    for choice in user.find(kind=ui.select).elements:
        if choice.props["label"] == texts.PART:
            return choice
    raise AssertionError("no choice of a part")


async def judge(folder):
    """Drop a scan without a unit, answer, and run; return the job and what was asked."""
    window = Window(folder)
    async with user_simulation(root=window.build) as user:
        await user.open("/inspect")
        upload = next(iter(user.find(marker="drop").elements))
        content = make_scan("x,z").encode()
        await upload.handle_uploads([SmallFileUpload("../scan.csv", "text/csv", content)])
        await user.should_see("unit", retries=200)
        asked = [label.text for label in user.find(kind=ui.label).elements]
        part = find_part(user)
        for _ in range(200):
            if part.options:
                break
            await asyncio.sleep(0.1)
        part.set_value("mine.toml\nlow")
        for box in user.find(kind=ui.input).elements:
            if box.props["label"].startswith("Unit"):
                box.set_value("um")
            if box.props["label"].startswith("Radius of the stylus"):
                box.set_value("2 um")
        user.find("Look").click()
        await user.should_see(marker="description", retries=200)
        await user.should_see("Run", retries=50)
        (button,) = user.find("Run").elements
        UserInteraction(user, {button}, "Run").click()
        (job,) = window.jobs.latest_first
        while job.state.name == "RUNNING":
            await asyncio.sleep(0.2)
        output = job.output
        window.jobs.close()
        return job, output, asked


@pytest.mark.long
def test_a_dropped_scan_is_judged_as_the_shown_command_judges_it(tmp_path, monkeypatch):
    clicked, typed = tmp_path / "clicked", tmp_path / "typed"
    for folder in (clicked, typed):
        folder.mkdir()
        (folder / "mine.toml").write_text(DECLARED)
    job, output, asked = asyncio.run(judge(clicked))
    assert any("unit" in text for text in asked)
    (typed / "scans").mkdir()
    (typed / "scans" / "scan.csv").write_bytes((clicked / "scans" / "scan.csv").read_bytes())
    words = shlex.split(job.command.line)[1:]
    monkeypatch.chdir(typed)
    assert main(words) in (0, 1, 3)
    assert list_bytes(clicked) == list_bytes(typed)
    assert (clicked / job.command.page).is_file(), output


def list_bytes(folder: Path):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix not in (".pdf", ".xlsx")  # which hold their time
    }


def make_step(height):
    """A profile over a sharp step, as text."""
    x = np.arange(-1000.0, 1000.0, 2.0)
    rows = [f"{position:g},{height * (position > 0.0):g}" for position in x]
    return "\n".join(["x_um,z_um", *rows]) + "\n"


async def list_batch(folder):
    """Drop three scans of two serial numbers, name them, write the list, and run the command."""
    window = Window(folder)
    async with user_simulation(root=window.build) as user:
        await user.open("/inspect")
        upload = next(iter(user.find(marker="drop").elements))
        for name, height in (("a1.csv", 25.0), ("a2.csv", 25.2), ("b1.csv", 24.9)):
            content = make_step(height).encode()
            await upload.handle_uploads([SmallFileUpload(name, "text/csv", content)])
        (scans,) = user.find(marker="batch-scans").elements
        while len(scans.options) < 3:
            await asyncio.sleep(0.1)
        (fold,) = user.find(marker="batch").elements
        fold.set_value(True)
        scans.set_value(["a1.csv", "a2.csv", "b1.csv"])
        (stimuli,) = user.find(marker="batch-stimuli").elements
        stimuli.set_value("mine.toml")
        await asyncio.sleep(0.5)
        user.find("Write the list").click()
        await user.should_see("must be answered first: Part that was scanned [a1.csv]", retries=50)
        for name, serial in (("a1.csv", "A"), ("a2.csv", "A"), ("b1.csv", "B")):
            (field,) = user.find(marker=f"serial-{name}").elements
            (part,) = user.find(marker=f"part-{name}").elements
            assert part.options == ["low"]
            field.set_value(serial)
            part.set_value("low")
        user.find("Write the list").click()
        await user.should_see("scans/scans.csv is saved", retries=50)
        button = max(user.find("Run").elements, key=lambda element: element.id)
        UserInteraction(user, {button}, "Run").click()
        (job,) = window.jobs.latest_first
        while job.state.name == "RUNNING":
            await asyncio.sleep(0.2)
        window.jobs.close()
        return job


@pytest.mark.long
def test_scans_of_several_serial_numbers_are_judged_together_as_the_command_does(
    tmp_path, monkeypatch
):
    clicked, typed = tmp_path / "clicked", tmp_path / "typed"
    clicked.mkdir()
    (clicked / "mine.toml").write_text(DECLARED)
    job = asyncio.run(list_batch(clicked))
    assert job.state.name in ("DONE", "OUT_OF_TOLERANCE", "NOT_PROVEN")
    assert (clicked / "scans" / "scans.csv").read_text() == (
        "scan,stimulus,block\na1.csv,low,A\na2.csv,low,A\nb1.csv,low,B\n"
    )
    shutil.copytree(clicked / "scans", typed / "scans")
    (typed / "mine.toml").write_text(DECLARED)
    words = shlex.split(job.command.line)[1:]
    monkeypatch.chdir(typed)
    assert main(words) in (0, 1, 3)
    assert list_bytes(clicked) == list_bytes(typed)
    for serial in ("A", "B"):
        assert (clicked / "out" / "inspect-scans" / serial / "low.inspection.html").is_file()


def test_a_list_replaces_no_file_but_an_earlier_list(tmp_path):
    (tmp_path / "scans.csv").write_text("x_um,z_um\n0,1\n")
    scans = [ListedScan("a.csv", "low", "=1+1")]
    with pytest.raises(PipelineError, match="which is kept"):
        write_scan_list(Folder(tmp_path), "scans.csv", scans)
    write_scan_list(Folder(tmp_path), "new.csv", scans)
    write_scan_list(Folder(tmp_path), "new.csv", scans)
    assert (tmp_path / "new.csv").read_text() == "scan,stimulus,block\na.csv,low,'=1+1\n"
    with pytest.raises(PipelineError, match="must lie in the folder"):
        write_scan_list(Folder(tmp_path), "../new.csv", scans)


async def leave_while_a_scan_is_drawn(folder, monkeypatch):
    """Close a page for which something is computed; return what is shown on it after that."""
    begun, is_let = threading.Event(), threading.Event()
    shown = []

    def draw(*_):
        begun.set()
        is_let.wait(60.0)
        raise PipelineError("not drawn")

    monkeypatch.setattr("stepblocks.window.inspect_page.read_and_draw_scan", draw)
    monkeypatch.setattr("stepblocks.window.inspect_page.show_mistake", shown.append)
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/inspect?file=scan.csv")
        user.find("Look").click()
        for _ in range(200):
            if begun.is_set():
                break
            await asyncio.sleep(0.05)
        user.client.delete()
        is_let.set()
        await asyncio.sleep(0.3)
    return shown


def test_what_was_computed_for_a_page_that_was_closed_meanwhile_is_not_shown(tmp_path, monkeypatch):
    (tmp_path / "scan.csv").write_text("x_um,z_um\n0,1\n1,2\n")
    assert asyncio.run(leave_while_a_scan_is_drawn(tmp_path, monkeypatch)) == []
