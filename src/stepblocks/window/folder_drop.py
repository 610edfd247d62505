"""A folder that is dropped on a field for archives, or chosen beside it: the browser packs it.

A browser sends files, never a folder. What is sent is a zip file of it, which goes the way of a
dropped one: bounded by its size, unpacked where it belongs.
"""

from collections.abc import Callable

from nicegui import ui

from stepblocks.window import texts
from stepblocks.window.frame import add_quiet_button, add_script
from stepblocks.window.gate import LARGEST_UPLOAD, MOST_FILES

_TAKES_FOLDERS = "takes-folders"  # class of the field
_UNREAD = "unread"  # event of the field: the browser could not read a folder
_LIMITS = {"files": MOST_FILES, "bytes": LARGEST_UPLOAD}


def add_folder_script() -> None:
    """Add what packs folders to the head of a page."""
    add_script("folder_drop.js", _LIMITS)


def accept_dropped_folders(upload: ui.upload, on_unreadable: Callable[[], object]) -> None:
    """Let a field for archives take folders, too, and add a button that chooses one.

    Parameters
    ----------
    upload : ui.upload
    on_unreadable : callable
        Called where the browser cannot read a folder.
    """
    upload.classes(_TAKES_FOLDERS)
    upload.on(_UNREAD, lambda: on_unreadable(), args=[])
    chosen = ui.element("input").props("type=file webkitdirectory hidden").mark("folder")
    chosen.on(
        "change",
        js_handler=f"event => window.sendChosenFolder(event.target, '{upload.html_id}')",
    )
    button = add_quiet_button(texts.CHOOSE_FOLDER, lambda: None)
    button.on("click", js_handler=f"() => document.getElementById('{chosen.html_id}').click()")
