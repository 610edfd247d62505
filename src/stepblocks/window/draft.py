"""A stimulus file while it is changed in the window: its comments and its order stay."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import tomlkit
from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from tomlkit.items import Item, String

from stepblocks.declaration.read import validate_file_tables
from stepblocks.declaration.set import StimulusSet, list_kinds
from stepblocks.errors import PipelineError, StimulusError
from stepblocks.files.atomic import replace_text
from stepblocks.files.text import is_file
from stepblocks.mistakes import Mistake
from stepblocks.parts.declared import Sourced, WorkedOut
from stepblocks.parts.material import Material
from stepblocks.quantities import DIMENSIONS, format_number, format_quantity
from stepblocks.window import texts
from stepblocks.window.saving import hold_for_saving
from stepblocks.window.toml_text import (
    BYTE_ORDER_MARK,
    MalformedTomlError,
    parse_toml_document,
    parse_toml_tables,
    parse_toml_value,
)

# a line with the header of a table, or of one of a list of tables
_HEADER = re.compile(r"\s*(?P<list>\[)?\[\s*(?P<name>[A-Za-z0-9_.\-]+)\s*\]{1,2}\s*(#.*)?$")
_DEEPEST = 3  # tables within a stanza
_METRES = "[m]"
_LONGEST_ENTRY = 2000  # letters of a field


@dataclass(frozen=True)
class FormField:
    """A field of a stanza as a form asks for it.

    Attributes
    ----------
    path : tuple of str
        Its name, behind the names of the tables that it stands in.
    default : str
        What counts where it is left out, as a file states it; empty where nothing does.
    is_required : bool
    help : str
        What it is, from the reference.
    """

    path: tuple[str, ...]
    default: str
    is_required: bool
    help: str

    @property
    def name(self) -> str:
        """Its name with dots, as in a message."""
        return ".".join(self.path)


@dataclass(frozen=True)
class StanzaPlace:
    """Where a stanza stands in its file: the kind, and the number among those of its kind."""

    kind: str
    number: int


@dataclass(frozen=True)
class Checked:
    """What a draft declares: the set, or all that is wrong with it."""

    stimuli: StimulusSet | None
    mistakes: tuple[Mistake, ...] = ()


def list_form_fields(kind: str) -> list[FormField]:
    """List the fields of a kind in the order of its model, those of tables below it among them."""
    return list(_yield_form_fields(list_kinds()[kind], ()))


def _yield_form_fields(model: type[BaseModel], parent_path: tuple[str, ...]) -> Iterable[FormField]:
    """Yield the fields of a model at `parent_path`, with those of the tables below it.

    What a scan or a set works out is left out: nobody types it.
    """
    helps = _read_field_helps(model)
    for name, field in model.model_fields.items():
        if any(isinstance(mark, WorkedOut) for mark in field.metadata):
            continue
        path = (*parent_path, name)
        below = _find_table_model(field.annotation)
        if below is not None and len(path) < _DEEPEST:
            yield from _yield_form_fields(below, path)
            continue
        is_required = field.is_required()
        help_ = helps.get(name, "")
        yield FormField(path, _format_default(field.default, help_), is_required, help_)


def _find_table_model(annotation: object) -> type[BaseModel] | None:
    """Return the model of a field that is a table, or may be one; a material is a name."""
    for kind in (annotation, *get_args(annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel) and kind is not Material:
            return kind
    return None


def _format_default(default: object, help_: str) -> str:
    """Write a default as a file states it; the help of its field names the unit of a number."""
    if default is None or default is PydanticUndefined:
        return ""
    if isinstance(default, Sourced):
        return f"{format_number(default.value)} {DIMENSIONS[default.quantity]}".strip()
    if isinstance(default, float):
        return _format_number(default, help_)
    if isinstance(default, tuple) and all(isinstance(value, float) for value in default):
        return ", ".join(_format_number(value, help_) for value in default)
    if isinstance(default, Mapping):
        stated = {
            "tolerance" if name == "otherwise" else name: text for name, text in default.items()
        }
        return ", ".join(str(text) for name, text in stated.items() if name != "source")
    return str(default)


def _format_number(value: float, help_: str) -> str:
    """Write a number with the unit that the help of its field names."""
    if _METRES in help_:
        return format_quantity(value, "length")
    return format_number(value)


def _read_field_helps(model: type[BaseModel]) -> dict[str, str]:
    """Read what the fields of a model are, those that it has from others among them."""
    helps: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        helps |= _read_attribute_helps(kind.__doc__ or "")
    return helps


def _read_attribute_helps(docstring: str) -> dict[str, str]:
    """Read what the attributes of a class are, from the section of its docstring."""
    helps: dict[str, str] = {}
    section = docstring.partition("Attributes\n")[2]
    names: list[str] = []
    for line in section.splitlines()[1:]:
        if " : " in line and not line.startswith("        "):
            names = [name.strip() for name in line.partition(" : ")[0].split(",")]
            helps.update(dict.fromkeys(names, ""))
            continue
        for name in names:
            helps[name] = f"{helps[name]} {line.strip()}".strip()
    return helps


def find_field_of_mistake(mistake: str, fields: Iterable[FormField]) -> FormField | None:
    """Return the field that a mistake is about, whose name it begins with; None where none is."""
    found = None
    for field in fields:
        for begin in (field.name, f"{field.path[0]}: {'.'.join(field.path[1:])}"):
            is_named = mistake.startswith((f"{begin} ", f"{begin}:"))
            if is_named and (found is None or len(field.path) > len(found.path)):
                found = field
    return found


def check_stimulus_text(text: str, path: Path) -> Checked:
    """Validate the text of a stimulus file, which is at a place or will be written there."""
    mistakes: list[Mistake] = []
    try:
        stimuli = validate_file_tables(_parse_stimulus_tables(text, path), path, mistakes)
    except StimulusError as error:
        return Checked(None, tuple(mistakes) or (("", str(error)),))
    return Checked(stimuli)


def _parse_stimulus_tables(text: str, path: Path) -> dict[str, Any]:
    """Return the tables of the text of a stimulus file."""
    try:
        return parse_toml_tables(text.removeprefix(BYTE_ORDER_MARK))
    except MalformedTomlError as error:
        raise StimulusError(texts.STIMULI_NO_TOML.format(reason=error, path=path)) from error


class Draft:
    """A stimulus file that is being changed.

    Parameters
    ----------
    path : Path
        Where it is, or will be written.

    Raises
    ------
    StimulusError
        If there is a file that is no TOML.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._before = _read_file_text(path)
        self._is_touched = False
        text = self._before or ""
        self._mark = ""
        if text.startswith(BYTE_ORDER_MARK):
            self._mark = BYTE_ORDER_MARK
        self._pieces = _split_into_pieces(text.removeprefix(self._mark))
        if (
            self._before is not None
            and _parse_pieces_together(self._pieces) != self._parse_tables()
        ):
            raise StimulusError(texts.STANZAS_MIXED.format(path=path))

    @property
    def is_unsaved(self) -> bool:
        """Whether something was typed that the file does not hold yet."""
        return self._is_touched and self.text != (self._before or "")

    @property
    def is_current(self) -> bool:
        """Whether the file is as it was when it was opened or saved here."""
        try:
            return _read_file_text(self.path) == self._before
        except StimulusError:
            return False

    @property
    def text(self) -> str:
        """The file as it would be written."""
        return self._mark + "".join(piece.text for piece in self._pieces)

    def _parse_tables(self) -> dict[str, Any]:
        """Return the tables of the file as it would be written."""
        return _parse_stimulus_tables(self.text, self.path)

    def list_stanzas(self) -> dict[StanzaPlace, str]:
        """List the stanzas with their identities, in the order of the file."""
        found: dict[StanzaPlace, str] = {}
        counts: Counter[str] = Counter()
        for piece in self._pieces:
            if piece.kind:
                place = StanzaPlace(piece.kind, counts[piece.kind])
                found[place] = str(piece.stanza.get("id", ""))
                counts[piece.kind] += 1
        return found

    def add_stanza(self, kind: str) -> StanzaPlace:
        """Add an empty stanza of a kind behind all others."""
        before = self.text
        gap = ""
        if before:
            gap = "\n" if before.endswith("\n") else "\n\n"
        number = sum(piece.kind == kind for piece in self._pieces)
        self._pieces += [_Piece(gap), _Piece(f"[[{kind}]]\n", kind)]
        return StanzaPlace(kind, number)

    def read_field(self, place: StanzaPlace, path: tuple[str, ...]) -> str:
        """Return what a field says, as it is typed; empty where it is left out."""
        value: Any = self._get_stanza_table(place)
        for name in path:
            if not isinstance(value, Mapping) or name not in value:
                return ""
            value = value[name]
        return _format_entry(value)

    def write_field(self, place: StanzaPlace, path: tuple[str, ...], entry: str) -> None:
        """Set a field to what was typed; an empty entry leaves it out."""
        self._is_touched = True
        table: Any = self._get_stanza_table(place)
        for name in path[:-1]:
            if name not in table and not entry.strip():
                return
            if name not in table:
                table[name] = tomlkit.inline_table()
            table = table[name]
            if not isinstance(table, Mapping):
                raise StimulusError(
                    texts.NO_TABLE.format(name=name, field=f"{path[-1]} [{self.path}]")
                )
        if entry.strip():
            table[path[-1]] = _parse_entry(entry)
        elif path[-1] in table:
            del table[path[-1]]
            self._drop_empty_tables(place, path[:-1])

    def _drop_empty_tables(self, place: StanzaPlace, path: tuple[str, ...]) -> None:
        """Take away the tables on the way to a field that hold nothing any more."""
        if not path:
            return
        table: Any = self._get_stanza_table(place)
        for name in path[:-1]:
            table = table[name]
        if not table[path[-1]]:
            del table[path[-1]]
            self._drop_empty_tables(place, path[:-1])

    def _get_stanza_table(self, place: StanzaPlace) -> Any:
        """Return the table of a stanza, in which its fields can be changed."""
        pieces = [piece for piece in self._pieces if piece.kind == place.kind]
        return pieces[place.number].stanza

    def check(self) -> Checked:
        """Validate the draft as the file would be."""
        return check_stimulus_text(self.text, self.path)

    def save(self) -> None:
        """Write the file.

        Raises
        ------
        StimulusError
            If the file would not be read.
        PipelineError
            If it was changed since it was opened here, or cannot be written.
        """
        validate_file_tables(self._parse_tables(), self.path, [])
        with hold_for_saving(self.path):
            if _read_file_text(self.path) != self._before:
                raise PipelineError(texts.WAS_CHANGED.format(name=self.path.name))
            replace_text(self.path, self.text)
        self._before = self.text


