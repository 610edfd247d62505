"""What is shown of a command that runs: how far it is, what it prints, its verdict and its page."""

from collections.abc import Callable
from functools import partial
from html import escape

from nicegui import ui

from stepblocks.errors import StepblocksError
from stepblocks.files.text import is_file
from stepblocks.window import texts
from stepblocks.window.command_line import ShownCommand
from stepblocks.window.folder import Folder
from stepblocks.window.frame import add_quiet_button, show_command, show_heading, show_mistake
from stepblocks.window.jobs import Job, JobList, JobState

PERIOD = 0.5  # between two looks at a job [s]
_PAGES = (".html", ".htm")


class JobView:
    """What is shown of one job.

    Parameters
    ----------
    job : Job
    folder : Folder
    at_end : callable, optional
        Called with the job when it has ended, to show what follows from it.
    """

    def __init__(
        self, job: Job, folder: Folder, on_job_end: Callable[[Job], object] | None = None
    ) -> None:
        self._job = job
        self._folder = folder
        self._at_end = on_job_end
        self.is_final = False
        with ui.card().classes("w-full") as self.card:
            with ui.row().classes("items-center"):
                self._spinner = ui.spinner(size="sm").props("aria-hidden=true")
                self._state = ui.label().props("role=status").mark(f"state-{job.number}")
                self._cancel = add_quiet_button(texts.CANCEL, job.cancel)
                self._link = ui.link(
                    texts.OPEN_PAGE, folder.make_file_address(job.command.page), True
                )
                self._served = ui.link(texts.OPEN_SERVED, job.command.address, True)
            with ui.row().classes("items-center w-full") as self._progress:
                self._bar = ui.linear_progress(value=0.0, show_value=False)
                self._bar.props(f'aria-label="{texts.PROGRESS}"').classes("w-[240px]")
                self._step = ui.label()
            self._output = ui.label().classes("command")
        self.update()

    def update(self) -> None:
        """Show how far the job is; what has ended is not looked at again."""
        if self.is_final:
            return
        state = self._job.state
        is_running = state is JobState.RUNNING
        self._state.set_text(state.value)
        self._output.set_text(self._job.output)
        self._show_progress()
        self._spinner.set_visibility(is_running)
        self._cancel.set_visibility(is_running)
        self._served.set_visibility(is_running and bool(self._job.command.address))
        self._link.set_visibility(not is_running and self._has_page())
        if is_running:
            return
        self.is_final = True
        if self._at_end is not None:
            with self.card:
                # by a timer: what follows may have to read files
                ui.timer(0.0, partial(self._at_end, self._job), once=True)

    def _show_progress(self) -> None:
        """Show the step that the command did last."""
        step = self._job.progress
        self._progress.set_visibility(step is not None)
        if step is None:
            return
        self._bar.set_visibility(step.total is not None)
        self._bar.set_value(step.done / (step.total or 1))
        text = texts.STEP if step.total is None else texts.STEP_OF
        self._step.set_text(text.format(done=step.done, total=step.total, name=step.name))

    def _has_page(self) -> bool:
        """Tell whether the command wrote a page to look at."""
        page = self._job.command.page
        return bool(page) and is_file(self._folder.resolve(page))


class Runnable:
    """A command with a button that runs it, and its progress below.

    A page that is opened again shows the job that was started: closing a page does not end it.

    Parameters
    ----------
    command : ShownCommand
    folder : Folder
    jobs : JobList
    at_end : callable, optional
        As `JobView` takes it.
    has_title : bool
        Whether to say what the command does; where a heading says it, it need not be.
    """

    def __init__(
        self,
        command: ShownCommand,
        folder: Folder,
        jobs: JobList,
        on_job_end: Callable[[Job], object] | None = None,
        *,
        has_title: bool = True,
    ) -> None:
        self._command = command
        self._folder = folder
        self._jobs = jobs
        self._at_end = on_job_end
        self._view: JobView | None = None
        if has_title:
            ui.label(command.title)
        with ui.row().classes("items-center w-full"):
            label = f"{texts.RUN}: {command.title}"
            ui.button(texts.RUN, on_click=self._start_command).props(
                f'no-caps aria-label="{escape(label)}"'
            )
            show_command(command)
        self._place = ui.column().classes("w-full")
        last = jobs.find_last(command)
        if last is not None:
            self._show_job(last)

    def _start_command(self) -> None:
        """Start the command, or say why it cannot be started."""
        self._place.clear()
        try:
            job = self._jobs.start_once(self._command)
        except StepblocksError as error:
            with self._place:
                show_mistake(error)
            return
        self._show_job(job)

    def _show_job(self, job: Job) -> None:
        """Show a job, and look at it until it has ended."""
        with self._place:
            view = JobView(job, self._folder, self._at_end)
            if view.is_final:
                return

            def update_view() -> None:
                view.update()
                if view.is_final:
                    timer.deactivate()

            timer = ui.timer(PERIOD, update_view)


def show_embedded_page(folder: Folder, name: str, title: str) -> None:
    """Show a page of the folder within this one, where there is such a page."""
    if not name.endswith(_PAGES) or not is_file(folder.resolve(name)):
        return
    frame = ui.element("iframe").classes("report").mark("report")
    frame.props(
        f'src="{folder.make_file_address(name)}" title="{escape(title)}" sandbox="allow-scripts"'
    )


def show_job_heading(job: Job) -> None:
    """Show what a job is, and its command."""
    show_heading(job.command.title, 2)
    show_command(job.command)
