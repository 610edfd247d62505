"""The instances of a Part 21 file (ISO 10303-21), looked up by name in linear time."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.errors import MetrologyError
from stepblocks.files.text import is_file

_MOST_BYTES = 128 * 2**20


@dataclass(frozen=True)
class Typed:
    """A value with the name of its type, such as ``LENGTH_MEASURE(0.01)``."""

    type: str
    value: Any


def is_reference(value: object) -> bool:
    """Tell whether a parameter is a reference such as ``#12``."""
    return isinstance(value, str) and value.startswith("#")


def read_number(value: object) -> float | None:
    """Return a numeric parameter, typed or not, as float, or None for anything else."""
    if isinstance(value, Typed):
        value = value.value
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


class Exchange:
    """All instances of a file by their texts; each is parsed when it is asked for.

    Thousands of instances describe shape, and few of them are ever needed.
    """

    def __init__(self, name: str, schema: tuple[str, ...], raw: dict[str, str]) -> None:
        self.name = name
        self.schema = schema
        self._raw = raw
        self._parsed: dict[str, dict[str, tuple[Any, ...]]] = {}
        self._holding: dict[
            str, list[str]
        ] = {}  # instances by each reference and each entity or type in their texts
        for ref, body in raw.items():
            for found in dict.fromkeys(_NAME.findall(_STRING.sub("", body))):
                self._holding.setdefault(found.upper(), []).append(ref)

    def parts(self, ref: object) -> dict[str, tuple[Any, ...]]:
        """Return entity names and parameters of an instance; empty for what is no instance."""
        if ref in self._raw and ref not in self._parsed:
            try:
                self._parsed[str(ref)] = _parse_instance(self._raw[str(ref)])
            except (ValueError, RecursionError) as error:
                raise _make_error(error, self.name) from error
        return self._parsed.get(str(ref), {})

    def parameters(self, ref: object, entity: str) -> tuple[Any, ...]:
        """Return the parameters of one entity of an instance; empty where it has none."""
        return self.parts(ref).get(entity, ())

    def named(self, *entities: str) -> Iterator[tuple[str, tuple[Any, ...]]]:
        """Yield reference and parameters of every instance of the given entities, in order."""
        for entity in entities:
            for ref in self._holding.get(entity, ()):
                if entity in self.parts(ref):
                    yield ref, self.parts(ref)[entity]

    def users(self, ref: str) -> list[str]:
        """Return the instances that refer to an instance directly."""
        return self._holding.get(ref, [])


def find_references(value: object) -> Iterator[str]:
    """Yield the references in a parameter, however deep, in their order."""
    if is_reference(value):
        yield str(value)
    elif isinstance(value, Typed):
        yield from find_references(value.value)
    elif isinstance(value, tuple | list):
        for one in value:
            yield from find_references(one)


def read_exchange(path: Path) -> Exchange:
    """Parse a STEP file."""
    MetrologyError.require(is_file(path), f"STEP file must be a file, got {str(path)!r}")
    MetrologyError.require(
        path.stat().st_size <= _MOST_BYTES,
        f"STEP file must not exceed {_MOST_BYTES >> 20} MiB [{path.name}]",
    )
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        text = path.read_text(encoding="latin-1")
    MetrologyError.require(
        text.lstrip().startswith("ISO-10303-21;"),
        f"STEP file must begin with ISO-10303-21; [{path.name}]",
    )
    try:
        header, raw = _split_instances(text)
        stated = next(
            (
                _parse_instance(one)["FILE_SCHEMA"]
                for one in header
                if re.match(r"FILE_SCHEMA\s*\(", one)
            ),
            (),
        )
        schema = tuple(
            str(name)
            for names in stated
            for name in (names if isinstance(names, tuple) else (names,))
        )
        return Exchange(path.name, schema, raw)
    except (ValueError, RecursionError) as error:
        raise _make_error(error, path.name) from error


def _make_error(error: Exception, name: str) -> MetrologyError:
    return MetrologyError(
        f"STEP file must be sound Part 21 text, got: {' '.join(str(error).split()):.120} [{name}]"
    )


