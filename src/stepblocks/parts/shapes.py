"""Parts as solids, as convex pieces, and as volumes in closed form."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from stepblocks.parts.kind import Part
from stepblocks.parts.mesh import Mesh

if TYPE_CHECKING:
    from stepblocks.cad.kernel import Body


def build_solids(part: Part) -> list[tuple[str, Body]]:
    """Build the solids of a part with the CAD kernel.

    Parameters
    ----------
    part : Part
        What is asked for.

    Returns
    -------
    list of (str, Body)
        Its named solids, in the frame that its kind documents; opaque but to `stepblocks.cad`.

    Raises
    ------
    SolidError
        If an operation of the kernel does not give one valid solid.
    """
    return list(zip(part.bodies, part.solids(), strict=True))


def solid_volumes(part: Part) -> tuple[float, ...]:
    """Volumes of the solids of a part in closed form, derived without the CAD kernel.

    A block is two chamfered halves, integrated in horizontal slices; a body of revolution follows from Pappus and Guldin on
    its half section, ``V = pi * contour integral of r^2 dz``; a bent wire is a torus.

    Parameters
    ----------
    part : Part
        What is asked for.

    Returns
    -------
    tuple of float
        Volume of each solid [m^3], in the order in which they are built.
    """
    return part.volumes()


def convex_pieces(part: Part) -> list[Mesh]:
    """Cut a part into convex pieces, for simulators that turn one concave mesh into its hull and a step into a ramp.

    Pieces describe what a probe can touch: fixing holes and engraving are left out. They fill the part without overlapping.

    Parameters
    ----------
    part : Part
        What is asked for.

    Returns
    -------
    list of Mesh
        Closed convex meshes, outward-wound.
    """
    return [_mesh(f"{part.id}-piece-{number:03}", piece) for number, piece in enumerate(part.hulls(), start=1)]


def hull(points: Iterable[Sequence[float]]) -> Any:
    """Convex hull of points [m] as a manifold [mm]."""
    import manifold3d

    return manifold3d.Manifold.hull_points(np.asarray(list(points)) * 1e3)


def split(solid: Any, axis: str, position: float) -> tuple[Any, Any]:
    """Split a manifold at a plane [m] square to an axis; the part below it comes first."""
    normal = tuple(1.0 if name == axis else 0.0 for name in "xyz")
    above, below = solid.split_by_plane(normal, position * 1e3)
    return below, above


def _mesh(name: str, piece: Any) -> Mesh:
    """Put vertices and triangles in ascending order: the hull's own order varies with its threads."""
    mesh = piece.to_mesh64()
    vertices, index = np.unique(np.asarray(mesh.vert_properties)[:, :3], axis=0, return_inverse=True)
    triangles = index.reshape(-1)[np.asarray(mesh.tri_verts).astype(np.int64)]
    first = triangles.argmin(axis=1)[:, None]
    triangles = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    return Mesh(name, vertices * 1e-3, triangles[np.lexsort(triangles.T[::-1])])
