"""Dimensions and tolerances as a STEP file states them."""

import math
from dataclasses import dataclass
from enum import StrEnum


class Problem(StrEnum):
    """What is wrong with a dimension or tolerance itself."""

    NONE = ""
    NO_VALUE = "no value"
    LIMITS_WITHOUT_VALUE = "limits without a value"
    LIMITS_OF_OTHER_UNIT = "limits in another kind of unit than the value"
    LIMITS_NOT_IN_ORDER = "limits are not in order"
    PLANES_NOT_PARALLEL = "names planes that are not parallel"
    ZONE_NOT_POSITIVE = "zone must be positive"


@dataclass(frozen=True)
class DisplayUnit:
    """Unit of a table or message."""

    name: str
    per_si: float  # how many make one of the SI

    def format_value(self, value: float) -> str:
        """Write a value [m or rad] with nine digits and the unit."""
        return f"{value * self.per_si:.9g} {self.name}"


MILLIMETRE = DisplayUnit("mm", 1e3)
DEGREE = DisplayUnit("deg", 180.0 / math.pi)


@dataclass(frozen=True)
class Characteristic:
    """One dimension or tolerance.

    Attributes
    ----------
    ref : str
        Its instance.
    kind : str
        ``diameter``, ``linear distance``, ``flatness``, ...
    name : str
        Name or description in the file.
    value : float
        Nominal of a dimension, zone of a tolerance [m or rad].
    lower, upper : float
        Signed deviations [m or rad]; nan where the file states none.
    unit : str
        Unit in the file.
    faces : tuple of str
        Faces that it names.
    geometry : float or None
        Value by those faces [m or rad]; None where they do not determine it.
    datums : tuple of str
        Letters of the datums that a tolerance refers to.
    angular : bool
        Whether value and limits are angles.
    problem : Problem
        What is wrong with it, apart from its faces.
    """

    ref: str
    kind: str
    name: str
    value: float
    lower: float
    upper: float
    unit: str
    faces: tuple[str, ...]
    geometry: float | None = None
    datums: tuple[str, ...] = ()
    angular: bool = False
    problem: Problem = Problem.NONE

    @property
    def deviation(self) -> float | None:
        """Geometry minus value [m or rad]."""
        if self.geometry is None:
            return None
        return self.geometry - self.value

    @property
    def display_unit(self) -> DisplayUnit:
        """Unit in which a table or a message shows it."""
        return choose_display_unit(self.angular)

    @property
    def number(self) -> int:
        """Number of the instance, by which characteristics are sorted."""
        return int(self.ref[1:])


def choose_display_unit(is_angle: bool) -> DisplayUnit:
    """Return the unit in which an angle or a length is shown."""
    return DEGREE if is_angle else MILLIMETRE


def read_optional_text(parameter: object) -> str:
    """Return a text parameter; empty where the file leaves it out."""
    if parameter is None or parameter in ("$", "*"):
        return ""
    return str(parameter)
