"""The instances of a Part 21 file (ISO 10303-21), in time that grows with its length, looked up by name."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.errors import MetrologyError

_MOST_BYTES = 128 * 2**20


@dataclass(frozen=True)
class Typed:
    """A value with the name of its type, such as ``LENGTH_MEASURE(0.01)``."""

    type: str
    value: Any


def is_reference(value: object) -> bool:
    """Tell whether a parameter is a reference such as ``#12``."""
    return isinstance(value, str) and value.startswith("#")


def number(value: object) -> float | None:
    """Return a numeric parameter, typed or not, as float, or None for anything else."""
    if isinstance(value, Typed):
        value = value.value
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


class Exchange:
    """All instances of a file."""

    def __init__(self, name: str, schema: tuple[str, ...], instances: dict[str, dict[str, tuple[Any, ...]]]) -> None:
        self.name, self.schema, self._instances = name, schema, instances
        self._by_type: dict[str, list[str]] = {}
        self._users: dict[str, list[str]] | None = None
        for ref, parts in instances.items():
            for part in parts:
                self._by_type.setdefault(part, []).append(ref)

    def parts(self, ref: object) -> dict[str, tuple[Any, ...]]:
        """Return entity names and parameters of an instance; empty for what is no instance."""
        return self._instances.get(ref, {}) if isinstance(ref, str) else {}

    def parameters(self, ref: object, entity: str) -> tuple[Any, ...]:
        """Return the parameters of one entity of an instance; empty where it has none."""
        return self.parts(ref).get(entity, ())

    def named(self, *entities: str) -> Iterator[tuple[str, tuple[Any, ...]]]:
        """Yield reference and parameters of every instance of the given entities, in the order of the file."""
        for entity in entities:
            for ref in self._by_type.get(entity, ()):
                yield ref, self._instances[ref][entity]

    def users(self, ref: str) -> list[str]:
        """Return the instances that refer to an instance directly."""
        if self._users is None:
            self._users = {}
            for user, parts in self._instances.items():
                for target in set(references_in(tuple(parts.values()))):
                    self._users.setdefault(target, []).append(user)
        return self._users.get(ref, [])


def references_in(value: object) -> Iterator[str]:
    """Yield the references in a parameter, however deep, in their order."""
    if is_reference(value):
        yield str(value)
    elif isinstance(value, Typed):
        yield from references_in(value.value)
    elif isinstance(value, tuple | list):
        for one in value:
            yield from references_in(one)


def read_exchange(path: Path) -> Exchange:
    """Parse a STEP file."""
    if not path.is_file():
        raise MetrologyError(f"STEP file must be a file, got {str(path)!r}")
    if path.stat().st_size > _MOST_BYTES:
        raise MetrologyError(f"STEP file must not exceed {_MOST_BYTES >> 20} MiB [{path.name}]")
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        text = path.read_text(encoding="latin-1")
    if not text.lstrip().startswith("ISO-10303-21;"):
        raise MetrologyError(f"STEP file must begin with ISO-10303-21; [{path.name}]")
    try:
        header, raw = _raw_instances(text)
        wanted = _with_references(raw, [ref for ref, body in raw.items() if not _SHAPE.fullmatch(_entity(body))])
        instances = {ref: _parsed(raw[ref]) for ref in wanted}
        stated = next((_parsed(one)["FILE_SCHEMA"] for one in header if _entity(one) == "FILE_SCHEMA"), ())
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:120]
        raise MetrologyError(f"STEP file must be sound Part 21 text, got: {reason} [{path.name}]") from error
    schema = tuple(str(name) for names in stated for name in (names if isinstance(names, tuple) else (names,)))
    return Exchange(path.name, schema, instances)


