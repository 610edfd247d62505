"""The page of the bench: a session in, its columns named beside a trace, what the model lacks."""

from pathlib import PurePosixPath

from nicegui import events, ui

from stepblocks.bench.session import open_session
from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.text import is_file
from stepblocks.window import texts
from stepblocks.window.agreement import RESULT_FILE
from stepblocks.window.declaration_check import DeclarationCheck
from stepblocks.window.folder import Entry, Folder, Kind
from stepblocks.window.folder_drop import accept_dropped_folders
from stepblocks.window.frame import compute_in_background, show_heading, show_mistake
from stepblocks.window.gate import LARGEST_UPLOAD, make_size_error
from stepblocks.window.job_view import Runnable, show_embedded_page
from stepblocks.window.jobs import Job, JobList
from stepblocks.window.loop_view import LoopView
from stepblocks.window.session_files import SETTINGS, SessionDraft, Setting, unpack_session
from stepblocks.window.suggestions import suggest_commands
from stepblocks.window.trace_picture import TracePicture, read_and_draw_trace

_LOOP = "loop"  # the command
_SESSIONS = "sessions"  # folder that dropped sessions are put into


class BenchPage:
    """The page on which sessions of a folder are measured and explained."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs

    def build(self, session: str = "") -> None:
        """Make the page; `session` is opened."""
        BenchForm(self._folder, self._jobs).build(session)


class BenchForm:
    """What one opened page shows, with the session that is open in it."""

    def __init__(self, folder: Folder, jobs: JobList) -> None:
        self._folder = folder
        self._jobs = jobs
        self._fields: dict[str, ui.input | ui.select] = {}

    def build(self, session: str) -> None:
        """Make the page."""
        show_heading(texts.BENCH_PAGE)
        ui.label(texts.BENCH_HELP)
        upload = ui.upload(
            label=texts.DROP_SESSION, max_file_size=LARGEST_UPLOAD, auto_upload=True
        ).mark("drop")
        upload.on_upload(self._unpack_dropped_archive)
        upload.on_rejected(lambda: self._show_refusal(make_size_error()))
        accept_dropped_folders(
            upload, lambda: self._show_refusal(PipelineError(texts.FOLDER_UNREAD))
        )
        names = self._get_session_names()
        first = session or next(iter(names), "")
        with ui.row().classes("items-center"):
            self._name = ui.input(texts.SESSION, value=first, autocomplete=names)
            self._name.classes("min-w-[400px]")
            ui.button(texts.OPEN, on_click=self._show_session).props("no-caps")
        self._place = ui.column().classes("w-full")
        if first:
            ui.timer(0.0, self._show_session, once=True)

    def _get_session_names(self) -> list[str]:
        """Return the names of the sessions in the folder."""
        return self._folder.list_names(Kind.SESSION)

    async def _unpack_dropped_archive(self, event: events.UploadEventArguments) -> None:
        """Unpack a dropped archive into the folder, and open it."""
        self._place.clear()
        try:
            name = self.choose_session_folder(event.file.name)
            content = await event.file.read()
            target = self._folder.resolve(name)
            await compute_in_background(self._place, unpack_session, content, target)
        except StepblocksError as error:
            with self._place:
                show_mistake(error)
            return
        self._name.set_value(name)
        await self._show_session()

    def _show_refusal(self, error: PipelineError) -> None:
        """Say why what was dropped is not taken."""
        self._place.clear()
        with self._place:
            show_mistake(error)

    def choose_session_folder(self, archive_name: str) -> str:
        """Return the folder of a session for a dropped archive.

        Raises
        ------
        PipelineError
            If it is no zip file by its name, or its name leads elsewhere.
        """
        name = PurePosixPath(archive_name.replace("\\", "/"))
        stem = name.stem
        if name.suffix.lower() != ".zip" or not stem or stem.startswith("."):
            raise PipelineError(texts.NO_ARCHIVE.format(name=name.name))
        self._folder.resolve(f"{_SESSIONS}/{stem}")
        return f"{_SESSIONS}/{stem}"

    async def _show_session(self) -> None:
        """Show the settings of a session beside its first trace, and its commands."""
        self._place.clear()
        name = str(self._name.value).strip()
        try:
            folder = self._folder.resolve(name)
            if not folder.is_dir():
                raise PipelineError(texts.NO_SESSION.format(name=name))
            draft = SessionDraft(folder)
        except StepblocksError as error:
            with self._place:
                show_mistake(error)
            return
        trace = draft.find_first_trace()
        picture = None
        unread = None
        try:
            if trace is not None:
                picture = await compute_in_background(self._place, read_and_draw_trace, trace)
        except StepblocksError as error:  # the settings may say why
            unread = error
        with self._place:
            if unread is not None:
                show_mistake(unread)
            self._show_settings(draft, picture, name)
            for command in suggest_commands(Entry(name, Kind.SESSION)):
                Runnable(command, self._folder, self._jobs, self._show_loop_result)
            await self._show_earlier_loop(name)

    def _show_settings(self, draft: SessionDraft, picture: TracePicture | None, name: str) -> None:
        """Show the fields of the settings; beside them the first trace, and what traces say."""
        columns: list[str] = []
        if picture is not None:
            columns = list(picture.columns)
        with ui.element("div").classes("beside"):
            with ui.column():
                ui.label(texts.COLUMNS_HELP)
                with ui.element("div").classes("channels"):
                    for setting in SETTINGS:
                        if setting.part is not None:
                            self._add_field(draft, setting, columns)
                for setting in SETTINGS:
                    if setting.part is None:
                        self._add_field(draft, setting, columns)
                button = ui.button(texts.SAVE).props("no-caps")
                place = ui.column()
            with ui.column():
                if picture is None:
                    ui.label(texts.NO_TRACE)
                else:
                    ui.label(texts.FIRST_TRACE.format(columns=", ".join(columns)))
                    image = ui.image(picture.image).classes("w-full")
                    image.props(f'alt="{texts.TRACE_PICTURE}"')
                check = DeclarationCheck(name, self._folder, self._jobs)
                check.build()
        button.on_click(lambda: self._save_settings(draft, place, check))

    def _add_field(self, draft: SessionDraft, setting: Setting, columns: list[str]) -> None:
        """Add the field of a setting; a column is chosen among those of the trace, or typed."""
        first = draft.read_setting(setting)
        field: ui.input | ui.select
        if setting.is_column:
            offered = list(dict.fromkeys([*columns, *filter(None, [first])]))
            field = ui.select(
                offered,
                label=setting.label,
                value=first or None,
                with_input=True,
                new_value_mode="add-unique",
            )
        else:
            field = ui.input(setting.label, value=first)
            if setting.part is not None:
                field.props(f'aria-label="{setting.path[-1]}: {setting.label}"')
        self._fields[setting.name] = field.classes("w-full").mark(setting.name)

    def _save_settings(
        self, draft: SessionDraft, container: ui.element, check: DeclarationCheck
    ) -> None:
        """Save the settings, and say what is still wrong with the session."""
        container.clear()
        with container:
            try:
                for setting in SETTINGS:
                    draft.write_setting(setting, str(self._fields[setting.name].value or ""))
                draft.save()
                ui.label(texts.SAVED.format(name=draft.folder.name)).props("role=status")
                check.show_latest_result()
                open_session(draft.folder)
            except StepblocksError as error:
                show_mistake(error)

    async def _show_loop_result(self, job: Job) -> None:
        """Show what a loop found, and its report; of a measured session there is no more."""
        if job.command.words[0] != _LOOP:
            return
        report = job.command.page
        if not is_file(self._folder.resolve(report)):
            return
        await self._show_loop(job.command.words[1], PurePosixPath(report).parent.as_posix())
        show_embedded_page(self._folder, report, texts.REPORT_OF.format(title=job.command.title))

    async def _show_earlier_loop(self, session: str) -> None:
        """Show what a loop found before the window was opened, where it has."""
        for command in suggest_commands(Entry(session, Kind.SESSION)):
            output = PurePosixPath(command.page).parent.as_posix()
            is_done = is_file(self._folder.resolve(f"{output}/{RESULT_FILE}"))
            if command.words[0] == _LOOP and is_done and self._jobs.find_last(command) is None:
                await self._show_loop(session, output)

    async def _show_loop(self, session: str, output: str) -> None:
        """Show what the loop of a session found."""
        await LoopView(session, output, self._folder, self._jobs).build()
