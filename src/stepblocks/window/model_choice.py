"""The model of a session by which the declare page predicts, chosen among those of the folder."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from nicegui import ui

from stepblocks.errors import StepblocksError
from stepblocks.window import texts
from stepblocks.window.folder import Folder
from stepblocks.window.frame import show_mistake

if TYPE_CHECKING:
    from stepblocks.records.model import LearnedModel


class ModelChoice:
    """A list of the models that loops left in the folder; without any it is not shown.

    Attributes
    ----------
    learned : LearnedModel or None
        The chosen one, read.
    name : str
        Of its file in the folder; empty where none is chosen.
    """

    def __init__(self, folder: Folder, first: str = "") -> None:
        self.learned: LearnedModel | None = None
        self.name = ""
        self._folder = folder
        self._follow: Callable[[], object] = lambda: None
        names = folder.list_models()
        value = first if first in names else None
        choice = ui.select(names, label=texts.SESSION_MODEL, value=value, clearable=True)
        choice.classes("min-w-[400px]").mark("model").set_visibility(bool(names))
        self._place = ui.column()
        choice.on_value_change(lambda: self._choose_model(str(choice.value or "")))
        if value:
            self._choose_model(value)

    def set_change_handler(self, handler: Callable[[], object]) -> None:
        """Let a form follow the choice, in place of the one before."""
        self._follow = handler

    def _choose_model(self, name: str) -> None:
        """Read a model, or say why it cannot be read; an empty name chooses none."""
        from stepblocks.records.model import read_model

        self._place.clear()
        self.learned = None
        self.name = ""
        try:
            if name:
                self.learned = read_model(self._folder.resolve(name))
                self.name = name
        except StepblocksError as error:
            with self._place:
                show_mistake(error)
        self._follow()
