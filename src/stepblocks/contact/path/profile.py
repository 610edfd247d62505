"""The path of a probe tip over a profile: exact dilation by a ball, contact points and the slope that a drag meets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact.domain import require_positive
from stepblocks.contact.path import profile_kernels as kernels
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]
Edges = Literal["strict", "flat"]


@dataclass(frozen=True)
class Ball:
    """A spherical tip; its arcs are handled in closed form."""

    radius: float  # R [m]

    def __post_init__(self) -> None:
        require_positive("ball radius", self.radius, "m")


@dataclass(frozen=True)
class TipPath:
    """Where the tip's lowest point runs while the tip is dragged over a profile."""

    position: Floats  # shape (n,); of the tip's axis along the drag [m], increasing
    height: Floats  # shape (n,); of the tip's lowest point [m]; NaN where the tip has no surface under it
    contact: Floats  # shape (n,); position of the point that is touched [m]
    slope: Floats  # shape (n,); of the path just ahead of the tip [1], exact: from the contact, not from differences
    supported: NDArray[np.bool_]  # shape (n,); False where missing samples or a levelled end lie within the tip's reach
    element: NDArray[np.int64]  # shape (n,); which row of `elements` is touched; -1 for none
    elements: Floats  # shape (m, 5); the surface as segments (x0, z0, x1, z1, contact offset) [m]
    tip: Ball


def profile_path(
    x: ArrayLike, z: ArrayLike, tip: Ball, *, positions: ArrayLike | None = None, edges: Edges = "strict"
) -> TipPath:
    """Path of a tip over a profile by exact dilation, ``h(x) = max_u z(u) - t(u - x)``.

    Points [m] come in order of `x`, two equal ones are a riser, straight lines join them; NaN heights were not measured.
    ``strict`` keeps to positions at which nothing beyond the ends could be touched, ``flat`` lets the surface go on level.
    Without `positions` those of the profile are taken, and points between them at most a 25th of the ball's width apart.

    Examples
    --------
    A ball meets a sharp step of 25 um at the critical angle of equation (2).

    >>> path = profile_path([-1e-3, 0, 0, 1e-3], [0, 0, 25e-6, 25e-6], Ball(125e-6))
    >>> from stepblocks.contact.path.catches import steepest
    >>> round(float(np.degrees(steepest(path).angle)), 6)
    36.869898
    """
    xs, zs = _checked(x, z)
    finite, width = np.isfinite(zs), 2.0 * tip.radius
    elements = _elements(xs, zs, tip.radius)
    used = _effective_reach(tip.radius, float(np.ptp(zs[finite])))
    if edges == "flat":
        (first, last), (start, end) = xs[finite][[0, -1]], zs[finite][[0, -1]]
        before = [first - 2.0 * width, start, first, start, 0.0]
        elements = np.vstack([before, elements, [last, end, last + 2.0 * width, end, 0.0]])
    elif xs[-1] - xs[0] < used[1] - used[0]:
        raise ContactError(
            f"tip reaches over {used[1] - used[0]:.3g} m and must not be larger than the profile "
            f"({xs[-1] - xs[0]:.3g} m); shorten it or use edges='flat'"
        )
    where = _positions(xs, positions, width, used, edges)
    height, contact, which = kernels.dilate_profile(where, elements, tip.radius)
    slope = kernels.path_slopes(where, contact, which, tip.radius)
    return TipPath(where, height, contact, slope, _supported(xs, finite, where, used), which, elements, tip)


