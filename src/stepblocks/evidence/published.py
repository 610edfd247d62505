"""Published figures as data: one TOML each, with its citation, its condition and its spread."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from stepblocks.errors import StimulusError
from stepblocks.evidence.questions import AT, QUESTIONS, dimension_of
from stepblocks.mistakes import validated
from stepblocks.quantities import parse_quantity
from stepblocks.text_file import read_document

_LARGEST = 100_000  # bytes


class _Value(BaseModel):
    model_config = ConfigDict(extra="forbid")

    label: Annotated[str, Field(min_length=1)]
    at: dict[str, Any] = {}
    low: str
    high: str
    spread: str = ""


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    order: int
    topic: Annotated[str, Field(min_length=1)]
    citation: Annotated[str, Field(min_length=1)]
    says: Annotated[str, Field(min_length=1)]
    question: str
    note: str = ""
    value: Annotated[list[_Value], Field(min_length=1)]


@dataclass(frozen=True, eq=False)
class Value:
    """One published figure as a range, in SI."""

    label: str
    at: dict[str, Any]  # condition under which the model is asked, SI
    low: float
    high: float
    spread: str  # whose the range is, where the publication gives none


@dataclass(frozen=True, eq=False)
class Published:
    """What one publication says."""

    name: str
    order: int  # on the page
    topic: str
    citation: str
    says: str
    question: str  # what the model is asked: a key of `stepblocks.evidence.questions.QUESTIONS`
    note: str  # how it is asked
    values: tuple[Value, ...]


def read_published(path: Path) -> Published:
    """Read one publication."""
    place, name = str(path), path.stem
    raw = validated(_File, read_document(path, "a publication", StimulusError, _LARGEST), place, StimulusError)
    if raw.question not in QUESTIONS:
        raise StimulusError(f"question must be one of {', '.join(QUESTIONS)}, got {raw.question!r} [{place}]")
    values = tuple(_value(one, dimension_of(raw.question, one.at), place) for one in raw.value)
    return Published(name, raw.order, raw.topic, raw.citation, raw.says, raw.question, raw.note, values)


def shipped() -> list[Published]:
    """All publications of the package, in the order of the page."""
    found = map(read_published, sorted(Path(__file__).with_name("published").glob("*.toml")))
    return sorted(found, key=lambda one: one.order)


def _value(raw: _Value, dimension: str, place: str) -> Value:
    unknown = sorted(set(raw.at) - set(AT))
    if unknown:
        raise StimulusError(f"at.{unknown[0]} is not one of {', '.join(AT)} [{place}, {raw.label!r}]")
    try:
        at = {key: parse_quantity(text, AT[key]) if AT[key] else text for key, text in raw.at.items()}
        low, high = (parse_quantity(text, dimension) for text in (raw.low, raw.high))
    except ValueError as error:
        raise StimulusError(f"{error} [{place}, {raw.label!r}]") from error
    if not low <= high:
        raise StimulusError(f"low must not exceed high, got {raw.low} and {raw.high} [{place}, {raw.label!r}]")
    return Value(raw.label, at, low, high, raw.spread)
