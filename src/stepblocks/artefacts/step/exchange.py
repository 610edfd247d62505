"""The instances of a Part 21 file (ISO 10303-21), looked up by entity and by reference."""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from stepblocks.errors import MetrologyError
from stepblocks.files.text import is_file

_MOST_BYTES = 128 * 2**20
_MOST_SHOWN = 120  # characters of a parser's own message
_DEEPEST_PARENTHESES = 16  # of one instance; the schemas need four

# Entities that make up shape and refer to shape alone: most of a file, never asked what they use
_SHAPE_ENTITIES = (
    "ADVANCED_FACE",
    "AXIS2_PLACEMENT_2D",
    "AXIS2_PLACEMENT_3D",
    "B_SPLINE_CURVE_WITH_KNOTS",
    "CARTESIAN_POINT",
    "CIRCLE",
    "COORDINATES_LIST",
    "DEFINITIONAL_REPRESENTATION",
    "DIRECTION",
    "EDGE_CURVE",
    "EDGE_LOOP",
    "FACE_BOUND",
    "LINE",
    "ORIENTED_EDGE",
    "PCURVE",
    "PLANE",
    "SURFACE_CURVE",
    "TESSELLATED_CURVE_SET",
    "VECTOR",
    "VERTEX_POINT",
)

Parameters = tuple[Any, ...]


@dataclass(frozen=True)
class Typed:
    """A value with the name of its type, such as ``LENGTH_MEASURE(0.01)``."""

    type: str
    value: Any


def is_reference(parameter: object) -> bool:
    """Tell whether a parameter is a reference such as ``#12``."""
    return isinstance(parameter, str) and parameter.startswith("#")


def read_numeric_parameter(parameter: object) -> float | None:
    """Return a numeric parameter, typed or not, as float, or None for anything else."""
    if isinstance(parameter, Typed):
        parameter = parameter.value
    if isinstance(parameter, bool) or not isinstance(parameter, int | float):
        return None
    return float(parameter)


@dataclass
class _DataSection:
    """The texts of all instances, and which of them hold an entity.

    Attributes
    ----------
    texts : dict of str to str
        Text of each instance by its reference, in the order of the file.
    holders : dict of str to list of str
        References of the instances that name an entity.
    names : dict of str to tuple of str
        The entities of an instance of several, by its text, which many share.
    """

    texts: dict[str, str] = field(default_factory=dict)
    holders: dict[str, list[str]] = field(default_factory=dict)
    names: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def add_instance(self, ref: str, entity: str, arguments: str) -> None:
        """Add an instance; without an entity before its arguments it holds several entities."""
        self.texts[ref] = entity + arguments
        if entity:
            self.holders.setdefault(entity.upper(), []).append(ref)
            return
        if arguments not in self.names:
            found = _ENTITY.findall(_STRING.sub("", arguments))
            self.names[arguments] = tuple(dict.fromkeys(found))
        for name in self.names[arguments]:
            self.holders.setdefault(name.upper(), []).append(ref)

    def get_last_reference(self) -> str:
        """Return the reference of the last instance, or the word that stands before the first."""
        return next(reversed(self.texts), "DATA")


