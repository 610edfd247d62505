"""Forces and vibration energy of a probe that slips over an edge: equations (1) and (2) of the paper.

A probe that is self-locked never slips; the fraction of equation (1), squared, gives it an energy all the same. Here
locking is a status and its numbers are not-a-number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from stepblocks.contact import kernels
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import ContactError


class Status(StrEnum):
    """What becomes of a probe at an edge."""

    RELEASES = "releases"  # It climbs, slips and rings
    LOCKED = "locked"  # ``a + atan mu`` is a right angle or more: no pulling force lifts it
    TOO_HIGH = "too-high"  # The step is as high as the ball or higher: the ball meets the riser, not the edge
    NO_CATCH = "no-catch"  # The path of the ball's centre never rises in this direction


@dataclass(frozen=True)
class Release:
    """What is felt when the probe slips over an edge."""

    status: Status  # Whether it slips at all; the figures below are not-a-number unless it does
    angle: float  # Critical angle a [rad]
    pull_force: float = math.nan  # Tangential force at release F_px [N]
    vibration_energy: float = math.nan  # Energy of the ring E_v [J]
    mean_power: float = math.nan  # E_v over the duration of the ring [W]
    threshold_ratio: float = math.nan  # Mean power over the detection threshold [1]


def release_at(angle: float, normal_load: float, friction: float, tool: Tool = PAPER.tool) -> Release:
    """Force and energy at release for a critical angle.

    Parameters
    ----------
    angle : float
        Critical angle a [rad], from 0 to a right angle.
    normal_load : float
        Normal load F_py [N].
    friction : float
        Coefficient of friction mu [1], not negative.
    tool : Tool
        Spring and ring of the explorer.

    Returns
    -------
    Release
        Status and, where the probe slips, force, energy and power.

    Raises
    ------
    ContactError
        If the load is not positive, the friction negative, the angle outside [0, pi/2], or one of them not finite.

    References
    ----------
    Equation (1) of the paper: ``E_v = C_v F_px^2 / 2k``, ``F_px = F_py tan(a + atan mu)``.

    Examples
    --------
    >>> from stepblocks.contact.critical_angle import step_angle
    >>> release = release_at(step_angle(25e-6, 125e-6), normal_load=1.0, friction=0.15)
    >>> f"{release.pull_force:.3f} N, {release.vibration_energy * 1e6:.1f} uJ"
    '1.014 N, 10.5 uJ'
    >>> release_at(step_angle(100e-6, 125e-6), normal_load=1.0, friction=0.3).status
    <Status.LOCKED: 'locked'>
    """
    if not (math.isfinite(normal_load) and normal_load > 0.0):
        raise ContactError(f"normal_load must be positive and finite, got {normal_load:g} N")
    if not (math.isfinite(friction) and friction >= 0.0):
        raise ContactError(f"friction must be finite and not negative, got {friction:g}")
    if not 0.0 <= angle <= 0.5 * math.pi:
        raise ContactError(f"angle must lie between 0 and 90 deg, got {math.degrees(angle):g} deg")
    if angle == 0.0:
        return Release(Status.NO_CATCH, angle)
    if angle == 0.5 * math.pi:
        return Release(Status.TOO_HIGH, angle)
    if angle + math.atan(friction) >= 0.5 * math.pi:
        return Release(Status.LOCKED, angle)
    force = float(kernels.pull_force(normal_load, angle, friction))
    energy = tool.conversion * float(kernels.stored_energy(force, tool.stiffness))
    power = energy / tool.ring_duration
    return Release(Status.RELEASES, angle, force, energy, power, power / tool.detection_threshold)
