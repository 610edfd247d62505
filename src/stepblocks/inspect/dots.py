"""Depth of dots, holes and craters of a map, one by one.

Their walls may slope and their depths differ: each is measured at half of its own depth.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    Measured,
    Source,
    average_profiles,
    list_tilt_components,
    make_measured_with_instrument,
)
from stepblocks.inspect.evaluation import AS_FOUND, Evaluation, EvaluationOptions, Shown
from stepblocks.inspect.map_levels import (
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
    LEAST_SCATTER,
    Array,
    Estimate,
    Mask,
    estimate_robust_scale,
    estimate_std_of_row_sums,
)
from stepblocks.inspect.notes import NoteKind
from stepblocks.inspect.profiles import collect_numbered_features
from stepblocks.scans.scan import HeightMap, ScannedProfile

Labels = NDArray[np.intp]  # shape (ny, nx); number of a dot at its points, else 0

# of the scatter of the surface beside them, by which dots stand out [1]
_STAND_OUT = 6.0
# of its depth, by which the floor of a dot may fall to its middle: a dome's falls by 0.047 [1]
_LEVEL_FLOOR = 0.04
_FLOOR = 0.5  # distance from the edge over the largest of a dot, beyond which its floor lies [1]
# Share of the points of a dot that must be measured: of a hole without light, strays may be left
_LEAST_MEASURED = 0.5
_CORE = 0.75  # the same of the middle of the floor [1]
_TERMS_OF_FORM = 6.0  # of a polynomial of degree two over a map


@dataclass(frozen=True)
class _Dots:
    """The dots of a map and the surface beside them."""

    labels: Labels
    reference: Mask  # shape (ny, nx); level surface beside the dots
    within: Array  # shape (ny, nx); distance to the edge of points of dots [m]
    outside: Array  # shape (ny, nx); the same of points beside them [m]
    exclusion: float  # kept from every edge [m]

    @property
    def numbers(self) -> NDArray[np.intp]:
        """Numbers of the dots, from 1."""
        return np.arange(1, self.labels.max() + 1)


@dataclass(frozen=True)
class _Regions:
    """Where heights of dots are taken."""

    floor: Labels
    core: Labels  # middle of the floor
    beside: Labels  # surface that is nearest to a dot


@dataclass(frozen=True)
class _Depths:
    """Depths of all dots, arrays of shape (dots,) [m]."""

    depths: Array
    stds: Array
    dof: float
    without_rows: Array  # depths without levelling by rows
    of_cores: Array  # depths of the middles of the floors

    @property
    def has_level_floor(self) -> Mask:
        """Which dots have a level floor."""
        falls = np.abs(self.of_cores - self.depths) + self.stds
        return np.asarray(falls < _LEVEL_FLOOR * self.depths)

    def compute_depth_changes(self, dot_indices: NDArray[np.intp]) -> Array:
        """Return the changes of the depths of some dots by both other ways, shape (2, chosen)."""
        again = np.stack([self.without_rows, self.of_cores])[:, dot_indices]
        return again - self.depths[dot_indices]


def measure_dots(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    options: EvaluationOptions = AS_FOUND,
    key: str = "dot_depth",
) -> Evaluation:
    """Depth of every dot, hole or crater that lies wholly in a map, over the surface beside it.

    Its floor is the inner half of its width at half depth, and must be level.

    Raises
    ------
    MetrologyError
        If the scan is a profile, shows no dots, or most of them have no level floor; or if
        `options` names dots that it does not show.
    """
    if isinstance(scan, ScannedProfile):
        raise MetrologyError("dots and craters must be seen in a map, got a profile")
    known = np.isfinite(scan.height)
    z = scan.height[find_nearest_known(known)]
    dots = _find_dots_and_reference(scan, z, known, options)
    level = level_map(z, dots.reference, 2)
    rows = level_rows(level, dots.reference)
    regions = _find_height_regions(dots, known)
    depths = _measure_dot_depths(dots, regions, level, rows)
    is_cut = _find_cut_dots(dots)
    is_measured = _find_sufficiently_measured_dots(dots, known)
    kept = np.flatnonzero(depths.has_level_floor & ~is_cut & is_measured)
    counted = NoteKind.DOTS_KEPT.make_note(
        kept=len(kept), total=len(dots.numbers), cut=is_cut.sum()
    )
    if 2 * len(kept) <= np.sum(~is_cut):
        raise MetrologyError(f"most dots and craters must have a level floor, got: {counted}")
    kept = _select_requested_dots(kept, options.edges)
    notes = [counted]
    slope = compute_plane_slope(scan, dots.reference)
    name = key.replace("_", " ")
    found = []
    for depth, std in zip(depths.depths[kept].tolist(), depths.stds[kept].tolist(), strict=True):
        found.append(Estimate(depth, std, depths.dof))
    changes = depths.compute_depth_changes(kept)
    average_noise = float(np.sqrt(np.mean(depths.stds[kept] ** 2) / len(kept)))
    average_form = _make_form_component(changes.mean(axis=1), average_noise)
    tilt = list_tilt_components(float(np.mean(depths.depths[kept])), slope)
    average = partial(
        average_profiles,
        f"{name}, mean",
        found,
        instrument,
        [average_form, *tilt],
        averaged_items="dots",
    )
    centres: Any = ndimage.center_of_mass(dots.labels > 0, dots.labels, kept + 1)
    places: list[tuple[float, float]] = list(centres)  # one for each label
    features = []
    for estimate, (y, x), change in zip(found, places, changes.T, strict=True):
        at_place = f"{name} at {x * scan.dx * 1e6:.4g}, {y * scan.dy * 1e6:.4g} um"
        form = _make_form_component(change, estimate.std)
        others = [form, *list_tilt_components(estimate.value, slope)]
        features.append(_make_depth_with_budget(at_place, estimate, others, instrument))
    most_floor = np.argmax(np.isin(regions.floor, kept + 1).sum(axis=1))
    return Evaluation(
        values=collect_numbered_features(key, features, average, notes),
        convention="each dot or crater by the mean of the inner half of its width at half depth, "
        "over the surface beside it, levelled row by row, "
        f"{dots.exclusion * 1e6:.3g} um kept from every edge",
        notes=tuple(notes),
        shown=Shown(scan.x, rows[most_floor]),
    )


def _find_dots_and_reference(
    scan: HeightMap, filled_heights: Array, known: Mask, options: EvaluationOptions
) -> _Dots:
    """Find the dots of a map; its surface is levelled without them, and they are sought again.

    `filled_heights`, shape (ny, nx), are the heights with missing ones filled [m].
    """
    pitch = (scan.dy, scan.dx)
    reference = find_bulk_points(filled_heights, known)
    for _ in range(TURNS // 2):
        calm = _remove_lone_points(level_map(filled_heights, reference, 2), reference)
        labels = _label_dots(calm, scan.source)
        within = ndimage.distance_transform_edt(labels > 0, sampling=pitch)
        outside = ndimage.distance_transform_edt(labels == 0, sampling=pitch)
        exclusion = options.exclusion or 0.5 * min(float(within.max()), float(outside.max()))
        reference = known & ~calm.outstanding_points & (outside > exclusion)
    return _Dots(labels, reference, within, outside, exclusion)


@dataclass(frozen=True)
class _CalmSurface:
    """A map over the median of its reference, without single points that stand out."""

    heights: Array  # shape (ny, nx); m
    least: float  # height from which a point stands out [m]

    @property
    def outstanding_points(self) -> Mask:
        """Points that stand out to either side."""
        return np.asarray(np.abs(self.heights) > self.least)


def _remove_lone_points(levelled_heights: Array, reference: Mask) -> _CalmSurface:
    """Remove single points that stand out from a levelled map, shape (ny, nx) [m]."""
    beside = levelled_heights[reference]
    heights = ndimage.median_filter(levelled_heights - np.median(beside), 3)
    scatter = max(estimate_robust_scale(beside), LEAST_SCATTER)
    return _CalmSurface(heights, _STAND_OUT * scatter)


def _label_dots(calm: _CalmSurface, source: str) -> Labels:
    """Return the numbers of dots: what stands out to the side where most does.

    Each reaches as far down as half of its own height.
    """
    side = np.sign(calm.heights[calm.outstanding_points].sum())
    tall = calm.heights * side
    islands, count = ndimage.label(tall > calm.least)
    if not count:
        raise MetrologyError(
            f"dots and craters must stand out {_STAND_OUT:g} times over the scatter of the surface "
            f"beside them, got none [{source}]"
        )
    tallest = ndimage.maximum(tall, islands, np.arange(count + 1))
    above_half = tall > 0.5 * tallest[islands]
    return np.asarray(ndimage.label((islands > 0) & above_half)[0])


def _find_height_regions(dots: _Dots, known: Mask) -> _Regions:
    """Return where the heights of dots and of the surface beside them are taken."""
    labels = dots.labels
    widest = np.append(1.0, ndimage.maximum(dots.within, labels, dots.numbers))
    depth_within = dots.within / widest[labels]
    floor = np.where(known & (depth_within > _FLOOR), labels, 0)
    # the surface beside a dot is nearer to it than to another, and as wide as the widest
    is_near = dots.outside < dots.exclusion + dots.within.max()
    nearest = labels[find_nearest_known(labels > 0)]
    return _Regions(
        floor=floor,
        core=np.where(depth_within > _CORE, floor, 0),
        beside=np.where(dots.reference & is_near, nearest, 0),
    )


def _measure_dot_depths(
    dots: _Dots, regions: _Regions, levelled_map: Array, levelled_rows: Array
) -> _Depths:
    """Measure the depths of all dots on a map [m], levelled as a whole and row by row."""
    weights = _iterate_floor_weights(dots.reference, dots.labels, regions.floor, regions.beside)
    stds = estimate_std_of_row_sums(weights, levelled_rows, dots.reference)
    # as many as would fit into what lies beside them, less the form of the map
    usual_floor = max(np.median(np.bincount(regions.floor[regions.floor > 0])), 1)
    dof = max(float(dots.reference.sum()) / usual_floor - _TERMS_OF_FORM, 1.0)
    numbers = dots.numbers

    def compute_depths(heights: Array, inner: Labels) -> Array:
        """Return by how much mean heights within and beside dots differ, shape (dots,) [m]."""
        of_inner = ndimage.mean(heights, inner, numbers)
        return np.asarray(np.abs(of_inner - ndimage.mean(heights, regions.beside, numbers)))

    with np.errstate(invalid="ignore"):  # of what has no points the mean is none
        return _Depths(
            depths=compute_depths(levelled_rows, regions.floor),
            stds=stds,
            dof=dof,
            without_rows=compute_depths(levelled_map, regions.floor),
            of_cores=compute_depths(levelled_rows, regions.core),
        )


def _iterate_floor_weights(
    reference: Mask, labels: Labels, floor: Labels, beside: Labels
) -> Iterator[Array]:
    """Yield the weights of the points of its rows in the height of each floor over what is beside.

    The lines of the rows go through other points, too.
    """
    lines = build_row_lines(reference)
    for number, (own_rows, _) in enumerate(
        ndimage.find_objects(np.maximum(labels, beside)), start=1
    ):
        inner = floor[own_rows] == number
        outer = beside[own_rows] == number
        direct = inner / max(inner.sum(), 1) - outer / max(outer.sum(), 1)
        own_lines = lines[:, own_rows]
        # the transpose of levelling: lines through all points take from those of the reference
        yield direct - sum_weighted_row_lines(reference[own_rows] * own_lines, own_lines, direct)


def _find_cut_dots(dots: _Dots) -> Mask:
    """Return which dots the border of the map cuts, shape (dots,)."""
    labels = dots.labels
    border = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    return np.isin(dots.numbers, border)


def _find_sufficiently_measured_dots(dots: _Dots, known: Mask) -> Mask:
    """Return which dots have enough of their own points measured, shape (dots,).

    Raises
    ------
    MetrologyError
        If none has.
    """
    points = np.bincount(dots.labels.ravel())[1:]
    measured = np.bincount(dots.labels[known], minlength=len(points) + 1)[1:]
    is_measured = measured >= _LEAST_MEASURED * points
    if not is_measured.any():
        best = int(np.argmax(measured / points))
        raise MetrologyError(
            f"dots and craters must have {_LEAST_MEASURED:.0%} of their own points measured, got "
            f"{measured[best]:,} of {points[best]:,} at most"
        )
    return np.asarray(is_measured)


def _select_requested_dots(
    kept: NDArray[np.intp], requested_numbers: Sequence[int] | None
) -> NDArray[np.intp]:
    """Return the kept dots that the options name, counted from 1; all where they name none."""
    if not requested_numbers:
        return kept
    if max(requested_numbers) > len(kept):
        raise MetrologyError(
            f"edges must name some of the {len(kept)} dots, got {requested_numbers}"
        )
    return np.asarray(kept[np.array(requested_numbers) - 1])


def _make_depth_with_budget(
    name: str, estimate: Estimate, others: Sequence[Component], instrument: Instrument
) -> Measured:
    """Add its budget to the depth of a dot; `others` are the components beside its noise."""
    noise = Component(
        Source.NOISE,
        estimate.std,
        estimate.dof,
        "autocovariance of the surface beside it, and what the lines of its rows leave",
    )
    return make_measured_with_instrument(name, estimate.value, [noise], instrument, others)


def _make_form_component(depth_changes: Array, noise_std: float) -> Component:
    """Make the component that the form leaves open of a depth, a rectangle.

    It is the largest change by another levelling or part of a floor, less what noise alone changes
    [m].
    """
    beyond_noise = max(float(np.max(depth_changes**2)) - 3.0 * noise_std**2, 0.0)
    return Component(
        Source.FORM,
        float(np.sqrt(beyond_noise / 3.0)),
        how="change without levelling by rows, or by the middle of the floors, rectangular",
    )
