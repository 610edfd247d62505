"""Several scans at once: each with its part and serial number, in a list that the command takes."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from nicegui import ui

from stepblocks.declaration.read import load_set
from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.atomic import replace_text
from stepblocks.files.tables import escape_formula
from stepblocks.files.text import is_file
from stepblocks.window import texts
from stepblocks.window.command_line import (
    ShownCommand,
    format_function_call,
    protect_leading_hyphen,
)
from stepblocks.window.folder import Folder, Kind
from stepblocks.window.frame import compute_in_background, show_mistake
from stepblocks.window.job_view import Runnable, show_embedded_page
from stepblocks.window.jobs import Job, JobList

_COLUMNS = ("scan", "stimulus", "block")
_LIST = "scans.csv"  # in the folder of the scans: the command finds it there
_PAGE = "inspections.html"


@dataclass(frozen=True)
class ListedScan:
    """A scan of a list.

    Attributes
    ----------
    scan : str
        Its name in the folder of the list.
    part : str
        Identity of the part that was scanned.
    serial : str
        Serial number of the block.
    """

    scan: str
    part: str
    serial: str


def format_scan_list(scans: Sequence[ListedScan]) -> str:
    """Write the list of scans that the command takes.

    Raises
    ------
    PipelineError
        If a part or a serial number is missing, or there are no scans.
    """
    if not scans:
        raise PipelineError(texts.MUST_BE_SAID.format(label=texts.BATCH_SCANS))
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for listed in scans:
        for label, answer in ((texts.PART, listed.part), (texts.SERIAL, listed.serial)):
            if not answer:
                raise PipelineError(texts.MUST_BE_SAID.format(label=f"{label} [{listed.scan}]"))
        cells = (listed.scan, listed.part, listed.serial)
        writer.writerow([escape_formula(cell) for cell in cells])
    return buffer.getvalue()


def write_scan_list(folder: Folder, name: str, scans: Sequence[ListedScan]) -> None:
    """Write the list of scans into the folder, over an earlier list and over nothing else."""
    text = format_scan_list(scans)
    path = folder.resolve(name)
    if is_file(path):
        with path.open(encoding="utf-8", errors="replace") as file:
            first = file.readline().strip()
        if first != ",".join(_COLUMNS):
            raise PipelineError(texts.FILE_IS_THERE.format(name=name))
    replace_text(path, text)


def make_batch_command(name: str, stimuli: str, unit: str, stylus: str) -> ShownCommand:
    """Make the command that judges the scans of a list."""
    output = f"out/inspect-{PurePosixPath(name).stem}"
    words = ["inspect", protect_leading_hyphen(name), "--stimuli", protect_leading_hyphen(stimuli)]
    for option, answer in (("--units", unit), ("--stylus-radius", stylus)):
        if answer:
            words.append(f"{option}={answer}")
    words += ["-o", output]
    python = ""
    if not stylus:
        options = {"unit": unit} if unit else {}
        call = format_function_call("inspect_many", name, stimuli=stimuli, **options)
        result = call.replace("\n\n", "\n\nresult = ", 1)
        python = f"{result}\nstepblocks.write_many(result, {output!r})"
    return ShownCommand(texts.INSPECT_BATCH, tuple(words), python, f"{output}/{_PAGE}")


class BatchForm:
    """The fields of several scans, and below them the list and its command.

    Parameters
    ----------
    folder : Folder
    jobs : JobList
    scans : str
        Folder that the scans lie in.
    """

    def __init__(self, folder: Folder, jobs: JobList, scans: str) -> None:
        self._folder = folder
        self._jobs = jobs
        self._scans = scans
        self._serials: dict[str, ui.input] = {}
        self._parts: dict[str, ui.select] = {}
        self._identities: list[str] = []

    def build(self) -> None:
        """Make the fields, behind a fold."""
        with ui.expansion(texts.BATCH, on_value_change=self.refresh_offered_files).classes(
            "w-full"
        ) as fold:
            fold.mark("batch")
            ui.label(texts.BATCH_HELP.format(folder=self._scans))
            with ui.element("div").classes("fields"):
                self._stimuli = ui.select([], label=texts.STIMULUS_FILE_OF_PARTS, clearable=True)
                self._chosen = ui.select([], label=texts.BATCH_SCANS, multiple=True)
                self._unit = ui.input(texts.UNIT)
                self._stylus = ui.input(texts.STYLUS)
            self._rows = ui.column().classes("w-full")
            ui.button(texts.WRITE_LIST, on_click=self._write_list_and_show_command).props("no-caps")
            self._command = ui.column().classes("w-full")
        self._stimuli.classes("w-full").mark("batch-stimuli").on_value_change(self._offer_parts)
        self._chosen.classes("w-full").mark("batch-scans").on_value_change(self._show_scan_rows)

    def refresh_offered_files(self) -> None:
        """Offer what lies in the folder now."""
        entries = self._folder.list_entries()
        files = [entry.name for entry in entries if entry.kind is Kind.STIMULI]
        begin = f"{self._scans}/"
        scans = []
        for entry in entries:
            name = entry.name.removeprefix(begin)
            is_here = entry.kind is Kind.SCAN and entry.name == f"{begin}{name}"
            if is_here and name != _LIST:
                scans.append(name)
        chosen = [name for name in self._chosen.value or [] if name in scans]
        self._chosen.set_options(scans, value=chosen)
        self._stimuli.set_options(files)

    async def _offer_parts(self) -> None:
        """Offer the parts that the stimulus file declares."""
        self._command.clear()
        self._identities = []
        try:
            if self._stimuli.value:
                path = self._folder.resolve(str(self._stimuli.value))
                stimuli = await compute_in_background(self._command, load_set, path)
                declared = stimuli.stimuli if stimuli else ()  # none: the window is being closed
                self._identities = [part.id for part in declared]
        except StepblocksError as error:
            with self._command:
                show_mistake(error)
        self._show_scan_rows()

    def _show_scan_rows(self) -> None:
        """Show a row for each chosen scan; what was answered stays."""
        serials = {name: str(field.value or "") for name, field in self._serials.items()}
        parts = {name: field.value for name, field in self._parts.items()}
        self._rows.clear()
        self._serials = {}
        self._parts = {}
        with self._rows:
            for name in self._chosen.value or []:
                serial = serials.get(name, PurePosixPath(name).stem)
                part = parts.get(name)
                if part not in self._identities:
                    part = None
                with ui.row().classes("items-center"):
                    ui.label(name)
                    self._serials[name] = ui.input(f"{texts.SERIAL}: {name}", value=serial)
                    self._parts[name] = ui.select(
                        self._identities, label=f"{texts.PART}: {name}", value=part
                    )
                    self._serials[name].mark(f"serial-{name}")
                    self._parts[name].classes("min-w-[240px]").mark(f"part-{name}")

    def _write_list_and_show_command(self) -> None:
        """Write the list, and show the command that judges its scans."""
        self._command.clear()
        name = f"{self._scans}/{_LIST}"
        listed = []
        for scan, field in self._serials.items():
            part = str(self._parts[scan].value or "")
            listed.append(ListedScan(scan, part, str(field.value or "").strip()))
        with self._command:
            try:
                write_scan_list(self._folder, name, listed)
            except StepblocksError as error:
                show_mistake(error)
                return
            ui.label(texts.SAVED.format(name=name)).props("role=status")
            command = make_batch_command(
                name,
                str(self._stimuli.value),
                str(self._unit.value or "").strip(),
                str(self._stylus.value or "").strip(),
            )
            Runnable(command, self._folder, self._jobs, self._show_inspections_page)

    def _show_inspections_page(self, job: Job) -> None:
        """Show the page of all serial numbers."""
        show_embedded_page(
            self._folder, job.command.page, texts.REPORT_OF.format(title=texts.INSPECT_BATCH)
        )
