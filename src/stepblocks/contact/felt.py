"""How far what is made is felt to be off from what was asked for."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Release, Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import ContactError


def energy_change(
    before: Counterface | Release, after: Counterface | Release, point: OperatingPoint, backward: bool = False
) -> float:
    """Relative change of the energy that is felt; NaN unless both release.

    Parameters
    ----------
    before, after : Counterface or Release
        Two counterfaces, or what was found over one.
    point : OperatingPoint
        Under which they are dragged over.
    backward : bool
        Direction of the drag.

    Returns
    -------
    float
        ``E_v(after) / E_v(before) - 1`` [1].

    Examples
    --------
    >>> from stepblocks.contact.counterface import Step
    >>> from stepblocks.contact.operating_point import PAPER
    >>> f"{energy_change(Step(25e-6), Step(26e-6), PAPER):+.1%}"
    '+5.4%'
    """
    first, second = (one.release(point, backward) if isinstance(one, Counterface) else one for one in (before, after))
    if first.status is not Status.RELEASES or second.status is not Status.RELEASES:
        return math.nan
    return float(second.vibration_energy / first.vibration_energy - 1.0)


def scanned_angle(position: NDArray[np.float64], height: NDArray[np.float64], ball: float) -> float | None:
    """Critical angle of a scanned edge: the steepest rise of the path of the tip's centre over it, up the step."""
    # compiled kernels, loaded where they are used
    from stepblocks.contact.path.catches import steepest
    from stepblocks.contact.path.profile import profile_path
    from stepblocks.contact.path.tip import Ball

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
