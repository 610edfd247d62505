"""All ridges and grooves of one profile, each by type A1 or A2 where its windows fit."""

from dataclasses import dataclass, replace
from enum import Enum
from functools import partial

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.attempts import Evaluated, evaluate_if_possible
from stepblocks.inspect.evaluation import EvaluationOptions, Window
from stepblocks.inspect.features import (
    Feature,
    Levels,
    fit_feature_heights,
    fit_significant_features,
)
from stepblocks.inspect.found_edges import FoundEdge, find_edges
from stepblocks.inspect.levelling import LEAST_FACE
from stepblocks.inspect.noise import Array, Estimate, Mask
from stepblocks.inspect.type_a1 import A1Kind, Span, TypeA1, estimate_apex_height, evaluate_type_a1
from stepblocks.scans.scan import ScannedProfile

_FITS = 2.0  # scatter about type A1 over that about a polynomial, up to which type A1 is taken [1]
_LEVEL = 0.1  # of a step that its faces may be off, and of a face over which they may be [1]
# of steps in one direction, by the slope between them, from which they may be a sawtooth [1]
_TAKEN_BACK = 0.5
_MOST_DROPPED = 0.2  # part of the points of a profile that may be spikes [1]
_MOST_HIDDEN = 3  # times that features are sought beside those that were found
_APEX, _WIDER_APEX = 1.0 / 3.0, 0.5  # parts of a domed top through which its arc is laid [1]
_DEGREE_NAMES = {1: "line", 2: "parabola", 3: "cubic"}
_HIGHEST_DEGREE = 3


class MethodKind(Enum):
    """How the height of a feature is defined."""

    A1 = "type A1"
    A2 = "type A2"
    A2_ON_POLYNOMIAL = "type A2 on a masked {name}"
    POLYNOMIAL = "masked {name}"


@dataclass(frozen=True)
class Method:
    """By what the height of a feature was evaluated."""

    kind: MethodKind
    degree: int  # of the polynomial that levels the profile

    @property
    def label(self) -> str:
        """What a person calls it."""
        return self.kind.value.format(name=_DEGREE_NAMES[self.degree])

    @property
    def is_domed(self) -> bool:
        """Whether the top of the feature is a dome."""
        return self.kind in (MethodKind.A2, MethodKind.A2_ON_POLYNOMIAL)


@dataclass(frozen=True)
class MeasuredFeature:
    """What one profile says of one feature."""

    feature: Feature  # its height by what its windows allow
    changes: tuple[float, ...]  # of the height by other windows or levellings [m]
    method: Method
    windows: tuple[Window, ...]
    outliers: int  # of the windows

    @property
    def span(self) -> Span:
        """Where its edges lie."""
        return Span(self.feature.begin, self.feature.end)


@dataclass(frozen=True)
class ProfileKind:
    """How many features a profile shows, and how they were evaluated."""

    features: int
    method: str  # labels of all methods
    is_masked: bool  # whether a method is a polynomial alone


@dataclass(frozen=True)
class MeasuredProfile:
    """What one profile says."""

    features: tuple[MeasuredFeature, ...]
    fitted: Array  # shape (n,); m
    rejected: int
    points: int  # with the rejected

    @property
    def kind(self) -> ProfileKind:
        """How many features it shows, and how they were evaluated."""
        labels = set()
        is_masked = False
        for measured in self.features:
            labels.add(measured.method.label)
            if measured.method.kind is MethodKind.POLYNOMIAL:
                is_masked = True
        return ProfileKind(len(self.features), " and ".join(sorted(labels)), is_masked)

    @property
    def spans(self) -> list[Span]:
        """Edges of each feature."""
        return [measured.span for measured in self.features]

    @property
    def heights(self) -> list[float]:
        """Height of each feature [m]."""
        return [measured.feature.height.value for measured in self.features]

    def keep_nearest_features(self, positions: Array) -> "MeasuredProfile":
        """Keep the feature nearest to each place [m]; all where there are no more than places."""
        if len(self.features) <= len(positions):
            return self
        begins = np.array([span.begin for span in self.spans])
        nearest = set()
        for place in positions:
            nearest.add(int(np.argmin(abs(begins - place))))
        kept = [self.features[index] for index in sorted(nearest)]
        return replace(self, features=tuple(kept))


