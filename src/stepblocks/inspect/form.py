"""Flatness of a face and parallelism to a datum, by minimum zone (ISO 1101).

Both are found of points, and of the form without the noise.

The zone that holds all measured points grows with noise and with their number, and says little of a
face. Stated is that of the form, a polynomial of total degree three or less over what was scanned,
with the waviness that a Gaussian filter passes where there is some; what noise adds to the form is
drawn and taken off.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.inspect.filtering import WavySurface, find_waviness
from stepblocks.inspect.levelling import fit_without_spikes
from stepblocks.inspect.noise import Array, Estimate, Mask, make_linear_estimate

# largest total degree of the form [1]; lower along a side with fewer than four points per degree
_MOST_DEGREE = 3
_POINTS_PER_DEGREE = 4
_LEAST_POINTS = 20  # of a face
_LEAST_OF_PLANE = 4  # points that span a face
_DRAWS = 40
_SCALES = (1.0, np.sqrt(3.0))
# ratio of the two growths from which it differs from the root of two [1]; forty draws scatter it by
# a third
_SEVERAL = 2.0
_GRID = 9  # points along either side at which the form is judged
_CELLS = 60  # of a wavy face along either side, of each of which the highest and lowest point count
_LEAST_RESIDUAL = 1e-15  # of points from a plane, below which lies rounding [m]


@dataclass(frozen=True)
class _Zone:
    """The narrowest zone between two parallel planes that holds all points."""

    width: float  # m
    normal: Array  # shape (3,); of length 1, upwards


def compute_flatness(points: Array) -> float:
    """Compute the flatness of a face by minimum zone (ISO 1101) of its points [m], of shape (n, 3).

    Points with a nan are left out.
    """
    return _find_minimum_zone(_select_face_points(points)).width


def compute_parallelism(points: Array, datum: Array) -> float:
    """Compute the parallelism of a face to a datum [m], points of shape (n, 3).

    It is the width along the normal of the minimum zone of the datum.
    """
    face = _select_face_points(points)
    zone = _find_minimum_zone(_select_face_points(datum))
    return float(np.ptp(face @ zone.normal))


def _select_face_points(points: Array) -> Array:
    """Return the points without nan, shape (n, 3) [m]; refuse those that span no face."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise MetrologyError(f"points must be rows of x, y, z, got shape {points.shape}")
    cloud = points[np.isfinite(points).all(axis=1)]
    if len(cloud) < _LEAST_OF_PLANE or _are_points_collinear(cloud):
        raise MetrologyError(
            f"points must span a face: at least {_LEAST_OF_PLANE} that are not on one line, got "
            f"{len(cloud)}"
        )
    return cloud


def _are_points_collinear(points: Array) -> bool:
    """Tell whether points of shape (n, 3) lie on one line as seen along z."""
    places = points[:, :2] - points[:, :2].mean(axis=0)
    return bool(np.linalg.matrix_rank(places, tol=1e-12) < 2)


def _find_minimum_zone(cloud: Array) -> _Zone:
    """Find the narrowest zone of points of shape (n, 3) [m].

    From a plane by least squares it is found by a linear programme.
    """
    centred = cloud - cloud.mean(axis=0)
    scale = float(np.ptp(cloud[:, :2], axis=0).max())
    design = np.column_stack([centred[:, :2] / scale, np.ones(len(cloud))])
    plane = np.linalg.lstsq(design, centred[:, 2], rcond=None)[0]
    residual = centred[:, 2] - design @ plane
    spread = float(np.ptp(residual))
    height = 0.0
    if spread > _LEAST_RESIDUAL:
        change, half_height = _solve_plane_change_and_half_width(design, residual / spread)
        plane = plane + change * spread
        height = 2.0 * half_height * spread
    upward = np.array([*(-plane[:2] / scale), 1.0])
    length = float(np.linalg.norm(upward))
    return _Zone(height / length, upward / length)


