"""Levelling: what is an edge, two planes beside one, and a polynomial beside all of them.

An edge is where two windows side by side differ by far more than such windows do elsewhere: the
noise, the roughness and the bow of the surface itself are the yardstick. What is found must then
beat a smooth curve with as many parameters. Heights come from one least-squares fit of a polynomial
(line, parabola or cubic, as the data or the user say) and one height per feature.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    Array,
    Estimate,
    Mask,
    estimate_autocovariance,
    estimate_linear,
    estimate_robust_scale,
    find_outliers,
)

LEAST_FACE = 20  # points of a face or shoulder that is fitted
_STAND_OUT = 7.0  # difference of two windows over the usual one, from which it is an edge [1]
# by which twice the logarithm of the likelihood, less the parameters, must gain on a smooth curve
# (Kass and Raftery 1995)
BEAT = 10.0
_ALIKE = 0.3  # of the largest edge, from which another counts [1]
PAIR = 0.35  # relative difference of the two edges of one ridge or groove, at most [1]
_PLATEAU = 0.8  # of the lesser of two edges, below which the difference must fall between them [1]
_MOST_EDGES = 400
_STARTS = 5  # of a fit, each nearer to the least sum of distances
_DEGREES = (1, 2, 3)
# of the last coefficient of a polynomial over its uncertainty, from which it is kept [1]
_SIGNIFICANT = 4.0
LEVELS = {"line": 1, "parabola": 2, "cubic": 3}


def check_profile(x: Array, z: Array, least: int) -> None:
    """Refuse what is no profile with `least` measured points, in equal steps."""
    MetrologyError.require(
        (count := int(np.isfinite(z).sum())) >= least,
        f"profile must have at least {least} measured points, got {count}",
    )
    steps = np.diff(x)
    MetrologyError.require(
        (steps > 0.0).all() and np.ptp(steps) < 0.01 * np.mean(steps),
        "positions of the profile must increase in equal steps within 1 %",
    )


def remove_spikes(heights: Array) -> Array:
    """Return the known heights as their running median over five points, which keeps edges."""
    calm = np.array(heights, dtype=np.float64)
    known = np.isfinite(heights)
    calm[known] = median_filter(calm[known], size=5, mode="nearest")
    return calm


def solve_least_squares(design: Array, z: Array, used: Mask) -> tuple[Array, Array]:
    """Return the weights of the points in a least-squares fit over those used, and its solution."""
    try:
        inverse = np.linalg.inv(design[:, used] @ design[:, used].T)
    except np.linalg.LinAlgError as error:
        raise MetrologyError(
            f"points must determine what is fitted to them, got {int(used.sum())} of one face"
        ) from error
    weights = np.where(used, inverse @ design, 0.0)
    return weights, weights[:, used] @ z[used]


@dataclass(frozen=True)
class Fit:
    """Least squares over the points that are no spikes."""

    design: Array  # shape (k, n)
    weights: Array  # shape (k, n); with which each point counts in the solution
    solution: Array  # shape (k,)
    residuals: Array  # shape (n,); m
    used: Mask  # shape (n,); points that took part
    rejected: int  # points left out as spikes

    def estimate(self, index: int, factor: float = 1.0) -> Estimate:
        """Return one term of the solution, times a factor, with its uncertainty."""
        return estimate_linear(
            factor * float(self.solution[index]),
            factor * self.weights[index],
            self.residuals,
            self.used,
            self.design,
        )


def fit_without_spikes(design: Array, z: Array, used: Mask) -> Fit:
    """Fit the rows of `design` to the heights [m] of those points that are no spikes."""
    root = np.ones(len(z))
    # first by distances instead of squares, so that neither spikes nor stray points pull
    for _ in range(_STARTS):
        residuals = z - solve_least_squares(design * root, z * root, used)[1] @ design
        root = (
            np.maximum(
                np.abs(residuals) / max(estimate_robust_scale(residuals[used]), LEAST_SCATTER), 1.0
            )
            ** -0.5
        )
    kept = used & ~find_outliers(residuals, used)
    for _ in range(5):
        weights, solution = solve_least_squares(design, z, kept)
        residuals = z - solution @ design
        spikes = find_outliers(residuals, kept)
        if not spikes.any():
            break
        kept = kept & ~spikes
    return Fit(design, weights, solution, residuals, kept, int(used.sum()) - int(kept.sum()))


@dataclass(frozen=True)
class TwoPlanes:
    """Two parallel faces, the one behind the middle of a profile higher by a step."""

    tilt: float  # common slope [1]
    offset: float  # height of the first face at position 0 [m]
    height: Estimate  # m
    fit: Fit  # of slope, offset at the middle, and height


def fit_two_planes(x: Array, z: Array, middle: float, used: Mask) -> TwoPlanes:
    """Fit ``z = a (x - middle) + b + h s(x)``, s = 0 before and 1 behind the middle, no spikes."""
    # Source: ISO 5436-1 leaves a single edge to convention; this is the two-plane one, which has no
    # feature to level through.
    scale = float(max(abs(x[0] - middle), abs(x[-1] - middle)))
    fit = fit_without_spikes(
        np.stack([(x - middle) / scale, np.ones_like(x), (x > middle).astype(float)]), z, used
    )
    height = fit.estimate(2)
    fit.weights[0] /= scale
    tilt = float(fit.solution[0]) / scale
    return TwoPlanes(tilt, float(fit.solution[1]) - tilt * middle, height, fit)


@dataclass(frozen=True)
class FoundEdge:
    """One edge of a profile."""

    position: float  # where half of its height is crossed [m]
    rise: float  # height behind it less height before it [m]
    begin: float  # where its flank leaves the face before it [m]
    end: float  # where its flank reaches the face behind it [m]
    unseen: float  # half of what was not measured there [m]


@dataclass(frozen=True)
class Feature:
    """A ridge, a groove, or a single step."""

    begin: float  # first edge [m]
    end: float  # second edge [m]; of a single step infinite
    unseen: float  # half of what was not measured at its edges, as root of the squares [m]
    flanks: float  # half of the widths of its flanks together [m]
    height: Estimate  # over the reference, or behind less before the edge [m]


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


def find_edges(x: Array, z: Array) -> list[FoundEdge]:
    """Find the edges of a profile in equal steps [m]; refused where no difference stands out."""
    check_profile(x, z, 2 * LEAST_FACE)
    known = np.isfinite(z)
    calm = remove_spikes(z)
    best = (_STAND_OUT, -1)
    reaches = [4]
    gaps: list[Array] = []
    while 3 * reaches[-1] <= len(x) // 4:
        gap = _compute_window_differences(calm, known, reaches[-1])
        scale = (
            max(estimate_robust_scale(gap[np.isfinite(gap)]), LEAST_SCATTER)
            if np.isfinite(gap).any()
            else np.inf
        )
        ratio = float(np.nanmax(np.abs(gap), initial=0.0)) / scale
        if ratio > best[0] * 1.05:
            best = ratio, len(gaps)
        gaps.append(np.where(np.abs(gap) < _STAND_OUT * scale, 0.0, gap))
        reaches.append(int(np.ceil(1.5 * reaches[-1])))
    nothing = (
        f"profile must show a step above its noise, one that stands out {_STAND_OUT:g} times "
        "over what is usual, got none"
    )
    at = best[1]
    MetrologyError.require(at >= 0, nothing)
    reach, gap = reaches[at], gaps[at]
    # what is too narrow for the best windows, or too near to where nothing was measured
    for other in gaps[:at]:
        gap = np.where(np.abs(other) > np.nan_to_num(np.abs(gap)), other, gap)
    for other in gaps[at + 1 :]:  # what missing points hide from them
        gap = np.where(np.isfinite(gap), gap, other)
    seen = np.nan_to_num(gap)
    places: set[int] = set()
    around = maximum_filter1d(np.abs(seen), 2 * reach + 1)
    # so that the other edge of a groove is no lesser one
    least = np.maximum(_ALIKE * around.max(), _PLATEAU * around)
    for size in (np.maximum(seen, 0.0), np.maximum(-seen, 0.0)):
        peaks = np.flatnonzero((size >= least) & (size == maximum_filter1d(size, 2 * reach + 1)))
        places |= {
            _find_plateau_middle(size, one, reach)
            for one in peaks[np.diff(peaks, prepend=-reach) > reach]
        }
    edges = _join_edges(x, calm, known, sorted(places)[:_MOST_EDGES], gap)
    found = _find_flanks(x, calm, known, *edges)
    MetrologyError.require(found, nothing)
    return found


def _find_plateau_middle(size: Array, peak: int, reach: int) -> int:
    # Return the middle of what is as high as a peak: windows with a gap see an edge all over it.
    ends = np.flatnonzero(np.concatenate([[True], size < _PLATEAU * size[peak], [True]])) - 1
    behind = int(np.searchsorted(ends, peak))
    first, last = ends[behind - 1 : behind + 1]
    return int(first + last) // 2 if last - first <= 2 * reach else peak


def _compute_window_differences(z: Array, known: Mask, reach: int) -> Array:
    # Difference of the means of two windows beside a gap, less what is usual around it: the slope
    # and bow of the surface.
    filled = np.where(known, z, 0.0)
    count, total = (
        np.concatenate([[0.0], np.cumsum(one)]) for one in (known.astype(float), filled)
    )
    at = np.arange(1, len(z))

    def mean(begin: NDArray[np.intp]) -> tuple[Array, Array]:
        low, high = (np.clip(one, 0, len(z)).astype(int) for one in (begin, begin + reach))
        number = count[high] - count[low]
        return number, (total[high] - total[low]) / np.maximum(number, 1.0)

    (before, low), (behind, high) = mean(at - reach // 2 - reach), mean(at + reach // 2)
    whole = np.minimum(before, behind) >= 0.6 * reach
    gaps = np.where(whole, high - low, np.nan)
    if not whole.any():
        return gaps
    filled = np.interp(at, at[whole], gaps[whole])
    lag = len(gaps) // 2
    # a bow makes them lean, of which the median would lose hold at either end
    slope = float(np.median(filled[lag:] - filled[:-lag])) / lag
    lean = min((0.0 * at, slope * at), key=lambda one: estimate_robust_scale(filled - one))
    return np.asarray(
        gaps - lean - median_filter(filled - lean, min(9 * reach, len(gaps)), mode="nearest")
    )


def _join_edges(
    x: Array, z: Array, known: Mask, places: list[int], gap: Array
) -> tuple[list[int], Array]:
    # Join two edges of one sign that are one: the surface goes on rising between them by more than
    # half of the lesser.
    # It rises so if it is steeper than farther out on either side, which a bow is not on average.
    ends = [0, *places, len(x) - 1]
    for index, (first, second) in enumerate(itertools.pairwise(places)):
        if gap[first] * gap[second] < 0.0:
            continue
        far = second - first
        lesser = min(abs(gap[first]), abs(gap[second]))
        # where the difference does not fall between them, they are the ends of one that points are
        # missing of
        joined = bool(np.nanmin(np.abs(gap[first:second])) > _PLATEAU * lesser)
        faces = [
            _fit_face_line(x, z, known, at, at + far)
            for at in (first - 2 * far, first, second + far)
        ]
        slopes = [float(face[0].deriv()(x[first])) for face in faces if face is not None]
        if (
            len(slopes) == 3
            and first - 2 * far >= ends[index]
            and second + 2 * far <= ends[index + 3]
        ):
            rise = (
                (slopes[1] - 0.5 * (slopes[0] + slopes[2]))
                * float(x[second] - x[first])
                * np.sign(gap[first])
            )
            joined |= rise > 0.5 * lesser
        if joined:
            middle = (first + second) // 2
            return _join_edges(
                x,
                z,
                known,
                [*places[:index], middle, *places[index + 2 :]],
                np.where(np.arange(len(gap)) == middle, gap[first] + gap[second], gap),
            )
    return places, gap


def _find_flanks(x: Array, z: Array, known: Mask, places: list[int], gap: Array) -> list[FoundEdge]:
    # Where the flank of each edge begins and ends: off the lines through the faces beside it.
    found = []
    ends = [0, *places, len(x) - 1]
    for before, at, behind in zip(ends, places, ends[2:], strict=False):
        lower = _fit_face_line(x, z, known, before, at)
        upper = _fit_face_line(x, z, known, at, behind)
        if lower is None or upper is None:
            continue
        low, high = lower[0], upper[0]
        rise = float(gap[at])
        between = float(high(x[at]) - low(x[at]))
        if np.sign(between) == np.sign(rise):
            rise = between
        on_low, on_high = (
            np.abs(z - line(x)) <= max(6.0 * rough, 0.02 * abs(rise))
            for line, rough in (lower, upper)
        )
        begin, end = at, at
        while begin > before and not (on_low[begin] and on_low[max(begin - 2, before)]):
            begin -= 1
        while end < behind and not (on_high[end] and on_high[min(end + 2, behind)]):
            end += 1
        part = slice(begin, end + 1)
        above = np.where(
            known[part], (z[part] - 0.5 * (low(x[part]) + high(x[part]))) * np.sign(rise), 0.0
        )
        first = int(np.argmax(above > 0.0)) if (above > 0.0).any() else at - begin
        position = float(x[begin + first])
        unseen = 0.0
        measured = np.flatnonzero(known[begin : begin + first])
        if len(measured) and above[first] > 0.0:
            last = int(measured[-1])
            step = float(x[1] - x[0])
            position -= (
                (first - last) * step * float(above[first] / max(above[first] - above[last], 1e-30))
            )
            unseen = 0.5 * (first - last - 1) * step
        found.append(FoundEdge(position, rise, float(x[begin]), float(x[end]), unseen))
    return found


def _fit_face_line(
    x: Array, z: Array, known: Mask, begin: int, end: int
) -> tuple[np.polynomial.Polynomial, float] | None:
    # Line through a face without its ends at edges, and its scatter; None where nothing of it was
    # measured.
    # a face ends where it is seen no more
    measured = max(begin, 0) + np.flatnonzero(known[max(begin, 0) : end])
    cut = max(len(measured) // 5, 1)
    inner = measured[cut:-cut]
    if len(inner) < 4:
        return None
    line = np.polynomial.Polynomial.fit(x[inner], z[inner], 1 if len(inner) > 10 else 0)
    return line, estimate_robust_scale(z[inner] - line(x[inner]))


def measure_features(
    x: Array, z: Array, edges: list[FoundEdge], degree: int | None, exclusion: float | None
) -> Levels:
    """Fit all features of a profile [m].

    Refused, with the figure, where none is significant or a smooth curve does as well.
    """
    while edges:
        levels = fit_features(x, z, edges, degree, exclusion)
        weak = [
            one for one in levels.features if abs(one.height.value) < _SIGNIFICANT * one.height.std
        ]
        if not weak:
            MetrologyError.require(
                not levels.gain < BEAT,
                "profile must show a step that a smooth curve does not explain, got a "
                f"likelihood gain of {levels.gain:.1f} on a smooth curve ({BEAT:g} needed)",
            )
            return levels
        gone = {end for one in weak for end in (one.begin, one.end)}
        edges = [edge for edge in edges if edge.position not in gone]
    raise MetrologyError(
        f"profile must show a step, got none of {_SIGNIFICANT:g} times its uncertainty"
    )


def fit_features(
    x: Array,
    z: Array,
    edges: Sequence[FoundEdge],
    degree: int | None = None,
    exclusion: float | None = None,
) -> Levels:
    """Heights of all features between `edges` in one fit.

    The polynomial's degree is that of its last significant term.
    """
    # `exclusion` is the half width [m] kept out at every edge; where its flank is, and half as much
    # again, by default.
    fits = _fit_polynomials(x, z, edges, _DEGREES if degree is None else (degree,), exclusion)
    lasts = {one: fit.estimate(one) for one, fit in fits.items() if one > min(fits)}
    carried = [one for one, last in lasts.items() if abs(last.value) > _SIGNIFICANT * last.std]
    power = max([min(fits), *carried])
    fit = fits[power]
    features = tuple(
        Feature(*span, fit.estimate(power + index))
        for index, span in enumerate(_pair_edges(edges), 1)
    )
    gain, together = _compute_likelihood_gain(fit.design[1], z, fit, power + 1 + 2 * len(edges))
    return Levels(
        features,
        power,
        fit.solution @ fit.design,
        fit.used,
        fit.rejected,
        gain,
        together,
        tuple(edges),
    )


def fit_heights(x: Array, z: Array, edges: Sequence[FoundEdge], degree: int) -> Array:
    """Return heights of all features on a polynomial of this degree [m], without uncertainty."""
    return _fit_polynomials(x, z, edges, (degree,), None)[degree].solution[degree + 1 :]


def _fit_polynomials(
    x: Array, z: Array, edges: Sequence[FoundEdge], powers: Sequence[int], exclusion: float | None
) -> dict[int, Fit]:
    # Fit polynomials and heights by the degree of the polynomial, as far as the points determine
    # them.
    used = np.isfinite(z)
    for edge in edges:
        slack = 0.25 * (edge.end - edge.begin) + 1.5 * float(x[1] - x[0])
        span = (edge.begin - slack, edge.end + slack)
        begin, end = (
            span if exclusion is None else (edge.position - exclusion, edge.position + exclusion)
        )
        used &= (x < begin) | (x > end)
    steps = np.array(
        [(x > begin) & (x < end) for begin, end, *_ in _pair_edges(edges)], dtype=np.float64
    )
    least = min(*(used & (steps > 0.5)).sum(axis=1), (used & (steps.sum(axis=0) < 0.5)).sum())
    MetrologyError.require(
        least >= 5,
        f"each feature and its surroundings must keep 5 points beside the flanks, got {least}",
    )
    t = 2.0 * (x - x[0]) / (x[-1] - x[0]) - 1.0
    fits: dict[int, Fit] = {}
    for power in powers:
        design = np.stack([*(t**k for k in range(power + 1)), *steps])
        if np.linalg.matrix_rank(design[:, used]) < len(design):
            break
        fits[power] = fit_without_spikes(design, z, used)
    MetrologyError.require(
        fits, "features must leave enough of a reference to level the profile on, got too little"
    )
    return fits


def _compute_likelihood_gain(t: Array, z: Array, fit: Fit, terms: int) -> tuple[float, float]:
    # Return twice the gain in log-likelihood on a smooth curve of as many parameters, and how many
    # points are not independent.
    kept = fit.used
    smooth = np.stack([t, *(np.cos(0.5 * np.pi * k * (t + 1.0)) for k in range(terms))])
    fair = np.linalg.lstsq(smooth[:, kept].T, z[kept], rcond=None)[0]
    gamma = estimate_autocovariance([np.where(kept, fit.residuals, np.nan)], len(fit.design))
    together = max(1.0, float(2.0 * gamma.sum() / gamma[0] - 1.0)) if gamma[0] > 0.0 else 1.0
    floor = LEAST_SCATTER**2 * kept.sum()
    squares = [float(np.sum(one[kept] ** 2)) + floor for one in (z - fair @ smooth, fit.residuals)]
    return float(kept.sum()) / together * float(np.log(squares[0] / squares[1])), together


def _pair_edges(edges: Sequence[FoundEdge]) -> list[tuple[float, float, float, float]]:
    # Join two edges of opposite sign and like size to a ridge or groove; others are single steps.
    # With each what was not seen of both edges, and half of the widths of their flanks together.
    spans: list[tuple[float, float, float, float]] = []
    waiting = list(edges)
    while waiting:
        one = waiting.pop(0)
        if waiting and abs(one.rise + waiting[0].rise) < PAIR * max(
            abs(one.rise), abs(waiting[0].rise)
        ):
            other = waiting.pop(0)
            unseen = float(np.hypot(one.unseen, other.unseen))
            flanks = 0.5 * (one.end - one.begin + other.end - other.begin) - one.unseen
            flanks = max(flanks - other.unseen, 0.0)
            spans.append((one.position, other.position, unseen, flanks))
        else:
            spans.append((one.position, np.inf, one.unseen, 0.5 * (one.end - one.begin)))
    return spans
