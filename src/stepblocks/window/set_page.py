"""The page of a set by what is felt: targets in, blocks out, both on one axis."""

import asyncio
from collections.abc import Mapping
from pathlib import PurePosixPath
from urllib.parse import quote

from nicegui import background_tasks, run, ui

from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.text import is_file
from stepblocks.window import texts
from stepblocks.window.command_form import CommandForm, FormCommand, Question
from stepblocks.window.command_line import format_constructor_call, format_function_call
from stepblocks.window.folder import Folder, Kind
from stepblocks.window.frame import is_gone, show_heading, show_message
from stepblocks.window.jobs import Job, JobList
from stepblocks.window.set_request import (
    FIRST_KIND,
    design_and_list_marks,
    format_target,
    keep_filled_answers,
    read_set_request,
)
from stepblocks.window.target_axis import TargetAxis

_FIRST_FILE = "even.toml"
_FIRST_PICTURE = "out/even.png"
_SPACING = ("lowest", "highest", "number", "apart")  # what stands in place of targets one by one
_QUIET = 0.25  # a set is designed as the command does when nothing has changed for so long [s]


class _SetDesignCommand(FormCommand):
    """Its function returns the set; what was designed is written and drawn by two more lines."""

    def format_python(self, answers: Mapping[str, str]) -> str:
        """Write the lines that design, write and draw; nothing where an answer is no number."""
        filled = keep_filled_answers(answers)
        try:
            request = read_set_request(answers)
        except PipelineError:
            return ""
        options = dict(request.options)
        if request.route:
            step = request.route.get("step")
            options["route"] = format_constructor_call(
                "MakingRoute", request.route["kind"], step=step
            )
        arguments: list[object] = [request.name]
        if request.targets:
            arguments.append(request.targets)
        call = format_function_call("design_set", *arguments, **options)
        lines = [call.replace("\n\n", "\n\ndesign = ", 1)]
        lines.append(f"design.stimuli.to_toml({filled['file']!r})")
        if "plot" in filled:
            lines.append(f"design.draw({filled['plot']!r})")
        return "\n".join(lines)


def make_set_design_command(stimuli: list[str]) -> FormCommand:
    """Make the command that designs a set."""
    file = Question("file", texts.SET_FILE, default=_FIRST_FILE, is_required=True, is_name=True)
    targets = (
        _TargetsQuestion("targets", texts.TARGETS),
        Question("lowest", texts.LOWEST, "--lowest", default="2 uJ"),
        Question("highest", texts.HIGHEST, "--highest"),
        Question("number", texts.NUMBER, "--number", default="8"),
        Question("apart", texts.NEIGHBOURS_APART, "--apart", default="1 JND"),
    )
    blocks = (
        Question("kind", texts.SET_KIND, "--kind", choices=(FIRST_KIND, "margin_block")),
        Question("base", texts.SET_BASE, "--base", choices=stimuli),
    )
    conditions = (
        Question("load", texts.SET_LOAD, "--load"),
        Question("friction", texts.SET_FRICTION, "--friction"),
    )
    step = Question("step", texts.SET_STEP, "--step")
    picture = Question("plot", texts.SET_PLOT, "--plot", default=_FIRST_PICTURE, is_name=True)
    questions = (file, *targets, *blocks, *conditions, step, picture)
    return _SetDesignCommand(texts.DESIGN_SET, ("design-set",), "design_set", questions)


class _TargetsQuestion(Question):
    """Targets are an option each."""

    def make_command_words(self, answer: str) -> list[str]:
        """Return the words of the command for targets with commas between them."""
        words = []
        for target in answer.split(","):
            words.append(f"--targets={target.strip()}")
        return words


class SetPage:
    """The page on which a set of blocks is designed by what is felt."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self) -> None:
        """Make the page."""
        SetForm(self._folder, self._jobs).build()


class SetForm:
    """What one opened page shows: the axis of its targets, and the form of the command."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs
        self._changes = 0
        self._is_designing = False

    def build(self) -> None:
        """Make the page."""
        show_heading(texts.SET_PAGE)
        ui.label(texts.SET_HELP)
        ui.label(texts.AXIS_HELP)
        self._axis = TargetAxis(self._fill_in_dragged_targets, self._request_design)
        with ui.row().classes("items-center"):
            ui.button(texts.ADD_TARGET, on_click=self._axis.add_above_highest).props("no-caps")
            self._state = ui.label().props("role=status").mark("design-state")
        self._problems = ui.column().mark("problems")
        stimuli = self._folder.list_names(Kind.STIMULI)
        self._form = CommandForm(
            make_set_design_command(stimuli),
            self._folder,
            self._jobs,
            self._show_designed_set,
            on_changed_answers=self._request_design,
        )
        self._form.build()
        ui.timer(0.0, self._request_design, once=True)

    def _fill_in_dragged_targets(self, energies: list[float]) -> None:
        """Put the targets of the axis into the form in place of what was said of them."""
        targets = ", ".join(format_target(energy) for energy in energies)
        self._form.fill_in_answers({**dict.fromkeys(_SPACING, ""), "targets": targets})

    def _request_design(self) -> None:
        """Design the set for what the form says now, without making the page wait."""
        self._changes += 1
        if not self._is_designing:
            self._is_designing = True
            background_tasks.create(self._design_until_quiet())

    async def _design_until_quiet(self) -> None:
        """Design until nothing has changed meanwhile: first by the formula, then as the command."""
        try:
            shown = -1
            while shown != self._changes:
                shown = self._changes
                is_sound = await self._design_and_show(is_quick=True)
                await asyncio.sleep(_QUIET)
                if is_gone(self._state):
                    return
                if is_sound and shown == self._changes and not self._axis.is_dragged_by_hand:
                    await self._design_and_show(is_quick=False)
        finally:
            self._is_designing = False

    async def _design_and_show(self, *, is_quick: bool) -> bool:
        """Design the set, and show it on the axis; return whether there is one."""
        number = self._changes
        self._state.set_text(texts.DESIGNING)
        problems: list[str] = []
        marks = None
        try:
            marks = await run.io_bound(
                design_and_list_marks, self._form.read_answers(), self._folder, is_quick=is_quick
            )
        except StepblocksError as error:
            problems = [str(error)]
        if number != self._changes or is_gone(self._state):  # somebody moved on
            return False
        if marks is not None:
            self._axis.show_marks(marks)
            problems = [target.problem for target in marks.targets if target.problem]
        self._problems.clear()
        with self._problems:
            for problem in problems:
                show_message(problem)
        self._state.set_text(texts.DESIGNED_BY_FORMULA if is_quick else texts.DESIGNED)
        return marks is not None

    def _show_designed_set(self, job: Job) -> None:
        """Show the picture of a set that was designed, and where it can be changed."""
        file = job.command.words[1]
        if not is_file(self._folder.resolve(file)):
            return
        ui.link(texts.DECLARE_SET, f"/declare?file={quote(PurePosixPath(file).as_posix())}")
        for word in job.command.words:
            picture = word.removeprefix("--plot=")
            if picture != word and is_file(self._folder.resolve(picture)):
                image = ui.image(self._folder.make_file_address(picture)).classes("max-w-[900px]")
                image.props(f'alt="{texts.SET_PICTURE}"')
