"""The path of a probe tip over a profile: its dilation by a ball, and where the tip catches."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact import Array
from stepblocks.contact.domain import require_positive, require_profile_points
from stepblocks.contact.path import profile_kernels as kernels
from stepblocks.errors import ContactError

_NO_ELEMENT = -1
_JUMP_WIDTH = 2e-13  # radii
_FARTHEST = 0.04  # diameters between two positions at most
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
        turned = np.column_stack([-x1, z1, -x0, z0, -offset])
        elements = np.ascontiguousarray(turned)
        position = np.ascontiguousarray(-self.position[::-1])
        contact = np.ascontiguousarray(-self.contact[::-1])
        height = self.height[::-1].copy()
        counted_back = len(elements) - 1 - self.element
        renumbered = np.where(self.element < 0, _NO_ELEMENT, counted_back)
        element = renumbered[::-1].copy()
        slope = kernels.compute_path_slopes(position, contact, element, self.ball_radius)
        return TipPath(position, height, contact, slope, element, elements, self.ball_radius)


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
    # exact dilation, h(x) = max_u z(u) - t(u - x), at positions that must increase
    require_positive("ball radius", ball_radius, "m")
    xs, zs = _convert_profile_to_arrays(x, z)
    measured = _build_elements(xs, zs, ball_radius)
    elements = _add_level_ends(measured, xs, zs, ball_radius)
    if positions is None:
        positions = _choose_tip_positions(xs, ball_radius)
    height, contact, element = kernels.dilate_profile(positions, elements, ball_radius)
    slope = kernels.compute_path_slopes(positions, contact, element, ball_radius)
    return TipPath(positions, height, contact, slope, element, elements, ball_radius)


def _add_level_ends(elements: Array, x: Array, z: Array, ball_radius: float) -> Array:
    """Continue the surface level beyond both ends, farther than the tip reaches."""
    is_measured = np.isfinite(z)
    first, last = x[is_measured][[0, -1]]
    start, end = z[is_measured][[0, -1]]
    beyond = 4.0 * ball_radius
    before = [first - beyond, start, first, start, 0.0]
    behind = [last, end, last + beyond, end, 0.0]
    return np.vstack([before, elements, behind])


def _build_elements(x: Array, z: Array, ball_radius: float) -> Array:
    """List segments of a profile with the offset at which the ball is as steep as each [m].

    The shape is (m, 5); a measured point without a measured neighbour is a segment of no length.
    """
    is_measured = np.isfinite(z)
    is_joined = is_measured[:-1] & is_measured[1:]  # to the next point
    joins_left = np.append(False, is_joined)
    joins_right = np.append(is_joined, False)
    joined = np.flatnonzero(is_joined)
    lone = np.flatnonzero(is_measured & ~joins_left & ~joins_right)
    begin = np.concatenate([joined, lone])
    end = np.concatenate([joined + 1, lone])
    order = np.argsort(x[begin], kind="stable")
    begin, end = begin[order], end[order]
    x0, z0 = x[begin], z[begin]
    x1, z1 = x[end], z[end]
    rise = z1 - z0
    length = np.hypot(x1 - x0, rise)
    offset = np.zeros_like(length)
    np.divide(ball_radius * rise, length, out=offset, where=length > 0.0)
    elements = np.column_stack([x0, z0, x1, z1, offset])
    return np.ascontiguousarray(elements)


def _convert_profile_to_arrays(x: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
    """Convert positions and heights [m] to arrays; refuse those that have no path."""
    xs, zs = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    require_profile_points(xs, zs)
    if not np.isfinite(xs).all():
        raise ContactError("profile positions must be finite, got a NaN or an infinity")
    if np.isinf(zs).any():
        raise ContactError("profile heights must be finite or NaN for missing, got an infinity")
    if np.isfinite(zs).sum() < 2:
        raise ContactError("profile needs at least 2 heights that are not NaN")
    return xs, zs


def _choose_tip_positions(x: Array, ball_radius: float) -> Array:
    """Choose positions of the tip [m]: every point, and so many between that none is far."""
    # a ball meets the first point from a radius away
    begin, end = x[0] - ball_radius, x[-1] + ball_radius
    ends = np.concatenate([[begin], x, [end]])
    widths = np.diff(ends)
    farthest = _FARTHEST * (2.0 * ball_radius)
    pieces = np.maximum(np.ceil(widths / farthest), 1)
    if pieces.sum() > _MOST_POSITIONS:
        raise ContactError(
            f"profile of {end - begin:.3g} m with {ends.size} points is too long for a ball "
            f"of {ball_radius:.3g} m; cut it out around the edge"
        )
    pieces = pieces.astype(int)
    # each piece by its number between two points, and how wide it is
    counted_before = np.cumsum(pieces) - pieces
    numbers = np.arange(pieces.sum()) - np.repeat(counted_before, pieces)
    steps = np.repeat(widths / pieces, pieces)
    starts = numbers * steps + np.repeat(ends[:-1], pieces)
    return np.unique(np.append(starts, end))


class Catch(NamedTuple):
    """A place where the path of the tip is steepest in the direction of the drag."""

    position: float  # of the tip's axis [m]
    contact: float  # of the edge that is touched [m]
    # slope of the path there [rad]; 0 where it never rises, a right angle where the tip meets a
    # riser
    angle: float


def find_steepest_catch(path: TipPath, contact_range: tuple[float, float] | None = None) -> Catch:
    """Find the steepest rise of a path towards growing x, exact whatever its positions.

    `contact_range` holds the search to a range of the positions that the tip touches [m].
    """
    least = -math.inf
    if contact_range is None:
        least = _compute_lower_bound_of_steepest_slope(path)
    # steepest rise between neighbouring positions, its place, and the contact there, (n - 1, 3)
    steepest = kernels.find_steepest_in_intervals(
        path.position,
        path.height,
        path.contact,
        path.element,
        least,
        path.elements,
        path.ball_radius,
        _find_jump_width(path),
    )
    if np.isnan(steepest[:, 0]).all():
        raise ContactError("path has no two neighbouring positions with a surface under the tip")
    if contact_range is not None:
        first, last = contact_range
        touched = steepest[:, 2]
        is_inside = (touched >= first) & (touched <= last)
        if not is_inside.any():
            return Catch(math.nan, math.nan, 0.0)  # the tip touches nothing there
        steepest = steepest[is_inside]
    slope, position, contact = steepest[np.nanargmax(steepest[:, 0])].tolist()
    return Catch(position, contact, math.atan(max(slope, 0.0)))


def _compute_lower_bound_of_steepest_slope(path: TipPath) -> float:
    """Find a lower bound of the steepest slope [1]: only steeper intervals count.

    The mean slope of an interval is never more than its greatest; a little less guards against
    rounding.
    """
    rise = np.diff(path.height) / np.diff(path.position)
    measured = rise[np.isfinite(rise)]
    if measured.size == 0:
        return 0.0
    return float(measured.max()) * (1.0 - 1e-9) - 1e-9


def _find_jump_width(path: TipPath) -> float:
    """Find the width [m] below which an interval that still climbs is a jump."""
    farthest = np.abs(path.position).max()
    of_rounding = 4.0 * float(np.spacing(farthest))
    return max(_JUMP_WIDTH * path.ball_radius, of_rounding)
