"""The scene for MuJoCo as it is delivered: camera, keyframe, sensors, README, whole sets."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stepblocks.simulators.export import export_scenes

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"
SHIPPED = [SET, SET.with_name("crown-margins.toml")]


def test_the_camera_rides_with_the_tip_and_looks_at_it(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    export_scenes([SET], "mujoco", tmp_path, only="step-050")
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


@pytest.mark.long
def test_one_scene_holds_all_blocks_of_a_set_and_each_tip_slips_at_the_force_of_its_own(tmp_path):
    """Expected: equation (1), as `event.json` of each block says it."""
    mujoco = pytest.importorskip("mujoco")
    export_scenes([SET], "mujoco", tmp_path, only="step-0[25]0", device="sigma-7")
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
    mujoco.mj_resetDataKeyframe(model, data, model.key("before").id)
    assert data.qpos[0::2] == pytest.approx(start)
    mujoco.mj_step(model, data, 500)
    greatest = max(event["critical_force_n"] for event in events)
    steps, peak = 15_000, np.zeros(2)
    for pulled in np.linspace(0.0, 30e-6 * scale + 1.15 * greatest / stiffness, steps):
        data.ctrl[0::2] = pulled
        mujoco.mj_step(model, data)
        peak = np.maximum(peak, data.actuator_force[0::2])
    assert peak == pytest.approx([event["critical_force_n"] for event in events], rel=0.01)
    limits = model.actuator_ctrlrange
    assert limits[0, 1] > 1.15 * greatest / stiffness
    assert limits[1, 0] == pytest.approx(-2.0 * load)


@pytest.fixture(scope="module")
def delivered(tmp_path_factory):
    """The folder of the block of 50 um, as the command writes it."""
    pytest.importorskip("mujoco")
    (done,) = export_scenes(SET, "mujoco", tmp_path_factory.mktemp("scene"), only="step-050")
    return done.folder


def test_the_readme_runs_as_it_stands_and_gives_the_force_of_the_formula(delivered):
    """Equations (1) and (2) at 0.3 N, mu 0.15, R 125 um: 0.5563 N."""
    code = re.search(r"```python\n(.*?)```", (delivered / "README.md").read_text(), re.DOTALL)[1]
    done = subprocess.run(
        [sys.executable, "-I", "-c", code],
        cwd=delivered,
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(done.stdout.split()[1]) == pytest.approx(0.5563, rel=0.01)


def test_the_tip_starts_outside_the_block_and_rests_there_under_its_load(delivered):
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(delivered / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)  # as a viewer opens it, before any keyframe
    assert all(contact.dist > -1e-7 for contact in data.contact)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 1000)
    assert data.sensor("tip_x").data[0] == pytest.approx(-130e-6, abs=1e-7)
    assert data.sensor("tip_z").data[0] == pytest.approx(125e-6, abs=2e-7)
    assert data.sensor("press").data[0] == pytest.approx(-0.3)
    assert data.sensor("pull").data[0] == pytest.approx(0.0, abs=1e-3)


@pytest.fixture(scope="module")
def all_margins(tmp_path_factory):
    """Folders of the blocks and margins that are shipped, by their names."""
    pytest.importorskip("mujoco")
    done = export_scenes(SHIPPED, "mujoco", tmp_path_factory.mktemp("scenes"))
    return {part.name.split("/")[1]: part.folder for part in done}


@pytest.mark.long
def test_nothing_moves_at_the_keyframe_of_any_scene_in_a_gap_neither(all_margins):
    """A ball over a gap would slide into it: at rest, it lies in the notch from the start."""
    import mujoco

    assert len(all_margins) == 22
    for name, folder in all_margins.items():
        model = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        home = data.qpos.copy()
        mujoco.mj_forward(model, data)
        assert all(abs(contact.dist) < 1e-7 for contact in data.contact), name
        mujoco.mj_step(model, data, 1000)
        assert data.qpos == pytest.approx(home, abs=1e-7), name


@pytest.mark.long
@pytest.mark.parametrize("name", ["step-100", "gap-100", "gap-050-under-020", "gap-050-bevelled"])
def test_the_readme_of_the_extremes_runs_as_it_stands_too(name, tmp_path):
    """The greatest force, 5.71 N, and the three gaps whose flank is steeper than friction."""
    pytest.importorskip("mujoco")
    (scene,) = export_scenes(SHIPPED, "mujoco", tmp_path, only=name)
    event = json.loads((scene.folder / "event.json").read_text())["events"][0]
    code = re.search(r"```python\n(.*?)```", (scene.folder / "README.md").read_text(), re.S)[1]
    done = subprocess.run(
        [sys.executable, "-I", "-c", code],
        cwd=scene.folder,
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(done.stdout.split()[1]) == pytest.approx(event["critical_force_n"], rel=0.005)


def test_the_tip_by_itself_rings_as_long_as_the_event_says(delivered):
    """Lifted off and let go: frequency and decay of the swing beside event.json."""
    import mujoco

    event = json.loads((delivered / "event.json").read_text())["events"][0]
    model = mujoco.MjModel.from_xml_path(str(delivered / "scene.xml"))
    data = mujoco.MjData(model)
    home = float(data.qpos[0])
    data.qpos[:] = home + 5e-5, 2e-3
    swing = np.empty(5000)
    for n in range(len(swing)):
        mujoco.mj_step(model, data)
        swing[n] = data.qpos[0] - home
    turns = np.flatnonzero((swing[1:-1] > swing[:-2]) & (swing[1:-1] > swing[2:])) + 1
    step = model.opt.timestep
    assert 1.0 / (np.diff(turns).mean() * step) == pytest.approx(event["frequency_hz"], rel=0.01)
    decay = (turns[-1] - turns[0]) * step / np.log(swing[turns[0]] / swing[turns[-1]])
    assert decay == pytest.approx(event["decay_s"], rel=0.02)