class Exchange:
    """All instances of a file by their texts; each is parsed when it is asked for.

    Thousands of instances describe shape, and few of them are ever needed.

    Attributes
    ----------
    name : str
        Name of the file.
    schema : tuple of str
        FILE_SCHEMA of its header.
    """

    def __init__(self, name: str, schema: tuple[str, ...], data: _DataSection) -> None:
        self.name = name
        self.schema = schema
        self._texts = data.texts
        self._holders = data.holders
        self._parsed: dict[str, dict[str, Parameters]] = {}

    def get_entities(self, ref: object) -> dict[str, Parameters]:
        """Return entity names and parameters of an instance; empty where there is none."""
        if not isinstance(ref, str) or ref not in self._texts:
            return {}
        if ref not in self._parsed:
            try:
                self._parsed[ref] = _parse_instance(self._texts[ref])
            except (ValueError, RecursionError) as error:
                raise _make_parse_error(error, self.name) from error
        return self._parsed[ref]

    def get_parameters(self, ref: object, entity: str) -> Parameters:
        """Return the parameters of one entity of an instance; empty where it has none."""
        return self.get_entities(ref).get(entity, ())

    def yield_instances(self, *entities: str) -> Iterator[tuple[str, Parameters]]:
        """Yield reference and parameters of every instance of the given entities, in order."""
        for entity in entities:
            for ref in self._holders.get(entity, ()):
                parts = self.get_entities(ref)
                if entity in parts:
                    yield ref, parts[entity]

    def list_referrers(self, ref: str) -> list[str]:
        """Return the instances that refer to an instance directly, but for those of pure shape."""
        return self._referrers.get(ref, [])

    @cached_property
    def _referrers(self) -> dict[str, list[str]]:
        """The instances that refer to each instance, in the order of the file."""
        of_shape: set[str] = set()
        for entity in _SHAPE_ENTITIES:
            of_shape.update(self._holders.get(entity, ()))
        users: dict[str, list[str]] = {}
        for ref, text in self._texts.items():
            if ref in of_shape:
                continue
            for used in dict.fromkeys(_STRING_OR_REFERENCE.findall(text)):
                if used:  # empty for a string
                    users.setdefault(used, []).append(ref)
        return users


def yield_references(parameter: object) -> Iterator[str]:
    """Yield the references in a parameter, however deep, in their order."""
    if is_reference(parameter):
        yield str(parameter)
    elif isinstance(parameter, Typed):
        yield from yield_references(parameter.value)
    elif isinstance(parameter, tuple | list):
        for item in parameter:
            yield from yield_references(item)


def read_exchange_file(path: Path) -> Exchange:
    """Read a STEP file.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    Exchange
        Its schema and instances.

    Raises
    ------
    MetrologyError
        If it is not whole Part 21 text, or is larger than 128 MiB.
    """
    if not is_file(path):
        raise MetrologyError(f"STEP file must be a file, got {str(path)!r}")
    if path.stat().st_size > _MOST_BYTES:
        raise MetrologyError(f"STEP file must not exceed {_MOST_BYTES >> 20} MiB [{path.name}]")
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        text = path.read_text(encoding="latin-1")
    if not text.lstrip().startswith("ISO-10303-21;"):
        raise MetrologyError(f"STEP file must begin with ISO-10303-21; [{path.name}]")
    if "/*" in text:
        text = _COMMENT.sub(_drop_comment, text)
    try:
        header, begin = _read_header(text)
        return Exchange(path.name, _read_schema(header), _read_data_section(text, begin))
    except (ValueError, RecursionError) as error:
        raise _make_parse_error(error, path.name) from error


def _make_parse_error(error: Exception, name: str) -> MetrologyError:
    """Make the error of a STEP file that cannot be parsed."""
    reason = " ".join(str(error).split())[:_MOST_SHOWN]
    return MetrologyError(f"STEP file must be sound Part 21 text, got: {reason} [{name}]")


def _build_parentheses_pattern(depth: int) -> str:
    """Build the pattern of text in parentheses that holds others, up to a depth."""
    pattern = r"\((?:[^'()]++|'[^']*+')*+\)"
    for _ in range(depth - 1):
        pattern = rf"\((?:[^'()]++|'[^']*+'|{pattern})*+\)"
    return pattern


