"""Characteristics of a working edge: height, edge radius, burr, riser, and form of the faces."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.attempts import Attempts, evaluate_each, evaluate_if_possible
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    Measured,
    Source,
    average_profiles,
    list_tilt_components,
    make_measured_with_instrument,
)
from stepblocks.inspect.edge import (
    Edge,
    LevelledPoints,
    find_largest_edge,
    fit_edge,
    fit_step_height,
)
from stepblocks.inspect.edge_arc import RESOLVED, compute_edge_profile
from stepblocks.inspect.evaluation import (
    AS_FOUND,
    Evaluation,
    EvaluationOptions,
    Shown,
    Window,
)
from stepblocks.inspect.features import PAIR, Feature, fit_significant_features
from stepblocks.inspect.found_edges import find_edges
from stepblocks.inspect.levelling import LEAST_FACE
from stepblocks.inspect.noise import Array, Estimate, Refit, estimate_refit_std
from stepblocks.inspect.notes import Note, NoteKind, NotMeasuredReason
from stepblocks.inspect.profiles import (
    LEAST_SHARE,
    Crossings,
    keep_profiles_that_agree,
    list_scan_directions,
    sample_profiles,
)
from stepblocks.inspect.working_edge.burr import ZONE, Burr, measure_burr
from stepblocks.inspect.working_edge.choose import find_working_stretch
from stepblocks.inspect.working_edge.crossing import CrossedEdge, CrossedEdges
from stepblocks.inspect.working_edge.faces import (
    MeasuredFaces,
    iterate_face_profiles,
    measure_faces,
)
from stepblocks.inspect.working_edge.radius import average_radius
from stepblocks.inspect.working_edge.relief import measure_and_cover_relief
from stepblocks.inspect.working_edge.riser import ANGLE, STRAIGHTNESS, measure_riser
from stepblocks.scans.scan import HeightMap, ScannedProfile

_MOST_SLANT_ROWS = 40  # of a map, from which the direction of its edge is found
_LEAST_SLANT_ROWS = 3
_TURNED = 0.01  # slope of an edge over a map from which it is turned [1]
_MOST_REFITTED = 10  # profiles whose heights are fitted again
_WIDER = 2.0  # exclusion over the usual one, with which they are [1]
_LEVEL = 0.5e-3  # length of the level faces on either side of an edge that was seen [m]
_VALLEY = 1e-6  # depth of a valley at the foot of an edge that is none of its form [m]
_DEEPER = 2.0  # that it must be deeper than a burr is high [1]
_SURE = 2.0  # standard uncertainties that it must stand out by [1]
# what is measured where heights that are upside down show the foot of the edge
_OF_THE_UPPER_CORNER = ("burr", "edge_radius")
_WORTH = 0.02  # of the step, from which another feature in its scan is named [1]
# what the planes beside a second step would bend
_OF_THE_EDGE = ("step_height", "edge_radius", ANGLE, STRAIGHTNESS)


@dataclass(frozen=True)
class _TurnedProfiles:
    """Profiles of a scan across its edge."""

    rows: list[ScannedProfile]
    turn: float  # length across the edge over that along the row [1]
    scan: ScannedProfile | HeightMap  # what is asked for of it
    notes: list[Note]


@dataclass(frozen=True)
class _OtherFeatures:
    """Steps, ridges and grooves beside the edge that is evaluated."""

    features: list[Feature]

    @property
    def single_step_positions(self) -> list[float]:
        """Positions of the single steps along the profile [m]."""
        return [feature.begin for feature in self.features if feature.is_single_step]

    def make_note(self, is_evaluated_between: bool) -> Note:
        """Note what they are, and whether the edge was evaluated between its neighbours alone."""
        listed = []
        for feature in self.features:
            height = feature.height.value * 1e6
            listed.append(f"{height:+.3g} um at {feature.begin * 1e6:.4g} um")
        kind = NoteKind.ALSO_SHOWS
        if is_evaluated_between:
            kind = NoteKind.ALSO_SHOWS_STEPS
        return kind.make_note(features=", ".join(listed))


def measure_edge(
    scan: ScannedProfile | HeightMap, instrument: Instrument, options: EvaluationOptions = AS_FOUND
) -> Evaluation:
    """Measure a step across its edge, along the rows of a map, or its columns if these show it.

    Parameters
    ----------
    scan : ScannedProfile or HeightMap
    instrument : Instrument
    options : EvaluationOptions

    Returns
    -------
    Evaluation
        Height and radius of the edge, burr, riser where it slopes, and form of the faces of a map.

    Raises
    ------
    MetrologyError
        If the profiles show no edge, do not agree on it, or it is the wall of a notch or ridge.
    """
    refusals = []
    for directed in list_scan_directions(scan, options.along):
        try:
            return _measure_along_rows(directed, instrument, options)
        except MetrologyError as error:
            refusals.append(str(error))
    raise MetrologyError(refusals[0])


def _measure_along_rows(
    scan: ScannedProfile | HeightMap, instrument: Instrument, options: EvaluationOptions
) -> Evaluation:
    """Measure an edge that the rows of a scan cross."""
    relief = measure_and_cover_relief(scan, instrument, options)
    scan = relief.scan
    stretch = None
    if options.layout is not None:
        stretch = find_working_stretch(sample_profiles(scan, options).rows, options.layout)
    if stretch is not None:
        options = replace(options, begin=stretch.begin, end=stretch.end, layout=None)
    turned = _project_profiles_across_edge(scan, options)
    notes = turned.notes
    notes += relief.notes
    if stretch is not None:
        notes.append(
            NoteKind.WORKING_EDGE_ALONE.make_note(
                begin=stretch.begin * 1e6, end=stretch.end * 1e6, beside=stretch.beside
            )
        )
    crossed = _fit_agreeing_edges(turned, options)
    first = crossed.first_crossing
    values = {
        "step_height": _average_step_height(crossed, instrument),
        "edge_radius": average_radius(crossed, instrument, options.stylus_radius, notes),
    }
    riser = measure_riser(crossed, instrument, options.stylus_cone, notes)
    values |= riser.values
    missing = {**relief.missing, **riser.missing}
    surface = None
    if riser.values:
        surface = _extend_by_level_faces(first)
    beside = _find_other_features(first)
    _refuse_notch(beside, first)
    has_steps = bool(beside.single_step_positions)
    if has_steps and options.begin is None and options.end is None:
        values |= _measure_between_steps(turned, beside, first, instrument, options, values)
        notes.append(beside.make_note(is_evaluated_between=True))
    elif beside.features:
        notes.append(beside.make_note(is_evaluated_between=False))
    points = _locate_points_across_edge(turned, crossed)
    burr = measure_burr(
        points.across,
        points.level,
        crossed.compute_usual_height(),
        crossed.compute_usual_exclusion(),
    )
    if burr is None:
        missing["burr"] = NotMeasuredReason.UPPER_FACE_TOO_SHORT.format_message()
    else:
        values["burr"] = _make_burr_with_budget(burr, instrument, notes)
    if _has_valley_at_foot(points, crossed, burr):
        for key in _OF_THE_UPPER_CORNER:
            values.pop(key, None)
            missing[key] = NotMeasuredReason.VALLEY_AT_FOOT.format_message()
    faces = MeasuredFaces({}, {})
    if isinstance(turned.scan, HeightMap):
        seen = relief.remove_filled_points(turned.scan)
        faces = measure_faces(seen, points.across, first.edge.exclusion, instrument, notes)
    _add_left_out_note(crossed, notes)
    if not has_steps:
        _add_sharp_edge_note(crossed, notes)
    return Evaluation(
        values=values | faces.values | relief.values,
        convention=_describe_convention(crossed),
        notes=tuple(notes),
        shown=_build_shown_profile(first, crossed.shows_mostly_flanks),
        arc=surface is None,
        missing=missing,
        covered=faces.covered,
        surface=surface,
        faces=tuple(iterate_face_profiles(crossed)),
    )


def _project_profiles_across_edge(
    scan: ScannedProfile | HeightMap, options: EvaluationOptions
) -> _TurnedProfiles:
    """Return the profiles of a scan as they would be across its edge.

    Of a map only the part that is asked for is kept: faces and burr, too, are those of it.
    """
    sampled = sample_profiles(scan, options)
    rows = sampled.rows
    notes = sampled.notes
    if isinstance(scan, HeightMap):
        position = rows[0].position
        asked = (scan.x >= position[0]) & (scan.x <= position[-1])
        scan = replace(scan, height=np.where(asked, scan.height, np.nan))
    slant = _estimate_edge_slant(rows)
    turn = 1.0 / math.hypot(1.0, slant)
    if slant != 0.0:  # the profile across the edge is shorter than the row
        rows = [replace(row, position=row.position * turn) for row in rows]
        angle = math.degrees(math.atan(slant))
        notes.append(NoteKind.EDGE_TURNED.make_note(angle=angle))
    return _TurnedProfiles(rows, turn, scan, notes)


def _estimate_edge_slant(rows: list[ScannedProfile]) -> float:
    """Return how far the edge of a map moves along x per distance along y [1].

    It is 0 where it does not.
    """
    chosen = rows[:: max(len(rows) // _MOST_SLANT_ROWS, 1)]
    attempts = evaluate_each(lambda row: find_largest_edge(row.position, row.height), chosen)
    # of a ridge or groove the walls are as high: only those on one side are one edge
    rising: list[tuple[float, float]] = []
    falling: list[tuple[float, float]] = []
    for success in attempts.evaluated:
        place = success.item.offset, success.result.position
        if success.result.rising:
            rising.append(place)
        else:
            falling.append(place)
    places = np.array(max(rising, falling, key=len))
    if len(places) < _LEAST_SLANT_ROWS:
        return 0.0
    # by the median of the slopes between all rows: each place is known to a sample alone
    offsets, positions = places.T
    slant = _compute_median_slope(offsets, positions)
    if abs(slant) > _TURNED:
        return slant
    return 0.0


def _compute_median_slope(x: Array, y: Array) -> float:
    """Compute the median of slopes between all pairs of points, shape (n,), as Theil and Sen do.

    `scipy.stats` says the same, and takes as long to load as all the rest.
    """
    first, second = np.triu_indices(len(x), k=1)
    runs = x[second] - x[first]
    is_apart = runs != 0.0
    rises = y[second] - y[first]
    return float(np.median(rises[is_apart] / runs[is_apart]))


def _fit_agreeing_edges(turned: _TurnedProfiles, options: EvaluationOptions) -> CrossedEdges:
    """Fit an edge to each profile, and keep those that agree."""
    attempts = evaluate_each(
        lambda row: fit_edge(row.position, row.height, options.exclusion),
        turned.rows,
        LEAST_SHARE * len(turned.rows),
    )
    kept = keep_profiles_that_agree(
        attempts, _collect_edge_crossings(attempts), turned.rows, turned.notes
    )
    crossings = tuple(CrossedEdge(success.item, success.result) for success in kept)
    return CrossedEdges(crossings, isinstance(turned.scan, HeightMap))


def _collect_edge_crossings(attempts: Attempts[ScannedProfile, Edge]) -> Crossings:
    """Collect heights and places of the edges of profiles; a place may be off by the exclusion."""
    heights, places, slack = [], [], []
    for edge in attempts.results:
        heights.append(edge.height.value)
        places.append(edge.position)
        slack.append(edge.exclusion)
    return Crossings(_make_column(heights), _make_column(places), _make_column(slack))


def _make_column(values: Sequence[float]) -> Array:
    """Return values as a column, shape (n, 1)."""
    return np.array(values, dtype=np.float64).reshape(-1, 1)


def _average_step_height(crossed: CrossedEdges, instrument: Instrument) -> Measured:
    """Average the height of the step over the profiles."""
    form = Component(
        Source.FORM,
        _estimate_form_uncertainty(crossed),
        how="change with twice the exclusion, rectangular",
    )
    heights = [edge.height for edge in crossed.edges]
    slope = float(np.median([edge.tilt for edge in crossed.edges]))
    height = float(np.mean([estimate.value for estimate in heights]))
    components = [form, *list_tilt_components(height, slope)]
    return average_profiles("step height", heights, instrument, components)


def _estimate_form_uncertainty(crossed: CrossedEdges) -> float:
    """Return the change of the mean height when twice as much is excluded [m]."""
    refits = []
    for success in evaluate_each(
        _fit_step_with_wider_exclusion, crossed.sample_evenly(_MOST_REFITTED)
    ).evaluated:
        refits.append(Refit(success.item.edge.height, success.result))
    return estimate_refit_std(refits, 1.0)


def _fit_step_with_wider_exclusion(crossing: CrossedEdge) -> Estimate:
    """Return the height of a step with twice the exclusion [m]."""
    row = crossing.row
    return fit_step_height(row.position, row.height, _WIDER * crossing.edge.exclusion)


def _extend_by_level_faces(crossing: CrossedEdge) -> ScannedProfile:
    """Return an edge as it was scanned, between level faces.

    So nothing depends on the length of the scan.
    """
    row = crossing.row
    edge = crossing.edge
    points = crossing.levelled_points
    inside = np.abs(points.across) < edge.exclusion
    used = inside & np.isfinite(points.level) & ~edge.dropped
    order = np.argsort(points.across[used])
    across = points.across[used][order]
    level = points.level[used][order]
    known = np.concatenate([[-edge.exclusion], across, [edge.exclusion]])
    heights = np.concatenate([[0.0], level, [edge.height.value]])
    count = round(_LEVEL / row.spacing)
    position = np.arange(-count, count, dtype=np.float64) * row.spacing
    return ScannedProfile(position, np.interp(position, known, heights), row.source)


def _find_other_features(crossing: CrossedEdge) -> _OtherFeatures:
    """Find the steps, ridges and grooves that a profile shows beside its edge."""
    edge = crossing.edge
    points = crossing.levelled_points
    beside = np.abs(points.across) > edge.exclusion
    without_step = points.level - edge.height.value * (points.across > 0.0)
    residuals = np.where(beside, without_step, np.nan)

    def find_features_without_step(position: Array) -> Sequence[Feature]:
        """Measure the features of the heights without the step."""
        edges = find_edges(position, residuals)
        return fit_significant_features(position, residuals, edges, None, None).features

    features = []
    for feature in evaluate_if_possible(find_features_without_step, crossing.row.position) or ():
        is_high = abs(feature.height.value) > _WORTH * edge.height.value
        # else what the edge left open: the flank of that begins before what was left out
        is_clear = abs(feature.begin - edge.middle) > edge.exclusion + feature.flanks
        if is_high and is_clear:
            features.append(feature)
    return _OtherFeatures(features)


def _refuse_notch(other_features: _OtherFeatures, crossing: CrossedEdge) -> None:
    """Refuse the wall of a notch or ridge: a flank that another follows at once is no edge."""
    edge = crossing.edge
    rise = edge.sign * edge.height.value
    least = 2.0 * edge.exclusion + LEAST_FACE * crossing.row.spacing
    for feature in other_features.features:
        is_near = abs(feature.begin - edge.middle) < least
        falls_back = abs(feature.height.value + rise) < PAIR * abs(rise)
        if is_near and falls_back:
            raise MetrologyError(
                f"edge must have a face of {LEAST_FACE} points on either side, got a notch or ridge"
            )


def _measure_between_steps(
    turned: _TurnedProfiles,
    other_features: _OtherFeatures,
    crossing: CrossedEdge,
    instrument: Instrument,
    options: EvaluationOptions,
    values: dict[str, Measured],
) -> dict[str, Measured]:
    """Measure an edge between the steps beside it, since a second step bends the planes.

    Of what was measured, `values`, those are returned that the planes say.
    """
    middle = crossing.edge.middle
    position = crossing.row.position
    before, behind = position[0], position[-1]
    for step in sorted(other_features.single_step_positions):
        if step < middle:
            before = step
        elif step > middle:
            behind = step
            break
    part = replace(options, begin=before / turned.turn, end=behind / turned.turn, layout=None)
    narrow = _measure_along_rows(turned.scan, instrument, part).values
    kept = {}
    for key, measured in narrow.items():
        if key in values and key in _OF_THE_EDGE:
            kept[key] = measured
    return kept


def _locate_points_across_edge(turned: _TurnedProfiles, crossed: CrossedEdges) -> LevelledPoints:
    """Return where the points of the whole scan lie beside the edge, shape (ny, nx) [m]."""
    scan = turned.scan
    if isinstance(scan, ScannedProfile):
        points = crossed.first_crossing.levelled_points
        return LevelledPoints(points.across[np.newaxis], points.level[np.newaxis])
    y = np.array([crossing.row.offset for crossing in crossed.crossings])
    offsets = [edge.offset for edge in crossed.edges]
    middle = _evaluate_fitted_line(y, crossed.edge_positions, scan.y)
    offset = _evaluate_fitted_line(y, offsets, scan.y)
    x = scan.x * turned.turn
    tilt = float(np.median([edge.tilt for edge in crossed.edges]))
    return LevelledPoints(
        across=crossed.first_crossing.edge.sign * (x - middle[:, np.newaxis]),
        level=scan.height - offset[:, np.newaxis] - tilt * x,
    )


def _evaluate_fitted_line(y: Array, values: list[float], at_y: Array) -> Array:
    """Return a line through values of rows at places of other rows, all lengths in m."""
    if np.ptp(y) > 0.0:
        return np.asarray(np.polyval(np.polyfit(y, values, 1), at_y), dtype=np.float64)
    return np.full(len(at_y), values[0])


def _has_valley_at_foot(points: LevelledPoints, crossed: CrossedEdges, burr: Burr | None) -> bool:
    """Tell whether the lower face falls at the foot of the edge by far more than a burr stands up.

    No block has a valley there: heights that are upside down show their burr so.
    """
    step = crossed.compute_usual_height()
    exclusion = crossed.compute_usual_exclusion()
    # another step in the scan bends the planes: the lower face counts as it lies beside the edge
    across = points.across
    beside = (across < -exclusion) & (across > -exclusion - 2.0 * ZONE)
    beside &= np.isfinite(points.level)
    if beside.sum() < LEAST_FACE:
        return False
    line = np.polynomial.Polynomial.fit(across[beside], points.level[beside], 1)
    valley = measure_burr(-across, step - points.level + line(across), step, exclusion)
    if valley is None:
        return False
    standing = 0.0
    if burr is not None:
        standing = burr.height.value
    surely = valley.height.value - _SURE * float(np.hypot(valley.height.std, valley.noise))
    return surely > _VALLEY + _DEEPER * standing


def _make_burr_with_budget(burr: Burr, instrument: Instrument, notes: list[Note]) -> Measured:
    """Add its budget to the height of a burr; appends to `notes` what is said of spikes."""
    if burr.spikes:
        kind = NoteKind.SPIKE_AT_EDGE
        if burr.spikes > 1:
            kind = NoteKind.SPIKES_AT_EDGE
        notes.append(kind.make_note(spikes=burr.spikes, highest=burr.highest_spike * 1e6))
    components = [
        Component(Source.NOISE, burr.height.std, how="valleys of the face and the lower face"),
        Component(Source.PEAK, burr.noise, how="half of what noise alone shows"),
        Component(Source.SAMPLING, burr.sampling, how="a peak between two points, rectangular"),
    ]
    return make_measured_with_instrument("burr", burr.height.value, components, instrument)


def _add_left_out_note(crossed: CrossedEdges, notes: list[Note]) -> None:
    """Say how many points were left out, if any."""
    left_out = sum(edge.rejected for edge in crossed.edges)
    if left_out:
        notes.append(NoteKind.POINTS_LEFT_OUT.make_note(left_out=left_out))


def _add_sharp_edge_note(crossed: CrossedEdges, notes: list[Note]) -> None:
    """Say up to which radius an edge may be that is sharper than the sampling resolves."""
    least = RESOLVED * crossed.spacing
    if any(edge.radius.value < least for edge in crossed.edges):
        limit = max(edge.radius_limit for edge in crossed.edges)
        notes.append(NoteKind.SHARP_EDGE.make_note(limit=limit * 1e6))


def _describe_convention(crossed: CrossedEdges) -> str:
    """Say how height and radius are defined."""
    exclusion = crossed.first_crossing.edge.exclusion
    convention = (
        f"two planes with a common slope, {exclusion * 1e6:.4g} um excluded on either side "
        "of the edge; radius by arc"
    )
    if crossed.shows_mostly_flanks:
        convention += " of the corner beside its flank"
    return convention


def _build_shown_profile(crossing: CrossedEdge, shows_mostly_flanks: bool) -> Shown:
    """Return what a plot shows of a profile: faces, ideal edge and spikes.

    The ideal edge has the fitted radius, but a sharp corner where profiles show mostly flanks.
    """
    row = crossing.row
    edge = crossing.edge
    x = row.position
    before = edge.middle - edge.exclusion
    behind = edge.middle + edge.exclusion
    level = row.height - edge.tilt * x
    lower = x > behind
    if edge.rising:
        lower = x < before
    corner = 0.0
    if not shows_mostly_flanks:
        corner = max(edge.radius.value, 0.0)
    fitted = compute_edge_profile(
        edge.sign * x, edge.sign * edge.position, edge.height.value, corner
    )
    return Shown(
        position=x,
        height=level - np.nanmedian(level[lower]),
        windows=(Window(float(x[0]), before, "face"), Window(behind, float(x[-1]), "face")),
        fitted=fitted,
        dropped=edge.dropped,
    )
