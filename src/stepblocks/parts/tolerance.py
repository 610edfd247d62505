"""Nominal values with their permitted deviations, and the general tolerances of ISO 2768-1."""

import math
import re
from dataclasses import dataclass
from typing import Annotated

from pydantic import BeforeValidator

from stepblocks.errors import QuantityError
from stepblocks.quantities import format_quantity, parse_quantity

# What a bench has unless it is zero, in SI: beyond lies a slip of the unit; 10 nm are neither cut
# nor measured
_SENSIBLE = {
    "length": (10e-9, 1.0),
    "force": (1e-6, 1e3),
    "stiffness": (1e-3, 1e9),
    "time": (1e-9, 10.0),
    "frequency": (0.01, 1e7),
    "pressure": (1.0, 1e13),
    "density": (0.1, 1e5),
    "ratio": (1e-9, 1e6),
}

# guard band over standard uncertainty at 95 % conformance probability (ISO 14253-1:2017, 5.3) [1]
GUARD_FACTOR = 1.65

# ISO 2768-1:1989, table 1 (linear dimensions, from 0.5 mm): up to, permissible deviation of class m
# [m]
_LINEAR = ((3e-3, 0.1e-3), (6e-3, 0.1e-3), (30e-3, 0.2e-3), (120e-3, 0.3e-3), (400e-3, 0.5e-3))
# ISO 2768-1:1989, table 3 (angles), shorter side up to 10 mm, classes f and m.
ANGULAR_DEVIATION = math.radians(1.0)


def parse_sensible(raw: object, quantity: str) -> float:
    """Read a quantity of a size that a bench can have."""
    value = parse_quantity(raw, quantity)
    least, largest = _SENSIBLE.get(quantity, (0.0, math.inf))
    QuantityError.require(
        abs(value) <= largest,
        f"must not exceed {format_quantity(largest, quantity)}, got {raw!r:.60}",
    )
    QuantityError.require(
        value == 0.0 or abs(value) >= least,
        f"must be 0 or at least {format_quantity(least, quantity)}, got {raw!r:.60}",
    )
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

    Raises
    ------
    QuantityError
        If `lower` exceeds `upper`.
    """

    nominal: float
    upper: float
    lower: float
    quantity: str = "length"  # ``"length"`` or ``"angle"``
    source: str = ""
    usual: bool = False
    general: bool = False

    def __post_init__(self) -> None:
        QuantityError.require(
            self.lower <= self.upper,
            "lower deviation must not exceed upper deviation, "
            f"got {self.lower:g} and {self.upper:g}",
        )

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit of the dimension itself [m or rad]."""
        return self.nominal + self.lower, self.nominal + self.upper

    def record(self) -> dict[str, object]:
        """Return plain values for JSON, the unit in the names."""
        unit = "rad" if self.quantity == "angle" else "m"

        origins = {
            "ISO 2768-m": self.general,
            "default": self.usual,
            "stated": True,
        }
        fields: dict[str, object] = {
            f"nominal_{unit}": self.nominal,
            f"upper_deviation_{unit}": self.upper,
            f"lower_deviation_{unit}": self.lower,
            "tolerance": next(origin for origin, holds in origins.items() if holds),
        }
        return {**fields, "source": self.source} if self.source else fields

    def __str__(self) -> str:
        text = format_quantity(self.nominal, self.quantity)
        if self.upper == -self.lower:
            return f"{text} ±{format_quantity(self.upper, self.quantity)}"
        signed = (  # no zero keeps a sign
            ("+" if one > 0.0 else "") + format_quantity(one + 0.0, self.quantity)
            for one in (self.upper, self.lower)
        )
        return f"{text} {'/'.join(signed)}"


def find_general_deviation(nominal: float) -> float | None:
    """Find the deviation of ISO 2768-m for a length [m]; None below 0.5 mm, above 400 mm."""
    return next((deviation for high, deviation in _LINEAR if 0.5e-3 <= nominal <= high), None)


_DEVIATIONS = re.compile(r"^\s*(?P<upper>[+-]?[^/]+)/(?P<lower>[+-]?[^/]+)$")


def _read_deviations(raw: object, quantity: str) -> tuple[float, float]:
    # Read ``"1 um"`` (to either side) or ``"+2 um / -0 um"``
    if isinstance(raw, str) and (match := _DEVIATIONS.match(raw)):
        upper, lower = (
            parse_quantity(match["upper"], quantity),
            parse_quantity(match["lower"], quantity),
        )
    else:
        upper = parse_quantity(raw, quantity)
        QuantityError.require(upper > 0.0, f"tolerance must be positive, got {raw!r}")
        lower = -upper
    largest = _SENSIBLE.get(quantity, (0.0, math.inf))[1]
    QuantityError.require(
        -largest <= lower < upper <= largest,
        "tolerance must have its upper deviation above the lower one, within sense, got "
        f"{raw!r:.60}",
    )
    return upper, lower


def _read_dimension(raw: object, quantity: str) -> Dimension:
    table: dict[str, object] = raw if isinstance(raw, dict) else {"nominal": raw}
    if isinstance(given := table.get("nominal"), Dimension):
        return given
    unknown = set(table) - {"nominal", "tolerance", "otherwise", "source"}
    if unknown or "nominal" not in table:
        what = f"unknown {', '.join(sorted(unknown))}" if unknown else "nominal is missing"
        raise ValueError(f"a dimension has nominal, tolerance and source: {what}")
    nominal = parse_sensible(table["nominal"], quantity)
    source = table.get("source", "")
    if not isinstance(source, str):
        raise ValueError(f"source must be text, got {source!r}")
    if "tolerance" in table:
        return Dimension(nominal, *_read_deviations(table["tolerance"], quantity), quantity, source)
    general = ANGULAR_DEVIATION if quantity == "angle" else find_general_deviation(abs(nominal))
    if general is not None:
        return Dimension(nominal, general, -general, quantity, source, general=True)
    if "otherwise" in table:
        return Dimension(
            nominal, *_read_deviations(table["otherwise"], quantity), quantity, source, usual=True
        )
    raise ValueError(
        "a tolerance must be stated: general tolerances (ISO 2768-m) do not cover "
        f"{format_quantity(nominal, quantity)}"
    )


def _make_validator(quantity: str, rule: str = "", *, above: bool = False) -> BeforeValidator:
    # Make a validator of a dimension. With a rule it must be at least, or above, 0; an angle is
    # below 180 degrees.
    least = 0.0 if rule else -math.inf

    def read(raw: object) -> Dimension:
        dimension = _read_dimension(raw, quantity)
        value = dimension.nominal
        QuantityError.require(
            (value > least if above else value >= least)
            and (quantity != "angle" or value < math.pi),
            f"must {rule}, got {format_quantity(value, quantity)}",
        )
        if quantity == "length" and least == 0.0 < value < -dimension.lower:
            raise ValueError(
                f"tolerance must not exceed the nominal {format_quantity(value, 'length')}, got "
                f"-{format_quantity(-dimension.lower, 'length')}"
            )
        return dimension

    return BeforeValidator(read)


Length = Annotated[Dimension, _make_validator("length", "not be negative")]
PositiveLength = Annotated[Dimension, _make_validator("length", "be positive", above=True)]
SignedLength = Annotated[Dimension, _make_validator("length")]
Angle = Annotated[Dimension, _make_validator("angle", "be at least 0 and less than 180 deg")]
