"""The page of what runs and has run: every command with what it prints, and its verdict."""

from nicegui import ui

from stepblocks.window import texts
from stepblocks.window.folder import Folder
from stepblocks.window.frame import show_heading
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
        empty = ui.label(texts.NO_WORK)
        place = ui.column().classes("w-full")

        def update() -> None:
            for job in reversed(self._jobs.latest_first):
                if job.number not in views:
                    views[job.number] = self._add_view(job, place)
                views[job.number].update()
            empty.set_visibility(not views)

        update()
        ui.timer(PERIOD, update)

    def _add_view(self, job: Job, place: ui.element) -> JobView:
        """Show a job above those that were started before it."""
        with place, ui.column().classes("w-full") as shown:
            show_job_heading(job)
            view = JobView(job, self._folder)
        shown.move(place, 0)
        return view
