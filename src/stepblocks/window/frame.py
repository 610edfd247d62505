"""What every page has: the bar with its links, the colours, and how a mistake is shown."""

import asyncio
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from importlib.resources import files
from typing import ParamSpec, TypeVar

from nicegui import run, ui

from stepblocks.errors import StepblocksError
from stepblocks.quantities import format_units
from stepblocks.window import texts
from stepblocks.window.command_line import ShownCommand

_Arguments = ParamSpec("_Arguments")
_Found = TypeVar("_Found")

# Readable in both colours: the contrast of text on its ground is 4.5 at least (WCAG 2.2, 1.4.3)
_STYLE = """
<style>
  body { font-family: system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
  .skip { position: absolute; left: -999px; }
  .skip:focus { left: 8px; top: 8px; z-index: 9999; background: #fff; padding: 4px 8px; }
  .window-content { max-width: 1240px; margin: 0 auto; width: 100%; padding: 12px; }
  .window-content h1 { font-size: 26px; font-weight: 500; line-height: 1.2; margin: 8px 0 4px; }
  .window-content h2 { font-size: 20px; font-weight: 500; line-height: 1.2; margin: 16px 0 4px; }
  .q-field--with-bottom { padding-bottom: 12px; }
  .q-field__bottom--animated { position: static; transform: none; }
  .body--dark .q-slider, .body--dark .q-linear-progress { color: #7cc4de; }
  .q-uploader__subtitle { display: none; }
  .q-table__card { box-shadow: none; border: 1px solid #8a8a8a66; }
  .command { font-family: ui-monospace, monospace; white-space: pre-wrap; word-break: break-word; }
  .mistake { color: #b3261e; white-space: pre-wrap; }
  .body--dark .mistake { color: #ff9b86; }
  .nicegui-link { color: #1b6480; }
  .body--dark .nicegui-link { color: #7cc4de; }
  .quiet { color: #1b6480; }
  .body--dark .quiet { color: #7cc4de; }
  .beside { display: grid; gap: 24px; width: 100%; grid-template-columns: minmax(0, 1fr); }
  @media (min-width: 1000px) { .beside { grid-template-columns: minmax(0, 2fr) minmax(0, 3fr); } }
  .fields { display: grid; gap: 4px 24px; width: 100%; grid-template-columns: 1fr; }
  @media (min-width: 700px) { .fields { grid-template-columns: 1fr 1fr; } }
  .channels { display: grid; gap: 0 12px; width: 100%; grid-template-columns: 3fr 1fr 2fr; }
  .moves { list-style: disc; padding-left: 24px; margin: 0; }
  .axis { position: relative; height: 176px; width: 100%; touch-action: none; user-select: none;
    overflow: hidden; background: linear-gradient(currentColor, currentColor) 0 64px / 100% 2px
    no-repeat; }
  .axis-tick, .axis-target, .axis-block { position: absolute; transform: translateX(-50%); }
  .axis-tick { top: 150px; font-size: 13px; }
  .axis-tick::before { content: ""; position: absolute; left: 50%; top: -88px; height: 88px;
    border-left: 1px dotted #8a8a8a; }
  .axis-target { top: 22px; width: 24px; height: 42px; cursor: ew-resize; z-index: 2; }
  .axis-target::before { content: ""; position: absolute; left: 4px; top: 0; width: 16px;
    height: 16px; border-radius: 50%; background: #b0506a; }
  .axis-target::after { content: ""; position: absolute; left: 11px; top: 16px; height: 26px;
    border-left: 2px solid #b0506a; }
  .axis-missed::before { background: #fff; border: 3px solid #b3261e; }
  .axis-block { top: calc(82px + 1.5em * var(--row)); font-size: 13px; white-space: nowrap;
    z-index: 1; }
  .axis-block > div { position: relative; background: #fff; }
  .body--dark .axis-block > div { background: var(--q-dark-page); }
  .axis-block::before { content: ""; position: absolute; left: 50%;
    top: calc(-17px - 1.5em * var(--row)); height: calc(17px + 1.5em * var(--row));
    border-left: 3px solid #2f6f9f; }
  .body--dark .axis-block::before { border-color: #7cc4de; }
  .report { width: 100%; height: 720px; border: 1px solid #8a8a8a; background: #fff; }
  .q-header .nicegui-link { color: #fff; padding: 2px 6px; border-radius: 4px; }
  .q-header .here { background: #fff; color: #1b6480; font-weight: 600; text-decoration: none; }
</style>
"""
# The framework hides the field for files within a button without a name. Here the field itself has
# the name, and is reached by the keyboard.
_NAME_FILE_FIELDS = """
<script>
  new MutationObserver(() => {
    for (const field of document.querySelectorAll('.q-uploader__input[tabindex="-1"]')) {
      const title = field.closest('.q-uploader').querySelector('.q-uploader__title');
      field.tabIndex = 0;
      field.setAttribute('aria-label', title.textContent);
      field.parentElement.closest('.q-btn').removeAttribute('role');
      field.parentElement.closest('.q-btn').removeAttribute('tabindex');
    }
  }).observe(document, { childList: true, subtree: true });
</script>
"""
_COLOUR = "#1b6480"


