"""Ridges and grooves.

All features of each profile are measured, or those of a map where its profiles do not agree.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.attempts import Attempts, Evaluated, evaluate_each, list_results
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    Measured,
    ScalePowers,
    Source,
    average_profiles,
    list_tilt_components,
    make_measured_with_instrument,
)
from stepblocks.inspect.dots import measure_dots
from stepblocks.inspect.evaluation import (
    AS_FOUND,
    Evaluation,
    EvaluationOptions,
    Shown,
    Window,
)
from stepblocks.inspect.found_edges import FoundEdge, find_edges
from stepblocks.inspect.groove_profile import MeasuredProfile, ProfileKind, measure_profile_features
from stepblocks.inspect.map_levels import is_periodic
from stepblocks.inspect.masked_step import evaluate_masked_step
from stepblocks.inspect.noise import Array
from stepblocks.inspect.notes import Note, NoteKind
from stepblocks.inspect.profiles import (
    LEAST_SHARE,
    Crossings,
    collect_numbered_features,
    keep_profiles_that_agree,
    list_scan_directions,
    sample_profiles,
)
from stepblocks.scans.scan import HeightMap, ScannedProfile

# profiles of a map that are evaluated first: of half that agree, two of them do but once in thirty
_TRIED = 8
_LEAST_ALIKE = 2  # of those
_SLACK_OF_WIDTH = 0.25  # of its width, by which a feature may lie elsewhere in a profile [1]
_SLACK_OF_STEPS = 0.02  # of the spread of single steps, by which one may [1]
# of the radius of a stylus, by which a wall stands farther out at most [1]: 1/cos - tan of 30 deg
_CONTACT = 0.58
_RULE = "profiles must agree on the features that they cross"
_WIDTH_POWERS = ScalePowers(vertical=0.0, lateral=1.0)

Crossing = Evaluated[ScannedProfile, list[FoundEdge]]
Measurement = Evaluated[ScannedProfile, MeasuredProfile]


class UnlikeError(MetrologyError):
    """A scan shows a feature well, and it is not the one that was asked for."""


@dataclass(frozen=True)
class _Asked:
    """What is asked of a scan of ridges or grooves."""

    instrument: Instrument
    options: EvaluationOptions
    key: str  # of the characteristic
    sign: float  # -1 of grooves, 1 of ridges, 0 of either

    @property
    def label(self) -> str:
        """What a person calls the characteristic."""
        return self.key.replace("_", " ")

    @property
    def allows_whole_map(self) -> bool:
        """Whether no option requires an evaluation profile by profile."""
        options = self.options
        followed = (options.along, options.begin, options.end, options.degree, options.edges)
        return all(option is None for option in followed)


def measure_groove(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    options: EvaluationOptions = AS_FOUND,
    key: str = "groove_depth",
    sign: float = 0.0,
) -> Evaluation:
    """Depth of all grooves or ridges of a scan.

    It is by type A1 or A2 where their windows fit, and otherwise on a masked polynomial. A map
    whose rows do not agree is evaluated across its columns, then by two levels or by dots.

    Parameters
    ----------
    scan : ScannedProfile or HeightMap
    instrument : Instrument
    options : EvaluationOptions
    key : str
        Of the characteristic; of a standard, ``depth``, dots count as well.
    sign : float
        -1 of grooves, 1 of ridges, 0 of either.

    Returns
    -------
    Evaluation

    Raises
    ------
    MetrologyError
        With the reason why the profiles cannot be evaluated, if nothing else can.
    UnlikeError
        If the scan shows a ridge where a groove is asked for, or a groove for a ridge.
    """
    asked = _Asked(instrument, options, key, sign)
    refusals = []
    for evaluate in _list_evaluation_functions(scan, asked):
        try:
            return evaluate()
        except UnlikeError:
            raise
        except MetrologyError as error:
            refusals.append(str(error))
    raise MetrologyError(refusals[0])


def _list_evaluation_functions(
    scan: ScannedProfile | HeightMap, asked: _Asked
) -> list[Callable[[], Evaluation]]:
    """Return the ways in which a scan can be evaluated, in the order in which they are tried."""
    ways: list[Callable[[], Evaluation]] = []
    for directed in list_scan_directions(scan, asked.options.along):
        ways.append(partial(_measure_profile_by_profile, directed, asked))
    if isinstance(scan, HeightMap) and asked.allows_whole_map:
        ways.append(partial(evaluate_masked_step, scan, asked.instrument, asked.options, asked.key))
        if asked.key == "depth":  # of a standard: a hole is no groove of a block
            ways.append(partial(measure_dots, scan, asked.instrument, asked.options, asked.key))
    return ways


def _measure_profile_by_profile(scan: ScannedProfile | HeightMap, asked: _Asked) -> Evaluation:
    """Measure all features of each profile, and average those that the profiles agree on."""
    sampled = sample_profiles(scan, asked.options)
    rows = sampled.rows
    notes = sampled.notes
    crossings = _find_edges_of_profiles(rows)
    measure = partial(measure_profile_features, asked.options)
    _refuse_disagreeing_profiles(crossings.evaluated, measure)
    most_refused = LEAST_SHARE * len(rows) - len(crossings.refusals)
    measurements = _drop_edges_from_attempts(
        evaluate_each(measure, crossings.evaluated, most_refused)
    )
    kind = _find_most_common_kind(measurements.results)
    alike = _select_profiles_of_kind(measurements.evaluated, kind)
    crossing_others = 0
    for profile in measurements.results:
        if len(profile.features) > kind.features:
            crossing_others += 1
    if crossing_others:
        notes.append(
            NoteKind.OTHER_FEATURES_CROSSED.make_note(
                crossing=crossing_others,
                total=len(measurements.results),
                evaluated=kind.features,
            )
        )
    attempts = Attempts(alike, crossings.refusals + measurements.refusals)
    kept = keep_profiles_that_agree(attempts, _collect_feature_crossings(alike, kind), rows, notes)
    profiles = list_results(kept)
    spans = np.array([profile.spans for profile in profiles])
    is_single_step = not np.isfinite(spans).all()  # steps have neither width nor pitch
    if is_single_step:
        _refuse_periodic_map(scan)
    slope = _estimate_usual_slope(kept)
    features = _average_each_feature(profiles, kind.features, slope, asked)
    if not is_single_step:
        _refuse_wrong_feature_sign(profiles, asked)
    average = partial(_average_over_features, asked.label, features, asked.instrument)
    values = collect_numbered_features(asked.key, features, average, notes)
    if not is_single_step and kind.features == 1:
        spacing = kept[0].item.spacing
        name = "feature_width"
        if asked.sign:
            name = f"{asked.key.split('_')[0]}_width"
        values[name] = _average_feature_width(profiles, spans, spacing, features[0].value, asked)
    _add_spike_note(profiles, notes)
    return Evaluation(
        values=values,
        convention=_describe_convention(kind),
        notes=tuple(notes),
        shown=_build_shown_profile(kept[0]),
    )


def _find_edges_of_profiles(
    profiles: list[ScannedProfile],
) -> Attempts[ScannedProfile, list[FoundEdge]]:
    """Find the edges of each profile; refused where most cross none."""
    crossings = evaluate_each(lambda row: find_edges(row.position, row.height), profiles)
    crossing = len(crossings.evaluated)
    if len(profiles) > 1 and len(crossings.refusals) > crossing:
        raise MetrologyError(
            f"{_RULE}, got {crossing} of {len(profiles)} that cross any, others since "
            f"{crossings.refusals[0]}"
        )
    return crossings


def _refuse_disagreeing_profiles(
    crossings: list[Crossing], measure: Callable[[Crossing], MeasuredProfile]
) -> None:
    """Refuse many profiles where no two of a few agree, before all are measured."""
    few = crossings[:: max(len(crossings) // _TRIED, 1)]
    measured = evaluate_each(measure, few).results
    kinds = [profile.kind for profile in measured]
    most_alike = max(map(kinds.count, kinds), default=0)
    if len(few) >= _TRIED and most_alike < _LEAST_ALIKE:
        raise MetrologyError(f"{_RULE}, got less than {_LEAST_ALIKE} of {len(few)} alike")


def _drop_edges_from_attempts(
    attempts: Attempts[Crossing, MeasuredProfile],
) -> Attempts[ScannedProfile, MeasuredProfile]:
    """Return measured profiles with the profiles themselves, without their edges."""
    evaluated = [Evaluated(success.item.item, success.result) for success in attempts.evaluated]
    return Attempts(evaluated, attempts.refusals)


def _find_most_common_kind(profiles: list[MeasuredProfile]) -> ProfileKind:
    """Return how many features most profiles show, and how they were evaluated."""
    kinds = [profile.kind for profile in profiles]
    in_order = sorted(set(kinds), key=lambda kind: (kind.features, kind.method))
    return max(in_order, key=kinds.count, default=ProfileKind(0, "", is_masked=False))


def _select_profiles_of_kind(
    measurements: list[Measurement], kind: ProfileKind
) -> list[Measurement]:
    """Return the profiles of a kind, without what they cross beside their usual features."""
    usual = []
    for measurement in measurements:
        if measurement.result.kind == kind:
            usual.append(measurement.result.spans)
    if not usual:
        return []
    places = np.median(np.array(usual)[..., 0], axis=0)
    selected = []
    for measurement in measurements:
        profile = measurement.result.keep_nearest_features(places)
        if profile.kind == kind:
            selected.append(Evaluated(measurement.item, profile))
    return selected


def _collect_feature_crossings(measurements: list[Measurement], kind: ProfileKind) -> Crossings:
    """Collect the heights and places of the features of profiles of a kind."""
    profiles = list_results(measurements)
    shape = (len(profiles), kind.features)
    spans = np.array([profile.spans for profile in profiles]).reshape(*shape, 2)
    begins = spans[..., 0]
    widths = spans[..., 1] - begins
    slack_of_steps = 0.0
    if begins.size:
        slack_of_steps = _SLACK_OF_STEPS * np.ptp(begins)
    slack = np.where(np.isfinite(widths), _SLACK_OF_WIDTH * widths, slack_of_steps)
    heights = np.array([profile.heights for profile in profiles]).reshape(shape)
    return Crossings(heights, begins, slack)


def _refuse_periodic_map(scan: ScannedProfile | HeightMap) -> None:
    """Refuse single steps of a map that repeats itself, since they are teeth of a grating."""
    if isinstance(scan, HeightMap) and is_periodic(scan.height):
        raise MetrologyError(
            "single steps must not repeat over a map, as the teeth of a grating do; a part of "
            "it without repetition can be evaluated"
        )


def _estimate_usual_slope(measurements: list[Measurement]) -> float:
    """Find the usual slope [1] of what was fitted to profiles: that of most pairs of points."""
    slopes = []
    for measurement in measurements:
        rises = np.diff(measurement.result.fitted) / np.diff(measurement.item.position)
        known = rises[np.isfinite(rises)]
        if len(known) > 0:
            slopes.append(float(np.median(known)))
    return float(np.median(slopes)) if slopes else 0.0


def _average_each_feature(
    profiles: list[MeasuredProfile], feature_count: int, face_slope: float, asked: _Asked
) -> list[Measured]:
    """Average the height of each feature over the profiles, whose faces have a slope [1]."""
    averages = []
    for index in range(feature_count):
        heights = []
        for profile in profiles:
            height = profile.features[index].feature.height
            heights.append(replace(height, value=abs(height.value)))
        form = Component(
            Source.FORM,
            _estimate_form_uncertainty(profiles, index),
            how="change by other windows or levelling, rectangular",
        )
        name = asked.label
        if feature_count > 1:
            name = f"{asked.label} {index + 1}"
        mean_height = float(np.mean([estimate.value for estimate in heights]))
        components = [form, *list_tilt_components(mean_height, face_slope)]
        averages.append(average_profiles(name, heights, asked.instrument, components))
    return averages


def _estimate_form_uncertainty(profiles: list[MeasuredProfile], feature_index: int) -> float:
    """Return the largest mean change of a height by another evaluation, as a rectangle [m].

    What noise alone changes is taken off.
    """
    features = [profile.features[feature_index] for profile in profiles]
    variances = [measured.feature.height.std**2 for measured in features]
    noise = float(np.mean(variances)) / len(profiles)
    changes_of_profiles = [measured.changes for measured in features]
    largest = 0.0
    # a profile that another evaluation refuses has fewer changes: the shortest list counts
    for changes in zip(*changes_of_profiles, strict=False):
        mean = float(np.mean(changes))
        largest = max(largest, mean**2)
    return float(np.sqrt(max(largest - 2.0 * noise, 0.0) / 3.0))


def _determine_feature_sign(profiles: list[MeasuredProfile]) -> float:
    """Return -1 where most profiles show a groove first, 1 where they show a ridge first."""
    return float(np.median(np.sign([profile.heights[0] for profile in profiles])))


def _refuse_wrong_feature_sign(profiles: list[MeasuredProfile], asked: _Asked) -> None:
    """Refuse a ridge where a groove is required, and a groove where a ridge is."""
    if not asked.sign or _determine_feature_sign(profiles) == asked.sign:
        return
    wanted, seen = "ridge", "groove"
    if asked.sign < 0.0:
        wanted, seen = seen, wanted
    raise UnlikeError(f"scan must show a {wanted}, got a {seen}: it is upside down, or beside it")


def _average_over_features(
    label: str, features: list[Measured], instrument: Instrument
) -> Measured:
    """Return the mean over features.

    Their scatter holds the noise of each; what the instrument owes is shared by all.
    """
    heights = np.array([feature.value for feature in features])
    scatter = float(heights.std(ddof=1) / np.sqrt(len(features)))
    forms = []
    for feature in features:
        forms += feature.list_component_stds(Source.FORM)
    parts = [
        Component(Source.SCATTER, scatter, len(features) - 1.0, f"over {len(features)} features"),
        Component(Source.FORM, float(np.mean(forms)), how="mean of theirs"),
    ]
    return make_measured_with_instrument(f"{label}, mean", float(heights.mean()), parts, instrument)


def _average_feature_width(
    profiles: list[MeasuredProfile], spans: Array, spacing: float, depth: float, asked: _Asked
) -> Measured:
    """Average the width of one feature over the profiles, at half of its height.

    `spans`, shape (profiles, 1, 2), are its edges, `spacing` is the sampling interval and `depth`
    its depth [m].
    """
    widths = (spans[..., 1] - spans[..., 0]).ravel()
    scatter = 0.0
    if len(widths) > 1:
        scatter = float(widths.std(ddof=1) / np.sqrt(len(widths)))
    features = [profile.features[0].feature for profile in profiles]
    left_open = np.array([(feature.unseen, feature.flanks) for feature in features])
    unseen, flanks = left_open.mean(axis=0)
    parts = [
        Component(
            Source.SAMPLING,
            float(np.hypot(spacing / np.sqrt(6.0), scatter)),
            how="one interval at either edge, rectangular",
        )
    ]
    if unseen > 0.0:
        how = "half of what was not measured there, rectangular"
        parts.append(Component(Source.MISSING, unseen / np.sqrt(3.0), how=how))
    walls = _locate_walls_behind_stylus_flanks(flanks, depth, asked.options)
    width = make_measured_with_instrument(
        f"width W of the {asked.label.split()[0]}, at half its height",
        float(widths.mean()),
        parts,
        asked.instrument,
        scale_powers=_WIDTH_POWERS,
    )
    return replace(
        width,
        value=width.value - _determine_feature_sign(profiles) * walls.inwards,
        components=(*width.components, walls.component),
    )


@dataclass(frozen=True)
class _Walls:
    """Where the walls of a groove stand beside what a stylus shows of them."""

    inwards: float  # by how much less wide the stylus shows the groove [m]
    component: Component  # what that leaves open


def _locate_walls_behind_stylus_flanks(
    half_flank_width: float, depth: float, options: EvaluationOptions
) -> _Walls:
    """Place the walls of a groove: a stylus shows an upright wall as a flank as wide as its cone.

    `half_flank_width` is half of both flanks' widths, and `depth` that of the groove [m].
    """
    cone = options.stylus_cone
    tip = options.stylus_radius or 0.0
    if cone is None:  # an optical instrument shows the wall at half its height
        how = "half of their width"
        return _Walls(0.0, Component(Source.FLANKS, half_flank_width / np.sqrt(3.0), how=how))
    # a flank wider than the cone shows it is that of the surface
    widest_shown = depth * np.tan(0.5 * cone) + 2.0 * tip
    shown = 0.0
    if half_flank_width < widest_shown:
        shown = half_flank_width
    half = 0.5 * shown + _CONTACT * tip
    how = "W with the walls in the middle of what the stylus shows of them, rectangular"
    # an upright wall, the usual one, lies at the very end of the rectangle, which 95 % of it leave
    # out: the interval is that of a normal law
    return _Walls(half, Component(Source.FLANKS, half / np.sqrt(3.0), how=how))


def _add_spike_note(profiles: list[MeasuredProfile], notes: list[Note]) -> None:
    """Say how many points were left out as spikes, if any."""
    left_out = sum(profile.rejected for profile in profiles)
    if left_out:
        points = sum(profile.points for profile in profiles)
        notes.append(NoteKind.SPIKES_LEFT_OUT.make_note(left_out=left_out, points=points))


def _describe_convention(kind: ProfileKind) -> str:
    """Say how the heights of a kind of profiles are defined."""
    if kind.is_masked:
        return f"{kind.method} beside the flanks, profile by profile"
    return f"ISO 5436-1 {kind.method}, profile by profile, unfiltered"


def _build_shown_profile(measurement: Measurement) -> Shown:
    """Return what a plot shows of a profile, levelled by the ends of what was fitted to it."""
    row = measurement.item
    profile = measurement.result
    windows: list[Window] = []
    for measured in profile.features:
        windows += measured.windows
    if not windows:
        last = float(row.position[-1])
        windows = [Window(span.begin, min(span.end, last), "") for span in profile.spans]
    ends = [0, -1]
    line = np.polynomial.Polynomial.fit(row.position[ends], profile.fitted[ends], 1)
    level = line(row.position)
    return Shown(row.position, row.height - level, tuple(windows), profile.fitted - level)
