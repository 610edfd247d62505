"""The domain of the formulas: one wording for every value that lies outside it, alone or in an array."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import ContactError

Real = Any  # a float or an array of them: what is given decides what comes out


def require_positive(name: str, value: Real, unit: str = "") -> None:
    """Refuse a value that is not above 0, or not finite."""
    if not (
        isinstance(value, float) and 0.0 < value < math.inf
    ):  # mostly a single float, which needs no array
        _require(name, value, unit, np.isfinite(value) & (value > 0.0), "positive and finite")


def require_not_negative(name: str, value: Real, unit: str = "") -> None:
    """Refuse a value below 0, or not finite."""
    if not (isinstance(value, float) and 0.0 <= value < math.inf):
        _require(name, value, unit, np.isfinite(value) & (value >= 0.0), "finite and not negative")


def require_finite(name: str, value: Real, unit: str = "") -> None:
    """Refuse a value that is not a number, or infinite."""
    _require(name, value, unit, np.isfinite(value), "finite")


def require_points(x: NDArray[np.float64], z: NDArray[np.float64]) -> None:
    """Refuse a profile that is not two rows of one length."""
    if x.ndim != 1 or x.shape != z.shape:
        raise ContactError(
            f"profile needs x and z of one equal length, got shapes {x.shape} and {z.shape}"
        )
    if x.size < 2:
        raise ContactError(f"profile needs at least 2 points, got {x.size}")


def unwrap_scalar(value: Real) -> Real:
    """Return a Python float for an array of no dimension, any other array as it is."""
    return float(value) if np.ndim(value) == 0 else value


def select_where(condition: Real, if_so: Real, otherwise: Real) -> Real:
    """`numpy.where`, at once where the condition is a single one."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, if_so, otherwise)
    return if_so if condition else otherwise


def _require(name: str, value: Real, unit: str, good: Any, rule: str) -> None:
    if not good.all():
        first = np.asarray(value)[np.logical_not(good)].flat[0]
        raise ContactError(f"{name} must be {rule}, got {first:g}{unit and ' ' + unit}")
