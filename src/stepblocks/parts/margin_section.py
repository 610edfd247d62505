"""Sections across the margin of a scan, and the shape of tooth and crown beside it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import Array

# of either side from which their shape is taken, and along the margin: a scan's noise averages out
# [m]
FITTED = 1e-3
SECTIONS = 9  # beside each other at a station
COVERED = 1.0 / 3.0  # share of a side that must be there: a hole beside the margin is bridged [1]
_SAMPLES = 51  # of either side of a section
_OUTLYING = 4.0  # robust standard deviations beyond which a sample is debris or the edge of a hole
_MAD_TO_STD = 1.4826  # standard deviation of a normal law over its median absolute deviation
_LEAST_OUTLYING = 1e-9  # distance that a sample may have in any case [m]
_TURNS = 6  # of the frame; each brings it nearer to level by a factor of a hundred
_ROBUST_FITS = 3  # each leaves out what the one before found outlying
_DEPTH = 2.0 * FITTED  # how far inside the margin a section is followed [m]


@dataclass(frozen=True)
class SectionFrame:
    """Where a section lies: unit vectors in the frame of the mesh, shape (3,)."""

    place: Array  # on the margin [m]
    across: Array  # along the tooth, towards the crown
    outward: Array
    along: Array  # the margin; the section is square to it


def make_section_frame(
    margin_point: Array, line_direction: Array, margin_middle: Array, draw_direction: Array
) -> SectionFrame:
    """Find the frame of a section.

    Parameters
    ----------
    margin_point, line_direction : ndarray
        A point of the margin line [m] and its direction there, shape (3,).
    margin_middle : ndarray
        Middle of the margin [m], shape (3,).
    draw_direction : ndarray
        Direction of the crown from the root, shape (3,).

    Returns
    -------
    SectionFrame
        With unit vectors, but for `line_direction`, which keeps its length.
    """
    outward = np.cross(line_direction, draw_direction)
    outward_sign = float(outward @ (margin_point - margin_middle))
    outward *= math.copysign(1.0 / float(np.linalg.norm(outward)), outward_sign)
    across = np.cross(outward, line_direction)
    across_sign = float(across @ draw_direction)
    across *= math.copysign(1.0 / float(np.linalg.norm(across)), across_sign)
    return SectionFrame(margin_point, across, outward, line_direction)


def cut_outermost_section(
    mesh: object, triangle_indices: NDArray[np.int64], frame: SectionFrame
) -> Array:
    """Find the outermost points of a section.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The scan [m].
    triangle_indices : ndarray
        Indices of the triangles that are cut.
    frame : SectionFrame
        Where it lies.

    Returns
    -------
    ndarray
        Points (x towards the crown, z outwards) [m], shape (n, 2).
    """
    import trimesh

    lines = trimesh.intersections.mesh_plane(
        mesh, frame.along, frame.place, local_faces=triangle_indices
    )
    offsets = lines - frame.place
    x = offsets @ frame.across
    z = offsets @ frame.outward
    is_slanted = x[:, 0] != x[:, 1]  # an upright line has no height over x
    x0, x1 = x[is_slanted].T
    z0, z1 = z[is_slanted].T
    samples = np.linspace(-2.0 * FITTED, 2.0 * FITTED, 4 * _SAMPLES)
    shares = (samples[:, None] - x0) / (x1 - x0)
    is_crossed = (shares >= 0.0) & (shares <= 1.0)
    heights = np.where(is_crossed, z0 + shares * (z1 - z0), -np.inf)
    outermost = heights.max(axis=1, initial=-np.inf)
    points = np.column_stack([samples, outermost])
    return np.asarray(points[outermost > -_DEPTH])


class Side(StrEnum):
    """A side of a margin."""

    TOOTH = "tooth"
    CROWN = "crown"


@dataclass(frozen=True)
class MarginFit:
    """Shape of tooth and crown at a station."""

    tooth_curvature: float  # [1/m]
    crown_slope: float  # against the tooth [rad]
    crown_curvature: float  # [1/m]
    scatter: float  # standard deviation of the scan about the shape [m]
    # in the frame of the middle section: where the sides meet [m], then the axes across and
    # outwards of the level frame, shape (3, 2)
    level: Array


@dataclass(frozen=True)
class _Shape:
    """Least squares fit: a level of each section, slopes and curvatures they share."""

    levels: Array  # shape (SECTIONS,) [m]
    tooth_slope: float
    tooth_curvature: float
    crown_slope: float
    crown_curvature: float
    scatter: float


def fit_sections(sections: Sequence[Array], shown_sides: str) -> MarginFit | Side:
    """Fit the shape of tooth and crown to the sections of a station.

    The sections share their shape, each at a level of its own, in a frame that is turned until
    the tooth, or else the crown, is level.

    Parameters
    ----------
    sections : sequence of ndarray
        Points (x, z) of each section [m], shape (n, 2).
    shown_sides : str
        Sides that the scan covers: ``"tooth"``, ``"crown"`` or ``"both"``.

    Returns
    -------
    MarginFit or Side
        The shape, or which side is not there: the scan has a hole beside the margin.
    """
    points = np.concatenate(sections)
    section = np.repeat(np.arange(SECTIONS), [len(rows) for rows in sections])
    origin = np.zeros(2)
    axes = np.eye(2)
    for _ in range(_TURNS):
        sides = _find_points_by_side(points, shown_sides)
        for side, is_on_side in sides.items():
            if is_on_side.sum() < COVERED * _SAMPLES * SECTIONS:
                return side
        is_used = np.any(list(sides.values()), axis=0)
        shape = _fit_section_shape(points[is_used], section[is_used])
        turn = math.atan(shape.crown_slope)
        if Side.TOOTH in sides:
            turn = math.atan(shape.tooth_slope)
        cos = math.cos(turn)
        sin = math.sin(turn)
        points[:, 1] -= shape.levels[section]
        points = points @ np.array([[cos, -sin], [sin, cos]])
        origin = origin + shape.levels[SECTIONS // 2] * axes[1]
        axes = np.array([[cos, sin], [-sin, cos]]) @ axes
    crown_slope = 0.0
    if shown_sides == "both":
        crown_slope = math.atan(shape.crown_slope)
    return MarginFit(
        tooth_curvature=shape.tooth_curvature,
        crown_slope=crown_slope,
        crown_curvature=shape.crown_curvature,
        scatter=shape.scatter,
        level=np.vstack([origin, axes]),
    )


def _find_points_by_side(points: Array, shown_sides: str) -> dict[Side, NDArray[np.bool_]]:
    """Find which points (x, z) lie on each side that a scan covers, shape (n,)."""
    x = points[:, 0]
    is_within = np.abs(x) <= FITTED
    sides = {}
    if shown_sides in ("tooth", "both"):
        sides[Side.TOOTH] = is_within & (x < 0.0)
    if shown_sides in ("crown", "both"):
        sides[Side.CROWN] = is_within & (x > 0.0)
    return sides


def _fit_section_shape(points: Array, section_indices: NDArray[np.intp]) -> _Shape:
    """Fit slopes and curvatures of both sides, and a level of each section, by least squares.

    `points` are (x, z), shape (n, 2), `section_indices` says which section each is of, shape (n,).
    Outlying points are left out step by step.
    """
    x, z = points.T
    columns = [section_indices[:, None] == np.arange(SECTIONS)]
    for is_on_side in (x < 0.0, x > 0.0):
        for power in (1, 2):
            columns.append(np.where(is_on_side, x**power / power, 0.0))
    design = np.column_stack(columns)
    is_used = np.ones(len(x), dtype=bool)
    for _ in range(_ROBUST_FITS):
        coefficients, *_ = np.linalg.lstsq(design[is_used], z[is_used], rcond=None)
        residuals = z - design @ coefficients
        scatter = float(np.std(residuals[is_used]))
        spread = _MAD_TO_STD * float(np.median(np.abs(residuals)))
        is_used = np.abs(residuals) <= max(_OUTLYING * spread, _LEAST_OUTLYING)
    tooth_slope, tooth_curvature, crown_slope, crown_curvature = coefficients[SECTIONS:].tolist()
    return _Shape(
        coefficients[:SECTIONS],
        tooth_slope,
        tooth_curvature,
        crown_slope,
        crown_curvature,
        scatter,
    )