def _solve_plane_change_and_half_width(design: Array, residual: Array) -> tuple[Array, float]:
    """Return the change of a plane that makes the largest residual least, and that residual [1].

    `design`, shape (n, 3), are the terms of the plane at points whose `residual`, shape (n,),
    spans 1. Only the corners of their convex hull bound the zone.
    """
    from scipy.optimize import linprog

    corners = _find_hull_corners(np.column_stack([design[:, :2], residual]))
    terms = design[corners]
    heights = residual[corners]
    below = np.hstack([np.vstack([-terms, terms]), -np.ones((2 * len(terms), 1))])
    result = linprog(
        [0, 0, 0, 1],
        A_ub=below,
        b_ub=np.concatenate([-heights, heights]),
        bounds=[(None, None)] * 3 + [(0, None)],
    )
    if not result.success or result.x is None:
        raise MetrologyError(f"minimum zone must be solvable, got: {result.message}")
    return result.x[:3], float(result.x[3])


def _find_hull_corners(points: Array) -> NDArray[np.intp]:
    """Return the indices of the corners of the convex hull of points; of all where it has none."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(ConvexHull(points).vertices)
    except QhullError:
        return np.arange(len(points))


@dataclass(frozen=True)
class FaceForm:
    """Form of one face.

    A polynomial, the covariance of its coefficients, and where it was measured.
    """

    points: Array  # shape (n, 3); measured points [m]
    grid: Array  # shape (m, 2); positions over the face at which the form is judged [m]
    columns: Array  # shape (k, m); terms of the polynomial there [1]
    solution: Array  # shape (k,); coefficients [m]
    root: Array  # shape (k, k); rows whose products add up to their covariance [m]
    dof: float  # degrees of freedom of that covariance
    degree: int  # total degree
    waviness: Array | float = 0.0  # shape (m,); over the polynomial [m]
    peaks: float = 0.0  # standard uncertainty of a zone by the noise of the waviness [m]

    @property
    def is_wavy(self) -> bool:
        """Whether its waviness is judged beside the polynomial."""
        return np.ndim(self.waviness) > 0

    def compute_form_points(self, coefficient_change: Array | float = 0.0) -> Array:
        """Return form and waviness as points [m], after a change of the coefficients [m]."""
        height = (self.solution + coefficient_change) @ self.columns + self.waviness
        return np.column_stack([self.grid, height])

    def draw_coefficient_noise(self, random: np.random.Generator) -> list[Array]:
        """Draw what noise may have added to the coefficients [m].

        It gives every draw and its mirror image.
        """
        # With mirror images the mean over the draws keeps only what curves, and that is the growth.
        half = random.normal(size=(_DRAWS // 2, len(self.root))) @ self.root
        return [*half, *-half]


@dataclass(frozen=True)
class _FaceSide:
    """One side of the rectangle that a face fills."""

    positions: Array  # of all points of the map along it [m]
    begin: float  # of the face [m]
    end: float  # m
    count: int  # points of the face along it

    @property
    def middle(self) -> float:
        """Middle of the side [m]."""
        return 0.5 * (self.begin + self.end)

    @property
    def half_length(self) -> float:
        """Half of the length of the side [m]."""
        return 0.5 * (self.end - self.begin)

    @property
    def highest_degree(self) -> int:
        """Highest degree of a polynomial that has points enough along the side."""
        return min(_MOST_DEGREE, max(self.count // _POINTS_PER_DEGREE, 1))

    def compute_scaled_positions(self) -> Array:
        """Return all positions, -1 to 1 over the face [1]."""
        return (self.positions - self.middle) / self.half_length

    def find_first_indices_at_or_after(self, places: Array) -> NDArray[np.intp]:
        """Return the indices of the first positions at or after places [m]."""
        return np.searchsorted(self.positions, places).clip(0, len(self.positions) - 1)


@dataclass(frozen=True)
class _Powers:
    """Degrees of one term of a form along both sides."""

    x: int
    y: int

    @property
    def total_degree(self) -> int:
        """Sum of both degrees."""
        return self.x + self.y


def fit_face(x: Array, y: Array, height: Array, face: Mask) -> FaceForm:
    """Fit the form of a face of a map.

    Parameters
    ----------
    x, y : array, shape (nx,) and (ny,)
        Positions of columns and rows [m].
    height : array, shape (ny, nx)
        m; nan where nothing was measured.
    face : array of bool, shape (ny, nx)
        Points of the face.

    Returns
    -------
    FaceForm

    Raises
    ------
    MetrologyError
        If fewer than twenty points, or only one row or column, were measured.
    """
    used = face & np.isfinite(height)
    rows = np.flatnonzero(used.any(axis=1))
    columns = np.flatnonzero(used.any(axis=0))
    if used.sum() < _LEAST_POINTS or len(rows) < 2 or len(columns) < 2:
        raise MetrologyError(
            f"face must have at least {_LEAST_POINTS} points on two rows and columns, got "
            f"{int(used.sum())}"
        )
    along_x = _FaceSide(x, x[columns[0]], x[columns[-1]], len(columns))
    along_y = _FaceSide(y, y[rows[0]], y[rows[-1]], len(rows))
    powers = _list_term_degrees(along_x.highest_degree, along_y.highest_degree)
    design = _evaluate_legendre_terms(
        along_x.compute_scaled_positions()[np.newaxis, :],
        along_y.compute_scaled_positions()[:, np.newaxis],
        powers,
    )
    fit = fit_without_spikes(design.reshape(len(design), -1), height.ravel(), used.ravel())
    kept = fit.used.reshape(height.shape)
    residuals = fit.residuals.reshape(height.shape)
    count = float(kept.sum())
    # for terms that vary little over the correlation length, the covariance is that of white noise
    # times one factor
    waves = find_waviness(
        residuals, kept, (_compute_sampling_interval(y), _compute_sampling_interval(x))
    )
    noise = residuals
    if waves is not None:
        noise = residuals - waves.height  # which is judged beside the polynomial
    mean = make_linear_estimate(0.0, kept / count, noise, kept, design)
    # not by eigenvectors, whose signs hang on the last bit: the draws would
    root = np.linalg.cholesky(fit.weights @ fit.weights.T).T * (mean.std * np.sqrt(count))
    mesh_x, mesh_y = np.meshgrid(x, y)
    degree = max(term.total_degree for term in powers)
    form = FaceForm(
        points=np.stack([mesh_x[used], mesh_y[used], height[used]], axis=1),
        grid=np.empty((0, 2)),
        columns=np.empty((len(powers), 0)),
        solution=fit.solution,
        root=root,
        dof=mean.dof,
        degree=degree,
    )
    judged = _sample_form_on_grid(form, face, along_x, along_y, powers)
    if waves is None:
        return judged
    return _add_wave_extremes(judged, waves, along_x, along_y, design)


def _compute_sampling_interval(positions: Array) -> float:
    """Return the sampling interval of positions, shape (n,) [m]."""
    return float((positions[-1] - positions[0]) / (len(positions) - 1))


def _sample_form_on_grid(
    form: FaceForm, face: Mask, along_x: _FaceSide, along_y: _FaceSide, powers: list[_Powers]
) -> FaceForm:
    """Return the form of a face, shape (ny, nx), sampled on a grid within the face."""
    side = np.linspace(-1.0, 1.0, _GRID)
    grid_x, grid_y = np.meshgrid(side, side)
    scaled = np.column_stack([grid_x.ravel(), grid_y.ravel()])
    middles = np.array([along_x.middle, along_y.middle])
    grid = middles + np.array([along_x.half_length, along_y.half_length]) * scaled
    # of a face that does not fill its rectangle, as in a turned map, only where it lies
    inside = face[
        along_y.find_first_indices_at_or_after(grid[:, 1]),
        along_x.find_first_indices_at_or_after(grid[:, 0]),
    ]
    scaled = scaled[inside]
    columns = _evaluate_legendre_terms(scaled[:, 0], scaled[:, 1], powers)
    return replace(form, grid=grid[inside], columns=columns)


def _add_wave_extremes(
    form: FaceForm, waves: WavySurface, along_x: _FaceSide, along_y: _FaceSide, design: Array
) -> FaceForm:
    """Return the form of a wavy face, sampled also where its waves are highest and lowest.

    `design`, shape (k, ny, nx), are the terms of the form. At the ends of the face the polynomial
    alone counts.
    """
    rows, columns = np.nonzero(waves.inside)
    height = waves.height[rows, columns]
    in_row = rows * _CELLS // len(along_y.positions)
    in_column = columns * _CELLS // len(along_x.positions)
    cell = in_row * _CELLS + in_column
    by_height = np.lexsort((height, cell))
    is_first = np.diff(cell[by_height], prepend=-1) > 0
    is_last = np.roll(is_first, -1)
    extremes = by_height[is_first | is_last]
    rows = rows[extremes]
    columns = columns[extremes]
    places = np.column_stack([along_x.positions[columns], along_y.positions[rows]])
    # of so many independent heights of a normal law the highest
    highest = np.sqrt(2.0 * np.log(waves.cells))
    design_at_extremes = design[:, rows, columns]
    not_wavy = np.zeros(len(form.grid))
    return replace(
        form,
        grid=np.concatenate([form.grid, places]),
        columns=np.concatenate([form.columns, design_at_extremes], axis=1),
        waviness=np.concatenate([not_wavy, height[extremes]]),
        peaks=float(highest * waves.noise),
    )


def _list_term_degrees(degree_x: int, degree_y: int) -> list[_Powers]:
    """Return the terms of a form whose total degree is that of the side that carries more."""
    total = max(degree_x, degree_y)
    powers = []
    for x in range(degree_x + 1):
        for y in range(degree_y + 1):
            if x + y <= total:
                powers.append(_Powers(x, y))
    return powers


def _evaluate_legendre_terms(x: Array, y: Array, degrees: list[_Powers]) -> Array:
    """Return products of Legendre's polynomials at positions from -1 to 1, one row a term [1]."""
    basis = np.polynomial.Legendre.basis
    terms = []
    for term in degrees:
        terms.append(np.asarray(basis(term.x)(x) * basis(term.y)(y)))
    return np.stack(terms)


