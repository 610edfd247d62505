"""The scene for MuJoCo shows what is felt: its camera rides with the tip and looks at it, and one scene holds all of a set."""

import json
from pathlib import Path

import numpy as np
import pytest

from stepblocks.simulators.export import export

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"


def test_the_camera_rides_with_the_tip_and_looks_at_it(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    export([SET], "mujoco", tmp_path, only="step-050")
    model = mujoco.MjModel.from_xml_path(
        str(tmp_path / "paper-ten" / "step-050" / "mujoco" / "scene.xml")
    )
    data = mujoco.MjData(model)
    ball, camera = model.geom("ball").id, model.camera("tip").id
    for x in (0.0, 1e-3):
        data.joint("x").qpos = x
        mujoco.mj_forward(model, data)
        towards = data.geom_xpos[ball] - data.cam_xpos[camera]
        ahead = -data.cam_xmat[camera].reshape(3, 3)[:, 2]  # a camera looks along its -z
        assert ahead @ towards / np.linalg.norm(towards) == pytest.approx(1.0, abs=1e-9)
        # nearer than nothing is drawn, by MuJoCo's own setting
        assert np.linalg.norm(towards) > model.vis.map.znear * model.stat.extent


def test_one_scene_holds_all_blocks_of_a_set_and_each_tip_slips_at_the_force_of_its_own(tmp_path):
    """Expected: equation (1), as `event.json` of each block says it."""
    mujoco = pytest.importorskip("mujoco")
    export([SET], "mujoco", tmp_path, only="step-0[25]0", device="sigma-7")
    place = tmp_path / "paper-ten"
    assert (
        "python -m mujoco.viewer --mjcf=scene.xml"
        in (place / "mujoco-sigma-7-blocks" / "README.md").read_text()
    )
    assert (
        "python -m mujoco.viewer"
        in (place / "step-050" / "mujoco-sigma-7" / "README.md").read_text()
    )
    model = mujoco.MjModel.from_xml_path(str(place / "mujoco-sigma-7-blocks" / "scene.xml"))
    data = mujoco.MjData(model)
    told = [
        json.loads((place / f"step-0{n}0/mujoco-sigma-7/event.json").read_text()) for n in (2, 5)
    ]
    assert (model.nq, model.ncam) == (4, 2)
    assert 2.0 * told[0]["ball_radius_m"] > model.vis.map.znear * model.stat.extent
    scale, stiffness, load = (
        told[0][name] for name in ("scale", "stiffness_n_per_m", "normal_load_n")
    )
    events = [scene["events"][0] for scene in told]
    start = np.array([event["trigger_position_m"] - 30e-6 * scale for event in events])
    data.qpos[0::2] = start
    data.qpos[1::2] = [event["trigger_height_m"] - told[0]["ball_radius_m"] for event in events]
    data.ctrl[0::2], data.ctrl[1::2] = start, -load
    mujoco.mj_step(model, data, 500)
    greatest = max(event["critical_force_n"] for event in events)
    steps, peak = 15_000, np.zeros(2)
    for pulled in np.linspace(0.0, 30e-6 * scale + 1.15 * greatest / stiffness, steps):
        data.ctrl[0::2] = start + pulled
        mujoco.mj_step(model, data)
        peak = np.maximum(peak, data.actuator_force[0::2])
    assert peak == pytest.approx([event["critical_force_n"] for event in events], rel=0.01)
    limits = model.actuator_ctrlrange
    assert limits[0, 1] > 1.15 * greatest / stiffness
    assert limits[1, 0] == pytest.approx(-2.0 * load)