def _elements(x: Floats, z: Floats, radius: float) -> Floats:
    """Segments of a profile with the offset at which the ball is as steep as each, shape (m, 5) [m]."""
    finite = np.isfinite(z)
    joined = finite[:-1] & finite[1:]
    lone = finite & ~np.concatenate([[False], joined]) & ~np.concatenate([joined, [False]])
    ends = x[:-1], z[:-1], x[1:], z[1:]
    pieces = [np.concatenate([end[joined], own[lone]]) for end, own in zip(ends, (x, z, x, z), strict=True)]
    order = np.argsort(pieces[0], kind="stable")
    x0, z0, x1, z1 = (piece[order] for piece in pieces)
    length = np.hypot(x1 - x0, z1 - z0)
    offset = np.divide(radius * (z1 - z0), length, out=np.zeros_like(length), where=length > 0.0)
    return np.ascontiguousarray(np.column_stack([x0, z0, x1, z1, offset]))


def _checked(x: ArrayLike, z: ArrayLike) -> tuple[Floats, Floats]:
    xs, zs = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    if xs.ndim != 1 or xs.shape != zs.shape:
        raise ContactError(f"profile needs x and z of one equal length, got shapes {xs.shape} and {zs.shape}")
    if xs.size < 2:
        raise ContactError(f"profile needs at least 2 points, got {xs.size}")
    if not np.isfinite(xs).all():
        raise ContactError("profile positions must be finite, got a NaN or an infinity")
    if np.isinf(zs).any():
        raise ContactError("profile heights must be finite or NaN for missing, got an infinity")
    if np.isfinite(zs).sum() < 2:
        raise ContactError("profile needs at least 2 heights that are not NaN")
    if (np.diff(xs) < 0.0).any():
        raise ContactError(f"profile positions must not decrease, they do at point {int(np.argmin(np.diff(xs))) + 1}")
    if xs[-1] == xs[0]:
        raise ContactError("profile must extend along x, got a single position")
    return xs, zs


def _effective_reach(radius: float, span: float) -> tuple[float, float]:
    """Find the part of the ball that can touch a surface of this height range."""
    half = radius if span >= radius else float(np.sqrt(span * (2.0 * radius - span)))
    return -half, half


def _positions(x: Floats, wanted: ArrayLike | None, reach: float, used: tuple[float, float], edges: Edges) -> Floats:
    if wanted is None:
        pieces = np.maximum(np.ceil(np.diff(x) / (0.04 * reach)), 1).astype(int)
        if pieces.max() == 1:
            where = np.unique(x)
        else:
            parts = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(x[:-1], x[1:], pieces, strict=True)]
            where = np.unique(np.concatenate([*parts, x[-1:]]))
        if edges == "strict":
            # the first and last tip positions that the profile fully decides are always among them
            ends = [x[0] - used[0], x[-1] - used[1]]
            inner = (where > ends[0]) & (where < ends[1])
            where = np.unique(np.concatenate([ends[:1], where[inner], ends[1:]]))
        return np.ascontiguousarray(where)
    given = np.asarray(wanted, dtype=np.float64)
    if given.ndim != 1 or given.size == 0 or not np.isfinite(given).all() or (np.diff(given) <= 0.0).any():
        raise ContactError("positions must be finite and increase strictly, and there must be at least one")
    first, last = (x[0] - used[0], x[-1] - used[1]) if edges == "strict" else (x[0], x[-1])
    if given[0] < first or given[-1] > last:
        raise ContactError(
            f"positions must lie between {first:.6g} m and {last:.6g} m with edges={edges!r}, "
            f"got {given[0]:.6g} m to {given[-1]:.6g} m"
        )
    return np.ascontiguousarray(given)


def _supported(x: Floats, finite: NDArray[np.bool_], where: Floats, used: tuple[float, float]) -> NDArray[np.bool_]:
    inside = (where + used[0] >= x[0] * (1 - 1e-12 * np.sign(x[0]))) & (where + used[1] <= x[-1] + 1e-12 * abs(x[-1]))
    if finite.all():
        return np.asarray(inside)
    holes = x[~finite]
    first = np.searchsorted(holes, where + used[0], side="left")
    last = np.searchsorted(holes, where + used[1], side="right")
    return np.asarray(inside & (first == last))
