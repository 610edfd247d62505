"""The command of a form is one that the command line takes, with the answers as they were given."""

import ast
import asyncio
import inspect
import shlex
from pathlib import Path

import pytest

pytest.importorskip("nicegui")

from nicegui import ui
from nicegui.testing.user_simulation import user_simulation

import stepblocks
from stepblocks.cli import main, make_root_command
from stepblocks.errors import PipelineError
from stepblocks.window.set_page import make_set_design_command
from stepblocks.window.set_request import AxisMark, SetMarks
from stepblocks.window.study_page import (
    make_analysis_command,
    make_design_command,
    make_run_command,
    make_sheets_command,
    make_simulation_command,
)
from stepblocks.window.target_axis import TargetAxis, list_round_energies
from stepblocks.window.window import Window

DECLARED = '[[step_block]]\nid = "low"\nheight = "25 um"\n'
FILES = ["mine.toml"]
STUDIES = ["study"]
FORMS = [
    make_design_command(FILES),
    make_sheets_command(STUDIES),
    make_run_command(STUDIES, FILES),
    make_simulation_command(STUDIES, FILES),
    make_analysis_command(STUDIES),
    make_set_design_command(FILES),
]
# what a person may say; anything else is said as it stands at first
SAID = {
    "study": "study",
    "file": "mine.toml",
    "answers": "study/answers.csv",
    "standard": "low",
    "practice": "2",
    "report": "report",
    "reference": "bare",
    "targets": "2 uJ, 30 dB",
    "base": "mine.toml",
    "load": "0.8 N",
    "friction": "0.2",
    "step": "1 um",
    "kind": "margin_block",
    "highest": "20 uJ",
}


@pytest.fixture(scope="module")
def command_line():
    return make_root_command()


def parse(command, words):
    rest = list(words)
    while hasattr(command, "commands"):
        command = command.commands[rest.pop(0)]
    return command.make_context("stepblocks", rest).params


def answer_all(form):
    answers = {}
    for question in form.questions:
        answers[question.name] = SAID.get(question.name, question.default)
    return answers


@pytest.mark.parametrize("form", FORMS, ids=lambda form: " ".join(form.words))
def test_every_answer_reaches_the_command_line(form, command_line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text(DECLARED, encoding="utf-8")
    Path("study").mkdir()
    answers = answer_all(form)
    assert all(answers.values())
    command = form.make_command(answers)
    words = shlex.split(command.line)[1:]
    assert words == list(command.words)
    params = parse(command_line, words)
    given = [value for value in params.values() if value not in (None, False, (), [])]
    assert len(given) >= len(form.questions)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: " ".join(form.words))
def test_an_answer_that_begins_like_an_option_stays_an_answer(form):
    answers = dict.fromkeys(answer_all(form), "--force")
    assert "--force" not in form.make_command(answers).words


@pytest.mark.parametrize("form", FORMS, ids=lambda form: " ".join(form.words))
def test_a_question_that_must_be_answered_is_named(form):
    for question in form.questions:
        if question.is_required:
            with pytest.raises(PipelineError, match="must be answered first: "):
                form.make_command(answer_all(form) | {question.name: " "})


@pytest.mark.long
@pytest.mark.parametrize("form", FORMS, ids=lambda form: " ".join(form.words))
def test_the_python_of_a_form_is_a_call_that_its_function_takes(form):
    if not form.function:
        return
    python = form.make_command(answer_all(form)).python
    call = ast.parse(python).body[1].value  # behind the import
    arguments = [ast.literal_eval(argument) for argument in call.args]
    options = {option.arg: ast.unparse(option.value) for option in call.keywords}
    inspect.signature(getattr(stepblocks, form.function)).bind(*arguments, **options)


