"""Capability of a process from many parts: Pp, Ppk, Cp, Cpk, and a chart of individuals.

The overall scatter of the parts (P) is what a customer gets. The scatter from part to part (C) is
what the process does when nothing drifts; the mean moving range tells it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stepblocks.inspect.noise import Array

FEWEST_PARTS = 5  # of which an index is stated
_D2 = 1.128379  # mean range of two normal values, in standard deviations (2 / sqrt(pi))
_D4 = 3.267  # upper limit of a chart of moving ranges, in mean ranges (ISO 7870-2, table 2)
_FREEDOM_OF_RANGES = 0.62  # of moving ranges, for each part after the first (Palm and Wheeler)
_LEVEL = 0.95  # of the intervals


class Index(NamedTuple):
    """An index of capability with its 95 % interval [1]; nan where it does not exist."""

    value: float
    low: float
    high: float


_NO_INDEX = Index(math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Capability:
    """What parts tell of the process that made them.

    Attributes
    ----------
    count : int
        Parts.
    mean : float
        Of the parts, in the unit of the characteristic.
    std_overall, std_within : float
        Standard deviation of all parts, and that from part to part.
    pp, ppk : Index
        Of the overall scatter, without and with the place of the mean.
    cp, cpk : Index
        Of the scatter from part to part, likewise.
    """

    count: int
    mean: float
    std_overall: float
    std_within: float
    pp: Index
    ppk: Index
    cp: Index
    cpk: Index


@dataclass(frozen=True)
class ControlChart:
    """A chart of individuals with its moving ranges (ISO 7870-2).

    Attributes
    ----------
    values : ndarray, shape (n,)
        Of the parts in the order in which they were made.
    centre, lower, upper : float
        Mean, and the limits three standard deviations from it.
    ranges : ndarray, shape (n - 1,)
        Between parts that follow each other.
    range_upper : float
        Limit of a range.
    """

    values: Array
    centre: float
    lower: float
    upper: float
    ranges: Array
    range_upper: float

    def find_parts_outside_limits(self) -> list[int]:
        """Find the parts that lie outside the limits, by their places."""
        is_outside = (self.values < self.lower) | (self.values > self.upper)
        places: list[int] = np.flatnonzero(is_outside).tolist()
        return places


def compute_capability(values: Array, lower: float, upper: float) -> Capability:
    """Compute the indices of capability of independent parts.

    Parameters
    ----------
    values : ndarray, shape (n,)
        One for each part, in the order in which they were made.
    lower, upper : float
        Limits of the characteristic; infinite where there is none.

    Returns
    -------
    Capability
        Without indices where the parts do not scatter: they are copies of one measurement.

    References
    ----------
    ISO 22514-2:2017; intervals by the chi-squared distribution and by Bissell (1990), as in the
    NIST/SEMATECH e-Handbook, 6.1.6.
    """
    count = len(values)
    mean = float(np.mean(values))
    overall = float(np.std(values, ddof=1))
    within = estimate_std_within(values)
    freedom_within = _FREEDOM_OF_RANGES * (count - 1)
    to_nearer_limit = min(upper - mean, mean - lower)
    return Capability(
        count=count,
        mean=mean,
        std_overall=overall,
        std_within=within,
        pp=_compute_spread_index(upper - lower, 6.0 * overall, count - 1.0),
        ppk=_compute_centred_index(to_nearer_limit, overall, count, count - 1.0),
        cp=_compute_spread_index(upper - lower, 6.0 * within, freedom_within),
        cpk=_compute_centred_index(to_nearer_limit, within, count, freedom_within),
    )


def estimate_std_within(values: Array) -> float:
    """Estimate the standard deviation from part to part by the mean moving range."""
    return float(np.mean(np.abs(np.diff(values)))) / _D2


def _compute_spread_index(limit_width: float, spread: float, dof: float) -> Index:
    """Compute Pp or Cp: the width of the limits in spreads, with its chi-squared interval."""
    from scipy import stats

    if not (math.isfinite(limit_width) and spread > 0.0):
        return _NO_INDEX
    value = limit_width / spread
    tail = 0.5 * (1.0 - _LEVEL)
    low = math.sqrt(stats.chi2.ppf(tail, dof) / dof)
    high = math.sqrt(stats.chi2.ppf(1.0 - tail, dof) / dof)
    return Index(value, value * low, value * high)


def _compute_centred_index(distance_to_limit: float, std: float, count: int, dof: float) -> Index:
    """Compute Ppk or Cpk: the distance of the mean to the nearer limit, with Bissell's interval."""
    from scipy import stats

    if not (math.isfinite(distance_to_limit) and std > 0.0):
        return _NO_INDEX
    value = distance_to_limit / (3.0 * std)
    coverage = float(stats.norm.ppf(0.5 + 0.5 * _LEVEL))
    half = coverage * math.sqrt(1.0 / (9.0 * count) + value**2 / (2.0 * dof))
    return Index(value, value - half, value + half)


def make_individuals_chart(values: Array) -> ControlChart:
    """Chart parts in the order in which they were made.

    Parameters
    ----------
    values : ndarray, shape (n,)
        At least two.

    Returns
    -------
    ControlChart
        With limits by the mean moving range.

    References
    ----------
    ISO 7870-2:2023, chart of individuals and moving ranges.
    """
    ranges = np.abs(np.diff(values))
    centre = float(np.mean(values))
    reach = 3.0 * estimate_std_within(values)
    return ControlChart(
        values=np.asarray(values, dtype=float),
        centre=centre,
        lower=centre - reach,
        upper=centre + reach,
        ranges=ranges,
        range_upper=_D4 * float(np.mean(ranges)),
    )


def find_repeated_digests(digests: Sequence[str]) -> set[int]:
    """Find the parts whose scans are those of an earlier part, by their places.

    Parameters
    ----------
    digests : sequence of str
        Hash of what was read of each part; empty where nothing was hashed.
    """
    copies = set()
    seen = set[str]()
    for place, digest in enumerate(digests):
        if digest and digest in seen:
            copies.add(place)
        seen.add(digest)
    return copies
