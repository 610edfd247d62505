"""Depth of many small features in one map, by two levels of height or one by one.

Holes of a grating are too short for the windows of type A1. Here each row gets its own slope and
offset, the drift of a scanning instrument, from points away from every edge. A map has levels only
where its heights gather at two with a gap between. Dots, holes and craters whose walls slope, or
whose depths differ, are measured one by one, each at half of its own depth.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    add_instrument_components,
    average_profiles,
)
from stepblocks.inspect.measure import (
    AS_FOUND,
    Evaluation,
    EvaluationOptions,
    Shown,
    evaluate_each,
    list_features,
)
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    Array,
    Estimate,
    Mask,
    estimate_linear,
    estimate_of_rows,
    estimate_robust_scale,
    find_outliers,
)
from stepblocks.scans.scan import HeightMap, ScannedProfile

_LEAST_FLOOR = 5  # points of a row in the features
_LEAST_REFERENCE = 20  # points of a row beside them
_SETTLED = 0.005  # deviation from the plateau that is no edge, as a part of the depth [1]
_LEAST_LEVEL = 0.02  # density of the lesser of two levels over that of the greater [1]
_TURNS = 6  # of levelling and looking again
_BINS = 400  # of the histogram of heights
_GAP = 0.6  # part of the points of the lesser of two levels that may lie between them [1]
_LEAST_PERIODS = (
    4.0  # over a map that repeats itself [1]: a wandering surface bends twice or thrice
)
_REPEATS = 0.4  # part of the power of a map about one wave, from which it repeats itself [1]
_LEAST_SEEN = 0.05  # part of the features that is evaluated: less is a corner of one [1]
# part of the reference that must not be spikes: debris lies on it, a third level is none [1]
_LEAST_KEPT = 0.8
# part of the half width of a feature within which its edge changes heights by what part of the
# depth, where it is a step [1]
_SUDDEN = 0.1, 0.5
_LEAST_BANDS = 4  # of rows, over which a scatter is taken
# of the scatter of the surface beside them, by which dots stand out [1]
_STAND_OUT = 6.0
# of its depth, by which the floor of a dot may fall to its middle: a dome's falls by 0.047 [1]
_LEVEL_FLOOR = 0.04


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


def measure_masked_step(
    scan: HeightMap, exclusion: float | None = None, inside: Mask | None = None
) -> MaskedStep:
    """Depth of holes, or height of bumps, over a map; missing points take no part."""
    # `exclusion` is the distance to keep to every edge [m]; by default that at which both sides
    # have settled. `inside` is the mask of the features; by default they are sought.
    z = scan.height
    measured = np.isfinite(z)
    pitch = min(scan.dx, scan.dy)
    if inside is None:
        # a missing point lies where its nearest neighbour does
        inside = _find_features(scan)[_find_nearest(measured)]
    within, outside = (
        ndimage.distance_transform_edt(one, sampling=(scan.dy, scan.dx))
        for one in (inside, ~inside)
    )
    if exclusion is None:
        level = _level_map(z, (outside > 3.0 * pitch) & measured, 1)
        exclusion = _find_settling_distance(level, within, outside, pitch)
    floor, reference = (within > exclusion) & measured, (outside > exclusion) & measured
    asked = int(reference.sum())
    level = _level_rows(_level_map(z, reference, 2), reference)
    for _ in range(_TURNS if asked else 0):
        if not (spikes := find_outliers(level, reference)).any():
            break
        reference &= ~spikes
        level = _level_rows(_level_map(z, reference, 2), reference)
    MetrologyError.require(
        reference.sum() >= _LEAST_KEPT * asked,
        f"at least {_LEAST_KEPT:.0%} of what lies beside the features must be level, got "
        f"{reference.sum() / max(asked, 1):.0%} [{scan.source}]",
    )
    depths, weights = _fit_row_depths(level, floor, reference)
    known = np.isfinite(depths)
    MetrologyError.require(
        known.sum() >= 3,
        "map must keep at least 3 rows with floor and reference beyond "
        f"{exclusion * 1e6:.3g} um, got {int(known.sum())} [{scan.source}]",
    )
    MetrologyError.require(
        floor.sum() >= _LEAST_SEEN * (inside & measured).sum(),
        f"at least {_LEAST_SEEN:.0%} of the features must lie {exclusion * 1e6:.3g} um "
        "from their edges, where they are level, got "
        f"{floor.sum() / (inside & measured).sum():.1%} [{scan.source}]",
    )
    share = weights / weights.sum()
    value = float(np.sum(share[known] * depths[known]))
    depth = _estimate_by_bands(depths, share, value, known)
    near = max(3.0 * pitch, _SUDDEN[0] * float(within.max()))
    sides = [level[(np.abs(one - near) <= pitch) & measured] for one in (within, outside)]
    MetrologyError.require(
        all(side.size for side in sides),
        f"heights must be measured {near * 1e6:.3g} um beside an edge, got none [{scan.source}]",
    )
    inner, outer = map(np.median, sides)
    MetrologyError.require(
        (jump := float(outer - inner) / value) > _SUDDEN[1],
        f"heights must change by {_SUDDEN[1]:.0%} of a depth at its edges, got {jump:.0%} "
        f"within {near * 1e6:.3g} um of an edge [{scan.source}]",
    )
    own = ndimage.label(inside)[0][floor]
    means = np.bincount(own, level[floor]) / np.maximum(np.bincount(own), 1)
    return MaskedStep(
        depth,
        float(np.std(means[own])),
        exclusion,
        int(known.sum()),
        int(np.unique(own).size),
        level,
        inside,
        floor,
        int(np.argmax(weights)),
    )


def _estimate_by_bands(depths: Array, share: Array, depth: float, known: Mask) -> Estimate:
    # Scatter over bands of rows that cross the same features; rows within a band depend on one
    # another. Bands whose variance goes as one over their share give ``sum(share deviation^2) /
    # (bands - 1)`` without bias, with one degree of freedom less than bands; a band that the map
    # cuts to a sliver counts with its neighbour.
    rows = np.flatnonzero(known)
    bands = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    least = 0.5 * float(np.median([share[band].sum() for band in bands]))
    if len(bands) > 1 and share[bands[0]].sum() < least:
        bands[:2] = [np.concatenate(bands[:2])]
    if len(bands) > 1 and share[bands[-1]].sum() < least:
        bands[-2:] = [np.concatenate(bands[-2:])]
    if len(bands) < _LEAST_BANDS:
        return estimate_linear(depth, share, depths - depth, known, np.ones((1, len(depths))))
    parts = [np.sum(share[one] * (depths[one] - depth)) ** 2 / np.sum(share[one]) for one in bands]
    return Estimate(depth, float(np.sqrt(np.sum(parts) / (len(bands) - 1))), len(bands) - 1.0)


def is_periodic(z: Array) -> bool:
    """Tell whether a map repeats itself over four periods or more, as the teeth of a grating do."""
    known = np.isfinite(z)
    level = np.where(known, _level_map(z, known, 2), 0.0)
    power = (
        np.abs(np.fft.fft2(level * np.outer(*(np.hanning(size + 2)[1:-1] for size in z.shape))))
        ** 2
    )
    periods = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n) * n for n in z.shape), indexing="ij"))
    at = np.unravel_index(int(np.argmax(power)), z.shape)
    near = np.roll(power, [3 - one for one in at], axis=(0, 1))[:7, :7]
    return bool(periods[at] >= _LEAST_PERIODS and 2.0 * near.sum() > _REPEATS * power.sum())


def _level_map(z: Array, reference: Mask, degree: int) -> Array:
    # Return heights less a polynomial of total degree `degree` through those of the reference.
    t, u = np.meshgrid(*(np.linspace(-1.0, 1.0, size) for size in z.shape[::-1]))
    terms = np.stack([t**i * u**j for i in range(degree + 1) for j in range(degree + 1 - i)])
    solution = np.linalg.lstsq(terms[:, reference].T, z[reference], rcond=None)[0]
    return np.asarray(z - np.tensordot(solution, terms, 1))


def _find_features(scan: HeightMap) -> Mask:
    # Mask of the level that covers less of the map; the rows are levelled without it until it
    # stays.
    z = scan.height
    known = np.isfinite(z)
    rest = _find_bulk(z, known)
    inside = np.zeros(z.shape, dtype=bool)
    for _ in range(2 * _TURNS):
        # a bow of the map is none of its features
        level = _level_rows(_level_map(z, rest, 2), rest)
        low, high = _find_two_modes(level[known], scan.source)
        middle, reach = 0.5 * (low + high), high - low
        # what towers over a level by as much as it is away from the other is a third
        upper = (level > middle) & (level < high + 0.5 * reach) & known
        lower = (level <= middle) & (level > low - 0.5 * reach) & known
        following = lower if lower.sum() <= upper.sum() else upper
        if (following == inside).all():
            break
        inside = following
        rest = ~ndimage.binary_dilation(inside, iterations=3) & (upper | lower)
    return inside


def _find_bulk(z: Array, known: Mask) -> Mask:
    # Points at the height at which most of a map lies, once it is level.
    bulk = known
    for _ in range(_TURNS + 1):
        level = _level_map(z, bulk, 1 if bulk is known else 2)
        off = np.abs(level - np.median(level[known]))
        bulk = known & (off < 3.0 * np.median(off[known]))
    return bulk


def _find_two_modes(heights: Array, source: str) -> tuple[float, float]:
    # Return the two heights at which most points gather with a gap between; refused, with the
    # figure, where they do not.
    ends = np.percentile(heights, [0.3, 99.7])
    counts, bins = np.histogram(heights, _BINS, (float(ends[0]), float(ends[1]) + 1e-15))
    bulk = estimate_robust_scale(heights) / float(ends[1] - ends[0] + 1e-15)
    density = ndimage.gaussian_filter1d(
        np.pad(counts.astype(np.float64), 1), float(np.clip(0.12 * bulk, 0.004, 0.012)) * _BINS
    )
    # `scipy.signal` finds peaks too, and takes as long to load as all the rest
    tops = (density[1:-1] > density[:-2]) & (density[1:-1] >= density[2:])
    peaks = 1 + np.flatnonzero(tops & (density[1:-1] >= _LEAST_LEVEL * density.max()))
    main = int(np.argmax(density))
    between = {
        one: float(density[min(one, main) : max(one, main) + 1].min() / density[one])
        for one in peaks[peaks != main]
    }
    apart = [one for one, part in between.items() if part < _GAP]
    MetrologyError.require(
        apart,
        f"heights of a map must gather at two levels, with less than {_GAP:.0%} as many "
        f"between as at the lesser, got {min(between.values(), default=1.0):.0%} [{source}]",
    )
    best = max(apart, key=lambda one: density[one])
    centres = np.concatenate([[bins[0]], 0.5 * (bins[1:] + bins[:-1]), [bins[-1]]])
    low, high = sorted((float(centres[main]), float(centres[best])))
    return low, high


def _level_rows(z: Array, reference: Mask) -> Array:
    # Level each row of a map without a bow by a line through its reference; a row with too little
    # of it keeps its heights less the median.
    level = z - float(np.median(z[reference])) if reference.any() else z
    lines = _find_lines(reference)
    return np.asarray(level - _sum_lines(lines, reference * lines, np.where(reference, level, 0.0)))


def _find_lines(reference: Mask) -> Array:
    # A constant and a slope of each row, shape (2, ny, nx), orthonormal over its reference; zero
    # where a row has too little of it.
    count = reference.sum(axis=1, keepdims=True)
    t = np.linspace(-1.0, 1.0, reference.shape[1])
    middle = (reference * t).sum(axis=1, keepdims=True) / np.maximum(count, 1)
    lines = np.stack([np.ones(reference.shape), t - middle])
    size = np.sqrt((reference * lines**2).sum(axis=2, keepdims=True))
    return np.asarray(np.where(count >= _LEAST_REFERENCE, lines / np.maximum(size, 1e-9), 0.0))


def _sum_lines(lines: Array, by: Array, heights: Array) -> Array:
    # Sum of lines, each times the product of the heights of its row with what goes by it.
    return np.asarray((lines * (by * heights).sum(axis=2, keepdims=True)).sum(axis=0))


def _find_settling_distance(level: Array, within: Array, outside: Array, pitch: float) -> float:
    # both sides are judged within the half width of the features, since bows of the scan show
    # beyond it
    reach = float(within.max())
    near = [(distance > 0.5 * reach) & (distance <= reach) for distance in (within, outside)]
    MetrologyError.require(
        all(np.isfinite(level[mask]).any() for mask in near),
        "features and what lies beside them must be measured half of their width from an edge",
    )
    plateau = [float(np.nanmedian(level[mask])) for mask in near]
    limit = _SETTLED * abs(plateau[0] - plateau[1])
    settled = 1
    for distance, target in zip((within, outside), plateau, strict=True):
        for ring in range(1, int(0.5 * reach / pitch) + 1):
            points = level[(distance > (ring - 0.5) * pitch) & (distance <= (ring + 0.5) * pitch)]
            points = points[np.isfinite(points)]
            if points.size and abs(np.median(points) - target) > limit:
                settled = max(settled, ring)
    # one ring more, since a ring is judged by its median and half of its points lie nearer to the
    # edge
    return (settled + 1.5) * pitch


def _fit_row_depths(z: Array, floor: Mask, reference: Mask) -> tuple[Array, Array]:
    # Depth of each row, by one fit of a line and the depth; nan where it has too little of either.
    # With it how many points of a floor it has.
    enough = (floor.sum(axis=1) >= _LEAST_FLOOR) & (reference.sum(axis=1) >= _LEAST_REFERENCE)
    used = (floor | reference) & enough[:, np.newaxis]
    lines = _find_lines(used)
    # what a line does not explain of the floor, by which the depth alone goes
    rest = used * (floor - _sum_lines(lines, used * lines, floor.astype(float)))
    share = np.where(enough, (rest * floor).sum(axis=1), np.nan)
    return -(rest * np.where(used, z, 0.0)).sum(axis=1) / share, np.where(
        enough, floor.sum(axis=1), 0.0
    )


def _find_nearest(known: Mask) -> tuple[NDArray[np.intp], ...]:
    # Indices of the nearest point of a mask to each point of a map.
    return tuple(
        ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    )


def measure_masked(
    scan: HeightMap, instrument: Instrument, options: EvaluationOptions, key: str
) -> Evaluation:
    """Depth of the features of a map by two levels, with how they differ."""
    step = measure_masked_step(scan, options.exclusion)
    # a floor too narrow for more to be kept out is compared with more of its flanks
    again = partial(measure_masked_step, scan, inside=step.inside)
    others = (
        evaluate_each(again, [1.5 * step.exclusion])[0]
        or evaluate_each(again, [step.exclusion / 1.5])[0]
    )
    changes = [abs(one.depth.value - step.depth.value) / np.sqrt(3.0) for _, one in others]
    origin = "scatter over rows, with the correlation of neighbours"
    changed = "change with one and a half times the exclusion or its part, rectangular"
    value = add_instrument_components(
        key.replace("_", " "),
        abs(step.depth.value),
        [Component("noise", step.depth.std, step.depth.dof, origin)],
        instrument,
        [Component("form", max(changes, default=np.nan), how=changed)],
    )
    convention = (
        f"masked step over {step.features} features and {step.rows} rows: each row levelled on "
        f"the reference between the features, {step.exclusion * 1e6:.3g} um kept from every edge"
    )
    note = (
        f"the features differ by {step.differ * 1e9:.3g} nm, so may another (standard deviation, "
        "by area)"
        if step.features > 1
        else "one feature alone: another may be of another height"
    )
    return Evaluation({key: value}, convention, (note,), Shown(scan.x, step.level[step.shown]))


def measure_dots(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    options: EvaluationOptions = AS_FOUND,
    key: str = "dot_depth",
) -> Evaluation:
    """Depth of every dot, hole or crater that lies wholly in a map, over the surface beside it.

    Its floor is the inner half of its width at half depth, and must be level.
    """
    if isinstance(scan, ScannedProfile):
        raise MetrologyError("dots and craters must be seen in a map, got a profile")
    known = np.isfinite(scan.height)
    z = scan.height[_find_nearest(known)]
    reference = _find_bulk(z, known)
    for _ in range(_TURNS // 2):
        labels, odd = _find_dots(_level_map(z, reference, 2), reference, scan.source)
        within, outside = (
            ndimage.distance_transform_edt(one, sampling=(scan.dy, scan.dx))
            for one in (labels > 0, labels == 0)
        )
        exclusion = options.exclusion or 0.5 * min(float(within.max()), float(outside.max()))
        reference = known & ~odd & (outside > exclusion)
    numbers = np.arange(1, labels.max() + 1)
    part = within / np.append(1.0, ndimage.maximum(within, labels, numbers))[labels]
    floor = np.where(known & (part > 0.5), labels, 0)
    # the surface beside a dot is nearer to it than to another, and as wide as the widest
    near = outside < exclusion + within.max()
    beside = np.where(reference & near, labels[_find_nearest(labels > 0)], 0)
    level = _level_map(z, reference, 2)
    rows = _level_rows(level, reference)
    with np.errstate(invalid="ignore"):  # of what has no points the mean is none
        depths, others, cores = (
            np.abs(ndimage.mean(heights, inner, numbers) - ndimage.mean(heights, beside, numbers))
            for heights, inner in (
                (rows, floor),
                (level, floor),
                (rows, np.where(part > 0.75, floor, 0)),
            )
        )
    stds = estimate_of_rows(_list_weights(reference, labels, floor, beside), rows, reference)
    # as many as would fit into what lies beside them, less the form of the map
    dof = max(float(reference.sum()) / max(np.median(np.bincount(floor[floor > 0])), 1) - 6.0, 1.0)
    cut = np.isin(numbers, [*labels[[0, -1]].ravel(), *labels[:, [0, -1]].ravel()])
    kept = np.flatnonzero((np.abs(cores - depths) + stds < _LEVEL_FLOOR * depths) & ~cut)
    said = (
        f"{len(kept)} of {len(numbers)} dots or craters have a level floor and lie wholly in the "
        f"map, {cut.sum()} are cut by its border"
    )
    MetrologyError.require(
        2 * len(kept) > np.sum(~cut), f"most dots and craters must have a level floor, got: {said}"
    )
    asked = options.edges or range(1, len(kept) + 1)
    MetrologyError.require(
        max(asked) <= len(kept), f"edges must name some of the {len(kept)} dots, got {asked}"
    )
    kept = kept[np.array(asked) - 1]
    changes = np.stack([others, cores])[:, kept] - depths[kept]
    found = [Estimate(float(depths[at]), float(stds[at]), dof) for at in kept]
    places = ndimage.center_of_mass(labels > 0, labels, kept + 1)
    label = key.replace("_", " ")
    each = [
        add_instrument_components(
            f"{label} at {x * scan.dx * 1e6:.4g}, {y * scan.dy * 1e6:.4g} um",
            one.value,
            [
                Component(
                    "noise",
                    one.std,
                    dof,
                    "autocovariance of the surface beside it, and what the lines of its rows leave",
                )
            ],
            instrument,
            [_bound_form(own, one.std)],
        )
        for one, (y, x), own in zip(found, places, changes.T, strict=True)
    ]
    form = _bound_form(changes.mean(axis=1), float(np.sqrt(np.mean(stds[kept] ** 2) / len(kept))))
    notes = [said]
    values = list_features(
        key,
        each,
        partial(average_profiles, f"{label}, mean", found, instrument, [form], of="dots"),
        notes,
    )
    return Evaluation(
        values,
        "each dot or crater by the mean of the inner half of its width at half depth, over the "
        f"surface beside it, levelled row by row, {exclusion * 1e6:.3g} um kept from every edge",
        tuple(notes),
        Shown(scan.x, rows[np.argmax(np.isin(floor, kept + 1).sum(axis=1))]),
    )


def _find_dots(level: Array, reference: Mask, source: str) -> tuple[NDArray[np.intp], Mask]:
    # Number what stands out to the side where most does, as far as half of its own height; and
    # mask what stands out to either side.
    rest = level[reference]
    # a single point is none
    calm = ndimage.median_filter(level - np.median(rest), 3)
    least = _STAND_OUT * max(estimate_robust_scale(rest), LEAST_SCATTER)
    odd = np.abs(calm) > least
    tall = calm * np.sign(calm[odd].sum())
    islands, count = ndimage.label(tall > least)
    MetrologyError.require(
        count,
        f"dots and craters must stand out {_STAND_OUT:g} times over the scatter of the surface "
        f"beside them, got none [{source}]",
    )
    tallest = ndimage.maximum(tall, islands, np.arange(count + 1))
    return ndimage.label((islands > 0) & (tall > 0.5 * tallest[islands]))[0], odd


def _list_weights(
    reference: Mask, labels: NDArray[np.intp], floor: NDArray[np.intp], beside: NDArray[np.intp]
) -> Iterator[Array]:
    # Yield the weights of the points of its rows in the height of each floor over what lies beside
    # it: the lines of the rows go through other points, too.
    lines = _find_lines(reference)
    for number, (own, _) in enumerate(ndimage.find_objects(np.maximum(labels, beside)), 1):
        inner, outer = (one[own] == number for one in (floor, beside))
        direct = inner / max(inner.sum(), 1) - outer / max(outer.sum(), 1)
        part = lines[:, own]
        yield direct - _sum_lines(reference[own] * part, part, direct)


def _bound_form(changes: Array, noise: float) -> Component:
    # Largest change by another levelling or part of a floor, a quarter of it, less what noise
    # alone changes.
    most = max(float(np.max(changes**2)) - 3.0 * noise**2, 0.0)
    return Component(
        "form",
        float(np.sqrt(most / 3.0)),
        how="change without levelling by rows, or by the middle of the floors, rectangular",
    )
