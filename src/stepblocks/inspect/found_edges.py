"""Find the edges of a profile.

An edge is where two windows side by side differ by far more than such windows do elsewhere: the
noise, the roughness and the bow of the surface itself are the yardstick.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import (
    LEAST_FACE,
    filter_by_running_median,
    refuse_unusable_profile,
)
from stepblocks.inspect.noise import LEAST_SCATTER, Array, Mask, estimate_robust_scale

_STAND_OUT = 7.0  # difference of two windows over the usual one, from which it is an edge [1]
_ALIKE = 0.3  # of the largest edge, from which another counts [1]
_PLATEAU = 0.8  # of the lesser of two edges, below which the difference must fall between them [1]
_MOST_EDGES = 400
_SHORTEST_WINDOW = 4  # points
_LONGER = 1.5  # of each length of windows over the one before [1]
_BY_FAR = 1.05  # of what longer windows must show more than shorter ones to be the best [1]
_LEAST_KNOWN = 0.6  # of the points of a window that must be measured [1]
_GOES_ON = 0.5  # of the lesser of two edges, which the surface between them rises if they are one
# height over a face, in robust deviations of it and as a part of the edge, from which a point is
# on the flank
_OFF_FACE_NOISE = 6.0
_OFF_FACE_HEIGHT = 0.02
_LEAST_LINE = 4  # points of a face through which a line is laid
_LEAST_SLOPE = 10  # points of a face beyond which its line may slope


@dataclass(frozen=True)
class FoundEdge:
    """One edge of a profile."""

    position: float  # where half of its height is crossed [m]
    rise: float  # height behind it less height before it [m]
    begin: float  # where its flank leaves the face before it [m]
    end: float  # where its flank reaches the face behind it [m]
    unseen: float  # half of what was not measured there [m]


@dataclass(frozen=True)
class _Profile:
    """A profile without its spikes; arrays of shape (n,)."""

    x: Array  # m
    z: Array  # m
    known: Mask  # points that were measured


@dataclass(frozen=True)
class _WindowDifferences:
    """How windows of one length differ between all points of a profile."""

    reach: int  # points of a window
    # shape (n - 1,), where they stand out, else 0 [m]; nan where too little was measured
    differences: Array
    contrast: float  # the largest difference over the usual one [1]


@dataclass(frozen=True)
class _FaceLine:
    """A line through a face."""

    line: np.polynomial.Polynomial
    scatter: float  # robust standard deviation of the points about it [m]


def find_edges(x: Array, z: Array) -> list[FoundEdge]:
    """Find the edges of a profile in equal steps [m].

    Raises
    ------
    MetrologyError
        If no difference of two windows stands out, or too few points are known to tell.
    """
    refuse_unusable_profile(x, z, 2 * LEAST_FACE)
    profile = _Profile(x, filter_by_running_median(z), np.isfinite(z))
    nothing_found = MetrologyError(
        f"profile must show a step above its noise, one that stands out {_STAND_OUT:g} times "
        "over what is usual, got none"
    )
    windows = _find_outstanding_differences(profile)
    best = _choose_best_window_index(windows)
    if best is None:
        _refuse_sparse_points(profile)
        raise nothing_found
    differences = _merge_window_differences(windows, best)
    places = _find_peak_indices(differences, windows[best].reach)
    places, differences = _join_split_edges(profile, places[:_MOST_EDGES], differences)
    edges = _build_edges_with_flanks(profile, places, differences)
    if not edges:
        raise nothing_found
    return edges


def _refuse_sparse_points(profile: _Profile) -> None:
    """Refuse a profile of which too little was measured to tell whether it has an edge."""
    share = float(np.mean(profile.known))
    if share < _LEAST_KNOWN:
        raise MetrologyError(
            f"a profile must be measured at {_LEAST_KNOWN:.0%} of its points or more, got "
            f"{share:.0%}; leave out the rows without a height"
        )


def _find_outstanding_differences(profile: _Profile) -> list[_WindowDifferences]:
    """Find where windows of growing lengths differ by more than is usual.

    Their lengths grow as far as three fit into a quarter of the profile.
    """
    windows = []
    reach = _SHORTEST_WINDOW
    while 3 * reach <= len(profile.x) // 4:
        differences = _compute_window_differences(profile.z, profile.known, reach)
        measured = differences[np.isfinite(differences)]
        usual = np.inf
        if measured.size:
            usual = max(estimate_robust_scale(measured), LEAST_SCATTER)
        contrast = float(np.nanmax(np.abs(differences), initial=0.0)) / usual
        is_usual = np.abs(differences) < _STAND_OUT * usual
        outstanding = np.where(is_usual, 0.0, differences)
        windows.append(_WindowDifferences(reach, outstanding, contrast))
        reach = int(np.ceil(_LONGER * reach))
    return windows


def _choose_best_window_index(windows: list[_WindowDifferences]) -> int | None:
    """Return the index of the shortest windows of about the highest contrast.

    None where no difference stands out.
    """
    best = None
    highest = _STAND_OUT
    for index, window in enumerate(windows):
        if window.contrast > _BY_FAR * highest:
            best = index
            highest = window.contrast
    return best


def _merge_window_differences(windows: list[_WindowDifferences], best_index: int) -> Array:
    """Add to the differences of the best windows what only others show, shape (n - 1,) [m]."""
    differences = windows[best_index].differences
    # what is too narrow for the best windows, or too near to where nothing was measured
    for shorter in windows[:best_index]:
        is_larger = np.abs(shorter.differences) > np.nan_to_num(np.abs(differences))
        differences = np.where(is_larger, shorter.differences, differences)
    # what missing points hide from them
    for longer in windows[best_index + 1 :]:
        differences = np.where(np.isfinite(differences), differences, longer.differences)
    return differences


def _find_peak_indices(differences: Array, window_length: int) -> list[int]:
    """Return where differences are the largest around, in ascending order.

    `window_length` is the length of the best windows.
    """
    seen = np.nan_to_num(differences)
    largest_around = maximum_filter1d(np.abs(seen), 2 * window_length + 1)
    # so that the other edge of a groove is no lesser one
    least = np.maximum(_ALIKE * largest_around.max(), _PLATEAU * largest_around)
    places: set[int] = set()
    for size in (np.maximum(seen, 0.0), np.maximum(-seen, 0.0)):
        is_peak = (size >= least) & (size == maximum_filter1d(size, 2 * window_length + 1))
        peaks = np.flatnonzero(is_peak)
        is_first_around = np.diff(peaks, prepend=-window_length) > window_length
        for peak in peaks[is_first_around]:
            places.add(_find_plateau_middle(size, peak, window_length))
    return sorted(places)


def _find_plateau_middle(edge_sizes: Array, peak: int, window_length: int) -> int:
    """Return the middle of what is as high as a peak: windows with a gap see an edge all over it.

    A plateau of more than two windows is none, and the peak itself is its place.
    """
    is_lower = np.concatenate([[True], edge_sizes < _PLATEAU * edge_sizes[peak], [True]])
    ends = np.flatnonzero(is_lower) - 1
    behind = int(np.searchsorted(ends, peak))
    first = ends[behind - 1]
    last = ends[behind]
    if last - first > 2 * window_length:
        return peak
    return int(first + last) // 2


def _compute_window_differences(z: Array, known: Mask, window_length: int) -> Array:
    """Return by how much the means of two windows beside a gap differ, shape (n - 1,) [m].

    What is usual around is taken off: the slope and bow of the surface. Nan where too little of a
    window was measured.
    """
    places = np.arange(1, len(z))
    sums = _RunningSums(z, known)
    before = sums.average_windows(places - window_length // 2 - window_length, window_length)
    behind = sums.average_windows(places + window_length // 2, window_length)
    is_known = np.minimum(before.counts, behind.counts) >= _LEAST_KNOWN * window_length
    differences = np.where(is_known, behind.means - before.means, np.nan)
    if not is_known.any():
        return differences
    filled = np.interp(places, places[is_known], differences[is_known])
    lean = _estimate_linear_trend(filled, places)
    around = median_filter(filled - lean, min(9 * window_length, len(differences)), mode="nearest")
    return np.asarray(differences - lean - around)


def _estimate_linear_trend(differences: Array, places: NDArray[np.intp]) -> Array:
    """Return the line by which a bow makes differences lean, shape (n - 1,) [m].

    The median of them would lose hold of it at either end. It is zero where it leaves more scatter.
    """
    lag = len(differences) // 2
    slope = float(np.median(differences[lag:] - differences[:-lag])) / lag
    upright = 0.0 * places
    leaning = slope * places
    if estimate_robust_scale(differences - leaning) < estimate_robust_scale(differences - upright):
        return np.asarray(leaning)
    return np.asarray(upright)


@dataclass(frozen=True)
class _WindowMeans:
    """Means of windows of a profile, arrays of one shape."""

    counts: Array  # points that were measured
    means: Array  # m; 0 where there are none


class _RunningSums:
    """Sums over the measured points of a profile, of which means of windows follow."""

    def __init__(self, z: Array, known: Mask) -> None:
        filled = np.where(known, z, 0.0)
        self._count = np.concatenate([[0.0], np.cumsum(known.astype(float))])
        self._total = np.concatenate([[0.0], np.cumsum(filled)])

    def average_windows(self, window_starts: NDArray[np.intp], window_length: int) -> _WindowMeans:
        """Return the means of windows of `window_length` points, cut off where the profile ends."""
        points = len(self._count) - 1
        first = np.clip(window_starts, 0, points).astype(int)
        last = np.clip(window_starts + window_length, 0, points).astype(int)
        counts = self._count[last] - self._count[first]
        totals = self._total[last] - self._total[first]
        return _WindowMeans(counts, totals / np.maximum(counts, 1.0))


def _join_split_edges(
    profile: _Profile, edge_indices: list[int], differences: Array
) -> tuple[list[int], Array]:
    """Join neighbouring edges of one sign that are one; return places and differences [m].

    The difference of joined edges, in their middle, is the sum of theirs.
    """
    ends = [0, *edge_indices, len(profile.x) - 1]
    for index, (first, second) in enumerate(itertools.pairwise(edge_indices)):
        if differences[first] * differences[second] < 0.0:
            continue
        outer = slice(ends[index], ends[index + 3])
        if not _are_one_edge(profile, differences, first, second, outer):
            continue
        middle = (first + second) // 2
        joined_places = [*edge_indices[:index], middle, *edge_indices[index + 2 :]]
        joined = differences.copy()
        joined[middle] = differences[first] + differences[second]
        return _join_split_edges(profile, joined_places, joined)
    return edge_indices, differences


def _are_one_edge(
    profile: _Profile, differences: Array, first_index: int, second_index: int, surroundings: slice
) -> bool:
    """Tell whether two edges of one sign are one.

    They are where the difference does not fall between them, as about an edge of which points are
    missing; or where the surface goes on rising between them by more than half of the lesser: it
    does if it is steeper than farther out on either side, which a bow is not on average.
    `surroundings` reaches from the edge before to the edge behind them.
    """
    lesser = min(abs(differences[first_index]), abs(differences[second_index]))
    lowest_between = np.nanmin(np.abs(differences[first_index:second_index]))
    if lowest_between > _PLATEAU * lesser:
        return True
    apart = second_index - first_index
    if first_index - 2 * apart < surroundings.start or second_index + 2 * apart > surroundings.stop:
        return False
    slopes = []
    for begin in (first_index - 2 * apart, first_index, second_index + apart):
        face = _fit_face_line(profile, begin, begin + apart)
        if face is None:
            return False
        slopes.append(float(face.line.deriv()(profile.x[first_index])))
    before, between, behind = slopes
    length = float(profile.x[second_index] - profile.x[first_index])
    rise = (between - 0.5 * (before + behind)) * length * np.sign(differences[first_index])
    return bool(rise > _GOES_ON * lesser)


def _build_edges_with_flanks(
    profile: _Profile, edge_indices: list[int], differences: Array
) -> list[FoundEdge]:
    """Find where the flank of each edge begins and ends: off the lines through the faces beside it.

    Edges without a face on either side are left out.
    """
    edges = []
    ends = [0, *edge_indices, len(profile.x) - 1]
    for before, place, behind in zip(ends, edge_indices, ends[2:], strict=False):
        lower = _fit_face_line(profile, before, place)
        upper = _fit_face_line(profile, place, behind)
        if lower is None or upper is None:
            continue
        rise = float(differences[place])
        between_lines = float(upper.line(profile.x[place]) - lower.line(profile.x[place]))
        if np.sign(between_lines) == np.sign(rise):
            rise = between_lines
        on_lower = _mark_points_on_face(profile, lower, rise)
        on_upper = _mark_points_on_face(profile, upper, rise)
        begin = place
        while begin > before and not (on_lower[begin] and on_lower[max(begin - 2, before)]):
            begin -= 1
        end = place
        while end < behind and not (on_upper[end] and on_upper[min(end + 2, behind)]):
            end += 1
        edges.append(
            _build_edge_at_half_height(profile, lower, upper, rise, place, slice(begin, end + 1))
        )
    return edges


def _mark_points_on_face(profile: _Profile, face: _FaceLine, rise: float) -> Mask:
    """Return which points of a profile lie on the line through a face beside an edge [m]."""
    tolerance = max(_OFF_FACE_NOISE * face.scatter, _OFF_FACE_HEIGHT * abs(rise))
    return np.asarray(np.abs(profile.z - face.line(profile.x)) <= tolerance)


def _build_edge_at_half_height(
    profile: _Profile,
    lower: _FaceLine,
    upper: _FaceLine,
    rise: float,
    edge_index: int,
    flank: slice,
) -> FoundEdge:
    """Return an edge at the first point of its flank over half of its height.

    Across points that were not measured the place is interpolated.
    """
    x = profile.x
    known = profile.known[flank]
    half_height = 0.5 * (lower.line(x[flank]) + upper.line(x[flank]))
    above = np.where(known, (profile.z[flank] - half_height) * np.sign(rise), 0.0)
    first = edge_index - flank.start
    if (above > 0.0).any():
        first = int(np.argmax(above > 0.0))
    position = float(x[flank.start + first])
    unseen = 0.0
    measured_before = np.flatnonzero(known[:first])
    if len(measured_before) and above[first] > 0.0:
        last = int(measured_before[-1])
        step = float(x[1] - x[0])
        share = float(above[first] / max(above[first] - above[last], 1e-30))
        position -= (first - last) * step * share
        unseen = 0.5 * (first - last - 1) * step
    return FoundEdge(position, rise, float(x[flank.start]), float(x[flank.stop - 1]), unseen)


def _fit_face_line(profile: _Profile, begin_index: int, end_index: int) -> _FaceLine | None:
    """Fit a line through a face between two points, without its ends at edges.

    A face ends where it is seen no more; None where too little of it was measured.
    """
    first = max(begin_index, 0)
    measured = first + np.flatnonzero(profile.known[first:end_index])
    cut = max(len(measured) // 5, 1)
    inner = measured[cut:-cut]
    if len(inner) < _LEAST_LINE:
        return None
    degree = 1 if len(inner) > _LEAST_SLOPE else 0
    x = profile.x[inner]
    z = profile.z[inner]
    line = np.polynomial.Polynomial.fit(x, z, degree)
    return _FaceLine(line, estimate_robust_scale(z - line(x)))
