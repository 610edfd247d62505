"""Units of length as instruments and users write them."""

import re
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError

# How many of each unit make one metre
UNITS_PER_METRE = {
    "pm": 1e12,
    "å": 1e10,
    "nm": 1e9,
    "um": 1e6,
    "µm": 1e6,
    "μm": 1e6,
    "mm": 1e3,
    "cm": 1e2,
    "m": 1.0,
    "nanometer": 1e9,
    "micrometer": 1e6,
    "micron": 1e6,
    "microns": 1e6,
    "millimeter": 1e3,
    "meter": 1.0,
    "angstrom": 1e10,
    "Å": 1e10,
    "\u212b": 1e10,
    "in": 1.0 / 25.4e-3,
    "inch": 1.0 / 25.4e-3,
    "mil": 1.0 / 25.4e-6,
    "uin": 1.0 / 25.4e-9,
    "µin": 1.0 / 25.4e-9,
    "μin": 1.0 / 25.4e-9,
}
# The longest first: an alternation takes the first that matches
UNIT_PATTERN = "(" + "|".join(sorted(UNITS_PER_METRE, key=len, reverse=True)) + ")"
_UNIT_OF_AXIS = re.compile(rf"(?:([xyz])\s*=)?\s*(\d+\.?\d*|\.\d+)?\s*{UNIT_PATTERN}")

Length = TypeVar("Length", float, NDArray[np.float64])


@dataclass(frozen=True)
class StoredLength:
    """Length that a stored 1 stands for, such as ``0.5 um``.

    Attributes
    ----------
    number : float
        The number before the unit [1].
    per_metre : float
        How many of the unit make one metre [1/m].
    is_step : bool
        Whether a number was stated for one axis alone, such as the spacing of a matrix.
    """

    number: float
    per_metre: float
    is_step: bool = field(default=False, compare=False)

    @property
    def metres(self) -> float:
        """The length of a stored 1 [m]."""
        return self.number / self.per_metre

    def to_metres(self, stored: Length) -> Length:
        """Convert stored numbers to metres."""
        return stored * self.number / self.per_metre


def parse_units(unit: str | None) -> dict[str, StoredLength]:
    """Read the unit that a user states for a file.

    Parameters
    ----------
    unit : str or None
        One unit for all axes (``um``, ``0.5 um``), or one for each (``x=mm,z=um``); case does not
        matter.

    Returns
    -------
    dict of str to StoredLength
        By axis: ``x``, ``y``, ``z``; empty where nothing is stated.

    Raises
    ------
    MetrologyError
        If a unit is unknown, or the number before it is zero.

    Examples
    --------
    >>> parse_units("x=0.5um,y=0.5um,z=nm")["x"].metres
    5e-07
    """
    units: dict[str, StoredLength] = {}
    if not unit:
        return units
    for entry in unit.split(","):
        match = _UNIT_OF_AXIS.fullmatch(entry.strip().lower())
        if match is None:
            raise _make_unit_error(unit)
        axis, number, name = match.groups()
        is_step = bool(axis) and number is not None
        length = StoredLength(float(number or 1.0), UNITS_PER_METRE[name], is_step)
        if length.number == 0.0:
            raise _make_unit_error(unit)
        if axis:
            units[axis] = length
        else:
            units.update(dict.fromkeys("xyz", length))
    return units


def _make_unit_error(unit: str) -> MetrologyError:
    """Make the error of a unit that is not known."""
    return MetrologyError(
        f"unit must be one of nm, um, mm, m, in, mil, uin, or by axis as x=mm,z=um, got {unit!r}"
    )