def measure_profile_features(
    options: EvaluationOptions, crossing: Evaluated[ScannedProfile, list[FoundEdge]]
) -> MeasuredProfile:
    """Measure all features of a profile, each by what its windows allow.

    Each is measured again with other windows, for the form.

    Parameters
    ----------
    options : EvaluationOptions
        Levelling, exclusion and which features.
    crossing : Evaluated
        A profile with the edges that were found in it.

    Returns
    -------
    MeasuredProfile

    Raises
    ------
    MetrologyError
        If no feature is significant, the features that are asked for are not there, or the faces
        beside one are not level.
    """
    x = crossing.item.position
    z = crossing.item.height
    levels = _measure_with_hidden_features(x, z, crossing.result, options)
    chosen = _choose_feature_indices(levels, options)
    other_heights = _fit_alternative_heights(x, z, levels, options)
    extent = _compute_detrended_height_range(x, z)
    features = []
    for index in chosen:
        feature = levels.features[index]
        changes = []
        for heights in other_heights:
            changes.append(float(heights[index]) - feature.height.value)
        measured = _measure_feature(x, z, levels, feature, tuple(changes), options)
        height = abs(measured.feature.height.value)
        if height > (1.0 + _LEVEL) * extent:
            raise MetrologyError(
                f"step must not exceed the range of the profile, {extent * 1e9:.4g} nm, got "
                f"{height * 1e9:.4g} nm: its features are too near for a reference"
            )
        features.append(measured)
    rejected = levels.rejected
    # a dome is off a level top, and no spike
    if any(measured.method.is_domed for measured in features):
        rejected = sum(measured.outliers for measured in features)
    return MeasuredProfile(tuple(features), levels.level, rejected, levels.point_count)


def _measure_with_hidden_features(
    x: Array, z: Array, edges: list[FoundEdge], options: EvaluationOptions
) -> Levels:
    """Measure the features between edges, and those that their fit left out as spikes."""
    measure = partial(_fit_features_between_edges, x, z, options)
    levels = measure(edges)
    for _ in range(_MOST_HIDDEN):
        hidden = _find_hidden_edges(x, z, levels)
        if not hidden:
            break
        all_edges = sorted([*levels.edges, *hidden], key=lambda edge: edge.position)
        again = evaluate_if_possible(measure, all_edges)
        if again is None or again.rejected >= levels.rejected:
            break
        levels = again
    return levels


def _fit_features_between_edges(
    x: Array, z: Array, options: EvaluationOptions, edges: list[FoundEdge]
) -> Levels:
    """Measure the features between edges as the options say."""
    return fit_significant_features(x, z, edges, options.degree, options.exclusion)


def _find_hidden_edges(x: Array, z: Array, levels: Levels) -> list[FoundEdge]:
    """Find edges that the fit of much larger features left out as if they were spikes."""
    beside = _mark_points_beside_features(x, z, levels)
    padded = np.concatenate([[0], beside & ~levels.used, [0]]).astype(int)
    ends = np.flatnonzero(np.diff(padded))
    run_lengths = ends[1::2] - ends[::2]
    if not (run_lengths >= LEAST_FACE).any():
        return []
    residuals = np.where(beside, z - levels.level, np.nan)
    return evaluate_if_possible(partial(find_edges, x), residuals) or []


def _mark_points_beside_features(x: Array, z: Array, levels: Levels) -> Mask:
    """Return the measured points away from edges and domed tops, which hide no edges."""
    beside = np.isfinite(z)
    step = float(x[1] - x[0])
    for edge in levels.edges:
        slack = edge.end - edge.begin + LEAST_FACE * step
        beside &= (x < edge.begin - slack) | (x > edge.end + slack)
    for feature in levels.features:
        if feature.is_single_step:
            continue
        span = Span(feature.begin, feature.end)
        residuals = z - levels.level
        if estimate_apex_height(x, residuals, feature.height.value, span, _WIDER_APEX) is not None:
            beside &= (x < feature.begin) | (x > feature.end)
    return beside