def estimate_zone(measure_zone: Callable[..., float], *faces: FaceForm) -> Estimate:
    """Return the zone of the form of faces, less what noise adds to it [m].

    What is taken off counts in the uncertainty, as a rectangle beside the scatter.

    Parameters
    ----------
    measure_zone : callable
        Takes the points of each face, shape (n, 3) [m], and returns the zone [m].
    *faces : FaceForm
        Forms of the faces.

    Returns
    -------
    Estimate
    """
    # The fit holds the noise once, draws at the two scales hold it as its root of two and twice.
    # Where one term sets the zone, the zone grows with the standard deviation of the noise and the
    # second growth is the first times the root of two; where several do, it grows with a higher
    # power, and the power follows from the two. Either way it is followed back to no noise.
    random = np.random.default_rng(1101)
    draws_of_faces, points, peaks, dofs = [], [], [], []
    for face in faces:
        draws_of_faces.append(face.draw_coefficient_noise(random))
        points.append(face.compute_form_points())
        peaks.append(face.peaks)
        dofs.append(face.dof)
    draws = list(zip(*draws_of_faces, strict=True))
    scale_once, scale_twice = _SCALES
    once = _compute_zones_with_drawn_noise(measure_zone, faces, draws, scale_once)
    twice = _compute_zones_with_drawn_noise(measure_zone, faces, draws, scale_twice)
    zone = float(measure_zone(*points))
    first_growth = float(once.mean()) - zone
    second_growth = float(twice.mean() - once.mean())
    ratio = np.sqrt(2.0)
    if second_growth > _SEVERAL * first_growth > 0.0:
        ratio = second_growth / first_growth
    growth = min(max(first_growth / (ratio - 1.0), 0.0), zone)
    std = math.hypot(float(once.std(ddof=1)), growth / math.sqrt(3.0), *peaks)
    return Estimate(zone - growth, std, min(dofs))


def _compute_zones_with_drawn_noise(
    measure_zone: Callable[..., float],
    faces: tuple[FaceForm, ...],
    draws: list[tuple[Array, ...]],
    noise_scale: float,
) -> Array:
    """Return the zone of faces [m] for each draw of noise on their coefficients.

    The shape is (draws,); the noise is multiplied by `noise_scale`.
    """
    zones = []
    for draw in draws:
        shapes = []
        for face, noise in zip(faces, draw, strict=True):
            shapes.append(face.compute_form_points(noise_scale * noise))
        zones.append(measure_zone(*shapes))
    return np.array(zones)