# every repetition is possessive: a quote that is lost costs one pass, not one for each character
# after it
_STATEMENT = re.compile(r"((?:'[^']*+'|[^';])++);")
_STRING = re.compile(r"'[^']*+'")
_COMMENT = re.compile(r"('[^']*+')|/\*(?:[^*]++|\*(?!/))*+(?:\*/)?")
_TOKEN = re.compile(
    r"(?P<text>'[^']*+'(?:'[^']*+')*+)"
    r"|(?P<number>[-+]?\d++(?:\.\d*+(?:E[-+]?\d++)?)?)"
    r"|(?P<word>!?[A-Z_][\w-]*+)\s*+\("
    r"""|(?P<name>\#\d++|\.\w++\.|"[0-9A-F]*+"|[$*])|(?P<mark>[(),])|\s++|(?P<other>.)""",
    re.IGNORECASE,
)
_EXTENDED = re.compile(r"\\X([24])\\([0-9A-F]*+)\\X0\\")
_NAME = re.compile(r"#\d++|[!A-Za-z_][\w-]*+(?=\s*+\()")


def _split_instances(text: str) -> tuple[list[str], dict[str, str]]:
    # Split a file into the statements of its header and its whole instances
    text = _COMMENT.sub(lambda found: found[1] or "", text) if "/*" in text else text
    statements = []
    at = 0
    while found := _STATEMENT.match(text, at):
        statements.append(found[1].strip())
        at = found.end()
    if (
        text[at:].strip()
        or "DATA" not in statements
        or statements[-2:] != ["ENDSEC", "END-ISO-10303-21"]
    ):
        raise ValueError("no whole DATA section")
    start = statements.index("DATA")
    raw: dict[str, str] = {}
    for statement in statements[start + 1 : -2]:
        name, _, body = statement.partition("=")
        ref = name.rstrip()
        plain = _STRING.sub("", body)
        if re.fullmatch(r"#\d++", ref) is None:
            raise ValueError(f"what is no instance after {next(reversed(raw), 'DATA')}")
        if plain.count("(") != plain.count(")") or not plain.endswith(")") or ref in raw:
            raise ValueError(f"instance {ref} is not whole or not unique")
        raw[ref] = body.lstrip()
    return statements[:start], raw


def _parse_instance(body: str) -> dict[str, tuple[Any, ...]]:
    # Read the entities of an instance with their parameters. The text is turned into JSON, whose
    # parser is strict.
    closing: list[str] = []
    several = body.startswith("(")

    def as_json(found: re.Match[str]) -> str:
        kind = found.lastgroup
        token = found[kind or 0]
        if kind == "word":
            between = (
                "," if several and len(closing) == 1 and body[1 : found.start()].strip() else ""
            )
            closing.append("]}")
            return f'{between}{{"{token.upper()}":['
        if kind == "number":
            return repr(float(token) if "." in token else int(token))
        if token in ("(", ")") and kind == "mark":
            if token == ")":
                return closing.pop() if closing else token
            closing.append("]")
            return "["
        if kind == "other":
            raise ValueError(f"no parameter: {body[found.start() :][:20]!r}")
        named = json.dumps(token) if kind == "name" else token
        return json.dumps(_decode(token)) if kind == "text" else named

    found = json.loads(_TOKEN.sub(as_json, body), object_pairs_hook=lambda pairs: Typed(*pairs[0]))
    entities = found if several else [found]
    if not entities or not all(isinstance(one, Typed) for one in entities):
        raise ValueError(f"instance must hold whole entities, got {body[:40]!r}")
    return {one.type: tuple(map(_convert_to_tuples, one.value)) for one in entities}


def _decode(token: str) -> str:
    wide = {"2": "utf-16-be", "4": "utf-32-be"}
    plain = token[1:-1].replace("''", "'")
    return _EXTENDED.sub(lambda one: bytes.fromhex(one[2]).decode(wide[one[1]]), plain).replace(
        "\\\\", "\\"
    )


def _convert_to_tuples(value: object) -> object:
    # Turn lists into tuples; what has a type has one value
    if isinstance(value, Typed):
        (inner,) = value.value
        return Typed(value.type, _convert_to_tuples(inner))
    return tuple(map(_convert_to_tuples, value)) if isinstance(value, list) else value
