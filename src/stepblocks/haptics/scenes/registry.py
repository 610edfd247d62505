"""Every simulator that scenes are written for; a new one is tested and offered by standing here."""

from __future__ import annotations

from stepblocks.haptics.scenes.chai3d import CHAI3D
from stepblocks.haptics.scenes.forcelaw import FORCELAW
from stepblocks.haptics.scenes.gltf import GLTF
from stepblocks.haptics.scenes.mujoco import MUJOCO
from stepblocks.haptics.scenes.scene import SceneFormat
from stepblocks.haptics.scenes.sofa import SOFA
from stepblocks.haptics.scenes.urdf import URDF
from stepblocks.haptics.scenes.usd import USD
from stepblocks.haptics.scenes.x3d import X3D

__all__ = ["SCENE_FORMATS"]

SCENE_FORMATS: dict[str, SceneFormat] = {
    form.name: form for form in (MUJOCO, CHAI3D, SOFA, USD, GLTF, X3D, URDF, FORCELAW)
}
"""By name, in the order of the help text."""
