"""Parts as solids, as meshes and as convex pieces."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks import cad
from stepblocks.errors import HapticsError
from stepblocks.parts.kind import COARSE_DEFLECTION, CONTACT_DEFLECTION, Manifold, Part


@dataclass(frozen=True)
class Mesh:
    """A closed triangle mesh.

    Attributes
    ----------
    name : str
        Of the body.
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

    Simulators turn one concave mesh into its hull, and a step into a ramp.

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
    return [
        _sort_mesh(f"{part.id}-piece-{number:03}", piece)
        for number, piece in enumerate(part.hulls(), start=1)
    ]


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
    mesh = Mesh(
        name,
        _lift_vertices(
            raw,
            np.array([part.chordal_error(face) for face in raw.faces]),
            cad.kernel.compute_volume(body),
        ),
        raw.triangles,
    )
    require_manifold(mesh)
    return mesh


def compute_enclosed_volume(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> float:
    """Volume that a closed mesh encloses, by the divergence theorem."""
    centred = vertices - vertices.mean(axis=0)
    a, b, c = (centred[triangles[:, corner]] for corner in range(3))
    return math.fsum((a * np.cross(b, c)).ravel().tolist()) / 6.0


def _lift_vertices(
    raw: cad.door.Tessellation, deflection: NDArray[np.float64], volume: float
) -> NDArray[np.float64]:
    # Lift vertices of coarse curved faces until the mesh encloses `volume`
    # chords cut corners: a mesh inscribed in a hole of 2.5 mm at 10 um is 1e-4 of a block too heavy
    curved = np.array([face.kind != "PLANE" for face in raw.faces])
    finest = deflection.min()
    coarse = curved & (deflection > finest) if finest < deflection.max() else curved
    if finest == deflection.max() == CONTACT_DEFLECTION or not coarse.any():
        return raw.vertices
    count = len(raw.vertices)
    on_coarse = coarse[raw.face]
    corners = raw.vertices[raw.triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals, kept = np.zeros((count, 3)), np.zeros(count, dtype=bool)
    for corner in range(3):
        np.add.at(normals, raw.triangles[on_coarse, corner], areas[on_coarse])
        kept[raw.triangles[(curved & ~coarse)[raw.face], corner]] = True
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    for index in np.flatnonzero(~curved):  # stay within the plane faces that a vertex also lies on
        on_face = raw.face == index
        area = areas[on_face].sum(axis=0)
        plane = area / math.sqrt(math.fsum((area * area).tolist()))
        touched = np.unique(raw.triangles[on_face])
        normals[touched] -= (normals[touched] * plane).sum(axis=1, keepdims=True) * plane
    normals[kept] = 0.0
    return _lift_to_volume(raw, normals, volume)


def _lift_to_volume(
    raw: cad.door.Tessellation, direction: NDArray[np.float64], volume: float
) -> NDArray[np.float64]:
    # Solve for the lift by Newton's rule; the volume is a cubic of it, and nearly linear
    lift, step = 0.0, 1e-7
    for _ in range(6):
        here = compute_enclosed_volume(raw.vertices + lift * direction, raw.triangles)
        slope = (
            compute_enclosed_volume(raw.vertices + (lift + step) * direction, raw.triangles) - here
        ) / step
        if slope == 0.0 or abs(here - volume) <= 1e-12 * volume:
            break
        lift += (volume - here) / slope
    HapticsError.require(
        abs(lift) <= COARSE_DEFLECTION,
        f"a mesh must keep its chordal error ({COARSE_DEFLECTION:g} m), got a lift of {lift:g} m",
    )
    return raw.vertices + lift * direction


def require_manifold(mesh: Mesh) -> None:
    """Refuse a mesh that is not closed, oriented and outward-wound."""
    import manifold3d

    solid = manifold3d.Manifold(
        manifold3d.Mesh64(mesh.vertices * 1e3, mesh.triangles.astype(np.uint64))
    )
    HapticsError.require(
        solid.status() == manifold3d.Error.NoError,
        f"the mesh of {mesh.name} must be a manifold, got {solid.status()}",
    )
    HapticsError.require(
        compute_enclosed_volume(mesh.vertices, mesh.triangles) > 0.0,
        f"the mesh of {mesh.name} must be wound outwards, got an inward winding",
    )


def make_hull(points: Iterable[Sequence[float]]) -> Manifold:
    """Convex hull of points [m] as a manifold [mm]."""
    import manifold3d

    return manifold3d.Manifold.hull_points(np.asarray(list(points)) * 1e3)


def split_solid(solid: Manifold, axis: str, position: float) -> tuple[Manifold, Manifold]:
    """Split a manifold at a plane [m] square to an axis; the part below it comes first."""
    above, below = solid.split_by_plane(
        tuple(1.0 if name == axis else 0.0 for name in "xyz"), position * 1e3
    )
    return below, above


def _sort_mesh(name: str, piece: Manifold) -> Mesh:
    # Sort vertices and triangles: the order of the hull varies with its threads
    mesh = piece.to_mesh64()
    vertices, index = np.unique(
        np.asarray(mesh.vert_properties)[:, :3], axis=0, return_inverse=True
    )
    triangles = index.reshape(-1)[np.asarray(mesh.tri_verts).astype(np.int64)]
    first = triangles.argmin(axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    return Mesh(name, vertices * 1e-3, triangles[np.lexsort(triangles.T[::-1])])
