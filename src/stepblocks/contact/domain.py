"""The domain of the formulas: values outside it, alone or in an array, are refused."""

import math
from dataclasses import fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import ContactError, QuantityError
from stepblocks.quantities import (
    DIMENSIONS,
    is_quantity,
    parse_quantity,
    read_array,
    unwrap_array_scalar,
)

Real = Any  # a float or an array of them: what is given decides what comes out
MOST_LENGTH = 1.0  # of anything on a bench [m]; more was read in a wrong unit
MOST_BALL = 0.05  # of the radius of a tip, magnified models included [m]


def format_changed_fields(value: Any) -> str:
    """Write a dataclass in a line, without the fields that have their default."""
    changed = []
    for field in fields(value):
        current = getattr(value, field.name)
        if current != field.default:
            changed.append(f"{field.name}={current!r}")
    return f"{type(value).__name__}({', '.join(changed)})"


def convert_fields_in_place(
    instance: object, lower_bound: float | None = None, **bounds: tuple[str, float]
) -> None:
    """Convert fields of a frozen dataclass in place: numbers in SI, or texts with their units.

    `bounds` has the dimension of each and the most that it may be; `lower_bound` is the least, and
    without
    it each must be positive.
    """
    for name, (dimension, high) in bounds.items():
        value = read_number(name, getattr(instance, name), dimension)
        _require_within_bounds(name, value, dimension, lower_bound, high)
        object.__setattr__(instance, name, value)


def _require_within_bounds(
    name: str, value: float, dimension: str, lower_bound: float | None, upper_bound: float
) -> None:
    """Refuse a value outside its bounds; without a lower one it must be positive."""
    unit = DIMENSIONS[dimension]
    if lower_bound is None:
        require_positive(name, value, unit)
    elif lower_bound == 0.0:
        require_not_negative(name, value, unit)
    else:
        require_finite(name, value, unit)
    if value <= upper_bound and (lower_bound is None or value >= lower_bound):
        return
    rule = (
        f"be at most {upper_bound:g}"
        if lower_bound is None
        else f"lie between {lower_bound:g} and {upper_bound:g}"
    )
    message = f"{name} must {rule} {unit}".rstrip() + f", got {value:g}"
    if dimension == "length":
        message += "; lengths are in metres: 25 um is 25e-6"
    raise ContactError(message)


def read_number(name: str, value: object, dimension: str) -> float:
    """Read a number in SI, or one with its unit: a text such as ``"25 um"``, or one of Pint."""
    value = unwrap_array_scalar(value)
    if isinstance(value, str) or is_quantity(value):
        try:
            return parse_quantity(value, dimension)
        except QuantityError as error:
            raise ContactError(f"{name} {error}") from error
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise ContactError(
            f"{name} must be one number [{DIMENSIONS[dimension] or '1'}], got "
            f"{type(value).__name__}"
        )
    try:
        return float(value)
    except OverflowError as error:
        raise ContactError(f"{name} must be at most 1.8e308, got a longer whole number") from error


def read_values(name: str, value: object, dimension: str) -> Real:
    """Read a number or an array of them in SI, in any form that `read_array` takes.

    One number comes back as a float, several as an array.
    """
    if isinstance(value, float) or (type(value) is np.ndarray and value.dtype == np.float64):
        return value
    try:
        return read_array(value, dimension)[()]
    except QuantityError as error:
        raise ContactError(f"{name} {error}") from error
    except (TypeError, ValueError) as error:
        raise ContactError(
            f"{name} must be numbers [{DIMENSIONS[dimension] or '1'}], got "
            f"{type(value).__name__}: {error}"
        ) from error


def require_positive(name: str, value: Real, unit: str = "") -> None:
    """Refuse a value that is not above 0, or not finite."""
    if isinstance(value, float) and 0.0 < value < math.inf:
        return  # mostly it is a single float, which needs no array
    is_good = np.isfinite(value) & (value > 0.0)
    _require_all(name, value, unit, is_good, "positive and finite")


