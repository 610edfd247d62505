"""The picture of a stimulus, whole and close up, and its data for the 3-D view."""

import base64
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import manifold3d
import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from stepblocks.parts.kind import Manifold

Polydata: TypeAlias = Any  # a surface of pyvista [mm]
Arrays = tuple[NDArray[np.float64], NDArray[np.int64]]
_COLOURS = ("#d3dbe3", "#efdcae")
_INK = "#1d2a36"


def exaggerate_heights(vertices: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Stretch heights over z = 0 and leave what lies below."""
    result = vertices.copy()
    result[:, 2] = np.where(result[:, 2] > 0.0, result[:, 2] * factor, result[:, 2])
    return result


def draw_part(
    path: Path,
    meshes: Sequence[Arrays],
    exaggeration: float,
    half_width: float,
    centre: tuple[float, float, float],
) -> None:
    """Render a part."""
    if "DISPLAY" not in os.environ:  # without a screen VTK first tries X11 and complains
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

    plotter = pv.Plotter(off_screen=True, shape=(1, 2), window_size=(960, 400), border=False)
    try:
        plotter.subplot(0, 0)
        whole = [
            (exaggerate_heights(vertices, exaggeration), triangles)
            for vertices, triangles in meshes
        ]
        _show(
            plotter,
            _cut_open(whole),
            "whole part"
            if exaggeration == 1.0
            else f"heights over the lower face x {exaggeration:g}",
        )
        plotter.subplot(0, 1)
        _show(
            plotter,
            [_cut_box(mesh, half_width, centre) for mesh in meshes],
            f"true scale, {2e6 * half_width:.4g} µm wide",
        )
        plotter.screenshot(str(path), return_img=False)
    finally:
        plotter.close()


def _make_polydata(vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> Polydata:
    return pv.PolyData.from_regular_faces(vertices * 1e3, triangles)


def _cut_mesh(mesh: Arrays, cut: Callable[[Manifold], Manifold]) -> Polydata:
    # Cut a body in millimetres, closed where it is cut
    vertices, triangles = mesh
    left = cut(
        manifold3d.Manifold(manifold3d.Mesh64(vertices * 1e3, triangles.astype(np.uint64)))
    ).to_mesh64()
    return _make_polydata(
        np.asarray(left.vert_properties)[:, :3] * 1e-3, np.asarray(left.tri_verts).astype(np.int64)
    )


def _cut_box(mesh: Arrays, half_width: float, centre: tuple[float, float, float]) -> Polydata:
    # Cut out what of a body lies in a box
    box = manifold3d.Manifold.cube([2e3 * half_width] * 3, True).translate(
        [1e3 * c for c in centre]
    )
    return _cut_mesh(mesh, lambda solid: solid ^ box)


def _cut_open(meshes: Sequence[Arrays]) -> list[Polydata]:
    # Cut parts of several bodies open, so that what is inside can be seen
    if len(meshes) == 1:
        return [_make_polydata(*meshes[0])]
    return [
        _cut_mesh(mesh, lambda solid: solid.trim_by_plane((0.0, 1.0, 0.0), 0.0)) for mesh in meshes
    ]


def write_view_script(
    path: Path,
    identity: str,
    meshes: Sequence[Arrays],
    exaggeration: float,
    half_width: float,
    centre: tuple[float, float, float],
) -> None:
    """Write the bodies [mm] as a call of the page's function ``stepblocksView``."""
    # Coordinates are float32, a nanometre in 20 mm, and corners uint16 where that is enough, in
    # base64: half the size of digits.

    def pack_values(values: NDArray[np.generic], kind: str) -> str:
        return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")

    bodies = [
        {
            name: pack_values(column * 1e3, "<f4")
            for name, column in zip("xyz", vertices.T, strict=True)
        }
        | {
            name: pack_values(column, f"<u{wide}")
            for name, column in zip("ijk", triangles.T, strict=True)
        }
        | {"bytes_of_a_corner": wide}
        for vertices, triangles in meshes
        for wide in (2 if len(vertices) <= 1 << 16 else 4,)
    ]
    data = {
        "id": identity,
        "unit": "mm",
        "exaggeration": exaggeration,
        "half_width": half_width * 1e3,
        "centre": [value * 1e3 for value in centre],
        "bodies": bodies,
    }
    path.write_text(
        f"stepblocksView({json.dumps(data, separators=(',', ':'), allow_nan=False)});\n",
        encoding="ascii",
        newline="\n",
    )


def _show(plotter: Any, bodies: list[Polydata], caption: str) -> None:
    plotter.set_background("white")
    for index, one in enumerate(bodies):
        if one.n_cells == 0:
            continue
        plotter.add_mesh(
            one,
            color=_COLOURS[index % 2],
            smooth_shading=False,
            ambient=0.35,
            diffuse=0.65,
            specular=0.1,
        )
        edges = one.extract_feature_edges(25.0, boundary_edges=False, manifold_edges=False)
        if edges.n_cells:
            plotter.add_mesh(edges, color=_INK, line_width=1.5)
    plotter.add_text(caption, position=(10, 8), font_size=10, color=_INK)
    plotter.camera_position = "iso"
    plotter.camera.azimuth = -115.0
    plotter.camera.elevation = -12.0
    plotter.enable_parallel_projection()
    plotter.reset_camera()
    extents = sorted(np.ptp(np.reshape(plotter.bounds, (3, 2)), axis=1))
    plotter.camera.zoom(1.2 if extents[-1] < 1.5 * extents[-2] else 1.0)
