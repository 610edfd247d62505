"""Drafts that were left unsaved when their page was closed, for who opens the file again."""

from pathlib import Path
from typing import TYPE_CHECKING

from nicegui import ui

from stepblocks.window.frame import is_gone

if TYPE_CHECKING:
    from stepblocks.window.draft import Draft

_MOST = 20  # that are kept


class UnsavedDrafts:
    """The drafts of a window, each with an element of the page that changes it."""

    def __init__(self) -> None:
        self._drafts: list[tuple[Draft, ui.element]] = []

    def keep_draft(self, draft: "Draft", page: ui.element) -> None:
        """Keep a draft that a page changes from now on."""
        self._drafts = [*self._drafts, (draft, page)][-_MOST:]

    def take_over_draft(self, path: Path) -> "Draft | None":
        """Return the draft of a file that was left unsaved last; it is kept no longer.

        None where there is none. What another page still changes is left to it, and a file that
        was changed since counts before what was typed.
        """
        left = [draft for draft, page in self._drafts if draft.path == path and _is_page_left(page)]
        self._drafts = [kept for kept in self._drafts if kept[0] not in left]
        for draft in reversed(left):
            if draft.is_unsaved and draft.is_current:
                return draft
        return None

    def forget_draft(self, draft: "Draft") -> None:
        """Let go of a draft: nobody wants what was typed."""
        self._drafts = [kept for kept in self._drafts if kept[0] is not draft]


def _is_page_left(page: ui.element) -> bool:
    """Tell whether nobody sees a page any more."""
    return is_gone(page) or not page.client.has_socket_connection
