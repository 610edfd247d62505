"""Drags per second of our integrator and of MuJoCo, with the error of the peak force against equation (1) beside.

The same mass on the same spring, load, friction and speed; MuJoCo with the settings that follow the formula (elliptic
cone, Newton, impratio 1000, solimp 0.9999 0.9999 1e-6, solref 4e-5 1, step 2e-5 s). Ours is run with a linear contact
of m / solref^2 = 1.7e6 N/m, with one of 3e7 N/m that comes as near to the rigid formula as MuJoCo, and with Hertz.
Run: python benchmarks/drag_against_mujoco.py
"""

from __future__ import annotations

import time
from dataclasses import replace

import mujoco
import numpy as np

from stepblocks.contact.critical_angle import step_angle
from stepblocks.contact.drag.model import PAPER_DRAG, DragSettings
from stepblocks.contact.drag.simulate import drag
from stepblocks.contact.drag.track import step_track
from stepblocks.contact.energy import release_at

R = 125e-6
LEAD, RING = 20e-6, 16e-3
CASES = [(10e-6, 1.0, 0.15), (25e-6, 1.0, 0.15), (50e-6, 0.5, 0.15), (75e-6, 0.2, 0.15)]

SCENE = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" cone="elliptic" solver="Newton" impratio="1000" iterations="100"
   tolerance="1e-14"/>
  <default><geom friction="{mu} 0 0" condim="3" solref="4e-5 1" solimp="0.9999 0.9999 1e-6 0.5 2"/></default>
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


def mujoco_drag(height: float, load: float, mu: float, speed: float, step: float) -> tuple[float, float]:
    """Seconds spent in MuJoCo and peak force [N]."""
    k, mass = PAPER_DRAG.stiffness, PAPER_DRAG.mass
    start = -np.sqrt(height * (2 * R - height)) - LEAD
    damping = 2 * PAPER_DRAG.damping_ratio * np.sqrt(k * mass)
    model = mujoco.MjModel.from_xml_string(
        SCENE.format(step=step, mu=mu, upper=height - 5e-4, x=start, z=R, damping=damping, mass=mass, radius=R, k=k)
    )
    data = mujoco.MjData(model)
    data.act[0] = mu * load / k
    data.ctrl[0] = data.qvel[0] = speed
    data.qfrc_applied[1] = -load
    data.qfrc_applied[0] = damping * speed  # the damper goes to the handle, which moves, not to the ground
    peak, released = 0.0, np.inf
    chunk = 5
    begin = time.process_time()
    while data.time < released + RING and data.time < 10.0:
        mujoco.mj_step(model, data, chunk)
        force = float(data.actuator_force[0])
        peak = max(peak, force)
        if released == np.inf and force < 0.5 * peak and data.qpos[0] > 10e-6:
            released = data.time
    return time.process_time() - begin, peak


CONTACTS = {
    "linear 1.7e6": (replace(PAPER_DRAG, contact_power=1.0, contact_stiffness=PAPER_DRAG.mass / 4e-5**2), 6.0),
    "linear 3e7": (replace(PAPER_DRAG, contact_power=1.0, contact_stiffness=3e7), 6.0),
    "Hertz": (PAPER_DRAG, 6.0),
    "Hertz, fine step": (PAPER_DRAG, 80.0),
}


def our_drag(height: float, load: float, mu: float, speed: float, contact: str) -> tuple[float, float]:
    probe, resolution = CONTACTS[contact]
    settings = DragSettings(load, mu, speed=speed, lead=LEAD, ring_time=RING, sample_rate=5e3, resolution=resolution)
    track = step_track(height, R)
    drag(track, probe, settings)
    repeats = 20
    begin = time.process_time()
    for _ in range(repeats):
        trace = drag(track, probe, settings)
    return (time.process_time() - begin) / repeats, trace.peak_force


def main() -> None:
    print(f"mujoco {mujoco.__version__}; CPU time of one core")
    print("error: peak force against equation (1), which knows no speed and no compliance")
    for speed in (1e-3, 5e-3):
        ratios: dict[str, list[float]] = {name: [] for name in CONTACTS}
        for height, load, mu in CASES:
            formula = release_at(step_angle(height, R), load, mu).pull_force
            theirs, peak = mujoco_drag(height, load, mu, speed, 2e-5)
            head = f"{speed * 1e3:g} mm/s, H {height * 1e6:3.0f} um"
            print(f"{head}: MuJoCo {theirs * 1e3:6.1f} ms {peak / formula - 1:+.2%}", end="")
            for name in CONTACTS:
                seconds, force = our_drag(height, load, mu, speed, name)
                ratios[name].append(theirs / seconds)
                print(f" | {name} {seconds * 1e3:5.2f} ms {force / formula - 1:+.2%}", end="")
            print()
        means = ", ".join(f"{name} {np.exp(np.mean(np.log(values))):.0f}" for name, values in ratios.items())
        print(f"  times faster than MuJoCo (geometric mean): {means}")
    for name in ("Hertz", "Hertz, fine step"):
        print(f"drags per second per core, H 25 um, 1 N, 5 mm/s, {name}: {1 / our_drag(*CASES[1], 5e-3, name)[0]:.0f}")


if __name__ == "__main__":
    main()
