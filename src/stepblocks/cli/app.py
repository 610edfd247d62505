"""``stepblocks app``: a window on the whole pipeline."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import register_command
from stepblocks.cli.options import NoOpen, Port
from stepblocks.cli.outcome import Outcome
from stepblocks.errors import PipelineError

app = typer.Typer()


@register_command(app, "app", "app", "app lab --port 8080", "app lab --no-open", panel="Begin")
def open_window(
    *,
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER",
            help="folder of your stimuli, scans, sessions and studies",
            show_default="the current one",
        ),
    ] = None,
    port: Port = 0,
    no_open: NoOpen = False,
) -> Outcome:
    """Open a window on a folder in the browser: its files, and what can be done with them.

    Only this machine can open it, by an address with a token. Ctrl-C ends it (extra app).
    """
    try:
        from stepblocks.window.window import Window, serve_window
    except ModuleNotFoundError as error:
        raise PipelineError(
            f"the window needs {error.name}: install the extra with pip install 'stepblocks[app]'"
        ) from error

    window = Window(folder or Path())

    def announce(address: str) -> None:
        print(f"open {address}", flush=True)
        if not no_open:
            import webbrowser

            webbrowser.open(address)

    with suppress(KeyboardInterrupt):
        serve_window(window, port, announce)
    return Outcome("the window is closed")