class _Piece:
    """A run of lines of a file: a stanza with the tables below it, or what lies between.

    Only the piece that is changed is written anew; all else stays as it was typed.
    """

    def __init__(self, text: str, kind: str = "") -> None:
        self.kind = kind
        self._text = text
        self._document: tomlkit.TOMLDocument | None = None

    @property
    def text(self) -> str:
        """The lines, as changed."""
        if self._document is None:
            return self._text
        return tomlkit.dumps(self._document)

    @property
    def stanza(self) -> Any:
        """The table of a stanza, which may be changed."""
        if self._document is None:
            self._document = parse_toml_document(self._text)
        stanzas: Any = self._document[self.kind]
        return stanzas[0]


def _split_into_pieces(text: str) -> list[_Piece]:
    """Split a file at the headers of its tables; a stanza keeps the tables below it."""
    pieces: list[_Piece] = []
    lines: list[str] = []
    kind = ""
    for line in text.splitlines(keepends=True):
        found = _HEADER.match(line)
        if found is None or (kind and found["name"].startswith(f"{kind}.")):
            lines.append(line)
            continue
        pieces.append(_Piece("".join(lines), kind))
        lines = [line]
        is_stanza = bool(found["list"]) and found["name"] in list_kinds()
        kind = found["name"] if is_stanza else ""
    pieces.append(_Piece("".join(lines), kind))
    return [piece for piece in pieces if piece.text]


