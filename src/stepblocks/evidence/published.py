"""Published figures as data: one TOML each, with its citation, its condition and its spread."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from stepblocks.errors import StimulusError
from stepblocks.evidence.questions import AT, QUESTIONS, dimension_of
from stepblocks.mistakes import validated
from stepblocks.quantities import parse_quantity
from stepblocks.text_file import read_document

_LARGEST = 100_000  # bytes
_Words = Annotated[str, Field(min_length=1)]


class Value(BaseModel):
    """One published figure as a range; quantities in the file, in SI once its publication is read."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    label: _Words
    at: dict[str, Any] = {}  # condition under which the model is asked
    low: Any
    high: Any
    spread: str = ""  # whose the range is, where the publication gives none

    def in_si(self, question: str) -> Value:
        """Return the figure in SI, or say what is wrong with it."""
        place = f"[{self.label!r}]"
        if unknown := sorted(set(self.at) - set(AT)):
            raise ValueError(f"at.{unknown[0]} is not one of {', '.join(AT)} {place}")
        try:
            at = {key: parse_quantity(text, AT[key]) if AT[key] else text for key, text in self.at.items()}
            low, high = (parse_quantity(text, dimension_of(question, at)) for text in (self.low, self.high))
        except ValueError as error:
            raise ValueError(f"{error} {place}") from error
        if not low <= high:
            raise ValueError(f"low must not exceed high, got {self.low} and {self.high} {place}")
        return self.model_copy(update={"at": at, "low": low, "high": high})


class Published(BaseModel):
    """What one publication says."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str  # of its file
    order: int  # on the page
    topic: _Words
    citation: _Words
    says: _Words
    question: str  # what the model is asked: a key of `stepblocks.evidence.questions.QUESTIONS`
    note: str = ""  # how it is asked
    values: Annotated[tuple[Value, ...], Field(min_length=1, alias="value")]

    @field_validator("question")
    @classmethod
    def _is_asked(cls, question: str) -> str:
        if question not in QUESTIONS:
            raise ValueError(f"question must be one of {', '.join(QUESTIONS)}, got {question!r}")
        return question

    @field_validator("values")
    @classmethod
    def _in_si(cls, values: tuple[Value, ...], info: ValidationInfo) -> tuple[Value, ...]:
        question = info.data.get("question")
        return tuple(value.in_si(question) for value in values) if question else values


def read_published(path: Path) -> Published:
    """Read one publication."""
    raw = read_document(path, "a publication", StimulusError, _LARGEST)
    return validated(Published, raw | {"name": path.stem}, path, StimulusError)


def shipped() -> list[Published]:
    """All publications of the package, in the order of the page."""
    found = map(read_published, Path(__file__).with_name("published").glob("*.toml"))
    return sorted(found, key=lambda one: (one.order, one.name))
