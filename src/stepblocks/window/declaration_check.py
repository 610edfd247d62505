"""What the traces of a session say of its declaration, beside the first of them."""

import hashlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from nicegui import ui
from pydantic import TypeAdapter, ValidationError

from stepblocks.errors import BenchError, PipelineError, StepblocksError
from stepblocks.files.text import is_file, read_document
from stepblocks.loop.declared_checks import CalibrationCheck, RateCheck, SessionCheck
from stepblocks.quantities import format_number, format_units
from stepblocks.window import texts
from stepblocks.window.command_line import (
    ShownCommand,
    format_function_call,
    protect_leading_hyphen,
)
from stepblocks.window.folder import OUTPUT, Folder
from stepblocks.window.frame import make_table_columns, show_heading, show_message, show_mistake
from stepblocks.window.job_view import Runnable
from stepblocks.window.jobs import Job, JobList
from stepblocks.window.session_files import SESSION_FILE

_LARGEST = 1_000_000  # of a result [bytes]
_DIGITS = 4  # of a declared or shown figure
_NEWTON_PER_MILLIMETRE = 1e3  # [N/m]
_RESULT = TypeAdapter(SessionCheck)


@dataclass(frozen=True)
class CheckRow:
    """A declared figure beside what is shown of it, as the table has it."""

    quantity: str
    declared: str
    shown: str
    ratio: str
    verdict: str


def name_check_file(session: str) -> str:
    """Return the file of the folder that the check of a session is written to."""
    return f"{OUTPUT}/{PurePosixPath(session).name}-check.json"


def make_declaration_check_command(session: str) -> ShownCommand:
    """Make the command that holds some trials of a session against its declaration."""
    target = name_check_file(session)
    words = ("measure", protect_leading_hyphen(session), "--check", target)
    return ShownCommand(
        texts.CHECK_SESSION, words, format_function_call("check_session", session, target)
    )


def read_check_result(path: Path) -> SessionCheck:
    """Read the result of a check.

    Raises
    ------
    PipelineError
        If the file is none that the check writes.
    """
    document = read_document(
        path, texts.CHECK_RESULT, PipelineError, most_bytes=_LARGEST, file_format="JSON"
    )
    try:
        return _RESULT.validate_python(document)
    except ValidationError as error:
        raise PipelineError(texts.NO_CHECK_RESULT.format(path=path)) from error


def list_check_rows(check: SessionCheck) -> list[CheckRow]:
    """List what a check shows of spring, load, sample rate and ring, row by row."""
    rows = []
    if check.spring is not None:
        rows.append(_make_spring_row(check.spring, check.spring_constant))
    if check.load is not None:
        row = CheckRow(
            texts.SET_LOADS,
            texts.BY_TRIAL,
            "",
            _format_shown_over_declared(check.load),
            _describe_verdict(check.load.contradicts, check.load.slip),
        )
        rows.append(row)
    if check.rate is not None:
        rows.append(_make_rate_row(check.rate))
    if check.ring_frequency is not None:
        verdict = texts.RINGS_UNUSUALLY
        if check.rings_as_usual:
            verdict = texts.RINGS_AS_USUAL
        shown = _format_frequency(check.ring_frequency)
        rows.append(CheckRow(texts.RING, "", shown, "", verdict))
    return rows


def _make_spring_row(spring: CalibrationCheck, declared_constant: float) -> CheckRow:
    """Make the row of the spring; `declared_constant` is its constant [N/m]."""
    constant = declared_constant / _NEWTON_PER_MILLIMETRE
    values = {"value": spring.shown, "low": spring.low, "high": spring.high}
    written = {name: f"{constant * ratio:.{_DIGITS}g}" for name, ratio in values.items()}
    return CheckRow(
        texts.SPRING_CONSTANT,
        texts.NEWTON_PER_MILLIMETRE.format(value=f"{constant:.{_DIGITS}g}"),
        texts.NEWTON_PER_MILLIMETRE.format(value=texts.INTERVAL.format(**written)),
        _format_shown_over_declared(spring),
        _describe_verdict(spring.contradicts, spring.slip),
    )