def _parse_pieces_together(pieces: Iterable[_Piece]) -> dict[str, Any] | None:
    """Return the tables of all pieces together; None where one of them is no TOML by itself."""
    between = ""
    stanzas: dict[str, list[Any]] = {}
    try:
        for piece in pieces:
            if piece.kind:
                stanzas.setdefault(piece.kind, []).extend(parse_toml_tables(piece.text)[piece.kind])
            else:
                between += piece.text
        return {**parse_toml_tables(between), **stanzas}
    except MalformedTomlError:
        return None


def _read_file_text(path: Path) -> str | None:
    """Read a file as it stands; None where there is none."""
    if not is_file(path):
        return None
    try:
        # line ends as they stand: what nobody changed stays the same bytes
        return path.read_bytes().decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StimulusError(texts.STIMULI_NO_TEXT.format(reason=error, path=path)) from error


def _parse_entry(entry: str) -> Item:
    """Read what was typed: a value of TOML as it stands, anything else as text."""
    line = " ".join(entry.split())
    if len(line) > _LONGEST_ENTRY:
        raise StimulusError(texts.ENTRY_TOO_LONG.format(most=_LONGEST_ENTRY, count=len(line)))
    try:
        return parse_toml_value(line)
    except MalformedTomlError:
        return tomlkit.string(line)


def _format_entry(value: object) -> str:
    """Write a value as it is typed: text without its quotes where that reads as the same text."""
    if isinstance(value, String):
        text = str(value)
        is_plain = " ".join(text.split()) == text and isinstance(_parse_entry(text or " "), String)
        return text if is_plain and not text.startswith(("'", '"')) else value.as_string()
    if isinstance(value, Item):
        if isinstance(value, Mapping):
            inline = tomlkit.inline_table()
            inline.update(value.unwrap())
            return inline.as_string()
        return value.as_string()
    return tomlkit.item(value).as_string()
