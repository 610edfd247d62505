"""Every simulator that scenes are written for; a new one is tested and offered by standing here."""

from __future__ import annotations

from stepblocks.simulators.scenes.chai3d import CHAI3D
from stepblocks.simulators.scenes.forcelaw import FORCELAW
from stepblocks.simulators.scenes.gltf import GLTF
from stepblocks.simulators.scenes.mujoco import MUJOCO
from stepblocks.simulators.scenes.scene import SceneFormat
from stepblocks.simulators.scenes.sofa import SOFA
from stepblocks.simulators.scenes.urdf import URDF
from stepblocks.simulators.scenes.usd import USD
from stepblocks.simulators.scenes.x3d import X3D

# By name, in the order of the help text
SCENE_FORMATS: dict[str, SceneFormat] = {
    form.name: form for form in (MUJOCO, CHAI3D, SOFA, USD, GLTF, X3D, URDF, FORCELAW)
}
