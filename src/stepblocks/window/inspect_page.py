"""The page to judge a scan: what its file leaves open is asked beside a picture of the data."""

import asyncio
import glob
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from nicegui import events, ui

from stepblocks.declaration.read import load_set
from stepblocks.errors import PipelineError, QuantityError, StepblocksError
from stepblocks.files.atomic import replace_bytes
from stepblocks.files.text import is_file
from stepblocks.quantities import format_units, parse_quantity
from stepblocks.scans.read import FORMATS
from stepblocks.window import texts
from stepblocks.window.batch_form import BatchForm
from stepblocks.window.command_line import (
    ShownCommand,
    format_constructor_call,
    format_function_call,
    protect_leading_hyphen,
)
from stepblocks.window.folder import Folder, Kind
from stepblocks.window.frame import compute_in_background, is_gone, show_heading, show_mistake
from stepblocks.window.gate import LARGEST_UPLOAD, MOST_FILES, make_size_error
from stepblocks.window.job_view import Runnable, show_embedded_page
from stepblocks.window.jobs import Job, JobList
from stepblocks.window.latest_work import LatestWork
from stepblocks.window.many_files import accept_many_files
from stepblocks.window.scan_picture import ScanPicture, read_and_draw_scan

if TYPE_CHECKING:
    from stepblocks.window.scan_edges import ScanEdge

_SCANS = "scans"  # folder that dropped scans are put into
_PAGE = "inspection.html"
_QUIET = 0.4  # a dropped scan is looked at when no other has come for so long [s]
_MOST_REFUSED = 20  # dropped files of which is said at once why they were not taken


@dataclass(frozen=True)
class InspectionAnswers:
    """What a user said of a scan; an empty text leaves it to the file.

    Attributes
    ----------
    scan, part, stimuli : str
        Name of the file, identity of the part, and the stimulus file that declares it.
    unit, channel, stylus_radius, calibration : str
        As the command takes them.
    begin, end : str
        Part of the profiles that holds the working edge alone.
    """

    scan: str
    part: str
    stimuli: str
    unit: str = ""
    channel: str = ""
    stylus_radius: str = ""
    calibration: str = ""
    begin: str = ""
    end: str = ""

    def make_command(self) -> ShownCommand:
        """Make the command that judges the scan."""
        output = f"out/inspect-{PurePosixPath(self.scan).stem}"
        words = ["inspect", protect_leading_hyphen(self.scan), "--stimulus", self.part]
        words += ["--stimuli", protect_leading_hyphen(self.stimuli)]
        for option, text in (
            ("--units", self.unit),
            ("--channel", self.channel),
            ("--stylus-radius", self.stylus_radius),
            ("--calibration", self.calibration),
            ("--from", self.begin),
            ("--to", self.end),
        ):
            if text:
                words.append(f"{option}={text}")
        words += ["-o", output]
        page = f"{output}/{self.part}.{_PAGE}"
        return ShownCommand(texts.INSPECT_THIS, tuple(words), self._format_python(output), page)

    def _format_python(self, output: str) -> str:
        """Write the same in Python; nothing where an answer is none that the command takes."""
        given: dict[str, object] = {"unit": self.unit or None, "channel": self.channel or None}
        try:
            if self.calibration:
                calibration = parse_quantity(self.calibration, "ratio")
                given["instrument"] = format_constructor_call(
                    "Instrument", calibration_std=calibration
                )
            if self.begin or self.end or self.stylus_radius:
                given["options"] = format_constructor_call(
                    "EvaluationOptions",
                    begin=_read_length(self.begin),
                    end=_read_length(self.end),
                    stylus_radius=_read_length(self.stylus_radius),
                )
        except QuantityError:
            return ""
        options = {name: value for name, value in given.items() if value is not None}
        judge = format_function_call(
            "inspect_scan", self.scan, self.part, stimuli=self.stimuli, **options
        )
        result = judge.replace("\n\n", "\n\nresult = ", 1)
        return f"{result}\nstepblocks.write_inspection(result, {output!r})"


def _read_field(field: ui.input) -> str:
    """Read what a field says, without spaces at its ends."""
    return str(field.value).strip()


def _read_length(text: str) -> float | None:
    """Read a length [m]; None where nothing was said."""
    return parse_quantity(text, "length") if text else None


