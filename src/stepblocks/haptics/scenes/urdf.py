"""URDF: the block as one link of convex pieces; for PyBullet, Drake, Gazebo and MuJoCo."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stepblocks.haptics.formats import write_stl
from stepblocks.haptics.scenes.scene import Scene, SceneFormat

__all__ = ["URDF"]


def _write(folder: Path, scene: Scene) -> None:
    root = ElementTree.Element("robot", name=scene.stimulus.id)
    link = ElementTree.SubElement(root, "link", name="block")
    for kind in ("visual", "collision"):
        for piece in scene.pieces:
            element = ElementTree.SubElement(link, kind, name=f"{kind}-{piece.name}")
            geometry = ElementTree.SubElement(element, "geometry")
            ElementTree.SubElement(geometry, "mesh", filename=f"{piece.name}.stl", scale="0.001 0.001 0.001")
    for piece in scene.pieces:
        write_stl(folder / f"{piece.name}.stl", piece)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(folder / "block.urdf", encoding="utf-8", xml_declaration=True)


URDF = SceneFormat(
    "urdf", "URDF", "metres, its STL files in millimetres with scale 0.001", _write,
    "Load `block.urdf` with the simulator's URDF importer; contact, spring and event are in `event.json`, URDF has no place for them.",
    (
        "one collision element per convex piece: importers replace a concave mesh by its convex hull",
        "set friction, contact margin (below 1 um times S) and time step in the simulator as the `mujoco` scene does",
    ),
    "loaded by MuJoCo's URDF importer in the test suite; not run here elsewhere.",
)  # fmt: skip
