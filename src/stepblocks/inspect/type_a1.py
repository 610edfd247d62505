"""Step height of a ridge or a groove by ISO 5436-1, type A1.

For a groove of width W between the edges L and R, one least-squares fit ``Z = a X + b + h d`` runs
over A = [L - W, L - W/3], C = the middle third, B = [R + W/3, R + W], with d = +1 on A and B and -1
on C; the depth is 2 h. The profile is not filtered. A window that holds a part of a flank bends the
result, and is refused.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import Fit, fit_without_spikes, solve_for_weights_and_coefficients
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    SPIKE,
    Array,
    Estimate,
    Mask,
    estimate_robust_scale,
    make_linear_estimate,
)

_LEAST_POINTS = 5  # of a window
_LEAST_POINTS_OF_DOME = 10  # of a window beside or on a domed middle
_TOLERATED = 0.01  # deviation of a window's end that is no flank, as a part of the depth [1]
_END = 3  # points at the end of a window that lie off the fit where a flank reaches into it
_SIGNIFICANT = 4.0  # of the bow of the middle over its uncertainty, from which it is domed [1]
_DOMED = 0.03  # least bow of a domed middle, as a part of the depth [1]
_MOST_OUTLIERS = 0.1  # part of a window's points that may be spikes [1]
# mean of t^2 over -1 to 1, so that a bow does not move the mean of the middle
_MEAN_SQUARE = 1.0 / 3.0


class Span(NamedTuple):
    """A stretch of a profile."""

    begin: float  # m
    end: float  # m

    @property
    def length(self) -> float:
        """Length [m]."""
        return self.end - self.begin


class A1Windows(NamedTuple):
    """The windows of type A1 as evaluated."""

    a: Span  # before the feature
    c: Span  # middle of the feature
    b: Span  # behind it


class A1Kind(StrEnum):
    """Types of ISO 5436-1."""

    A1 = "A1"
    A2 = "A2"  # the middle is domed


@dataclass(frozen=True)
class TypeA1:
    """Result of one evaluation."""

    depth: Estimate  # 2h [m]; negative for a ridge
    windows: A1Windows
    outliers: int  # points left out as spikes
    kind: A1Kind
    scatter: float  # root mean square of the residuals [m]
    near: float  # depth with the outer windows cut to the half that is nearer to the feature [m]


@dataclass(frozen=True)
class _WindowPoints:
    """Points of a profile in the windows of type A1."""

    x: Array  # shape (n,); m
    z: Array  # shape (n,); m
    a: Mask  # shape (n,); measured points of the window
    c: Mask
    b: Mask
    feature: str  # for messages

    @property
    def masks_by_letter(self) -> dict[str, Mask]:
        """Points of each window, by its letter A, B or C."""
        return {"A": self.a, "C": self.c, "B": self.b}

    @property
    def in_windows(self) -> Mask:
        """Which points lie in any of the windows."""
        return self.a | self.c | self.b

    def build_design(self) -> Array:
        """Return slope, offset and half depth of a flat groove, shape (3, n) [1]."""
        in_windows = self.x[self.in_windows]
        slope = (self.x - in_windows.mean()) / np.ptp(in_windows)
        return np.stack([slope, np.ones_like(self.x), np.where(self.c, -1.0, 1.0)])


def evaluate_type_a1(x: Array, z: Array, edges: Span | tuple[float, float]) -> TypeA1:
    """Depth of one groove or ridge between two edges of a profile.

    Where the middle third is domed by more than its noise, the depth is that of type A2: to the
    apex of the arc through it.

    Parameters
    ----------
    x, z : array, shape (n,)
        Positions and heights [m]; nan where nothing was measured.
    edges : Span or pair of float
        Left and right edge [m].

    Returns
    -------
    TypeA1
        By ISO 5436-1:2000, 5.2 and figure 7.

    Raises
    ------
    MetrologyError
        If the profile does not reach one width beyond the edges, or a window holds too few points,
        a flank or spikes.
    """
    windows = _place_a1_windows(x, Span(*edges))
    feature = f"the feature from {edges[0] * 1e6:.4g} to {edges[1] * 1e6:.4g} um"
    points = _WindowPoints(
        x,
        z,
        _mark_window_points(x, z, windows.a),
        _mark_window_points(x, z, windows.c),
        _mark_window_points(x, z, windows.b),
        feature,
    )
    for name, mask in points.masks_by_letter.items():
        if mask.sum() < _LEAST_POINTS:
            raise MetrologyError(
                f"window {name} must keep {_LEAST_POINTS} points, got {mask.sum()} for {feature}"
            )
    domed = _evaluate_domed_feature(points)
    if domed is not None:
        return domed
    return _evaluate_flat_feature(points)


def _place_a1_windows(x: Array, edges: Span) -> A1Windows:
    """Return the windows of a feature; refuse a profile that does not hold them."""
    width = edges.length
    if not width > 0.0:
        raise MetrologyError(f"edges must be in order, got {edges.begin:g} and {edges.end:g} m")
    third = width / 3
    windows = A1Windows(
        Span(edges.begin - width, edges.begin - third),
        Span(edges.begin + third, edges.end - third),
        Span(edges.end + third, edges.end + width),
    )
    slack = 0.5 * (x[-1] - x[0]) / (len(x) - 1)
    begin = windows.a.begin
    end = windows.b.end
    if not (x[0] - slack <= begin and end <= x[-1] + slack):
        raise MetrologyError(
            f"profile must reach one width ({width * 1e6:.4g} um) beyond the edges, from "
            f"{begin * 1e6:.4g} to "
            f"{end * 1e6:.4g} um, got {x[0] * 1e6:.4g} to {x[-1] * 1e6:.4g} um"
        )
    return windows


def _mark_window_points(x: Array, z: Array, window: Span) -> Mask:
    """Return the measured points of a window."""
    return np.asarray((x >= window.begin) & (x <= window.end) & np.isfinite(z))


def _evaluate_flat_feature(points: _WindowPoints) -> TypeA1:
    """Return the depth of a feature whose middle is flat; refuse flanks and spikes in windows."""
    used = points.in_windows
    fit = fit_without_spikes(points.build_design(), points.z, used)
    name = _find_window_reached_by_flank(fit, points.masks_by_letter)
    if name is not None:
        raise MetrologyError(
            f"window {name} of type A1 must lie on a face, but a flank or a defect reaches "
            f"into it for {points.feature}"
        )
    fewest = min((mask & fit.used).sum() for mask in points.masks_by_letter.values())
    if fit.rejected > _MOST_OUTLIERS * used.sum() or fewest < _LEAST_POINTS:
        raise MetrologyError(
            f"windows of type A1 must hold at most {_MOST_OUTLIERS:.0%} spikes, got "
            f"{fit.rejected} of {used.sum()} points for {points.feature}"
        )
    windows = _trim_windows_to_points(points, fit.used)
    nearer = (points.x >= np.mean(windows.a)) & (points.x <= np.mean(windows.b))
    _, solution = solve_for_weights_and_coefficients(fit.design, points.z, fit.used & nearer)
    return TypeA1(
        depth=fit.estimate_term(2, 2.0),
        windows=windows,
        outliers=fit.rejected,
        kind=A1Kind.A1,
        scatter=float(np.sqrt(np.mean(fit.residuals[fit.used] ** 2))),
        near=2.0 * float(solution[2]),
    )


def _find_window_reached_by_flank(fit: Fit, windows: Mapping[str, Mask]) -> str | None:
    """Return the name of the first window whose end lies off the fit, as a flank or a defect does.

    None where no end does.
    """
    noise = estimate_robust_scale(fit.residuals[fit.used])
    depth = abs(2.0 * float(fit.solution[2]))
    off = np.abs(fit.residuals) > max(SPIKE * noise, _TOLERATED * depth, LEAST_SCATTER)
    for name, mask in windows.items():
        indices = np.flatnonzero(mask)
        if off[indices[:_END]].all() or off[indices[-_END:]].all():
            return name
    return None


def _evaluate_domed_feature(points: _WindowPoints) -> TypeA1 | None:
    """Return the depth by type A2, to the apex of the parabola through the middle third.

    None where that is not domed.
    """
    if min(int(mask.sum()) for mask in points.masks_by_letter.values()) < _LEAST_POINTS_OF_DOME:
        return None
    fit = _fit_dome(points)
    if fit.rejected > _MOST_OUTLIERS * points.in_windows.sum():
        return None
    if _find_window_reached_by_flank(fit, {"A": points.a, "B": points.b}) is not None:
        return None
    depth = 2.0 * float(fit.solution[2])
    slant = float(fit.solution[3])
    bow = fit.estimate_term(4)
    if not _is_domed(bow, slant, depth) or bow.value * depth < 0.0:
        return None
    # the middle lies below the line by the depth; its apex is lower by a third of the bow and by
    # what the slant adds
    place = slant / (2.0 * bow.value)
    weights = (
        2.0 * fit.weights[2] + place * fit.weights[3] + (_MEAN_SQUARE - place**2) * fit.weights[4]
    )
    apex = make_linear_estimate(
        depth + bow.value / 3.0 + slant**2 / (4.0 * bow.value),
        weights,
        fit.residuals,
        fit.used,
        fit.design,
    )
    return TypeA1(
        depth=apex,
        windows=_trim_windows_to_points(points, np.ones_like(points.in_windows)),
        outliers=fit.rejected,
        kind=A1Kind.A2,
        scatter=apex.value,
        near=apex.value,
    )


def _fit_dome(points: _WindowPoints) -> Fit:
    """Fit slope, offset, half depth, slant of the middle third and its bow."""
    middle = points.x[points.c]
    begin = middle[0]
    end = middle[-1]
    t = np.where(points.c, 2.0 * (points.x - begin) / (end - begin) - 1.0, 0.0)
    bow = np.where(points.c, t**2 - _MEAN_SQUARE, 0.0)
    design = np.stack([*points.build_design(), t, bow])
    return fit_without_spikes(design, points.z, points.in_windows)


def _is_domed(bow: Estimate, slant: float, height: float) -> bool:
    """Tell whether a bow is more than its noise, a part of the height, and the slant [all m]."""
    least = max(_SIGNIFICANT * bow.std, _DOMED * abs(height), LEAST_SCATTER, abs(slant))
    return abs(bow.value) >= least


def estimate_apex_height(
    x: Array,
    residuals: Array,
    feature_height: float,
    span: Span | tuple[float, float],
    middle_share: float,
) -> Estimate | None:
    """Apex of a domed feature over its flat top [m], by an arc through the middle share of it.

    `residuals`, shape (n,), are those of flat tops at positions `x`, `feature_height` and `span`
    those of the feature [m]; the result is None where the top is not domed.
    """
    span = Span(*span)
    middle = 0.5 * (span.begin + span.end)
    half = 0.5 * middle_share * span.length
    used = (np.abs(x - middle) <= half) & np.isfinite(residuals)
    if used.sum() < _LEAST_POINTS_OF_DOME:
        return None
    t = np.where(used, (x - middle) / half, 0.0)
    design = np.stack([np.ones_like(t), t, t**2 - _MEAN_SQUARE])
    fit = fit_without_spikes(design, residuals, used)
    mean = fit.estimate_term(0)
    slant = float(fit.solution[1])
    bow = fit.estimate_term(2)
    if not _is_domed(bow, slant, feature_height) or bow.value * feature_height > 0.0:
        return None
    return Estimate(
        mean.value - bow.value / 3.0 - slant**2 / (4.0 * bow.value),
        float(np.hypot(mean.std, bow.std / 3.0)),
        mean.dof,
    )


def _trim_windows_to_points(points: _WindowPoints, kept: Mask) -> A1Windows:
    """Return the first and last points of the windows that were kept."""
    ends = []
    for mask in (points.a, points.c, points.b):
        positions = points.x[mask & kept]
        ends.append(Span(float(positions[0]), float(positions[-1])))
    return A1Windows(*ends)
