"""Writers of mesh files, one per format in `MESH_FORMATS`.

Every byte depends on the mesh alone: no dates, no random identifiers.
"""

import re
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stepblocks.compute.collector import pause_garbage_collector
from stepblocks.files.archives import pin_archive_times
from stepblocks.parts.shapes import Mesh

if TYPE_CHECKING:
    from trimesh import Trimesh

_MM = 1e3
_IDENTIFIER = re.compile(rb"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}")
# Rotation from the part's axes (z up) to glTF's (y up): x stays, y becomes -z, z becomes y
GLB_FROM_PART = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@cache
def _load_trimesh() -> Any:
    """Load the library of meshes, on first use."""
    with pause_garbage_collector():
        import trimesh
    return trimesh


def _build_trimesh(mesh: Mesh, scale: float) -> "Trimesh":
    """Build a mesh of the library, its lengths in metres times a scale."""
    trimesh = _load_trimesh()
    return trimesh.Trimesh(mesh.vertices * scale, mesh.triangles, process=False, validate=False)


def write_stl(path: Path, mesh: Mesh) -> None:
    """Write binary STL in millimetres, float32."""
    path.write_bytes(_build_trimesh(mesh, _MM).export(file_type="stl"))


def write_obj(path: Path, mesh: Mesh, *, include_normals: bool = False) -> None:
    """Write OBJ in millimetres with 12 decimals, which is a femtometre."""
    text = _build_trimesh(mesh, _MM).export(
        file_type="obj", digits=12, include_normals=include_normals, header=f"{mesh.name}, mm"
    )
    path.write_text(text + "\n", encoding="ascii", newline="\n")


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write binary PLY in millimetres, float32."""
    path.write_bytes(_build_trimesh(mesh, _MM).export(file_type="ply", vertex_normal=False))


def write_3mf(path: Path, mesh: Mesh) -> None:
    """Write 3MF in millimetres, decimal text, its random identifiers replaced by counted ones."""
    exported = _build_trimesh(mesh, _MM).export(file_type="3mf")
    path.write_bytes(pin_archive_times(exported, _replace_identifiers_by_numbers))


def _replace_identifiers_by_numbers(text: bytes) -> bytes:
    """Replace random identifiers by numbers, in the order of their first occurrence."""
    identifiers = dict.fromkeys(_IDENTIFIER.findall(text))
    for number, identifier in enumerate(identifiers, start=1):
        text = text.replace(identifier, b"00000000-0000-4000-8000-%012d" % number)
    return text


def write_glb(path: Path, mesh: Mesh) -> None:
    """Write GLB in metres, y up, float32."""
    x, y, z = mesh.vertices.T + 0.0  # no zero keeps a sign
    turned = Mesh(mesh.name, np.column_stack([x, z, 0.0 - y]), mesh.triangles)
    path.write_bytes(_build_trimesh(turned, 1.0).export(file_type="glb", include_normals=False))


# Every mesh format that is written, by its ending; a new one is tested by standing here
MESH_FORMATS: dict[str, Callable[[Path, Mesh], None]] = {
    ".stl": write_stl,
    ".obj": write_obj,
    ".ply": write_ply,
    ".3mf": write_3mf,
    ".glb": write_glb,
}
if find_spec("lib3mf") is None:  # what cannot be read back is not written
    del MESH_FORMATS[".3mf"]


def write_convex_pieces(path: Path, pieces: Sequence[Mesh]) -> None:
    """Write convex pieces as one OBJ in millimetres, an object per piece."""
    lines = ["# convex pieces, mm"]
    first_vertex = 1
    for piece in pieces:
        lines.append(f"o {piece.name}")
        for x, y, z in piece.vertices * _MM:
            lines.append(f"v {x:.12f} {y:.12f} {z:.12f}")
        for a, b, c in piece.triangles + first_vertex:
            lines.append(f"f {a} {b} {c}")
        first_vertex += len(piece.vertices)
    path.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")
