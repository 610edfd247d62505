"""Laws of friction and of the contact, and overtones of the tool, as objects.

The drag in time takes their value at every step, the equations their value at rest. A file names
a law that ships, or one that a package offers as an entry point.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, cast

from stepblocks.contact.domain import (
    convert_fields_in_place,
    read_number,
    require_not_negative,
    require_positive,
)
from stepblocks.errors import ContactError, QuantityError
from stepblocks.quantities import Measure

Coefficient = Callable[[float, float, float, float], float]


@dataclass(frozen=True)
class FrictionLaw:
    """Coefficient of friction of the tip, as a function of your own.

    A law is given as ``friction=`` to `drag_over` and to `OperatingPoint`. Equation (1) takes its
    value at rest, because the tip is at rest when it releases; the drag in time takes its value at
    every step.

    Attributes
    ----------
    coefficient : callable
        ``coefficient(speed, load, place, time)``: the coefficient [1], at least 0, at a speed of
        sliding of either sign [m/s], a normal force [N], x [m] and t [s]. It is compiled by numba,
        so it may use floats, `math` and other compiled functions.
    bristle_stiffness : float
        Of bristles that bend before the tip slides, after Dahl [N/m]. With 0 the tip sticks as
        stiffly as the contact (Mindlin) up to the limit of Coulomb.

    Examples
    --------
    >>> law = FrictionLaw(lambda speed, load, place, time: 0.1 + 0.05 * load ** (-1 / 3))
    >>> round(law.coefficient(0.0, 1.0, 0.0, 0.0), 3)
    0.15
    """

    coefficient: Coefficient
    bristle_stiffness: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative("bristle_stiffness", self.bristle_stiffness, "N/m")
        for speed in (0.0, 5e-3, 0.5):
            value = self.coefficient(speed, 1.0, 0.0, 0.0)
            if not 0.0 <= value < math.inf:
                raise ContactError(
                    f"a law of friction must give a finite coefficient of at least 0, got "
                    f"{value!r} at {speed:g} m/s"
                )


class Stribeck(FrictionLaw):
    """Friction that falls from rest to sliding and rises with the speed, on bristles if asked.

    With bristles it is the law of LuGre, and that of Dahl where `static` equals `sliding`: they
    bend by ``dz/dt = v - |v| z / z_ss`` with ``z_ss = mu(v) N / bristle_stiffness``, so that the
    tip creeps before it slides, and steady sliding is that without them.

    Parameters
    ----------
    sliding, static : float
        Coefficients while sliding and at rest [1].
    speed : float
        Over which the one falls to the other, to 1/e of the difference [m/s].
    viscous : float
        Rise of the coefficient per speed [s/m].
    bristle_stiffness : float
        Of the bristles [N/m]; 0 for none.

    Attributes
    ----------
    coefficient : callable
        As of `FrictionLaw`.

    References
    ----------
    Canudas de Wit, Olsson, Astrom, Lischinsky (1995), IEEE Trans. Automatic Control 40, 419.
    """

    _numbers: tuple[float, ...]

    def __init__(
        self,
        sliding: float,
        static: float,
        speed: Measure = 1e-3,
        viscous: float = 0.0,
        bristle_stiffness: Measure = 0.0,
    ) -> None:
        speed = read_number("speed", speed, "speed")
        bristle_stiffness = read_number("bristle_stiffness", bristle_stiffness, "stiffness")
        require_positive("speed", speed, "m/s")
        for name, value in (("sliding", sliding), ("static", static), ("viscous", viscous)):
            require_not_negative(name, value)

        coefficient = _make_stribeck_curve(
            float(sliding), float(static), float(speed), float(viscous)
        )
        super().__init__(coefficient, bristle_stiffness)
        object.__setattr__(self, "_numbers", (sliding, static, speed, viscous, bristle_stiffness))

    def __reduce__(self) -> "tuple[type[Stribeck], tuple[float, ...]]":
        return Stribeck, self._numbers  # a function within a function cannot be pickled

    def __repr__(self) -> str:
        return f"Stribeck{self._numbers}"


@lru_cache(maxsize=64)
def _make_stribeck_curve(
    sliding: float, static: float, speed: float, viscous: float
) -> Coefficient:
    """Make the coefficient of a Stribeck law; equal laws share it, so that it is compiled once."""

    def compute_coefficient(v: float, load: float, place: float, time: float) -> float:
        """Coefficient at a speed [m/s]; load, place and time do not count."""
        stribeck = (static - sliding) * math.exp(-abs(v) / speed)
        return sliding + stribeck + viscous * abs(v)

    return compute_coefficient


class ContactLaw(ABC):
    """Normal force of the contact, a power ``F = K d^p`` of the indentation.

    A law is given as ``contact=`` to `drag_over` and to `OperatingPoint`; a subclass that has
    `power_law` is one. The equations know a rigid contact alone.
    """

    @abstractmethod
    def power_law(self, ball_radius: float) -> tuple[float, float]:
        """Return K [N/m^p] and p of a ball of a radius [m]."""


@dataclass(frozen=True)
class Hertz(ContactLaw):
    """A ball on a plane of the same material (Johnson, Contact Mechanics, 4.2).

    Attributes
    ----------
    modulus : float
        Young's modulus of both [Pa]; that of steel by default.
    poisson : float
        Poisson's ratio of both [1].
    """

    modulus: float = 210e9
    poisson: float = 0.3

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(self, modulus: Measure = ..., poisson: Measure = ...) -> None: ...

    def __post_init__(self) -> None:
        convert_fields_in_place(self, modulus=("pressure", 1e13))
        convert_fields_in_place(self, -1.0, poisson=("ratio", 0.5))

    def power_law(self, ball_radius: float) -> tuple[float, float]:
        """Return ``4/3 E* sqrt(R)`` and 1.5."""
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

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(self, stiffness: Measure) -> None: ...

    def __post_init__(self) -> None:
        convert_fields_in_place(self, stiffness=("stiffness", 1e15))

    def power_law(self, ball_radius: float) -> tuple[float, float]:
        """Return the stiffness and 1."""
        return self.stiffness, 1.0


@dataclass(frozen=True)
class Overtone:
    """A further mode of bending of the tool, above the one that gives it its name.

    A tool takes some as ``overtones=``. At rest they give way with the rest of the tool, whose
    stiffness stays that of equation (1). In the drag in time each is pushed by the force on the tip
    and rings by itself; a handle that moves does not stir them. What knows a ring of one frequency
    alone (equation (1), scenes, the renderer) takes that of the tool.

    Attributes
    ----------
    frequency : float
        At which it rings [Hz].
    decay_time : float
        In which its amplitude falls to 1/e [s].
    mass_ratio : float
        Its effective mass at the tip over that of the first mode [1]. All modes of a uniform rod
        that is held at one end have a quarter of its mass.

    References
    ----------
    Blevins (1979), Formulas for Natural Frequency and Mode Shape, table 8-1.

    Examples
    --------
    >>> from stepblocks.contact.operating_point import Tool
    >>> Tool(overtones=Overtone("900 Hz", "5 ms")).overtones
    (Overtone(frequency=900.0, decay_time=0.005, mass_ratio=1.0),)
    """

    frequency: float
    decay_time: float
    mass_ratio: float = 1.0

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(
            self, frequency: Measure, decay_time: Measure, mass_ratio: Measure = ...
        ) -> None: ...

    def __post_init__(self) -> None:
        convert_fields_in_place(
            self, frequency=("frequency", 1e7), decay_time=("time", 1e6), mass_ratio=("ratio", 1e6)
        )


_KINDS = {"friction": FrictionLaw, "contact": ContactLaw, "tool": Overtone}
_SHIPPED: dict[str, Callable[..., object]] = {
    "stribeck": Stribeck,
    # bristles, assumed, about as stiff as a steel ball of 125 um under 1 N
    "lugre": partial(Stribeck, bristle_stiffness=1e6),
    "hertz": Hertz,
    "linear": LinearContact,
    "overtone": Overtone,
}
_DIMENSIONS = {
    "speed": "speed",
    "stiffness": "stiffness",
    "bristle_stiffness": "stiffness",
    "modulus": "pressure",
    "frequency": "frequency",
    "decay_time": "time",
}


def build_declared_laws(declared: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Build the laws that a file declares under ``friction``, ``contact`` and ``tool``.

    The name of each, under ``law``, is that of a law that ships or of an entry point of the group
    ``stepblocks.laws``; what stands beside it are its numbers.
    """
    return {kind: _build_declared_law(kind, **numbers) for kind, numbers in declared.items()}


