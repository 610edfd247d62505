"""Parameters of a drag, each with its unit, and the check that they make sense together."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.errors import ContactError


@dataclass(frozen=True)
class Probe:
    """The explorer as a mass on springs."""

    stiffness: float  # tangential, k [N/m]
    mass: float  # effective mass of the tip m [kg]
    damping_ratio: float  # share of critical damping of the tangential spring [1]
    contact_stiffness: float  # of the contact along its normal [N/m^p]
    contact_power: float = 1.5  # p: 1.5 for Hertz, 1 for a linear contact
    contact_loss: float = 5.0  # Hunt and Crossley: share of the contact force lost per speed of approach [s/m]; assumed
    normal_stiffness: float = 0.0  # between the tip and the carrier of the weight [N/m]; 0: the load acts on the tip
    carrier_mass: float = 0.0  # that is lifted with the carrier [kg]; used where `normal_stiffness` is not 0

    def __post_init__(self) -> None:
        for name in ("stiffness", "mass", "contact_stiffness"):
            require_positive(name, getattr(self, name))
        for name in ("damping_ratio", "contact_loss", "normal_stiffness", "carrier_mass"):
            require_not_negative(name, getattr(self, name))
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

    normal_load: float  # weight F_py [N]
    friction: float  # coefficient of friction while sliding mu [1]
    speed: float = PAPER.speed  # of the handle [m/s]; 0 where a force pulls it
    pulling_force: float = 0.0  # constant force on the handle [N]; 0 where it moves at constant speed
    handle_mass: float = 0.0  # inertia of a handle that is pulled [kg]
    handle_damping: float = 0.0  # of the guide of a handle that is pulled [N s/m]
    static_friction: float = 0.0  # coefficient of friction at rest [1]; 0: as while sliding
    stribeck_speed: float = 1e-3  # over which static falls to sliding friction [m/s]
    viscous_friction: float = 0.0  # rise of the coefficient of friction per speed [s/m]
    lead: float = 20e-6  # distance of sliding before the path first bends or slopes by more than a degree [m]
    ring_time: float = 40e-3  # recorded after the release [s]
    sample_rate: float = 10e3  # rows of the trace per second [Hz]
    resolution: float = 20.0  # steps per period of the stiffest contact mode [1]

    def __post_init__(self) -> None:
        for name in ("normal_load", "stribeck_speed", "ring_time", "sample_rate"):
            require_positive(name, getattr(self, name))
        for field in fields(self):
            require_not_negative(field.name, getattr(self, field.name))
        if (self.speed > 0.0) == (self.pulling_force > 0.0):
            raise ContactError("exactly one of speed and pulling_force must be positive")
        if self.pulling_force > 0.0 and self.handle_mass <= 0.0:
            raise ContactError("handle_mass must be positive where a pulling_force acts")
        if self.static_friction and self.static_friction < self.friction:
            raise ContactError(f"static_friction must not be less than friction ({self.friction:g})")
        if not 4.0 <= self.resolution <= 1e4:
            raise ContactError(f"resolution must lie between 4 and 10000 steps per period, got {self.resolution:g}")

    @classmethod
    def under(cls, point: OperatingPoint, **changes: float) -> DragSettings:
        """Take load, friction and speed from an operating point."""
        return cls(**{"normal_load": point.normal_load, "friction": point.friction, "speed": point.speed} | changes)


def hertz_stiffness(ball_radius: float, modulus: float = 210e9, poisson: float = 0.3) -> float:
    """Stiffness of a ball on a plane of the same material, ``F = K d^1.5`` [N/m^1.5].

    Examples
    --------
    >>> f"{(1.0 / hertz_stiffness(125e-6)) ** (2 / 3) * 1e6:.2f} um under 1 N"
    '0.70 um under 1 N'
    """
    require_positive("ball_radius", ball_radius)
    require_positive("modulus", modulus)
    return 4.0 / 3.0 * modulus / (2.0 * (1.0 - poisson * poisson)) * math.sqrt(ball_radius)


def probe_for(tool: Tool, ball_radius: float, **changes: float) -> Probe:
    """Return the probe that rings as a tool does, with a ball of steel on steel by Hertz.

    Examples
    --------
    >>> f"{PAPER_DRAG.mass * 1e3:.2f} g, {PAPER_DRAG.damping_ratio:.3f}"
    '2.76 g, 0.037'
    """
    probe = Probe(tool.stiffness, tool.effective_mass, tool.damping_ratio, hertz_stiffness(ball_radius))
    return replace(probe, **changes)


PAPER_DRAG = probe_for(PAPER.tool, PAPER.ball_radius)
