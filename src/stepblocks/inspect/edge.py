"""A single edge in a profile: height of the step by two planes, radius of the edge by its arc.

A single edge is not type A1 of ISO 5436-1. By the convention here one common slope and two offsets
are fitted to the faces beyond the exclusion; the height is the difference of the offsets. The
radius comes from the points inside the exclusion.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.inspect.edge_arc import (
    Arc,
    Flank,
    Window,
    compute_edge_profile,
    fit_arc,
    fit_flank,
)
from stepblocks.inspect.form import FaceForm, estimate_zone
from stepblocks.inspect.levelling import (
    LEAST_FACE,
    TwoPlanes,
    find_edges,
    fit_two_planes,
    fit_without_spikes,
    remove_spikes,
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

# mean square of whitened residuals on the arc beyond which one of its points may be a spike [1]
_SUSPECT = 4.0
# factor by which that falls when the spike is left out [1]; form of the edge is in all points and
# falls by less
_BY_FAR = 2.5
# of the height, from which an arc leaves no riser to distinguish it from [1]
NO_RISER = 0.7
_BETTER = 1.5  # of the residuals of the arc over those of the flank, from which it is a flank [1]
_LEAST_EXCLUSION = 16.0  # sampling intervals kept out of the faces where the edge is sharp [1]
_MOST_DROPPED = 0.2  # part of the points of a face, or at an edge, that may be spikes [1]
_MOST_ON_ARC = 3  # spikes that are sought on an arc


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

    def measure_across(self, position: Array, height: Array) -> tuple[Array, Array]:
        """Return distances from the edge to the upper face, and heights over the lower one [m]."""
        sign = 1.0 if self.rising else -1.0
        return sign * (position - self.middle), height - self.offset - self.tilt * position

    def measure_riser(self, position: Array, height: Array, angle: float) -> Estimate:
        """Return the zone of the form of a sloping riser in the middle half of its height [m].

        The form is a cubic, as that of a face: the zone of all points would grow with the noise.
        """
        u, level = self.measure_across(position, height)
        used = (np.abs(u) <= self.exclusion) & (np.abs(level / self.height.value - 0.5) < 0.25)
        t = 2.0 * (u - u[used].mean()) / np.ptp(u[used])
        fit = fit_without_spikes(np.polynomial.legendre.legvander(t, 3).T, level, used)
        # a short riser does not show its own correlation: it is that of the faces, and the noise
        # what the cubic leaves where that is more
        covariance = compute_estimator_covariance(fit.weights[2:], self.noise)
        covariance *= max(
            1.0, np.var(fit.residuals[fit.used], ddof=4) / max(self.noise[0], LEAST_SCATTER**2)
        )
        form = FaceForm(
            points=np.column_stack([u, level, level])[used],
            grid=np.column_stack([u, u])[used],
            columns=fit.design[2:, used],
            solution=fit.solution[2:],
            root=np.diag(np.sqrt(np.diag(covariance).clip(min=0.0))),
            dof=np.inf,
            degree=3,
        )
        zone = estimate_zone(lambda points: float(np.ptp(points[:, 2]) * np.cos(angle)), form)
        # the polynomials span two: the zone moves by no more than twice what noise adds to either
        return replace(zone, std=max(zone.std, 2.0 * float(form.root.max() * np.cos(angle))))


def fit_edge(position: Array, height: Array, exclusion: float | None = None) -> Edge:
    """Height of a step and radius of its edge from one profile across it [m].

    Nan where nothing was measured.
    """
    # `exclusion` is the half width that is kept out of the faces [m]; half as much again as the
    # edge is rounded by default.
    own, rising, x, z, middle = _isolate_largest_edge(position, height)
    spacing = (x[-1] - x[0]) / (len(x) - 1)
    half_width = (
        min(_LEAST_EXCLUSION * spacing, min(middle - x[0], x[-1] - middle) / 3.0)
        if exclusion is None
        else exclusion
    )
    faces = _fit_faces(x, z, middle, half_width)
    if (
        exclusion is None
        and (wider := 1.5 * _find_rounding_width(x, z, spacing, faces)) > half_width
    ):
        half_width = wider
        faces = _fit_faces(x, z, middle, wider)
    planes, roughness, step = faces.planes, faces.roughness, faces.planes.height
    MetrologyError.require(
        step.value > 5.0 * max(step.std, roughness / np.sqrt(len(x))),
        f"profile must show a step above its noise, got {step.value * 1e6:.4g} um with "
        f"roughness {roughness * 1e6:.3g} um",
    )
    known = np.isfinite(z)
    near = known & (np.abs(x - middle) < half_width)
    spikes = np.zeros_like(known)
    # over the whole profile, so that the points at the ends of the window have their neighbours too
    spikes[known] = _find_edge_spikes(
        z[known] - planes.tilt * x[known], 6.0 * max(roughness, LEAST_SCATTER)
    )
    spikes &= near
    arc, flank, on_arc = _fit_arc_or_flank(
        x, z - planes.offset - planes.tilt * x, spacing, faces, np.flatnonzero(near & ~spikes)
    )
    MetrologyError.require(
        not (share := float(spikes.sum()) / max(int(near.sum()), 1)) > _MOST_DROPPED,
        f"at most {_MOST_DROPPED:.0%} of the points at an edge may be spikes, got "
        f"{share:.0%} of those within {half_width * 1e6:.3g} um of it",
    )
    MetrologyError.require(
        not (lost := planes.fit.rejected / int(faces.asked.sum())) > _MOST_DROPPED,
        f"at most {_MOST_DROPPED:.0%} of the points of the faces may be spikes, got {lost:.0%}",
    )
    off = faces.asked & ~planes.fit.used | spikes
    dropped = np.zeros(len(position), dtype=bool)
    dropped[np.flatnonzero(own)] = off if rising else off[::-1]
    sign = 1.0 if rising else -1.0
    corner = arc if flank is None else flank
    return Edge(
        height=step,
        # a bow leaves few degrees of freedom, yet many of the noise
        radius=Estimate(corner.radius, corner.radius_std),
        radius_limit=corner.radius_limit,
        position=sign * arc.riser,
        middle=sign * middle,
        tilt=sign * planes.tilt,
        offset=planes.offset,
        exclusion=half_width,
        rejected=planes.fit.rejected + int(spikes.sum()) + on_arc + int((~known).sum()),
        rising=rising,
        flank=flank,
        dropped=dropped,
        noise=faces.gamma,
    )


def find_position(position: Array, height: Array) -> tuple[float, bool]:
    """Return where the largest edge of a profile lies [m], and whether it rises."""
    _, rising, _, _, middle = _isolate_largest_edge(position, height)
    return (middle, True) if rising else (-middle, False)


def fit_step(position: Array, height: Array, exclusion: float) -> Estimate:
    """Height of a step [m] alone, as `fit_edge` with this `exclusion` says it.

    Without its checks.
    """
    _, _, x, z, middle = _isolate_largest_edge(position, height)
    return _fit_faces(x, z, middle, exclusion).planes.height


def _isolate_largest_edge(x: Array, height: Array) -> tuple[Mask, bool, Array, Array, float]:
    # Return which points are the largest edge's own, whether it rises, and these points and its
    # place as if it did [m].
    z = np.where(np.isfinite(height), height, np.nan)
    found = find_edges(x, z)
    chosen = max(range(len(found)), key=lambda index: abs(found[index].rise))
    # what stands beside the edge is not its face
    before, behind = [one.end for one in found[:chosen]], [one.begin for one in found[chosen + 1 :]]
    own = (x > before[-1] if before else x >= x[0]) & (x < behind[0] if behind else x <= x[-1])
    if found[chosen].rise > 0.0:
        return own, True, x[own], z[own], found[chosen].position
    return own, False, -x[own][::-1], z[own][::-1], -found[chosen].position


@dataclass(frozen=True)
class _Faces:
    planes: TwoPlanes
    gamma: Array  # autocovariance of their noise [m^2]
    bare: Array  # the same without a bow, of which two planes leave the rest at the edge
    # shape (3, 3); rows whose products add up to the covariance of tilt, offset and height
    errors: Array
    asked: Mask  # shape (n,); points beside the exclusion
    middle: float  # m

    @property
    def roughness(self) -> float:
        return float(np.sqrt(self.gamma[0]))


def _fit_faces(x: Array, z: Array, middle: float, exclusion: float) -> _Faces:
    lower, upper = x < middle - exclusion, x > middle + exclusion
    finite = np.isfinite(z)
    for name, side in (("left", lower), ("right", upper)):
        MetrologyError.require(
            (count := int((side & finite).sum())) >= LEAST_FACE,
            f"face {name} of the edge must keep {LEAST_FACE} points outside the exclusion "
            f"of {exclusion * 1e6:.4g} um, got {count}",
        )
    asked = (lower | upper) & finite
    planes = fit_two_planes(x, z, middle, asked)
    kept = np.where(planes.fit.used, planes.fit.residuals, np.nan)
    gamma = estimate_autocovariance([kept[lower], kept[upper]])
    used = planes.fit.used
    bow = np.polynomial.Polynomial.fit(x[used], kept[used], 2)(x)
    return _Faces(
        planes,
        gamma,
        estimate_autocovariance([(kept - bow)[lower], (kept - bow)[upper]]),
        factor_covariance(compute_estimator_covariance(planes.fit.weights, gamma)),
        asked,
        middle,
    )


def _find_better_flank(
    x: Array, levelled: Array, spacing: float, faces: _Faces, arc: Arc
) -> Flank | None:
    # Sloped flank of an edge, where the circle of a vertical one does not hold and a flank is seen.
    height = faces.planes.height.value
    flank = fit_flank(x, levelled, height, spacing, faces.gamma)
    if flank is None:
        return None
    # of a quarter of a circle the surface is this steep at half the height
    upright = float(
        np.arccos(np.clip(1.0 - 0.5 * height / max(arc.radius, 0.5 * height), 0.0, 1.0))
    )
    gentler = upright - flank.angle > 3.0 * flank.angle_std + np.radians(5.0)
    # an arc as high as the step is as steep as a flank there: the better fit decides
    fitted = compute_edge_profile(x, arc.riser, height, arc.radius)
    rest = float(np.sqrt(np.mean((fitted - levelled)[flank.used] ** 2)))
    gentler |= arc.radius > NO_RISER * height and rest > _BETTER * flank.misfit
    return flank if arc.excess > _SUSPECT and gentler else None


def _find_edge_spikes(heights: Array, limit: float) -> Mask:
    # Return spikes in a window at the edge: an edge rises or falls, so a point stays within the
    # range of its four neighbours.
    padded = np.pad(heights, 2, mode="reflect")
    beside = np.stack([padded[shift : shift + len(heights)] for shift in (0, 1, 3, 4)])
    return np.asarray(
        (heights > beside.max(axis=0) + limit) | (heights < beside.min(axis=0) - limit)
    )


def _fit_arc_or_flank(
    x: Array, levelled: Array, spacing: float, faces: _Faces, kept: NDArray[np.intp]
) -> tuple[Arc, Flank | None, int]:
    # Fit the arc; drop a point where the circle fits the others by far better, as it does for a
    # spike and not for form.
    def fit_points(points: NDArray[np.intp]) -> Arc:
        u = x[points]
        columns = np.stack([u - faces.middle, np.ones(len(u)), (u > faces.middle).astype(float)])
        return fit_arc(
            Window(
                u,
                levelled[points],
                faces.planes.height.value,
                spacing,
                faces.bare,
                faces.errors @ columns,
            )
        )

    given = len(kept)
    arc = fit_points(kept)
    flank = _find_better_flank(x[kept], levelled[kept], spacing, faces, arc)
    while flank is None and arc.excess > _SUSPECT and len(kept) > max(given - _MOST_ON_ARC, 8):
        trials = [np.delete(kept, index) for index in arc.suspects]
        best, points = min(
            ((fit_points(points), points) for points in trials), key=lambda trial: trial[0].misfit
        )
        if best.excess > arc.excess / _BY_FAR:
            break
        arc, kept = best, points
    return arc, flank, given - len(kept)


def _find_rounding_width(x: Array, z: Array, spacing: float, faces: _Faces) -> float:
    # Distance from the riser to the last point that lies clearly off its own face.
    height, planes = faces.planes.height.value, faces.planes
    ideal = planes.offset + planes.tilt * x + np.where(x > faces.middle, height, 0.0)
    deviation = np.abs(remove_spikes(np.where(np.isfinite(z), z, ideal)) - ideal)
    off = deviation > max(6.0 * faces.roughness, 1e-3 * height)
    distance = np.abs(x - faces.middle)
    # points as far on either side are ordered by their place, not by the last bit of their distance
    near = np.argsort(np.rint(4.0 * distance / spacing), kind="stable")
    # the rounding ends where ten points in a row, on both sides together, lie on their faces again
    for index in np.flatnonzero(~off[near]):
        if not off[near[index : index + 10]].any():
            return float(distance[near[index]])
    return float(distance.max())
