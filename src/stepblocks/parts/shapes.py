"""Parts as solids, as meshes and as convex pieces."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks import cad
from stepblocks.errors import HapticsError
from stepblocks.parts.kind import COARSE_DEFLECTION, CONTACT_DEFLECTION, Manifold, Part

_MILLIMETRES = 1e3  # of a metre: manifolds are in millimetres
_LIFT_STEP = 1e-7  # by which the slope of the volume over the lift is found [m]
_LIFT_ITERATIONS = 6  # of Newton's rule, at most
_SAME_VOLUME = 1e-12  # relative difference of volumes that are taken as equal


@dataclass(frozen=True)
class Mesh:
    """A closed triangle mesh.

    Attributes
    ----------
    name : str
        Name of the body.
    vertices : ndarray
        Points [m], shape (n, 3).
    triangles : ndarray
        Indices, shape (m, 3), counter-clockwise seen from outside.
    """

    name: str
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]

    def __repr__(self) -> str:
        return f"Mesh({self.name!r}, {len(self.vertices)} points, {len(self.triangles)} triangles)"


def build_solids(part: Part) -> list[tuple[str, cad.door.Body]]:
    """Build the solids of a part with the CAD kernel.

    Parameters
    ----------
    part : Part
        What is asked for.

    Returns
    -------
    list of (str, cad.door.Body)
        Its named solids, in the frame that its kind documents; opaque but to `stepblocks.cad`.

    Raises
    ------
    SolidError
        If an operation of the kernel does not give one valid solid.
    """
    return list(zip(part.bodies, part.solids(), strict=True))


def build_convex_pieces(part: Part) -> list[Mesh]:
    """Cut a part into convex pieces for simulators.

    Simulators replace a concave mesh by its hull, and so a step by a ramp.

    Pieces describe what a probe can touch: fixing holes and engraving are left out. They fill the
    part without overlapping.

    Parameters
    ----------
    part : Part
        What is asked for.

    Returns
    -------
    list of Mesh
        Closed convex meshes, outward-wound.
    """
    pieces = []
    for number, hull in enumerate(part.hulls(), start=1):
        pieces.append(_make_sorted_mesh(f"{part.id}-piece-{number:03}", hull))
    return pieces


def mesh_solid(part: Part, name: str, body: cad.door.Body) -> Mesh:
    """Mesh one solid of a part, finest where the probe touches.

    Parameters
    ----------
    part : Part
        What the solid belongs to; it knows where the contact is.
    name : str
        Name of the body.
    body : cad.door.Body
        The solid, as `build_solids` returns it.

    Returns
    -------
    Mesh
        Watertight and outward-wound, of the volume of the solid.

    Raises
    ------
    HapticsError
        If the mesh is not a closed, oriented 2-manifold.
    """
    raw = cad.kernel.tessellate(body, part.chordal_error)
    deflections = np.array([part.chordal_error(face) for face in raw.faces])
    vertices = _lift_vertices(raw, deflections, cad.kernel.compute_volume(body))
    mesh = Mesh(name, vertices, raw.triangles)
    require_manifold(mesh)
    return mesh


def compute_enclosed_volume(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> float:
    """Compute the volume that a closed mesh encloses, by the divergence theorem.

    Parameters
    ----------
    vertices : ndarray
        Points, shape (n, 3).
    triangles : ndarray
        Indices of their corners, shape (m, 3).

    Returns
    -------
    float
        The volume, negative where the triangles are wound inwards, in the cube of the unit of the
        points.
    """
    centred = vertices - vertices.mean(axis=0)
    a = centred[triangles[:, 0]]
    b = centred[triangles[:, 1]]
    c = centred[triangles[:, 2]]
    return math.fsum((a * np.cross(b, c)).ravel().tolist()) / 6.0


def _lift_vertices(
    tessellation: cad.door.Tessellation, deflections: NDArray[np.float64], volume: float
) -> NDArray[np.float64]:
    """Lift vertices of coarse curved faces until a mesh encloses a volume [m^3].

    Chords cut corners: a mesh inscribed in a hole of 2.5 mm at 10 um is 1e-4 of a block too heavy.
    `deflections` are the chordal errors of the faces [m]. Returns the points [m], shape (n, 3).
    """
    is_curved = np.array([face.kind != "PLANE" for face in tessellation.faces])
    is_coarse = _find_coarse_faces(is_curved, deflections)
    if not is_coarse.any():
        return tessellation.vertices
    corners = tessellation.vertices[tessellation.triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    directions = _average_coarse_normals(tessellation, areas, is_coarse)
    _project_directions_onto_planes(directions, tessellation, areas, np.flatnonzero(~is_curved))
    is_fine = is_curved & ~is_coarse
    fine_vertices = np.unique(tessellation.triangles[is_fine[tessellation.face]])
    directions[fine_vertices] = 0.0
    return _lift_vertices_to_volume(tessellation, directions, volume)


def _find_coarse_faces(
    is_curved: NDArray[np.bool_], deflections: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Find the curved faces whose vertices are lifted, shape (faces,).

    Those are the coarser ones; where all faces are alike, all that are curved, unless the probe
    touches them.
    """
    finest = deflections.min()
    if finest < deflections.max():
        is_coarser: NDArray[np.bool_] = deflections > finest
        return is_curved & is_coarser
    if finest == CONTACT_DEFLECTION:
        return np.zeros_like(is_curved)
    return is_curved


