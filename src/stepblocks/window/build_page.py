"""The page to build: what changed, how far it is, the verdict of every file, and two bundles."""

from pathlib import Path, PurePosixPath

from nicegui import ui

from stepblocks.build.run import BuildChanges, find_changes
from stepblocks.errors import StepblocksError
from stepblocks.window import texts
from stepblocks.window.command_line import (
    ShownCommand,
    format_function_call,
    protect_leading_hyphen,
)
from stepblocks.window.folder import OUTPUT, Folder, Kind
from stepblocks.window.frame import (
    compute_in_background,
    make_table_columns,
    show_heading,
    show_mistake,
)
from stepblocks.window.job_view import Runnable, show_embedded_page
from stepblocks.window.jobs import Job, JobList
from stepblocks.window.verdicts import FileVerdict, list_file_verdicts

_SIMULATORS = ("mujoco", "chai3d", "sofa", "usd", "gltf", "x3d", "forcelaw", "native")


def make_build_command(files: list[str]) -> ShownCommand:
    """Make the command that builds stimulus files."""
    words = ("build", *map(protect_leading_hyphen, files), "-o", OUTPUT)
    python = format_function_call("build_sets", files, OUTPUT)
    return ShownCommand(texts.BUILD, words, python, f"{OUTPUT}/index.html")


def make_order_command(files: list[str]) -> ShownCommand:
    """Make the command that writes the papers of an order, and their archive."""
    words = ("workshop", *map(protect_leading_hyphen, files), "-o", OUTPUT)
    return ShownCommand(texts.BUNDLE, words, format_function_call("order_parts", files, OUTPUT))


def make_scenes_command(files: list[str], simulator: str) -> ShownCommand:
    """Make the command that writes scenes for a simulator."""
    place = f"{OUTPUT}/scenes-{simulator}"
    words = ("export", *map(protect_leading_hyphen, files), "--for", simulator, "-o", place)
    python = format_function_call("export_scenes", files, simulator, place)
    return ShownCommand(texts.SCENES.format(simulator=simulator), words, python)


def list_quotation_archives(folder: Folder, files: list[str]) -> list[str]:
    """List the archives for a quotation of the sets of stimulus files that are there."""
    found = []
    for file in files:
        name = PurePosixPath(file).stem
        archive = f"{OUTPUT}/{name}/{name}.quotation.zip"
        if folder.resolve(archive).is_file():
            found.append(archive)
    return found


class BuildPage:
    """The page on which stimulus files of a folder are built."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self, file: str = "") -> None:
        """Make the page; `file` is chosen, or all stimulus files where it is none."""
        BuildForm(self._folder, self._jobs).build(file)


class BuildForm:
    """What one opened page shows, with what was chosen in it."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs
        self._changes = BuildChanges((), ())
        self._files: list[str] = []

    def build(self, file: str) -> None:
        """Make the page."""
        show_heading(texts.BUILD_PAGE)
        names = self._folder.list_names(Kind.STIMULI)
        if not names:
            ui.label(texts.NO_STIMULI)
            return
        chosen = [file] if file in names else names
        self._choice = ui.select(names, label=texts.BUILD_FILES, value=chosen, multiple=True)
        self._choice.classes("min-w-[420px]").on_value_change(self._show_changes_and_commands)
        ui.button(texts.LOOK_WHAT_CHANGED, on_click=self._show_changes_and_commands).props(
            "no-caps"
        )
        self._state = ui.column().classes("w-full")
        self._verdicts = ui.column().classes("w-full")
        self._commands = ui.column().classes("w-full")
        ui.timer(0.0, self._show_changes_and_commands, once=True)

    async def _show_changes_and_commands(self) -> None:
        """Show what changed, and the commands for the chosen files."""
        self._files = list(self._choice.value)
        self._commands.clear()
        await self._show_changes()
        if not self._files:
            return
        with self._commands:
            Runnable(
                make_build_command(self._files), self._folder, self._jobs, self._show_build_result
            )
            Runnable(
                make_order_command(self._files), self._folder, self._jobs, self._show_order_archives
            )
            simulator = ui.select(list(_SIMULATORS), label=texts.SIMULATOR, value=_SIMULATORS[0])
            simulator.classes("min-w-[160px]")
            place = ui.column().classes("w-full")
            simulator.on_value_change(lambda event: self._show_scenes(event.value, place))
            self._show_scenes(simulator.value, place)

    def _show_scenes(self, simulator: str, container: ui.element) -> None:
        """Show the command that writes the scenes for a simulator."""
        container.clear()
        with container:
            Runnable(make_scenes_command(self._files, simulator), self._folder, self._jobs)

    async def _show_changes(self) -> None:
        """Show what a build would make and what an earlier one found, or what is wrong."""
        if not self._files:
            self._state.clear()
            self._verdicts.clear()
            return
        paths: list[str | Path] = [self._folder.resolve(name) for name in self._files]
        try:
            found = await compute_in_background(
                self._state, find_changes, paths, self._folder.path / OUTPUT
            )
        except StepblocksError as error:
            self._state.clear()
            self._verdicts.clear()
            with self._state:
                show_mistake(error)
            return
        if found is None:  # the window is being closed
            return
        self._changes = found
        self._state.clear()
        with self._state:
            for text, parts in ((texts.OUTDATED, found.outdated), (texts.CURRENT, found.current)):
                ui.label(text.format(names=", ".join(parts) or texts.NONE)).props("role=status")
        await self._show_verdicts()

    async def _show_verdicts(self) -> None:
        """Show the verdict of every file that a build left, and whether it is of today."""
        parts = sorted({*self._changes.current, *self._changes.outdated})
        output = self._folder.path / OUTPUT
        found = await compute_in_background(self._verdicts, list_file_verdicts, output, parts)
        self._verdicts.clear()  # also what a second look has shown meanwhile
        if not found:
            return
        columns = make_table_columns(texts.VERDICT_COLUMNS)
        rows = [self._make_verdict_row(verdict) for verdict in found]
        with self._verdicts, ui.expansion(texts.VERDICTS, value=True).classes("w-full"):
            table = ui.table(columns=columns, rows=rows, pagination=10)
            table.props("dense wrap-cells").classes("w-full").mark("verdicts")

    def _make_verdict_row(self, verdict: FileVerdict) -> dict[str, str]:
        """Make the row of a file in the table of verdicts."""
        within = verdict.total - len(verdict.failures)
        made_from = texts.MADE_AS_DECLARED
        if verdict.part in self._changes.outdated:
            made_from = texts.MADE_BEFORE
        return {
            "part": verdict.part,
            "file": verdict.file,
            "within": texts.WITHIN.format(count=within, total=verdict.total),
            "failures": "; ".join(verdict.failures),
            "made_from": made_from,
        }

    async def _show_build_result(self, job: Job) -> None:
        """Show what is to be made still, the verdict of every file, and the page of the build."""
        page = ui.column().classes("w-full")
        await self._show_changes()
        with page:
            show_embedded_page(
                self._folder, job.command.page, texts.REPORT_OF.format(title=texts.BUILD)
            )

    def _show_order_archives(self, _: Job) -> None:
        """Show the archives of the order."""
        for archive in list_quotation_archives(self._folder, self._files):
            name = PurePosixPath(archive).name
            link = ui.link(
                texts.DOWNLOAD.format(name=name), self._folder.make_file_address(archive)
            )
            link.props(f'download="{name}"')
