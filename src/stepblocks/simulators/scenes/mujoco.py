"""MuJoCo: an MJCF scene of convex pieces, one with a height field, and a script that drags the tip over either."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from stepblocks.artefacts.heightfield import relief
from stepblocks.parts.shapes import Mesh
from stepblocks.simulators.scene import Scene, SceneFormat, element, fill, numbers, write_xml

_TIME_STEP = 2e-5
_REACH = 10.0  # pieces that come closer to the drag line than this many radii of the ball collide, the others are seen
_SEEN_ONLY = {"contype": "0", "conaffinity": "0"}
_BASE = 100e-6  # thickness under a height field, unscaled [m]


def _write(folder: Path, scene: Scene) -> None:
    bodies = [
        _shape(piece, rgba="0.7 0.7 0.75 1", **({} if _near(piece, scene) else _SEEN_ONLY)) for piece in scene.pieces
    ]
    write_xml(folder / "scene.xml", _document(scene, [_mesh(piece) for piece in scene.pieces], bodies))
    field, surface = _height_field(folder / "heightfield.bin", scene)
    write_xml(folder / "scene-heightfield.xml", _document(scene, [field], [surface]))
    fill(folder / "drag.py")


def _document(
    scene: Scene, assets: list[ElementTree.Element], bodies: list[ElementTree.Element]
) -> ElementTree.Element:
    option = element(
        "option",
        timestep=f"{_TIME_STEP:g}",
        cone="elliptic",
        solver="Newton",
        impratio="1000",
        iterations="100",
        tolerance="0",
        gravity="0 0 0",
        ccd_tolerance=f"{1e-9 * scene.scale:g}",
        ccd_iterations="200",
    )
    contact = element(
        "geom",
        friction=f"{scene.point.friction:.9g} 0 0",
        condim="3",
        margin="0",
        gap="0",
        solimp=f"0.9999 0.9999 {1e-6 * scene.scale:g} 0.5 2",
        solref=f"{2.0 * _TIME_STEP:g} 1",
    )
    light = element("light", pos="0 -0.05 0.1", dir="0 0.4 -1")
    spring = element("position", name="spring", joint="x", kp=f"{scene.stiffness:.12g}")
    shape = scene.probe.pieces if scene.probe else ()
    return element(
        "mujoco",
        element("compiler", angle="radian"),
        option,
        element("default", contact),
        element("asset", *assets, *(_mesh(piece) for piece in shape)),
        element("worldbody", light, *bodies, _tip(scene, shape)),
        element("actuator", spring, element("motor", name="load", joint="z")),
        model=scene.stimulus.id,
    )


def _mesh(piece: Mesh) -> ElementTree.Element:
    return element("mesh", name=piece.name, vertex=numbers(piece.vertices), inertia="convex")


def _shape(piece: Mesh, **attributes: str) -> ElementTree.Element:
    return element("geom", name=piece.name, type="mesh", mesh=piece.name, **attributes)


def _near(piece: Mesh, scene: Scene) -> bool:
    """Whether a piece's bounding box comes close to the line that the ball is dragged along."""
    reach, (low, high) = _REACH * scene.ball_radius, (piece.vertices.min(axis=0), piece.vertices.max(axis=0))
    return bool(low[1] < reach and high[1] > -reach and high[2] > -reach and low[2] < reach)


def _tip(scene: Scene, shape: Sequence[Mesh]) -> ElementTree.Element:
    """Hang a ball on two slides; its mass is explicit, or the density of a 125 um ball would make it a nanogram."""
    R, mass = scene.ball_radius, scene.tip_mass
    inertia = " ".join([f"{0.4 * mass * R * R:.6g}"] * 3)
    return element(
        "body",
        element("joint", name="x", type="slide", axis="1 0 0", damping=f"{0.5 / scene.scale:g}"),
        element("joint", name="z", type="slide", axis="0 0 1"),
        element("inertial", pos="0 0 0", mass=f"{mass:.9g}", diaginertia=inertia),
        element("geom", name="ball", type="sphere", size=f"{R:.12g}", rgba="0.8 0.5 0.1 1"),
        *(_shape(piece, **_SEEN_ONLY, rgba="0.8 0.8 0.85 1") for piece in shape),
        name="tip",
        pos=f"0 0 {R:.12g}",
    )


def _height_field(path: Path, scene: Scene) -> tuple[ElementTree.Element, ElementTree.Element]:
    """Write the binary that MuJoCo reads: rows and columns as int32, then float32 from 0 to 1, row 0 at the smallest y."""
    field = relief(scene.surface, scene.point.ball_radius)
    low, rise = float(field.heights.min()), float(np.ptp(field.heights))
    values = ((field.heights - low) / (rise or 1.0)).astype("<f4")
    path.write_bytes(struct.pack("<2i", *values.shape) + values.tobytes())
    half_x, half_y = 0.5 * float(np.ptp(field.x)), 0.5 * float(np.ptp(field.y))
    size = np.array([half_x, half_y, rise or 1e-9, _BASE]) * scene.scale
    centre = np.array([field.x.mean(), field.y.mean(), low]) * scene.scale
    asset = element("hfield", name="surface", file=path.name, size=numbers(size))
    return asset, element("geom", name="surface", type="hfield", hfield="surface", pos=numbers(centre))


MUJOCO = SceneFormat(
    name="mujoco",
    title="MuJoCo",
    unit="metres",
    write=_write,
    run=(
        "`pip install mujoco`, then `python drag.py` (towards +x) or `python drag.py --down`, from any directory; "
        "`--heightfield` drags over `scene-heightfield.xml` instead of the convex pieces of `scene.xml`."
    ),
    settings=(
        "convex pieces: one concave mesh would become its convex hull and the step a ramp",
        "elliptic cone, Newton solver, impratio 1000, solimp with a width of 1 um times S, solref of two time steps: "
        "with the defaults the tip falls through",
        "ccd_tolerance 1 nm times S: its default of 1 um is a tenth of a step",
        "the tip's mass and inertia are explicit; mass and spring ring at the event's frequency",
        "the joint's damping spends the tip's own ring; to hear the event of the formula, play `ring-up-48khz.wav` at the release",
        "`heightfield.bin` is MuJoCo's own binary in float32; its PNG path has 8 bits, which are coarser than a step",
    ),
    verified="run in MuJoCo by the test suite and by the table of docs/simulators.md, pieces and height field.",
)
