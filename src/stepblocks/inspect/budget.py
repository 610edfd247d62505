"""A measured value with its uncertainty budget, and whether it conforms.

JCGM 100:2008: components add in squares (10), degrees of freedom by Welch and Satterthwaite (G.2b),
coverage factor from Student's law. ISO 14253-1: inside the limits by more than the guard band the
part conforms; outside by more than it, it does not; between, neither is proven.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, Estimate
from stepblocks.parts.tolerance import GUARD_FACTOR

# slow cosines that are always taken, where there are as many profiles: Student's factor is then 2.8
# at 95 %
_LEAST_COSINES = 4


@dataclass(frozen=True)
class Component:
    """One source of uncertainty."""

    name: str
    std: float  # standard uncertainty, in the unit of the value; nan where it is not stated
    dof: float = math.inf  # degrees of freedom; infinite for what was not estimated from few values
    how: str = ""  # it was evaluated


@dataclass(frozen=True)
class Instrument:
    """What is known of the instrument besides the scan."""

    calibration_std: float | None = (
        None  # relative, of the vertical scale [1]; None where it is not stated
    )
    resolution: float = 0.0  # least difference of height that it shows [m]
    lateral_std: float | None = (
        None  # relative, of the lateral scale [1]; None where it is not stated
    )

    def __post_init__(self) -> None:
        for name, value in (
            ("calibration", self.calibration_std),
            ("lateral calibration", self.lateral_std),
        ):
            if value is not None and not 0.0 <= value < 1.0:
                raise MetrologyError(f"{name} must be at least 0 and below 1, got {value:g}")
        if not 0.0 <= self.resolution < 1e-3:
            rule = "resolution, or one count of a scan, must be at least 0 and below 1 mm"
            raise MetrologyError(f"{rule}, got {self.resolution * 1e3:g} mm")


@dataclass(frozen=True)
class Measured:
    """A value with its budget."""

    name: str  # of the characteristic, such as ``step height``
    value: float  # m
    components: tuple[Component, ...]

    @property
    def std(self) -> float:
        """Combined standard uncertainty [m]; what is not stated counts as zero and is named in `unstated`."""
        return math.sqrt(sum(part.std**2 for part in self.components if math.isfinite(part.std)))

    @property
    def unstated(self) -> tuple[str, ...]:
        """Names of components that nobody has stated."""
        return tuple(part.name for part in self.components if not math.isfinite(part.std))

    @property
    def dof(self) -> float:
        """Effective degrees of freedom by Welch and Satterthwaite."""
        known = [
            part for part in self.components if math.isfinite(part.std) and math.isfinite(part.dof)
        ]
        weight = sum(part.std**4 / part.dof for part in known)
        return self.std**4 / weight if weight > 0.0 else math.inf

    def expanded(self, level: float = 0.95) -> float:
        """Half width of the two-sided interval at `level` [m]."""
        return student_quantile(0.5 + 0.5 * level, self.dof) * self.std


def student_quantile(share: float, dof: float) -> float:
    """Return the point below which this share of Student's law lies."""
    # `scipy.stats` says the same, and takes as long to load as all the rest
    from scipy.special import stdtrit

    return float(stdtrit(dof, share))


def add_instrument_components(
    name: str,
    value: float,
    own: Sequence[Component],
    instrument: Instrument,
    others: Sequence[Component] = (),
    axes: tuple[float, float] = (1.0, 0.0),
) -> Measured:
    """Add what the instrument owes to a value [m]: calibration, and resolution behind the other components."""
    # `axes` says with which power the value goes with the vertical scale, and with the lateral one.
    parts = list(own)
    scales = (
        ("calibration", instrument.calibration_std),
        ("lateral calibration", instrument.lateral_std),
    )
    for (label, relative), power in zip(scales, axes, strict=True):
        if power != 0.0 and relative is None:
            parts.append(Component(label, math.nan, how="not stated"))
        elif power != 0.0 and relative is not None:
            parts.append(
                Component(
                    label, power * relative * abs(value), how=f"{power * relative:g} of the value"
                )
            )
    resolution = Component(
        "resolution", instrument.resolution / math.sqrt(12.0), how="one count, rectangular"
    )
    return Measured(name, value, (*parts, *others, resolution))


