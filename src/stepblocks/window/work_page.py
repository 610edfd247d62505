"""The page of what runs and has run: every command with what it prints, and its verdict."""

from nicegui import ui

from stepblocks.errors import StepblocksError
from stepblocks.files.text import is_file
from stepblocks.window import texts
from stepblocks.window.command_line import ShownCommand
from stepblocks.window.folder import Folder
from stepblocks.window.frame import show_command, show_heading, show_mistake
from stepblocks.window.jobs import Job, JobList, JobState

ADDRESS = "/work"
_PERIOD = 0.5  # between two looks at the jobs [s]


class WorkPage:
    """The page of the jobs of a window; it shows the same, however often it is opened."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self) -> None:
        """Make the page."""
        show_heading(texts.WORK)
        views: dict[int, _JobView] = {}
        empty = ui.label(texts.NO_WORK)
        place = ui.column().classes("w-full")

        def update() -> None:
            for job in reversed(self._jobs.latest_first):
                if job.number not in views:
                    with place:
                        views[job.number] = _JobView(job, self._folder)
                    views[job.number].card.move(place, 0)
                views[job.number].update()
            empty.set_visibility(not views)

        update()
        ui.timer(_PERIOD, update)


class _JobView:
    """What is shown of one job."""

    def __init__(self, job: Job, folder: Folder) -> None:
        self._job = job
        self._folder = folder
        self._is_final = False
        with ui.card().classes("w-full") as self.card:
            show_heading(job.command.title, 2)
            show_command(job.command)
            with ui.row().classes("items-center"):
                self._spinner = ui.spinner(size="sm").props("aria-hidden=true")
                self._state = ui.label().props("role=status").mark(f"state-{job.number}")
                self._cancel = ui.button(texts.CANCEL, on_click=job.cancel).props("flat no-caps")
                self._link = ui.link(texts.OPEN_PAGE, folder.make_link(job.command.page), True)
            self._output = ui.label().classes("command")

    def update(self) -> None:
        """Show how far the job is; what has ended is not looked at again."""
        if self._is_final:
            return
        state = self._job.state
        is_running = state is JobState.RUNNING
        self._state.set_text(state.value)
        self._output.set_text(self._job.output)
        self._spinner.set_visibility(is_running)
        self._cancel.set_visibility(is_running)
        self._link.set_visibility(not is_running and self._has_page())
        self._is_final = not is_running

    def _has_page(self) -> bool:
        """Tell whether the command wrote a page to look at."""
        page = self._job.command.page
        return bool(page) and is_file(self._folder.resolve(page))


def show_runnable(command: ShownCommand, jobs: JobList) -> None:
    """Show a command with a button that runs it and opens the page of what runs."""
    ui.label(command.title)
    place = ui.column()

    def run() -> None:
        place.clear()
        try:
            jobs.start(command)
        except StepblocksError as error:
            with place:
                show_mistake(error)
            return
        ui.navigate.to(ADDRESS)

    with ui.row().classes("items-center w-full"):
        ui.button(texts.RUN, on_click=run).props(f'no-caps aria-label="{texts.RUN_THIS}"')
        show_command(command)
