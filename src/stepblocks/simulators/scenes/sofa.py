"""SOFA: a scene in centimetres, the unit of its Geomagic driver, with contact distances below the step."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stepblocks.artefacts.meshes.write import write_obj
from stepblocks.parts.mesh import Mesh
from stepblocks.simulators.scenes.scene import Scene, SceneFormat

_CM = 1e2
_OBJ_UNITS = (
    1e3  # `write_obj` writes millimetres; a mesh divided by this and multiplied by 100 comes out in centimetres
)


def _write(folder: Path, scene: Scene) -> None:
    for piece in scene.pieces:
        write_obj(folder / f"{piece.name}.obj", Mesh(piece.name, piece.vertices * (_CM / _OBJ_UNITS), piece.triangles))
    alarm = 0.1 * scene.scale * _CM * _height(scene)
    root = ElementTree.Element("Node", name="root", dt="0.001", gravity="0 0 0")
    plugins = (
        "Sofa.Component.AnimationLoop",
        "Sofa.Component.Collision.Detection.Algorithm",
        "Sofa.Component.Collision.Detection.Intersection",
        "Sofa.Component.Collision.Geometry",
        "Sofa.Component.Collision.Response.Contact",
        "Sofa.Component.Constraint.Lagrangian.Correction",
        "Sofa.Component.Constraint.Lagrangian.Solver",
        "Sofa.Component.IO.Mesh",
        "Sofa.Component.LinearSolver.Direct",
        "Sofa.Component.Mass",
        "Sofa.Component.ODESolver.Backward",
        "Sofa.Component.SolidMechanics.Spring",
        "Sofa.Component.StateContainer",
        "Sofa.Component.Topology.Container.Constant",
    )
    for name in plugins:
        ElementTree.SubElement(root, "RequiredPlugin", name=name)
    ElementTree.SubElement(root, "FreeMotionAnimationLoop")
    ElementTree.SubElement(root, "GenericConstraintSolver", maxIterations="1000", tolerance="1e-9")
    ElementTree.SubElement(root, "CollisionPipeline", depth="6")
    ElementTree.SubElement(root, "BruteForceBroadPhase")
    ElementTree.SubElement(root, "BVHNarrowPhase")
    ElementTree.SubElement(
        root,
        "LocalMinDistance",
        name="proximity",
        alarmDistance=f"{alarm:.6g}",
        contactDistance=f"{0.1 * alarm:.6g}",
        angleCone="0.0",
    )
    ElementTree.SubElement(
        root,
        "CollisionResponse",
        response="FrictionContactConstraint",
        responseParams=f"mu={scene.condition.friction:.9g}",
    )
    for piece in scene.pieces:
        node = ElementTree.SubElement(root, "Node", name=piece.name)
        ElementTree.SubElement(node, "MeshOBJLoader", name="loader", filename=f"{piece.name}.obj")
        ElementTree.SubElement(node, "MeshTopology", src="@loader")
        ElementTree.SubElement(node, "MechanicalObject", src="@loader")
        for model in ("TriangleCollisionModel", "LineCollisionModel", "PointCollisionModel"):
            ElementTree.SubElement(node, model, simulated="0", moving="0", contactStiffness="1000")
    if scene.probe:
        tip = Mesh("probe", scene.probe.whole.vertices * (_CM / _OBJ_UNITS), scene.probe.whole.triangles)
        write_obj(folder / "probe.obj", tip)
    _probe(root, scene)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(folder / "scene.scn", encoding="utf-8", xml_declaration=True)


def _height(scene: Scene) -> float:
    """Smallest feature that must be felt, unscaled [m]."""
    rises = abs(float(scene.path.z[-1] - scene.path.z[0])) / scene.scale
    return rises or abs(float(scene.path.z.min() - scene.path.z[0])) / scene.scale or scene.condition.ball_radius


def _probe(root: ElementTree.Element, scene: Scene) -> None:
    """Hang the ball on a spring whose other end is the device; mass in kg, force in kg cm/s^2, so stiffness stays N/m."""
    start, height = scene.path.x[0] * 0.1 * _CM, float(scene.path.z[0]) * _CM
    place = f"{start:.9g} 0 {height:.9g}"
    probe = ElementTree.SubElement(root, "Node", name="probe")
    ElementTree.SubElement(probe, "EulerImplicitSolver")
    ElementTree.SubElement(probe, "SparseLDLSolver", template="CompressedRowSparseMatrixMat3x3d")
    ElementTree.SubElement(probe, "MechanicalObject", name="tip", template="Vec3d", position=place)
    ElementTree.SubElement(probe, "UniformMass", totalMass=f"{scene.tip_mass:.9g}")
    ElementTree.SubElement(
        probe, "RestShapeSpringsForceField", stiffness=f"{scene.stiffness:.9g}", external_rest_shape="@../device/hand"
    )
    ElementTree.SubElement(probe, "UncoupledConstraintCorrection")
    ElementTree.SubElement(probe, "SphereCollisionModel", radius=f"{scene.ball_radius * _CM:.9g}")
    device = ElementTree.SubElement(root, "Node", name="device")
    ElementTree.SubElement(device, "MechanicalObject", name="hand", template="Vec3d", position=place)


SOFA = SceneFormat(
    "sofa",
    "SOFA",
    "centimetres",
    _write,
    "`runSofa scene.scn`; bind the position of `@device/hand` to your driver (its Geomagic plugin reports centimetres).",
    (
        "centimetres, as SOFA's Geomagic driver reports",
        "alarm distance a tenth of the step, contact distance a hundredth: the usual 0.15 and 0.05 are larger than the step",
        "forces come out in kg cm/s^2: divide by 100 for newton; a stiffness in N/m is the same number in kg/s^2",
        "one collision model per convex piece; friction through FrictionContactConstraint",
        "the scene's probe is a ball on a particle; a declared tip's shape is in `probe.obj`, for a picture bound to your driver",
    ),
    "parsed by lxml, and its meshes read and measured by trimesh, in the test suite; not run here in SOFA.",
)
