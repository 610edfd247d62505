"""URDF and SDFormat: the part as one link of convex pieces; for Drake, Gazebo, PyBullet and MuJoCo."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stepblocks.artefacts.meshes.write import write_obj
from stepblocks.parts.shapes import Mesh
from stepblocks.simulators.scene import Scene, SceneFormat, element, write_xml

_KINDS = ("visual", "collision")
_SCALE = "0.001 0.001 0.001"  # the OBJ files are in millimetres


def _write(folder: Path, scene: Scene) -> None:
    shapes = {"block": scene.pieces} | ({"probe": scene.probe.pieces} if scene.probe else {})
    for name, pieces in shapes.items():
        for piece in pieces:
            write_obj(folder / f"{piece.name}.obj", piece)
        write_xml(folder / f"{name}.urdf", _urdf(name, pieces))
        write_xml(folder / f"{name}.sdf", _sdf(name, pieces, f"{scene.point.friction:.9g}"))


def _urdf(name: str, pieces: tuple[Mesh, ...]) -> ElementTree.Element:
    def shape(kind: str, piece: Mesh) -> ElementTree.Element:
        declared = [element("drake:declare_convex")] if kind == "collision" else []
        mesh = element("mesh", *declared, filename=f"{piece.name}.obj", scale=_SCALE)
        return element(kind, element("geometry", mesh), name=f"{kind}-{piece.name}")

    note = ElementTree.Comment(" drake:declare_convex keeps Drake from shrink-wrapping what already is convex ")
    link = element("link", *(shape(kind, piece) for kind in _KINDS for piece in pieces), name=name)
    return element("robot", note, link, name=name, **{"xmlns:drake": "http://drake.mit.edu"})


def _sdf(name: str, pieces: tuple[Mesh, ...], friction: str) -> ElementTree.Element:
    def shape(kind: str, piece: Mesh) -> ElementTree.Element:
        mesh = element("mesh", _text("uri", f"{piece.name}.obj"), _text("scale", _SCALE))
        made = element(kind, element("geometry", mesh), name=f"{kind}-{piece.name}")
        if kind == "collision":
            cone = element("friction", element("ode", _text("mu", friction), _text("mu2", friction)))
            made.append(element("surface", cone, element("contact", element("ode", _text("min_depth", "0")))))
        return made

    link = element("link", *(shape(kind, piece) for kind in _KINDS for piece in pieces), name=name)
    return element("sdf", element("model", _text("static", "true"), link, name=name), version="1.9")


def _text(tag: str, text: str) -> ElementTree.Element:
    made = element(tag)
    made.text = text
    return made


URDF = SceneFormat(
    name="urdf",
    title="URDF and SDFormat",
    unit="metres, its OBJ files in millimetres with scale 0.001",
    write=_write,
    run=(
        "Load `block.urdf` or `block.sdf` with the simulator's importer; spring and event are in `event.json`: neither format has "
        "a place for them."
    ),
    settings=(
        "one collision element per convex piece: importers replace a concave mesh by its convex hull",
        "SDFormat carries the friction; with URDF set it in the simulator",
        "set contact margin (below 1 um times S) and time step in the simulator as the `mujoco` scene does",
    ),
    verified="URDF loaded by MuJoCo's importer in the test suite; both run in Drake for the table of docs/simulators.md.",
)
