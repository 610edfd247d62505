"""Step height of a ridge or a groove by ISO 5436-1, type A1.

For a groove of width W between the edges L and R, one least-squares fit ``Z = a X + b + h d`` runs
over A = [L - W, L - W/3], C = the middle third, B = [R + W/3, R + W], with d = +1 on A and B and -1
on C; the depth is 2 h. The profile is not filtered. A window that holds a part of a flank bends the
result, and is refused.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import Fit, fit_without_spikes, solve_least_squares
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    SPIKE,
    Array,
    Estimate,
    Mask,
    estimate_linear,
    estimate_robust_scale,
)

Span = tuple[float, float]

_LEAST_POINTS = 5  # of a window
_TOLERATED = 0.01  # deviation of a window's end that is no flank, as a part of the depth [1]
_SIGNIFICANT = 4.0  # of the bow of the middle over its uncertainty, from which it is domed [1]
_DOMED = 0.03  # least bow of a domed middle, as a part of the depth [1]
_MOST_OUTLIERS = 0.1  # part of a window's points that may be spikes [1]


@dataclass(frozen=True)
class TypeA1:
    """Result of one evaluation."""

    depth: Estimate  # 2h [m]; negative for a ridge
    windows: tuple[Span, Span, Span]  # begin and end of A, C and B as evaluated [m]
    outliers: int  # points left out as spikes
    kind: str  # A1, or A2 where the middle is domed
    scatter: float  # root mean square of the residuals [m]
    near: float  # depth with the outer windows cut to the half that is nearer to the feature [m]


def evaluate_a1(x: Array, z: Array, edges: Span) -> TypeA1:
    """Depth of one groove or ridge between `edges` L and R in one profile [m].

    ISO 5436-1:2000, 5.2 and figure 7, defines it.
    """
    # Where the middle third is domed by more than its noise, the depth is that of type A2: to the
    # apex of the arc through it.
    left, right = edges
    width = right - left
    MetrologyError.require(width > 0.0, f"edges must be in order, got {left:g} and {right:g} m")
    outer = (left - width, left - width / 3), (right + width / 3, right + width)
    spans = outer[0], (left + width / 3, right - width / 3), outer[1]
    slack = 0.5 * (x[-1] - x[0]) / (len(x) - 1)
    MetrologyError.require(
        x[0] - slack <= spans[0][0] and spans[2][1] <= x[-1] + slack,
        f"profile must reach one width ({width * 1e6:.4g} um) beyond the edges, from "
        f"{spans[0][0] * 1e6:.4g} to "
        f"{spans[2][1] * 1e6:.4g} um, got {x[0] * 1e6:.4g} to {x[-1] * 1e6:.4g} um",
    )
    feature = f"the feature from {left * 1e6:.4g} to {right * 1e6:.4g} um"
    masks = [(x >= begin) & (x <= end) & np.isfinite(z) for begin, end in spans]
    for name, mask in zip("ACB", masks, strict=True):
        MetrologyError.require(
            mask.sum() >= _LEAST_POINTS,
            f"window {name} must keep {_LEAST_POINTS} points, got {mask.sum()} for {feature}",
        )
    used = masks[0] | masks[1] | masks[2]
    design = np.stack(
        [(x - x[used].mean()) / np.ptp(x[used]), np.ones_like(x), np.where(masks[1], -1.0, 1.0)]
    )
    return _evaluate_domed(x, z, masks, used, design) or _evaluate_flat(
        x, z, masks, used, design, feature
    )


def _evaluate_flat(
    x: Array, z: Array, masks: list[Mask], used: Mask, design: Array, feature: str
) -> TypeA1:
    fit = fit_without_spikes(design, z, used)
    MetrologyError.require(
        not (name := _find_flank_window(fit, dict(zip("ACB", masks, strict=True)))),
        f"window {name} of type A1 must lie on a face, but a flank or a defect reaches "
        f"into it for {feature}",
    )
    MetrologyError.require(
        fit.rejected <= _MOST_OUTLIERS * used.sum()
        and all((mask & fit.used).sum() >= _LEAST_POINTS for mask in masks),
        f"windows of type A1 must hold at most {_MOST_OUTLIERS:.0%} spikes, got "
        f"{fit.rejected} of {used.sum()} points for {feature}",
    )
    kept = [x[mask & fit.used] for mask in masks]
    inner = (x >= np.mean(kept[0][[0, -1]])) & (x <= np.mean(kept[2][[0, -1]]))
    return TypeA1(
        fit.estimate(2, 2.0),
        _list_window_ends(kept),
        fit.rejected,
        "A1",
        float(np.sqrt(np.mean(fit.residuals[fit.used] ** 2))),
        2.0 * float(solve_least_squares(fit.design, z, fit.used & inner)[1][2]),
    )


def _find_flank_window(fit: Fit, windows: dict[str, Mask]) -> str:
    # Name the first window whose end lies off the fit, as a flank or a defect does; empty where
    # none does.
    noise = estimate_robust_scale(fit.residuals[fit.used])
    depth = abs(2.0 * float(fit.solution[2]))
    off = np.abs(fit.residuals) > max(SPIKE * noise, _TOLERATED * depth, LEAST_SCATTER)
    ends = {name: np.flatnonzero(mask) for name, mask in windows.items()}
    return next(
        (name for name, own in ends.items() if off[own[:3]].all() or off[own[-3:]].all()), ""
    )


def _evaluate_domed(
    x: Array, z: Array, masks: list[Mask], used: Mask, flat: Array
) -> TypeA1 | None:
    # Type A2, to the apex of the parabola through the middle third; None where that is not domed.
    if min(int(mask.sum()) for mask in masks) < 2 * _LEAST_POINTS:
        return None
    begin, end = x[masks[1]][[0, -1]]
    t = np.where(masks[1], 2.0 * (x - begin) / (end - begin) - 1.0, 0.0)
    design = np.stack([*flat, t, np.where(masks[1], t**2 - 1.0 / 3.0, 0.0)])
    fit = fit_without_spikes(design, z, used)
    if fit.rejected > _MOST_OUTLIERS * used.sum() or _find_flank_window(
        fit, {"A": masks[0], "B": masks[2]}
    ):
        return None
    depth = 2.0 * float(fit.solution[2])
    slant = float(fit.solution[3])
    bow = fit.estimate(4)
    least = max(_SIGNIFICANT * bow.std, _DOMED * abs(depth), LEAST_SCATTER, abs(slant))
    if abs(bow.value) < least or bow.value * depth < 0.0:
        return None
    # the middle lies below the line by the depth; its apex is lower by a third of the bow and by
    # what the slant adds
    half = slant / (2.0 * bow.value)
    weights = 2.0 * fit.weights[2] + half * fit.weights[3] + (1.0 / 3.0 - half**2) * fit.weights[4]
    apex = estimate_linear(
        depth + bow.value / 3.0 + slant**2 / (4.0 * bow.value),
        weights,
        fit.residuals,
        fit.used,
        fit.design,
    )
    return TypeA1(
        apex,
        _list_window_ends([x[mask] for mask in masks]),
        fit.rejected,
        "A2",
        apex.value,
        apex.value,
    )


def find_apex(x: Array, rest: Array, height: float, span: Span, part: float) -> Estimate | None:
    """Apex of a domed feature over its flat top, by an arc through the middle `part` of it [m].

    `rest` are the residuals of flat tops; the result is None where the top is not domed.
    """
    middle, half = 0.5 * (span[0] + span[1]), 0.5 * part * (span[1] - span[0])
    used = (np.abs(x - middle) <= half) & np.isfinite(rest)
    if used.sum() < 2 * _LEAST_POINTS:
        return None
    t = np.where(used, (x - middle) / half, 0.0)
    fit = fit_without_spikes(np.stack([np.ones_like(t), t, t**2 - 1.0 / 3.0]), rest, used)
    mean, slant, bow = (fit.estimate(power) for power in range(3))
    least = max(_SIGNIFICANT * bow.std, _DOMED * abs(height), LEAST_SCATTER, abs(slant.value))
    if abs(bow.value) < least or bow.value * height > 0.0:
        return None
    return Estimate(
        mean.value - bow.value / 3.0 - slant.value**2 / (4.0 * bow.value),
        float(np.hypot(mean.std, bow.std / 3.0)),
        mean.dof,
    )


def _list_window_ends(windows: list[Array]) -> tuple[Span, Span, Span]:
    first, middle, last = ((float(one[0]), float(one[-1])) for one in windows)
    return first, middle, last
