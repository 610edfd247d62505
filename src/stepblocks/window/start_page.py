"""The start page: the files of the folder by kind, each with what can be done with it."""

from urllib.parse import quote

from nicegui import ui

from stepblocks.window import texts
from stepblocks.window.folder import Entry, Folder, Kind
from stepblocks.window.frame import add_quiet_button, show_heading
from stepblocks.window.job_view import Runnable
from stepblocks.window.jobs import JobList
from stepblocks.window.suggestions import suggest_beginnings, suggest_commands

_MOST = 100  # of a kind: a page of thousands takes long to open
_TITLES = {
    Kind.STIMULI: texts.STIMULI,
    Kind.SCAN: texts.SCANS,
    Kind.SESSION: texts.SESSIONS,
    Kind.STUDY: texts.STUDIES,
    Kind.OUTPUT: texts.OUTPUTS,
}


class StartPage:
    """The start page of a folder."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self) -> None:
        """Make the page."""
        show_heading(texts.START)
        with ui.row().classes("items-center"):
            ui.label(texts.FOLDER.format(path=self._folder.path))
            again = add_quiet_button(texts.REFRESH, lambda: self._show_entries(content))
        again.props("dense")
        content = ui.column().classes("w-full")
        self._show_entries(content)

    def _show_entries(self, container: ui.element) -> None:
        """Show what lies in the folder now."""
        container.clear()
        entries = self._folder.list_entries()
        with container:
            if not entries:
                ui.label(texts.EMPTY_FOLDER)
                for command in suggest_beginnings():
                    Runnable(command, self._folder, self._jobs)
            for kind, title in _TITLES.items():
                found = [entry for entry in entries if entry.kind is kind]
                if found:
                    show_heading(texts.COUNT.format(title=title, count=len(found)), 2)
                for entry in found[:_MOST]:
                    _show_entry(entry, self._folder, self._jobs)
                if len(found) > _MOST:
                    ui.label(texts.MORE_ENTRIES.format(count=len(found) - _MOST))


def _show_entry(entry: Entry, folder: Folder, jobs: JobList) -> None:
    """Show a file or folder; opened, it shows its commands."""
    if entry.kind is Kind.OUTPUT:
        with ui.row().classes("items-center"):
            ui.label(entry.name)
            ui.link(
                texts.OPEN_PAGE, folder.make_file_address(f"{entry.name}/index.html"), new_tab=True
            )
        return
    with ui.expansion(entry.name).classes("w-full"):
        if entry.kind is Kind.STIMULI:
            ui.link(texts.CHANGE, f"/declare?file={quote(entry.name)}")
        if entry.kind is Kind.SCAN:
            ui.link(texts.INSPECT_LINK, f"/inspect?file={quote(entry.name)}")
        for command in suggest_commands(entry):
            Runnable(command, folder, jobs)
