"""A trial held apart, as result.json has it; what draws it needs nothing of the search."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ApartTrial:
    """A trial that was held apart, the chance that it went wrong, and what it looks like."""

    trial: str
    chance: float
    looks_like: str
