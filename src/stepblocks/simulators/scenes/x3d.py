"""X3D for H3D: the block in metres with H3D's frictional surface."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stepblocks.parts.shapes import Mesh
from stepblocks.simulators.scene import Scene, SceneFormat, element, numbers, write_xml


def _write(folder: Path, scene: Scene) -> None:
    magnified = f"magnified {scene.scale:g} times"
    write_xml(folder / "scene.x3d", _document(scene, scene.whole, f"{scene.surface.id}, {magnified}"))
    if scene.probe:
        write_xml(folder / "probe.x3d", _document(scene, scene.probe.whole, f"{scene.stimulus.id}, {magnified}"))


def _document(scene: Scene, mesh: Mesh, title: str) -> ElementTree.Element:
    extent, friction = float(abs(mesh.vertices).max()), f"{scene.point.friction:.9g}"
    surface = element(
        "FrictionalSurface",
        stiffness=f"{scene.stiffness:.9g}",
        useRelativeValues="false",  # else H3D's stiffness is relative to what the device can render
        staticFriction=friction,
        dynamicFriction=friction,
    )
    faces = element(
        "IndexedTriangleSet",
        element("Coordinate", point=numbers(mesh.vertices)),
        solid="true",
        ccw="true",
        normalPerVertex="false",
        index=numbers(mesh.triangles),
    )
    appearance = element("Appearance", element("Material", diffuseColor="0.7 0.7 0.75"), surface)
    view = element("Viewpoint", position=f"0 {-4.0 * extent:.6g} {2.0 * extent:.6g}", orientation="1 0 0 1.1")
    head = [element("meta", name="title", content=title), element("meta", name="unit", content="metre")]
    body = [element("NavigationInfo", type='"EXAMINE"'), view, element("Shape", appearance, faces, DEF="block")]
    return element("X3D", element("head", *head), element("Scene", *body), profile="Immersive", version="3.3")


X3D = SceneFormat(
    name="x3d",
    title="X3D (H3D)",
    unit="metres",
    write=_write,
    run=(
        "`H3DLoad scene.x3d`; a declared tip is `probe.x3d`, for the stylus of `DeviceInfo`; other X3D viewers show the block and "
        "ignore the haptic surface."
    ),
    settings=(
        "FrictionalSurface with absolute stiffness k/S and the static and dynamic friction of the condition",
        "coordinates are decimal text with 12 digits, counter-clockwise seen from outside",
        "the proxy radius is the haptics device's in H3D (`DeviceInfo`, `proxyRadius`): set it to the ball's",
    ),
    verified="parsed by lxml and measured as a mesh by trimesh in the test suite; not run here in H3D.",
)
