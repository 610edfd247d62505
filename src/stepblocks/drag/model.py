"""Parameters of a drag, each with its unit, and the check that they make sense together."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from stepblocks.errors import ContactError


def _positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ContactError(f"{name} must be positive and finite, got {value:g}")


def _not_negative(name: str, value: float) -> None:
    if not (math.isfinite(value) and value >= 0.0):
        raise ContactError(f"{name} must be finite and not negative, got {value:g}")


@dataclass(frozen=True)
class Probe:
    """The explorer as a mass on springs."""

    stiffness: float  # Tangential stiffness k [N/m]
    mass: float  # Effective mass of the tip m [kg]
    damping_ratio: float  # Share of critical damping of the tangential spring [1]
    contact_stiffness: float  # Stiffness of the contact along its normal [N/m^p]
    contact_power: float  # p: 1.5 for Hertz, 1 for a linear contact
    # Hunt and Crossley's coefficient: share of the contact force that is lost per speed of approach [s/m]
    contact_loss: float
    # Stiffness along the normal between the tip and the carrier of the weight [N/m]; 0: the load acts on the tip
    normal_stiffness: float
    carrier_mass: float  # Mass that is lifted with the carrier [kg]; used where `normal_stiffness` is not 0

    def __post_init__(self) -> None:
        for name in ("stiffness", "mass", "contact_stiffness"):
            _positive(name, getattr(self, name))
        for name in ("damping_ratio", "contact_loss", "normal_stiffness", "carrier_mass"):
            _not_negative(name, getattr(self, name))
        if self.contact_power not in (1.0, 1.5):
            raise ContactError(f"contact_power must be 1 (linear) or 1.5 (Hertz), got {self.contact_power:g}")
        if self.normal_stiffness > 0.0 and self.carrier_mass <= 0.0:
            raise ContactError("carrier_mass must be positive where normal_stiffness is not 0")

    @property
    def frequency(self) -> float:
        """Natural frequency along the drag [Hz]."""
        return math.sqrt(self.stiffness / self.mass) / (2.0 * math.pi)


@dataclass(frozen=True)
class DragSettings:
    """How the probe is dragged."""

    normal_load: float  # Weight F_py [N]
    friction: float  # Coefficient of friction while sliding mu [1]
    speed: float = 5e-3  # Speed of the handle [m/s]; 0 where a force pulls it
    pulling_force: float = 0.0  # Constant force on the handle [N]; 0 where it moves at constant speed
    handle_mass: float = 0.0  # Inertia [kg] and guide damping [N s/m] of a handle that is pulled
    handle_damping: float = 0.0
    static_friction: float = 0.0  # Coefficient of friction at rest [1]; 0: as while sliding
    stribeck_speed: float = 1e-3  # Speed over which static falls to sliding friction [m/s]
    viscous_friction: float = 0.0  # Rise of the coefficient of friction per speed [s/m]
    lead: float = 20e-6  # Distance of sliding before the path first bends or slopes by more than a degree [m]
    ring_time: float = 40e-3  # Time recorded after the release [s]
    sample_rate: float = 10e3  # Rows of the trace per second [Hz]
    resolution: float = 20.0  # Steps per period of the stiffest contact mode [1]

    def __post_init__(self) -> None:
        for name in ("normal_load", "stribeck_speed", "ring_time", "sample_rate"):
            _positive(name, getattr(self, name))
        for field in fields(self):
            _not_negative(field.name, getattr(self, field.name))
        if (self.speed > 0.0) == (self.pulling_force > 0.0):
            raise ContactError("exactly one of speed and pulling_force must be positive")
        if self.pulling_force > 0.0 and self.handle_mass <= 0.0:
            raise ContactError("handle_mass must be positive where a pulling_force acts")
        if self.static_friction and self.static_friction < self.friction:
            raise ContactError(f"static_friction must not be less than friction ({self.friction:g})")
        if not 4.0 <= self.resolution <= 1e4:
            raise ContactError(f"resolution must lie between 4 and 10000 steps per period, got {self.resolution:g}")


def hertz_stiffness(ball_radius: float, modulus: float = 210e9, poisson: float = 0.3) -> float:
    """Stiffness of a ball on a plane of the same material, ``F = K d^1.5`` [N/m^1.5].

    Examples
    --------
    >>> f"{(1.0 / hertz_stiffness(125e-6)) ** (2 / 3) * 1e6:.2f} um under 1 N"
    '0.70 um under 1 N'
    """
    _positive("ball_radius", ball_radius)
    _positive("modulus", modulus)
    return 4.0 / 3.0 * modulus / (2.0 * (1.0 - poisson * poisson)) * math.sqrt(ball_radius)


def probe_of_frequency(frequency: float, ball_radius: float, stiffness: float = 9.81e3, **changes: float) -> Probe:
    """Probe with a spring of the paper, a mass that gives `frequency` [Hz], and a steel contact by Hertz.

    Examples
    --------
    >>> f"{probe_of_frequency(300.0, 125e-6).mass * 1e3:.2f} g"
    '2.76 g'
    """
    _positive("frequency", frequency)
    values = {
        "stiffness": stiffness,
        "mass": stiffness / (2.0 * math.pi * frequency) ** 2,
        "damping_ratio": 0.02,
        "contact_stiffness": hertz_stiffness(ball_radius),
        "contact_power": 1.5,
        "contact_loss": 5.0,
        "normal_stiffness": 0.0,
        "carrier_mass": 0.0,
    }
    values.update(changes)
    return Probe(**values)


# k = 9.81e3 N/m of the paper and a mass for 300 Hz, the middle of its band; damping and contact are assumed
PAPER_DRAG = probe_of_frequency(300.0, 125e-6)