def average_profiles(
    name: str,
    found: Sequence[Estimate],
    instrument: Instrument,
    others: Sequence[Component] = (),
    axes: tuple[float, float] = (1.0, 0.0),
) -> Measured:
    """Mean over profiles with its budget; one profile shows no repeatability."""
    values = np.array([one.value for one in found])
    within = np.array([one.std**2 for one in found])
    if len(values) == 0 or not (np.isfinite(values).all() and np.isfinite(within).all()):
        raise MetrologyError(
            f"{name} must come from at least one profile with a finite value, got {len(values)}"
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
        parts = _split_scatter(values - mean, float(within.mean()) / len(values))
    return add_instrument_components(name, mean, parts, instrument, others, axes)


def _split_scatter(deviations: Array, noise: float) -> list[Component]:
    """Split the variance of a mean over profiles into their noise, itself a variance, and repeatability."""
    # Neighbouring profiles may err together, so of the scatter only its slow part counts: the
    # lowest cosines over the map, whose squares average the variance of the mean with as many
    # degrees of freedom; exact for independent profiles, and little too small for correlated ones
    # (Lazarus, Lewis, Stock and Watson 2018, doi:10.1080/07350015.2018.1506926). Repeatability is
    # what that has beyond the noise; as a difference of two variances it has few degrees of
    # freedom.
    from scipy.fft import dct

    count = len(deviations)
    cosines = min(max(_LEAST_COSINES, round(0.4 * count ** (2.0 / 3.0))), count - 1)
    variance, dof = (
        float(np.mean(dct(deviations, norm="ortho")[1 : cosines + 1] ** 2)) / count,
        float(cosines),
    )
    how = (
        f"slow part of the scatter of {count} profiles"
        if cosines < count - 1
        else f"scatter of {count} profiles"
    )
    beyond = variance - noise
    if beyond <= 0.0:
        none = Component("repeatability", 0.0, how="none beyond noise")
        return [Component("noise", math.sqrt(variance), dof, how), none]
    return [
        Component("noise", math.sqrt(noise), how="autocovariance of the residuals"),
        Component(
            "repeatability",
            math.sqrt(beyond),
            dof * (beyond / variance) ** 2,
            f"{how}, beyond their noise",
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
    """A value judged against its limits."""

    verdict: Outcome
    value: float  # m
    std: float  # standard uncertainty [m]
    lower: float  # limit of the specification [m]; infinite where there is none
    upper: float  # likewise [m]
    guard: float  # guard band [m]
    probability: float  # that the true value lies within the limits, from the measurement alone [1]


def decide(
    value: float,
    std: float,
    lower: float = -math.inf,
    upper: float = math.inf,
    dof: float = math.inf,
) -> Decision:
    """Judge one measured value; with few degrees of freedom the guard band is Student's 95 % point instead of `GUARD_FACTOR`."""
    # Proof of conformity is impossible where the tolerance is narrower than two guard bands.
    if not (math.isfinite(value) and math.isfinite(std) and std >= 0.0):
        raise MetrologyError(
            f"value and std must be finite and std not negative, got {value:g} and {std:g}"
        )
    if not lower <= upper:
        raise MetrologyError(f"limits must be in order, got {lower:g} to {upper:g}")
    from scipy.special import stdtr

    guard = max(GUARD_FACTOR, student_quantile(0.95, dof)) * std
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
    """Judge a value by nominal and deviations [m]; a lower limit at or below zero of what cannot be negative is none."""
    low = nominal + lower
    least = low if low > 0.0 or nominal < 0.0 else -math.inf
    return decide(measured.value, measured.std, least, nominal + upper, measured.dof)


def combine_verdicts(decisions: Iterable[Decision]) -> Outcome:
    """Return the verdict over all characteristics: one failure fails, one unproven leaves the whole unproven."""
    verdicts = {decision.verdict for decision in decisions}
    worst = (Outcome.DOES_NOT_CONFORM, Outcome.NOT_PROVEN)
    return next((verdict for verdict in worst if verdict in verdicts), Outcome.CONFORMS)
