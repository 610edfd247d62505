"""The scene for MuJoCo shows what is felt: its camera rides with the tip and looks at it."""

from pathlib import Path

import numpy as np
import pytest

from stepblocks.simulators.export import export

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"


def test_the_camera_rides_with_the_tip_and_looks_at_it(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    export([SET], "mujoco", tmp_path, only="step-050")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "paper-ten" / "step-050" / "mujoco" / "scene.xml"))
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