def test_the_python_of_a_set_writes_what_its_command_writes(tmp_path, monkeypatch):
    form = make_set_design_command([])
    answers = answer_all(form) | {"targets": "20 uJ, 30 uJ", "base": "", "plot": ""}
    answers |= {"lowest": "", "highest": "", "number": "", "apart": "", "kind": "step_block"}
    command = form.make_command(answers)
    written = []
    for folder in ("typed", "python"):
        (tmp_path / folder).mkdir()
        monkeypatch.chdir(tmp_path / folder)
        if folder == "typed":
            assert main([*command.words, "--model=formula"]) == 0
        else:
            code = command.python.replace(")\ndesign", ", model='formula')\ndesign", 1)
            exec(code)
        written.append((tmp_path / folder / "mine.toml").read_bytes())
    assert written[0] == written[1]


async def open_page(folder, path):
    async with user_simulation(root=Window(folder).build) as user:
        await user.open(path)
        return [label.text for label in user.find(kind=ui.label).elements]


def test_a_study_page_asks_for_a_design_first(tmp_path):
    (tmp_path / "mine.toml").write_text(DECLARED, encoding="utf-8")
    shown = asyncio.run(open_page(tmp_path, "/study"))
    assert "No study lies in the folder yet: design one first." in shown
    assert (
        "stepblocks study design mine.toml --output=study --seed=1 --experiment=estimates "
        "--participants=10 --probes=bare,hard,soft --repetitions=3"
    ) in shown


def test_the_page_of_a_set_begins_with_eight_blocks_one_jnd_apart(tmp_path):
    shown = asyncio.run(open_page(tmp_path, "/set"))
    assert (
        "stepblocks design-set even.toml '--lowest=2 uJ' --number=8 '--apart=1 JND' "
        "--plot=out/even.png"
    ) in shown


async def move_targets(folder):
    """Move the first target of a set by keys and by a hand; return what the page says then."""
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/set")
        await user.should_see(marker="target-7", retries=200)
        user.find(marker="target-0").trigger("keydown", "PageUp")
        await user.should_see("--targets=2.83 uJ", retries=50)
        user.find(marker="axis").trigger("pointerdown", 1)
        user.find(marker="axis").trigger("pointermove", 1.0)
        user.find(marker="axis").trigger("pointerup", {})
        user.find(marker="target-3").trigger("keydown", "Delete")
        await user.should_see("As the command designs it.", retries=200)
        (blocks,) = user.find(marker="blocks").elements
        sizes = [block.text for block in blocks.descendants() if isinstance(block, ui.label)]
        shown = [label.text for label in user.find(kind=ui.label).elements]
        return next(text for text in shown if text.startswith("stepblocks design-set")), sizes


def test_targets_are_moved_by_keys_and_hand_and_the_command_designs_the_blocks_that_are_shown(
    tmp_path, monkeypatch, capsys
):
    line, sizes = asyncio.run(move_targets(tmp_path))
    monkeypatch.chdir(tmp_path)
    words = [word for word in shlex.split(line)[1:] if not word.startswith("--plot")]
    assert len([word for word in words if word.startswith("--targets=")]) == 7
    assert not any(word.startswith(("--lowest", "--number", "--apart")) for word in words)
    assert main(words) == 0
    declared = stepblocks.load_set("even.toml").stimuli
    made = [f"{1e6 * part.height.nominal:.3g} µm" for part in declared]
    assert sizes == made


@pytest.mark.parametrize(
    "event", [("pointerdown", 99), ("pointermove", "x"), ("pointermove", None), ("keydown", "a")]
)
def test_an_event_that_no_page_sends_moves_nothing(event, tmp_path):
    axis_marks = SetMarks((AxisMark(2e-6, "2 uJ"), AxisMark(4e-6, "4 uJ")), ())
    told = []

    async def send():
        async with user_simulation(root=lambda: build(told)) as user:
            await user.open("/")
            marker = "target-0" if event[0] == "keydown" else "axis"
            user.find(marker=marker).trigger(*event)

    def build(told):
        axis = TargetAxis(told.append, lambda: None)
        axis.show_marks(axis_marks)

    asyncio.run(send())
    assert told == []


def test_the_axis_is_marked_at_round_energies():
    found = [1e6 * energy for energy in list_round_energies(0.9e-6, 21e-6)]
    assert found == pytest.approx([1.0, 2.0, 5.0, 10.0, 20.0])
