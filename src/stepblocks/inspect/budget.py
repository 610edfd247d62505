"""Uncertainty budgets: named standard uncertainties, combined as the GUM asks.

JCGM 100:2008: components add in squares (10), degrees of freedom by Welch and Satterthwaite (G.2b), coverage factor
from Student's law. A component that nobody has stated is named as not stated; it is not silently zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.inspect.evaluate.noise_uncertainty import NoiseUncertainty


@dataclass(frozen=True)
class Component:
    """One source of uncertainty."""

    name: str  # What it comes from
    std: float  # Standard uncertainty, in the unit of the value; nan where it is not stated
    dof: float = math.inf  # Degrees of freedom; infinite for what was not estimated from few values
    how: str = ""  # How it was evaluated


@dataclass(frozen=True)
class Instrument:
    """What is known of the instrument besides the scan."""

    # Relative standard uncertainty of its vertical calibration [1]; None where it is not stated
    calibration_std: float | None = None
    resolution: float = 0.0  # Least difference of height that it shows [m]
    # Relative standard uncertainty of its lateral calibration [1]; None where it is not stated
    lateral_std: float | None = None


@dataclass(frozen=True)
class Measured:
    """A value with its budget."""

    name: str  # Characteristic, for example ``step height``
    value: float  # Estimate [m]
    components: tuple[Component, ...]  # The budget

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
        weight = sum(
            part.std**4 / part.dof for part in self.components if math.isfinite(part.std) and math.isfinite(part.dof)
        )
        return self.std**4 / weight if weight > 0.0 else math.inf

    def expanded(self, level: float = 0.95) -> float:
        """Half width of the two-sided interval at `level` [m]."""
        from scipy import stats

        quantile = 0.5 + 0.5 * level
        law = stats.norm if math.isinf(self.dof) else stats.t(df=self.dof)
        return float(law.ppf(quantile)) * self.std


def measured_from_profiles(
    name: str,
    values: Sequence[float],
    noise: Sequence[NoiseUncertainty],
    instrument: Instrument,
    others: Sequence[Component] = (),
    axes: tuple[float, float] = (1.0, 0.0),
) -> Measured:
    """Mean over profiles with its budget.

    The scatter of the profiles holds their noise already, so the two together are the scatter over the root of the number
    of profiles, with its degrees of freedom; repeatability is what it has beyond the noise, and as a difference of two
    variances it has few degrees of freedom itself. Neighbouring profiles may err together, so of the scatter only its slow part
    counts: the lowest cosines over the map (four of up to 37 profiles), whose squares average the variance of the mean with as
    many degrees of freedom; exact for independent profiles, and little too small for correlated ones (Lazarus, Lewis, Stock
    and Watson 2018, doi:10.1080/07350015.2018.1506926). One profile shows no repeatability; the component is then not stated.

    Examples
    --------
    >>> quiet = [NoiseUncertainty(0.05e-6, 50.0)] * 2
    >>> result = measured_from_profiles("depth", [10.0e-6, 10.2e-6], quiet, Instrument(1e-3, 1e-9))
    >>> round(result.value * 1e6, 3), round(result.std * 1e6, 3), round(result.dof, 1)
    (10.1, 0.101, 1.0)
    """
    heights = np.asarray(values, dtype=np.float64)
    within = np.array([one.std**2 for one in noise], dtype=np.float64)
    count = len(heights)
    if count == 0 or not (np.isfinite(heights).all() and np.isfinite(within).all()):
        raise MetrologyError(f"{name} must come from at least one profile with a finite value, got {count}")
    mean = float(heights.mean())
    parts = [*_scatter(heights - mean, within, noise), *calibration_of(mean, instrument, axes), *others]
    parts.append(Component("resolution", instrument.resolution / math.sqrt(12.0), how="one count, rectangular"))
    return Measured(name, mean, tuple(parts))


# Slow cosines that are always taken, where there are as many profiles: Student's factor is then 2.8 at 95 %
_LEAST_COSINES = 4


def _scatter(
    deviations: NDArray[np.float64], within: NDArray[np.float64], noise: Sequence[NoiseUncertainty]
) -> list[Component]:
    count = len(deviations)
    average = float(within.mean()) / count
    if count == 1:
        return [
            Component("noise", math.sqrt(average), noise[0].dof, "autocovariance of the residuals"),
            Component("repeatability", math.nan, how="one profile: not observed"),
        ]
    from scipy.fft import dct

    cosines = min(max(_LEAST_COSINES, round(0.4 * count ** (2.0 / 3.0))), count - 1)
    variance, dof = float(np.mean(dct(deviations, norm="ortho")[1 : cosines + 1] ** 2)) / count, float(cosines)
    how = f"slow part of the scatter of {count} profiles" if cosines < count - 1 else f"scatter of {count} profiles"
    if variance <= average:
        return [
            Component("noise", math.sqrt(variance), dof, how),
            Component("repeatability", 0.0, how="none beyond noise"),
        ]
    beyond = variance - average
    return [
        Component("noise", math.sqrt(average), how="autocovariance of the residuals"),
        Component("repeatability", math.sqrt(beyond), dof * (beyond / variance) ** 2, f"{how}, beyond their noise"),
    ]


def calibration_of(value: float, instrument: Instrument, axes: tuple[float, float]) -> list[Component]:
    """List the components of calibration of a value."""
    parts = []
    for name, relative, share in (
        ("calibration", instrument.calibration_std, axes[0]),
        ("lateral calibration", instrument.lateral_std, axes[1]),
    ):
        if share == 0.0:
            continue
        if relative is None:
            parts.append(Component(name, math.nan, how="not stated"))
        else:
            parts.append(Component(name, share * relative * abs(value), how=f"{share * relative:g} of the value"))
    return parts
