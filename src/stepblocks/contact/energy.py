"""Force and energy of a probe that slips over an edge, by equation (1).

The equation gives a locked probe an energy too; here such a probe has none.
"""

import math
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Any, Generic, Never, overload

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeVar

from stepblocks.contact import Array, kernels
from stepblocks.contact.domain import (
    Real,
    read_values,
    require_not_negative,
    require_positive,
    select_by_condition,
)
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import ContactError
from stepblocks.quantities import Measure


class Status(StrEnum):
    """What becomes of a probe at an edge.

    Attributes
    ----------
    RELEASES
        The tip climbs, slips and rings.
    LOCKED
        ``a + atan mu`` is a right angle or more: no pulling force lifts the tip.
    TOO_HIGH
        The step is as high as the ball or higher: the ball meets the riser, not the edge.
    RUN_OVER
        The tip comes in flight, or slides, and is not caught; in the drag in time alone.
    NO_CATCH
        The path of the ball's centre never rises in this direction.
    BEYOND_STRENGTH
        The slip takes more pull than the tool bears.
    BEYOND_SPRING
        The slip takes more pull than that up to which the spring is linear.
    BEYOND_GAUGE
        The slip takes more pull than the gauge shows.
    BEYOND_HAND
        The slip takes more pull than a hand exerts.
    """

    RELEASES = "releases"
    LOCKED = "locked"
    TOO_HIGH = "too-high"
    RUN_OVER = "run-over"
    NO_CATCH = "no-catch"
    BEYOND_STRENGTH = "beyond-strength"
    BEYOND_SPRING = "beyond-spring"
    BEYOND_GAUGE = "beyond-gauge"
    BEYOND_HAND = "beyond-hand"

    @classmethod
    def _missing_(cls, value: object) -> Never:
        """Refuse a value that is not a status; the message lists all statuses."""
        raise ContactError(f"status must be one of {', '.join(cls)}, got {value!r:.60}")

    @property
    def is_beyond_limit(self) -> bool:
        """Whether it is a limit, and no geometry, that keeps the tip from slipping."""
        return self in _BEYOND_LIMIT.values()


# by the name of the limit, see `Limits`
_BEYOND_LIMIT = {
    "strength": Status.BEYOND_STRENGTH,
    "spring": Status.BEYOND_SPRING,
    "gauge": Status.BEYOND_GAUGE,
    "hand": Status.BEYOND_HAND,
}

Statuses = TypeVar("Statuses", Status, NDArray[np.str_], default=Status)
Floats = TypeVar("Floats", float, Array, default=float)


@dataclass(frozen=True)
class Release(Generic[Statuses, Floats]):
    """What is felt when the probe slips over an edge.

    Of many drags at once, each field is an array over them.

    Attributes
    ----------
    status : Status or ndarray of str
        Whether the probe slips at all; the energies are not-a-number unless it does.
    angle : float or ndarray
        Critical angle a [rad].
    pull_force : float or ndarray
        Tangential force at release F_px [N]; beyond a limit, what it would take.
    vibration_energy : float or ndarray
        Energy of the ring E_v [J].
    mean_power : float or ndarray
        E_v over the duration of the ring [W].
    threshold_ratio : float or ndarray
        Mean power over the detection threshold [1].
    """

    status: Statuses
    angle: Floats
    pull_force: Floats
    vibration_energy: Floats
    mean_power: Floats
    threshold_ratio: Floats


