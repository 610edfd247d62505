"""SOFA: a scene in centimetres, the unit of its Geomagic driver, with contact distances below the step."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from stepblocks.artefacts.meshes.write import write_obj
from stepblocks.parts.shapes import Mesh
from stepblocks.simulators.scene import Scene, SceneFormat, element, write_xml

_CM = 1e2
_OBJ_UNITS = (
    1e3  # `write_obj` writes millimetres: what is divided by this and multiplied by 100 comes out in centimetres
)
_PLUGINS = (
    "AnimationLoop",
    "Collision.Detection.Algorithm",
    "Collision.Detection.Intersection",
    "Collision.Geometry",
    "Collision.Response.Contact",
    "Constraint.Lagrangian.Correction",
    "Constraint.Lagrangian.Solver",
    "IO.Mesh",
    "LinearSolver.Direct",
    "Mass",
    "ODESolver.Backward",
    "SolidMechanics.Spring",
    "StateContainer",
    "Topology.Container.Constant",
)


def _write(folder: Path, scene: Scene) -> None:
    alarm = 0.1 * scene.scale * _CM * _height(scene)
    distances = {"alarmDistance": f"{alarm:.6g}", "contactDistance": f"{0.1 * alarm:.6g}"}
    root = element(
        "Node",
        *(element("RequiredPlugin", name=f"Sofa.Component.{name}") for name in _PLUGINS),
        element("FreeMotionAnimationLoop"),
        element("GenericConstraintSolver", maxIterations="1000", tolerance="1e-9"),
        element("CollisionPipeline", depth="6"),
        element("BruteForceBroadPhase"),
        element("BVHNarrowPhase"),
        element("LocalMinDistance", name="proximity", **distances, angleCone="0.0"),
        element(
            "CollisionResponse", response="FrictionContactConstraint", responseParams=f"mu={scene.point.friction:.9g}"
        ),
        *(_obstacle(piece.name) for piece in scene.pieces),
        *_probe(scene),
        name="root",
        dt="0.001",
        gravity="0 0 0",
    )
    for piece in scene.pieces:
        _write_obj(folder, piece, piece.name)
    if scene.probe:
        _write_obj(folder, scene.probe.whole, "probe")
    write_xml(folder / "scene.scn", root)


def _write_obj(folder: Path, mesh: Mesh, name: str) -> None:
    write_obj(folder / f"{name}.obj", Mesh(name, mesh.vertices * (_CM / _OBJ_UNITS), mesh.triangles))


def _obstacle(name: str) -> ElementTree.Element:
    models = ("TriangleCollisionModel", "LineCollisionModel", "PointCollisionModel")
    return element(
        "Node",
        element("MeshOBJLoader", name="loader", filename=f"{name}.obj"),
        element("MeshTopology", src="@loader"),
        element("MechanicalObject", src="@loader"),
        *(element(model, simulated="0", moving="0", contactStiffness="1000") for model in models),
        name=name,
    )


def _height(scene: Scene) -> float:
    """Smallest feature that must be felt, unscaled [m]."""
    z = scene.path.z / scene.scale
    return abs(float(z[-1] - z[0])) or abs(float(z.min() - z[0])) or scene.point.ball_radius


def _probe(scene: Scene) -> tuple[ElementTree.Element, ElementTree.Element]:
    """Hang the ball on a spring whose other end is the device; mass in kg, force in kg cm/s^2, so stiffness stays N/m."""
    place = f"{scene.path.x[0] * 0.1 * _CM:.9g} 0 {float(scene.path.z[0]) * _CM:.9g}"
    spring = {"stiffness": f"{scene.stiffness:.9g}", "external_rest_shape": "@../device/hand"}
    probe = element(
        "Node",
        element("EulerImplicitSolver"),
        element("SparseLDLSolver", template="CompressedRowSparseMatrixMat3x3d"),
        element("MechanicalObject", name="tip", template="Vec3d", position=place),
        element("UniformMass", totalMass=f"{scene.tip_mass:.9g}"),
        element("RestShapeSpringsForceField", **spring),
        element("UncoupledConstraintCorrection"),
        element("SphereCollisionModel", radius=f"{scene.ball_radius * _CM:.9g}"),
        name="probe",
    )
    hand = element("MechanicalObject", name="hand", template="Vec3d", position=place)
    return probe, element("Node", hand, name="device")


SOFA = SceneFormat(
    name="sofa",
    title="SOFA",
    unit="centimetres",
    write=_write,
    run="`runSofa scene.scn`; bind the position of `@device/hand` to your driver (its Geomagic plugin reports centimetres).",
    settings=(
        "centimetres, as SOFA's Geomagic driver reports",
        "alarm distance a tenth of the step, contact distance a hundredth: the usual 0.15 and 0.05 are larger than the step",
        "forces come out in kg cm/s^2: divide by 100 for newton; a stiffness in N/m is the same number in kg/s^2",
        "one collision model per convex piece; friction through FrictionContactConstraint",
        "the scene's probe is a ball on a particle; a declared tip's shape is in `probe.obj`, for a picture bound to your driver",
    ),
    verified="parsed by lxml, and its meshes read and measured by trimesh, in the test suite; not run here in SOFA.",
)
