"""The critical angle of a scanned edge."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.path.catches import steepest
from stepblocks.contact.path.profile import profile_path
from stepblocks.contact.path.tip import Ball
from stepblocks.errors import ContactError


def scanned_angle(position: NDArray[np.float64], height: NDArray[np.float64], ball: float) -> float | None:
    """Critical angle of a scanned edge: the steepest rise of the path of the tip's centre over it, up the step."""
    known = height[np.isfinite(height)]
    tenth = len(known) // 10
    if tenth == 0:
        return None
    rising = float(np.median(known[-tenth:])) > float(np.median(known[:tenth]))
    x, z = (position, height) if rising else (-position[::-1], height[::-1])
    try:
        angle = steepest(profile_path(x, z, Ball(ball))).angle
    except ContactError:
        return None
    return angle if 0.0 < angle < 0.5 * math.pi else None
