"""Uncertainty budgets: named standard uncertainties, combined as the GUM asks.

JCGM 100:2008: components add in squares (10), degrees of freedom by Welch and Satterthwaite (G.2b), coverage factor
from Student's law. A component that nobody has stated is named as not stated; it is not silently zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError

__all__ = ["Component", "Instrument", "Measured", "measured_from_profiles"]


@dataclass(frozen=True)
class Component:
    """One source of uncertainty.

    Attributes
    ----------
    name : str
        What it comes from.
    std : float
        Standard uncertainty, in the unit of the value; nan where it is not stated.
    dof : float
        Degrees of freedom; infinite for what was not estimated from few values.
    how : str
        How it was evaluated.
    """

    name: str
    std: float
    dof: float = math.inf
    how: str = ""


@dataclass(frozen=True)
class Instrument:
    """What is known of the instrument besides the scan.

    Attributes
    ----------
    calibration_std : float or None
        Relative standard uncertainty of its vertical calibration [1]; None where it is not stated.
    resolution : float
        Least difference of height that it shows [m].
    """

    calibration_std: float | None = None
    resolution: float = 0.0


@dataclass(frozen=True)
class Measured:
    """A value with its budget.

    Attributes
    ----------
    name : str
        Characteristic, for example ``step height``.
    value : float
        Estimate [m].
    components : tuple of Component
        The budget.
    """

    name: str
    value: float
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
    name: str, values: Sequence[float], stds: Sequence[float], instrument: Instrument, form: float = 0.0
) -> Measured:
    """Mean over profiles with its budget.

    Parameters
    ----------
    name : str
        Characteristic.
    values, stds : sequence of float
        Value and standard uncertainty from noise of each profile [m].
    instrument : Instrument
        Calibration and resolution.
    form : float
        Standard uncertainty since the faces are not planes [m].

    Returns
    -------
    Measured
        Mean and components noise, repeatability, calibration, form, resolution.

    Raises
    ------
    MetrologyError
        If there is no profile or a value is not finite.

    Notes
    -----
    The scatter over profiles holds their noise already, so repeatability is what the scatter has beyond it. One profile
    shows no repeatability; the component is then not stated.

    Examples
    --------
    >>> result = measured_from_profiles("depth", [10.0e-6, 10.2e-6], [0.05e-6, 0.05e-6], Instrument(1e-3, 1e-9))
    >>> round(result.value * 1e6, 3), round(result.std * 1e6, 3)
    (10.1, 0.101)
    """
    heights, noise = np.asarray(values, dtype=np.float64), np.asarray(stds, dtype=np.float64)
    count = len(heights)
    if count == 0 or not (np.isfinite(heights).all() and np.isfinite(noise).all()):
        raise MetrologyError(f"{name} must come from at least one profile with a finite value, got {count}")
    mean = float(heights.mean())
    within = float(np.mean(noise**2))
    parts = [Component("noise", math.sqrt(within / count), how="autocovariance of the residuals")]
    if count > 1:
        beyond = max(float(heights.var(ddof=1)) - within, 0.0)
        parts.append(Component("repeatability", math.sqrt(beyond / count), count - 1, f"scatter of {count} profiles"))
    else:
        parts.append(Component("repeatability", math.nan, how="one profile: not observed"))
    calibration = instrument.calibration_std
    parts.append(
        Component("calibration", math.nan, how="not stated")
        if calibration is None
        else Component("calibration", calibration * abs(mean), how=f"{calibration:g} of the value")
    )
    parts.append(Component("form", form, how="change with the exclusion, rectangular"))
    parts.append(Component("resolution", instrument.resolution / math.sqrt(12.0), how="one count, rectangular"))
    return Measured(name, mean, tuple(parts))
