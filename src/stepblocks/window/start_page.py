"""The start page: the files of the folder by kind, each with what can be done with it."""

from urllib.parse import quote

from nicegui import ui

from stepblocks.window import texts
from stepblocks.window.folder import Entry, Folder, Kind
from stepblocks.window.frame import show_command, show_heading
from stepblocks.window.gate import FILES
from stepblocks.window.suggestions import suggest_beginnings, suggest_commands

_TITLES = {
    Kind.STIMULI: texts.STIMULI,
    Kind.SCAN: texts.SCANS,
    Kind.SESSION: texts.SESSIONS,
    Kind.STUDY: texts.STUDIES,
    Kind.OUTPUT: texts.OUTPUTS,
}


class StartPage:
    """The start page of a folder."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder

    def build(self) -> None:
        """Make the page."""
        show_heading(texts.START)
        ui.label(texts.FOLDER.format(path=self._folder.path))
        content = ui.column().classes("w-full")
        ui.button(texts.REFRESH, on_click=lambda: self._show_entries(content)).props("no-caps")
        self._show_entries(content)

    def _show_entries(self, place: ui.element) -> None:
        """Show what lies in the folder now."""
        place.clear()
        entries = self._folder.list_entries()
        with place:
            if not entries:
                ui.label(texts.EMPTY_FOLDER)
                for command in suggest_beginnings():
                    ui.label(command.title)
                    show_command(command)
            for kind, title in _TITLES.items():
                found = [entry for entry in entries if entry.kind is kind]
                if found:
                    show_heading(texts.COUNT.format(title=title, count=len(found)), 2)
                for entry in found:
                    _show_entry(entry)


def _show_entry(entry: Entry) -> None:
    """Show a file or folder; opened, it shows its commands."""
    if entry.kind is Kind.OUTPUT:
        with ui.row().classes("items-center"):
            ui.label(entry.name)
            page = quote(f"{entry.name}/index.html")
            ui.link(texts.OPEN_PAGE, f"{FILES}{page}", new_tab=True)
        return
    with ui.expansion(entry.name).classes("w-full"):
        for command in suggest_commands(entry):
            ui.label(command.title)
            show_command(command)
