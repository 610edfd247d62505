"""The page to declare stimuli: a form for each stanza of a file, and beside it what is felt."""

import asyncio
import re
from collections.abc import Callable, Mapping
from functools import partial
from itertools import islice
from urllib.parse import quote

from nicegui import run, ui

from stepblocks.declaration.set import list_kinds
from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.files.text import is_file
from stepblocks.predict.kept import KeptPredictions
from stepblocks.quantities import format_units
from stepblocks.window import texts
from stepblocks.window.command_line import (
    ShownCommand,
    format_function_call,
    protect_leading_hyphen,
)
from stepblocks.window.draft import (
    Checked,
    Draft,
    FormField,
    StanzaPlace,
    find_field_of_mistake,
    list_form_fields,
)
from stepblocks.window.felt import CheckedAndFelt, check_and_predict, predict_felt
from stepblocks.window.felt_view import FeltView
from stepblocks.window.folder import OUTPUT, Folder, Kind
from stepblocks.window.frame import (
    add_quiet_button,
    is_gone,
    show_command,
    show_heading,
    show_mistake,
)
from stepblocks.window.latest_work import LatestWork
from stepblocks.window.left_drafts import UnsavedDrafts
from stepblocks.window.model_choice import ModelChoice
from stepblocks.window.size_slider import MOST_SLIDERS, Size, add_slider, list_slidable_sizes

_ENDING = ".toml"
_UNITS = re.compile(r" \[[^\]]*\]")  # of a value of the library; a field takes any with its name
_LITERAL = "``"  # around what is typed as it stands, in the reference
_DEBOUNCE = 150  # a form is checked when nobody has typed for so long [ms]
_QUIET = 0.25  # parts are dragged in time, and built, when nothing has changed for so long [s]


class DeclarePage:
    """The page on which stimulus files of a folder are written and changed."""

    def __init__(self, folder: Folder, left: UnsavedDrafts) -> None:
        self._folder = folder
        self._left = left

    def build(self, file: str = "", model: str = "") -> None:
        """Make the page; `file` is opened, and `model` predicts what is felt."""
        show_heading(texts.DECLARE)
        ui.label(texts.DECLARE_HELP)
        names = self._folder.list_names(Kind.STIMULI)
        with ui.row().classes("items-center"):
            choice = ui.input(texts.STIMULUS_FILE, value=file, autocomplete=names)
            choice.classes("min-w-[400px]")
            opener = ui.button(texts.OPEN).props("no-caps")
        with ui.row():
            ui.label(texts.STIMULUS_FILES_ARE)
            for name in names:
                ui.link(name, f"/declare?file={quote(name)}")
            if not names:
                ui.label(texts.NONE)
        chosen = ModelChoice(self._folder, model)
        place = ui.column().classes("w-full")
        opener.on_click(lambda: self._open_file(choice.value, place, chosen))
        if file:
            self._open_file(file, place, chosen)

    def _open_file(self, name: str, container: ui.element, model: ModelChoice) -> None:
        """Show the form of a file, or why it cannot be opened."""
        container.clear()
        with container:
            try:
                path = self._folder.resolve(name.strip())
                if path.suffix != _ENDING:
                    raise PipelineError(texts.WRONG_ENDING.format(ending=_ENDING, name=repr(name)))
                draft = self._left.take_over_draft(path)
                if draft is not None:
                    self._offer_to_discard(draft, partial(self._open_file, name, container, model))
                else:
                    draft = Draft(path)
                with ui.column().classes("w-full") as form:
                    self._left.keep_draft(draft, form)
                    DeclarationForm(draft, name.strip(), model).build()
            except StepblocksError as error:
                show_mistake(error)

    def _offer_to_discard(self, draft: Draft, open_again: Callable[[], object]) -> None:
        """Say that changes are shown that were never saved, and let them be discarded."""

        def discard_changes() -> None:
            """Forget the unsaved changes, and open the file again."""
            self._left.forget_draft(draft)
            open_again()

        with ui.row().classes("items-center"):
            ui.label(texts.LEFT_UNSAVED).props("role=status")
            add_quiet_button(texts.DISCARD, discard_changes)