@dataclass(frozen=True)
class Page:
    """A page of the window.

    Attributes
    ----------
    path : str
        Its address.
    title : str
        What the bar calls it.
    build : callable
        Makes its elements.
    """

    path: str
    title: str
    build: Callable[..., object]


def build_frame(pages: Sequence[Page]) -> None:
    """Make the bar, and below it the page that the address names."""
    ui.add_head_html(_STYLE + _NAME_FILE_FIELDS)
    ui.page_title(texts.TITLE)
    ui.colors(primary=_COLOUR)
    colours = ui.dark_mode(None)
    ui.html(f'<a class="skip" href="#content">{texts.SKIP_TO_CONTENT}</a>', sanitize=False)
    with (
        ui.header().style(f"background-color: {_COLOUR}"),
        ui.row().props(f'role=navigation aria-label="{texts.NAVIGATION}"'),
    ):
        links = {page.path: ui.link(page.title, page.path) for page in pages}
        switch = ui.button(icon="contrast", on_click=lambda: _switch_colour_mode(colours))
        switch.props(f'flat dense color=white aria-label="{texts.COLOURS}"').tooltip(texts.COLOURS)
    router = ui.context.client.sub_pages_router
    router.on_path_changed(partial(_mark_current_page, links))
    _mark_current_page(links, router.current_path)
    with ui.element("div").classes("window-content").props("id=content tabindex=-1"):
        ui.sub_pages({page.path: page.build for page in pages})


def add_script(name: str, limits: Mapping[str, int]) -> None:
    """Add a script of this folder, a function that is called with limits, to the head of a page."""
    function = files(__package__).joinpath(name).read_text(encoding="utf-8").rstrip()
    ui.add_head_html(f"<script>\n{function}({json.dumps(limits)});\n</script>")


def _mark_current_page(links: Mapping[str, ui.link], address: str) -> None:
    """Mark the link of the page that an address opens, for eyes and for listeners."""
    shown_path = address.partition("?")[0]
    for path, link in links.items():
        if path == shown_path:
            link.classes(add="here").props("aria-current=page")
        else:
            link.classes(remove="here").props(remove="aria-current")


def _switch_colour_mode(colours: ui.dark_mode) -> None:
    """Go from the colours of the system to light ones, dark ones, and back."""
    following = {None: False, False: True, True: None}
    colours.set_value(following[colours.value])


def make_table_columns(labels: Mapping[str, str]) -> list[dict[str, str]]:
    """Make the columns of a table of the page, by the label of each field of its rows."""
    columns = []
    for name, label in labels.items():
        columns.append({"name": name, "label": label, "field": name, "align": "left"})
    return columns


def show_heading(text: str, level: int = 1) -> None:
    """Show a heading."""
    ui.html(escape(text), tag=f"h{level}", sanitize=False)


def show_mistake(error: StepblocksError) -> None:
    """Show the message that the command line would print; who cannot see it hears it."""
    show_message(str(error))


def show_message(text: str) -> None:
    """Show what is wrong; who cannot see it hears it."""
    ui.label(format_units(text)).classes("mistake").props("role=alert")


def show_command(command: ShownCommand) -> None:
    """Show a command, with buttons that copy it and the same in Python."""
    with ui.row().classes("items-center"):
        ui.label(command.line).classes("command").props(
            _format_aria_label(texts.COMMAND_OF.format(title=command.title))
        )
        _add_copy_button(texts.COPY_COMMAND, command.line)
        if command.python:
            _add_copy_button(texts.COPY_PYTHON, command.python)


def _format_aria_label(name: str) -> str:
    """Return the ARIA property that names an element for a screen reader."""
    return f'aria-label="{escape(name)}"'


def _add_copy_button(label: str, text: str) -> None:
    """Add a button that copies a text to the clipboard, and says so."""

    def copy_text() -> None:
        ui.clipboard.write(text)
        ui.notify(texts.COPIED)

    add_quiet_button(label, copy_text).props("dense")


def add_quiet_button(label: str, on_click: Callable[[], object]) -> ui.button:
    """Add a button without a ground of its own."""
    button = ui.button(label, on_click=on_click, color=None)
    return button.props("flat no-caps").classes("quiet")


def is_gone(element: ui.element) -> bool:
    """Tell whether the page of an element was closed: what was computed for it is not shown."""
    try:
        return element.is_deleted or element.client.is_deleted
    except RuntimeError:  # the framework keeps closed pages by no strong reference
        return True


async def compute_in_background(
    page: ui.element,
    function: Callable[_Arguments, _Found],
    *given: _Arguments.args,
    **named: _Arguments.kwargs,
) -> _Found | None:
    """Compute something for a page without making it wait; None where the window is being closed.

    Whoever waits for it is ended in silence where the page was closed meanwhile: nobody is there
    to see it, or what is wrong.
    """
    try:
        found = await run.io_bound(function, *given, **named)
    except StepblocksError as error:
        if is_gone(page):
            raise asyncio.CancelledError from error
        raise
    if is_gone(page):
        raise asyncio.CancelledError
    return found
