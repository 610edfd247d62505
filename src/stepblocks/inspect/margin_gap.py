"""Gap and discrepancies of a crown margin, from a profile across it.

Terms of Holmes et al. 1989 (J. Prosthet. Dent. 62:405, doi:10.1016/0022-3913(89)90170-4) for a
planar junction: the opening lies between the points where the profile leaves the two shoulders;
with the rise it makes the absolute discrepancy.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import LEAST_FACE, check_profile, fit_two_planes, remove_spikes
from stepblocks.inspect.noise import Array, Estimate


@dataclass(frozen=True)
class Margin:
    """What a profile across a margin says."""

    # distance between the two edges along the profile, by the noise where they are sampled [m]
    opening: Estimate
    sampling: (
        float  # standard uncertainty of it since nothing is known between two samples of a wall [m]
    )
    rise: Estimate  # height of the right shoulder over the left [m]

    @property
    def absolute(self) -> Estimate:
        """Absolute marginal discrepancy, the hypotenuse [m].

        The degrees of freedom are those of the rise, which carries them.
        """
        size = float(np.hypot(self.opening.value, self.rise.value))
        share, slope = self.opening.value / size, self.rise.value / size
        return Estimate(
            size, float(np.hypot(share * self.opening.std, slope * self.rise.std)), self.rise.dof
        )


def fit_margin(x: Array, z: Array) -> Margin:
    """Measure opening and rise of a margin from a profile [m], nan where nothing was measured."""
    # An edge is where the profile has fallen below its own shoulder by half the depth of the gap;
    # missing points count as gap. Where two samples jump over a wall, the edge is known to that
    # interval, as a rectangle; on a flank it is interpolated.
    check_profile(x, z, 3 * LEAST_FACE)
    begin, end = _find_gap(x, z)
    margin = max((end - begin) // 2, 3)
    used = np.isfinite(z)
    used[max(begin - margin, 0) : end + margin] = False
    MetrologyError.require(
        min(used[:begin].sum(), used[end:].sum()) >= LEAST_FACE,
        f"shoulders must keep {LEAST_FACE} points each beside the gap",
    )
    planes = fit_two_planes(x, z, 0.5 * float(x[begin] + x[end - 1]), used)
    left, right = _find_walls(
        x, z - planes.tilt * x - planes.offset, planes.height.value, begin, end
    )
    spacing, roughness = (
        float(np.diff(x).mean()),
        float(np.std(planes.fit.residuals[planes.fit.used])),
    )
    sampling = spacing * float(np.hypot(left.unresolved, right.unresolved)) / np.sqrt(12.0)
    crossing = [
        0.0 if np.isnan(one.jump) else roughness * spacing / one.jump for one in (left, right)
    ]
    return Margin(
        Estimate(
            right.position - left.position,
            float(np.hypot(crossing[0], crossing[1])),
            planes.height.dof,
        ),
        sampling,
        planes.height,
    )


def _find_gap(x: Array, z: Array) -> tuple[int, int]:
    # Return the indices of the longest stretch that is missing or far below both shoulders.
    # Only to find it the profile is levelled by the median of its slopes, which does not see a gap
    # of less than half of it.
    known = np.isfinite(z)
    quarter = len(z) // 4
    u, w = x[known], z[known]
    lag = max(len(w) // 50, 1)
    level = remove_spikes(z - float(np.median((w[lag:] - w[:-lag]) / (u[lag:] - u[:-lag]))) * x)
    shoulders = [float(np.nanmedian(part)) for part in (level[:quarter], level[-quarter:])]
    depth = min(shoulders) - np.nanmin(level)
    MetrologyError.require(
        depth > max(0.2 * abs(shoulders[1] - shoulders[0]), 1e-12),
        "profile must show a gap below both shoulders, got none",
    )
    inside = ~known | (level < min(shoulders) - 0.5 * depth)
    change = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    begin, end = max(
        zip(change[::2], change[1::2], strict=True), key=lambda pair: pair[1] - pair[0]
    )
    MetrologyError.require(
        begin >= LEAST_FACE and len(level) - end >= LEAST_FACE,
        f"gap must leave {LEAST_FACE} points of a shoulder on either side",
    )
    return int(begin), int(end)


class _Wall(NamedTuple):
    position: float  # m
    unresolved: float  # how much of a sampling interval it leaves open [1]
    jump: float  # over it [m]


def _find_walls(x: Array, flat: Array, rise: float, begin: int, end: int) -> list[_Wall]:
    lower = min(0.0, rise)
    inner = flat[begin:end]
    # the median of the deepest tenth, since the deepest point is mostly noise
    known = np.sort(inner[np.isfinite(inner)])
    depth = float(lower - np.median(known[: max(len(known) // 10, 1)])) if known.size else np.nan
    level = lower - (0.5 * depth if np.isfinite(depth) else 0.0)
    solid = np.isfinite(flat) & (flat > level)
    middle = (begin + end) // 2
    left, right = (
        int(np.flatnonzero(solid[:middle])[-1]),
        middle + int(np.flatnonzero(solid[middle:])[0]),
    )
    return [
        _locate_wall(x[low : low + 2], flat[low : low + 2], level, depth)
        for low in (left, right - 1)
    ]


def _locate_wall(x: Array, flat: Array, level: float, depth: float) -> _Wall:
    # Locate a wall between two samples: a jump of the whole depth leaves the interval open, a flank
    # is interpolated.
    jump = float(abs(flat[1] - flat[0]))
    if not np.isfinite(jump / depth) or jump == 0.0:
        return _Wall(float(x.mean()), 1.0, float("nan"))
    unresolved = float(np.clip(2.0 * jump / depth - 1.0, 0.0, 1.0))
    crossing = float(x[0] + (level - flat[0]) / (flat[1] - flat[0]) * (x[1] - x[0]))
    return _Wall(unresolved * float(x.mean()) + (1.0 - unresolved) * crossing, unresolved, jump)