@overload
def find_release(
    angle: Measure, normal_load: Measure, friction: Measure, tool: Tool = ...
) -> Release[Status, float]: ...
@overload
def find_release(
    angle: Real, normal_load: Real, friction: Real, tool: Tool = ...
) -> Release[NDArray[np.str_], Array]: ...
def find_release(
    angle: Real, normal_load: Real, friction: Real, tool: Tool = PAPER.tool
) -> Release[Any, Any]:
    """Force and energy at release for a critical angle.

    Parameters
    ----------
    angle, normal_load, friction : float, text with its unit, quantity of Pint, or array_like
        Critical angle a [rad], from 0 to a right angle; load F_py [N]; coefficient of friction mu
        [1].
    tool : Tool
        Spring, ring and limits of the explorer.

    Returns
    -------
    Release
        Status and, where the probe slips, force, energy and power; beyond a limit the force that it
        would take. One drag has a `Status` and floats, several have arrays of the shape to which
        the arguments broadcast, the status as text.

    Raises
    ------
    ContactError
        If the load is not positive, the friction negative, the angle outside [0, pi/2], or one of
        them not finite.

    References
    ----------
    Equation (1) of the paper: ``E_v = C_v F_px^2 / 2k``, ``F_px = F_py tan(a + atan mu)``.

    Examples
    --------
    >>> from stepblocks.contact.critical_angle import find_step_angle
    >>> release = find_release(find_step_angle(25e-6, 125e-6), normal_load=1.0, friction=0.15)
    >>> f"{release.pull_force:.3f} N, {release.vibration_energy * 1e6:.1f} uJ"
    '1.014 N, 10.5 uJ'
    >>> angles = find_step_angle([25e-6, 100e-6], 125e-6)
    >>> find_release(angles, normal_load=1.0, friction=0.3).status.tolist()
    ['releases', 'locked']
    """
    a = np.asarray(read_values("angle", angle, "angle"))[()]
    load = np.asarray(read_values("normal_load", normal_load, "force"))[()]
    mu = np.asarray(read_values("friction", friction, "ratio"))[()]
    require_positive("normal_load", load, "N")
    require_not_negative("friction", mu)
    _require_angles_up_to_right(a)
    geometry = _classify_geometry(a, mu)
    is_releasing = geometry == _Geometry.RELEASES
    climbed = select_by_condition(is_releasing, a, 0.0)
    pull = kernels.compute_pull_force(load, climbed, mu)
    no_force = math.nan * (a + load + mu)  # in the shape of all three
    force = select_by_condition(is_releasing, pull, no_force)
    limit = tool.limits.first
    is_beyond = is_releasing & (force > limit.force)
    stored = kernels.compute_stored_energy(force, tool.stiffness)
    energy = select_by_condition(is_beyond, math.nan, tool.conversion * stored)
    power = energy / tool.ring_duration
    threshold_ratio = power / tool.detection_threshold
    figures = (a, force, energy, power, threshold_ratio)
    statuses = (*_STATUSES, _BEYOND_LIMIT[limit.name])
    which = select_by_condition(is_beyond, len(_STATUSES), geometry)
    if np.ndim(force) == 0:
        return Release(statuses[which], *map(float, figures))
    return Release(*np.broadcast_arrays(np.array(statuses)[which], *figures))


class _Geometry(IntEnum):
    """What the geometry alone makes of a drag; the place of its status in `_STATUSES`."""

    NO_CATCH = 0
    TOO_HIGH = 1
    LOCKED = 2
    RELEASES = 3


_STATUSES = (Status.NO_CATCH, Status.TOO_HIGH, Status.LOCKED, Status.RELEASES)


def _require_angles_up_to_right(angle: Any) -> None:
    """Refuse an angle outside 0 to a right angle [rad]."""
    is_inside = (angle >= 0.0) & (angle <= 0.5 * math.pi)
    if is_inside.all():
        return
    outside = np.asarray(angle)[np.logical_not(is_inside)]
    degrees = np.degrees(outside.flat[0])
    raise ContactError(f"angle must lie between 0 and 90 deg, got {degrees:g} deg")


def _classify_geometry(angle: Any, friction: Any) -> Any:
    """Find the first `_Geometry` that holds, of a number or for each of an array."""
    is_locked = angle + np.arctan(friction) >= 0.5 * math.pi
    climbs = select_by_condition(is_locked, _Geometry.LOCKED, _Geometry.RELEASES)
    rises = select_by_condition(angle == 0.5 * math.pi, _Geometry.TOO_HIGH, climbs)
    return select_by_condition(angle == 0.0, _Geometry.NO_CATCH, rises)
