"""What the declare page shows beside a form: mistakes, or the working edge, the part and its feel.

Its elements stay while their content changes: a slider is followed at once.
"""

from collections.abc import Iterable, Sequence

from nicegui import background_tasks, ui

from stepblocks.declaration.set import StimulusSet
from stepblocks.mistakes import Mistake
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.window import texts
from stepblocks.window.draft import StanzaPlace
from stepblocks.window.felt import Felt, draw_profile_as_svg
from stepblocks.window.frame import make_table_columns, show_message

_MOST_MISTAKES = 20  # that are shown at once
_LEARNED = "learned"  # the column by the model of a session


class FeltView:
    """The column beside a form."""

    def __init__(self) -> None:
        self._mistakes = ui.column()
        self._shown: tuple[Part, OrderSpec] | None = None
        self._built: tuple[Part, OrderSpec] | None = None  # which the solid shows, or will
        with ui.column().classes("w-full") as self._results:
            self._edge = ui.label()
            self._picture = ui.html("", sanitize=False).classes("w-full")
            self._nothing = ui.label(texts.NOT_FELT)
            self._table = ui.table(columns=[], rows=[], title=texts.FELT).mark("felt")
            self._table.props("dense wrap-cells flat bordered").classes("w-full")
            self._condition = ui.label()
            self._solid = ui.expansion(texts.SHOW_PART, on_value_change=self.make_solid_if_wanted)
            self._solid.classes("w-full").mark("show-part")
            with self._solid:
                self._place = ui.column().classes("w-full")
        self._results.set_visibility(False)

    def show_mistakes(self, mistakes: Iterable[Mistake]) -> None:
        """Show what is wrong in place of what is felt."""
        self._results.set_visibility(False)
        self._mistakes.clear()
        with self._mistakes:
            lines = list(dict.fromkeys(map(_format_mistake, mistakes)))
            for line in lines[:_MOST_MISTAKES]:
                show_message(line)
            if len(lines) > _MOST_MISTAKES:
                show_message(texts.MORE_MISTAKES.format(count=len(lines) - _MOST_MISTAKES))

    def show_felt(self, felt: Sequence[Felt], model: str, *, is_dragged: bool) -> None:
        """Show what is felt of every part, by the model of a session too where one is named."""
        self._mistakes.clear()
        self._results.set_visibility(True)
        self._nothing.set_visibility(not felt)
        self._table.set_visibility(bool(felt))
        labels = dict(texts.FELT_COLUMNS)
        if model:
            labels[_LEARNED] = texts.FELT_LEARNED
        columns = make_table_columns(labels)
        if columns != self._table.columns:
            self._table.columns = columns
        self._table.rows = [vars(row) for row in felt]
        sentences = [texts.FELT_CONDITION]
        if model:
            sentences.append(texts.MODEL_CONDITION.format(name=model))
        if not is_dragged:
            sentences.append(texts.DRAGGING)
        self._condition.set_text(" ".join(sentences))
        self._condition.set_visibility(bool(felt))

    def show_working_edge(
        self, stimuli: StimulusSet, place: StanzaPlace | None, identity: str
    ) -> None:
        """Show the working edge of the first part of a stanza."""
        part = _find_part_of_stanza(stimuli, place, identity)
        self._shown = None
        picture = ""
        if part is not None:
            self._shown = part, stimuli.order
            picture = draw_profile_as_svg(part)
            self._edge.set_text(texts.PROFILE_OF.format(part=part.id))
        self._edge.set_visibility(bool(picture))
        self._picture.set_content(picture)
        self._solid.set_visibility(part is not None)

    def make_solid_if_wanted(self) -> None:
        """Make the part in 3-D where somebody wants to see it, and it is not shown yet."""
        if self._shown is None or not self._solid.value or self._shown == self._built:
            return
        part, order = self._built = self._shown
        self._place.clear()
        with self._place:
            ui.label(texts.MAKING_PART.format(part=part.id)).props("role=status")
        background_tasks.create(self._show_solid(part, order))

    async def _show_solid(self, part: Part, order: OrderSpec) -> None:
        """Show a part in 3-D once it is made, unless it has been changed meanwhile."""
        from stepblocks.window.part_view import show_solid_and_drawing

        def is_wanted() -> bool:
            return self._built == (part, order)

        await show_solid_and_drawing(part, order, self._place, is_wanted)


def _format_mistake(mistake: Mistake) -> str:
    """Write a mistake with its place, where it has one."""
    place, text = mistake
    if not place:
        return text
    return f"{text} [{place}]"


def _find_part_of_stanza(
    stimuli: StimulusSet, place: StanzaPlace | None, identity: str
) -> Part | None:
    """Return the part of an identity in a stanza, or else its first part; None without one."""
    if place is None:
        return None
    parts = [part for part in stimuli.stimuli if part.stanza == place.kind]
    named = [part for part in parts if part.id == identity] or parts
    if not named:
        return None
    return named[0]
