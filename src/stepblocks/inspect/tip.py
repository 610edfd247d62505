"""Radius and form of a probe tip.

A sphere is fitted to the heights of the cap of a map, a circle to those of a profile.

The noise of a scan is along z and correlated. So the sphere is fitted to heights, with the forms
that leave its curvature alone (astigmatism, coma), and its uncertainty goes through the
autocovariance of the residuals.
"""

from dataclasses import dataclass

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.noise import Array, Estimate, Mask, find_outliers, make_linear_estimate
from stepblocks.scans.scan import HeightMap, ScannedProfile

# reach of the cap that is fitted, as a part of the nominal radius [1]: 44 degrees of the ball,
# clear of the cone
_CAP = 0.7
_TOP = 0.02  # height of the top, from whose middle the apex is sought, over the nominal radius [1]
_MOST_ACROSS = 256  # points of a map along either side that are fitted; of more, every so many
_CENTRINGS = 4
_LEAST_POINTS = 10  # of the cap
_MOST_STEPS = 20  # of the fit
_SETTLED = 1e-9  # change of the sphere in a step, over its radius, below which it is settled [1]
_SMALLEST, _LARGEST = 0.2, 5.0  # radius over the nominal one, between which it is a tip [1]
_LARGEST_SQUARE = 1e8  # of the radius over the nominal one, beyond which the points are a plane [1]


@dataclass(frozen=True)
class DrawnCap:
    """The row of a scan with most of the cap; arrays of shape (n,) [m]."""

    position: Array
    height: Array
    fitted: Array  # nan off the cap


@dataclass(frozen=True)
class Cap:
    """Sphere through the cap of a tip."""

    radius: Estimate  # m
    form: float  # peak to valley of the distances from the sphere, noise included [m]
    cap_angle: float  # half angle of the cap [rad]
    rejected: int  # points left out as spikes
    points: int  # of the cap, with these
    drawn: DrawnCap


@dataclass
class _Sphere:
    """Centre and radius [m]."""

    x: float
    y: float
    z: float
    radius: float


@dataclass(frozen=True)
class _Cloud:
    """Points of a scan, arrays of shape (ny, nx) [m]; nan where nothing was measured."""

    x: Array
    y: Array
    z: Array
    source: str

    @property
    def is_profile(self) -> bool:
        """Whether the points lie on one line."""
        return len(self.z) == 1


@dataclass(frozen=True)
class _Correction:
    """One step of the fit of a sphere to heights."""

    design: Array  # shape (k, ny, nx); change of the heights by the terms [1]
    weights: Array  # shape (k, points used)
    solution: Array  # shape (k,); m
    residuals: Array  # shape (ny, nx); m


def fit_cap(
    scan: ScannedProfile | HeightMap, nominal_radius: float, relative_cap_radius: float = _CAP
) -> Cap:
    """Fit a sphere, or a circle, to the heights around the apex.

    Parameters
    ----------
    scan : ScannedProfile or HeightMap
        Profile over the tip, or map that looks along its axis.
    nominal_radius : float
        Approximate radius of the tip [m].
    relative_cap_radius : float
        Radius of the cap, as a share of the nominal radius [1].

    Returns
    -------
    Cap

    Raises
    ------
    MetrologyError
        If the scan shows no cap of about this radius.
    """
    cloud = _thin_scan_points(scan)
    face, sphere = _find_cap_points_and_sphere(cloud, nominal_radius, relative_cap_radius)
    used = face.copy()
    for left in reversed(range(_MOST_STEPS)):
        step = _fit_sphere_correction(
            cloud, sphere, used, relative_cap_radius * nominal_radius, nominal_radius
        )
        change = _apply_sphere_correction(sphere, step.solution, cloud.is_profile)
        # after the fit, since the start knows no form, and form is no spike
        spikes = find_outliers(step.residuals, used)
        is_settled = change < _SETTLED * sphere.radius and not spikes.any()
        if left == 0 or is_settled:
            break
        used &= ~spikes
    if (
        used.sum() < 2 * len(step.design)
        or not _SMALLEST < sphere.radius / nominal_radius < _LARGEST
    ):
        raise MetrologyError(
            f"tip must show a cap of a ball of about {nominal_radius * 1e6:.4g} um, got "
            f"{int(used.sum())} points on one of {sphere.radius * 1e6:.4g} um [{cloud.source}]"
        )
    spread = np.zeros(cloud.z.shape)
    spread[used] = step.weights[2]
    radius = make_linear_estimate(float(sphere.radius), spread, step.residuals, used, step.design)
    outward = np.stack([cloud.x - sphere.x, cloud.y - sphere.y, cloud.z - sphere.z])[:, used]
    distance = np.linalg.norm(outward, axis=0)
    axis = outward.mean(axis=1) / np.linalg.norm(outward.mean(axis=1))
    smallest_cosine = (axis @ (outward / distance)).min()
    return Cap(
        radius=radius,
        form=float(np.ptp(distance)),
        cap_angle=float(np.arccos(np.clip(smallest_cosine, -1.0, 1.0))),
        rejected=int(face.sum() - used.sum()),
        points=int(face.sum()),
        drawn=_extract_drawn_cap(cloud, sphere, used),
    )


