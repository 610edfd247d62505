"""Wavy faces beside an edge: their levels at the edge, and what is left open of them.

Two planes through wavy faces may lie micrometres off where the edge is: a radius or a flank is
judged over the faces as they end there.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.inspect.filtering import FaceLine, compute_mean_line, extrapolate_face_line, is_wavy
from stepblocks.inspect.noise import Array, estimate_autocovariance

_MOST_PLACES = 40  # of a face, at which it is tried how well it is continued
_LEAST_PLACES = 5
_ROUGH = 3.0  # windows of an edge, over which what varies is roughness beside its level [1]
_LEAST_IN_GAP = 3  # points that such a place is compared with


@dataclass(frozen=True)
class WavyFaces:
    """Wavy faces beside an edge, over the two planes through them; lengths in m."""

    middle: float  # of the edge
    lower: FaceLine
    upper: FaceLine
    noise: Array  # autocovariance of their roughness [m^2]
    # shape (4, 4); rows whose products add up to the covariance of level [m] and slope [1] of the
    # lower face and of the upper one at the edge
    errors: Array

    def compute_heights_over_planes(self, x: Array) -> Array:
        """Return how high the wavy faces lie over the two planes at positions [m]."""
        distance = x - self.middle
        is_upper = distance > 0.0
        return np.where(
            is_upper, self.upper.compute_heights(distance), self.lower.compute_heights(distance)
        )

    def compute_level_covariance_root(self, x: Array) -> Array:
        """Return rows whose products add up to the covariance of the levels, shape (4, n) [m]."""
        distance = x - self.middle
        is_upper = distance > 0.0
        is_lower = ~is_upper
        terms = [is_lower, is_lower * distance, is_upper, is_upper * distance]
        return self.errors @ np.stack([term.astype(np.float64) for term in terms])


def find_wavy_faces(
    x: Array, residuals: Array, without_bow: Array, middle: float, exclusion: float
) -> WavyFaces | None:
    """Find the levels of wavy faces at an edge.

    Parameters
    ----------
    x, residuals : array, shape (n,)
        Profile in equal steps [m]: positions, and heights over the planes; nan at the edge, and
        where a point is missing.
    without_bow : array, shape (n,)
        The heights over a parabola, which is no waviness [m].
    middle, exclusion : float
        Of the edge, and half width kept out of the faces [m].

    Returns
    -------
    WavyFaces or None
        None where roughness outweighs the waviness, or a face is too short to tell.
    """
    spacing = float((x[-1] - x[0]) / (len(x) - 1))
    is_upper = x > middle
    if not (is_wavy(without_bow[is_upper], spacing) or is_wavy(without_bow[~is_upper], spacing)):
        return None
    rough = []
    lines = []
    errors = []
    for sign, side in ((-1.0, ~is_upper), (1.0, is_upper)):
        height = residuals[side]
        known = np.isfinite(height)
        outward = sign * (x[side][known] - middle)
        root = _estimate_continuation_errors(outward, height[known], exclusion)
        if root is None:
            return None
        line = extrapolate_face_line(outward, height[known])
        lines.append(FaceLine(line.level, sign * line.slope))
        errors.append(root * np.array([1.0, sign]))
        # what varies over less than a few windows of the edge: level and slope at the edge do not
        # hold it
        waves = compute_mean_line(height, known, spacing, _ROUGH * exclusion)
        rough.append(np.where(known, height - waves, np.nan))
    lower, upper = lines
    nothing = np.zeros((2, 2))
    rows = np.block([[errors[0], nothing], [nothing, errors[1]]])
    return WavyFaces(middle, lower, upper, estimate_autocovariance(rough), rows)


def _estimate_continuation_errors(distance: Array, height: Array, gap_width: float) -> Array | None:
    """Estimate the errors of continuing a face across a gap [m].

    `distance` and `height`, shape (n,), are those of its points from the edge [m]. Returned are
    rows, shape (2, 2), whose products add up to the covariance of level [m] and slope [1]; None
    where the face is too short.
    """
    order = np.argsort(distance)
    distance = distance[order]
    height = height[order]
    last = distance[-1] - 2.0 * gap_width
    places = np.linspace(distance[0], last, _MOST_PLACES)
    misses = []
    for place in places[places <= last]:
        beyond = distance - place
        in_gap = (beyond >= 0.0) & (beyond <= gap_width)
        behind = beyond > gap_width
        if in_gap.sum() < _LEAST_IN_GAP or behind.sum() < _LEAST_IN_GAP:
            continue
        line = extrapolate_face_line(beyond[behind], height[behind])
        off = height[in_gap] - line.compute_heights(beyond[in_gap])
        slope, level = np.polyfit(beyond[in_gap], off, 1)
        misses.append((level, slope))
    if len(misses) < _LEAST_PLACES:
        return None
    scatter = np.array(misses) / np.sqrt(len(misses))
    return np.asarray(np.linalg.qr(scatter, mode="r"))
