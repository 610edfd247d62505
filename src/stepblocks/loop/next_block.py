"""The block that an experiment asks for, as result.json has it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NextBlock:
    """The block that an experiment asks for, in quantities of a stimulus file."""

    name: str
    height: str
    tip: str
    friction: str
