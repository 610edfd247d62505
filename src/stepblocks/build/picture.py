"""The picture of a stimulus, whole and close up, and its data for the 3-D view."""

import base64
import json
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import manifold3d
import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from stepblocks.parts.kind import Manifold

Polydata: TypeAlias = Any  # a surface of pyvista [mm]
Vertices = NDArray[np.float64]
# A body: points [m], shape (n, 3), and corners of its triangles, shape (m, 3)
Arrays = tuple[Vertices, NDArray[np.int64]]
Point = tuple[float, float, float]

_COLOURS = ("#d3dbe3", "#efdcae")
_INK = "#1d2a36"
_WINDOW = (960, 400)  # pixels
_SHARP = 25.0  # least angle between faces whose edge is drawn [deg]
_LONG = 1.5  # a part longer than that many of its widths fills the window as it is
_MOST_SHORT_CORNERS = 1 << 16  # points that two bytes can number


def exaggerate_heights(vertices: Vertices, factor: float) -> Vertices:
    """Stretch heights over z = 0 and leave what lies below."""
    stretched = vertices.copy()
    z = stretched[:, 2]
    stretched[:, 2] = np.where(z > 0.0, z * factor, z)
    return stretched


def render_part_picture(
    path: Path,
    meshes: Sequence[Arrays],
    exaggeration: float,
    half_width: float,
    centre: Point,
) -> None:
    """Render a part, whole on the left and close up on the right.

    Parameters
    ----------
    path : Path
        The PNG.
    meshes : sequence of (vertices, triangles)
        Its bodies [m].
    exaggeration : float
        Factor of the heights over z = 0 on the left [1].
    half_width : float
        Half of the width of the close-up [m].
    centre : tuple of float
        Middle of the close-up [m].
    """
    if "DISPLAY" not in os.environ:  # without a screen VTK first tries X11 and complains
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

    stretched = []
    for vertices, triangles in meshes:
        stretched.append((exaggerate_heights(vertices, exaggeration), triangles))
    caption = f"heights over the lower face x {exaggeration:g}"
    if exaggeration == 1.0:
        caption = "whole part"
    plotter = _open_plotter(os.getpid(), threading.get_ident())
    plotter.suppress_rendering = True  # until everything is there
    for renderer in plotter.renderers:
        renderer.clear_actors()
    plotter.subplot(0, 0)
    _add_bodies_to_plotter(plotter, _cut_open_bodies(stretched), caption)
    plotter.subplot(0, 1)
    window = [_crop_to_cube(mesh, half_width, centre) for mesh in meshes]
    _add_bodies_to_plotter(plotter, window, f"true scale, {2e6 * half_width:.4g} µm wide")
    plotter.suppress_rendering = False
    plotter.render()
    plotter.screenshot(str(path), return_img=False)


@cache
def _open_plotter(_process: int, _thread: int) -> Any:
    """Open the window for all pictures of a thread: a new one takes as long as to draw in it.

    A window belongs to the thread that made it, and is lost in a fork of its process.
    """
    return pv.Plotter(off_screen=True, shape=(1, 2), window_size=_WINDOW, border=False)


def _make_polydata(vertices: Vertices, triangles: NDArray[np.int64]) -> Polydata:
    """Make a surface [mm] of vertices [m]."""
    return pv.PolyData.from_regular_faces(vertices * 1e3, triangles)


def _cut_solid(mesh: Arrays, cut: Callable[[Manifold], Manifold]) -> Polydata:
    """Cut a body as a solid in millimetres, so that it is closed where it is cut."""
    vertices, triangles = mesh
    solid = manifold3d.Manifold(manifold3d.Mesh64(vertices * 1e3, triangles.astype(np.uint64)))
    remainder = cut(solid).to_mesh64()
    points = np.asarray(remainder.vert_properties)[:, :3] * 1e-3
    return _make_polydata(points, np.asarray(remainder.tri_verts).astype(np.int64))


def _crop_to_cube(mesh: Arrays, half_width: float, centre: Point) -> Polydata:
    """Cut away what lies outside a cube of twice the half-width about a centre [m]."""
    side = 2e3 * half_width
    middle = [1e3 * coordinate for coordinate in centre]
    cube = manifold3d.Manifold.cube([side, side, side], True).translate(middle)
    return _cut_solid(mesh, lambda solid: solid ^ cube)


