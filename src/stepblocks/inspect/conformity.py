"""Whether a measured value conforms.

ISO 14253-1: inside the limits by more than the guard band the part conforms; outside by more than
it, it does not; between, neither is proven. What makes a value a bound, or leaves its uncertainty
unknown, stops the verdict at "not proven".
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

from scipy.special import stdtr, stdtrit

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Bound, Measured
from stepblocks.parts.tolerance import GUARD_FACTOR


class Outcome(StrEnum):
    """The three outcomes of ISO 14253-1, and the exit code of each."""

    CONFORMS = "conforms"
    DOES_NOT_CONFORM = "does not conform"
    NOT_PROVEN = "not proven"

    @property
    def exit_code(self) -> int:
        """0, 1 or 3."""
        return _EXIT_CODES[self]


_EXIT_CODES = {Outcome.CONFORMS: 0, Outcome.DOES_NOT_CONFORM: 1, Outcome.NOT_PROVEN: 3}


@dataclass(frozen=True)
class Decision:
    """A value judged against its limits; all but the probability in the unit of the value.

    Attributes
    ----------
    verdict : Outcome
    value, std : float
        Measured value and its standard uncertainty.
    lower, upper : float
        Limits of the specification; infinite where there is none.
    guard : float
        Guard band.
    probability : float
        That the true value lies within the limits, from the measurement alone [1].
    """

    verdict: Outcome
    value: float
    std: float
    lower: float
    upper: float
    guard: float
    probability: float


def decide_conformity(
    value: float,
    std: float,
    lower: float = -math.inf,
    upper: float = math.inf,
    dof: float = math.inf,
    guard: float | None = None,
) -> Decision:
    """Judge one measured value; the guard band follows from `std` and `dof` where none is given.

    Conformity cannot be proven where the tolerance is narrower than two guard bands.

    Raises
    ------
    MetrologyError
        If value or standard uncertainty are not finite, or the limits not in order.
    """
    if not (math.isfinite(value) and math.isfinite(std) and std >= 0.0):
        raise MetrologyError(
            f"value and std must be finite and std not negative, got {value:g} and {std:g}"
        )
    if not lower <= upper:
        raise MetrologyError(f"limits must be in order, got {lower:g} to {upper:g}")
    if guard is None:
        guard = max(GUARD_FACTOR, float(stdtrit(dof, 0.95))) * std
    return Decision(
        verdict=_decide_outcome(value, lower, upper, guard),
        value=value,
        std=std,
        lower=lower,
        upper=upper,
        guard=guard,
        probability=_compute_conformance_probability(value, std, lower, upper, dof),
    )


def _decide_outcome(value: float, lower: float, upper: float, guard: float) -> Outcome:
    """Return the outcome of ISO 14253-1, all sizes in the unit of the value."""
    if lower + guard <= value <= upper - guard:
        return Outcome.CONFORMS
    if value < lower - guard or value > upper + guard:
        return Outcome.DOES_NOT_CONFORM
    return Outcome.NOT_PROVEN


def _compute_conformance_probability(
    value: float, std: float, lower: float, upper: float, dof: float
) -> float:
    """Return the probability that the true value lies within the limits (JCGM 106:2012, 7.2)."""
    if std == 0.0:
        return 1.0 if lower <= value <= upper else 0.0
    below_upper = float(stdtr(dof, (upper - value) / std))
    below_lower = float(stdtr(dof, (lower - value) / std))
    return below_upper - below_lower


def judge_measured_conformity(
    measured: Measured, nominal: float, lower_deviation: float, upper_deviation: float
) -> Decision:
    """Judge a value by nominal and signed deviations, all in the unit of the value.

    A lower limit at or below zero of what cannot be negative is none. Of a bound only that side is
    proven on which it bounds; of what has no stated uncertainty nothing is.
    """
    least = nominal + lower_deviation
    if least <= 0.0 <= nominal:
        least = -math.inf
    decision = decide_conformity(
        measured.value, measured.std, least, nominal + upper_deviation, measured.dof, measured.guard
    )
    if decision.verdict is Outcome.NOT_PROVEN:
        return decision
    if measured.is_decidable and _is_proven_by_bound(measured.bound, decision):
        return decision
    return replace(decision, verdict=Outcome.NOT_PROVEN)


def _is_proven_by_bound(bound: Bound, decision: Decision) -> bool:
    """Tell whether a verdict also holds where the true value lies beyond what was measured."""
    lies_above = decision.value > decision.upper
    if bound is Bound.AT_LEAST:
        return lies_above
    if bound is Bound.AT_MOST:
        if decision.verdict is Outcome.DOES_NOT_CONFORM:
            return not lies_above
        return not math.isfinite(decision.lower)
    return True


def combine_verdicts(verdicts: Iterable[Outcome | None]) -> Outcome:
    """Return the verdict over all: one failure fails, one unproven leaves the whole unproven."""
    found = set(verdicts)
    for worst in (Outcome.DOES_NOT_CONFORM, Outcome.NOT_PROVEN):
        if worst in found:
            return worst
    return Outcome.CONFORMS
