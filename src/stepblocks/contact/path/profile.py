"""The path of a probe tip over a profile.

Exact dilation by a ball, what it touches, and where the tip catches.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact import Array
from stepblocks.contact.domain import require_points, require_positive
from stepblocks.contact.path import profile_kernels as kernels
from stepblocks.errors import ContactError

_MOST_POSITIONS = 4_000_000  # of the path; it takes 100 bytes for each


@dataclass(frozen=True)
class TipPath:
    """Where the tip's lowest point runs while the tip is dragged over a profile."""

    position: Array  # shape (n,); of the tip's axis along the drag [m], increasing
    # shape (n,); of the tip's lowest point [m]; NaN where the tip has no surface under it
    height: Array
    contact: Array  # shape (n,); position of the point that is touched [m]
    # shape (n,); of the path just ahead of the tip [1], exact: from the contact, not from
    # differences
    slope: Array
    element: NDArray[np.int64]  # shape (n,); which row of `elements` is touched; -1 for none
    elements: Array  # shape (m, 5); the surface as segments (x0, z0, x1, z1, contact offset) [m]
    ball_radius: float  # R [m]

    def mirrored(self) -> "TipPath":
        """Return the path as it is met on the way back."""
        x0, z0, x1, z1, offset = self.elements[::-1].T
        elements = np.ascontiguousarray(np.column_stack([-x1, z1, -x0, z0, -offset]))
        position, contact = (
            np.ascontiguousarray(-self.position[::-1]),
            np.ascontiguousarray(-self.contact[::-1]),
        )
        element = np.where(self.element < 0, -1, len(elements) - 1 - self.element)[::-1].copy()
        return TipPath(
            position,
            self.height[::-1].copy(),
            contact,
            kernels.compute_path_slopes(position, contact, element, self.ball_radius),
            element,
            elements,
            self.ball_radius,
        )


def build_profile_path(
    x: ArrayLike,
    z: ArrayLike,
    ball_radius: float,
    *,
    positions: Array | None = None,
) -> TipPath:
    """Path of a ball [m] over points in order of `x`, joined by lines.

    Two points at one place are a riser; a point of NaN was not measured.
    """
    # exact dilation, h(x) = max_u z(u) - t(u - x), at positions that must increase; the surface
    # goes on level beyond both ends
    require_positive("ball radius", ball_radius, "m")
    xs, zs = _check_profile(x, z)
    finite = np.isfinite(zs)
    width = 2.0 * ball_radius
    elements = _list_elements(xs, zs, ball_radius)
    (first, last), (start, end) = xs[finite][[0, -1]], zs[finite][[0, -1]]
    elements = np.vstack(
        [
            [first - 2.0 * width, start, first, start, 0.0],
            elements,
            [last, end, last + 2.0 * width, end, 0.0],
        ]
    )
    where = _choose_positions(xs, width) if positions is None else positions
    height, contact, which = kernels.dilate_profile(where, elements, ball_radius)
    return TipPath(
        where,
        height,
        contact,
        kernels.compute_path_slopes(where, contact, which, ball_radius),
        which,
        elements,
        ball_radius,
    )


def _list_elements(x: Array, z: Array, radius: float) -> Array:
    # Segments of a profile with the offset at which the ball is as steep as each, shape (m, 5) [m]
    finite = np.isfinite(z)
    joined = finite[:-1] & finite[1:]
    lone = finite & ~np.concatenate([[False], joined]) & ~np.concatenate([joined, [False]])
    ends = x[:-1], z[:-1], x[1:], z[1:]
    pieces = [
        np.concatenate([end[joined], own[lone]])
        for end, own in zip(ends, (x, z, x, z), strict=True)
    ]
    order = np.argsort(pieces[0], kind="stable")
    x0, z0, x1, z1 = (piece[order] for piece in pieces)
    length = np.hypot(x1 - x0, z1 - z0)
    offset = np.divide(radius * (z1 - z0), length, out=np.zeros_like(length), where=length > 0.0)
    return np.ascontiguousarray(np.column_stack([x0, z0, x1, z1, offset]))


def _check_profile(x: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
    xs, zs = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    require_points(xs, zs)
    ContactError.require(
        np.isfinite(xs).all(), "profile positions must be finite, got a NaN or an infinity"
    )
    ContactError.require(
        not np.isinf(zs).any(), "profile heights must be finite or NaN for missing, got an infinity"
    )
    ContactError.require(
        np.isfinite(zs).sum() >= 2, "profile needs at least 2 heights that are not NaN"
    )
    return xs, zs


def _choose_positions(x: Array, width: float) -> Array:
    # a ball meets the first point from a radius away
    x = np.concatenate([[x[0] - 0.5 * width], x, [x[-1] + 0.5 * width]])
    pieces = np.maximum(np.ceil(np.diff(x) / (0.04 * width)), 1)
    ContactError.require(
        pieces.sum() <= _MOST_POSITIONS,
        f"profile of {x[-1] - x[0]:.3g} m with {x.size} points is too long for a ball of "
        f"{0.5 * width:.3g} m; cut it out around the edge",
    )
    pieces = pieces.astype(int)
    number = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    starts = number * np.repeat(np.diff(x) / pieces, pieces) + np.repeat(x[:-1], pieces)
    return np.unique(np.append(starts, x[-1]))


class Catch(NamedTuple):
    """A place where the path of the tip is steepest in the direction of the drag."""

    position: float  # of the tip's axis [m]
    contact: float  # of the edge that is touched [m]
    # slope of the path there [rad]; 0 where it never rises, a right angle where the tip meets a
    # riser
    angle: float


def find_steepest_catch(path: TipPath, within: tuple[float, float] | None = None) -> Catch:
    """Find the steepest rise of a path towards growing x, exact whatever its positions.

    `within` holds the search to a range of the positions that the tip touches [m].
    """
    rise = np.diff(path.height) / np.diff(path.position)
    finite = rise[np.isfinite(rise)]
    # the mean slope of an interval is never more than its greatest, a little less guards against
    # rounding: only steeper ones count
    floor = float(finite.max()) * (1.0 - 1e-9) - 1e-9 if finite.size else 0.0
    # steepest rise between neighbouring positions, its place, and the contact there, (n - 1, 3)
    slopes = kernels.find_steepest_in_each(
        path.position,
        path.height,
        path.contact,
        path.element,
        -math.inf if within is not None else floor,
        path.elements,
        path.ball_radius,
        max(2e-13 * path.ball_radius, 4.0 * float(np.spacing(np.abs(path.position).max()))),
    )
    ContactError.require(
        not np.isnan(slopes[:, 0]).all(),
        "path has no two neighbouring positions with a surface under the tip",
    )
    if within is not None:
        inside = (slopes[:, 2] >= within[0]) & (slopes[:, 2] <= within[1])
        if not inside.any():
            return Catch(math.nan, math.nan, 0.0)  # the tip touches nothing there
        slopes = slopes[inside]
    slope, where, contact = map(float, slopes[np.nanargmax(slopes[:, 0])])
    return Catch(where, contact, math.atan(max(slope, 0.0)))
