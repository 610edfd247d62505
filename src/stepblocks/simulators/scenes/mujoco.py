"""MuJoCo: a scene of convex pieces, the whole tooth of a scan, and a script that drags the tip."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stepblocks.artefacts.meshes.write import write_obj
from stepblocks.contact.energy import Status
from stepblocks.parts.shapes import Mesh
from stepblocks.simulators.scene import Scene, SceneFormat, write_from_template


def _write_scene(folder: Path, scene: Scene) -> None:
    """Write the scene of a block, and the script that drags its tip."""
    block = {"scene": scene, "y": 0.0, "prefix": ""}
    write_from_template(folder / "scene.xml", name=scene.stimulus.id, blocks=[block], reach=None)
    write_from_template(folder / "drag.py")


def _write_set(folder: Path, scenes: Sequence[Scene], _: str) -> None:
    """Write one scene with all blocks of a set side by side; each has its tip."""
    first = scenes[0]
    spacing = 1.2 * max(map(_compute_block_width, scenes))
    blocks = []
    for number, scene in enumerate(scenes):
        prefix = f"{scene.stimulus.id}-"
        blocks.append({"scene": scene, "y": -number * spacing, "prefix": prefix})
    clip = first.ball_radius / (len(scenes) * spacing)  # nearer to a camera nothing is drawn
    write_from_template(
        folder / "scene.xml",
        name=folder.parent.name,
        blocks=blocks,
        reach=_compute_slider_span(scenes),
        clip=clip,
    )
    write_from_template(
        folder / "README.md", "mujoco-blocks.md", name=folder.parent.name, scenes=scenes
    )


def _compute_block_width(scene: Scene) -> float:
    """Measure the width of a block in a scene."""
    return float(np.ptp(scene.whole.vertices[:, 1]))


def _compute_slider_span(scenes: Sequence[Scene]) -> float:
    """Find what the sliders of the viewer span [m]: past every release, and twice the load."""
    first = scenes[0]
    forces = []
    for scene in scenes:
        event = scene.events[0]
        if event.status is Status.RELEASES:
            forces.append(event.critical_force)
    force = max(forces, default=first.point.normal_load)
    return 1.3 * force / first.stiffness + 2.0 * first.ball_radius


def _write_tooth(folder: Path, scan: Mesh, stations: Sequence[Scene]) -> None:
    """Write one scene with the whole tooth: a tip that keyframes put before each station."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix([station.frame.turn for station in stations])
    write_obj(folder / "tooth.obj", scan)
    write_from_template(
        folder / "scene.xml",
        "tooth.xml",
        stations=stations,
        turns=turns.as_quat(scalar_first=True),
    )
    write_from_template(folder / "drag.py", "drag_tooth.py", stations=stations)


MUJOCO = SceneFormat(
    name="mujoco",
    title="MuJoCo",
    unit="metres",
    write=_write_scene,
    write_set=_write_set,
    write_tooth=_write_tooth,
    run=(
        "`pip install mujoco`, then `python drag.py` (towards +x) or `python drag.py --down`, from "
        "any directory. To look at it: `python -m mujoco.viewer --mjcf=scene.xml` (the "
        "camera `tip` rides with the tip). `-blocks` beside the blocks of a set is one scene with "
        "all of them.\n\n"
        "In a program of your own start from the keyframe `before`, in which the tip rests before "
        "the step (in a gap: in its notch) under its load, and pull the far end of the spring:\n\n"
        "```python\n"
        "import json\n\n"
        "import mujoco\n\n"
        'model = mujoco.MjModel.from_xml_path("scene.xml")\n'
        "data = mujoco.MjData(model)\n"
        'mujoco.mj_resetDataKeyframe(model, data, model.key("before").id)\n'
        'scene = json.load(open("event.json"))\n'
        'force = scene["events"][0]["critical_force_n"] or 1.0\n'
        'speed = 5e-4 * scene["scale"] * min(1.0, force)  # slow: inertia adds sqrt(k m) times it\n'
        'travel = 1e-4 * scene["scale"] + 1.1 * force / scene["stiffness_n_per_m"]\n'
        "peak = 0.0\n"
        "for step in range(int(travel / speed / model.opt.timestep)):\n"
        '    data.actuator("spring").ctrl = speed * step * model.opt.timestep\n'
        "    mujoco.mj_step(model, data)\n"
        '    peak = max(peak, data.sensor("pull").data[0])\n'
        'print(f"peak {peak:.4f} N")\n'
        "```"
    ),
    settings=(
        "convex pieces: one concave mesh would become its convex hull and the step a ramp",
        "elliptic cone, Newton solver, impratio 1000, solimp with a width of 1 um times S, solref "
        "of two time steps: with the defaults the tip falls through",
        "ccd_tolerance 1 nm times S: its default of 1 um is a tenth of a step",
        "the tip's mass and inertia are explicit; mass and spring ring at the event's frequency",
        "the joint's damping gives the tip the decay of `event.json`; friction ends its ring "
        "sooner while it slides. It swings with the energy that the slip leaves it, not with E_v: "
        "to feel the ring of the formula play the `ring-up` WAV at the release",
        "sensors: `pull` and `press` are the forces of spring and load, `tip_x`, `tip_z` and "
        "`tip_velocity` the ball, `ring` its acceleration",
    ),
    verified="run in MuJoCo by the test suite and by the table of docs/explanation/simulators.md.",
)
