"""The part of a stanza in 3-D, and its drawing: made from the draft by a process of its own."""

import base64
import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from nicegui import ui

from stepblocks.compute.processes import run_in_processes
from stepblocks.errors import StepblocksError
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.quantities import format_number
from stepblocks.window import texts
from stepblocks.window.frame import compute_in_background, show_mistake

_WIDTH, _HEIGHT = 560, 360  # of the scene [pixels]
_FAR = 1.7  # distance of the camera, in the length of the part [1]
_COLOURS = ("#9fb3c8", "#d9c48a")  # of the bodies
_SVG_SIZE = re.compile(r'(<svg[^>]*?) width="[^"]*" height="[^"]*"')


@dataclass(frozen=True)
class PartView:
    """What is shown of a part.

    Attributes
    ----------
    bodies : tuple of bytes
        Each body as binary STL [mm].
    exaggeration : float
        Factor by which heights over the lower face are stretched [1].
    centre : tuple of float
        Middle of the part [mm].
    length : float
        Greatest extent [mm].
    drawing : str
        Drawing as SVG.
    """

    bodies: tuple[bytes, ...]
    exaggeration: float
    centre: tuple[float, float, float]
    length: float
    drawing: str


def make_part_view(part: Part, order: OrderSpec) -> PartView:
    """Build the solids of a part with the CAD kernel, mesh them, and draw the part.

    It takes seconds and much memory, for which the server of the window is no place.
    """
    from stepblocks.artefacts.meshes.write import write_stl
    from stepblocks.build.picture import exaggerate_heights
    from stepblocks.parts.shapes import Mesh, build_solids, mesh_solid
    from stepblocks.workshop.drawing import write_drawing

    exaggeration = part.choose_close_up().exaggeration
    bodies = []
    corners = []
    with tempfile.TemporaryDirectory(prefix="stepblocks-window-") as name:
        scratch = Path(name)
        for number, (body_name, body) in enumerate(build_solids(part)):
            mesh = mesh_solid(part, body_name, body)
            stretched = exaggerate_heights(mesh.vertices, exaggeration)
            target = scratch / f"{number}.stl"
            write_stl(target, Mesh(body_name, stretched, mesh.triangles))
            bodies.append(target.read_bytes())
            corners += [stretched.min(axis=0), stretched.max(axis=0)]
        (drawing,) = write_drawing(scratch, part, ("svg",), order)
        text = drawing.read_text(encoding="utf-8")
    low, high = 1e3 * np.min(corners, axis=0), 1e3 * np.max(corners, axis=0)
    x, y, z = (0.5 * (low + high)).tolist()
    return PartView(tuple(bodies), exaggeration, (x, y, z), float(np.max(high - low)), text)


def make_part_view_in_worker(part: Part, order: OrderSpec) -> PartView:
    """Make the view of a part in a process of its own."""
    (view,) = run_in_processes(make_part_view, [(part, order)], 1)
    return view


async def show_solid_and_drawing(
    part: Part, order: OrderSpec, container: ui.element, is_wanted: Callable[[], bool]
) -> None:
    """Show a part in 3-D with its drawing, or why the kernel cannot build it.

    `is_wanted` tells, once it is made, whether it is to be shown still.
    """
    try:
        view = await compute_in_background(container, make_part_view_in_worker, part, order)
    except StepblocksError as error:
        if is_wanted():
            container.clear()
            with container:
                show_mistake(error)
        return
    if view is None or not is_wanted():  # the window is being closed, or the part was changed
        return
    container.clear()
    with container:
        _show_scene(part, view)
        drawing = _encode_as_address(_remove_fixed_size(view.drawing).encode(), "image/svg+xml")
        image = ui.image(drawing).classes("w-full bg-white").mark("drawing")
        image.props(f'alt="{texts.DRAWING_OF.format(part=part.id)}"')


def _show_scene(part: Part, view: PartView) -> None:
    """Show the bodies of a part, which can be turned with the mouse."""
    far = _FAR * view.length
    camera = ui.scene.perspective_camera(fov=40, near=0.01 * far, far=100.0 * far)
    scene = ui.scene(_WIDTH, _HEIGHT, grid=False, camera=camera, background_color="#ffffff")
    scene.props(f'role=img aria-label="{texts.SOLID_OF.format(part=part.id)}"').mark("solid")
    with scene:
        for number, body in enumerate(view.bodies):
            shape = scene.stl(_encode_as_address(body, "model/stl"))
            shape.material(_COLOURS[number % len(_COLOURS)], side="both")
    x, y, z = view.centre
    scene.move_camera(
        x - 0.6 * far, y - 0.9 * far, z + 0.6 * far, look_at_x=x, look_at_y=y, look_at_z=z
    )
    text = texts.TRUE_SCALE
    if view.exaggeration != 1.0:
        text = texts.STRETCHED.format(factor=format_number(view.exaggeration))
    ui.label(text)


def _remove_fixed_size(svg: str) -> str:
    """Return an SVG without its size in its head, so that it fills the width of the page."""
    return _SVG_SIZE.sub(r"\1", svg, count=1)


def _encode_as_address(content: bytes, kind: str) -> str:
    """Return bytes of a media type as a data URL."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
