"""X3D for H3D: the block in metres with H3D's frictional surface."""

from stepblocks.simulators.scene import SceneFormat, write_from_template

X3D = SceneFormat(
    name="x3d",
    title="X3D (H3D)",
    unit="metres",
    write=lambda to, scene: write_from_template(
        to / "scene.x3d", scene=scene, extent=float(abs(scene.whole.vertices).max())
    ),
    run="`H3DLoad scene.x3d`; other X3D viewers show the block and ignore the haptic surface.",
    settings=(
        "FrictionalSurface with absolute stiffness k/S and the static and dynamic "
        "friction of "
        "the "
        "condition",
        "coordinates are decimal text with 12 digits, counter-clockwise seen from outside",
        "the proxy radius is the haptics device's in H3D (`DeviceInfo`, "
        "`proxyRadius`): "
        "set "
        "it to "
        "the ball's",
    ),
    verified="parsed by lxml and measured as a mesh by trimesh in the test suite; not run here in "
    "H3D.",
)
