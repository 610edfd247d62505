"""Does a part conform? Decision by ISO 14253-1, with a guard band, and the risks that come with it.

At 95 % conformance probability the guard band is 1.65 u: inside the limits by more than it, the part conforms; outside
by more than it, it does not; between, neither is proven.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Measured

GUARD_FACTOR = 1.65  # guard band over standard uncertainty at 95 % conformance probability (ISO 14253-1:2017, 5.3) [1]


class Outcome(StrEnum):
    """The three outcomes of ISO 14253-1, and the exit code of each."""

    CONFORMS = "conforms"
    DOES_NOT_CONFORM = "does not conform"
    NOT_PROVEN = "not proven"

    @property
    def exit_code(self) -> int:
        """0, 1 or 3."""
        return {Outcome.CONFORMS: 0, Outcome.DOES_NOT_CONFORM: 1, Outcome.NOT_PROVEN: 3}[self]


@dataclass(frozen=True)
class Decision:
    """A value judged against its limits."""

    verdict: Outcome
    value: float  # m
    std: float  # standard uncertainty [m]
    lower: float  # limit of the specification [m]; infinite where there is none
    upper: float  # likewise [m]
    guard: float  # guard band [m]
    probability: float  # that the true value lies within the limits, from the measurement alone [1]


def decide(
    value: float, std: float, lower: float = -math.inf, upper: float = math.inf, dof: float = math.inf
) -> Decision:
    """Judge one measured value.

    Proof of conformity is impossible where the tolerance is narrower than two guard bands. With few degrees of freedom the
    guard band is Student's 95 % point instead of 1.65.

    References
    ----------
    ISO 14253-1:2017; probability under a normal law, JCGM 106:2012 (7.2).

    Examples
    --------
    >>> decide(10.2e-6, 0.1e-6, 9e-6, 11e-6).verdict
    <Outcome.CONFORMS: 'conforms'>
    >>> decide(10.9e-6, 0.1e-6, 9e-6, 11e-6).verdict
    <Outcome.NOT_PROVEN: 'not proven'>
    """
    if not (math.isfinite(value) and math.isfinite(std) and std >= 0.0):
        raise MetrologyError(f"value and std must be finite and std not negative, got {value:g} and {std:g}")
    if math.isnan(lower) or math.isnan(upper) or not lower <= upper:
        raise MetrologyError(f"limits must be in order, got {lower:g} to {upper:g}")
    guard = _guard_factor(dof) * std
    if lower + guard <= value <= upper - guard:
        verdict = Outcome.CONFORMS
    elif value < lower - guard or value > upper + guard:
        verdict = Outcome.DOES_NOT_CONFORM
    else:
        verdict = Outcome.NOT_PROVEN
    return Decision(verdict, value, std, lower, upper, guard, _between(value, std, lower, upper, dof))


def judge(measured: Measured, nominal: float, lower: float, upper: float) -> Decision:
    """Judge a value by nominal and deviations [m]; a lower limit at or below zero of what cannot be negative is none."""
    low = nominal + lower
    least = low if low > 0.0 or nominal < 0.0 else -math.inf
    return decide(measured.value, measured.std, least, nominal + upper, measured.dof)


def verdict_of(decisions: Iterable[Decision]) -> Outcome:
    """Return the verdict over all characteristics: one failure fails, one unproven leaves the whole unproven."""
    verdicts = {decision.verdict for decision in decisions}
    for verdict in (Outcome.DOES_NOT_CONFORM, Outcome.NOT_PROVEN):
        if verdict in verdicts:
            return verdict
    return Outcome.CONFORMS


def _guard_factor(dof: float) -> float:
    if math.isinf(dof):
        return GUARD_FACTOR
    from scipy import stats

    return max(GUARD_FACTOR, float(stats.t.ppf(0.95, dof)))


def _normal_cdf(x: float) -> float:
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


def _between(value: float, std: float, lower: float, upper: float, dof: float = math.inf) -> float:
    if std == 0.0:
        return 1.0 if lower <= value <= upper else 0.0
    if math.isfinite(dof):
        from scipy import stats

        return float(stats.t.cdf((upper - value) / std, dof) - stats.t.cdf((lower - value) / std, dof))
    return _normal_cdf((upper - value) / std) - _normal_cdf((lower - value) / std)


def risks(process_mean: float, process_std: float, std: float, lower: float, upper: float) -> tuple[float, float]:
    """Risks of the rule for parts of a normal process measured with a normal error.

    Returns
    -------
    tuple of float
        Share of all parts that lie outside the limits and are accepted, and that lie inside and are rejected [1].

    Raises
    ------
    MetrologyError
        If a standard deviation is not positive or a limit not finite.

    References
    ----------
    JCGM 106:2012, 9.5 (global risks), integrated over the true value.
    """
    if not (process_std > 0.0 and std > 0.0 and math.isfinite(lower) and math.isfinite(upper)):
        raise MetrologyError("risks need positive standard deviations and finite limits")
    guard = GUARD_FACTOR * std

    def accepted(truth: float) -> float:
        return _between(truth, std, lower + guard, upper - guard) if lower + guard <= upper - guard else 0.0

    def rejected(truth: float) -> float:
        return 1.0 - _between(truth, std, lower - guard, upper + guard)

    low, high = (max(min((limit - process_mean) / process_std, 12.0), -12.0) for limit in (lower, upper))

    def share(answer: Callable[[float], float], begin: float, end: float) -> float:
        from scipy.integrate import quad

        def density(t: float) -> float:
            return answer(process_mean + t * process_std) * math.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi)

        return float(quad(density, begin, end, limit=200, epsabs=1e-12)[0]) if end > begin else 0.0

    return share(accepted, -12.0, low) + share(accepted, high, 12.0), share(rejected, low, high)