def _choose_feature_indices(levels: Levels, options: EvaluationOptions) -> list[int]:
    """Return the indices of the features that the options name; all by default."""
    chosen = []
    for index in range(len(levels.features)):
        if options.edges is None or index + 1 in options.edges:
            chosen.append(index)
    if not chosen:
        raise MetrologyError(
            f"edges must name features of the {len(levels.features)} found, got {options.edges}"
        )
    return chosen


def _compute_detrended_height_range(x: Array, z: Array) -> float:
    """Return the range of the heights of a profile over a line through them [m]."""
    known = np.isfinite(z)
    line = np.polynomial.Polynomial.fit(x[known], z[known], 1)
    return float(np.ptp(z[known] - line(x[known])))


def _fit_alternative_heights(
    x: Array, z: Array, levels: Levels, options: EvaluationOptions
) -> list[Array]:
    """Return heights by the next polynomial, and with more kept out at the edges [m].

    Each has the shape (features,); what cannot be evaluated is left out.
    """
    next_degree = levels.degree + 1 if levels.degree < _HIGHEST_DEGREE else 2
    same_degree = levels.degree
    if options.degree is not None:
        next_degree = same_degree = options.degree
    by_next = evaluate_if_possible(
        lambda degree: fit_feature_heights(x, z, levels.edges, degree), next_degree
    )
    by_wider = evaluate_if_possible(
        lambda edges: fit_feature_heights(x, z, edges, same_degree), _widen_flanks(x, levels)
    )
    return [heights for heights in (by_next, by_wider) if heights is not None]


def _widen_flanks(x: Array, levels: Levels) -> list[FoundEdge]:
    """Return the edges of a profile with flanks of twice their width and four points more."""
    wider = []
    for edge in levels.edges:
        slack = 0.5 * (edge.end - edge.begin) + 2 * float(x[1] - x[0])
        wider.append(replace(edge, begin=edge.begin - slack, end=edge.end + slack))
    return wider


def _measure_feature(
    x: Array,
    z: Array,
    levels: Levels,
    feature: Feature,
    height_changes: tuple[float, ...],
    options: EvaluationOptions,
) -> MeasuredFeature:
    """Measure a feature by what its windows allow.

    `height_changes` are those of its height by other polynomials and edges [m]; they count where
    it is measured by the polynomial alone.
    """
    is_free = options.degree is None and options.exclusion is None
    by_windows = _evaluate_type_a1_if_better(x, z, levels, feature) if is_free else None
    if by_windows is not None:
        return _make_type_a1_feature(feature, by_windows, levels.degree)
    if not feature.is_single_step:
        on_dome = _measure_feature_to_apex(x, z, levels, feature)
        if on_dome is not None:
            return on_dome
    _refuse_uneven_faces(x, z, levels, feature)
    return MeasuredFeature(
        feature,
        height_changes,
        Method(MethodKind.POLYNOMIAL, levels.degree),
        windows=(),
        outliers=0,
    )


def _make_type_a1_feature(feature: Feature, found: TypeA1, degree: int) -> MeasuredFeature:
    """Make a feature of type A1 or A2; its height is minus the depth."""
    height = replace(found.depth, value=-found.depth.value)
    kind = MethodKind.A2 if found.kind is A1Kind.A2 else MethodKind.A1
    windows = (
        Window(*found.windows.a, "A"),
        Window(*found.windows.c, "C"),
        Window(*found.windows.b, "B"),
    )
    return MeasuredFeature(
        feature=replace(feature, height=height),
        changes=(np.sqrt(3.0) * (found.depth.value - found.near),),
        method=Method(kind, degree),
        windows=windows,
        outliers=found.outliers,
    )


def _measure_feature_to_apex(
    x: Array, z: Array, levels: Levels, feature: Feature
) -> MeasuredFeature | None:
    """Measure a feature to the apex of its domed top; None where the top is not domed."""
    residuals = z - levels.level
    height = feature.height
    span = Span(feature.begin, feature.end)
    apex = estimate_apex_height(x, residuals, height.value, span, _APEX)
    if apex is None:
        return None
    change = 0.0
    wider = estimate_apex_height(x, residuals, height.value, span, _WIDER_APEX)
    if wider is not None:
        change = wider.value - apex.value
    to_apex = Estimate(height.value + apex.value, height.std + apex.std, apex.dof)
    return MeasuredFeature(
        feature=replace(feature, height=to_apex),
        changes=(change,),
        method=Method(MethodKind.A2_ON_POLYNOMIAL, levels.degree),
        windows=(),
        outliers=0,
    )


