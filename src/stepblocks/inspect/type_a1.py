"""Step height of a ridge or a groove by ISO 5436-1, type A1.

For a groove of width W between the edges L and R, one least-squares fit ``Z = a X + b + h d`` runs over
A = [L - W, L - W/3], C = the middle third, B = [R + W/3, R + W], with d = +1 on A and B and -1 on C; the depth is 2 h.
The profile is not filtered. A window that holds a part of a flank bends the result, and is refused or cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.levelling import weighted, without_spikes
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
_SIGNIFICANT = 4.0  # of the bow of the middle over its uncertainty, from which it is domed [1]
_DOMED = 0.03  # least bow of a domed middle, as a part of the depth [1]
_MOST_OUTLIERS = 0.1  # part of a window's points that may be spikes [1]


@dataclass(frozen=True)
class TypeA1:
    """Result of one evaluation."""

    depth: float  # 2h [m]; negative for a ridge
    noise: NoiseUncertainty  # of the depth, from noise and roughness [m]
    windows: tuple[Span, Span, Span]  # begin and end of A, C and B as evaluated [m]
    tilt: float  # slope a [1]
    outliers: int  # points left out as spikes
    kind: str  # A1, or A2 where the middle is domed
    scatter: float  # root mean square of the residuals [m]
    near: float  # depth with the outer windows cut to the half that is nearer to the feature [m]


def evaluate_a1(x: Array, z: Array, edges: Span) -> TypeA1:
    """Depth of one groove or ridge between `edges` L and R [m] in one profile (ISO 5436-1:2000, 5.2 and figure 7).

    Where the middle third is domed by more than its noise, the depth is that of type A2: to the apex of the arc through it.
    """
    left, right = edges
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
    domed = None if cuts["A"] or cuts["B"] else _domed(x, z, masks)
    if domed is not None:
        return domed
    if any(cuts.values()):
        reached = f"{', '.join(name for name, cut in cuts.items() if cut)} ({sum(cuts.values())} points) of {feature}"
        rule = "windows of type A1 must lie on the faces"
        raise MetrologyError(f"{rule}, but a flank or a defect reaches into {reached}")
    for name, mask in zip("ACB", masks, strict=True):
        if mask.sum() < _LEAST_POINTS:
            rule = f"window {name} must keep at least half of its points and {_LEAST_POINTS}"
            raise MetrologyError(f"{rule}, got {mask.sum()} of {mask.sum()} for {feature}")
    return _solve(x, z, masks, feature)


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
    near = [
        mask & (x >= 0.5 * (first[0] + first[1])) if mask is masks[0] else mask & (x <= 0.5 * (last[0] + last[1]))
        for mask in masks[::2]
    ]
    close = 2.0 * float(weighted(design, z, near[0] | masks[1] | near[1])[1][2])
    scatter = float(np.sqrt(np.mean(residuals[used] ** 2)))
    return TypeA1(depth, noise, (first, middle, last), tilt, whole - int(used.sum()), "A1", scatter, close)


def _domed(x: Array, z: Array, masks: list[Mask]) -> TypeA1 | None:
    """Type A2, to the apex of the parabola through the middle third; None where that is not domed."""
    if min(int(mask.sum()) for mask in masks) < 2 * _LEAST_POINTS:
        return None
    flat, _, _, used, design = _fit(x, without_spikes(z), masks)
    begin, end = x[masks[1]][0], x[masks[1]][-1]
    t = np.where(masks[1], 2.0 * (x - begin) / (end - begin) - 1.0, 0.0)
    columns = np.stack([*design, t, np.where(masks[1], t**2 - 1.0 / 3.0, 0.0)])
    for _ in range(4):
        weights, solution = weighted(columns, z, used)
        residuals = z - solution @ columns
        spikes = outlier_mask(residuals, used)
        if not spikes.any() or spikes.sum() > _MOST_OUTLIERS * used.sum():
            break
        used = used & ~spikes
    depth, slant, bow = 2.0 * float(solution[2]), float(solution[3]), float(solution[4])
    bows = noise_uncertainty(weights[4], residuals, used, list(columns))
    if (
        abs(bow) < max(_SIGNIFICANT * bows.std, _DOMED * abs(depth), LEAST_SCATTER)
        or bow * depth < 0.0
        or abs(slant) > abs(bow)
    ):
        return None
    # the middle lies below the line by the depth; its apex is lower by a third of the bow and by what the slant adds
    apex = depth + bow / 3.0 + slant**2 / (4.0 * bow)
    half = slant / (2.0 * bow)
    noise = noise_uncertainty(
        2.0 * weights[2] + half * weights[3] + (1.0 / 3.0 - half**2) * weights[4], residuals, used, list(columns)
    )
    first, middle, last = ((float(x[mask][0]), float(x[mask][-1])) for mask in masks)
    return TypeA1(
        apex,
        noise,
        (first, middle, last),
        float(flat[0]),
        int(sum(int(mask.sum()) for mask in masks) - used.sum()),
        "A2",
        apex,
        apex,
    )
