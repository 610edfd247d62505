"""URDF and SDFormat: the part as one link of convex pieces; for Drake, Gazebo, PyBullet and MuJoCo."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stepblocks.artefacts.meshes.write import write_obj
from stepblocks.parts.mesh import Mesh
from stepblocks.simulators.scenes.scene import Scene, SceneFormat


def _write(folder: Path, scene: Scene) -> None:
    shapes = [("block", scene.pieces)] + ([("probe", scene.probe.pieces)] if scene.probe else [])
    for name, pieces in shapes:
        for piece in pieces:
            write_obj(folder / f"{piece.name}.obj", piece)
        _save(_urdf(name, pieces), folder / f"{name}.urdf")
        _save(_sdf(name, pieces, scene), folder / f"{name}.sdf")


def _urdf(name: str, pieces: tuple[Mesh, ...]) -> ElementTree.Element:
    root = ElementTree.Element("robot", name=name)
    root.append(ElementTree.Comment(" drake:declare_convex keeps Drake from shrink-wrapping what already is convex "))
    root.set("xmlns:drake", "http://drake.mit.edu")
    link = ElementTree.SubElement(root, "link", name=name)
    for kind in ("visual", "collision"):
        for piece in pieces:
            element = ElementTree.SubElement(link, kind, name=f"{kind}-{piece.name}")
            geometry = ElementTree.SubElement(element, "geometry")
            mesh = ElementTree.SubElement(geometry, "mesh", filename=f"{piece.name}.obj", scale="0.001 0.001 0.001")
            if kind == "collision":
                ElementTree.SubElement(mesh, "drake:declare_convex")
    return root


def _sdf(name: str, pieces: tuple[Mesh, ...], scene: Scene) -> ElementTree.Element:
    root = ElementTree.Element("sdf", version="1.9")
    model = ElementTree.SubElement(root, "model", name=name)
    ElementTree.SubElement(model, "static").text = "true"
    link = ElementTree.SubElement(model, "link", name=name)
    friction = f"{scene.condition.friction:.9g}"
    for kind in ("visual", "collision"):
        for piece in pieces:
            element = ElementTree.SubElement(link, kind, name=f"{kind}-{piece.name}")
            geometry = ElementTree.SubElement(element, "geometry")
            mesh = ElementTree.SubElement(geometry, "mesh")
            ElementTree.SubElement(mesh, "uri").text = f"{piece.name}.obj"
            ElementTree.SubElement(mesh, "scale").text = "0.001 0.001 0.001"
            if kind == "collision":
                surface = ElementTree.SubElement(element, "surface")
                ode = ElementTree.SubElement(ElementTree.SubElement(surface, "friction"), "ode")
                ElementTree.SubElement(ode, "mu").text = friction
                ElementTree.SubElement(ode, "mu2").text = friction
                contact = ElementTree.SubElement(ElementTree.SubElement(surface, "contact"), "ode")
                ElementTree.SubElement(contact, "min_depth").text = "0"
    return root


def _save(root: ElementTree.Element, path: Path) -> None:
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


URDF = SceneFormat(
    "urdf",
    "URDF and SDFormat",
    "metres, its OBJ files in millimetres with scale 0.001",
    _write,
    "Load `block.urdf` or `block.sdf` with the simulator's importer; spring and event are in `event.json`: neither format has "
    "a place for them.",
    (
        "one collision element per convex piece: importers replace a concave mesh by its convex hull",
        "SDFormat carries the friction; with URDF set it in the simulator",
        "set contact margin (below 1 um times S) and time step in the simulator as the `mujoco` scene does",
    ),
    "URDF loaded by MuJoCo's importer in the test suite; both run in Drake for the table of docs/simulators.md.",
)
