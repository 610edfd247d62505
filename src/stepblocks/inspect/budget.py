"""A measured value with its uncertainty budget, and whether it conforms.

JCGM 100:2008: components add in squares (10), degrees of freedom by Welch and Satterthwaite (G.2b).
An interval is never narrower than that of what was estimated from few values alone, so that stating
one more component does not narrow it.
ISO 14253-1: inside the limits by more than the guard band the part conforms; outside by more than
it, it does not; between, neither is proven. What makes a value a bound, or leaves its uncertainty
unknown, stops the verdict at "not proven".
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, Estimate
from stepblocks.parts.tolerance import GUARD_FACTOR

# slow cosines that are always taken, where there are as many profiles: Student's factor is then 2.8
# at 95 %
_LEAST_COSINES = 4


# relative standard uncertainty of a scale that nobody stated [1]: what makers of stylus instruments
# specify, by H. Haitjema, Uncertainty analysis of roughness standard calibration using stylus
# instruments, Precision Engineering 22 (1998)
UNSTATED_SCALE = 0.02
UNSTATED = "not stated"
_NORMAL_95 = 1.959963984540054
_NODES = 200  # of a rectangle over which a mean is taken
_LEAST_REST = 1e-4  # of the variance of a rectangle, that all else has at least [1]


@dataclass(frozen=True)
class Component:
    """One source of uncertainty.

    Attributes
    ----------
    name : str
        What it comes from.
    std : float
        Standard uncertainty, in the unit of the value; nan where it is unknown.
    dof : float
        Degrees of freedom; infinite for what was not estimated from few values.
    how : str
        How it was evaluated; begins with "not stated" where a default stands for it.
    decisive : bool
        Whether nothing can be proven while it is unknown.
    bounded : bool
        Whether it ends at root three of `std`, a rectangle: where it outweighs the others, their
        sum does nearly so.
    """

    name: str
    std: float
    dof: float = math.inf
    how: str = ""
    decisive: bool = False
    bounded: bool = False

    @property
    def is_type_a(self) -> bool:
        """Whether statistics of the scan gave it (JCGM 100, 4.2)."""
        return math.isfinite(self.dof) or self.name == "noise"


@dataclass(frozen=True)
class Instrument:
    """What is known of the instrument besides the scan.

    Attributes
    ----------
    calibration_std : float or None
        Relative standard uncertainty of the vertical scale [1]; None takes 2 %.
    resolution : float
        Least difference of height that it shows [m].
    lateral_std : float or None
        Relative standard uncertainty of the lateral scale [1]; None takes 2 %.
    """

    calibration_std: float | None = None
    resolution: float = 0.0
    lateral_std: float | None = None

    def __post_init__(self) -> None:
        for name, value in (
            ("calibration", self.calibration_std),
            ("lateral calibration", self.lateral_std),
        ):
            MetrologyError.require(
                value is None or 0.0 <= value < 1.0,
                f"{name} must be at least 0 and below 1, got {value}",
            )
        MetrologyError.require(
            0.0 <= self.resolution < 1e-3,
            "resolution, or one count of a scan, must be at least 0 and below 1 mm, got "
            f"{self.resolution * 1e3:g} mm",
        )


@dataclass(frozen=True)
class Measured:
    """A value with its budget.

    Attributes
    ----------
    name : str
        Of the characteristic, such as ``step height``.
    value : float
        m, or rad of an angle.
    components : tuple of Component
        In the unit of the value.
    bound : {"", "at most", "at least"}
        Where the true value is known on one side only: at most, or at least, this value.
    """

    name: str
    value: float
    components: tuple[Component, ...]
    bound: Literal["", "at most", "at least"] = ""

    @property
    def std(self) -> float:
        """Combined standard uncertainty.

        What is unknown adds nothing and is named in `unstated`.
        """
        return math.sqrt(sum(part.std**2 for part in self.components if math.isfinite(part.std)))

    @property
    def unstated(self) -> tuple[str, ...]:
        """Names of components that are unknown or for which a default stands."""
        return tuple(
            part.name
            for part in self.components
            if not math.isfinite(part.std) or part.how.startswith(UNSTATED)
        )

    @property
    def is_decidable(self) -> bool:
        """Whether no component is unknown without which nothing can be proven."""
        return all(math.isfinite(part.std) for part in self.components if part.decisive)

    @property
    def dof(self) -> float:
        """Effective degrees of freedom of all components, by Welch and Satterthwaite."""
        return _find_effective_dof(self.components, self.std)

    def expanded(self, level: float = 0.95) -> float:
        """Half width of the two-sided interval at `level`, in the unit of the value."""
        return self._expand(0.5 + 0.5 * level)

    @property
    def coverage_factor(self) -> float:
        """Half width of the interval at 95 % over the standard uncertainty [1]."""
        return self.expanded() / self.std if self.std > 0.0 else _NORMAL_95

    @property
    def guard(self) -> float:
        """Guard band at 95 % conformance probability (ISO 14253-1), in the unit of the value."""
        return max(GUARD_FACTOR * self.std, self._expand(0.95))

    def _expand(self, share: float) -> float:
        # never less than what was estimated from few values has by itself: degrees of freedom that
        # one more component brings must not narrow the interval
        own = [one for one in self.components if math.isfinite(one.std) and one.is_type_a]
        few = math.sqrt(sum(part.std**2 for part in own))
        # `scipy.stats` says the same, and takes as long to load as all the rest
        single = float(stdtrit(_find_effective_dof(own, few), share)) * few
        return max(
            single,
            min(float(stdtrit(self.dof, share)) * self.std, self._expand_rectangle(share)),
        )

    def _expand_rectangle(self, share: float) -> float:
        # quantile of the sum of the largest rectangle and Student's law of all else (JCGM 101,
        # 7.6; EA-4/02, S9.14, of a rectangle alone), by the mean over the rectangle
        widest = max((part.std for part in self.components if part.bounded), default=0.0)
        if widest == 0.0:
            return math.inf
        rest = math.sqrt(max((self.std / widest) ** 2 - 1.0, _LEAST_REST))
        inside = math.sqrt(3.0) * np.linspace(-1.0, 1.0, 2 * _NODES + 1)[1::2]
        most = 2.0 * (math.sqrt(3.0) + float(stdtrit(self.dof, share)) * rest)
        return widest * float(
            brentq(lambda at: stdtr(self.dof, (at - inside) / rest).mean() - share, 0.0, most)
        )


def _find_effective_dof(components: Iterable[Component], std: float) -> float:
    # Return the degrees of freedom of a sum by Welch and Satterthwaite (JCGM 100, G.2b).
    known = [part for part in components if math.isfinite(part.std) and math.isfinite(part.dof)]
    weight = sum(part.std**4 / part.dof for part in known)
    return std**4 / weight if weight > 0.0 else math.inf


def add_instrument_components(
    name: str,
    value: float,
    own: Sequence[Component],
    instrument: Instrument,
    others: Sequence[Component] = (),
    axes: tuple[float, float] = (1.0, 0.0),
) -> Measured:
    """Add to a value [m] what the instrument leaves open: calibration and resolution."""
    # `axes` says with which power the value goes with the vertical scale, and with the lateral one.
    parts = list(own)
    for label, stated, power in (
        ("calibration", instrument.calibration_std, axes[0]),
        ("lateral calibration", instrument.lateral_std, axes[1]),
    ):
        if power != 0.0:
            relative = power * (UNSTATED_SCALE if stated is None else stated)
            origin = f"{relative:g} of the value"
            unknown = f"{UNSTATED}: {origin}, as makers specify stylus instruments (Haitjema 1998)"
            parts.append(
                Component(label, relative * abs(value), how=unknown if stated is None else origin)
            )
    parts += [
        *others,
        Component(
            "resolution",
            instrument.resolution / math.sqrt(12.0),
            how="one count, rectangular",
            bounded=True,
        ),
    ]
    return Measured(name, value, tuple(parts))


def average_profiles(
    name: str,
    found: Sequence[Estimate],
    instrument: Instrument,
    others: Sequence[Component] = (),
    axes: tuple[float, float] = (1.0, 0.0),
    of: str = "profiles",
) -> Measured:
    """Mean over profiles, or what else `of` says, with its budget; one shows no repeatability."""
    values = np.array([one.value for one in found])
    within = np.array([one.std**2 for one in found])
    MetrologyError.require(
        len(values) and np.isfinite(values).all() and np.isfinite(within).all(),
        f"{name} must come from at least one profile with a finite value, got {len(values)}",
    )
    mean = float(values.mean())
    if len(values) == 1:
        parts = [
            Component(
                "noise", math.sqrt(within[0]), found[0].dof, "autocovariance of the residuals"
            ),
            Component("repeatability", math.nan, how="one profile: not observed"),
        ]
    else:
        parts = _split_scatter(values - mean, float(within.mean()) / len(values), of)
    return add_instrument_components(name, mean, parts, instrument, others, axes)


def _split_scatter(deviations: Array, noise: float, of: str) -> list[Component]:
    # Split the variance of a mean over profiles into their noise, itself a variance, and
    # repeatability.
    # Neighbouring profiles may err together, so of the scatter only its slow part counts: the
    # lowest cosines over the map, whose squares average the variance of the mean with as many
    # degrees of freedom; exact for independent profiles, and little too small for correlated ones
    # (Lazarus, Lewis, Stock and Watson 2018, doi:10.1080/07350015.2018.1506926). Repeatability is
    # what that has beyond the noise; as a difference of two variances it has few degrees of
    # freedom.
    from scipy.fft import dct

    count = len(deviations)
    cosines = min(max(_LEAST_COSINES, round(0.4 * count ** (2.0 / 3.0))), count - 1)
    variance = float(np.mean(dct(deviations, norm="ortho")[1 : cosines + 1] ** 2)) / count
    origin = (
        f"slow part of the scatter of {count} {of}"
        if cosines < count - 1
        else f"scatter of {count} {of}"
    )
    beyond = variance - noise
    if beyond <= 0.0:
        return [
            Component("noise", math.sqrt(variance), float(cosines), origin),
            Component("repeatability", 0.0, how="none beyond noise"),
        ]
    return [
        Component("noise", math.sqrt(noise), how="autocovariance of the residuals"),
        Component(
            "repeatability",
            math.sqrt(beyond),
            cosines * (beyond / variance) ** 2,
            f"{origin}, beyond their noise",
        ),
    ]


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


def decide(
    value: float,
    std: float,
    lower: float = -math.inf,
    upper: float = math.inf,
    dof: float = math.inf,
    guard: float | None = None,
) -> Decision:
    """Judge one measured value; the guard band follows from `std` and `dof` where none is given."""
    # Proof of conformity is impossible where the tolerance is narrower than two guard bands.
    MetrologyError.require(
        math.isfinite(value) and math.isfinite(std) and std >= 0.0,
        f"value and std must be finite and std not negative, got {value:g} and {std:g}",
    )
    MetrologyError.require(lower <= upper, f"limits must be in order, got {lower:g} to {upper:g}")

    if guard is None:
        guard = max(GUARD_FACTOR, float(stdtrit(dof, 0.95))) * std
    if lower + guard <= value <= upper - guard:
        verdict = Outcome.CONFORMS
    elif value < lower - guard or value > upper + guard:
        verdict = Outcome.DOES_NOT_CONFORM
    else:
        verdict = Outcome.NOT_PROVEN
    if std == 0.0:
        probability = 1.0 if lower <= value <= upper else 0.0
    else:  # JCGM 106:2012, 7.2
        above, below = (float(stdtr(dof, (end - value) / std)) for end in (upper, lower))
        probability = above - below
    return Decision(verdict, value, std, lower, upper, guard, probability)


def judge(measured: Measured, nominal: float, lower: float, upper: float) -> Decision:
    """Judge a value by nominal and signed deviations, all in the unit of the value.

    A lower limit at or below zero of what cannot be negative is none. Of a bound only that side is
    proven on which it bounds; of what has no stated uncertainty nothing is.
    """
    low = nominal + lower
    least = low if low > 0.0 or nominal < 0.0 else -math.inf
    found = decide(
        measured.value, measured.std, least, nominal + upper, measured.dof, measured.guard
    )
    above = found.value > found.upper
    idle = {
        "": False,
        "at most": above if found.verdict is Outcome.DOES_NOT_CONFORM else math.isfinite(least),
        "at least": not above,
    }[measured.bound]
    if found.verdict is not Outcome.NOT_PROVEN and (idle or not measured.is_decidable):
        return replace(found, verdict=Outcome.NOT_PROVEN)
    return found


def combine_verdicts(verdicts: Iterable[Outcome | None]) -> Outcome:
    """Return the verdict over all: one failure fails, one unproven leaves the whole unproven."""
    found = set(verdicts)
    return next(
        (worst for worst in (Outcome.DOES_NOT_CONFORM, Outcome.NOT_PROVEN) if worst in found),
        Outcome.CONFORMS,
    )