# every repetition is possessive: a quote that is lost costs one pass, not one for each character
# after it
_STRING = re.compile(r"'[^']*+'")
_COMMENT = re.compile(r"('[^']*+')|/\*(?:[^*]++|\*(?!/))*+(?:\*/)?")
_STATEMENT = re.compile(r"((?:'[^']*+'|[^';]++)++);")
_INSTANCE = re.compile(
    r"\s*+(?P<ref>\#\d++)\s*+=\s*+(?P<entity>(?:!?[A-Za-z_][\w-]*+)?+)\s*+"
    rf"(?P<arguments>{_build_parentheses_pattern(_DEEPEST_PARENTHESES)})\s*+;"
)
_END = re.compile(r"\s*+ENDSEC\s*+;\s*+END-ISO-10303-21\s*+;\s*+\Z")
_ENTITY = re.compile(r"!?[A-Za-z_][\w-]*+(?=\s*+\()")
_STRING_OR_REFERENCE = re.compile(r"'[^']*+'|(\#\d++)")
_TOKEN = re.compile(
    r"(?P<text>'[^']*+'(?:'[^']*+')*+)"
    r"|(?P<number>[-+]?\d++(?:\.\d*+(?:E[-+]?\d++)?)?)"
    r"|(?P<word>!?[A-Z_][\w-]*+)\s*+\("
    r"""|(?P<name>\#\d++|\.\w++\.|"[0-9A-F]*+"|[$*])|(?P<mark>[(),])|\s++|(?P<unknown>.)""",
    re.IGNORECASE,
)
# an instance without a name, of references, enumerations, numbers with a point, and lists of these:
# most of a file
_NUMBER = r"[-+]?\d++\.\d*+(?:E[-+]?\d++)?+"
_ATOM = rf"(?:\#\d++|\.[A-Z]\w*+\.|{_NUMBER})"
_PLAIN = re.compile(
    rf"(?P<entity>[A-Z_][A-Z0-9_]*+)\(''(?P<items>"
    rf"(?:,\s*+(?:{_ATOM}|\({_ATOM}(?:,\s*+{_ATOM})*+\)))++)\)"
)
_PLAIN_ITEM = re.compile(r",\s*+(?:\((?P<list>[^)]++)\)|(?P<atom>[^,(\s]++))")
_EXTENDED = re.compile(r"\\X(?P<bytes>[24])\\(?P<digits>[0-9A-F]*+)\\X0\\")
_ENCODING_BY_BYTES = {"2": "utf-16-be", "4": "utf-32-be"}


def _drop_comment(comment_or_string: re.Match[str]) -> str:
    """Replace a comment by nothing; keep a string."""
    return comment_or_string[1] or ""


def _read_header(text: str) -> tuple[list[str], int]:
    """Split a file into the statements before its data and the position of the data."""
    statements: list[str] = []
    position = 0
    while found := _STATEMENT.match(text, position):
        position = found.end()
        statement = found[1].strip()
        if statement == "DATA":
            return statements, position
        statements.append(statement)
    raise ValueError("no whole DATA section")


def _read_schema(header: list[str]) -> tuple[str, ...]:
    """Read the names in FILE_SCHEMA."""
    for statement in header:
        if re.match(r"FILE_SCHEMA\s*\(", statement):
            stated = _parse_instance(statement)["FILE_SCHEMA"]
            break
    else:
        return ()
    schema: list[str] = []
    for names in stated:
        if isinstance(names, tuple):
            schema += map(str, names)
        else:
            schema.append(str(names))
    return tuple(schema)


def _read_data_section(text: str, begin: int) -> _DataSection:
    """Read the instances from a position on, in one walk, up to the end of the file."""
    data = _DataSection()
    position = begin
    while found := _INSTANCE.match(text, position):
        position = found.end()
        ref, entity, arguments = found.groups()
        if ref in data.texts:
            raise ValueError(f"instance {ref} is not whole or not unique")
        data.add_instance(ref, entity, arguments)
    if not _END.match(text, position):
        raise _make_data_error(text, position, data.get_last_reference())
    return data


def _make_data_error(text: str, position: int, last: str) -> ValueError:
    """Make the error of a data section whose instances end too early."""
    statement = _STATEMENT.match(text, position)
    if statement is None or not _END.search(text, position):
        return ValueError("no whole DATA section")
    ref, equals, _ = statement[1].partition("=")
    if equals and re.fullmatch(r"#\d++", ref.strip()):
        return ValueError(f"instance {ref.strip()} is not whole or not unique")
    return ValueError(f"unexpected text after {last}")


def _parse_instance(text: str) -> dict[str, Parameters]:
    """Read the entities of an instance with their parameters."""
    plain = _PLAIN.fullmatch(text)
    if plain is not None:
        return {plain["entity"]: _read_plain_items(plain["items"])}
    return _parse_any_instance(text)


