"""Heights of all features of a profile in one fit.

Heights come from one least-squares fit of a polynomial (line, parabola or cubic, as the data or the
user say) and one height per feature. What is found must beat a smooth curve with as many
parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.found_edges import FoundEdge
from stepblocks.inspect.levelling import DEGREES, Fit, fit_without_spikes
from stepblocks.inspect.noise import LEAST_SCATTER, Array, Estimate, Mask, estimate_autocovariance

# by which twice the logarithm of the likelihood, less the parameters, must gain on a smooth curve
# (Kass and Raftery 1995)
BEAT = 10.0
PAIR = 0.35  # relative difference of the two edges of one ridge or groove, at most [1]
# of the last coefficient of a polynomial over its uncertainty, from which it is kept [1]
_SIGNIFICANT = 4.0
_LEAST_POINTS = 5  # of a feature and of its surroundings
# Share of the points of a ridge or groove that must be measured: strays may be left of the others
_LEAST_MEASURED = 0.1
_SLACK = 0.25  # of the width of a flank, kept out beside it [1]
_SLACK_STEPS = 1.5  # sampling intervals that are kept out besides


@dataclass(frozen=True)
class Feature:
    """A ridge, a groove, or a single step."""

    begin: float  # first edge [m]
    end: float  # second edge [m]; of a single step infinite
    unseen: float  # half of what was not measured at its edges, as root of the squares [m]
    flanks: float  # half of the widths of its flanks together [m]
    height: Estimate  # over the reference, or behind less before the edge [m]

    @property
    def is_single_step(self) -> bool:
        """Whether it has one edge alone."""
        return not np.isfinite(self.end)


@dataclass(frozen=True)
class Levels:
    """All features of a profile, and how it was levelled."""

    features: tuple[Feature, ...]
    degree: int  # of the polynomial
    level: Array  # shape (n,); polynomial and heights, as fitted [m]
    used: Mask  # shape (n,); points that took part
    rejected: int  # left out as spikes
    gain: float  # by which it beats a smooth curve, as BEAT [1]
    together: float  # points of the residuals that wander together [1]
    edges: tuple[FoundEdge, ...]

    @property
    def point_count(self) -> int:
        """Number of points that were fitted, with those left out as spikes."""
        return int(self.used.sum()) + self.rejected


@dataclass(frozen=True)
class _Span:
    """Where a feature lies, as its edges say."""

    begin: float  # m
    end: float  # m; infinite of a single step
    unseen: float  # half of what was not measured at its edges, as root of the squares [m]
    flanks: float  # half of the widths of its flanks together [m]


def fit_significant_features(
    x: Array, z: Array, edges: list[FoundEdge], degree: int | None, exclusion: float | None
) -> Levels:
    """Fit all significant features of a profile.

    Parameters
    ----------
    x, z : array, shape (n,)
        Positions and heights [m]; nan where nothing was measured.
    edges : list of FoundEdge
        Edges of the profile.
    degree : int or None
        Of the polynomial; that of its last significant term where it is not given.
    exclusion : float or None
        Half width kept out at every edge [m]; by default where its flank is.

    Returns
    -------
    Levels

    Raises
    ------
    MetrologyError
        With the figure, if no feature is significant or a smooth curve does as well.
    """
    while edges:
        levels = fit_features(x, z, edges, degree, exclusion)
        insignificant_ends = _find_insignificant_edge_positions(levels)
        if not insignificant_ends:
            if levels.gain < BEAT:
                raise MetrologyError(
                    "profile must show a step that a smooth curve does not explain, got a "
                    f"likelihood gain of {levels.gain:.1f} on a smooth curve ({BEAT:g} needed)"
                )
            return levels
        edges = [edge for edge in edges if edge.position not in insignificant_ends]
    raise MetrologyError(
        f"profile must show a step, got none of {_SIGNIFICANT:g} times its uncertainty"
    )


def _find_insignificant_edge_positions(levels: Levels) -> set[float]:
    """Return the places of the edges of features that are not significant [m]."""
    ends: set[float] = set()
    for feature in levels.features:
        if abs(feature.height.value) < _SIGNIFICANT * feature.height.std:
            ends |= {feature.begin, feature.end}
    return ends


def fit_features(
    x: Array,
    z: Array,
    edges: Sequence[FoundEdge],
    degree: int | None = None,
    exclusion: float | None = None,
) -> Levels:
    """Fit all features between edges at once, as `fit_significant_features` takes them."""
    degrees = DEGREES if degree is None else (degree,)
    fits = _fit_polynomials_and_heights(x, z, edges, degrees, exclusion)
    chosen = _choose_highest_significant_degree(fits)
    fit = fits[chosen]
    features = []
    for number, span in enumerate(_pair_edges_into_spans(edges), start=1):
        height = fit.estimate_term(chosen + number)
        features.append(Feature(span.begin, span.end, span.unseen, span.flanks, height))
    together = _estimate_correlated_point_count(fit)
    positions = fit.design[1]
    terms = chosen + 1 + 2 * len(edges)
    return Levels(
        features=tuple(features),
        degree=chosen,
        level=fit.solution @ fit.design,
        used=fit.used,
        rejected=fit.rejected,
        gain=_compute_likelihood_gain(positions, z, fit, terms, together),
        together=together,
        edges=tuple(edges),
    )


def _choose_highest_significant_degree(fits: dict[int, Fit]) -> int:
    """Return the highest degree whose last term is significant; the lowest where none is."""
    lowest = min(fits)
    chosen = lowest
    for degree, fit in fits.items():
        if degree == lowest:
            continue
        last = fit.estimate_term(degree)
        if abs(last.value) > _SIGNIFICANT * last.std:
            chosen = max(chosen, degree)
    return chosen


def fit_feature_heights(x: Array, z: Array, edges: Sequence[FoundEdge], degree: int) -> Array:
    """Return heights of all features on a polynomial of this degree [m], without uncertainty."""
    fit = _fit_polynomials_and_heights(x, z, edges, (degree,), None)[degree]
    return fit.solution[degree + 1 :]


def _fit_polynomials_and_heights(
    x: Array, z: Array, edges: Sequence[FoundEdge], degrees: Sequence[int], exclusion: float | None
) -> dict[int, Fit]:
    """Fit polynomials and heights, by the degree, as far as the points determine them."""
    used = _mark_points_beside_edges(x, z, edges, exclusion)
    spans = _pair_edges_into_spans(edges)
    _refuse_unmeasured_features(x, z, spans)
    steps = np.array([(x > span.begin) & (x < span.end) for span in spans], dtype=np.float64)
    points_of_features = (used & (steps > 0.5)).sum(axis=1)
    points_beside = (used & (steps.sum(axis=0) < 0.5)).sum()
    least = min(*points_of_features, points_beside)
    if least < _LEAST_POINTS:
        raise MetrologyError(
            f"each feature and its surroundings must keep {_LEAST_POINTS} points beside the "
            f"flanks, got {least}"
        )
    t = 2.0 * (x - x[0]) / (x[-1] - x[0]) - 1.0
    fits: dict[int, Fit] = {}
    for degree in degrees:
        powers = [t**power for power in range(degree + 1)]
        design = np.stack([*powers, *steps])
        if np.linalg.matrix_rank(design[:, used]) < len(design):
            break
        fits[degree] = fit_without_spikes(design, z, used)
    if not fits:
        raise MetrologyError(
            "features must leave enough reference points to level the profile on, got "
            f"{points_beside} for a polynomial of degree {degrees[0]}"
        )
    return fits


def _refuse_unmeasured_features(x: Array, z: Array, spans: Sequence[_Span]) -> None:
    """Refuse a ridge or groove of which next to nothing was measured."""
    for span in spans:
        inside = (x > span.begin) & (x < span.end)
        measured = int((inside & np.isfinite(z)).sum())
        if measured < _LEAST_MEASURED * inside.sum():
            raise MetrologyError(
                f"a feature must have {_LEAST_MEASURED:.0%} of its points measured, got {measured} "
                f"of {inside.sum()} from {span.begin * 1e6:.4g} um on"
            )


def _mark_points_beside_edges(
    x: Array, z: Array, edges: Sequence[FoundEdge], exclusion: float | None
) -> Mask:
    """Return the measured points that lie on no flank, or beyond the exclusion [m] of all edges."""
    beside = np.isfinite(z)
    for edge in edges:
        if exclusion is None:
            slack = _SLACK * (edge.end - edge.begin) + _SLACK_STEPS * float(x[1] - x[0])
            begin, end = edge.begin - slack, edge.end + slack
        else:
            begin, end = edge.position - exclusion, edge.position + exclusion
        beside &= (x < begin) | (x > end)
    return beside


def _estimate_correlated_point_count(fit: Fit) -> float:
    """Estimate over how many points the residuals of a fit are correlated, at least 1 [points]."""
    kept = np.where(fit.used, fit.residuals, np.nan)
    gamma = estimate_autocovariance([kept], len(fit.design))
    if gamma[0] > 0.0:
        return max(1.0, float(2.0 * gamma.sum() / gamma[0] - 1.0))
    return 1.0


def _compute_likelihood_gain(
    scaled_positions: Array, heights: Array, fit: Fit, term_count: int, correlation_length: float
) -> float:
    """Return twice the gain in log-likelihood of a fit on a smooth curve of as many parameters.

    `scaled_positions`, shape (n,), are positions from -1 to 1 [1], `term_count` the number of
    cosines of the curve, and `correlation_length` that of the points that are not independent.
    """
    kept = fit.used
    curves = [scaled_positions]
    for k in range(term_count):
        curves.append(np.cos(0.5 * np.pi * k * (scaled_positions + 1.0)))
    smooth = np.stack(curves)
    solution = np.linalg.lstsq(smooth[:, kept].T, heights[kept], rcond=None)[0]
    beside_smooth = heights - solution @ smooth
    floor = LEAST_SCATTER**2 * kept.sum()
    squares_of_smooth = float(np.sum(beside_smooth[kept] ** 2)) + floor
    squares_of_fit = float(np.sum(fit.residuals[kept] ** 2)) + floor
    return (
        float(kept.sum()) / correlation_length * float(np.log(squares_of_smooth / squares_of_fit))
    )


def _pair_edges_into_spans(edges: Sequence[FoundEdge]) -> list[_Span]:
    """Join two edges of opposite sign and like size to a ridge or groove; others are single steps.

    A single step has half of the width of its flank.
    """
    spans = []
    waiting = list(edges)
    while waiting:
        first = waiting.pop(0)
        if not waiting or not _are_edges_of_one_feature(first, waiting[0]):
            half_flank = 0.5 * (first.end - first.begin)
            spans.append(_Span(first.position, np.inf, first.unseen, half_flank))
            continue
        second = waiting.pop(0)
        unseen = float(np.hypot(first.unseen, second.unseen))
        flanks = 0.5 * (first.end - first.begin + second.end - second.begin) - first.unseen
        flanks = max(flanks - second.unseen, 0.0)
        spans.append(_Span(first.position, second.position, unseen, flanks))
    return spans


def _are_edges_of_one_feature(first: FoundEdge, second: FoundEdge) -> bool:
    """Tell whether two edges are those of one ridge or groove."""
    larger = max(abs(first.rise), abs(second.rise))
    return abs(first.rise + second.rise) < PAIR * larger
