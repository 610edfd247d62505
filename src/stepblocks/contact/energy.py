"""Force and energy of a probe that slips over an edge, by equation (1).

The equation gives a locked probe an energy too; here such a probe has none.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Generic, Never, overload

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeVar

from stepblocks.contact import Array, kernels
from stepblocks.contact.domain import Real, require_not_negative, require_positive, select_where
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import ContactError


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

    RELEASES = "releases"  # it climbs, slips and rings
    LOCKED = "locked"  # ``a + atan mu`` is a right angle or more: no pulling force lifts it
    # the step is as high as the ball or higher: the ball meets the riser, not the edge
    TOO_HIGH = "too-high"
    # the tip comes in flight, or slides, and is not caught; in the drag in time alone
    RUN_OVER = "run-over"
    NO_CATCH = "no-catch"  # the path of the ball's centre never rises in this direction
    BEYOND_STRENGTH = "beyond-strength"  # the pull that it takes is more than the tool bears,
    BEYOND_SPRING = "beyond-spring"  # than its spring is linear to,
    BEYOND_GAUGE = "beyond-gauge"  # than the gauge shows,
    BEYOND_HAND = "beyond-hand"  # or than a hand exerts

    @classmethod
    def _missing_(cls, value: object) -> Never:
        raise ContactError(f"status must be one of {', '.join(cls)}, got {value!r:.60}")

    @property
    def is_beyond_limit(self) -> bool:
        """Whether it is a limit, and no geometry, that keeps the tip from slipping."""
        return self.value.startswith("beyond-")


_KINDS = (Status.NO_CATCH, Status.TOO_HIGH, Status.LOCKED, Status.RELEASES)


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
    angle: float, normal_load: float, friction: float, tool: Tool = ...
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
    angle, normal_load, friction : float or array_like
        Critical angle a [rad], from 0 to a right angle; load F_py [N]; coefficient of friction mu
        [1].
    tool : Tool
        Spring, ring and limits of the explorer; the default has no limits.

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
    a, load, mu = (
        np.asarray(value, dtype=np.float64)[()] for value in (angle, normal_load, friction)
    )
    require_positive("normal_load", load, "N")
    require_not_negative("friction", mu)
    inside = (a >= 0.0) & (a <= 0.5 * math.pi)
    if not inside.all():
        wrong = np.degrees(np.asarray(a)[np.logical_not(inside)].flat[0])
        raise ContactError(f"angle must lie between 0 and 90 deg, got {wrong:g} deg")
    # the first of these that holds
    kind = select_where(
        a == 0.0,
        0,
        select_where(a == 0.5 * math.pi, 1, select_where(a + np.arctan(mu) >= 0.5 * math.pi, 2, 3)),
    )
    released = kind == 3
    force = select_where(
        released,
        kernels.compute_pull_force(load, select_where(released, a, 0.0), mu),
        math.nan * (a + load + mu),
    )
    limit, most = tool.limits.first
    beyond = released & (force > most)
    energy = select_where(
        beyond, math.nan, tool.conversion * kernels.compute_stored_energy(force, tool.stiffness)
    )
    power = energy / tool.ring_duration
    figures = (a, force, energy, power, power / tool.detection_threshold)
    kinds = (*_KINDS, Status(f"beyond-{limit}"))
    kind = select_where(beyond, len(_KINDS), kind)
    if np.ndim(force) == 0:
        return Release(kinds[kind], *map(float, figures))
    return Release(*np.broadcast_arrays(np.array(kinds)[kind], *figures))
