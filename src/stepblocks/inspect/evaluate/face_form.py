"""Flatness and parallelism of the form of a face, apart from the noise of the scan.

The zone that holds all measured points grows with noise and with the number of points, and says little of a face. Stated
here is the zone of the form: of the polynomial of total degree three or less, fitted by least squares, over the face that was
scanned. That polynomial is the filter. What its coefficients owe to noise is drawn from their covariance: the mean by which the
zone grows with it is taken off, its scatter is the uncertainty. The zone of all points stands beside it as a note.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.inspect.evaluate.flatness import Plane, flatness, parallelism
from stepblocks.inspect.evaluate.noise_uncertainty import noise_uncertainty
from stepblocks.inspect.evaluate.roughness_noise import outlier_mask

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_DEGREE = 3  # Largest total degree of the form [1]; along a side with fewer than four points per degree it is lower
_DRAWS = 40
_SCALES = (1.0, np.sqrt(3.0))
# Ratio of the two growths from which it is told from the root of two [1]; forty draws scatter it by a third
_SEVERAL = 2.0
_GRID = 9


@dataclass(frozen=True)
class FormZone:
    """Width of a zone."""

    zone: float  # Zone of the form and its standard uncertainty from noise [m]
    std: float
    dof: float  # Degrees of freedom of that uncertainty, which are those of the noise
    all_points: float  # Zone of every measured point, spikes and noise included [m]


@dataclass(frozen=True)
class FaceForm:
    """Form of one face: a polynomial, the covariance of its coefficients, and where it was measured."""

    points: Array  # shape (n, 3); Measured points [m]
    grid: Array  # shape (m, 2); Positions over the face at which the form is judged [m]
    columns: Array  # shape (k, m); Terms of the polynomial there [1]
    solution: Array  # shape (k,); Coefficients [m]
    root: Array  # shape (k, k); Rows whose products add up to their covariance [m]
    dof: float  # Degrees of freedom of that covariance
    degree: int  # Total degree

    def shape(self, added: Array | float = 0.0) -> Array:
        """Return the form as points [m], with `added` [m] on its coefficients."""
        return np.column_stack([self.grid, (self.solution + added) @ self.columns])

    def draws(self, random: np.random.Generator) -> list[Array]:
        """Return what noise may have added to the coefficients [m]: every draw and its mirror image.

        With mirror images the mean over the draws keeps only what curves, and that is the growth.
        """
        half = random.normal(size=(_DRAWS // 2, len(self.root))) @ self.root
        return [*half, *-half]


def fit_face(x: Array, y: Array, height: Array, face: Mask) -> FaceForm:
    """Fit the form of a face of a map."""
    used = face & np.isfinite(height)
    rows, columns = np.flatnonzero(used.any(axis=1)), np.flatnonzero(used.any(axis=0))
    if used.sum() < 20 or len(rows) < 2 or len(columns) < 2:
        raise MetrologyError(f"face must have at least 20 points on two rows and columns, got {int(used.sum())}")
    spans = (x[columns[0]], x[columns[-1]]), (y[rows[0]], y[rows[-1]])
    degrees = [min(MOST_DEGREE, max(len(index) // 4, 1)) for index in (columns, rows)]
    powers = [(i, j) for i in range(degrees[0] + 1) for j in range(degrees[1] + 1) if i + j <= max(degrees)]
    at_x, at_y = (_scaled(axis, *span) for axis, span in zip((x, y), spans, strict=True))
    design = np.stack([_legendre(at_x, i)[np.newaxis, :] * _legendre(at_y, j)[:, np.newaxis] for i, j in powers])
    for _ in range(4):
        solution = np.linalg.lstsq(design[:, used].T, height[used], rcond=None)[0]
        residuals = height - np.tensordot(solution, design, 1)
        spikes = np.zeros_like(used)
        spikes[used] = outlier_mask(residuals[used])
        if not spikes.any():
            break
        used &= ~spikes
    count = float(used.sum())
    # for terms that vary little over the correlation length, the covariance is that of white noise times one factor
    mean = noise_uncertainty(used / count, residuals, used, list(design))
    inverse = np.linalg.inv(design[:, used] @ design[:, used].T)
    values, vectors = np.linalg.eigh(inverse * mean.std**2 * count)
    root = np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))).T, dtype=np.float64)
    steps = np.linspace(-1.0, 1.0, _GRID)
    gx, gy = (one.ravel() for one in np.meshgrid(steps, steps))
    grid = np.column_stack([_placed(gx, *spans[0]), _placed(gy, *spans[1])])
    terms = np.stack([_legendre(gx, i) * _legendre(gy, j) for i, j in powers])
    measured = face & np.isfinite(height)
    mx, my = np.meshgrid(x, y)
    points = np.stack([mx[measured], my[measured], height[measured]], axis=1)
    coefficients = np.asarray(solution, dtype=np.float64)
    return FaceForm(points, grid, terms, coefficients, root, mean.dof, max(i + j for i, j in powers))


def _legendre(at: Array, degree: int) -> Array:
    """Return Legendre's polynomial of a degree."""
    return np.asarray(np.polynomial.Legendre.basis(degree)(at))


def _scaled(axis: Array, low: float, high: float) -> Array:
    return (axis - 0.5 * (low + high)) / (0.5 * (high - low))


def _placed(at: Array, low: float, high: float) -> Array:
    return 0.5 * (low + high) + 0.5 * (high - low) * at


def zone_of_flatness(face: FaceForm) -> FormZone:
    """Flatness of the form of a face (ISO 1101, minimum zone)."""
    added = face.draws(np.random.default_rng(1101))
    drawn = [np.array([flatness(face.shape(scale * one)).zone for one in added]) for scale in _SCALES]
    return _without_growth(flatness(face.shape()).zone, drawn, face.dof, flatness(face.points).zone)


def zone_of_parallelism(face: FaceForm, datum: FaceForm) -> FormZone:
    """Parallelism of the form of a face to the minimum-zone plane of the form of another (ISO 1101)."""
    random = np.random.default_rng(1101)
    pairs = list(zip(face.draws(random), datum.draws(random), strict=True))

    def zones(scale: float) -> Array:
        return np.array([parallelism(face.shape(scale * a), flatness(datum.shape(scale * b))) for a, b in pairs])

    zone = parallelism(face.shape(), flatness(datum.shape()))
    plane: Plane = flatness(datum.points)
    drawn = [zones(scale) for scale in _SCALES]
    return _without_growth(zone, drawn, min(face.dof, datum.dof), parallelism(face.points, plane))


def _without_growth(zone: float, drawn: list[Array], dof: float, all_points: float) -> FormZone:
    """Take off what noise has added; as much again, as a rectangle, counts beside the scatter.

    The fit holds the noise once, draws at the two scales hold it as its root of two and twice. Where one term sets the zone, the
    zone grows with the standard deviation of the noise and the second growth is the first times the root of two; where several
    do, it grows with a higher power, and the power follows from the two. Either way it is followed back to no noise.
    """
    first, second = float(drawn[0].mean()) - zone, float(drawn[1].mean() - drawn[0].mean())
    ratio = second / first if second > _SEVERAL * first > 0.0 else np.sqrt(2.0)
    growth = min(max(first / (ratio - 1.0), 0.0), zone)
    std = float(np.hypot(drawn[0].std(ddof=1), growth / np.sqrt(3.0)))
    return FormZone(zone - growth, std, dof, all_points)
