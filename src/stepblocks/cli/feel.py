"""``stepblocks feel``: a page on which the mouse drags the probe."""

from pathlib import Path
from typing import Annotated

import typer

from stepblocks.cli.command import command
from stepblocks.cli.options import Files, NoOpen
from stepblocks.cli.outcome import Outcome

app = typer.Typer()


@command(app, "feel", "feel", "feel mine.toml --no-open", panel="Simulators")
def feel(
    *,
    files: Files = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="HTML", help="page to write")
    ] = Path("out/feel.html"),
    no_open: NoOpen = False,
) -> Outcome:
    """Write a page on which the mouse drags the probe over a block.

    Writes one page that needs no network, and opens it: force, spectrum, locking, and the ring as
    sound.
    """
    from stepblocks.simulators.feel import write_feel_page

    page = output.with_suffix(output.suffix or ".html") if output.name else output
    count = write_feel_page(files or [], page)
    if not no_open:
        import webbrowser

        webbrowser.open(page.resolve().as_uri())
    return Outcome(f"{page}: {count} block{'s' if count != 1 else ''}", page=page)
