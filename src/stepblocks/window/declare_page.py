"""The page to declare stimuli: a form for each stanza of a file, and beside it what is felt."""

from collections.abc import Callable
from urllib.parse import quote

from nicegui import run, ui

from stepblocks.declaration.set import StimulusSet, list_kinds
from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.quantities import format_units
from stepblocks.window import texts
from stepblocks.window.command_line import ShownCommand, write_call, write_name
from stepblocks.window.draft import Checked, Draft, FormField, StanzaPlace, find_field, list_fields
from stepblocks.window.felt import Felt, draw_profile, predict_felt
from stepblocks.window.folder import Folder, Kind
from stepblocks.window.frame import show_command, show_heading, show_message, show_mistake

_ENDING = ".toml"
_DEBOUNCE = 150  # a form is checked when nobody has typed for so long [ms]


class DeclarePage:
    """The page on which stimulus files of a folder are written and changed."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder

    def build(self, file: str = "") -> None:
        """Make the page; `file` is opened."""
        show_heading(texts.DECLARE)
        ui.label(texts.DECLARE_HELP)
        names = [entry.name for entry in self._folder.list_entries() if entry.kind is Kind.STIMULI]
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
        place = ui.column().classes("w-full")
        opener.on_click(lambda: self._open(choice.value, place))
        if file:
            self._open(file, place)

    def _open(self, name: str, place: ui.element) -> None:
        """Show the form of a file, or why it cannot be opened."""
        place.clear()
        with place:
            try:
                path = self._folder.resolve(name.strip())
                if path.suffix != _ENDING:
                    raise PipelineError(f"a stimulus file must end in {_ENDING}, got {name!r}")
                DeclarationForm(Draft(path), name.strip()).build()
            except StepblocksError as error:
                show_mistake(error)


class DeclarationForm:
    """The form of one file.

    Parameters
    ----------
    draft : Draft
    name : str
        Of the file in the folder.
    """

    def __init__(self, draft: Draft, name: str) -> None:
        self._draft = draft
        self._name = name
        self._place: StanzaPlace | None = None
        self._inputs: dict[str, ui.input] = {}
        self._fields: list[FormField] = []
        self._changes = 0

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
            self._beside = ui.column()
        with ui.row().classes("items-center"):
            ui.button(texts.SAVE, on_click=self._save).props("no-caps")
        self._saved = ui.column().classes("w-full")
        places = list(self._draft.list_stanzas())
        if not places:
            places = [self._draft.add_stanza(next(iter(kinds)))]
        self._refresh_choice(places[0])

    def _refresh_choice(self, place: StanzaPlace) -> None:
        """List the stanzas, and show one of them."""
        key = f"{place.kind} {place.number}"
        self._choice.set_options(self._name_stanzas(), value=key)

    def _name_stanzas(self) -> dict[str, str]:
        """Return what the choice says of each stanza."""
        options = {}
        for found, identity in self._draft.list_stanzas().items():
            options[f"{found.kind} {found.number}"] = f"{found.kind}: {identity or texts.NO_NAME}"
        return options

    def _add_stanza(self, kind: str) -> None:
        self._refresh_choice(self._draft.add_stanza(kind))

    def _show_stanza(self, key: str) -> None:
        """Show the fields of a stanza; those of its tables behind a fold."""
        kind, number = key.split()
        self._place = StanzaPlace(kind, int(number))
        self._fields = list_fields(kind)
        self._inputs = {}
        self._form.clear()
        with self._form:
            for field in self._fields:
                if len(field.path) == 1:
                    self._add_input(field)
            tables = dict.fromkeys(field.path[0] for field in self._fields if len(field.path) > 1)
            for table in tables:
                with ui.expansion(table).classes("w-full"):
                    for field in self._fields:
                        if len(field.path) > 1 and field.path[0] == table:
                            self._add_input(field)
        self._update_soon()

    def _add_input(self, field: FormField) -> None:
        """Add a field, with what it is and what counts where it is left out."""
        assert self._place is not None
        hints = [field.help]
        if field.default:
            hints.append(texts.DEFAULT.format(value=format_units(field.default)))
        if field.is_required:
            hints.append(texts.REQUIRED)
        box = ui.input(
            field.name,
            value=self._draft.read_field(self._place, field.path),
            on_change=self._make_writer(self._place, field),
        )
        box.props(f"debounce={_DEBOUNCE} bottom-slots").classes("w-full").mark(field.name)
        hint = " ".join(filter(None, hints))
        with box.add_slot("hint"):
            ui.label(format_units(hint))
        self._inputs[field.name] = box

    def _make_writer(self, place: StanzaPlace, field: FormField) -> Callable[[], None]:
        """Return what puts the entry of a field into the draft."""

        def write() -> None:
            box = self._inputs[field.name]
            try:
                self._draft.write_field(place, field.path, str(box.value or ""))
            except StepblocksError as error:
                box.error = format_units(error)
                return
            self._update_soon()

        return write

    def _update_soon(self) -> None:
        """Check the draft and predict, without making the page wait."""
        self._changes += 1
        ui.timer(0.0, self._update, once=True)

    async def _update(self) -> None:
        """Show mistakes at their fields; without any, what is felt and the working edge."""
        number = self._changes
        options = self._name_stanzas()
        if options != self._choice.options:
            self._choice.set_options(options)
        checked = self._draft.check()
        self._show_mistakes(checked)
        felt: list[Felt] = []
        if checked.stimuli is not None:
            felt = await run.io_bound(predict_felt, checked.stimuli) or []
        if number != self._changes:  # somebody typed on
            return
        self._beside.clear()
        with self._beside:
            if checked.stimuli is None:
                for place, text in checked.mistakes:
                    show_message(f"{text} [{place}]" if place else text)
            else:
                self._show_felt(checked.stimuli, felt)

    def _show_mistakes(self, checked: Checked) -> None:
        """Put each mistake of the shown stanza at its field."""
        errors: dict[str, str] = {}
        assert self._place is not None
        identity = self._draft.list_stanzas().get(self._place, "")
        for place, text in checked.mistakes:
            is_here = place.startswith(self._place.kind) and ("{" in identity or identity in place)
            field = find_field(text, self._fields)
            if is_here and field is not None:
                errors.setdefault(field.name, format_units(text))
        for name, box in self._inputs.items():
            box.error = errors.get(name)

    def _show_felt(self, stimuli: StimulusSet, felt: list[Felt]) -> None:
        """Show what is felt of each part, and the profile of the first of the stanza."""
        assert self._place is not None
        parts = [part for part in stimuli.stimuli if part.stanza == self._place.kind]
        identity = self._draft.list_stanzas().get(self._place, "")
        named = [part for part in parts if part.id == identity] or parts
        if named:
            picture = draw_profile(named[0])
            if picture:
                ui.label(texts.PROFILE_OF.format(part=named[0].id))
                ui.html(picture, sanitize=False)
        if not felt:
            ui.label(texts.NOT_FELT)
            return
        columns = [
            {"name": name, "label": label, "field": name, "align": "left"}
            for name, label in texts.FELT_COLUMNS.items()
        ]
        rows = [vars(row) for row in felt]
        ui.table(columns=columns, rows=rows, title=texts.FELT).mark("felt")
        ui.label(texts.FELT_CONDITION)

    def _save(self) -> None:
        """Write the file, and show the commands that take it."""
        self._saved.clear()
        with self._saved:
            try:
                self._draft.save()
            except StepblocksError as error:
                show_mistake(error)
                return
            ui.label(texts.SAVED.format(name=self._name)).props("role=status")
            word = write_name(self._name)
            show_command(
                ShownCommand(
                    texts.PREDICT, ("predict", word), write_call("predict_set", self._name)
                )
            )