def _make_rate_row(rate: RateCheck) -> CheckRow:
    """Make the row of the sample rate, by the time of the traces."""
    return CheckRow(
        texts.RATE,
        _format_frequency(rate.declared),
        _format_frequency(rate.declared * rate.shown),
        _format_shown_over_declared(rate),
        _describe_verdict(rate.contradicts, rate.slip),
    )


def _format_frequency(frequency: float) -> str:
    """Write a frequency [Hz]."""
    return texts.HERTZ.format(value=format_number(frequency))


def _format_shown_over_declared(check: CalibrationCheck | RateCheck) -> str:
    """Write what is shown over what is declared, with its interval."""
    values = {"value": check.shown, "low": check.low, "high": check.high}
    written = {name: f"{value:.3f}" for name, value in values.items()}
    return texts.INTERVAL.format(**written)


def _describe_verdict(contradicts: bool, slip: float | None) -> str:
    """Say whether the declaration stands, and near which factor it does not."""
    if not contradicts:
        return texts.AGREES
    if slip is None:
        return texts.CONTRADICTED
    if slip < 1.0:
        return texts.CONTRADICTED_BY_SHARE.format(factor=f"{1.0 / slip:g}")
    return texts.CONTRADICTED_BY_FACTOR.format(factor=f"{slip:g}")


class DeclarationCheck:
    """The command that checks a session, and below it what it found.

    Parameters
    ----------
    session : str
        Name of its folder in that of the window.
    folder : Folder
    jobs : JobList
    """

    def __init__(self, session: str, folder: Folder, jobs: JobList) -> None:
        self._session = session
        self._folder = folder
        self._jobs = jobs

    def build(self) -> None:
        """Show the command, and what it found when it was run last."""
        show_heading(texts.CHECK_HEADING, 2)
        ui.label(texts.CHECK_HELP)
        Runnable(
            make_declaration_check_command(self._session),
            self._folder,
            self._jobs,
            self._show_ended_run,
        )
        self._place = ui.column().classes("w-full")
        self.show_latest_result()

    def _show_ended_run(self, _: Job) -> None:
        """Show what a run found that has ended."""
        self.show_latest_result()

    def show_latest_result(self) -> None:
        """Show what was found last, and whether the session was changed since."""
        self._place.clear()
        with self._place:
            try:
                path = self._folder.resolve(name_check_file(self._session))
                if is_file(path):
                    self._show_result(read_check_result(path))
            except StepblocksError as error:
                show_mistake(error)

    def _show_result(self, check: SessionCheck) -> None:
        """Show a result, row by row, and the contradictions as the command prints them."""
        if check.digest != self._hash_session():
            show_message(texts.CHECK_IS_OLD)
        ui.label(texts.CHECKED.format(measured=check.measured, total=check.looked_at)).props(
            "role=status"
        )
        rows = list_check_rows(check)
        if rows:
            columns = make_table_columns(texts.CHECK_COLUMNS)
            table = ui.table(columns=columns, rows=[vars(row) for row in rows])
            table.props("wrap-cells dense").classes("w-full").mark("check")
        if check.reason:
            ui.label(format_units(texts.NOT_MEASURED.format(reason=check.reason)))
        for sentence in check.contradictions:
            show_message(sentence)

    def _hash_session(self) -> str:
        """Return the SHA-256 of the session.toml as it is now.

        Raises
        ------
        BenchError
            If it cannot be read.
        """
        path = self._folder.resolve(self._session) / SESSION_FILE
        try:
            return hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError as error:
            raise BenchError(
                texts.CANNOT_BE_READ.format(name=SESSION_FILE, reason=error.strerror)
            ) from error
