"""Many files that are dropped at once are handed in a few at a time.

The framework's field draws a line for every file whenever one of them has come a step further:
with hundreds of them the page stands still for so long that its server takes it for closed.
"""

from collections.abc import Callable

from nicegui import events, ui

from stepblocks.window.frame import add_script
from stepblocks.window.gate import LARGEST_UPLOAD, MOST_FILES

_FEW = 50  # files of a request
_MOST_BYTES = LARGEST_UPLOAD - 1_000_000  # of them together; the rest is what stands around each
_TAKES_MANY = "takes-many"  # class of the field
_TOO_MANY = "toomany"  # event of the field: more files than a folder may have were dropped
_BEGIN = "manybegin"  # event of the field: many are handed in from now on
_END = "manyend"  # event of the field: all were handed in; with the number that did not arrive
_LIMITS = {"few": _FEW, "files": MOST_FILES, "bytes": _MOST_BYTES}


def add_many_files_script() -> None:
    """Add what hands in many files to the head of a page."""
    add_script("many_files.js", _LIMITS)


def accept_many_files(
    upload: ui.upload,
    on_too_many: Callable[[int], object],
    on_begin: Callable[[], object],
    on_end: Callable[[int], object],
) -> None:
    """Let a field take thousands of files.

    Parameters
    ----------
    upload : ui.upload
        For several files.
    on_too_many : callable
        Called with how many files were dropped, where that is too many.
    on_begin, on_end : callable
        Called before the first of several files, and behind the last with how many did not arrive.
    """
    # one request for files that are added together
    upload.classes(_TAKES_MANY).props("batch")
    upload.on(_TOO_MANY, lambda event: on_too_many(_read_file_count(event)))
    upload.on(_BEGIN, lambda: on_begin(), args=[])
    upload.on(_END, lambda event: on_end(_read_file_count(event)))


def _read_file_count(event: events.GenericEventArguments) -> int:
    """Return the number of files that the field reports; 0 where it reports none."""
    count = event.args
    return count if isinstance(count, int) else 0
