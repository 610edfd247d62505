"""Gap and discrepancies of a crown margin, from a profile across it.

Terms of Holmes et al. 1989 (J. Prosthet. Dent. 62:405, doi:10.1016/0022-3913(89)90170-4) for a
planar junction: the opening lies between the points where the profile leaves the two shoulders;
with the rise it makes the absolute discrepancy.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import (
    LEAST_FACE,
    filter_by_running_median,
    fit_two_planes,
    refuse_unusable_profile,
)
from stepblocks.inspect.noise import Array, Estimate, Mask
from stepblocks.inspect.waviness import estimate_height_beside_waves

_LEAST_MARGIN = 3  # points beside a gap that belong to no shoulder
_LEAST_DEPTH_OVER_RISE = 0.2  # of a gap below the lower shoulder, over the rise between them [1]
_LEAST_DEPTH = 1e-12  # of a gap, below which lies rounding [m]


@dataclass(frozen=True)
class Margin:
    """What a profile across a margin says."""

    # distance between the two edges along the profile, by the noise where they are sampled [m]
    opening: Estimate
    # standard uncertainty of it since nothing is known between two samples of a wall [m]
    sampling: float
    rise: Estimate  # height of the right shoulder over the left [m]
    slope: float  # of both shoulders [1]
    depth: float  # of the gap below the lower shoulder, as far as it was measured [m]

    @property
    def absolute_discrepancy(self) -> Estimate:
        """Absolute marginal discrepancy, the hypotenuse [m].

        The degrees of freedom are those of the rise, which carries them.
        """
        size = float(np.hypot(self.opening.value, self.rise.value))
        from_opening = self.opening.value / size * self.opening.std
        from_rise = self.rise.value / size * self.rise.std
        return Estimate(size, float(np.hypot(from_opening, from_rise)), self.rise.dof)


@dataclass(frozen=True)
class _Gap:
    """Where a profile shows a gap: from index `begin` to before `end`."""

    begin: int
    end: int

    @property
    def point_count(self) -> int:
        """Number of points."""
        return self.end - self.begin


@dataclass(frozen=True)
class _Walls:
    """The walls of a gap, and how deep it was measured."""

    left: "_Wall"
    right: "_Wall"
    depth: float  # below the lower shoulder; nan where nothing was measured [m]


@dataclass(frozen=True)
class _Wall:
    """Where a profile leaves a shoulder."""

    position: float  # m
    unresolved: float  # how much of a sampling interval it leaves open [1]
    jump: float  # over the interval [m]; nan where one side of it was not measured


def fit_margin(x: Array, z: Array) -> Margin:
    """Measure opening and rise of a margin from a profile [m], nan where nothing was measured.

    An edge is where the profile has fallen below its own shoulder by half the depth of the gap;
    missing points count as gap. Where two samples jump over a wall, the edge is known to that
    interval, as a rectangle; on a flank it is interpolated.

    Raises
    ------
    MetrologyError
        If the profile shows no gap between two shoulders of twenty points.
    """
    refuse_unusable_profile(x, z, 3 * LEAST_FACE)
    gap = _find_gap(x, z)
    shoulders = _mark_shoulders(z, gap)
    middle = 0.5 * float(x[gap.begin] + x[gap.end - 1])
    planes = fit_two_planes(x, z, middle, shoulders)
    level = z - planes.tilt * x - planes.offset
    walls = _find_walls(x, level, planes.height.value, gap)
    left, right = walls.left, walls.right
    spacing = float(np.diff(x).mean())
    roughness = float(np.std(planes.fit.residuals[planes.fit.used]))
    noise = np.hypot(
        _compute_wall_position_noise(left, roughness, spacing),
        _compute_wall_position_noise(right, roughness, spacing),
    )
    return Margin(
        opening=Estimate(right.position - left.position, float(noise), planes.height.dof),
        sampling=spacing * float(np.hypot(left.unresolved, right.unresolved)) / np.sqrt(12.0),
        rise=estimate_height_beside_waves(x, z, middle, planes),
        slope=planes.tilt,
        depth=float(np.nan_to_num(walls.depth)),
    )


def _mark_shoulders(z: Array, gap: _Gap) -> Mask:
    """Return the points of both shoulders, without those close to the gap."""
    margin = max(gap.point_count // 2, _LEAST_MARGIN)
    shoulders = np.isfinite(z)
    shoulders[max(gap.begin - margin, 0) : gap.end + margin] = False
    if min(shoulders[: gap.begin].sum(), shoulders[gap.end :].sum()) < LEAST_FACE:
        raise MetrologyError(f"shoulders must keep {LEAST_FACE} points each beside the gap")
    return shoulders


def _find_gap(x: Array, z: Array) -> _Gap:
    """Return the longest stretch that is missing or far below both shoulders.

    Only to find it the profile is levelled by the median of its slopes, which does not see a gap of
    less than half of it.
    """
    known = np.isfinite(z)
    x_known = x[known]
    z_known = z[known]
    lag = max(len(z_known) // 50, 1)
    slopes = (z_known[lag:] - z_known[:-lag]) / (x_known[lag:] - x_known[:-lag])
    level = filter_by_running_median(z - float(np.median(slopes)) * x)
    quarter = len(z) // 4
    left = float(np.nanmedian(level[:quarter]))
    right = float(np.nanmedian(level[-quarter:]))
    lower = min(left, right)
    depth = lower - np.nanmin(level)
    if not depth > max(_LEAST_DEPTH_OVER_RISE * abs(right - left), _LEAST_DEPTH):
        raise MetrologyError("profile must show a gap below both shoulders, got none")
    gap = _find_longest_run(~known | (level < lower - 0.5 * depth))
    if gap.begin < LEAST_FACE or len(level) - gap.end < LEAST_FACE:
        raise MetrologyError(f"gap must leave {LEAST_FACE} points of a shoulder on either side")
    return gap


def _find_longest_run(inside: Mask) -> _Gap:
    """Return the longest run of true values, the first of several."""
    padded = np.concatenate([[0], inside.astype(np.int8), [0]])
    changes = np.flatnonzero(np.diff(padded)).tolist()
    runs = []
    for begin, end in zip(changes[::2], changes[1::2], strict=True):
        runs.append(_Gap(begin, end))
    return max(runs, key=lambda run: run.point_count)


def _find_walls(x: Array, level: Array, rise: float, gap: _Gap) -> _Walls:
    """Find the left and the right wall of a gap.

    `level` are heights over the left shoulder, `rise` is the height of the right one [m].
    """
    lower = min(0.0, rise)
    inner = level[gap.begin : gap.end]
    # the median of the deepest tenth, since the deepest point is mostly noise
    known = np.sort(inner[np.isfinite(inner)])
    depth = np.nan
    half_depth = 0.0
    if known.size:
        depth = float(lower - np.median(known[: max(len(known) // 10, 1)]))
        half_depth = 0.5 * depth
    threshold = lower - half_depth
    solid = np.isfinite(level) & (level > threshold)
    middle = (gap.begin + gap.end) // 2
    last_before = int(np.flatnonzero(solid[:middle])[-1])
    first_behind = middle + int(np.flatnonzero(solid[middle:])[0])
    left = slice(last_before, last_before + 2)
    right = slice(first_behind - 1, first_behind + 1)
    return _Walls(
        _locate_wall_between_samples(x[left], level[left], threshold, depth),
        _locate_wall_between_samples(x[right], level[right], threshold, depth),
        depth,
    )


def _locate_wall_between_samples(
    x: Array, level: Array, threshold: float, gap_depth: float
) -> _Wall:
    """Locate a wall between two samples [m].

    A jump of the whole depth leaves the interval open, a flank is interpolated.
    """
    jump = float(abs(level[1] - level[0]))
    middle = float(x.mean())
    if not np.isfinite(jump / gap_depth) or jump == 0.0:
        return _Wall(middle, 1.0, float("nan"))
    unresolved = float(np.clip(2.0 * jump / gap_depth - 1.0, 0.0, 1.0))
    crossing = float(x[0] + (threshold - level[0]) / (level[1] - level[0]) * (x[1] - x[0]))
    position = unresolved * middle + (1.0 - unresolved) * crossing
    return _Wall(position, unresolved, jump)


def _compute_wall_position_noise(wall: _Wall, roughness: float, spacing: float) -> float:
    """Return what noise leaves open of the place of a wall [m]."""
    if np.isnan(wall.jump):
        return 0.0
    return roughness * spacing / wall.jump