def _build_declared_law(law_kind: str, law: str = "", **numbers: Any) -> object:
    """Build one law of a kind from its name and its numbers."""
    if law_kind not in _KINDS:
        raise QuantityError(f"laws must be of {', '.join(_KINDS)}, got {law_kind!r}")
    try:
        make = _find_law_factory(law)
        values = {name: _read_law_parameter(name, value) for name, value in numbers.items()}
        built = make(**values)
    except (TypeError, ContactError) as error:
        raise QuantityError(f"law of {law_kind} {law!r}: {error}") from error
    if not isinstance(built, _KINDS[law_kind]):
        raise QuantityError(
            f"law of {law_kind} must be of {_KINDS[law_kind].__name__}, {law!r} is not"
        )
    return built


def _find_law_factory(law: str) -> Callable[..., object]:
    """Find what builds a law of a name: a shipped one, or an entry point of a package."""
    if law in _SHIPPED:
        return _SHIPPED[law]
    offered = {entry.name: entry for entry in entry_points(group="stepblocks.laws")}
    if law not in offered:
        names = [*_SHIPPED, *offered]
        raise QuantityError(f"laws must be of {', '.join(names)}, got {law!r}")
    return cast(Callable[..., object], offered[law].load())


def _read_law_parameter(name: str, value: object) -> object:
    """Read a parameter of a law in SI where its dimension is known; return others as they are."""
    if name in _DIMENSIONS:
        return read_number(name, value, _DIMENSIONS[name])
    return value


@lru_cache(maxsize=64)
def compile_friction_coefficient(coefficient: Coefficient) -> Coefficient:
    """Compile a function of four floats to a pointer that the integrator can call."""
    from numba import cfunc
    from numba.core.errors import NumbaError

    signature = "float64(float64, float64, float64, float64)"
    source = getattr(coefficient, "py_func", coefficient)
    try:
        return cast(Coefficient, cfunc(signature)(source))
    except (NumbaError, TypeError, AttributeError) as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise ContactError(
            f"a law of friction must be a function of four floats that numba compiles: {reason}"
        ) from error
