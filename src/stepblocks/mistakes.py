"""Everything that is wrong with a file that people write, listed at once."""

import difflib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from stepblocks.errors import StepblocksError

_FEW = 12  # names that a message lists
Model = TypeVar("Model", bound=BaseModel)
Mistake = tuple[str, str]  # where in the file, empty for the file itself; name, rule and value
# from a location to the place in the file, and what is left of it
Location = tuple[Any, ...]
Located = Callable[[Location], tuple[str, Location]]


def validate_data(
    model: type[Model], data: object, place: object, raised: type[StepblocksError]
) -> Model:
    """Validate what a file holds, or list all that is wrong with it."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise raised(format_mistakes(list_mistakes(error, model, data), place)) from error


@contextmanager
def collect_mistakes(mistakes: list[Mistake], place: str = "") -> Iterator[None]:
    """Note what the block refuses, and go on after it."""
    try:
        yield
    except StepblocksError as error:
        mistakes.append((place, str(error)))


def find_unknown_names(
    table: Iterable[str], known: Sequence[str], place: str = ""
) -> list[Mistake]:
    """List unknown names, with what was probably meant."""
    found = [name for name in table if name not in known]
    hints = [
        f"did you mean {meant}?"
        if (meant := find_similar(name, known))
        else f"known are {', '.join(known)}"
        for name in found
    ]
    return [
        (place, f"{name!r} is not known; {hint}") for name, hint in zip(found, hints, strict=True)
    ]


def format_mistakes(mistakes: Sequence[Mistake], file: object) -> str:
    """Write mistakes by their places, one a line, those that are alike once."""
    by_text: dict[str, list[str]] = {}
    order = list(dict.fromkeys(place for place, _ in mistakes))
    for place, text in sorted(mistakes, key=lambda one: order.index(one[0])):
        by_text.setdefault(text, []).append(place)
    lines = []
    for text, (first, *others) in by_text.items():
        more = len(set(others) - {first})
        lines.append((text, f"{first} and {more} more" if more else first))
    if len(lines) == 1:
        ((text, where),) = lines
        return f"{text} [{', '.join(filter(None, (str(file), where)))}]"
    shown = (f"  {text} [{where}]" if where else f"  {text}" for text, where in lines)
    return "\n".join([f"{len(lines)} mistakes [{file}]", *shown])


def list_mistakes(
    error: ValidationError,
    model: type[BaseModel],
    data: object,
    locate: Located = lambda place: ("", place),
    validate: Callable[[Any], object] | None = None,
) -> list[Mistake]:
    """List what is wrong by its places, unknown names first.

    What depends on an unknown name is checked as if the name were right.
    """
    found = error.errors(include_url=False)
    unknown = [one for one in found if one["type"] == "extra_forbidden"]
    if unknown:
        try:
            (validate or model.model_validate)(_correct_names(data, model, unknown))
            found = unknown
        except ValidationError as other:
            found = unknown + [one for one in other.errors(include_url=False) if one not in unknown]
        except TypeError:  # a call from Python holds a value that cannot be copied
            found = unknown
    # that too few are left is no mistake of its own where those that fell out are listed
    deeper = {one["loc"][:end] for one in found for end in range(len(one["loc"]))}
    own = [one for one in found if one["type"] != "too_short" or one["loc"] not in deeper]
    mistakes = []
    for one in sorted(own, key=lambda one: one["type"] != "extra_forbidden"):
        place, rest = locate(one["loc"])
        hint = ""
        if one["type"] == "extra_forbidden":
            known = sorted(_list_fields(model, one["loc"]))
            if meant := _find_meant_name(model, one["loc"]):
                hint = f"; did you mean {'.'.join(map(str, (*rest[:-1], meant)))}?"
            elif len(known) <= _FEW:
                hint = f"; known are {', '.join(known)}"
        mistakes += [
            (place, f"{text}{hint}") for text in _format_finding(one, ".".join(map(str, rest)))
        ]
    order = ["", *dict.fromkeys(place for place, _ in mistakes)]
    return sorted(mistakes, key=lambda one: order.index(one[0]))


def _format_finding(finding: ErrorDetails, name: str) -> list[str]:
    # Say name, rule and value of one of pydantic's findings, which may state several rules
    kind = finding["type"]
    value = finding.get("input")
    if kind == "missing":
        return [f"{name} is missing"]
    if kind == "extra_forbidden":
        return [f"{name} is not a known field, got {shorten_value(value)}"]
    if kind in ("value_error", "quantity"):
        text = str(finding["ctx"]["error"]) if "ctx" in finding else finding["msg"]
        stated = (name.rsplit(".", 1)[-1], f"`{name}")
        return [
            f"{name}: {line}" if name and not line.startswith(stated) else line
            for line in text.splitlines()
        ]
    if kind.startswith("int_"):
        return [f"{name} must be a whole number, got {shorten_value(value)}"]
    if kind == "string_pattern_mismatch":
        return [
            f"{name} must be lower-case words and digits joined by hyphens, "
            f"got {shorten_value(value)}"
        ]
    text = finding["msg"].replace("a valid tuple", "a list in square brackets")
    return [f"{name}: {text[:1].lower()}{text[1:]}, got {shorten_value(value)}"]


def shorten_value(value: object) -> str:
    """Write a value in one line of at most sixty letters."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."


def find_similar(word: str, known: Iterable[str]) -> str | None:
    """Find the name that was probably meant."""
    return next(iter(difflib.get_close_matches(word, list(known), 1, 0.7)), None)


def _list_fields(model: type[BaseModel], place: Location) -> dict[str, FieldInfo]:
    # List the fields, by their names in the file, of the table in which a place lies
    tables = [model]
    for step in place[:-1]:
        fields = [
            field for table in tables if (field := table.model_fields.get(str(step))) is not None
        ]
        tables = [below for field in fields for below in _list_models(field.annotation)] or tables
    return {
        field.alias or name: field
        for table in tables
        for name, field in table.model_fields.items()
        if not field.exclude
    }


def _find_meant_name(model: type[BaseModel], place: Location) -> str | None:
    # Find what a name meant: one like it in its table, or the same in a table below
    word = str(place[-1])
    known = _list_fields(model, place)
    deeper = [
        f"{name}.{word}"
        for name, field in known.items()
        for below in _list_models(field.annotation)
        if word in below.model_fields
    ]
    return find_similar(word, known) or next(iter(deeper), None)


def _list_models(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _list_models(part)


def _correct_names(
    data: object, model: type[BaseModel], unknown: Sequence[Mapping[str, Any]]
) -> object:
    # Take a misspelt name for what was meant, where that is missing, and leave the others out
    data = deepcopy(data)
    for one in unknown:
        *way, name = one["loc"]
        table: Any = data
        for step in way:
            if isinstance(table, Mapping | list | tuple) and not (
                isinstance(table, Mapping) and step not in table
            ):
                table = table[step]
        if isinstance(table, dict) and name in table:
            value = table.pop(name)
            meant = _find_meant_name(model, one["loc"])
            if meant is not None and "." not in meant:
                table[meant] = value
    return data