def _average_coarse_normals(
    tessellation: cad.door.Tessellation, areas: NDArray[np.float64], is_coarse: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Average the normals of the coarse faces at each vertex, weighted by area.

    `areas` are twice the area vectors of the triangles [m^2], shape (m, 3). Returns unit vectors,
    shape (n, 3); zero off the coarse faces.
    """
    on_coarse = is_coarse[tessellation.face]
    normals = np.zeros((len(tessellation.vertices), 3))
    for corner in range(3):
        np.add.at(normals, tessellation.triangles[on_coarse, corner], areas[on_coarse])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    directions = np.zeros_like(normals)
    np.divide(normals, lengths, out=directions, where=lengths > 0.0)
    return directions


def _project_directions_onto_planes(
    directions: NDArray[np.float64],
    tessellation: cad.door.Tessellation,
    areas: NDArray[np.float64],
    plane_indices: NDArray[np.intp],
) -> None:
    """Keep the directions of vertices within the plane faces that they also lie on, in place.

    `plane_indices` are the indices of the plane faces.
    """
    for index in plane_indices:
        on_face = tessellation.face == index
        area = areas[on_face].sum(axis=0)
        normal = area / math.sqrt(math.fsum((area * area).tolist()))
        touched = np.unique(tessellation.triangles[on_face])
        out_of_plane = (directions[touched] * normal).sum(axis=1, keepdims=True)
        directions[touched] -= out_of_plane * normal


def _lift_vertices_to_volume(
    tessellation: cad.door.Tessellation, directions: NDArray[np.float64], volume: float
) -> NDArray[np.float64]:
    """Solve for the lift by Newton's rule; the volume is a cubic of it, and nearly linear.

    Returns the lifted points [m], shape (n, 3).
    """
    lift = 0.0
    for _ in range(_LIFT_ITERATIONS):
        reached = compute_enclosed_volume(
            tessellation.vertices + lift * directions, tessellation.triangles
        )
        further = tessellation.vertices + (lift + _LIFT_STEP) * directions
        slope = (compute_enclosed_volume(further, tessellation.triangles) - reached) / _LIFT_STEP
        if slope == 0.0 or abs(reached - volume) <= _SAME_VOLUME * volume:
            break
        lift += (volume - reached) / slope
    if not abs(lift) <= COARSE_DEFLECTION:
        raise HapticsError(
            f"a mesh must keep its chordal error ({COARSE_DEFLECTION:g} m), "
            f"got a lift of {lift:g} m"
        )
    return tessellation.vertices + lift * directions


def require_manifold(mesh: Mesh) -> None:
    """Refuse a mesh that is not closed, oriented and outward-wound.

    Raises
    ------
    HapticsError
        With the name of the mesh and what is wrong with it.
    """
    import manifold3d

    solid = manifold3d.Manifold(
        manifold3d.Mesh64(mesh.vertices * _MILLIMETRES, mesh.triangles.astype(np.uint64))
    )
    status = solid.status()
    if status != manifold3d.Error.NoError:
        raise HapticsError(f"the mesh of {mesh.name} must be a manifold, got {status}")
    if not compute_enclosed_volume(mesh.vertices, mesh.triangles) > 0.0:
        raise HapticsError(f"the mesh of {mesh.name} must be wound outwards, got an inward winding")


def make_hull(points: Iterable[Sequence[float]]) -> Manifold:
    """Make the convex hull of points [m] as a manifold [mm]."""
    import manifold3d

    return manifold3d.Manifold.hull_points(np.asarray(list(points)) * _MILLIMETRES)


def split_solid(solid: Manifold, axis: str, position: float) -> tuple[Manifold, Manifold]:
    """Split a manifold at a plane [m] square to an axis; the part below it comes first."""
    normal = [0.0, 0.0, 0.0]
    normal["xyz".index(axis)] = 1.0
    above, below = solid.split_by_plane(tuple(normal), position * _MILLIMETRES)
    return below, above


def _make_sorted_mesh(name: str, manifold: Manifold) -> Mesh:
    """Make a mesh [m] of a manifold [mm], its vertices and triangles sorted.

    The order of a hull varies with its threads.
    """
    mesh = manifold.to_mesh64()
    points = np.asarray(mesh.vert_properties)[:, :3]
    vertices, index = np.unique(points, axis=0, return_inverse=True)
    triangles = index.reshape(-1)[np.asarray(mesh.tri_verts).astype(np.int64)]
    # each triangle starts at its lowest vertex, and keeps its winding
    lowest = triangles.argmin(axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (lowest + np.arange(3)) % 3, axis=1)
    order = np.lexsort(triangles.T[::-1])
    return Mesh(name, vertices * 1e-3, triangles[order])
