"""The window on a folder: its pages, and the server that shows them to its user alone."""

import logging
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from nicegui import app as framework, ui
from starlette.responses import FileResponse, PlainTextResponse, Response

from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.text import is_file
from stepblocks.window import texts
from stepblocks.window.folder import Folder
from stepblocks.window.folder_drop import add_folder_script
from stepblocks.window.frame import Page, build_frame
from stepblocks.window.gate import Gate
from stepblocks.window.jobs import JobList
from stepblocks.window.left_drafts import UnsavedDrafts
from stepblocks.window.many_files import add_many_files_script
from stepblocks.window.set_page import SetPage
from stepblocks.window.start_page import StartPage
from stepblocks.window.study_page import StudyPage
from stepblocks.window.work_page import ADDRESS, WorkPage

# A page that a busy machine keeps from answering for so long is not taken for closed [s]
_PATIENCE = 30.0


class Window:
    """The pages on a folder.

    Parameters
    ----------
    path : Path
        The folder.

    Raises
    ------
    PipelineError
        If there is no such folder.
    """

    def __init__(self, path: Path) -> None:
        self.folder = Folder(path)
        self.jobs = JobList(self.folder.path)
        self._left = UnsavedDrafts()
        start_page = StartPage(self.folder, self.jobs)
        study_page = StudyPage(self.folder, self.jobs)
        set_page = SetPage(self.folder, self.jobs)
        work_page = WorkPage(self.folder, self.jobs)
        self.pages = (
            Page("/", texts.START, start_page.build),
            Page("/declare", texts.DECLARE, self._build_declare_page),
            Page("/build", texts.BUILD_PAGE, self._build_build_page),
            Page("/inspect", texts.INSPECT, self._build_inspect_page),
            Page("/bench", texts.BENCH_PAGE, self._build_bench_page),
            Page("/study", texts.STUDY_PAGE, study_page.build),
            Page("/set", texts.SET_PAGE, set_page.build),
            Page(ADDRESS, texts.WORK, work_page.build),
        )

    def build(self) -> None:
        """Make the page that the address names."""
        add_folder_script()
        add_many_files_script()
        build_frame(self.pages)

    # what these need is loaded when they are opened: the first page is there at once

    def _build_declare_page(self, file: str = "", model: str = "") -> None:
        """Make the page to declare stimuli; `file` is opened, and `model` predicts."""
        from stepblocks.window.declare_page import DeclarePage

        DeclarePage(self.folder, self._left).build(file, model)

    def _build_build_page(self, file: str = "") -> None:
        """Make the page to build; `file` is chosen."""
        from stepblocks.window.build_page import BuildPage

        BuildPage(self.folder, self.jobs).build(file)

    def _build_inspect_page(self, file: str = "") -> None:
        """Make the page to judge a scan; `file` is looked at first."""
        from stepblocks.window.inspect_page import InspectPage

        InspectPage(self.folder, self.jobs).build(file)

    def _build_bench_page(self, session: str = "") -> None:
        """Make the page of the bench; `session` is opened."""
        from stepblocks.window.bench_page import BenchPage

        BenchPage(self.folder, self.jobs).build(session)

    def answer_with_file(self, name: str) -> Response:
        """Answer with a file of the folder; of what lies outside it there is none."""
        try:
            path = self.folder.resolve(name)
        except StepblocksError:
            return PlainTextResponse(texts.NO_FILE, 404)
        hidden = any(part.startswith(".") for part in path.relative_to(self.folder.path).parts)
        if hidden or not is_file(path):
            return PlainTextResponse(texts.NO_FILE, 404)
        return FileResponse(path)


def make_app(window: Window, port: int, token: str) -> Gate:
    """Make what a server runs: the pages and the files of a window, behind its gate."""
    site = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    site.add_api_route(
        f"{window.folder.address}{{name:path}}", window.answer_with_file, response_model=None
    )
    ui.run_with(
        site,
        root=window.build,
        title=texts.TITLE,
        dark=None,
        language="en-US",
        show_welcome_message=False,
        reconnect_timeout=_PATIENCE,
    )
    framework.on_exception(_show_internal_error)
    return Gate(site, port, token, window.folder.address)


def _show_internal_error() -> None:
    """Say in the window that something went wrong; what it was stands in the terminal."""
    with suppress(RuntimeError):  # of work for a page that was closed, nobody is told
        ui.notify(texts.INTERNAL_ERROR, type="negative")


def serve_window(window: Window, port: int, announce: Callable[[str], None]) -> None:
    """Serve a window on this machine until the user ends it.

    Parameters
    ----------
    window : Window
    port : int
        0 takes a free one.
    announce : callable
        Called with the address, which carries the token, when it can be opened.

    Raises
    ------
    PipelineError
        If the port is taken.
    """
    try:
        listener = socket.create_server(("127.0.0.1", port))
    except OSError as error:
        raise PipelineError(texts.PORT_IS_TAKEN.format(port=port, reason=error.strerror)) from error
    with listener:
        port = listener.getsockname()[1]
        token = secrets.token_urlsafe(32)
        logging.getLogger("nicegui").setLevel(logging.ERROR)
        site = make_app(window, port, token)
        window.jobs.take_over_killed_jobs()
        config = uvicorn.Config(site, log_level="error", access_log=False, server_header=False)
        announce(f"http://127.0.0.1:{port}/?token={token}")
        try:
            uvicorn.Server(config).run(sockets=[listener])
        finally:
            window.jobs.close()
