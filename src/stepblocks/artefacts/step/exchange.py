"""The instances of a Part 21 file, parsed by steputils and looked up by name."""

from __future__ import annotations

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
    head, raw = _raw_instances(text, path)
    wanted = _with_references(raw, [ref for ref, body in raw.items() if not _SHAPE.fullmatch(_entity(body))])
    from steputils import p21

    part = head + "DATA;\n" + "".join(f"{ref}={raw[ref]};\n" for ref in wanted) + "ENDSEC;\nEND-ISO-10303-21;\n"
    try:
        file = p21.loads(part)
    except Exception as error:  # a parser of hostile text may fail in any way; each is one line
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise MetrologyError(f"STEP file must be sound Part 21 text, got: {reason} [{path.name}]") from error
    stated = file.header["FILE_SCHEMA"].params if "FILE_SCHEMA" in file.header else ()
    schema = tuple(str(name) for names in stated for name in (names if isinstance(names, tuple | list) else (names,)))
    instances: dict[str, dict[str, tuple[Any, ...]]] = {}
    for section in file.data:
        for instance in section.instances.values():
            entities = getattr(instance, "entities", None) or [instance.entity]
            instances[str(instance.ref)] = {str(one.name).upper(): _plain(one.params) for one in entities}
    return Exchange(path.name, schema, instances)


_INSTANCE = re.compile(r"\s*(#\d+)\s*=((?:'(?:[^']|'')*'|[^';])*);")
_STRING = re.compile(r"'(?:[^']|'')*'")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
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


def _raw_instances(text: str, path: Path) -> tuple[str, dict[str, str]]:
    """Split the data section into instances, each checked to be whole; the header stays text."""

    def broken(reason: str) -> MetrologyError:
        return MetrologyError(f"STEP file must be sound Part 21 text, got: {reason} [{path.name}]")

    text = _COMMENT.sub("", text) if "/*" in text else text
    head, mark, data = text.partition("DATA;")
    if not mark or not re.search(r"ENDSEC;\s*END-ISO-10303-21;\s*$", data):
        raise broken("no whole DATA section")
    raw: dict[str, str] = {}
    at = 0
    for match in _INSTANCE.finditer(data):
        if match.start() != at:
            break
        at = match.end()
        plain = _STRING.sub("", match[2])
        if plain.count("(") != plain.count(")") or not plain.rstrip().endswith(")") or match[1] in raw:
            raise broken(f"instance {match[1]} is not whole or not unique")
        raw[match[1]] = match[2].strip()
    if re.fullmatch(r"\s*ENDSEC;\s*END-ISO-10303-21;\s*", data[at:]) is None:
        raise broken(f"what is no instance after {next(reversed(raw), 'DATA')}")
    return head, raw


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


def _plain(value: Any) -> Any:
    """Turn what the parser gives into tuples, numbers, texts and `Typed`."""
    if hasattr(value, "type_name"):
        return Typed(str(value.type_name).upper(), _plain(value.param))
    if isinstance(value, tuple | list):
        return tuple(_plain(one) for one in value)
    return str(value) if isinstance(value, str) else value