def _read_plain_items(items: str) -> Parameters:
    """Read the parameters of a plain instance after its empty name."""
    parameters: list[object] = [""]
    for values, atom in _PLAIN_ITEM.findall(items):
        if atom:
            parameters.append(_read_atom(atom))
        else:
            parameters.append(tuple(map(_read_atom, values.split(","))))
    return tuple(parameters)


def _read_atom(text: str) -> str | float:
    """Read a reference, an enumeration or a number with a point."""
    text = text.strip()
    if text[0] in "#.":
        return text
    number = float(text)
    if math.isinf(number):
        raise ValueError(f"no parameter: {text[:20]!r}")
    return number


def _parse_any_instance(text: str) -> dict[str, Parameters]:
    """Read the entities of an instance, however deep their parameters are.

    The text is turned into JSON, whose parser is strict: an entity or a typed value is an object
    with one key, a list is a list.
    """
    translator = _JsonTranslator(text)
    content = _DECODER.decode(_TOKEN.sub(translator.translate, text))
    entities = content if translator.holds_several else [content]
    if not entities:
        raise ValueError(f"instance must hold whole entities, got {text[:40]!r}")
    parts: dict[str, Parameters] = {}
    for entity in entities:
        if not isinstance(entity, Typed):
            raise ValueError(f"instance must hold whole entities, got {text[:40]!r}")
        parts[entity.type] = tuple(map(_convert_lists_to_tuples, entity.value))
    return parts


def _make_typed_value(pairs: list[tuple[str, Any]]) -> Typed:
    """Make a typed value of the only key of an object and its list of values."""
    name, value = pairs[0]
    return Typed(name, value)


_DECODER = json.JSONDecoder(object_pairs_hook=_make_typed_value)


class _JsonTranslator:
    """Turns the tokens of an instance into JSON, from the first to the last.

    Parameters
    ----------
    text : str
        The instance; in parentheses it holds several entities.
    """

    def __init__(self, text: str) -> None:
        self.holds_several = text.startswith("(")
        self._text = text
        self._closing: list[str] = []  # what ends the open objects and lists

    def translate(self, found: re.Match[str]) -> str:
        """Return the JSON of a token."""
        kind = found.lastgroup
        if kind is None:  # blanks
            return found[0]
        token = found[kind]
        if kind == "mark":
            return self._translate_mark(token)
        if kind == "word":
            return self._open_object(token, found.start())
        if kind == "number":
            return repr(float(token) if "." in token else int(token))
        if kind == "text":
            return json.dumps(_decode_string(token))
        if kind == "name" and token.startswith('"'):  # a binary number has quotes of its own
            return json.dumps(token)
        if kind == "name":
            return f'"{token}"'
        raise ValueError(f"no parameter: {self._text[found.start() :][:20]!r}")

    def _open_object(self, name: str, position: int) -> str:
        """Begin an object; entities of an instance follow each other without a comma."""
        is_entity = self.holds_several and len(self._closing) == 1
        is_first = not self._text[1:position].strip()
        self._closing.append("]}")
        comma = "," if is_entity and not is_first else ""
        return f'{comma}{{"{name.upper()}":['

    def _translate_mark(self, mark: str) -> str:
        """Translate a parenthesis or comma; a parenthesis closes what was opened last."""
        if mark == "(":
            self._closing.append("]")
            return "["
        if mark == ")" and self._closing:
            return self._closing.pop()
        return mark


def _decode_string(token: str) -> str:
    """Decode a string of Part 21 with its quotes."""
    plain = token[1:-1].replace("''", "'")
    return _EXTENDED.sub(_decode_extended, plain).replace("\\\\", "\\")


def _decode_extended(found: re.Match[str]) -> str:
    """Decode the hexadecimal digits of an ``X2`` or ``X4`` sequence of Part 21."""
    return bytes.fromhex(found["digits"]).decode(_ENCODING_BY_BYTES[found["bytes"]])


def _convert_lists_to_tuples(value: object) -> object:
    """Turn lists into tuples; a typed value holds one value instead of a list of one."""
    if isinstance(value, Typed):
        (inner,) = value.value
        return Typed(value.type, _convert_lists_to_tuples(inner))
    if isinstance(value, list):
        return tuple(map(_convert_lists_to_tuples, value))
    return value
