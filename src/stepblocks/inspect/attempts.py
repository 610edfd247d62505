"""Evaluate what can be evaluated, and keep why the others were refused."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from stepblocks.errors import MetrologyError

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Evaluated(Generic[Item, Result]):
    """What was evaluated, such as a profile, with what came out."""

    item: Item
    result: Result


@dataclass(frozen=True)
class Attempts(Generic[Item, Result]):
    """What could be evaluated of several items, and why the others were refused."""

    evaluated: list[Evaluated[Item, Result]] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)

    @property
    def results(self) -> list[Result]:
        """Results alone, in the order of their items."""
        return list_results(self.evaluated)


def list_results(evaluated: Iterable[Evaluated[Item, Result]]) -> list[Result]:
    """List the results of what was evaluated, without the items."""
    return [success.result for success in evaluated]


def evaluate_each(
    evaluate: Callable[[Item], Result], items: Iterable[Item], most_refused: float = np.inf
) -> Attempts[Item, Result]:
    """Evaluate each item; a `MetrologyError` refuses the item alone.

    Once more than `most_refused` items were refused, the remaining ones are not tried.
    """
    attempts = Attempts[Item, Result]()
    for item in items:
        if len(attempts.refusals) > most_refused:
            break
        try:
            attempts.evaluated.append(Evaluated(item, evaluate(item)))
        except MetrologyError as error:
            attempts.refusals.append(str(error))
    return attempts


def evaluate_if_possible(evaluate: Callable[[Item], Result], item: Item) -> Result | None:
    """Return the result of an evaluation, or None where a `MetrologyError` refuses it."""
    try:
        return evaluate(item)
    except MetrologyError:
        return None
