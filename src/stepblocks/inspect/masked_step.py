"""Depth of many small features in one map, by two levels of height.

Holes of a grating are too short for the windows of type A1. Here each row is levelled by points
away from every edge. A map has levels only where its heights gather at two with a gap between.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from stepblocks.errors import MetrologyError
from stepblocks.inspect.attempts import evaluate_if_possible
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    Source,
    list_tilt_components,
    make_measured_with_instrument,
)
from stepblocks.inspect.evaluation import Evaluation, EvaluationOptions, Shown
from stepblocks.inspect.map_levels import (
    LEAST_REFERENCE,
    TURNS,
    build_row_lines,
    compute_plane_slope,
    find_bulk_points,
    find_nearest_known,
    level_map,
    level_rows,
    sum_weighted_row_lines,
)
from stepblocks.inspect.noise import (
    Array,
    Estimate,
    Mask,
    estimate_robust_scale,
    find_outliers,
    make_linear_estimate,
)
from stepblocks.inspect.notes import NoteKind
from stepblocks.scans.scan import HeightMap

_LEAST_FLOOR = 5  # points of a row in the features
_LEAST_ROWS = 3  # with floor and reference
_SETTLED = 0.005  # deviation from the plateau that is no edge, as a part of the depth [1]
_CLEAR = 3.0  # points to every edge, beyond which a map is levelled at first
_LEAST_LEVEL = 0.02  # density of the lesser of two levels over that of the greater [1]
_BINS = 400  # of the histogram of heights
_HISTOGRAM = (0.3, 99.7)  # percentiles of the heights between which the histogram lies [%]
# width by which a histogram is smoothed over the scatter of its bulk, and its ends over the whole
_SMOOTHING = 0.12
_LEAST_SMOOTHING, _MOST_SMOOTHING = 0.004, 0.012
_GAP = 0.6  # part of the points of the lesser of two levels that may lie between them [1]
_LEAST_SEEN = 0.05  # part of the features that is evaluated: less is a corner of one [1]
# part of the reference that must not be spikes: debris lies on it, a third level is none [1]
_LEAST_KEPT = 0.8
# part of the half width of a feature within which its edge changes heights, where it is a step [1]
_SUDDEN_WIDTH = 0.1
_SUDDEN_CHANGE = 0.5  # by what part of the depth it does
_LEAST_BANDS = 4  # of rows, over which a scatter is taken
_WIDER = 1.5  # exclusion over the usual one, with which a depth is measured again [1]


@dataclass(frozen=True)
class MaskedStep:
    """Depth of the features of a map."""

    depth: Estimate  # of the features that the map shows, each by its area [m]; negative for ridges
    differ: float  # standard deviation of their heights, by their area [m]
    exclusion: float  # distance that was kept to every edge [m]
    rows: int  # that took part
    features: int  # separate ones in the map
    level: Array  # shape (ny, nx); heights with each row levelled on the reference [m]
    inside: Mask  # shape (ny, nx); features, whole
    floor: Mask  # shape (ny, nx); points of the features that took part
    shown: int  # row with most floor
    slope: float  # of the reference beside the features [1]


@dataclass(frozen=True)
class _EdgeDistances:
    """Distances to the nearest edge of a feature, arrays of shape (ny, nx) [m]."""

    within: Array  # of points of features; 0 outside
    outside: Array  # of points beside them; 0 within


@dataclass(frozen=True)
class _LevelledMap:
    """A map with each row levelled on its reference, arrays of shape (ny, nx)."""

    heights: Array  # m
    reference: Mask  # without spikes


@dataclass(frozen=True)
class _RowDepths:
    """Depths of the rows of a map, arrays of shape (ny,)."""

    depths: Array  # m; nan where a row has too little floor or reference
    points: Array  # of a floor; 0 there

    @property
    def has_depth(self) -> Mask:
        """Which rows have a depth, shape (ny,)."""
        return np.isfinite(self.depths)

    @property
    def weights(self) -> Array:
        """Weight of each row in the mean depth of the map, of sum 1 [1]."""
        return np.asarray(self.points / self.points.sum())


def measure_masked_step(
    scan: HeightMap, exclusion: float | None = None, inside: Mask | None = None
) -> MaskedStep:
    """Depth of holes, or height of bumps, over a map; missing points take no part.

    Parameters
    ----------
    scan : HeightMap
    exclusion : float, optional
        Distance to keep to every edge [m]; by default that at which both sides have settled.
    inside : array of bool, shape (ny, nx), optional
        Mask of the features; by default they are sought.

    Returns
    -------
    MaskedStep

    Raises
    ------
    MetrologyError
        If heights do not gather at two levels, or too little of either is level and beyond the
        exclusion.
    """
    z = scan.height
    measured = np.isfinite(z)
    pitch = min(scan.dx, scan.dy)
    if inside is None:
        # a missing point lies where its nearest neighbour does
        inside = _find_feature_points(scan)[find_nearest_known(measured)]
    distances = _compute_edge_distances(inside, scan)
    if exclusion is None:
        level = level_map(z, (distances.outside > _CLEAR * pitch) & measured, 1)
        exclusion = _find_settling_distance(level, distances, pitch)
    floor = (distances.within > exclusion) & measured
    levelled = _level_on_reference(z, (distances.outside > exclusion) & measured, scan.source)
    rows = _fit_row_depths(levelled.heights, floor, levelled.reference)
    known = rows.has_depth
    if known.sum() < _LEAST_ROWS:
        raise MetrologyError(
            f"map must keep at least {_LEAST_ROWS} rows with floor and reference beyond "
            f"{exclusion * 1e6:.3g} um, got {int(known.sum())} [{scan.source}]"
        )
    features_measured = (inside & measured).sum()
    if floor.sum() < _LEAST_SEEN * features_measured:
        raise MetrologyError(
            f"at least {_LEAST_SEEN:.0%} of the features must lie {exclusion * 1e6:.3g} um "
            "from their edges, where they are level, got "
            f"{floor.sum() / features_measured:.1%} [{scan.source}]"
        )
    depth = float(np.sum(rows.weights[known] * rows.depths[known]))
    near = max(_CLEAR * pitch, _SUDDEN_WIDTH * float(distances.within.max()))
    change = _measure_change_at_edges(levelled.heights, measured, distances, near, pitch)
    _refuse_gradual_change(change, depth, near, scan.source)
    labels, _ = ndimage.label(inside)
    numbers = labels[floor]
    sums = np.bincount(numbers, levelled.heights[floor])
    means = sums / np.maximum(np.bincount(numbers), 1)
    scatter_of_means = float(np.std(means[numbers]))
    features = int(np.unique(numbers).size)
    return MaskedStep(
        depth=_estimate_depth_by_row_bands(rows.depths, rows.weights, depth, known),
        differ=scatter_of_means,
        exclusion=exclusion,
        rows=int(known.sum()),
        features=features,
        level=levelled.heights,
        inside=inside,
        floor=floor,
        shown=int(np.argmax(rows.points)),
        slope=compute_plane_slope(scan, levelled.reference),
    )


def _compute_edge_distances(inside: Mask, scan: HeightMap) -> _EdgeDistances:
    """Compute how far each point lies from the edges of the features `inside`."""
    pitch = (scan.dy, scan.dx)
    return _EdgeDistances(
        ndimage.distance_transform_edt(inside, sampling=pitch),
        ndimage.distance_transform_edt(~inside, sampling=pitch),
    )


def _level_on_reference(z: Array, reference: Mask, source: str) -> _LevelledMap:
    """Level a map [m] on a reference without its spikes; refuse it where too little is level."""
    asked = int(reference.sum())
    reference = reference.copy()
    heights = level_rows(level_map(z, reference, 2), reference)
    for _ in range(TURNS):
        if not asked:
            break
        spikes = find_outliers(heights, reference)
        if not spikes.any():
            break
        reference &= ~spikes
        heights = level_rows(level_map(z, reference, 2), reference)
    if reference.sum() < _LEAST_KEPT * asked:
        raise MetrologyError(
            f"at least {_LEAST_KEPT:.0%} of what lies beside the features must be level, got "
            f"{reference.sum() / max(asked, 1):.0%} [{source}]"
        )
    return _LevelledMap(heights, reference)


def _measure_change_at_edges(
    level: Array, measured: Mask, distances: _EdgeDistances, edge_distance: float, pitch: float
) -> float | None:
    """Return by how much heights change at the edges of the features [m].

    Heights are those `edge_distance` the edges [m] on both sides, within a point; None where one
    side was not measured.
    """
    inner = level[(np.abs(distances.within - edge_distance) <= pitch) & measured]
    outer = level[(np.abs(distances.outside - edge_distance) <= pitch) & measured]
    if not inner.size or not outer.size:
        return None
    return float(np.median(outer) - np.median(inner))


def _refuse_gradual_change(
    change: float | None, depth: float, edge_distance: float, source: str
) -> None:
    """Refuse features whose heights do not change suddenly at their edges [all m]."""
    if change is None:
        raise MetrologyError(
            f"heights must be measured {edge_distance * 1e6:.3g} um beside an edge, got none "
            f"[{source}]"
        )
    jump = change / depth
    if not jump > _SUDDEN_CHANGE:
        raise MetrologyError(
            f"heights must change by {_SUDDEN_CHANGE:.0%} of a depth at its edges, got {jump:.0%} "
            f"within {edge_distance * 1e6:.3g} um of an edge [{source}]"
        )


def _estimate_depth_by_row_bands(
    row_depths: Array, row_weights: Array, mean_depth: float, has_depth: Mask
) -> Estimate:
    """Estimate the uncertainty of a depth [m] by its scatter over bands of rows.

    A band crosses the same features, so rows within it depend on one another. Bands whose variance
    goes as one over their share give ``sum(share deviation^2) / (bands - 1)`` without bias, with
    one degree of freedom less than bands. Of few bands the correlation of the rows tells.
    """
    rows = np.flatnonzero(has_depth)
    bands = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    # a band that the map cuts to a sliver counts with its neighbour
    shares_of_bands = [row_weights[band].sum() for band in bands]
    least = 0.5 * float(np.median(shares_of_bands))
    if len(bands) > 1 and row_weights[bands[0]].sum() < least:
        bands[:2] = [np.concatenate(bands[:2])]
    if len(bands) > 1 and row_weights[bands[-1]].sum() < least:
        bands[-2:] = [np.concatenate(bands[-2:])]
    if len(bands) < _LEAST_BANDS:
        return make_linear_estimate(
            mean_depth,
            row_weights,
            row_depths - mean_depth,
            has_depth,
            np.ones((1, len(row_depths))),
        )
    squares = []
    for band in bands:
        deviation = np.sum(row_weights[band] * (row_depths[band] - mean_depth))
        squares.append(deviation**2 / np.sum(row_weights[band]))
    std = float(np.sqrt(np.sum(squares) / (len(bands) - 1)))
    return Estimate(mean_depth, std, len(bands) - 1.0)


def _find_feature_points(scan: HeightMap) -> Mask:
    """Return the points of the level that covers less of a map, shape (ny, nx).

    The rows are levelled without it until it stays.
    """
    z = scan.height
    known = np.isfinite(z)
    beside = find_bulk_points(z, known)
    inside = np.zeros(z.shape, dtype=bool)
    for _ in range(2 * TURNS):
        # a bow of the map is none of its features
        level = level_rows(level_map(z, beside, 2), beside)
        low, high = _find_two_height_levels(level[known], scan.source)
        middle = 0.5 * (low + high)
        apart = high - low
        # what towers over a level by as much as it is away from the other is a third
        upper = (level > middle) & (level < high + 0.5 * apart) & known
        lower = (level <= middle) & (level > low - 0.5 * apart) & known
        lesser = lower if lower.sum() <= upper.sum() else upper
        if (lesser == inside).all():
            break
        inside = lesser
        beside = ~ndimage.binary_dilation(inside, iterations=3) & (upper | lower)
    return inside


def _find_two_height_levels(heights: Array, source: str) -> tuple[float, float]:
    """Return the lower and the higher of the heights at which most points gather [m].

    Refused, with the figure, where there is no gap between them.
    """
    lowest, highest = np.percentile(heights, _HISTOGRAM)
    ends = (float(lowest), float(highest) + 1e-15)
    counts, bins = np.histogram(heights, _BINS, ends)
    bulk = estimate_robust_scale(heights) / float(highest - lowest + 1e-15)
    width = float(np.clip(_SMOOTHING * bulk, _LEAST_SMOOTHING, _MOST_SMOOTHING)) * _BINS
    density = ndimage.gaussian_filter1d(np.pad(counts.astype(np.float64), 1), width)
    # `scipy.signal` finds peaks too, and takes as long to load as all the rest
    is_top = (density[1:-1] > density[:-2]) & (density[1:-1] >= density[2:])
    is_level = density[1:-1] >= _LEAST_LEVEL * density.max()
    peaks = 1 + np.flatnonzero(is_top & is_level)
    main = int(np.argmax(density))
    between = {}
    for peak in peaks[peaks != main]:
        valley = density[min(peak, main) : max(peak, main) + 1].min()
        between[peak] = float(valley / density[peak])
    apart = [peak for peak, share in between.items() if share < _GAP]
    if not apart:
        raise MetrologyError(
            f"heights of a map must gather at two levels, with less than {_GAP:.0%} as many "
            f"between as at the lesser, got {min(between.values(), default=1.0):.0%} [{source}]"
        )
    second = max(apart, key=lambda peak: density[peak])
    centres = np.concatenate([[bins[0]], 0.5 * (bins[1:] + bins[:-1]), [bins[-1]]])
    low, high = sorted((float(centres[main]), float(centres[second])))
    return low, high


def _find_settling_distance(level: Array, distances: _EdgeDistances, pitch: float) -> float:
    """Return the distance from the edges at which heights [m] have settled on both sides [m].

    Both sides are judged within the half width of the features, since bows of the scan show beyond
    it.
    """
    reach = float(distances.within.max())
    sides = (distances.within, distances.outside)
    heights = []
    for side in sides:
        plateau = level[(side > 0.5 * reach) & (side <= reach)]
        if not np.isfinite(plateau).any():
            raise MetrologyError(
                "features and what lies beside them must be measured half of their width from an "
                "edge"
            )
        heights.append(float(np.nanmedian(plateau)))
    tolerance = _SETTLED * abs(heights[0] - heights[1])
    settled = 1
    for side, height in zip(sides, heights, strict=True):
        for ring in range(1, int(0.5 * reach / pitch) + 1):
            points = level[(side > (ring - 0.5) * pitch) & (side <= (ring + 0.5) * pitch)]
            points = points[np.isfinite(points)]
            if points.size and abs(np.median(points) - height) > tolerance:
                settled = max(settled, ring)
    # one ring more, since a ring is judged by its median and half of its points lie nearer to the
    # edge
    return (settled + 1.5) * pitch


def _fit_row_depths(z: Array, floor: Mask, reference: Mask) -> _RowDepths:
    """Fit a line and a depth to each row of a map [m]."""
    floor_points = floor.sum(axis=1)
    enough = (floor_points >= _LEAST_FLOOR) & (reference.sum(axis=1) >= LEAST_REFERENCE)
    used = (floor | reference) & enough[:, np.newaxis]
    lines = build_row_lines(used)
    # what a line does not explain of the floor, by which the depth alone goes
    weights = used * (floor - sum_weighted_row_lines(lines, used * lines, floor.astype(float)))
    scale = np.where(enough, (weights * floor).sum(axis=1), np.nan)
    depths = -(weights * np.where(used, z, 0.0)).sum(axis=1) / scale
    return _RowDepths(depths, np.where(enough, floor_points, 0.0))


def evaluate_masked_step(
    scan: HeightMap, instrument: Instrument, options: EvaluationOptions, key: str
) -> Evaluation:
    """Depth of the features of a map by two levels, with how they differ.

    `key` is that of the characteristic.
    """
    step = measure_masked_step(scan, options.exclusion)
    noise = Component(
        Source.NOISE,
        step.depth.std,
        step.depth.dof,
        "scatter over rows, with the correlation of neighbours",
    )
    form = Component(
        Source.FORM,
        _estimate_form_uncertainty(scan, step),
        how="change with one and a half times the exclusion or its part, rectangular",
    )
    name = key.replace("_", " ")
    depth = abs(step.depth.value)
    others = [form, *list_tilt_components(depth, step.slope)]
    value = make_measured_with_instrument(name, depth, [noise], instrument, others)
    note = NoteKind.SINGLE_FEATURE.make_note()
    if step.features > 1:
        note = NoteKind.FEATURES_DIFFER.make_note(differ=step.differ * 1e9)
    return Evaluation(
        values={key: value},
        convention=f"masked step over {step.features} features and {step.rows} rows: each row "
        "levelled on the reference between the features, "
        f"{step.exclusion * 1e6:.3g} um kept from every edge",
        notes=(note,),
        shown=Shown(scan.x, step.level[step.shown]),
    )


def _estimate_form_uncertainty(scan: HeightMap, step: MaskedStep) -> float:
    """Return the change of a depth with another exclusion, as a rectangle [m]; NaN without one.

    Where a floor is too narrow for more to be kept out, it is compared with more of its flanks.
    """

    def measure_with_exclusion(exclusion: float) -> MaskedStep:
        """Measure the map again with an exclusion [m]."""
        return measure_masked_step(scan, exclusion, step.inside)

    again = evaluate_if_possible(measure_with_exclusion, _WIDER * step.exclusion)
    if again is None:
        again = evaluate_if_possible(measure_with_exclusion, step.exclusion / _WIDER)
    if again is None:
        return np.nan
    return float(abs(again.depth.value - step.depth.value) / np.sqrt(3.0))
