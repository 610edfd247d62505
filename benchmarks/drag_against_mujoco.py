"""Compare the drag in time with MuJoCo: drags per second at known settings and equal accuracy.

The same mass on the same spring, load, friction, speed, lead and ring. MuJoCo has the settings that
follow the formula (elliptic cone, Newton, impratio 1000, solimp 0.9999 0.9999 1e-6, solref 4e-5 1,
step 2e-5 s), and again the step at which the peak force comes as near to that of ever smaller steps
as ours does. Ours has the Hertz contact of steel, a linear one of m / solref^2 = 1.7e6 N/m, and one
of 3e7 N/m that comes as near to the rigid formula as MuJoCo. "stepping": relative error of the peak
against the same model with a step 2 (MuJoCo) or 13 (ours) times as fine as the finest shown.
"equation (1)": difference from the formula, which knows no speed and no compliance: a property of
the contact, not an error. Run: python benchmarks/drag_against_mujoco.py
"""

from __future__ import annotations

import time
from dataclasses import replace

import mujoco
import numpy as np

from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.drag.probe import PAPER_DRAG, DragSettings
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.track import build_step_track

R = 125e-6
PROBE = replace(PAPER_DRAG, damping_ratio=0.02)  # as in the figures of docs/explanation/drag.md
LEAD, RING = 20e-6, 16e-3
CASES = [(10e-6, 1.0, 0.15), (25e-6, 1.0, 0.15), (50e-6, 0.5, 0.15), (75e-6, 0.2, 0.15)]

SCENE = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" cone="elliptic" solver="Newton" impratio="1000"
          iterations="100"
   tolerance="1e-14"/>
  <default><geom friction="{mu} 0 0" condim="3" solref="4e-5 1"
                 solimp="0.9999 0.9999 1e-6 0.5 2"/></default>
  <worldbody>
    <geom type="box" size="5e-3 1e-3 5e-4" pos="-5e-3 0 -5e-4"/>
    <geom type="box" size="5e-3 1e-3 5e-4" pos="5e-3 0 {upper}"/>
    <body pos="{x} 0 {z}">
      <joint name="x" type="slide" axis="1 0 0" damping="{damping}"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="1e-11 1e-11 1e-11"/>
      <geom type="sphere" size="{radius}"/>
    </body>
  </worldbody>
  <actuator><intvelocity joint="x" kp="{k}" actrange="-1 1"/></actuator>
</mujoco>
"""


def mujoco_drag(
    height: float, load: float, mu: float, speed: float, step: float
) -> tuple[float, float, float]:
    """Seconds spent in MuJoCo, peak force [N] and seconds simulated."""
    k, mass = PROBE.stiffness, PROBE.mass
    start = -np.sqrt(height * (2 * R - height)) - LEAD
    damping = 2 * PROBE.damping_ratio * np.sqrt(k * mass)
    model = mujoco.MjModel.from_xml_string(
        SCENE.format(
            step=step,
            mu=mu,
            upper=height - 5e-4,
            x=start,
            z=R,
            damping=damping,
            mass=mass,
            radius=R,
            k=k,
        )
    )
    data = mujoco.MjData(model)
    data.act[0] = mu * load / k
    data.ctrl[0] = data.qvel[0] = speed
    data.qfrc_applied[1] = -load
    # the damper goes to the handle, which moves, not to the ground
    data.qfrc_applied[0] = damping * speed
    peak, released = 0.0, np.inf
    chunk = 5
    begin = time.process_time()
    while data.time < released + RING and data.time < 10.0:
        mujoco.mj_step(model, data, chunk)
        force = float(data.actuator_force[0])
        peak = max(peak, force)
        if released == np.inf and force < 0.5 * peak and data.qpos[0] > 10e-6:
            released = data.time
    return time.process_time() - begin, peak, data.time


CONTACTS = {
    "linear 1.7e6": replace(PROBE, contact_power=1.0, contact_stiffness=PROBE.mass / 4e-5**2),
    "linear 3e7": replace(PROBE, contact_power=1.0, contact_stiffness=3e7),
    "Hertz": PROBE,
}
RESOLUTION = 6.0  # steps per period of the stiffest contact mode


def our_drag(
    height: float,
    load: float,
    mu: float,
    speed: float,
    contact: str,
    resolution: float = RESOLUTION,
    repeats: int = 20,
) -> tuple[float, float, float]:
    """Seconds spent, peak force [N] and seconds simulated."""
    settings = DragSettings(
        load, mu, speed=speed, lead=LEAD, ring_time=RING, sample_rate=5e3, resolution=resolution
    )
    track = build_step_track(height, R)
    simulate_drag(track, CONTACTS[contact], settings)
    begin = time.process_time()
    for _ in range(repeats):
        trace = simulate_drag(track, CONTACTS[contact], settings)
    return (
        (time.process_time() - begin) / repeats,
        trace.peak_force,
        float(trace.column("time_s")[-1]),
    )


def main() -> None:
    print(f"mujoco {mujoco.__version__}; CPU time of one core")
    print(
        f"{'drag':18s} {'program':28s} {'CPU ms':>8s} {'simulated ms':>13s} {'stepping':>9s} "
        f"{'equation (1)':>13s}"
    )
    ratios: dict[tuple[str, float], list[float]] = {}
    apart = []
    for speed in (1e-3, 5e-3):
        for case in CASES:
            formula = find_release(find_step_angle(case[0], R), case[1], case[2]).pull_force
            head = f"{speed * 1e3:g} mm/s, H {case[0] * 1e6:3.0f} um"
            limit = mujoco_drag(*case, speed, 2.5e-6)[1]
            theirs = {}
            for step in (2e-5, 5e-6):
                theirs[step], peak, span = mujoco_drag(*case, speed, step)
                _line(
                    head,
                    f"MuJoCo, step {step:g} s",
                    theirs[step],
                    span,
                    peak / limit - 1,
                    peak / formula - 1,
                )
            for name in CONTACTS:
                seconds, peak, span = our_drag(*case, speed, name)
                fine = our_drag(*case, speed, name, 80.0, 1)[1]
                if name == "linear 3e7":
                    apart.append(abs(peak / limit - 1.0))
                _line(head, f"ours, {name}", seconds, span, peak / fine - 1, peak / formula - 1)
                for step, spent in theirs.items():
                    ratios.setdefault((name, step), []).append(spent / seconds)
    for step in (2e-5, 5e-6):
        means = ", ".join(
            f"{n} {np.exp(np.mean(np.log(v))):.0f}" for (n, s), v in ratios.items() if s == step
        )
        print(
            f"times faster than MuJoCo with a step of {step:g} s (geometric mean of all "
            "drags): "
            f"{means}"
        )
    print(f"peaks of both programs, linear 3e7: {100.0 * max(apart):.1f} %")
    print(
        "drags per second per core, Hertz, H 25 um, 1 N, 5 mm/s: "
        f"{1 / our_drag(*CASES[1], 5e-3, 'Hertz')[0]:.0f}"
    )


def _line(
    head: str, program: str, seconds: float, span: float, stepping: float, off: float
) -> None:
    print(
        f"{head:18s} {program:28s} {seconds * 1e3:8.2f} {span * 1e3:13.1f} {stepping:+9.1e} "
        f"{off:+13.2%}",
        flush=True,
    )


if __name__ == "__main__":
    main()
