"""The simulators that scenes are written for, one file each; what stands here is offered."""

from stepblocks.simulators.scene import SceneFormat
from stepblocks.simulators.scenes.chai3d import CHAI3D
from stepblocks.simulators.scenes.forcelaw import FORCELAW
from stepblocks.simulators.scenes.gltf import GLTF
from stepblocks.simulators.scenes.mujoco import MUJOCO
from stepblocks.simulators.scenes.native import NATIVE
from stepblocks.simulators.scenes.sofa import SOFA
from stepblocks.simulators.scenes.usd import USD
from stepblocks.simulators.scenes.x3d import X3D

_ALL = (MUJOCO, CHAI3D, SOFA, USD, GLTF, X3D, FORCELAW, NATIVE)
# by name, in the order of the help text
SCENE_FORMATS: dict[str, SceneFormat] = {form.name: form for form in _ALL}