def require_not_negative(name: str, value: Real, unit: str = "") -> None:
    """Refuse a value below 0, or not finite."""
    if isinstance(value, float) and 0.0 <= value < math.inf:
        return
    is_good = np.isfinite(value) & (value >= 0.0)
    _require_all(name, value, unit, is_good, "finite and not negative")


def require_finite(name: str, value: Real, unit: str = "") -> None:
    """Refuse a value that is not a number, or infinite."""
    _require_all(name, value, unit, np.isfinite(value), "finite")


def require_profile_points(x: NDArray[np.float64], z: NDArray[np.float64]) -> None:
    """Refuse a profile that is not two rows of one length, or whose positions do not ascend."""
    if x.ndim != 1 or x.shape != z.shape:
        raise ContactError(
            f"profile needs x and z of one equal length, got shapes {x.shape} and {z.shape}"
        )
    if x.size < 2:
        raise ContactError(f"profile needs at least 2 points, got {x.size}")
    falls = np.flatnonzero(np.diff(x) < 0.0)
    if falls.size:
        number = int(falls[0]) + 1
        raise ContactError(
            f"profile positions must not decrease, point {number} lies at {x[number]:g} m behind "
            f"{x[number - 1]:g} m; sort the points"
        )
    if x[-1] == x[0]:
        raise ContactError("profile must extend along x, got a single position")


def unwrap_scalar(value: Real) -> Real:
    """Return a Python float for an array of no dimension, any other array as it is."""
    if np.ndim(value) == 0:
        return float(value)
    return value


def select_by_condition(condition: Real, if_so: Real, otherwise: Real) -> Real:
    """Select as `numpy.where` does, without an array where the condition is a single one."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, if_so, otherwise)
    if condition:
        return if_so
    return otherwise


def _require_all(
    name: str, value: Real, unit: str, is_good: NDArray[np.bool_] | np.bool_, rule: str
) -> None:
    """Refuse values that are not all good; the message shows the first that is not."""
    if is_good.all():
        return
    wrong = np.asarray(value)[np.logical_not(is_good)]
    message = f"{name} must be {rule}, got {wrong.flat[0]:g} {unit}"
    raise ContactError(message.rstrip())


def read_profile_lengths(name: str, values: object) -> NDArray[np.float64]:
    """Read a row of finite lengths [m], none too large for a bench, as an array."""
    try:
        lengths: NDArray[np.float64] = np.ascontiguousarray(read_array(values, "length"))
    except QuantityError as error:
        raise ContactError(f"profile {name} {error}") from error
    except (TypeError, ValueError) as error:
        raise ContactError(
            f"profile {name} must be numbers [m], got {type(values).__name__}: {error}"
        ) from error
    if lengths.ndim == 1 and lengths.size:  # else `require_profile_points` refuses it
        _require_profile_lengths(name, lengths)
    return lengths


def _require_profile_lengths(name: str, lengths: NDArray[np.float64]) -> None:
    """Refuse lengths [m] that are not finite, or too large for a bench."""
    wrong = np.flatnonzero(~np.isfinite(lengths))
    if wrong.size:
        first = int(wrong[0])
        raise ContactError(
            f"profile {name} must be finite, point {first} of {lengths.size} is "
            f"{lengths[first]}; Profile.from_scan bridges points that were not measured"
        )
    greatest = float(np.abs(lengths).max())
    if greatest > MOST_LENGTH:
        raise ContactError(
            f"profile {name} must lie within {MOST_LENGTH:g} m, got {greatest:g} m; lengths are in "
            "metres: 25 um is 25e-6"
        )


class Scanned(Protocol):
    """A profile as an instrument measured it."""

    @property
    def position(self) -> NDArray[np.float64]:
        """Positions [m]."""

    @property
    def height(self) -> NDArray[np.float64]:
        """Heights [m], NaN where nothing was measured."""
