"""A single edge in a profile: height of the step by two planes, radius of the edge by its arc.

A single edge is not type A1 of ISO 5436-1. By the convention here one common slope and two offsets
are fitted to the faces beyond the exclusion; the height is the difference of the offsets. The
radius comes from the points inside the exclusion.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.inspect.edge_arc import Arc, EdgeWindow, compute_edge_profile, fit_arc
from stepblocks.inspect.edge_flank import Flank, fit_flank
from stepblocks.inspect.edge_waviness import WavyFaces, find_wavy_faces
from stepblocks.inspect.form import FaceForm, estimate_zone
from stepblocks.inspect.found_edges import FoundEdge, find_edges
from stepblocks.inspect.levelling import (
    LEAST_FACE,
    TwoPlanes,
    filter_by_running_median,
    fit_two_planes,
    fit_without_spikes,
)
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    Array,
    Estimate,
    Mask,
    compute_estimator_covariance,
    estimate_autocovariance,
    factor_covariance,
)
from stepblocks.inspect.waviness import estimate_height_beside_waves

# mean square of whitened residuals on the arc beyond which one of its points may be a spike [1]
_SUSPECT = 4.0
# factor by which that falls when the spike is left out [1]; form of the edge is in all points and
# falls by less
_BY_FAR = 2.5
# of the height, from which an arc leaves no riser to distinguish it from [1]
NO_RISER = 0.7
_BETTER = 1.5  # of the residuals of the arc over those of the flank, from which it is a flank [1]
_GENTLER_STDS = 3.0  # standard uncertainties by which a flank is gentler than an arc [1]
_GENTLER = np.radians(5.0)  # angle by which it is gentler besides [rad]
_LEAST_EXCLUSION = 16.0  # sampling intervals kept out of the faces where the edge is sharp [1]
_LEAST_FACE_SHARE = 3.0  # exclusions from the edge to the nearer end of the profile, at least [1]
_WIDER = 1.5  # exclusion over the width of the rounding [1]
_MOST_DROPPED = 0.2  # part of the points of a face, or at an edge, that may be spikes [1]
_MOST_ON_ARC = 3  # spikes that are sought on an arc
_LEAST_ON_ARC = 8  # points that stay
_LEAST_STEP = 5.0  # height of a step over its uncertainty [1]
_SPIKE = 6.0  # roughnesses by which a point at an edge stands out of its neighbours [1]
_OFF_FACE = 6.0  # roughnesses by which a point lies off its face [1]
_OFF_FACE_HEIGHT = 1e-3  # part of the height by which it does [1]
_IN_A_ROW = 10  # points on their faces, behind which a rounding has ended
_MIDDLE = 0.25  # of the height to either side of its middle, where a riser is straight [1]
_RISER_DEGREE = 3
# scatter of radii beside waves over what their fits say, as soft gauges with chatter and random
# waviness show it: the waves go on under the arc otherwise than beside it [1]
_BESIDE_WAVES = 1.4


@dataclass(frozen=True)
class LevelledPoints:
    """Points of a profile beside its edge, arrays of shape (n,) [m]."""

    across: Array  # distance from the edge to the upper face
    level: Array  # height over the lower face


@dataclass(frozen=True)
class Edge:
    """What one profile across one edge says; lengths in m.

    Attributes
    ----------
    height : Estimate
        Of the step, by the two-plane convention.
    radius : Estimate
        Of the rounded edge; of a sharp one a part of the sampling interval, as is its uncertainty.
    radius_limit : float
        Upper limit of the radius at 95 %: what a sharp edge of this sampling may still have.
    position : float
        Of the riser along the profile.
    middle : float
        Where half of the height is crossed, from which the exclusion counts.
    tilt, offset : float
        Common slope of the faces [1], and height of the lower face at position 0.
    exclusion : float
        Half width that was kept out of the faces.
    rejected : int
        Points taken for spikes, or missing.
    rising : bool
        Whether the higher face lies at larger positions.
    flank : Flank or None
        Where the flank slopes and the edge is no arc.
    dropped : array of bool, shape (n,)
        Points left out as spikes, along the profile as given.
    noise : array, shape (lags,)
        Autocovariance of the noise of the faces [m^2].
    """

    height: Estimate
    radius: Estimate
    radius_limit: float
    position: float
    middle: float
    tilt: float
    offset: float
    exclusion: float
    rejected: int
    rising: bool
    flank: Flank | None
    dropped: Mask
    noise: Array

    @property
    def sign(self) -> float:
        """1 where the higher face lies at larger positions, else -1."""
        return 1.0 if self.rising else -1.0

    def locate_points_beside_edge(self, position: Array, height: Array) -> LevelledPoints:
        """Return where points lie beside the edge."""
        across = self.sign * (position - self.middle)
        return LevelledPoints(across, height - self.offset - self.tilt * position)

    def estimate_riser_form(self, position: Array, height: Array, riser_angle: float) -> Estimate:
        """Return the zone of the form of a sloping riser in the middle half of its height [m].

        The form is a cubic, as that of a face: the zone of all points would grow with the noise.
        `riser_angle` is that of the riser [rad].
        """
        points = self.locate_points_beside_edge(position, height)
        u, level = points.across, points.level
        in_middle = np.abs(level / self.height.value - 0.5) < _MIDDLE
        used = (np.abs(u) <= self.exclusion) & in_middle
        t = 2.0 * (u - u[used].mean()) / np.ptp(u[used])
        terms = np.polynomial.legendre.legvander(t, _RISER_DEGREE).T
        fit = fit_without_spikes(terms, level, used)
        # a short riser does not show its own correlation: it is that of the faces, and the noise
        # what the cubic leaves where that is more
        covariance = compute_estimator_covariance(fit.weights[2:], self.noise)
        variance = np.var(fit.residuals[fit.used], ddof=_RISER_DEGREE + 1)
        covariance *= max(1.0, variance / max(self.noise[0], LEAST_SCATTER**2))
        stds = np.sqrt(np.diag(covariance).clip(min=0.0))
        form = FaceForm(
            points=np.column_stack([u, level, level])[used],
            grid=np.column_stack([u, u])[used],
            columns=fit.design[2:, used],
            solution=fit.solution[2:],
            root=np.diag(stds),
            dof=np.inf,
            degree=_RISER_DEGREE,
        )
        zone = estimate_zone(lambda shape: float(np.ptp(shape[:, 2]) * np.cos(riser_angle)), form)
        # the polynomials span two: the zone moves by no more than twice what noise adds to either
        least = 2.0 * float(stds.max() * np.cos(riser_angle))
        return replace(zone, std=max(zone.std, least))


@dataclass(frozen=True)
class EdgePlace:
    """Where the largest edge of a profile lies."""

    position: float  # m
    rising: bool


@dataclass(frozen=True)
class _IsolatedEdge:
    """The largest edge of a profile as if it rose: a falling one is turned around."""

    x: Array  # shape (m,); m
    z: Array  # shape (m,); m
    middle: float  # where half of the height is crossed [m]
    rising: bool  # along the profile as given
    points: Mask  # shape (n,); points of the profile as given that belong to the edge

    @property
    def spacing(self) -> float:
        """Sampling interval [m]."""
        return float((self.x[-1] - self.x[0]) / (len(self.x) - 1))

    def map_points_to_profile(self, points: Mask) -> Mask:
        """Return points of the edge, shape (m,), as points of the profile as given, shape (n,)."""
        turned = np.zeros(len(self.points), dtype=bool)
        turned[np.flatnonzero(self.points)] = points if self.rising else points[::-1]
        return turned


@dataclass(frozen=True)
class _Faces:
    """Two planes through the faces beside an edge, and their noise."""

    planes: TwoPlanes
    noise: Array  # autocovariance of what the planes leave [m^2]
    gamma: Array  # the same over the levels at the edge [m^2]
    bare: Array  # the same without a bow, of which two planes leave the rest at the edge
    # shape (3, 3); rows whose products add up to the covariance of tilt, offset and height
    errors: Array
    asked: Mask  # shape (n,); points beside the exclusion
    middle: float  # of the edge [m]
    exclusion: float  # half width that was kept out [m]
    wavy: WavyFaces | None  # where waviness outweighs the noise

    @property
    def noise_std(self) -> float:
        """Standard deviation of the noise about the faces at the edge [m]."""
        return float(np.sqrt(self.gamma[0]))

    def subtract_lower_face(self, x: Array, z: Array) -> Array:
        """Return heights over the lower face; those of the upper face are about the step [m]."""
        level = z - self.planes.offset - self.planes.tilt * x
        if self.wavy is not None:
            return level - self.wavy.compute_heights_over_planes(x)
        return level

    def compute_level_covariance_root(self, x: Array) -> Array:
        """Return rows whose products add up to the covariance of the levels, shape (k, n) [m]."""
        if self.wavy is not None:
            return self.wavy.compute_level_covariance_root(x)
        is_upper = (x > self.middle).astype(float)
        return np.asarray(self.errors @ np.stack([x - self.middle, np.ones(len(x)), is_upper]))

    @property
    def step_height(self) -> float:
        """Height of the step [m]."""
        return self.planes.height.value


@dataclass(frozen=True)
class _Corner:
    """What the points at an edge say of it."""

    arc: Arc
    flank: Flank | None  # where it is no arc
    spikes: int  # that were left out on the arc


def fit_edge(position: Array, height: Array, exclusion: float | None = None) -> Edge:
    """Height of a step and radius of its edge from one profile across it.

    Parameters
    ----------
    position, height : array, shape (n,)
        m; nan where nothing was measured.
    exclusion : float, optional
        Half width that is kept out of the faces [m]; half as much again as the edge is rounded by
        default.

    Returns
    -------
    Edge

    Raises
    ------
    MetrologyError
        If the profile shows no step above its noise, a face is too short, or too many points are
        spikes.
    """
    edge = _isolate_largest_edge(position, height)
    x = edge.x
    z = edge.z
    faces = _fit_faces_beside_rounding(edge) if exclusion is None else _fit_faces(edge, exclusion)
    _refuse_step_within_noise(faces, len(x))
    known = np.isfinite(z)
    near = known & (np.abs(x - edge.middle) < faces.exclusion)
    spikes = near & _find_edge_spikes(edge, faces)
    planes = faces.planes
    levelled = faces.subtract_lower_face(x, z)
    corner = _fit_arc_or_flank(x, levelled, edge.spacing, faces, np.flatnonzero(near & ~spikes))
    _refuse_many_spikes(faces, spikes, near)
    shape = corner.arc if corner.flank is None else corner.flank
    radius_std = shape.radius_std
    if faces.wavy is not None:
        radius_std *= _BESIDE_WAVES
    missing = int((~known).sum())
    rejected = planes.fit.rejected + int(spikes.sum()) + corner.spikes + missing
    dropped = faces.asked & ~planes.fit.used | spikes
    sign = 1.0 if edge.rising else -1.0
    return Edge(
        height=estimate_height_beside_waves(x, z, edge.middle, planes),
        # a bow leaves few degrees of freedom, yet many of the noise
        radius=Estimate(shape.radius, radius_std),
        radius_limit=shape.radius_limit,
        position=sign * corner.arc.riser,
        middle=sign * edge.middle,
        tilt=sign * planes.tilt,
        offset=planes.offset,
        exclusion=faces.exclusion,
        rejected=rejected,
        rising=edge.rising,
        flank=corner.flank,
        dropped=edge.map_points_to_profile(dropped),
        noise=faces.noise,
    )


def find_largest_edge(position: Array, height: Array) -> EdgePlace:
    """Return where the largest edge of a profile lies, and whether it rises."""
    edge = _isolate_largest_edge(position, height)
    if edge.rising:
        return EdgePlace(edge.middle, rising=True)
    return EdgePlace(-edge.middle, rising=False)


def fit_step_height(position: Array, height: Array, exclusion: float) -> Estimate:
    """Fit the height of a step [m] alone, as `fit_edge` does with this `exclusion`.

    Without its checks.
    """
    edge = _isolate_largest_edge(position, height)
    planes = _fit_faces(edge, exclusion).planes
    return estimate_height_beside_waves(edge.x, edge.z, edge.middle, planes)


def _isolate_largest_edge(x: Array, height: Array) -> _IsolatedEdge:
    """Return the largest edge of a profile with the points between its neighbours."""
    z = np.where(np.isfinite(height), height, np.nan)
    found = find_edges(x, z)
    chosen = max(range(len(found)), key=lambda index: abs(found[index].rise))
    edge = found[chosen]
    points = _find_points_between_neighbours(x, found, chosen)
    if edge.rise > 0.0:
        return _IsolatedEdge(x[points], z[points], edge.position, rising=True, points=points)
    turned_x = -x[points][::-1]
    turned_z = z[points][::-1]
    return _IsolatedEdge(turned_x, turned_z, -edge.position, rising=False, points=points)


def _find_points_between_neighbours(x: Array, edges: list[FoundEdge], edge_index: int) -> Mask:
    """Return the points between the neighbours of an edge, which stand on no face of it."""
    points = np.ones(len(x), dtype=bool)
    if edge_index > 0:
        points &= x > edges[edge_index - 1].end
    if edge_index + 1 < len(edges):
        points &= x < edges[edge_index + 1].begin
    return points


def _fit_faces_beside_rounding(edge: _IsolatedEdge) -> _Faces:
    """Fit the faces with half as much again kept out as the edge is rounded.

    At least as much is kept out as of a sharp edge.
    """
    to_nearer_end = min(edge.middle - edge.x[0], edge.x[-1] - edge.middle)
    least = min(_LEAST_EXCLUSION * edge.spacing, to_nearer_end / _LEAST_FACE_SHARE)
    faces = _fit_faces(edge, least)
    wider = _WIDER * _measure_rounding_width(edge, faces)
    if wider > least:
        return _fit_faces(edge, wider)
    return faces


def _fit_faces(edge: _IsolatedEdge, exclusion: float) -> _Faces:
    """Fit two planes to the points beyond the exclusion [m], and estimate their noise.

    Refused where a face keeps too few points.
    """
    x = edge.x
    z = edge.z
    middle = edge.middle
    lower = x < middle - exclusion
    upper = x > middle + exclusion
    finite = np.isfinite(z)
    for name, side in (("left", lower), ("right", upper)):
        count = int((side & finite).sum())
        if count < LEAST_FACE:
            raise MetrologyError(
                f"face {name} of the edge must keep {LEAST_FACE} points outside the exclusion "
                f"of {exclusion * 1e6:.4g} um, got {count}"
            )
    asked = (lower | upper) & finite
    planes = fit_two_planes(x, z, middle, asked)
    used = planes.fit.used
    kept = np.where(used, planes.fit.residuals, np.nan)
    noise = estimate_autocovariance([kept[lower], kept[upper]])
    bow = np.polynomial.Polynomial.fit(x[used], kept[used], 2)(x)
    without_bow = kept - bow
    gamma = noise
    bare = estimate_autocovariance([without_bow[lower], without_bow[upper]])
    wavy = find_wavy_faces(x, kept, without_bow, middle, exclusion)
    if wavy is not None:
        gamma = wavy.noise
        bare = wavy.noise
    return _Faces(
        planes=planes,
        noise=noise,
        gamma=gamma,
        bare=bare,
        errors=factor_covariance(compute_estimator_covariance(planes.fit.weights, noise)),
        asked=asked,
        middle=middle,
        exclusion=exclusion,
        wavy=wavy,
    )


def _refuse_step_within_noise(faces: _Faces, point_count: int) -> None:
    """Refuse a step that is not well above its noise."""
    height = faces.planes.height
    noise = max(height.std, faces.noise_std / np.sqrt(point_count))
    if not height.value > _LEAST_STEP * noise:
        raise MetrologyError(
            f"profile must show a step above its noise, got {height.value * 1e6:.4g} um with "
            f"roughness {faces.noise_std * 1e6:.3g} um"
        )


def _refuse_many_spikes(faces: _Faces, spikes: Mask, near_edge: Mask) -> None:
    """Refuse an edge, or faces, of which too many points are spikes."""
    share = float(spikes.sum()) / max(int(near_edge.sum()), 1)
    if share > _MOST_DROPPED:
        raise MetrologyError(
            f"at most {_MOST_DROPPED:.0%} of the points at an edge may be spikes, got "
            f"{share:.0%} of those within {faces.exclusion * 1e6:.3g} um of it"
        )
    lost = faces.planes.fit.rejected / int(faces.asked.sum())
    if lost > _MOST_DROPPED:
        raise MetrologyError(
            f"at most {_MOST_DROPPED:.0%} of the points of the faces may be spikes, got {lost:.0%}"
        )


def _find_edge_spikes(edge: _IsolatedEdge, faces: _Faces) -> Mask:
    """Return spikes of a profile, shape (m,).

    An edge rises or falls, so a point stays within the range of its four neighbours. All points are
    looked at, so that those at the ends of a window have their neighbours too.
    """
    known = np.isfinite(edge.z)
    heights = edge.z[known] - faces.planes.tilt * edge.x[known]
    limit = _SPIKE * max(faces.noise_std, LEAST_SCATTER)
    padded = np.pad(heights, 2, mode="reflect")
    beside = np.stack([padded[shift : shift + len(heights)] for shift in (0, 1, 3, 4)])
    is_above = heights > beside.max(axis=0) + limit
    is_below = heights < beside.min(axis=0) - limit
    spikes = np.zeros_like(known)
    spikes[known] = is_above | is_below
    return spikes


def _fit_arc_or_flank(
    x: Array, levelled: Array, spacing: float, faces: _Faces, point_indices: NDArray[np.intp]
) -> _Corner:
    """Fit an arc, or a flank with a corner, to the points at an edge.

    `x` and `levelled`, shape (n,), are positions and heights over the lower face of a profile [m].
    """
    # a point is dropped where the circle fits the others by far better, as it does for a spike and
    # not for form
    kept = point_indices
    arc = _fit_arc_to_points(x, levelled, spacing, faces, kept)
    flank = _fit_flank_if_better_than_arc(x[kept], levelled[kept], spacing, faces, arc)
    if flank is not None:
        return _Corner(arc, flank, 0)
    least = max(len(point_indices) - _MOST_ON_ARC, _LEAST_ON_ARC)
    while arc.excess > _SUSPECT and len(kept) > least:
        trials = [np.delete(kept, suspect) for suspect in arc.suspects]
        arcs = [_fit_arc_to_points(x, levelled, spacing, faces, trial) for trial in trials]
        best = min(range(len(arcs)), key=lambda index: arcs[index].misfit)
        if arcs[best].excess > arc.excess / _BY_FAR:
            break
        arc = arcs[best]
        kept = trials[best]
    return _Corner(arc, None, len(point_indices) - len(kept))


def _fit_arc_to_points(
    x: Array, levelled: Array, spacing: float, faces: _Faces, point_indices: NDArray[np.intp]
) -> Arc:
    """Fit an arc to some points of a profile, with what the planes leave open of their levels."""
    u = x[point_indices]
    errors = faces.compute_level_covariance_root(u)
    window = EdgeWindow(u, levelled[point_indices], faces.step_height, spacing, faces.bare, errors)
    return fit_arc(window)


def _fit_flank_if_better_than_arc(
    x: Array, levelled: Array, spacing: float, faces: _Faces, arc: Arc
) -> Flank | None:
    """Return the sloped flank of an edge, where the circle of a vertical one does not hold.

    None where the circle holds or no flank is seen.
    """
    if not arc.excess > _SUSPECT:
        return None
    height = faces.planes.height.value
    flank = fit_flank(x, levelled, height, spacing, faces.gamma)
    if flank is None:
        return None
    # of a quarter of a circle the surface is this steep at half the height
    cosine = 1.0 - 0.5 * height / max(arc.radius, 0.5 * height)
    steepness = float(np.arccos(np.clip(cosine, 0.0, 1.0)))
    if steepness - flank.angle > _GENTLER_STDS * flank.angle_std + _GENTLER:
        return flank
    # an arc as high as the step is as steep as a flank there: the better fit decides
    fitted = compute_edge_profile(x, arc.riser, height, arc.radius)
    misfit = float(np.sqrt(np.mean((fitted - levelled)[flank.used] ** 2)))
    if arc.radius > NO_RISER * height and misfit > _BETTER * flank.misfit:
        return flank
    return None


def _measure_rounding_width(edge: _IsolatedEdge, faces: _Faces) -> float:
    """Return the distance from the riser to the last point that lies clearly off its own face [m].

    The rounding ends where ten points in a row, on both sides together, lie on their faces again.
    """
    x = edge.x
    is_upper = x > faces.middle
    off_face = faces.subtract_lower_face(x, edge.z) - np.where(is_upper, faces.step_height, 0.0)
    filled = np.where(np.isfinite(edge.z), off_face, 0.0)
    deviation = np.abs(filter_by_running_median(filled))
    off = deviation > max(_OFF_FACE * faces.noise_std, _OFF_FACE_HEIGHT * faces.step_height)
    distance = np.abs(x - faces.middle)
    # points as far on either side are ordered by their place, not by the last bit of their distance
    by_distance = np.argsort(np.rint(4.0 * distance / edge.spacing), kind="stable")
    off = off[by_distance]
    for index in np.flatnonzero(~off):
        if not off[index : index + _IN_A_ROW].any():
            return float(distance[by_distance[index]])
    return float(distance.max())
