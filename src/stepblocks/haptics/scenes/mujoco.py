"""MuJoCo: an MJCF scene of convex pieces, and a script that drags the tip and prints the peak beside the formula."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stepblocks.haptics.mesh import Mesh
from stepblocks.haptics.scenes.scene import Scene, SceneFormat, render_template

__all__ = ["MUJOCO"]

_TIME_STEP = 2e-5
_REACH = 3.0  # pieces that come closer to the drag line than this many radii collide


def _write(folder: Path, scene: Scene) -> None:
    root = ElementTree.Element("mujoco", model=scene.stimulus.id)
    ElementTree.SubElement(root, "compiler", angle="radian")
    ElementTree.SubElement(
        root, "option", timestep=f"{_TIME_STEP:g}", cone="elliptic", solver="Newton", impratio="1000", iterations="100",
        tolerance="0", gravity="0 0 0", ccd_tolerance=f"{1e-9 * scene.scale:g}", ccd_iterations="200",
    )  # fmt: skip
    default = ElementTree.SubElement(root, "default")
    ElementTree.SubElement(
        default, "geom", friction=f"{scene.condition.friction:.9g} 0 0", condim="3", margin="0", gap="0",
        solimp=f"0.9999 0.9999 {1e-6 * scene.scale:g} 0.5 2", solref=f"{2.0 * _TIME_STEP:g} 1",
    )  # fmt: skip
    asset = ElementTree.SubElement(root, "asset")
    world = ElementTree.SubElement(root, "worldbody")
    ElementTree.SubElement(world, "light", pos="0 -0.05 0.1", dir="0 0.4 -1")
    for piece in scene.pieces:
        ElementTree.SubElement(asset, "mesh", name=piece.name, vertex=_numbers(piece), inertia="convex")
        ElementTree.SubElement(world, "geom", name=piece.name, type="mesh", mesh=piece.name, rgba="0.7 0.7 0.75 1")
    _tip(world, scene)
    actuator = ElementTree.SubElement(root, "actuator")
    ElementTree.SubElement(actuator, "position", name="spring", joint="x", kp=f"{scene.stiffness:.12g}")
    ElementTree.SubElement(actuator, "motor", name="load", joint="z")
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(folder / "scene.xml", encoding="utf-8", xml_declaration=True)
    (folder / "drag.py").write_text(render_template("mujoco_drag.py"), encoding="utf-8")


def _numbers(piece: Mesh) -> str:
    return " ".join(f"{value:.12g}" for value in piece.vertices.ravel())


def _tip(world: ElementTree.Element, scene: Scene) -> None:
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


MUJOCO = SceneFormat(
    "mujoco", "MuJoCo", "metres", _write,
    "`pip install mujoco`, then `python drag.py` (towards +x) or `python drag.py --down`, from any directory.",
    (
        "convex pieces: one concave mesh would become its convex hull and the step a ramp",
        "elliptic cone, Newton solver, impratio 1000, solimp with a width of 1 um times S, solref of two time steps: "
        "with the defaults the tip falls through",
        "ccd_tolerance 1 nm times S: its default of 1 um is a tenth of a step",
        "the tip's mass and inertia are explicit; mass and spring ring at the event's frequency",
        "the joint's damping spends the tip's own ring; to hear the event of the formula, play `ring-up-48khz.wav` at the release",
    ),
    "run in MuJoCo by the test suite and by the table of docs/simulators.md.",
)  # fmt: skip
