"""How much the energy of a release changes between two counterfaces."""

import math

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Release, Status
from stepblocks.contact.operating_point import OperatingPoint


def find_energy_change(
    before: Counterface | Release,
    after: Counterface | Release,
    point: OperatingPoint,
    backward: bool = False,
) -> float:
    """Relative change of the energy that is felt; NaN unless both release.

    Parameters
    ----------
    before, after : Counterface or Release
        Two counterfaces, dragged over under `point`, backward or not; or what was found over one.

    Returns
    -------
    float
        ``E_v(after) / E_v(before) - 1`` [1].

    Examples
    --------
    >>> from stepblocks.contact.counterface import Step
    >>> from stepblocks.contact.operating_point import PAPER
    >>> f"{find_energy_change(Step(25e-6), Step(26e-6), PAPER):+.1%}"
    '+5.4%'
    """
    first, second = (
        one.release(point, backward) if isinstance(one, Counterface) else one
        for one in (before, after)
    )
    if first.status is not Status.RELEASES or second.status is not Status.RELEASES:
        return math.nan
    return float(second.vibration_energy / first.vibration_energy - 1.0)
