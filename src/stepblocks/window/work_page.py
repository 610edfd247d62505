"""The page of what runs and has run: every command with what it prints, and its verdict."""

from html import escape

from nicegui import ui

from stepblocks.errors import StepblocksError
from stepblocks.window import texts
from stepblocks.window.folder import Folder
from stepblocks.window.frame import add_quiet_button, show_heading, show_mistake
from stepblocks.window.job_view import PERIOD, JobView, show_job_heading
from stepblocks.window.jobs import Job, JobList

ADDRESS = "/work"


class WorkPage:
    """The page of the jobs of a window; it shows the same, however often it is opened."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self) -> None:
        """Make the page."""
        show_heading(texts.WORK)
        views: dict[int, JobView] = {}
        again: dict[int, ui.button] = {}
        empty = ui.label(texts.NO_WORK)
        place = ui.column().classes("w-full")

        def update() -> None:
            for job in reversed(self._jobs.latest_first):
                if job.number not in views:
                    views[job.number], again[job.number] = self._add_job_view(job, place)
                views[job.number].update()
                again[job.number].set_visibility(views[job.number].is_final)
            empty.set_visibility(not views)

        update()
        ui.timer(PERIOD, update)

    def _add_job_view(self, job: Job, container: ui.element) -> tuple[JobView, ui.button]:
        """Show a job above those that were started before it, with a button that runs it again."""
        with container, ui.column().classes("w-full") as shown:
            show_job_heading(job)
            button = add_quiet_button(texts.RUN_AGAIN, lambda: self._run_again(job, shown))
            label = f"{texts.RUN_AGAIN}: {job.command.title}"
            button.props(f'aria-label="{escape(label)}"')
            view = JobView(job, self._folder)
        shown.move(container, 0)
        return view, button

    def _run_again(self, job: Job, container: ui.element) -> None:
        """Run the command of a job once more, or say why it cannot be started."""
        try:
            self._jobs.start_once(job.command)
        except StepblocksError as error:
            with container:
                show_mistake(error)
