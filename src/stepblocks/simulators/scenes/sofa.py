"""SOFA: a scene in centimetres, with contact distances below the step."""

from pathlib import Path

from stepblocks.artefacts.meshes.write import write_obj
from stepblocks.parts.shapes import Mesh
from stepblocks.simulators.scene import Scene, SceneFormat, write_from_template

_CM = 1e2
# `write_obj` writes millimetres: divided by this and multiplied by 100, its numbers are centimetres
_OBJ_UNITS = 1e3


def _write_scene(folder: Path, scene: Scene) -> None:
    """Write the scene, and each convex piece as a mesh in centimetres."""
    for piece in scene.pieces:
        vertices = piece.vertices * (_CM / _OBJ_UNITS)
        write_obj(folder / f"{piece.name}.obj", Mesh(piece.name, vertices, piece.triangles))
    alarm = 0.1 * scene.scale * _CM * _compute_smallest_felt_height(scene)
    write_from_template(folder / "scene.scn", scene=scene, alarm=alarm)


def _compute_smallest_felt_height(scene: Scene) -> float:
    """Find the smallest height that is to be felt [m]: of a step, else of a gap, else the ball."""
    z = scene.path.z / scene.scale
    step = abs(float(z[-1] - z[0]))
    if step > 0.0:
        return step
    gap = abs(float(z.min() - z[0]))
    if gap > 0.0:
        return gap
    return scene.point.ball_radius


SOFA = SceneFormat(
    name="sofa",
    title="SOFA",
    unit="centimetres",
    write=_write_scene,
    run="`runSofa scene.scn`; bind the position of `@device/hand` to your driver (its Geomagic "
    "plugin reports centimetres).",
    settings=(
        "for SOFA v25.12 and later; in an older release write `GenericConstraintSolver` for "
        "`BlockGaussSeidelConstraintSolver` in `scene.scn`, which is the same solver by its name "
        "before",
        "centimetres, as SOFA's Geomagic driver reports",
        "alarm distance a tenth of the step, contact distance a hundredth: the usual 0.15 and "
        "0.05 are larger than the step",
        "forces come out in kg cm/s^2: divide by 100 for newton; a stiffness in N/m is the same "
        "number in kg/s^2",
        "one collision model per convex piece; friction through FrictionContactConstraint",
        "the scene's probe is a ball on a particle; the hand starts F/k below it, so that the "
        "spring presses with the load",
    ),
    verified="parsed by lxml, and its meshes read and measured by trimesh, in the test "
    "suite; not run here in SOFA.",
)
