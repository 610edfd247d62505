"""Meshes read back from disk, each through a reader that did not write it: meshio, lib3mf, pygltflib instead of trimesh."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.confined import read_confined
from stepblocks.errors import MetrologyError

Arrays = tuple[NDArray[np.float64], NDArray[np.int64]]
_MM = 1e-3
_MAX_BYTES = 500_000_000


def _with_meshio(path: Path) -> Arrays:
    import meshio

    if path.suffix == ".ply" and b"end_header" not in path.read_bytes():
        raise ValueError("a header that does not end")  # meshio would look for it for ever
    with contextlib.redirect_stdout(io.StringIO()):
        mesh = meshio.read(path)
    triangles = np.asarray(mesh.cells_dict["triangle"], dtype=np.int64)
    return np.asarray(mesh.points, dtype=np.float64) * _MM, triangles


def _with_lib3mf(path: Path) -> Arrays:
    from lib3mf import Lib3MF, get_wrapper

    model = get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    if model.GetUnit() != Lib3MF.ModelUnit.MilliMeter:
        raise ValueError("another unit than the millimetre")
    objects = model.GetMeshObjects()
    objects.MoveNext()
    mesh = objects.GetCurrentMeshObject()
    vertices = np.array([tuple(vertex.Coordinates) for vertex in mesh.GetVertices()], dtype=np.float64)
    triangles = np.array([tuple(t.Indices) for t in mesh.GetTriangleIndices()], dtype=np.int64)
    return vertices * _MM, triangles


def _with_pygltflib(path: Path) -> Arrays:
    import pygltflib

    document = pygltflib.GLTF2().load(str(path))
    blob = document.binary_blob()
    nodes = [node for node in document.nodes if node.mesh is not None]
    if len(nodes) != 1 or any(getattr(nodes[0], name) for name in ("matrix", "translation", "rotation", "scale")):
        raise ValueError("not one mesh without a transformation")
    primitive = document.meshes[nodes[0].mesh].primitives[0]

    def array(index: int) -> NDArray[np.generic]:
        accessor = document.accessors[index]
        view = document.bufferViews[accessor.bufferView]
        kind = {5126: "<f4", 5125: "<u4", 5123: "<u2", 5121: "<u1"}[accessor.componentType]
        width = {"SCALAR": 1, "VEC3": 3}[accessor.type]
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        return np.frombuffer(blob, kind, accessor.count * width, start).reshape(-1, width)

    points = array(primitive.attributes.POSITION).astype(np.float64)
    upright = np.column_stack([points[:, 0], -points[:, 2], points[:, 1]])  # glTF is y up
    return upright, array(primitive.indices).astype(np.int64).reshape(-1, 3)


MESH_READERS: dict[str, Callable[[Path], Arrays]] = {
    **dict.fromkeys((".stl", ".obj", ".ply"), _with_meshio),
    ".3mf": _with_lib3mf,
    ".glb": _with_pygltflib,
}


def read_mesh(path: Path) -> Arrays:
    """Read a mesh file."""
    found = read_confined(f"{__name__}:mesh_in", path, raises=MetrologyError)
    return found["vertices"], found["triangles"]


def mesh_in(path: Path) -> dict[str, Any]:
    """Read a mesh file; called in the confined process, as `pieces_in` is."""
    if (size := path.stat().st_size) > _MAX_BYTES:
        raise MetrologyError(f"a mesh file must be at most {_MAX_BYTES} bytes, got {size} [{path.name}]")
    vertices, triangles = MESH_READERS[path.suffix](path)
    if not is_whole(vertices, triangles):
        raise ValueError("no triangles between finite vertices")
    return {"vertices": vertices, "triangles": triangles}


def is_whole(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> bool:
    """Tell whether there are triangles, all between finite vertices."""
    within = len(triangles) and triangles.min() >= 0 and triangles.max() < len(vertices)
    return bool(within and np.isfinite(vertices).all())


def read_pieces(path: Path) -> list[Arrays]:
    """Read an OBJ of several objects."""
    found = read_confined(f"{__name__}:pieces_in", path, raises=MetrologyError)
    return [(found[f"vertices {number}"], found[f"triangles {number}"]) for number in range(found["count"])]


def pieces_in(path: Path) -> dict[str, Any]:
    """Read the objects of an OBJ."""
    found: dict[str, Any] = {}
    first = count = 1
    for count, block in enumerate(path.read_text(encoding="ascii").split("\no ")):
        if count == 0:  # the head of the file
            continue
        lines = [line.split() for line in block.splitlines()[1:]]
        vertices = np.array([line[1:4] for line in lines if line and line[0] == "v"], dtype=np.float64)
        triangles = np.array([line[1:4] for line in lines if line and line[0] == "f"], dtype=np.int64) - first
        if vertices.shape[1:] != (3,) or triangles.shape[1:] != (3,) or not is_whole(vertices, triangles):
            raise ValueError("a piece needs vertices and the triangles between them")
        first += len(vertices)
        found |= {f"vertices {count - 1}": vertices * _MM, f"triangles {count - 1}": triangles}
    if not found:
        raise ValueError("no convex pieces")
    return {**found, "count": count}
