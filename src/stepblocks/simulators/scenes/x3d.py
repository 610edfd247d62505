"""X3D: the block in metres for any viewer, and with H3D's frictional surface."""

from pathlib import Path

from stepblocks.simulators.scene import Scene, SceneFormat, write_from_template


def _write_scene(folder: Path, scene: Scene) -> None:
    """Write the block for any viewer, and with the surface of H3D."""
    extent = float(abs(scene.whole.vertices).max())
    for name, haptic in (("scene.x3d", False), ("scene-h3d.x3d", True)):
        write_from_template(folder / name, "scene.x3d", scene=scene, extent=extent, haptic=haptic)


X3D = SceneFormat(
    name="x3d",
    title="X3D (H3D)",
    unit="metres",
    write=_write_scene,
    run="`H3DLoad scene-h3d.x3d`; `scene.x3d` is the same block for every other X3D viewer.",
    settings=(
        "`scene-h3d.x3d` has H3D's FrictionalSurface with absolute stiffness k/S and the static "
        "and dynamic friction of the condition; X3D itself has no such node",
        "coordinates are decimal text with 12 digits, counter-clockwise seen from outside",
        "the size of the avatar sets the near plane: with X3D's default a block of 20 mm is not "
        "drawn",
        "the proxy radius is the haptics device's in H3D (`DeviceInfo`, `proxyRadius`): set it to "
        "the ball's",
    ),
    verified="parsed by lxml, measured as a mesh by trimesh and drawn by X_ITE in the test suite; "
    "not run here in H3D.",
)
