"""Nominal values with their permitted deviations, and the general tolerances of ISO 2768-1."""

import math
import numbers
import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, NamedTuple, cast

from pydantic import BeforeValidator, ValidationInfo

from stepblocks.errors import QuantityError
from stepblocks.quantities import format_quantity, parse_quantity


class _Range(NamedTuple):
    """Sizes that a bench can have, in SI, besides zero."""

    least: float
    largest: float


# beyond lies a slip of the unit; 10 nm are neither cut nor measured
_SENSIBLE = {
    "length": _Range(10e-9, 1.0),
    "force": _Range(1e-6, 1e3),
    "stiffness": _Range(1e-3, 1e9),
    "time": _Range(1e-9, 10.0),
    "frequency": _Range(0.01, 1e7),
    "pressure": _Range(1.0, 1e13),
    "density": _Range(0.1, 1e5),
    "ratio": _Range(1e-9, 1e6),
}
_ANYTHING = _Range(0.0, math.inf)

# guard band over standard uncertainty at 95 % conformance probability (ISO 14253-1:2017, 5.3) [1]
GUARD_FACTOR = 1.65


class _GeneralTolerance(NamedTuple):
    """A row of ISO 2768-1:1989, table 1, class m [m]."""

    up_to: float
    deviation: float


_LEAST_GENERAL_LENGTH = 0.5e-3  # below, tolerances are stated [m]
_GENERAL_TOLERANCES = (
    _GeneralTolerance(3e-3, 0.1e-3),
    _GeneralTolerance(6e-3, 0.1e-3),
    _GeneralTolerance(30e-3, 0.2e-3),
    _GeneralTolerance(120e-3, 0.3e-3),
    _GeneralTolerance(400e-3, 0.5e-3),
)
# ISO 2768-1:1989, table 3 (angles), shorter side up to 10 mm, classes f and m [rad]
ANGULAR_DEVIATION = math.radians(1.0)


class Origin(Enum):
    """Who declares a part: a file must give every number its unit, Python's numbers are in SI."""

    FILE = "file"
    PYTHON = "Python"


def find_declared_origin(info: ValidationInfo) -> Origin:
    """Return who declares what pydantic validates; it is a file where nobody says."""
    if info.context is Origin.PYTHON:
        return Origin.PYTHON
    return Origin.FILE


def parse_declared_quantity(raw: object, quantity: str, origin: Origin) -> float:
    """Read a quantity in SI; a number without a unit is allowed from Python alone.

    Raises
    ------
    QuantityError
        If it is no such quantity, or not finite.
    """
    is_number = isinstance(raw, numbers.Real) and not isinstance(raw, bool)
    if origin is Origin.FILE or not is_number:
        return parse_quantity(raw, quantity)
    value = float(cast(float, raw))
    if not math.isfinite(value):
        raise QuantityError(f"must be finite, got {value}")
    return value


def parse_plausible_quantity(raw: object, quantity: str, origin: Origin = Origin.FILE) -> float:
    """Read a quantity in SI and check that its size is plausible on a bench.

    Raises
    ------
    QuantityError
        If the text is no such quantity, or its value is implausibly small or large.
    """
    value = parse_declared_quantity(raw, quantity, origin)
    sensible = _SENSIBLE.get(quantity, _ANYTHING)
    if abs(value) > sensible.largest:
        largest = format_quantity(sensible.largest, quantity)
        raise QuantityError(f"must not exceed {largest}, got {raw!r:.60}")
    if value != 0.0 and abs(value) < sensible.least:
        least = format_quantity(sensible.least, quantity)
        raise QuantityError(f"must be 0 or at least {least}, got {raw!r:.60}")
    return value


