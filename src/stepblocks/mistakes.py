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
_LONGEST_VALUE = 60  # letters of a value that a message shows
_SIMILAR_ENOUGH = 0.7  # of two names, as difflib measures it

# pydantic's findings where a table should stand
_NO_TABLE = ("model_type", "model_attributes_type", "dict_type")

Model = TypeVar("Model", bound=BaseModel)
Mistake = tuple[str, str]  # where in the file, empty for the file itself; name, rule and value
# from a location to the place in the file, and what is left of it
Location = tuple[Any, ...]
Located = Callable[[Location], tuple[str, Location]]


def validate_file_data(
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


def list_unknown_names(
    table: Iterable[str], known: Sequence[str], place: str = ""
) -> list[Mistake]:
    """List unknown names, with what was probably meant."""
    mistakes = []
    for name in table:
        if name in known:
            continue
        similar = find_similar_name(name, known)
        hint = f"known are {', '.join(known)}"
        if similar:
            hint = f"did you mean {similar}?"
        mistakes.append((place, f"{name!r} is not known; {hint}"))
    return mistakes


def format_mistakes(mistakes: Sequence[Mistake], file: object) -> str:
    """Write mistakes by their places, one a line; the same mistake at several places once."""
    lines = [
        (text, _format_places(places)) for text, places in _group_places_by_text(mistakes).items()
    ]
    if len(lines) == 1:
        ((text, where),) = lines
        where = ", ".join(filter(None, (str(file), where)))
        return f"{text} [{where}]"
    message = [f"{len(lines)} mistakes [{file}]"]
    for text, where in lines:
        line = f"  {text}"
        if where:
            line += f" [{where}]"
        message.append(line)
    return "\n".join(message)


def _group_places_by_text(mistakes: Sequence[Mistake]) -> dict[str, list[str]]:
    """Return the places of each mistake by its text, ordered by where a place first occurs."""
    places_by_text: dict[str, list[str]] = {}
    for place, text in _sort_by_place(mistakes):
        places_by_text.setdefault(text, []).append(place)
    return places_by_text


def _sort_by_place(mistakes: Sequence[Mistake], first: Sequence[str] = ()) -> list[Mistake]:
    """Bring mistakes at one place together, in the order in which the places first occur."""
    order = list(dict.fromkeys([*first, *(place for place, _ in mistakes)]))
    return sorted(mistakes, key=lambda mistake: order.index(mistake[0]))


def _format_places(places: Sequence[str]) -> str:
    """Name the first of several places and say how many more there are."""
    first = places[0]
    further = set(places) - {first}
    if further:
        return f"{first} and {len(further)} more"
    return first


def list_mistakes(
    error: ValidationError,
    model: type[BaseModel],
    data: object,
    locate: Located = lambda place: ("", place),
    validate: Callable[[Any], object] | None = None,
) -> list[Mistake]:
    """List what is wrong by its places, unknown names first.

    What depends on an unknown name is checked as if the name were right.

    Parameters
    ----------
    error : ValidationError
        What pydantic found in the data.
    model : type of BaseModel
        The model of the data.
    data : object
        What was validated.
    locate : callable
        Takes a location of pydantic's; returns the place in the file, and what is left of the
        location.
    validate : callable, optional
        Validates corrected data again; the model where omitted.
    """
    findings = _leave_out_consequences(
        _list_findings_after_correction(error, model, data, validate)
    )
    mistakes: list[Mistake] = []
    for finding in sorted(findings, key=lambda found: not _is_unknown_name(found)):
        place, remainder = locate(finding["loc"])
        hint = ""
        if _is_unknown_name(finding):
            hint = _explain_unknown_name(model, finding["loc"], remainder)
        elif finding["type"] == "model_type":
            hint = _describe_table_fields(model, finding["loc"])
        for text in _format_finding(finding, ".".join(map(str, remainder))):
            mistakes.append((place, f"{text}{hint}"))
    return _sort_by_place(mistakes, first=[""])


def _is_unknown_name(finding: ErrorDetails) -> bool:
    """Tell whether pydantic found a name that a table does not have."""
    return finding["type"] == "extra_forbidden"


def _list_findings_after_correction(
    error: ValidationError,
    model: type[BaseModel],
    data: object,
    validate: Callable[[Any], object] | None,
) -> list[ErrorDetails]:
    """List pydantic's findings: unknown names, and what is wrong once these are corrected."""
    findings = error.errors(include_url=False)
    unknown = [finding for finding in findings if _is_unknown_name(finding)]
    if not unknown:
        return findings
    try:
        (validate or model.model_validate)(_correct_names(data, model, unknown))
    except ValidationError as deeper_error:
        deeper = deeper_error.errors(include_url=False)
        return unknown + [finding for finding in deeper if finding not in unknown]
    except TypeError:  # a call from Python holds a value that cannot be copied
        return unknown
    return unknown


def _leave_out_consequences(findings: Sequence[ErrorDetails]) -> list[ErrorDetails]:
    """Leave out that a list is too short where the entries that fell out of it are listed."""
    above = set()
    for finding in findings:
        location = finding["loc"]
        for end in range(len(location)):
            above.add(location[:end])
    return [
        finding
        for finding in findings
        if finding["type"] != "too_short" or finding["loc"] not in above
    ]


def _explain_unknown_name(model: type[BaseModel], location: Location, remainder: Location) -> str:
    """Return what to add to a message about an unknown name: why, what was meant, or what is known.

    A table states in `not_declared` why what others ask for is no field of it.
    """
    for table in _find_table_models(model, location):
        reasons: Mapping[str, str] = getattr(table, "not_declared", {})
        reason = reasons.get(str(location[-1]))
        if reason is not None:
            return f": {reason}"
    meant = _find_meant_name(model, location)
    if meant:
        path = ".".join(map(str, (*remainder[:-1], meant)))
        return f"; did you mean {path}?"
    known = sorted(_map_table_fields_by_name(model, location))
    if len(known) <= _FEW:
        return f"; known are {', '.join(known)}"
    return ""


def _describe_table_fields(model: type[BaseModel], location: Location) -> str:
    """Return what to add to a message where no table stands: the fields that it has, if few."""
    fields = _map_table_fields_by_name(model, (*location, ""))
    if not fields or len(fields) > _FEW:
        return ""
    return f"; its fields are {', '.join(fields)}"


def _format_finding(finding: ErrorDetails, name: str) -> list[str]:
    """Say name, rule and value of one of pydantic's findings, which may state several rules."""
    kind = finding["type"]
    value = finding.get("input")
    if kind == "missing":
        return [f"{name} is missing"]
    if kind == "extra_forbidden":
        return [f"{name} is not a known field, got {shorten_value(value)}"]
    if kind in ("value_error", "quantity"):
        text = finding["msg"]
        if "ctx" in finding:
            text = str(finding["ctx"]["error"])
        return [_prefix_rule_with_name(rule, name) for rule in text.splitlines()]
    if kind.startswith("int_"):
        return [f"{name} must be a whole number, got {shorten_value(value)}"]
    if kind == "string_pattern_mismatch":
        return [
            f"{name} must be lower-case words and digits joined by hyphens, "
            f"got {shorten_value(value)}"
        ]
    if kind in _NO_TABLE:
        return [f"{name} must be a table in braces, got {shorten_value(value)}"]
    text = finding["msg"].replace("a valid tuple", "a list in square brackets")
    return [f"{name}: {text[:1].lower()}{text[1:]}, got {shorten_value(value)}"]


def _prefix_rule_with_name(rule: str, name: str) -> str:
    """Put the name of a field before its rule, unless the rule begins with the name."""
    field_name = name.rsplit(".", 1)[-1]
    if not name or rule.startswith((field_name, f"`{name}")):
        return rule
    return f"{name}: {rule}"


def shorten_value(value: object) -> str:
    """Write a value in one line of at most sixty letters."""
    text = " ".join(repr(value).split())
    if len(text) <= _LONGEST_VALUE:
        return text
    return text[: _LONGEST_VALUE - 3] + "..."


def find_similar_name(word: str, known: Iterable[str]) -> str | None:
    """Find the name that was probably meant."""
    similar = difflib.get_close_matches(word, list(known), 1, _SIMILAR_ENOUGH)
    return similar[0] if similar else None


def _map_table_fields_by_name(model: type[BaseModel], location: Location) -> dict[str, FieldInfo]:
    """Return the fields, by their names in the file, of the table in which a location lies."""
    fields = {}
    for table in _find_table_models(model, location):
        for name, field in table.model_fields.items():
            if not field.exclude:
                fields[field.alias or name] = field
    return fields


def _find_table_models(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    """Return the models that the table may have in which a location lies."""
    tables = [model]
    for step in location[:-1]:
        below: list[type[BaseModel]] = []
        for table in tables:
            field = table.model_fields.get(str(step))
            if field is not None:
                below.extend(_yield_models_in_annotation(field.annotation))
        if below:
            tables = below
    return tables


def _find_meant_name(model: type[BaseModel], location: Location) -> str | None:
    """Find what an unknown name meant: one like it in its table, or the same in a table below."""
    word = str(location[-1])
    fields = _map_table_fields_by_name(model, location)
    similar = find_similar_name(word, fields)
    if similar:
        return similar
    for name, field in fields.items():
        for table in _yield_models_in_annotation(field.annotation):
            if word in table.model_fields:
                return f"{name}.{word}"
    return None


def _yield_models_in_annotation(annotation: object) -> Iterator[type[BaseModel]]:
    """Yield the models in the type of a field, such as those of a list or a union."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _yield_models_in_annotation(part)


def _correct_names(
    data: object, model: type[BaseModel], unknown: Sequence[Mapping[str, Any]]
) -> object:
    """Return data whose misspelt names are taken for what was meant, where that is missing.

    Stanzas of a misspelt kind join those of the kind that was meant. Other unknown names are left
    out.
    """
    data = deepcopy(data)
    for finding in unknown:
        *path, name = finding["loc"]
        table = _get_value_at_path(data, path)
        if not isinstance(table, dict) or name not in table:
            continue
        value = table.pop(name)
        meant = _find_meant_name(model, finding["loc"])
        if meant is None or "." in meant:
            continue
        declared = table.setdefault(meant, value)
        if declared is not value and isinstance(declared, list) and isinstance(value, list):
            declared += value
    return data


def _get_value_at_path(data: object, path: Sequence[Any]) -> object:
    """Return what lies in data at the end of a location, whose steps need not be keys.

    A step of pydantic's that names the branch of a union is passed over.
    """
    table: Any = data
    for step in path:
        is_key = isinstance(table, Mapping) and step in table
        if is_key or isinstance(table, list | tuple):
            table = table[step]
    return table
