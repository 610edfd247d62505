"""Gap and discrepancies of a crown margin, from a profile across it.

Terms of Holmes et al. 1989 (J. Prosthet. Dent. 62:405, doi:10.1016/0022-3913(89)90170-4) for a planar junction: the two
shoulders are fitted as in the two-plane convention of a single edge; the opening lies between the points
where the profile leaves them. Horizontal opening and vertical discrepancy together give the absolute discrepancy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import (
    LEAST_FACE,
    TwoPlanes,
    check_profile,
    despiked,
    fit_two_planes,
    roughly_levelled,
    two_levels,
)
from stepblocks.inspect.noise import Array, NoiseUncertainty


@dataclass(frozen=True)
class Margin:
    """What a profile across a margin says."""

    opening: float  # distance between the two edges along the profile [m]
    opening_noise: NoiseUncertainty  # from the noise where its edges are sampled [m]
    opening_sampling: float  # standard uncertainty since nothing is known between two samples of a wall [m]
    rise: float  # height of the right shoulder over the left [m]
    rise_noise: NoiseUncertainty  # from noise and roughness [m]

    @property
    def absolute(self) -> float:
        """Absolute marginal discrepancy, the hypotenuse of opening and rise [m]."""
        return float(np.hypot(self.opening, self.rise))

    @property
    def absolute_noise(self) -> NoiseUncertainty:
        """Its uncertainty from noise [m]; the degrees of freedom are those of the rise, which carries them."""
        share, slope = self.opening / self.absolute, self.rise / self.absolute
        std = float(np.hypot(share * self.opening_noise.std, slope * self.rise_noise.std))
        return NoiseUncertainty(std, self.rise_noise.dof)


def fit_margin(x: Array, z: Array) -> Margin:
    """Measure opening and rise of a margin from a profile [m], nan where nothing was measured.

    An edge is where the profile has fallen below its own shoulder by half the depth of the gap; missing points count as gap.
    Where two samples jump over a wall, the edge is known to that interval, as a rectangle; on a flank it is interpolated.
    """
    check_profile(x, z, 3 * LEAST_FACE)
    known, level = np.isfinite(z), np.full_like(z, np.nan)
    level[known] = despiked(roughly_levelled(x[known], z[known]))
    begin, end = _gap(level)
    middle = 0.5 * float(x[begin] + x[end - 1])
    planes = _shoulders(x, z, begin, end, middle)
    flat = z - planes.tilt * (x - middle) - planes.offset
    left, right = _edges(x, flat, planes.height, begin, end)
    spacing, roughness = float(np.diff(x).mean()), float(np.std(planes.residuals[planes.used]))
    sampling = spacing * float(np.hypot(left.unresolved, right.unresolved)) / np.sqrt(12.0)
    crossing = [0.0 if np.isnan(one.jump) else roughness * spacing / one.jump for one in (left, right)]
    noise = NoiseUncertainty(float(np.hypot(crossing[0], crossing[1])), planes.noise.dof)
    return Margin(right.position - left.position, noise, sampling, planes.height, planes.noise)


def _gap(level: Array) -> tuple[int, int]:
    """Return the indices of the longest stretch that is missing or far below both shoulders."""
    lower, upper = two_levels(level[np.isfinite(level)])
    quarter = len(level) // 4
    shoulders = min(np.nanmedian(level[:quarter]), np.nanmedian(level[-quarter:]))
    bottom = float(np.nanmin(level))
    limit = shoulders - 0.5 * (shoulders - bottom)
    if not shoulders - bottom > max(abs(upper - lower) * 0.2, 1e-12):
        raise MetrologyError("profile must show a gap below both shoulders, got none")
    inside = ~np.isfinite(level) | (level < limit)
    change = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    stretches = list(zip(change[::2], change[1::2], strict=True))
    begin, end = max(stretches, key=lambda pair: pair[1] - pair[0])
    if begin < LEAST_FACE or len(level) - end < LEAST_FACE:
        raise MetrologyError(f"gap must leave {LEAST_FACE} points of a shoulder on either side")
    return int(begin), int(end)


def _shoulders(x: Array, z: Array, begin: int, end: int, middle: float) -> TwoPlanes:
    margin = max((end - begin) // 2, 3)
    used = np.isfinite(z)
    used[max(begin - margin, 0) : end + margin] = False
    if min(used[:begin].sum(), used[end:].sum()) < LEAST_FACE:
        raise MetrologyError(f"shoulders must keep {LEAST_FACE} points each beside the gap")
    return fit_two_planes(x, z, middle, used)


@dataclass(frozen=True)
class _Wall:
    """Where a wall stands [m], how much of a sampling interval that leaves open [1], and the jump over it [m]."""

    position: float
    unresolved: float
    jump: float


def _edges(x: Array, flat: Array, rise: float, begin: int, end: int) -> tuple[_Wall, _Wall]:
    lower = min(0.0, rise)
    inner = flat[begin:end]
    # the median of the deepest tenth, since the deepest point is mostly noise
    known = np.sort(inner[np.isfinite(inner)])
    depth = float(lower - np.median(known[: max(len(known) // 10, 1)])) if known.size else np.nan
    level = lower - (0.5 * depth if np.isfinite(depth) else 0.0)
    solid = np.isfinite(flat) & (flat > level)
    middle = (begin + end) // 2
    left = int(np.flatnonzero(solid[:middle])[-1])
    right = middle + int(np.flatnonzero(solid[middle:])[0])
    return _wall(x, flat, level, depth, left), _wall(x, flat, level, depth, right - 1)


def _wall(x: Array, flat: Array, level: float, depth: float, low: int) -> _Wall:
    """Locate a wall between two samples: a jump of the whole depth leaves the interval open, a flank is interpolated."""
    (begin, end), (a, b) = x[low : low + 2], flat[low : low + 2]
    middle, jump = float(0.5 * (begin + end)), float(abs(b - a))
    if not np.isfinite(jump / depth) or jump == 0.0:
        return _Wall(middle, 1.0, float("nan"))
    unresolved = float(np.clip(2.0 * jump / depth - 1.0, 0.0, 1.0))
    crossing = float(begin + (level - a) / (b - a) * (end - begin))
    return _Wall(unresolved * middle + (1.0 - unresolved) * crossing, unresolved, jump)