def _thin_scan_points(scan: ScannedProfile | HeightMap) -> _Cloud:
    """Return the points of a scan, of a large map every so many along either side."""
    if isinstance(scan, ScannedProfile):
        x = scan.position[np.newaxis, :]
        return _Cloud(x, np.zeros_like(x), scan.height[np.newaxis, :], scan.source)
    rows, columns = scan.height.shape
    thin_y = max(rows // _MOST_ACROSS, 1)
    thin_x = max(columns // _MOST_ACROSS, 1)
    x, y = np.meshgrid(scan.x[::thin_x], scan.y[::thin_y])
    return _Cloud(x, y, scan.height[::thin_y, ::thin_x], scan.source)


def _find_cap_points_and_sphere(
    cloud: _Cloud, nominal_radius: float, relative_cap_radius: float
) -> tuple[Mask, _Sphere]:
    """Return the points of the cap, and a sphere about through them.

    The apex is that of the fit, since the highest points lie on a slope of noise.
    """
    x, y, z = cloud.x, cloud.y, cloud.z
    top = z > np.nanmax(z) - _TOP * nominal_radius
    apex_x = float(np.median(x[top]))
    apex_y = float(np.median(y[top]))
    for _ in range(_CENTRINGS):
        face = (
            np.hypot(x - apex_x, y - apex_y) < relative_cap_radius * nominal_radius
        ) & np.isfinite(z)
        if face.sum() < _LEAST_POINTS:
            raise MetrologyError(
                f"tip must show at least {_LEAST_POINTS} points of its cap, got {int(face.sum())} "
                f"[{cloud.source}]"
            )
        points = np.stack([x[face], y[face], z[face]], axis=1)
        sphere = _fit_sphere_algebraically(points, nominal_radius, cloud.is_profile)
        apex_x = sphere.x
        apex_y = sphere.y
    return face, sphere


def _fit_sphere_algebraically(points: Array, length_unit: float, is_profile: bool) -> _Sphere:
    """Return the sphere ``|p|^2 = 2 c p + q`` through points of shape (n, 3) [m].

    Of a profile it is the circle over x; `length_unit` scales the points [m].
    """
    origin = points.mean(axis=0)
    scaled = (points - origin) / length_unit
    free = scaled[:, ::2] if is_profile else scaled
    design = np.column_stack([2.0 * free, np.ones(len(scaled))])
    squares = np.sum(scaled**2, axis=1)
    solution, _, rank, _ = np.linalg.lstsq(design, squares, rcond=1e-10)
    radius_squared = float(solution[-1] + solution[:-1] @ solution[:-1])
    if rank < design.shape[1] or not 0.0 < radius_squared <= _LARGEST_SQUARE:
        raise MetrologyError("points must determine a sphere, got points on a plane or a line")
    centre = solution[:3]
    if is_profile:
        centre = np.array([solution[0], 0.0, solution[1]])
    x, y, z = centre * length_unit + origin
    return _Sphere(x, y, z, np.sqrt(radius_squared) * length_unit)


def _fit_sphere_correction(
    cloud: _Cloud, sphere: _Sphere, used: Mask, cap_radius: float, nominal_radius: float
) -> _Correction:
    """Fit the correction of a sphere, and forms that do not change its curvature, to heights.

    `cap_radius` is that of the cap [m].
    """
    dx = cloud.x - sphere.x
    dy = cloud.y - sphere.y
    squared_rise = sphere.radius**2 - dx**2 - dy**2
    if not (squared_rise[used] > 0.0).all():
        raise MetrologyError(
            f"tip must show a cap of a ball of about {nominal_radius * 1e6:.4g} um, got none "
            f"[{cloud.source}]"
        )
    rise = np.sqrt(np.where(used, squared_rise, 1.0))
    residuals = np.where(used, cloud.z - sphere.z - rise, np.nan)
    columns = [dx / rise, np.ones_like(rise), sphere.radius / rise]
    if not cloud.is_profile:
        u = dx / cap_radius
        v = dy / cap_radius
        astigmatism = [u * u - v * v, u * v]
        coma = [u * (u * u + v * v), v * (u * u + v * v)]
        columns += [dy / rise, *astigmatism, *coma]
    design = np.stack([np.where(used, column, 0.0) for column in columns])
    weights = np.linalg.pinv(design[:, used].T)
    solution = weights @ residuals[used]
    residuals -= np.tensordot(solution, design, 1)
    return _Correction(design, weights, solution, residuals)


def _apply_sphere_correction(sphere: _Sphere, solution: Array, is_profile: bool) -> float:
    """Move a sphere in place by the solution of a correction; return the largest change [m]."""
    sphere.x += solution[0]
    sphere.z += solution[1]
    sphere.radius += solution[2]
    largest = max(abs(solution[0]), abs(solution[1]), abs(solution[2]))
    if not is_profile:
        sphere.y += solution[3]
        largest = max(largest, abs(solution[3]))
    return float(largest)


def _extract_drawn_cap(cloud: _Cloud, sphere: _Sphere, used: Mask) -> DrawnCap:
    """Return the row with most of the cap and the sphere over it."""
    row = int(np.argmax(used.sum(axis=1)))
    x = cloud.x[row]
    squared_rise = sphere.radius**2 - (x - sphere.x) ** 2 - (cloud.y[row] - sphere.y) ** 2
    circle = sphere.z + np.sqrt(np.maximum(squared_rise, 0.0))
    return DrawnCap(x, cloud.z[row], np.where(used[row], circle, np.nan))
