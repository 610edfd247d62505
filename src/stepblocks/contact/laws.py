"""Laws of friction and of the contact as objects, for the drag in time and, at rest, for the equations."""

from __future__ import annotations

import ctypes
import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.errors import ContactError

MODULUS, POISSON = 210e9, 0.3  # of steel [Pa], [1]
_SPEEDS = (0.0, 1e-6, 5e-3, 0.5)  # at which a law is tried before a drag [m/s]


class FrictionLaw(ABC):
    """Coefficient of friction of the tip: a subclass that has `coefficient` is a law.

    A law is given as ``friction=`` to `drag_over` and to `OperatingPoint`. Equation (1) takes its
    value at rest, because the tip is at rest when it releases; the drag in time takes its value at
    every step. The laws below run at the speed of compiled code, a subclass of your own at that of
    Python.
    """

    @abstractmethod
    def coefficient(self, speed: float, load: float, place: float, time: float) -> float:
        """Return the coefficient [1] at a speed of sliding [m/s], a normal force [N], x [m] and t [s]."""

    def compile(self) -> Callable[[float, float, float, float], float]:
        """Return what the integrator calls at each step."""
        return _compile(self.coefficient, 4)


@dataclass(frozen=True)
class Coulomb(FrictionLaw):
    """Friction that depends on nothing.

    Attributes
    ----------
    sliding : float
        Coefficient [1].
    """

    sliding: float

    def __post_init__(self) -> None:
        require_not_negative("sliding", self.sliding)

    def coefficient(self, speed: float, load: float, place: float, time: float) -> float:
        """Return `sliding`."""
        return self.sliding


@dataclass(frozen=True)
class Stribeck(FrictionLaw):
    """Friction that falls from rest to sliding and rises with the speed.

    Attributes
    ----------
    sliding : float
        Coefficient while sliding [1].
    static : float
        Coefficient at rest, not less than `sliding` [1].
    stribeck_speed : float
        Speed over which it falls to 1/e of the difference [m/s].
    viscous : float
        Rise of the coefficient per speed [s/m].
    """

    sliding: float
    static: float
    stribeck_speed: float = 1e-3
    viscous: float = 0.0

    def __post_init__(self) -> None:
        require_positive("stribeck_speed", self.stribeck_speed, "m/s")
        for name in ("sliding", "viscous"):
            require_not_negative(name, getattr(self, name))
        if not self.sliding <= self.static < math.inf:
            raise ContactError(
                f"static must be finite and not less than sliding ({self.sliding:g}), "
                f"got {self.static:g}"
            )

    def coefficient(self, speed: float, load: float, place: float, time: float) -> float:
        """Return ``mu_k + (mu_s - mu_k) exp(-v / v_s) + c v``."""
        v = abs(speed)
        fall = (self.static - self.sliding) * math.exp(-v / self.stribeck_speed)
        return self.sliding + fall + self.viscous * v


@dataclass(frozen=True)
class FrictionFunction(FrictionLaw):
    """A law of your own.

    Attributes
    ----------
    function : callable
        ``function(speed, load, place, time)``: coefficient [1] from m/s, N, m and s. Where numba
        can compile it (floats, `math`, other compiled functions) it runs at the full speed.
    """

    function: Callable[[float, float, float, float], float]

    def __post_init__(self) -> None:
        for speed in _SPEEDS:
            value = self.coefficient(speed, 1.0, 0.0, 0.0)
            if not 0.0 <= value < math.inf:
                raise ContactError(
                    f"a friction function must return a finite coefficient of at least 0, got "
                    f"{value!r} at {speed:g} m/s"
                )

    def coefficient(self, speed: float, load: float, place: float, time: float) -> float:
        """Return what the function returns."""
        return float(self.function(speed, load, place, time))

    def compile(self) -> Callable[[float, float, float, float], float]:
        """Return the compiled function."""
        return _compile(self.function, 4)


class ContactLaw(ABC):
    """Normal force of the contact: a subclass that has `force` is a law.

    A law is given as ``contact=`` to `drag_over` and to `OperatingPoint`. The equations know a
    rigid contact alone.
    """

    @abstractmethod
    def force(self, indentation: float, ball_radius: float) -> float:
        """Return the force [N] at an indentation [m] of a ball of a radius [m]; it must not fall."""

    def power_law(self, ball_radius: float) -> tuple[float, float]:
        """Return stiffness [N/m^p] and power p of ``F = K d^p``; a power of 0 where there is none."""
        return 0.0, 0.0

    def compile(self, ball_radius: float) -> Callable[[float], float]:
        """Return the force over the indentation as the integrator calls it."""
        return _compile(_Fixed(self, ball_radius), 1)


@dataclass(frozen=True)
class _Fixed:
    """The force of a law on one ball."""

    law: ContactLaw
    ball_radius: float

    def __call__(self, indentation: float) -> float:
        return self.law.force(indentation, self.ball_radius)