class InspectPage:
    """The page on which scans of a folder are judged."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self, file: str = "") -> None:
        """Make the page; `file` is the scan that is looked at first."""
        InspectForm(self._folder, self._jobs).build(file)


class InspectForm:
    """What one opened page shows, with what was answered in it."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs
        self._edge: ScanEdge | None = None
        self._is_shown = False
        self._taken = 0
        self._is_receiving = False
        self._looks = LatestWork(self._show_last_dropped_scan)

    def build(self, file: str) -> None:
        """Make the page."""
        show_heading(texts.INSPECT)
        upload = ui.upload(
            label=texts.DROP_SCAN, max_file_size=LARGEST_UPLOAD, auto_upload=True, multiple=True
        ).mark("drop")
        self._state = ui.label().props("role=status")
        self._refused = ui.column()
        with ui.element("div").classes("beside"):
            with ui.column():
                scans = self._folder.list_names(Kind.SCAN)
                self._scan = ui.input(texts.SCAN, value=file, autocomplete=scans)
                self._part = ui.select({}, label=texts.PART, with_input=True)
                self._unit = ui.input(texts.UNIT)
                self._channel = ui.input(texts.CHANNEL)
                self._stylus = ui.input(texts.STYLUS)
                self._calibration = ui.input(texts.CALIBRATION)
                for box in (self._scan, self._part, self._unit, self._channel, self._stylus):
                    box.classes("w-full")
                self._calibration.classes("w-full")
                for field in (self._part, self._stylus, self._calibration):
                    field.on_value_change(self._refresh_command_if_shown)
                ui.button(texts.LOOK, on_click=self._show_named_scan).props("no-caps")
            self._picture = ui.column()
        self._command = ui.column().classes("w-full")
        self._batch = BatchForm(self._folder, self._jobs, _SCANS)
        self._batch.build()
        upload.on_upload(self._save_dropped_scan)
        upload.on_rejected(lambda: self._show_refusal(make_size_error()))
        accept_many_files(
            upload, self._refuse_all, self._begin_receiving_many, self._end_receiving_many
        )
        ui.timer(0.0, self._offer_parts, once=True)

    async def _offer_parts(self) -> None:
        """Offer the parts to choose from; the page is there before all files are read."""
        parts = await compute_in_background(self._picture, self._list_parts)
        self._part.set_options(parts or {})

    def _list_parts(self) -> dict[str, str]:
        """List the parts of all stimulus files of the folder that can be read, by file and part."""
        parts = {}
        for name in self._folder.list_names(Kind.STIMULI):
            try:
                stimuli = load_set(self._folder.resolve(name))
            except StepblocksError:  # the page to declare says what is wrong with it
                continue
            for part in stimuli.stimuli:
                parts[f"{name}\n{part.id}"] = f"{part.id} ({name})"
        return parts

    async def _save_dropped_scan(self, event: events.UploadEventArguments) -> None:
        """Put a dropped scan into the folder, and show the last of several."""
        try:
            name = self.choose_scan_name(event.file.name)
            replace_bytes(self._folder.resolve(name), await event.file.read())
        except StepblocksError as error:
            self._show_refusal(error)
            return
        self._scan.set_value(name)
        self._taken += 1
        self._state.set_text(texts.TAKEN.format(count=self._taken, folder=_SCANS))
        self._looks.request()

    def _show_refusal(self, error: StepblocksError) -> None:
        """Say why a dropped file was not taken, below what was said of those before it."""
        if len(self._refused.default_slot.children) == _MOST_REFUSED:
            self._refused.clear()
        with self._refused:
            show_mistake(error)

    def _refuse_all(self, count: int) -> None:
        """Say that more files were dropped at once than are taken."""
        self._show_refusal(
            PipelineError(texts.TOO_MANY_DROPPED.format(most=MOST_FILES, count=count))
        )

    def _begin_receiving_many(self) -> None:
        """Look at no scan until all of many have come."""
        self._is_receiving = True

    def _end_receiving_many(self, missing_count: int) -> None:
        """Look at the last of many scans, and say how many did not arrive."""
        self._is_receiving = False
        if missing_count:
            self._show_refusal(PipelineError(texts.NOT_ARRIVED.format(count=missing_count)))
        if self._taken:
            self._looks.request()

    async def _show_last_dropped_scan(self) -> None:
        """Look at the scan that was dropped last, once all are there, and offer them for a list."""
        seen = -1
        while seen != self._taken:
            seen = self._taken
            await asyncio.sleep(_QUIET)
        if self._is_receiving or is_gone(self._picture):
            return
        self._batch.refresh_offered_files()
        await self._show_scan()

    def choose_scan_name(self, file_name: str) -> str:
        """Return the name in the folder for a dropped file.

        Raises
        ------
        PipelineError
            If its ending is that of no scan, its name leads elsewhere, or such a file is there.
        """
        name = PurePosixPath(file_name.replace("\\", "/")).name
        if PurePosixPath(name).suffix.lower() not in FORMATS:
            raise PipelineError(texts.NO_SCAN.format(endings=", ".join(FORMATS), name=name))
        target = f"{_SCANS}/{name}"
        if name.startswith(".") or self._folder.resolve(target).exists():
            raise PipelineError(texts.FILE_IS_THERE.format(name=target))
        return target

    async def _show_named_scan(self) -> None:
        """Look at the scan that is named; what was refused before is read by now."""
        self._refused.clear()
        await self._show_scan()

    async def _show_scan(self) -> None:
        """Show the scan as it is read now, or what its file leaves open; then the command."""
        self._picture.clear()
        self._command.clear()
        self._is_shown = False
        try:
            path = self._folder.resolve(str(self._scan.value).strip())
            unit = str(self._unit.value).strip() or None
            channel = str(self._channel.value).strip() or None
            picture = await compute_in_background(
                self._picture, read_and_draw_scan, path, unit, channel
            )
        except StepblocksError as error:
            with self._picture:
                show_mistake(error)
            return
        if picture is None:  # the window is being closed
            return
        with self._picture:
            ui.label(format_units(picture.description)).mark("description")
            ui.label(picture.scale)
            self._show_picture(picture)
        self._is_shown = True
        self._show_command()

    def _show_picture(self, picture: ScanPicture) -> None:
        """Show the picture of a scan, on which the working edge can be picked where it has several.

        Whoever does not use a mouse picks it in the list below.
        """
        self._edge = None
        image = ui.interactive_image(picture.image, on_mouse=lambda event: pick_edge(event.image_x))
        image.props(f'alt="{texts.SCAN_PICTURE}"').classes("w-full").mark("picture")
        if len(picture.edges) < 2:
            return
        ui.label(texts.PICK_EDGE)
        by_name = {edge.name: edge for edge in picture.edges}
        choice = ui.select(list(by_name), label=texts.WORKING_EDGE, clearable=True)
        choice.classes("w-full").mark("edge")

        def pick_edge(column: float) -> None:
            """Choose the edge nearest to a column of the picture."""
            edge = picture.find_nearest_edge(column)
            if edge is not None:
                choice.set_value(edge.name)

        def take_edge(event: events.ValueChangeEventArguments[str | None]) -> None:
            """Take the chosen edge, and show the command for it."""
            self._edge = by_name.get(event.value or "")
            self._show_command()

        choice.on_value_change(take_edge)

    def _refresh_command_if_shown(self) -> None:
        """Show the command for an answer that changed, once the scan was looked at."""
        if self._is_shown:
            self._show_command()

    def _show_command(self) -> None:
        """Show the command for what the fields say."""
        self._command.clear()
        with self._command:
            if self._part.value is None:
                ui.label(texts.CHOOSE_PART)
                return
            command = self._read_answers().make_command()
            Runnable(command, self._folder, self._jobs, self._show_inspection_result)

    def _show_inspection_result(self, job: Job) -> None:
        """Show the page of an inspection, and every file that it wrote."""
        page = self._folder.resolve(job.command.page)
        if not is_file(page):
            return
        begin = page.name.removesuffix(_PAGE)
        with ui.row():
            for path in sorted(page.parent.glob(f"{glob.escape(begin)}*")):
                name = path.relative_to(self._folder.path).as_posix()
                ui.link(path.name, self._folder.make_file_address(name), new_tab=True)
        show_embedded_page(
            self._folder, job.command.page, texts.REPORT_OF.format(title=texts.INSPECT_THIS)
        )

    def _read_answers(self) -> InspectionAnswers:
        """Return what the fields and the picked edge say."""
        file, _, part = str(self._part.value).partition("\n")
        begin = end = ""
        if self._edge is not None:
            begin, end = self._edge.begin, self._edge.end
        return InspectionAnswers(
            scan=_read_field(self._scan),
            part=part,
            stimuli=file,
            unit=_read_field(self._unit),
            channel=_read_field(self._channel),
            stylus_radius=_read_field(self._stylus),
            calibration=_read_field(self._calibration),
            begin=begin,
            end=end,
        )
