"""How much the energy of a release changes between two counterfaces."""

import math

from stepblocks.contact.counterface import Counterface, convert_to_counterface
from stepblocks.contact.domain import Scanned
from stepblocks.contact.energy import Release, Status
from stepblocks.contact.operating_point import OperatingPoint


def find_energy_change(
    before: Counterface | Scanned | Release,
    after: Counterface | Scanned | Release,
    point: OperatingPoint,
    backward: bool = False,
) -> float:
    """Relative change of the energy that is felt; NaN unless both release.

    Parameters
    ----------
    before, after : Counterface, ScannedProfile or Release
        Two counterfaces or scanned profiles, dragged over under `point`, backward or not; or what
        was found over one.

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
    first = _get_release_over_surface(before, point, backward)
    second = _get_release_over_surface(after, point, backward)
    if first.status is not Status.RELEASES or second.status is not Status.RELEASES:
        return math.nan
    return float(second.vibration_energy / first.vibration_energy - 1.0)


def _get_release_over_surface(
    surface: Counterface | Scanned | Release, point: OperatingPoint, backward: bool
) -> Release:
    """Return the release over a surface; a release is returned as it is."""
    if isinstance(surface, Release):
        return surface
    return convert_to_counterface(surface).release(point, backward)