def _cut_open_bodies(meshes: Sequence[Arrays]) -> list[Polydata]:
    """Cut each of several bodies in half, so that the inside can be seen; leave one body whole."""
    if len(meshes) == 1:
        vertices, triangles = meshes[0]
        return [_make_polydata(vertices, triangles)]
    return [_cut_solid(mesh, _cut_in_half) for mesh in meshes]


def _cut_in_half(solid: Manifold) -> Manifold:
    """Keep the half of a solid at y > 0."""
    return solid.trim_by_plane((0.0, 1.0, 0.0), 0.0)


def _add_bodies_to_plotter(plotter: Any, bodies: Sequence[Polydata], caption: str) -> None:
    """Draw bodies with their sharp edges and a caption in the current half of the window."""
    plotter.set_background("white")
    for index, body in enumerate(bodies):
        if body.n_cells == 0:
            continue
        plotter.add_mesh(
            body,
            color=_COLOURS[index % len(_COLOURS)],
            smooth_shading=False,
            ambient=0.35,
            diffuse=0.65,
            specular=0.1,
        )
        edges = body.extract_feature_edges(_SHARP, boundary_edges=False, manifold_edges=False)
        if edges.n_cells:
            plotter.add_mesh(edges, color=_INK, line_width=1.5)
    plotter.add_text(caption, position=(10, 8), font_size=10, color=_INK)
    plotter.camera_position = "iso"
    plotter.camera.azimuth = -115.0
    plotter.camera.elevation = -12.0
    plotter.enable_parallel_projection()
    plotter.reset_camera()
    _, width, length = sorted(np.ptp(np.reshape(plotter.bounds, (3, 2)), axis=1))
    plotter.camera.zoom(1.2 if length < _LONG * width else 1.0)


@dataclass(frozen=True)
class _ViewedBody:
    """A body of the 3-D view: coordinates [mm] as float32, corners as uint16 or uint32, in base64.

    float32 is a nanometre in 20 mm; base64 takes half the size of digits.
    """

    x: str
    y: str
    z: str
    i: str
    j: str
    k: str
    bytes_of_a_corner: int


@dataclass(frozen=True)
class _View:
    """What the page's function ``stepblocksView`` is called with; lengths in millimetres."""

    id: str
    unit: str
    exaggeration: float
    half_width: float
    centre: list[float]
    bodies: list[_ViewedBody]


def write_view_call(
    path: Path,
    part_id: str,
    meshes: Sequence[Arrays],
    exaggeration: float,
    half_width: float,
    centre: Point,
) -> None:
    """Write the bodies of a part as JavaScript that calls ``stepblocksView`` of the page.

    The other parameters are those of `render_part_picture`, lengths in metres; the page gets
    millimetres.
    """
    view = _View(
        id=part_id,
        unit="mm",
        exaggeration=exaggeration,
        half_width=half_width * 1e3,
        centre=[coordinate * 1e3 for coordinate in centre],
        bodies=[_pack_body(vertices, triangles) for vertices, triangles in meshes],
    )
    data = json.dumps(asdict(view), separators=(",", ":"), allow_nan=False)
    path.write_text(f"stepblocksView({data});\n", encoding="ascii", newline="\n")


def _pack_body(vertices: Vertices, triangles: NDArray[np.int64]) -> _ViewedBody:
    """Pack vertices [mm] and triangles for the viewer, in the shortest integers that fit."""
    corner_bytes = 2 if len(vertices) <= _MOST_SHORT_CORNERS else 4
    x, y, z = (_encode_in_base64(column * 1e3, "<f4") for column in vertices.T)
    i, j, k = (_encode_in_base64(column, f"<u{corner_bytes}") for column in triangles.T)
    return _ViewedBody(x, y, z, i, j, k, corner_bytes)


def _encode_in_base64(values: NDArray[Any], dtype: str) -> str:
    """Write values of a type, such as ``<f4``, in base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=dtype).tobytes()).decode("ascii")