@dataclass(frozen=True)
class Hertz(ContactLaw):
    """A ball on a plane of the same material.

    Attributes
    ----------
    modulus : float
        Young's modulus of both [Pa]; that of steel by default.
    poisson : float
        Poisson's ratio of both [1].
    """

    modulus: float = MODULUS
    poisson: float = POISSON

    def __post_init__(self) -> None:
        require_positive("modulus", self.modulus, "Pa")
        if not 0.0 <= self.poisson <= 0.5:
            raise ContactError(f"poisson must lie between 0 and 0.5, got {self.poisson!r}")

    def force(self, indentation: float, ball_radius: float) -> float:
        """Return ``4/3 E* sqrt(R) d^1.5`` (Johnson, Contact Mechanics, 4.2)."""
        return float(self.power_law(ball_radius)[0] * max(indentation, 0.0) ** 1.5)

    def power_law(self, ball_radius: float) -> tuple[float, float]:
        """Return stiffness and power."""
        reduced = self.modulus / (2.0 * (1.0 - self.poisson * self.poisson))
        return 4.0 / 3.0 * reduced * math.sqrt(ball_radius), 1.5


@dataclass(frozen=True)
class LinearContact(ContactLaw):
    """A contact that is a spring.

    Attributes
    ----------
    stiffness : float
        Of the contact along its normal [N/m].
    """

    stiffness: float

    def __post_init__(self) -> None:
        require_positive("stiffness", self.stiffness, "N/m")

    def force(self, indentation: float, ball_radius: float) -> float:
        """Return ``K d``."""
        return self.stiffness * max(indentation, 0.0)

    def power_law(self, ball_radius: float) -> tuple[float, float]:
        """Return stiffness and power."""
        return self.stiffness, 1.0


@dataclass(frozen=True)
class ContactFunction(ContactLaw):
    """A law of your own.

    Attributes
    ----------
    function : callable
        ``function(indentation)``: force [N] from m; 0 at 0, and rising. Where numba can compile it
        it runs at the full speed.
    """

    function: Callable[[float], float]

    def __post_init__(self) -> None:
        forces = [self.force(depth, 0.0) for depth in (0.0, 1e-8, 1e-7, 1e-6, 1e-5)]
        rising = all(a < b for a, b in itertools.pairwise(forces))
        if forces[0] != 0.0 or not rising or not math.isfinite(forces[-1]):
            raise ContactError(
                "a contact function must be 0 without indentation and rise with it, got "
                f"{forces} N at 0, 10 nm, 0.1, 1 and 10 um"
            )

    def force(self, indentation: float, ball_radius: float) -> float:
        """Return what the function returns."""
        return float(self.function(indentation))

    def compile(self, ball_radius: float) -> Callable[[float], float]:
        """Return the compiled function."""
        return _compile(self.function, 1)


@lru_cache(maxsize=64)
def _compile(function: Callable[..., float], arguments: int) -> Callable[..., float]:
    """Turn a function of floats into one that compiled code can call, at full speed where numba can."""
    from numba import cfunc, types
    from numba.core.errors import NumbaError

    signature = types.float64(*[types.float64] * arguments)
    try:
        return cast(
            "Callable[..., float]", cfunc(signature)(getattr(function, "py_func", function))
        )
    except (NumbaError, TypeError, AttributeError):
        return _Callback(function, arguments)


class _Callback:
    """A Python function with an address, as numba's protocol of function wrappers asks for."""

    def __init__(self, function: Callable[..., float], arguments: int) -> None:
        from numba.core import types

        def call(*values: float) -> float:
            try:
                return float(function(*values))
            except Exception:  # an exception cannot cross compiled code; the drag refuses a NaN
                return math.nan

        doubles = [ctypes.c_double] * (arguments + 1)
        self._call = ctypes.CFUNCTYPE(*doubles)(call)
        self._signature = types.float64(*[types.float64] * arguments)
        self._numba_type_ = types.FunctionType(self._signature)

    def __call__(self, *values: float) -> float:
        return float(self._call(*values))

    def __wrapper_address__(self) -> int:
        return ctypes.cast(self._call, ctypes.c_void_p).value or 0

    def signature(self) -> object:
        return self._signature


def find_indentation(law: ContactLaw, ball_radius: float, force: float) -> float:
    """Find the indentation at which a law bears a force [m]."""
    stiffness, power = law.power_law(ball_radius)
    if power > 0.0:
        return float((force / stiffness) ** (1.0 / power))
    from scipy.optimize import brentq

    deep = 1e-9
    while law.force(deep, ball_radius) < force:
        deep *= 2.0
        if deep > ball_radius:
            raise ContactError(
                f"the contact must bear {force:g} N before the ball is pressed in by its radius"
            )
    return float(brentq(lambda d: law.force(d, ball_radius) - force, 0.0, deep, rtol=1e-12))