@dataclass(frozen=True)
class Dimension:
    """A nominal value with its limits.

    Attributes
    ----------
    nominal : float
        Nominal value [m or rad].
    upper, lower : float
        Permitted deviations, signed; `lower` is at most `upper` [m or rad].
    quantity : str
        ``"length"`` or ``"angle"``.
    source : str
        Where the nominal value comes from; empty where the file does not say.
    usual : bool
        Whether the deviations are the defaults of this program, because none are stated.
    general : bool
        Whether the deviations are the general ones of ISO 2768-1, because none are stated.
    by_feel : bool
        Whether the deviations follow from what the part's ring may change by.

    Raises
    ------
    QuantityError
        If `lower` exceeds `upper`.
    """

    nominal: float
    upper: float
    lower: float
    quantity: str = "length"
    source: str = ""
    usual: bool = False
    general: bool = False
    by_feel: bool = False

    def __post_init__(self) -> None:
        if not self.lower <= self.upper:
            raise QuantityError(
                "lower deviation must not exceed upper deviation, "
                f"got {self.lower:g} and {self.upper:g}"
            )

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit of the dimension itself [m or rad]."""
        return self.nominal + self.lower, self.nominal + self.upper

    @property
    def tolerance_origin(self) -> str:
        """Where the deviations come from: the standard, the program or the file."""
        if self.by_feel:
            return "by feel"
        if self.general:
            return "ISO 2768-m"
        if self.usual:
            return "default"
        return "stated"

    def record(self) -> dict[str, object]:
        """Return plain values for JSON, the unit in the names."""
        unit = "rad" if self.quantity == "angle" else "m"
        fields: dict[str, object] = {
            f"nominal_{unit}": self.nominal,
            f"upper_deviation_{unit}": self.upper,
            f"lower_deviation_{unit}": self.lower,
            "tolerance": self.tolerance_origin,
        }
        if self.source:
            fields["source"] = self.source
        return fields

    def __str__(self) -> str:
        nominal = format_quantity(self.nominal, self.quantity)
        if self.upper == -self.lower:
            return f"{nominal} ±{format_quantity(self.upper, self.quantity)}"
        upper = _format_deviation(self.upper, self.quantity)
        lower = _format_deviation(self.lower, self.quantity)
        return f"{nominal} {upper}/{lower}"


def _format_deviation(deviation: float, quantity: str) -> str:
    """Write a deviation with its sign, which zero has none of."""
    text = format_quantity(deviation + 0.0, quantity)
    if deviation > 0.0:
        return f"+{text}"
    return text


def find_general_deviation(nominal_length: float) -> float | None:
    """Find the deviation of ISO 2768-m for a length [m]; None below 0.5 mm, above 400 mm."""
    if nominal_length < _LEAST_GENERAL_LENGTH:
        return None
    for row in _GENERAL_TOLERANCES:
        if nominal_length <= row.up_to:
            return row.deviation
    return None


class _Deviations(NamedTuple):
    """Signed deviations of a dimension [m or rad]."""

    upper: float
    lower: float


_DEVIATIONS = re.compile(r"^\s*(?P<upper>[+-]?[^/]+)/(?P<lower>[+-]?[^/]+)$")


def _read_deviations(raw: object, quantity: str, origin: Origin) -> _Deviations:
    """Read ``"1 um"`` (to either side) or ``"+2 um / -0 um"``."""
    match = _DEVIATIONS.match(raw) if isinstance(raw, str) else None
    if match is not None:
        upper = parse_quantity(match["upper"], quantity)
        lower = parse_quantity(match["lower"], quantity)
    else:
        upper = parse_declared_quantity(raw, quantity, origin)
        if not upper > 0.0:
            raise QuantityError(f"tolerance must be positive, got {raw!r}")
        lower = -upper
    if not lower < upper:
        raise QuantityError(
            f"tolerance must have its upper deviation above the lower one, got {raw!r:.60}"
        )
    largest = _SENSIBLE.get(quantity, _ANYTHING).largest
    if lower < -largest or upper > largest:
        raise QuantityError(
            f"tolerance must not exceed {format_quantity(largest, quantity)}, got {raw!r:.60}"
        )
    return _Deviations(upper, lower)


def _read_dimension(raw: object, quantity: str, origin: Origin) -> Dimension:
    """Read a dimension from a quantity, or a table with nominal, tolerance and source.

    Where no tolerance is stated it is the general one of ISO 2768-m, or what ``otherwise`` says.
    """
    table: dict[str, object] = raw if isinstance(raw, dict) else {"nominal": raw}
    nominal_raw = table.get("nominal")
    if isinstance(nominal_raw, Dimension):
        return nominal_raw
    _refuse_wrong_dimension_fields(table)
    nominal = parse_plausible_quantity(nominal_raw, quantity, origin)
    source = table.get("source", "")
    if not isinstance(source, str):
        raise ValueError(f"source must be text, got {source!r}")
    if "tolerance" in table:
        stated = _read_deviations(table["tolerance"], quantity, origin)
        return Dimension(nominal, stated.upper, stated.lower, quantity, source)
    general: float | None = ANGULAR_DEVIATION
    if quantity != "angle":
        general = find_general_deviation(abs(nominal))
    if general is not None:
        return Dimension(nominal, general, -general, quantity, source, general=True)
    if "otherwise" in table:
        usual = _read_deviations(table["otherwise"], quantity, origin)
        return Dimension(nominal, usual.upper, usual.lower, quantity, source, usual=True)
    raise ValueError(
        "a tolerance must be stated: general tolerances (ISO 2768-m) do not cover "
        f"{format_quantity(nominal, quantity)}"
    )


def _refuse_wrong_dimension_fields(table: dict[str, object]) -> None:
    """Refuse a table that has unknown names or no nominal value."""
    mistake = ""
    unknown = set(table) - {"nominal", "tolerance", "otherwise", "source"}
    if unknown:
        mistake = f"unknown {', '.join(sorted(unknown))}"
    elif "nominal" not in table:
        mistake = "nominal is missing"
    if mistake:
        raise ValueError(f"a dimension has nominal, tolerance and source: {mistake}")


def _make_dimension_validator(
    quantity: str, *, accepts_nominal: Callable[[float], bool] | None = None, rule: str = ""
) -> BeforeValidator:
    """Make a validator of a dimension whose nominal value must be accepted; `rule` says when."""

    def read_accepted_dimension(raw: object, info: ValidationInfo) -> Dimension:
        """Read a dimension, and refuse one whose nominal value is not accepted."""
        dimension = _read_dimension(raw, quantity, find_declared_origin(info))
        if accepts_nominal is None:
            return dimension
        nominal = dimension.nominal
        if not accepts_nominal(nominal):
            raise QuantityError(f"must {rule}, got {format_quantity(nominal, quantity)}")
        if quantity == "length" and 0.0 < nominal < -dimension.lower:
            raise ValueError(
                f"tolerance must not exceed the nominal {format_quantity(nominal, quantity)}, got "
                f"-{format_quantity(-dimension.lower, quantity)}"
            )
        return dimension

    return BeforeValidator(read_accepted_dimension)


def _is_not_negative(nominal: float) -> bool:
    """Tell whether a nominal value is 0 or positive."""
    return nominal >= 0.0


def _is_positive(nominal: float) -> bool:
    """Tell whether a nominal value is positive."""
    return nominal > 0.0


def _is_angle_below_pi(angle: float) -> bool:
    """Tell whether an angle [rad] is from 0 to below pi."""
    return 0.0 <= angle < math.pi


Length = Annotated[
    Dimension,
    _make_dimension_validator("length", accepts_nominal=_is_not_negative, rule="not be negative"),
]
PositiveLength = Annotated[
    Dimension, _make_dimension_validator("length", accepts_nominal=_is_positive, rule="be positive")
]
SignedLength = Annotated[Dimension, _make_dimension_validator("length")]
Angle = Annotated[
    Dimension,
    _make_dimension_validator(
        "angle", accepts_nominal=_is_angle_below_pi, rule="be at least 0 and less than 180 deg"
    ),
]
