"""Step height of a ridge or a groove by ISO 5436-1, type A1.

For a groove of width W between the edges L and R, one least-squares fit ``Z = a X + b + h d`` runs over
A = [L - W, L - W/3], C = the middle third, B = [R + W/3, R + W], with d = +1 on A and B and -1 on C; the depth is 2 h.
The profile is not filtered. A window that holds a part of a flank bends the result, and is refused or cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import despiked, roughly_levelled, two_levels, weighted, without_spikes
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    SPIKE,
    Array,
    Mask,
    NoiseUncertainty,
    noise_uncertainty,
    outlier_mask,
    robust_scale,
)

Span = tuple[float, float]

_LEAST_POINTS = 5  # of a window
_TOLERATED = 0.01  # deviation of a window's points that is no flank, as a part of the depth [1]
_MOST_OUTLIERS = 0.1  # part of a window's points that may be spikes [1]


@dataclass(frozen=True)
class TypeA1:
    """Result of one evaluation."""

    depth: float  # 2h [m]; negative for a ridge
    noise: NoiseUncertainty  # of the depth, from noise and roughness [m]
    windows: tuple[Span, Span, Span]  # begin and end of A, C and B as evaluated [m]
    tilt: float  # slope a [1]
    outliers: int  # points left out as spikes


def find_features(x: Array, z: Array) -> list[Span]:
    """Edges L and R of every groove or ridge that lies wholly inside a profile."""
    known = np.isfinite(z)
    x, z = x[known], z[known]
    if len(x) < 4 * _LEAST_POINTS:
        raise MetrologyError(f"profile must have at least {4 * _LEAST_POINTS} measured points, got {len(x)}")
    level = despiked(roughly_levelled(x, z))
    lower, upper = two_levels(level)
    middle = 0.5 * (lower + upper)
    inside = level < middle if (level < middle).sum() <= 0.5 * len(level) else level > middle
    change = np.flatnonzero(np.diff(inside.astype(np.int8)))
    # `interp` asks for rising levels
    pairs = [np.array([level[i : i + 2], x[i : i + 2]])[:, :: 1 if level[i] <= level[i + 1] else -1] for i in change]
    crossings = [float(np.interp(middle, *pair)) for pair in pairs]
    begin = 1 if inside[0] else 0
    return list(zip(crossings[begin::2], crossings[begin + 1 :: 2], strict=False))


def evaluate_a1(x: Array, z: Array, edges: Span | None = None) -> TypeA1:
    """Depth of one groove or ridge in one profile [m], nan where nothing was measured (ISO 5436-1:2000, 5.2 and figure 7).

    `edges` are L and R [m]; found where not given, and then there must be one feature.
    """
    left, right = edges if edges is not None else _only_feature(x, z)
    width = right - left
    if not width > 0.0:
        raise MetrologyError(f"edges must be in order, got {left:g} and {right:g} m")
    outer = (left - width, left - width / 3), (right + width / 3, right + width)
    spans = outer[0], (left + width / 3, right - width / 3), outer[1]
    slack = 0.5 * (x[-1] - x[0]) / (len(x) - 1)
    if spans[0][0] < x[0] - slack or spans[2][1] > x[-1] + slack:
        raise MetrologyError(
            f"profile must reach one width ({width * 1e6:.4g} um) beyond the edges, from {spans[0][0] * 1e6:.4g} to "
            f"{spans[2][1] * 1e6:.4g} um, got {x[0] * 1e6:.4g} to {x[-1] * 1e6:.4g} um"
        )
    masks = [(x >= begin) & (x <= end) & np.isfinite(z) for begin, end in spans]
    feature = f"the feature from {left * 1e6:.4g} to {right * 1e6:.4g} um"
    cuts = {name: _flank_points(x, z, mask, masks) for name, mask in zip("ACB", masks, strict=True)}
    if any(cuts.values()):
        reached = f"{', '.join(name for name, cut in cuts.items() if cut)} ({sum(cuts.values())} points) of {feature}"
        rule = "windows of type A1 must lie on the faces"
        raise MetrologyError(f"{rule}, but a flank or a defect reaches into {reached}")
    for name, mask in zip("ACB", masks, strict=True):
        if mask.sum() < _LEAST_POINTS:
            rule = f"window {name} must keep at least half of its points and {_LEAST_POINTS}"
            raise MetrologyError(f"{rule}, got {mask.sum()} of {mask.sum()} for {feature}")
    return _solve(x, z, masks, feature)


def _only_feature(x: Array, z: Array) -> Span:
    found = find_features(x, z)
    if len(found) != 1:
        raise MetrologyError(f"profile must hold exactly one ridge or groove with both flanks, got {len(found)}")
    return found[0]


def _fit(x: Array, z: Array, masks: list[Mask]) -> tuple[Array, Array, Array, Mask, Array]:
    used = masks[0] | masks[1] | masks[2]
    origin, scale = float(x[used].mean()), float(np.ptp(x[used]))
    design = np.stack([(x - origin) / scale, np.ones_like(x), np.where(masks[1], -1.0, 1.0)])
    weights, solution = weighted(design, z, used)
    solution[0] /= scale
    weights[0] /= scale
    return solution, weights, z - (solution[0] * (x - origin) + solution[1:] @ design[1:]), used, design


def _flank_points(x: Array, z: Array, mask: Mask, masks: list[Mask]) -> int:
    """Count the points at the ends of a window that lie on a flank."""
    if mask.sum() < _LEAST_POINTS:
        return 0
    # the inner half of each window is judged clean; the fit through these halves is the reference
    cores = [_core(one) for one in masks]
    if any(core.sum() < 2 for core in cores):
        return 0
    solution, _, residuals, used, _ = _fit(x, z, cores)
    depth = abs(2.0 * float(solution[2]))
    own = float(np.median(residuals[_core(mask)]))
    # `residuals` takes d = +1 outside C, so a point of another window is judged against its own side
    side = -1.0 if mask is masks[1] else 1.0
    origin = float(x[used].mean())
    deviation = z - (solution[0] * (x - origin) + solution[1] + solution[2] * side) - own
    noise = max(robust_scale(residuals[used]), LEAST_SCATTER)
    size, limit = np.abs(deviation[mask]), max(SPIKE * noise, _TOLERATED * depth)
    return min(sum(_flank_length(inward, limit, 2.0 * noise) for inward in (size, size[::-1])), len(size))


def _flank_length(size: Array, limit: float, floor: float) -> int:
    """Count the points from the end of a window that belong to a flank: off the face at the end, until they are on it.

    A flank is recognised by `limit` and followed down to `floor`, or its foot would stay in the window.
    """
    if not (size[:3] > limit).all():
        return 0
    back = np.flatnonzero(size <= floor)
    return int(back[0]) if back.size else len(size)


def _core(mask: Mask) -> Mask:
    index = np.flatnonzero(mask)
    quarter = len(index) // 4
    core = np.zeros_like(mask)
    core[index[quarter : len(index) - quarter]] = True
    return core


def _solve(x: Array, z: Array, masks: list[Mask], feature: str) -> TypeA1:
    whole = int(sum(mask.sum() for mask in masks))
    calm = without_spikes(z)
    solution, weights, residuals, used, design = _fit(x, calm, masks)
    residuals = z - calm + residuals
    for _ in range(6):
        spikes = outlier_mask(residuals, used)
        outliers = whole - int(used.sum()) + int(spikes.sum())
        if outliers > _MOST_OUTLIERS * whole or any((mask & ~spikes).sum() < _LEAST_POINTS for mask in masks):
            rule = f"windows of type A1 must hold at most {_MOST_OUTLIERS:.0%} spikes"
            raise MetrologyError(f"{rule}, got {outliers} of {whole} points for {feature}")
        masks = [mask & ~spikes for mask in masks]
        solution, weights, residuals, used, design = _fit(x, z, masks)
        if not spikes.any():
            break
    noise = noise_uncertainty(2.0 * weights[2], residuals, used, list(design))
    first, middle, last = ((float(x[mask][0]), float(x[mask][-1])) for mask in masks)
    tilt, depth = float(solution[0]), 2.0 * float(solution[2])
    return TypeA1(depth, noise, (first, middle, last), tilt, whole - int(used.sum()))
