"""X3D for H3D: the block in metres with H3D's frictional surface."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stepblocks.parts.mesh import Mesh
from stepblocks.simulators.scenes.scene import Scene, SceneFormat


def _write(folder: Path, scene: Scene) -> None:
    _document(folder / "scene.x3d", scene, scene.whole, f"{scene.surface.id}, magnified {scene.scale:g} times")
    if scene.probe:
        _document(
            folder / "probe.x3d", scene, scene.probe.whole, f"{scene.stimulus.id}, magnified {scene.scale:g} times"
        )


def _document(path: Path, scene: Scene, mesh: Mesh, title: str) -> None:
    root = ElementTree.Element("X3D", profile="Immersive", version="3.3")
    head = ElementTree.SubElement(root, "head")
    ElementTree.SubElement(head, "meta", name="title", content=title)
    ElementTree.SubElement(head, "meta", name="unit", content="metre")
    body = ElementTree.SubElement(root, "Scene")
    ElementTree.SubElement(body, "NavigationInfo", type='"EXAMINE"')
    extent = float(abs(mesh.vertices).max())
    ElementTree.SubElement(
        body, "Viewpoint", position=f"0 {-4.0 * extent:.6g} {2.0 * extent:.6g}", orientation="1 0 0 1.1"
    )
    shape = ElementTree.SubElement(body, "Shape", DEF="block")
    appearance = ElementTree.SubElement(shape, "Appearance")
    ElementTree.SubElement(appearance, "Material", diffuseColor="0.7 0.7 0.75")
    # H3D's stiffness is relative to what the device can render unless useRelativeValues is off
    friction = f"{scene.condition.friction:.9g}"
    ElementTree.SubElement(
        appearance,
        "FrictionalSurface",
        stiffness=f"{scene.stiffness:.9g}",
        useRelativeValues="false",
        staticFriction=friction,
        dynamicFriction=friction,
    )
    faces = ElementTree.SubElement(
        shape,
        "IndexedTriangleSet",
        solid="true",
        ccw="true",
        normalPerVertex="false",
        index=" ".join(str(index) for index in mesh.triangles.ravel()),
    )
    points = " ".join(f"{value:.12g}" for value in mesh.vertices.ravel())
    ElementTree.SubElement(faces, "Coordinate", point=points)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


X3D = SceneFormat(
    "x3d",
    "X3D (H3D)",
    "metres",
    _write,
    "`H3DLoad scene.x3d`; a declared tip is `probe.x3d`, for the stylus of `DeviceInfo`; other X3D viewers show the block and "
    "ignore the haptic surface.",
    (
        "FrictionalSurface with absolute stiffness k/S and the static and dynamic friction of the condition",
        "coordinates are decimal text with 12 digits, counter-clockwise seen from outside",
        "the proxy radius is the haptics device's in H3D (`DeviceInfo`, `proxyRadius`): set it to the ball's",
    ),
    "parsed by lxml and measured as a mesh by trimesh in the test suite; not run here in H3D.",
)