class DeclarationForm:
    """The form of one file.

    Parameters
    ----------
    draft : Draft
    name : str
        Of the file in the folder.
    model : ModelChoice
        By which model of a session to predict.
    """

    def __init__(self, draft: Draft, name: str, model: ModelChoice) -> None:
        self._draft = draft
        self._name = name
        self._model = model
        self._place: StanzaPlace | None = None
        self._inputs: dict[str, ui.input] = {}
        self._fields: list[FormField] = []
        self._refused: dict[str, str] = {}  # entries that are none, by field: what is wrong
        self._sizes: dict[tuple[str, str], Size] = {}  # with a slider each
        self._changes = 0
        self._kept_by_formula, self._kept_in_time = KeptPredictions(), KeptPredictions()
        self._formula = LatestWork(self._check_and_predict)
        self._beside = LatestWork(self._drag_in_background)
        # what was predicted last, and of which change
        self._predicted: tuple[int, CheckedAndFelt] = 0, CheckedAndFelt(Checked(None))

    def build(self) -> None:
        """Make the form: stanzas to choose from, fields, and what follows from them."""
        with ui.row().classes("items-center"):
            self._choice = ui.select(
                {}, label=texts.STANZA, on_change=lambda event: self._show_stanza(event.value)
            ).classes("min-w-[240px]")
            kinds = {kind: model.kind_name for kind, model in list_kinds().items()}
            kind = ui.select(kinds, label=texts.KIND, value=next(iter(kinds)))
            kind.classes("min-w-[160px]")
            ui.button(texts.ADD_STANZA, on_click=lambda: self._add_stanza(kind.value)).props(
                "no-caps"
            )
        with ui.element("div").classes("beside"):
            self._form = ui.column()
            with ui.column():
                self._slide = ui.column().classes("w-full")
                self._view = FeltView()
        with ui.row().classes("items-center"):
            ui.button(texts.SAVE, on_click=self._save_file).props("no-caps")
        self._saved = ui.column().classes("w-full")
        self._commands = ui.column().classes("w-full")
        if is_file(self._draft.path):
            self._show_prediction_commands()
        self._model.set_change_handler(self._predict_by_chosen_model)
        places = list(self._draft.list_stanzas())
        if not places:
            places = [self._draft.add_stanza(next(iter(kinds)))]
        self._refresh_stanza_choice(places[0])

    def _refresh_stanza_choice(self, place: StanzaPlace) -> None:
        """List the stanzas, and show one of them."""
        key = f"{place.kind} {place.number}"
        self._choice.set_options(self._list_stanza_labels(), value=key)

    def _list_stanza_labels(self) -> dict[str, str]:
        """Return what the choice says of each stanza."""
        options = {}
        for found, identity in self._draft.list_stanzas().items():
            options[f"{found.kind} {found.number}"] = f"{found.kind}: {identity or texts.NO_NAME}"
        return options

    def _add_stanza(self, kind: str) -> None:
        self._refresh_stanza_choice(self._draft.add_stanza(kind))

    def _show_stanza(self, key: str) -> None:
        """Show the fields of a stanza; those of its tables behind a fold."""
        kind, number = key.split()
        self._place = StanzaPlace(kind, int(number))
        self._fields = list_form_fields(kind)
        self._inputs = {}
        self._refused = {}
        self._sizes = {}
        self._slide.clear()
        self._form.clear()
        with self._form:
            for field in self._fields:
                if len(field.path) == 1:
                    self._add_field_input(field)
            tables = dict.fromkeys(field.path[0] for field in self._fields if len(field.path) > 1)
            for table in tables:
                with ui.expansion(table).classes("w-full"):
                    for field in self._fields:
                        if len(field.path) > 1 and field.path[0] == table:
                            self._add_field_input(field)
        self._refresh_sliders()
        self._request_update()

    def _refresh_sliders(self) -> None:
        """Offer sliders for the sizes of the stanza, where those offered do not fit any more."""
        sizes = self._list_sizes()
        if _are_sliders_current(self._sizes, sizes):
            return
        self._sizes = sizes
        self._slide.clear()
        with self._slide:
            for (name, _), size in sizes.items():
                box = self._inputs[name]
                add_slider(name, size, partial(_read_entry, box), box.set_value)

    def _refresh_sliders_of_field(self, field: FormField) -> None:
        """Offer sliders anew where the entry of a field does not fit those that are there."""
        if len(field.path) > 1:
            return
        entry = _read_entry(self._inputs[field.name])
        shown = {key: size for key, size in self._sizes.items() if key[0] == field.name}
        sizes = {(field.name, size.place_label): size for size in list_slidable_sizes(entry)}
        if not _are_sliders_current(shown, sizes):
            self._refresh_sliders()

    def _list_sizes(self) -> dict[tuple[str, str], Size]:
        """List the sizes that the fields of the stanza hold, by the names of field and size."""
        sizes: dict[tuple[str, str], Size] = {}
        for field in self._fields:
            if len(field.path) == 1:
                entry = _read_entry(self._inputs[field.name])
                sizes |= {
                    (field.name, size.place_label): size for size in list_slidable_sizes(entry)
                }
        return dict(islice(sizes.items(), MOST_SLIDERS))

    def _add_field_input(self, field: FormField) -> None:
        """Add a field, with what it is and what counts where it is left out."""
        assert self._place is not None
        hints = [_UNITS.sub("", field.help).replace(_LITERAL, "")]
        if field.default:
            hints.append(texts.DEFAULT.format(value=format_units(field.default)))
        if field.is_required:
            hints.append(texts.REQUIRED)
        box = ui.input(
            field.name,
            value=self._draft.read_field(self._place, field.path),
            on_change=self._make_entry_writer(self._place, field),
        )
        box.props(f"debounce={_DEBOUNCE} bottom-slots").classes("w-full").mark(field.name)
        hint = " ".join(filter(None, hints))
        with box.add_slot("hint"):
            ui.label(format_units(hint))
        self._inputs[field.name] = box

    def _make_entry_writer(self, place: StanzaPlace, field: FormField) -> Callable[[], None]:
        """Return what puts the entry of a field into the draft."""

        def write_entry() -> None:
            """Write the entry into the draft, or keep why it is refused."""
            box = self._inputs[field.name]
            try:
                self._draft.write_field(place, field.path, str(box.value or ""))
                self._refused.pop(field.name, None)
            except StepblocksError as error:
                self._refused[field.name] = format_units(error)
            self._refresh_sliders_of_field(field)
            self._request_update()

        return write_entry

    def _predict_by_chosen_model(self) -> None:
        """Predict by another model, and show the command that does."""
        self._show_prediction_commands()
        self._request_update()

    def _request_update(self) -> None:
        """Check the draft and predict, without making the page wait."""
        self._changes += 1
        self._formula.request()

    async def _check_and_predict(self) -> None:
        """Show mistakes at their fields; without any, what is felt and the working edge.

        What has changed meanwhile is followed behind it: of many moves each result is shown.
        """
        number = self._changes
        options = self._list_stanza_labels()
        if options != self._choice.options:
            self._choice.set_options(options)
        found = await run.io_bound(
            check_and_predict,
            self._draft.text,
            self._draft.path,
            self._model.learned,
            self._kept_by_formula,
        )
        if found is None or is_gone(self._form):  # closed
            return
        self._predicted = number, found
        self._show_mistakes_at_fields(found.checked)
        if found.checked.stimuli is None or found.reason:
            self._view.show_mistakes([*found.checked.mistakes, *found.reason])
            return
        self._view.show_felt(found.felt, self._model.name, is_dragged=False)
        self._view.show_working_edge(found.checked.stimuli, self._place, self._get_shown_identity())
        self._beside.request()

    async def _drag_in_background(self) -> None:
        """Make the part and drag all parts in time, once nothing has changed for a moment."""
        number = -1
        while self._has_changed_since(number):
            number = self._changes
            await asyncio.sleep(_QUIET)
        if is_gone(self._form):
            return
        predicted, found = self._predicted
        if predicted != number or found.checked.stimuli is None:
            return  # the formula asks again when it has followed
        self._view.make_solid_if_wanted()
        if not found.felt:
            return
        felt = await run.io_bound(
            predict_felt,
            found.checked.stimuli,
            self._model.learned,
            dragged=True,
            kept=self._kept_in_time,
            is_wanted=lambda: not self._has_changed_since(number),
        )
        if not felt or self._has_changed_since(number) or is_gone(self._form):
            return
        self._view.show_felt(felt, self._model.name, is_dragged=True)

    def _has_changed_since(self, change_number: int) -> bool:
        """Tell whether anything was changed since."""
        return change_number != self._changes

    def _get_shown_identity(self) -> str:
        """Return the identity of the stanza that is shown, as it is declared."""
        assert self._place is not None
        return self._draft.list_stanzas().get(self._place, "")

    def _show_mistakes_at_fields(self, checked: Checked) -> None:
        """Put each mistake of the shown stanza at its field."""
        errors = dict(self._refused)
        assert self._place is not None
        identity = self._get_shown_identity()
        for place, text in checked.mistakes:
            is_here = place.startswith(self._place.kind) and ("{" in identity or identity in place)
            field = find_field_of_mistake(text, self._fields)
            if is_here and field is not None:
                errors.setdefault(field.name, format_units(text))
        for name, box in self._inputs.items():
            box.error = errors.get(name)

    def _save_file(self) -> None:
        """Write the file, and show the commands that take it."""
        self._saved.clear()
        with self._saved:
            try:
                for message in self._refused.values():
                    raise PipelineError(message)
                self._draft.save()
            except StepblocksError as error:
                show_mistake(error)
                return
            ui.label(texts.SAVED.format(name=self._name)).props("role=status")
        self._show_prediction_commands()

    def _show_prediction_commands(self) -> None:
        """Show the commands that predict what the file declares."""
        self._commands.clear()
        with self._commands:
            for command in make_prediction_commands(self._name, self._model.name):
                show_command(command)


def _are_sliders_current(
    shown: Mapping[tuple[str, str], Size], sizes: Mapping[tuple[str, str], Size]
) -> bool:
    """Tell whether the sliders that are shown cover these sizes, and no others."""
    if shown.keys() != sizes.keys():
        return False
    return all(size.range.contains(sizes[key].range) for key, size in shown.items())


def _read_entry(box: ui.input) -> str:
    """Return what a field says."""
    return str(box.value or "")


def make_prediction_commands(name: str, model: str) -> list[ShownCommand]:
    """Make the commands that predict a file; by a model of a session, a build does."""
    word = protect_leading_hyphen(name)
    predict = ShownCommand(
        texts.PREDICT, ("predict", word), format_function_call("predict_set", name)
    )
    if not model:
        return [predict]
    words = ("build", word, "-o", OUTPUT, "--model", model)
    python = format_function_call("build_sets", [name], OUTPUT, model=model)
    return [predict, ShownCommand(texts.BUILD_BY_MODEL, words, python)]
