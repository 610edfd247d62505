"""What an inspection gives: measured characteristics with their convention, and the verdict on them.

The evaluations themselves are `stepblocks.inspect.step` and `stepblocks.inspect.shapes`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.scans.scan import HeightMap, Profile, rows_of
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Measured
from stepblocks.inspect.conformity import Decision, Outcome, decide

Array = NDArray[np.float64]
T = TypeVar("T")

MOST_PROFILES = 60  # Profiles of a map that are evaluated; of more, as many are taken evenly over the map


@dataclass(frozen=True)
class Shown:
    """What a plot shows."""

    position: Array  # One profile, levelled on its lower or outer face [m]
    height: Array
    windows: tuple[tuple[float, float, str], ...]  # Begin, end [m] and name of the stretches that were evaluated


@dataclass(frozen=True)
class Inspected:
    """What a scan says."""

    values: dict[str, Measured]  # By key of the characteristic
    convention: str  # How the values are defined
    notes: tuple[str, ...]  # What was left out or cut
    shown: Shown  # For the plot


def sampled(scan: Profile | HeightMap) -> tuple[list[Profile], list[str]]:
    """Return the profiles of a scan that are evaluated, and a note if not all are."""
    rows = rows_of(scan)
    if len(rows) <= MOST_PROFILES:
        return rows, []
    chosen = np.unique(np.linspace(0, len(rows) - 1, MOST_PROFILES).round().astype(int))
    return [rows[index] for index in chosen], [f"{len(chosen)} of {len(rows)} profiles evaluated"]


def evaluated(rows: list[Profile], evaluate: Callable[[Profile], T], notes: list[str]) -> list[tuple[Profile, T]]:
    """Evaluate profile by profile; refused ones are named, and all refused is an error."""
    results: list[tuple[Profile, T]] = []
    refused: list[str] = []
    for row in rows:
        try:
            results.append((row, evaluate(row)))
        except MetrologyError as error:
            refused.append(str(error))
    if not results:
        raise MetrologyError(f"no profile can be evaluated: {refused[0]}")
    if refused:
        notes.append(f"{len(refused)} of {len(rows)} profiles refused, the first since {refused[0]}")
    return results


def verdict_of(decisions: list[Decision]) -> Outcome:
    """Return the verdict over all characteristics: one failure fails, one unproven leaves the whole unproven."""
    verdicts = {decision.verdict for decision in decisions}
    for verdict in (Outcome.DOES_NOT_CONFORM, Outcome.NOT_PROVEN):
        if verdict in verdicts:
            return verdict
    return Outcome.CONFORMS


def judge(measured: Measured, nominal: float, lower: float, upper: float) -> Decision:
    """Judge a value; a lower limit at or below zero of what cannot be negative is none."""
    low = nominal + lower
    return decide(
        measured.value, measured.std, low if low > 0.0 or nominal < 0.0 else -np.inf, nominal + upper, measured.dof
    )
