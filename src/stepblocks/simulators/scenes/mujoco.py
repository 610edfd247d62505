"""MuJoCo: an MJCF scene of convex pieces, one with a height field, and a script that drags the tip over either."""

from __future__ import annotations

import struct
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from stepblocks.artefacts.heightfield import relief
from stepblocks.parts.mesh import Mesh
from stepblocks.simulators.scenes.scene import Scene, SceneFormat, render_template

_TIME_STEP = 2e-5
_REACH = 10.0  # pieces that come closer to the drag line than this many radii of the ball collide, the others are seen
_BASE = 100e-6  # thickness under a height field, unscaled [m]


def _write(folder: Path, scene: Scene) -> None:
    root, asset, world = _stage(scene)
    for piece in scene.pieces:
        ElementTree.SubElement(asset, "mesh", name=piece.name, vertex=_numbers(piece), inertia="convex")
        geom = ElementTree.SubElement(
            world, "geom", name=piece.name, type="mesh", mesh=piece.name, rgba="0.7 0.7 0.75 1"
        )
        if not _near(piece, scene):
            geom.attrib |= {"contype": "0", "conaffinity": "0"}
    _finish(root, asset, world, scene, folder / "scene.xml")
    root, asset, world = _stage(scene)
    _height_field(folder, scene, asset, world)
    _finish(root, asset, world, scene, folder / "scene-heightfield.xml")
    (folder / "drag.py").write_text(render_template("mujoco_drag.py"), encoding="utf-8")


def _stage(scene: Scene) -> tuple[ElementTree.Element, ElementTree.Element, ElementTree.Element]:
    root = ElementTree.Element("mujoco", model=scene.stimulus.id)
    ElementTree.SubElement(root, "compiler", angle="radian")
    ElementTree.SubElement(
        root,
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
    default = ElementTree.SubElement(root, "default")
    ElementTree.SubElement(
        default,
        "geom",
        friction=f"{scene.condition.friction:.9g} 0 0",
        condim="3",
        margin="0",
        gap="0",
        solimp=f"0.9999 0.9999 {1e-6 * scene.scale:g} 0.5 2",
        solref=f"{2.0 * _TIME_STEP:g} 1",
    )
    asset = ElementTree.SubElement(root, "asset")
    world = ElementTree.SubElement(root, "worldbody")
    ElementTree.SubElement(world, "light", pos="0 -0.05 0.1", dir="0 0.4 -1")
    return root, asset, world


def _finish(
    root: ElementTree.Element, asset: ElementTree.Element, world: ElementTree.Element, scene: Scene, path: Path
) -> None:
    _tip(world, asset, scene)
    actuator = ElementTree.SubElement(root, "actuator")
    ElementTree.SubElement(actuator, "position", name="spring", joint="x", kp=f"{scene.stiffness:.12g}")
    ElementTree.SubElement(actuator, "motor", name="load", joint="z")
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _numbers(piece: Mesh) -> str:
    return " ".join(f"{value:.12g}" for value in piece.vertices.ravel())


def _near(piece: Mesh, scene: Scene) -> bool:
    """Whether a piece's bounding box comes close to the line that the ball is dragged along."""
    reach, (low, high) = _REACH * scene.ball_radius, (piece.vertices.min(axis=0), piece.vertices.max(axis=0))
    return bool(low[1] < reach and high[1] > -reach and high[2] > -reach and low[2] < reach)


def _height_field(folder: Path, scene: Scene, asset: ElementTree.Element, world: ElementTree.Element) -> None:
    """Write the binary that MuJoCo reads: rows and columns as int32, then float32 from 0 to 1, row 0 at the smallest y."""
    field = relief(scene.surface, scene.condition.ball_radius)
    low, rise = float(field.heights.min()), float(np.ptp(field.heights))
    values = ((field.heights - low) / (rise or 1.0)).astype("<f4")
    (folder / "heightfield.bin").write_bytes(struct.pack("<2i", *values.shape) + values.tobytes())
    half_x, half_y = 0.5 * float(np.ptp(field.x)), 0.5 * float(np.ptp(field.y))
    size = np.array([half_x, half_y, rise or 1e-9, _BASE]) * scene.scale
    centre = np.array([field.x.mean(), field.y.mean(), low]) * scene.scale
    ElementTree.SubElement(
        asset, "hfield", name="surface", file="heightfield.bin", size=" ".join(f"{v:.12g}" for v in size)
    )
    ElementTree.SubElement(
        world, "geom", name="surface", type="hfield", hfield="surface", pos=" ".join(f"{v:.12g}" for v in centre)
    )


def read_hfield(path: Path) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """Read MuJoCo's height-field binary."""
    raw = path.read_bytes()
    rows, columns = struct.unpack_from("<2i", raw)
    return np.frombuffer(raw, "<f4", offset=8).reshape(rows, columns)


def _tip(world: ElementTree.Element, asset: ElementTree.Element, scene: Scene) -> None:
    """Hang a ball on two slides; its mass is explicit, or the density of a 125 um ball would make it a nanogram."""
    R = scene.ball_radius
    body = ElementTree.SubElement(world, "body", name="tip", pos=f"0 0 {R:.12g}")
    ElementTree.SubElement(body, "joint", name="x", type="slide", axis="1 0 0", damping=f"{0.5 / scene.scale:g}")
    ElementTree.SubElement(body, "joint", name="z", type="slide", axis="0 0 1")
    inertia = f"{0.4 * scene.tip_mass * R * R:.6g}"
    ElementTree.SubElement(
        body, "inertial", pos="0 0 0", mass=f"{scene.tip_mass:.9g}", diaginertia=" ".join([inertia] * 3)
    )
    ElementTree.SubElement(body, "geom", name="ball", type="sphere", size=f"{R:.12g}", rgba="0.8 0.5 0.1 1")
    for piece in scene.probe.pieces if scene.probe else ():
        ElementTree.SubElement(asset, "mesh", name=piece.name, vertex=_numbers(piece), inertia="convex")
        ElementTree.SubElement(
            body,
            "geom",
            name=piece.name,
            type="mesh",
            mesh=piece.name,
            contype="0",
            conaffinity="0",
            rgba="0.8 0.8 0.85 1",
        )


MUJOCO = SceneFormat(
    "mujoco",
    "MuJoCo",
    "metres",
    _write,
    "`pip install mujoco`, then `python drag.py` (towards +x) or `python drag.py --down`, from any directory; `--heightfield` drags "
    "over `scene-heightfield.xml` instead of the convex pieces of `scene.xml`.",
    (
        "convex pieces: one concave mesh would become its convex hull and the step a ramp",
        "elliptic cone, Newton solver, impratio 1000, solimp with a width of 1 um times S, solref of two time steps: "
        "with the defaults the tip falls through",
        "ccd_tolerance 1 nm times S: its default of 1 um is a tenth of a step",
        "the tip's mass and inertia are explicit; mass and spring ring at the event's frequency",
        "the joint's damping spends the tip's own ring; to hear the event of the formula, play `ring-up-48khz.wav` at the release",
        "`heightfield.bin` is MuJoCo's own binary in float32; its PNG path has 8 bits, which are coarser than a step",
    ),
    "run in MuJoCo by the test suite and by the table of docs/simulators.md, pieces and height field.",
)
