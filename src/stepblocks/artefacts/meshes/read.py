"""Readers of mesh files: meshio, VTK, lib3mf and our own, none of which wrote the file."""

import contextlib
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.files.stl import read_stl
from stepblocks.files.wavefront import read_obj

_MM = 1e-3
_MOST_BYTES = 500_000_000


class MeshArrays(NamedTuple):
    """A mesh as it was read.

    Attributes
    ----------
    vertices : array, shape (n, 3)
        Points [m].
    triangles : array, shape (m, 3)
        Indices of corners.
    normals : array, shape (m, 3), or (0, 3)
        Normals as the file states them, of any length, zero where it states none.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64] = np.empty((0, 3))


def _read_stl_or_obj(path: Path) -> MeshArrays:
    """Read STL or OBJ, in millimetres."""
    read = read_stl if path.suffix.lower() == ".stl" else read_obj
    mesh = read(path)
    return MeshArrays(mesh.vertices * _MM, mesh.triangles, mesh.normals)


def _read_ply_with_meshio(path: Path) -> MeshArrays:
    """Read PLY, in millimetres."""
    import meshio

    if b"end_header" not in path.read_bytes():
        raise ValueError("a header that does not end")  # meshio would look for it for ever
    with contextlib.redirect_stdout(io.StringIO()):
        mesh = meshio.read(path, file_format="ply")
    vertices = np.asarray(mesh.points, dtype=np.float64) * _MM
    triangles = np.asarray(mesh.cells_dict["triangle"], dtype=np.int64)
    if not {"nx", "ny", "nz"} <= set(mesh.point_data):
        return MeshArrays(vertices, triangles)
    of_vertices = np.column_stack([mesh.point_data[name] for name in ("nx", "ny", "nz")])
    normals = of_vertices.astype(np.float64)[triangles].sum(axis=1)
    return MeshArrays(vertices, triangles, normals)


def _read_glb_with_vtk(path: Path) -> MeshArrays:
    """Read GLB, in metres and y up."""
    import pyvista as pv

    mesh = pv.read(path)
    while isinstance(mesh, pv.MultiBlock):
        if len(mesh) != 1:
            raise ValueError("not one mesh")
        mesh = mesh[0]
    # glTF is in metres, y up
    x, z, minus_y = np.asarray(mesh.points, dtype=np.float64).T
    vertices = np.column_stack([x, -minus_y, z])
    return MeshArrays(vertices, np.asarray(mesh.regular_faces, dtype=np.int64))


def _read_3mf_with_lib3mf(path: Path) -> MeshArrays:
    """Read the first mesh of a 3MF."""
    try:
        from lib3mf import Lib3MF, get_wrapper
    except ImportError as error:
        raise MetrologyError(
            "a 3MF file cannot be read here: lib3mf is missing, which has no wheel for this "
            f"processor [{path.name}]"
        ) from error
    model = get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    if model.GetUnit() != Lib3MF.ModelUnit.MilliMeter:
        raise ValueError("another unit than the millimetre")
    objects = model.GetMeshObjects()
    objects.MoveNext()
    mesh = objects.GetCurrentMeshObject()
    points = [tuple(vertex.Coordinates) for vertex in mesh.GetVertices()]
    corners = [tuple(triangle.Indices) for triangle in mesh.GetTriangleIndices()]
    return MeshArrays(np.array(points, dtype=np.float64) * _MM, np.array(corners, dtype=np.int64))


MESH_READERS: dict[str, Callable[[Path], MeshArrays]] = {
    ".stl": _read_stl_or_obj,
    ".ply": _read_ply_with_meshio,
    ".obj": _read_stl_or_obj,
    ".glb": _read_glb_with_vtk,
    ".3mf": _read_3mf_with_lib3mf,
}


def read_mesh(path: Path) -> MeshArrays:
    """Read a mesh file.

    Raises
    ------
    MetrologyError
        If it is not a sound mesh of triangles.
    """
    content = read_confined(f"{__name__}:read_mesh_in_worker", path, raises=MetrologyError)
    return MeshArrays(content["vertices"], content["triangles"], content["normals"])


def read_mesh_in_worker(path: Path) -> dict[str, object]:
    """Read a mesh file; runs in the confined process."""
    size = path.stat().st_size
    if size > _MOST_BYTES:
        raise MetrologyError(
            f"a mesh file must be at most {_MOST_BYTES} bytes, got {size} [{path.name}]"
        )
    mesh = MESH_READERS[path.suffix.lower()](path)
    if not has_finite_triangles(mesh):
        raise ValueError("no triangles between finite vertices")
    return mesh._asdict()


def has_finite_triangles(mesh: MeshArrays) -> bool:
    """Tell whether there are triangles, and all of them join finite vertices."""
    triangles = mesh.triangles
    if not len(triangles) or triangles.min() < 0 or triangles.max() >= len(mesh.vertices):
        return False
    return bool(np.isfinite(mesh.vertices).all())


def read_convex_pieces(path: Path) -> list[MeshArrays]:
    """Read an OBJ of several objects.

    Raises
    ------
    MetrologyError
        If it has none, or one is not a sound mesh of triangles.
    """
    content = read_confined(f"{__name__}:read_pieces_in_worker", path, raises=MetrologyError)
    pieces = []
    for number in range(content["count"]):
        pieces.append(MeshArrays(content[f"vertices {number}"], content[f"triangles {number}"]))
    return pieces


def read_pieces_in_worker(path: Path) -> dict[str, object]:
    """Read the objects of an OBJ; runs in the confined process."""
    content: dict[str, object] = {}
    vertices_before = 0
    _, *objects = path.read_text(encoding="ascii").split("\no ")
    for number, text in enumerate(objects):
        _, *lines = text.splitlines()
        mesh = _read_obj_object(lines, vertices_before)
        vertices_before += len(mesh.vertices)
        content[f"vertices {number}"] = mesh.vertices
        content[f"triangles {number}"] = mesh.triangles
    if not objects:
        raise ValueError("no convex pieces")
    content["count"] = len(objects)
    return content


def _read_obj_object(lines: Sequence[str], vertices_before: int) -> MeshArrays:
    """Read one of several objects in an OBJ, which counts the vertices of all from 1.

    meshio would join the objects.
    """
    points = []
    corners = []
    for line in lines:
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            points.append(words[1:4])
        elif words[0] == "f":
            corners.append(words[1:4])
    vertices = np.array(points, dtype=np.float64) * _MM
    triangles = np.array(corners, dtype=np.int64) - (vertices_before + 1)
    are_spatial = vertices.shape[1:] == (3,) and triangles.shape[1:] == (3,)
    mesh = MeshArrays(vertices, triangles)
    if not are_spatial or not has_finite_triangles(mesh):
        raise ValueError("needs vertices and the triangles between them")
    return mesh