# every repetition is possessive: a quote that is lost costs one pass, not one for each character after it
_STATEMENT = re.compile(r"((?:'[^']*+'|[^';])++);")
_STRING = re.compile(r"'[^']*+'")
_COMMENT = re.compile(r"('[^']*+')|/\*(?:[^*]++|\*(?!/))*+(?:\*/)?")
_TOKEN = re.compile(
    r"""(?P<text>'[^']*+'(?:'[^']*+')*+)|(?P<number>[-+]?\d++(?:\.\d*+(?:E[-+]?\d++)?)?)|(?P<word>!?[A-Z_][\w-]*+)\s*+\("""
    r"""|(?P<name>\#\d++|\.\w++\.|"[0-9A-F]*+"|[$*])|(?P<mark>[(),])|\s++|(?P<other>.)""",
    re.IGNORECASE,
)
_EXTENDED = re.compile(r"\\X([24])\\([0-9A-F]*+)\\X0\\")
# thousands of instances are shape; of them only what a dimension leads to is parsed
_SHAPE = re.compile(
    r"(CARTESIAN|VERTEX)_POINT|DIRECTION|VECTOR|LINE|CIRCLE|ELLIPSE|POLYLINE"
    r"|(EDGE|SURFACE|SEAM)_CURVE|PCURVE|ORIENTED_EDGE|(EDGE|POLY)_LOOP|FACE(_OUTER)?_BOUND|ADVANCED_FACE"
    r"|PLANE|(CYLINDRICAL|CONICAL|SPHERICAL|TOROIDAL)_SURFACE|B_SPLINE_(CURVE|SURFACE)_WITH_KNOTS"
    r"|DEFINITIONAL_REPRESENTATION|AXIS2_PLACEMENT_[23]D|AXIS1_PLACEMENT|(CLOSED|OPEN)_SHELL|MANIFOLD_SOLID_BREP"
    r"|COORDINATES_LIST|TESSELLATED_(CURVE_SET|GEOMETRIC_SET|ANNOTATION_OCCURRENCE)"
    r"|DRAUGHTING_(CALLOUT|MODEL)|ANNOTATION_PLANE"
)
# instances whose references are not followed
_LEAVES = re.compile(
    r"(EDGE|VERTEX)_LOOP|FACE(_OUTER)?_BOUND|(CLOSED|OPEN)_SHELL|MANIFOLD_SOLID_BREP|DRAUGHTING_(CALLOUT|MODEL)"
)


def _entity(body: str) -> str:
    return body.lstrip().partition("(")[0].strip().upper()


def _raw_instances(text: str) -> tuple[list[str], dict[str, str]]:
    """Split a file into the statements of its header and its instances, each checked to be whole."""
    text = _COMMENT.sub(lambda found: found[1] or "", text) if "/*" in text else text
    statements, at = [], 0
    while found := _STATEMENT.match(text, at):
        statements.append(found[1].strip())
        at = found.end()
    if text[at:].strip() or "DATA" not in statements or statements[-2:] != ["ENDSEC", "END-ISO-10303-21"]:
        raise ValueError("no whole DATA section")
    start = statements.index("DATA")
    raw: dict[str, str] = {}
    for statement in statements[start + 1 : -2]:
        name, _, body = statement.partition("=")
        ref, plain = name.rstrip(), _STRING.sub("", body)
        if re.fullmatch(r"#\d++", ref) is None:
            raise ValueError(f"what is no instance after {next(reversed(raw), 'DATA')}")
        if plain.count("(") != plain.count(")") or not plain.endswith(")") or ref in raw:
            raise ValueError(f"instance {ref} is not whole or not unique")
        raw[ref] = body.lstrip()
    return statements[:start], raw


def _with_references(raw: dict[str, str], start: list[str]) -> list[str]:
    wanted = dict.fromkeys(start)
    stack = list(start)
    while stack:
        body = raw[stack.pop()]
        if _LEAVES.fullmatch(_entity(body)):
            continue
        for target in re.findall(r"#\d+", _STRING.sub("", body)):
            if target in raw and target not in wanted:
                wanted[target] = None
                stack.append(target)
    return list(wanted)


def _parsed(body: str) -> dict[str, tuple[Any, ...]]:
    """Read the entities of an instance, one or several in brackets, each with its parameters: as JSON, whose parser is strict."""
    closing: list[str] = []
    several = body.startswith("(")

    def as_json(found: re.Match[str]) -> str:
        kind, token = found.lastgroup, found[found.lastgroup or 0]
        if kind == "word":
            between = "," if several and len(closing) == 1 and body[1 : found.start()].strip() else ""
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
        return json.dumps(_decoded(token) if kind == "text" else token) if kind in ("text", "name") else token

    found = json.loads(_TOKEN.sub(as_json, body), object_pairs_hook=lambda pairs: Typed(*pairs[0]))
    entities = found if several else [found]
    if not entities or not all(isinstance(one, Typed) for one in entities):
        raise ValueError(f"instance must hold whole entities, got {body[:40]!r}")
    return {one.type: tuple(map(_plain, one.value)) for one in entities}


def _decoded(token: str) -> str:
    plain = _EXTENDED.sub(_extended, token[1:-1].replace("''", "'"))
    return plain.replace("\\\\", "\\")


def _extended(found: re.Match[str]) -> str:
    return bytes.fromhex(found[2]).decode("utf-16-be" if found[1] == "2" else "utf-32-be")


def _plain(value: Any) -> Any:
    """Turn lists into tuples; what has a type has one value."""
    if isinstance(value, Typed):
        (inner,) = value.value
        return Typed(value.type, _plain(inner))
    return tuple(map(_plain, value)) if isinstance(value, list) else value
