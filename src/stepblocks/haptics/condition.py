"""Under what a stimulus is felt: the ball, the load, the friction and the tool."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stepblocks.contact.energy import PAPER_TOOL, Tool
from stepblocks.errors import HapticsError

__all__ = ["Condition"]


@dataclass(frozen=True)
class Condition:
    """Ball, load, friction and tool.

    Attributes
    ----------
    ball_radius : float
        Radius R of the probe tip [m].
    normal_load : float
        Normal load F_py [N].
    friction : float
        Coefficient of friction mu [1].
    tool : Tool
        Spring and ring of the explorer.
    """

    ball_radius: float
    normal_load: float
    friction: float
    tool: Tool = PAPER_TOOL

    def __post_init__(self) -> None:
        for name, unit in (("ball_radius", "m"), ("normal_load", "N")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise HapticsError(f"{name} must be positive and finite, got {value:g} {unit}")
        if not (math.isfinite(self.friction) and self.friction >= 0.0):
            raise HapticsError(f"friction must be finite and not negative, got {self.friction:g}")
