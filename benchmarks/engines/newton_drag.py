"""Measure the peak force of an exported USD scene in Newton: newton_drag.py FOLDER [--warp]."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import newton  # type: ignore[import-not-found]  # it has an environment of its own
import numpy as np
import warp  # type: ignore[import-not-found]

TIME_STEP = 2e-5
APPROACH = 30e-6  # before the notch, unscaled [m]


def main() -> None:
    folder = Path(sys.argv[1])
    scene = json.loads((folder / "event.json").read_text(encoding="utf-8"))
    warp.config.quiet = True
    builder = newton.ModelBuilder()
    # reads mjc:solref and mjc:solimp of the colliders
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    builder.add_usd(str(folder / "scene.usda"), load_visual_shapes=False)
    # the damper that MuJoCo's scene has on the tip; USD's drive carries the spring alone
    builder.joint_target_kd[0] = 0.5 / scene["scale"]
    model = builder.finalize(device="cpu")
    gap = float(model.shape_gap.numpy().max())
    print(json.dumps(drag(model, scene, scene["events"][0]) | {"contact_gap_m": gap}))


def drag(model: newton.Model, scene: dict, event: dict) -> dict:
    """Pull the far end of the joint's drive steadily; the load is a constant force along z."""
    solver = newton.solvers.SolverMuJoCo(
        model,
        cone="elliptic",
        impratio=1000.0,
        iterations=100,
        ls_iterations=50,
        tolerance=1e-12,
        use_mujoco_cpu="--warp" not in sys.argv,
    )
    first, second, control = model.state(), model.state(), model.control()
    stiffness, scale, load = scene["stiffness_n_per_m"], scene["scale"], scene["normal_load_n"]
    formula = event["critical_force_n"]
    target = formula or 10.0 * load
    home = float(model.joint_X_p.numpy()[0][0])
    start = event["trigger_position_m"] - APPROACH * scale - home
    q = np.array([start, 0.0], dtype=np.float32)
    first.joint_q.assign(q)
    newton.eval_fk(model, first.joint_q, first.joint_qd, first)
    speed = 1e-3 * scale * min(1.0, target)
    travel = APPROACH * scale + 1.15 * target / stiffness + 0.3 * scene["ball_radius_m"]
    steps, settle = int(np.ceil(travel / speed / TIME_STEP)), 500
    force = np.array([0.0, -load], dtype=np.float32)
    control.joint_f.assign(force)
    goal, peak, place = np.zeros(2, dtype=np.float32), 0.0, start
    for step in range(-settle, steps):
        goal[0] = start + speed * max(step, 0) * TIME_STEP
        control.joint_target_q.assign(goal)
        solver.step(first, second, control, None, TIME_STEP)
        first, second = second, first
        if step >= 0 and step % 5 == 0:
            place = float(first.joint_q.numpy()[0])
            peak = max(peak, stiffness * (float(goal[0]) - place))
    crossed = place + home - event["trigger_position_m"] > 0.2 * scene["ball_radius_m"]
    return {"peak_force_n": peak, "formula_n": formula, "crossed": bool(crossed), "steps": steps}


if __name__ == "__main__":
    main()