def _evaluate_type_a1_if_better(
    x: Array, z: Array, levels: Levels, feature: Feature
) -> TypeA1 | None:
    """Return type A1 or A2 of a feature.

    None where its windows do not fit, or where a bow lets the polynomial fit the same points
    better.
    """
    span = Span(feature.begin, feature.end)
    found = evaluate_if_possible(partial(evaluate_type_a1, x, z), span)
    if found is None:
        return None
    in_windows = np.zeros(x.shape, dtype=bool)
    for window in found.windows:
        in_windows |= (x >= window.begin) & (x <= window.end)
    seen = levels.used & in_windows
    if not seen.any():
        return None
    about_polynomial = float(np.sqrt(np.mean((z - levels.level)[seen] ** 2)))
    if found.kind is A1Kind.A2 or found.scatter < _FITS * about_polynomial:
        return found
    return None


def _refuse_uneven_faces(x: Array, z: Array, levels: Levels, feature: Feature) -> None:
    """Refuse a step beside faces that are not level, since its height depends on the datum.

    `x` and `z`, shape (n,), are positions and heights of the profile [m].
    """
    if levels.rejected > _MOST_DROPPED * levels.point_count:
        raise MetrologyError(
            f"at most {_MOST_DROPPED:.0%} of the points of a profile may be spikes, got "
            f"{levels.rejected / levels.point_count:.0%}"
        )
    # what a profile with whole features cuts at its ends has less
    if all(shown.is_single_step for shown in levels.features):
        _refuse_few_face_points(x, z, levels, feature)
    height = abs(feature.height.value)
    residual = float(np.sqrt(np.mean((z - levels.level)[levels.used] ** 2)))
    face = float(levels.used.sum()) / (len(levels.edges) + 1)
    if residual > _LEVEL * height and levels.together > _LEVEL * face:
        raise MetrologyError(
            f"faces beside a step of {height * 1e9:.4g} nm must be level, got residuals of "
            f"{residual * 1e9:.3g} nm that wander together over {levels.together / face:.0%} of a "
            "face"
        )
    _refuse_sawtooth(levels)


def _refuse_few_face_points(x: Array, z: Array, levels: Levels, feature: Feature) -> None:
    """Refuse a single step beside which half of the points of a face were left out."""
    # flanks that overlap may cross half of their heights in another order
    positions = [edge.position for edge in levels.edges]
    ends = sorted([float(x[0]), *positions, float(x[-1])])
    place = ends.index(feature.begin)
    kept = np.histogram(x[levels.used], ends)[0][place - 1 : place + 1]
    seen = np.histogram(x[np.isfinite(z)], ends)[0][place - 1 : place + 1]
    if not (kept >= np.maximum(LEAST_FACE // 2, seen // 2)).all():
        raise MetrologyError(
            f"faces beside a single step must keep half of their points, and {LEAST_FACE // 2}, "
            f"got {kept[0]} of {seen[0]} and {kept[1]} of {seen[1]}"
        )


def _refuse_sawtooth(levels: Levels) -> None:
    """Refuse single steps in one direction that the slope between them takes back."""
    heights = []
    for feature in levels.features:
        if feature.is_single_step:
            heights.append(feature.height.value)
    single = np.array(heights)
    taken_back = 0.0
    if len(single) > 1:
        slope = float(levels.level[-1] - levels.level[0])
        taken_back = 1.0 - slope / float(single.sum())
    in_one_direction = abs(single.sum()) > _TAKEN_BACK * np.abs(single).sum()
    if abs(taken_back - 1.0) < _TAKEN_BACK and in_one_direction:
        raise MetrologyError(
            f"steps must not be those of a sawtooth, got {len(single)} in one direction, of "
            f"which the slope takes back {taken_back:.0%}"
        )
