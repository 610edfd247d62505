"""Readers of mesh files: meshio, VTK and lib3mf, none of which wrote the file."""

import contextlib
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined

Arrays = tuple[NDArray[np.float64], NDArray[np.int64]]
_MM = 1e-3
_MAX_BYTES = 500_000_000


def _read_with_meshio(path: Path) -> Arrays:
    import meshio

    if path.suffix == ".ply" and b"end_header" not in path.read_bytes():
        raise ValueError("a header that does not end")  # meshio would look for it for ever
    with contextlib.redirect_stdout(io.StringIO()):
        mesh = meshio.read(path)  # VTK would fill up a file that is cut short, without a word
    return (
        np.asarray(mesh.points, dtype=np.float64) * _MM,
        np.asarray(mesh.cells_dict["triangle"], dtype=np.int64),
    )


def _read_with_vtk(path: Path) -> Arrays:
    import pyvista as pv

    found = pv.read(path)
    while isinstance(found, pv.MultiBlock):
        if len(found) != 1:
            raise ValueError("not one mesh")
        found = found[0]
    points = np.asarray(found.points, dtype=np.float64)
    # glTF is in metres, y up
    upright = np.column_stack([points[:, 0], -points[:, 2], points[:, 1]])
    return upright, np.asarray(found.regular_faces, dtype=np.int64)


def _read_as_text(lines: Sequence[str], first: int) -> Arrays:
    # Read one of several objects in an OBJ; meshio would join them
    words = [line.split() for line in lines]
    vertices = np.array([one[1:4] for one in words if one and one[0] == "v"], dtype=np.float64)
    triangles = (
        np.array([one[1:4] for one in words if one and one[0] == "f"], dtype=np.int64) - first
    )
    if (
        vertices.shape[1:] != (3,)
        or triangles.shape[1:] != (3,)
        or not is_complete_mesh(vertices, triangles)
    ):
        raise ValueError("needs vertices and the triangles between them")
    return vertices * _MM, triangles


def _read_with_lib3mf(path: Path) -> Arrays:
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
    return (
        np.array([tuple(v.Coordinates) for v in mesh.GetVertices()], dtype=np.float64) * _MM,
        np.array([tuple(t.Indices) for t in mesh.GetTriangleIndices()], dtype=np.int64),
    )


MESH_READERS: dict[str, Callable[[Path], Arrays]] = {
    **dict.fromkeys((".stl", ".ply", ".obj"), _read_with_meshio),
    ".glb": _read_with_vtk,
    ".3mf": _read_with_lib3mf,
}


def read_mesh(path: Path) -> Arrays:
    """Read a mesh file."""
    found = read_confined(f"{__name__}:read_mesh_confined", path, raises=MetrologyError)
    return found["vertices"], found["triangles"]


def read_mesh_confined(path: Path) -> dict[str, object]:
    """Read a mesh file; called in the confined process, as `read_pieces_confined` is."""
    MetrologyError.require(
        (size := path.stat().st_size) <= _MAX_BYTES,
        f"a mesh file must be at most {_MAX_BYTES} bytes, got {size} [{path.name}]",
    )
    vertices, triangles = MESH_READERS[path.suffix](path)
    if not is_complete_mesh(vertices, triangles):
        raise ValueError("no triangles between finite vertices")
    return {"vertices": vertices, "triangles": triangles}


def is_complete_mesh(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> bool:
    """Tell whether there are triangles, all between finite vertices."""
    return bool(
        len(triangles)
        and triangles.min() >= 0
        and triangles.max() < len(vertices)
        and np.isfinite(vertices).all()
    )


def read_pieces(path: Path) -> list[Arrays]:
    """Read an OBJ of several objects."""
    found = read_confined(f"{__name__}:read_pieces_confined", path, raises=MetrologyError)
    return [
        (found[f"vertices {number}"], found[f"triangles {number}"])
        for number in range(found["count"])
    ]


def read_pieces_confined(path: Path) -> dict[str, object]:
    """Read the objects of an OBJ."""
    found: dict[str, object] = {}
    # after the head of the file
    first = 1
    objects = path.read_text(encoding="ascii").split("\no ")[1:]
    for number, lines in enumerate(objects):
        vertices, triangles = _read_as_text(lines.splitlines()[1:], first)
        first += len(vertices)
        found |= {f"vertices {number}": vertices, f"triangles {number}": triangles}
    if not found:
        raise ValueError("no convex pieces")
    return {**found, "count": len(objects)}
