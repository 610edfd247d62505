"""The probe and the settings of a drag in time.

Named settings reproduce the figures of the paper.
"""

import math
from dataclasses import dataclass, fields, replace

from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.kernels import compute_softened_force
from stepblocks.contact.laws import ContactLaw, FrictionLaw, Hertz
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.errors import ContactError


@dataclass(frozen=True)
class Probe:
    """The explorer as a mass on springs.

    Attributes
    ----------
    stiffness : float
        Tangential, k [N/m].
    mass : float
        Effective mass of the tip m [kg].
    damping_ratio : float
        Share of the critical damping of the tangential spring [1].
    contact_stiffness : float
        Of the contact along its normal [N/m^p].
    contact_power : float
        p: 1.5 for Hertz, 1 for a linear contact, at least 1 [1].
    contact_loss : float
        Share of the contact force that is lost per speed of approach, after Hunt and Crossley
        [s/m]; assumed.
    normal_stiffness : float
        Between the tip and the carrier of the weight [N/m]; 0: the load acts on the tip.
    carrier_mass : float
        Mass that is lifted with the carrier [kg]; used where `normal_stiffness` is not 0.
    hardening : float
        k3 of ``F = k x + k3 x^3``, Duffing's spring [N/m^3].
    overtones : tuple
        Stiffness [N/m], mass [kg] and damper [N s/m] of each further mode. `stiffness` is that of
        all modes together; mass, damping and frequency are those of the first.
    """

    stiffness: float
    mass: float
    damping_ratio: float
    contact_stiffness: float
    contact_power: float = 1.5
    contact_loss: float = 5.0
    normal_stiffness: float = 0.0
    carrier_mass: float = 0.0
    hardening: float = 0.0
    overtones: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in ("stiffness", "mass", "contact_stiffness"):
            require_positive(name, getattr(self, name))
        for name in (
            "damping_ratio",
            "contact_loss",
            "normal_stiffness",
            "carrier_mass",
            "hardening",
        ):
            require_not_negative(name, getattr(self, name))
        ContactError.require(
            1.0 <= self.contact_power <= 4.0,
            f"contact_power must lie between 1 (linear) and 4, got {self.contact_power:g}",
        )
        ContactError.require(
            self.normal_stiffness == 0.0 or self.carrier_mass > 0.0,
            "carrier_mass must be positive where normal_stiffness is not 0",
        )
        ContactError.require(
            self.hardening == 0.0 or not self.overtones,
            "hardening is for a tool of one mode, this one has overtones",
        )

    @property
    def first_stiffness(self) -> float:
        """Stiffness of the first mode [N/m], which gives way less than all modes together."""
        return self.stiffness / (1.0 - sum(self.stiffness / one[0] for one in self.overtones))

    @property
    def frequency(self) -> float:
        """Natural frequency of the first mode along the drag [Hz]."""
        return math.sqrt(self.first_stiffness / self.mass) / (2.0 * math.pi)

    def find_indentation(self, force: float) -> float:
        """Find the indentation at which the contact bears a force [m]."""
        return float((force / self.contact_stiffness) ** (1.0 / self.contact_power))

    def stretch(self, force: float) -> float:
        """Stretch of the spring under a force [m]."""
        if self.hardening > 0.0:
            force = float(compute_softened_force(force, self.hardening / self.stiffness**3))
        return force / self.stiffness

    def energy(self, force: float, rest: float = 0.0) -> float:
        """Energy of the spring at a force, above that at its rest [J].

        Another force pulls steadily at rest.
        """
        if self.hardening == 0.0:
            return 0.5 * (force - rest) * (force - rest) / self.stiffness
        x, r = self.stretch(force), self.stretch(rest)
        own, at_rest = (0.5 * self.stiffness * s**2 + 0.25 * self.hardening * s**4 for s in (x, r))
        return own - at_rest - rest * (x - r)


@dataclass(frozen=True)
class DragSettings:
    """How the probe is dragged.

    Attributes
    ----------
    normal_load : float
        Weight F_py [N].
    friction : float
        Coefficient of friction while sliding mu [1].
    speed : float
        Of the handle [m/s]; 0 where a force pulls it.
    pulling_force : float
        Constant force on the handle [N]; 0 where it moves at constant speed.
    handle_mass : float
        Inertia of a handle that is pulled [kg].
    handle_damping : float
        Of the guide of a handle that is pulled [N s/m].
    static_friction : float
        Coefficient of friction at rest [1]; 0: as while sliding.
    stribeck_speed : float
        Speed over which static falls to sliding friction [m/s].
    viscous_friction : float
        Rise of the coefficient of friction per speed [s/m].
    lead : float
        Distance of sliding before the path first bends or slopes by more than a degree [m].
    ring_time : float
        Time that is recorded after the last release [s].
    sample_rate : float
        Rows of the trace per second [Hz].
    resolution : float
        Steps per period of the stiffest mode of the contact [1].
    tissue_stiffness : float
        Of a soft wall along which the tool rubs [N/m]; 0: there is none.
    tissue_damping : float
        Of that wall [N s/m].
    tissue_friction : float
        Force at which the tool slides along it [N].
    friction_law : FrictionLaw, optional
        A law whose formula the settings do not hold.
    """

    normal_load: float
    friction: float
    speed: float = PAPER.speed
    pulling_force: float = 0.0
    handle_mass: float = 0.0
    handle_damping: float = 0.0
    static_friction: float = 0.0
    stribeck_speed: float = 1e-3
    viscous_friction: float = 0.0
    lead: float = 20e-6
    ring_time: float = 40e-3
    sample_rate: float = 10e3
    resolution: float = 20.0
    tissue_stiffness: float = 0.0
    tissue_damping: float = 0.0
    tissue_friction: float = 0.0
    friction_law: FrictionLaw | None = None

    def __post_init__(self) -> None:
        for name in ("normal_load", "stribeck_speed", "ring_time", "sample_rate"):
            require_positive(name, getattr(self, name))
        for field in fields(self)[:-1]:
            require_not_negative(field.name, getattr(self, field.name))
        ContactError.require(
            (self.speed > 0.0) != (self.pulling_force > 0.0),
            "exactly one of speed and pulling_force must be positive",
        )
        ContactError.require(
            self.pulling_force == 0.0 or self.handle_mass > 0.0,
            "handle_mass must be positive where a pulling_force acts",
        )
        ContactError.require(
            self.static_friction == 0.0 or self.static_friction >= self.friction,
            f"static_friction must not be less than friction ({self.friction:g})",
        )
        ContactError.require(
            4.0 <= self.resolution <= 1e4,
            f"resolution must lie between 4 and 10000 steps per period, got {self.resolution:g}",
        )

    @classmethod
    def under(cls, point: OperatingPoint, **changes: object) -> "DragSettings":
        """Take load, friction, speed and tissue from an operating point."""
        wall = {f"tissue_{name}": value for name, value in vars(point.tissue).items()}
        known = {"normal_load": point.normal_load, "friction": point.friction, "speed": point.speed}
        settings = cls(**known | wall | changes)
        law = point.friction_law
        if law is None or "friction" in changes:
            return settings
        sliding, rest = (
            law.coefficient(speed, point.normal_load, 0.0, 0.0) for speed in (settings.speed, 0.0)
        )
        return replace(
            settings,
            friction=sliding,
            static_friction=rest if rest > sliding else 0.0,
            friction_law=law,
        )

    @property
    def friction_at_rest(self) -> float:
        """Coefficient of friction at rest [1]."""
        return self.static_friction or self.friction

    def find_sliding_force(self, slope: float = 0.0) -> float:
        """Find the pull that slides the tip up a slope [1], N tan(atan s + atan mu) [N]."""
        return (slope + self.friction) / (
            1.0 - slope * self.friction
        ) * self.normal_load + self.tissue_friction


def build_probe(
    tool: Tool, ball_radius: float, contact: ContactLaw | None = None, /, **changes: float
) -> Probe:
    """Return the probe that rings as a tool does.

    The contact of the probe is that of steel on steel by default.
    """
    stiffness, power = (contact or Hertz()).power_law(ball_radius)
    # the modes in a row are as soft as the tool; their masses are as their ratios say
    mass = tool.effective_mass * (
        1.0 + sum((tool.frequency / one.frequency) ** 2 / one.mass_ratio for one in tool.overtones)
    )
    overtones = []
    for one in tool.overtones:
        own = one.mass_ratio * mass
        omega = math.tau * one.frequency
        overtones.append((own * omega * omega, own, 2.0 * own / one.decay_time))
    values = {
        "stiffness": tool.stiffness,
        "mass": mass,
        "damping_ratio": tool.damping_ratio,
        "contact_stiffness": stiffness,
        "contact_power": power,
    }
    return Probe(**(values | changes), overtones=tuple(overtones))


PAPER_DRAG = build_probe(PAPER.tool, PAPER.ball_radius)


@dataclass(frozen=True)
class Setting:
    """A named way of carrying the load.

    Attributes
    ----------
    source, fails : str
        Where it comes from, and where it fails.
    normal_load, friction : float
        Load [N] and coefficient of friction [1], unless others are asked for.
    damping_ratio : float
        Share of critical damping [1].
    holder_mass : float
        Carried beside the weight [kg].
    """

    source: str
    fails: str
    normal_load: float
    friction: float
    damping_ratio: float
    holder_mass: float

    def changes(self, tool: Tool, normal_load: float) -> dict[str, float]:
        """Return the changes of the probe.

        A round rod is as stiff along the normal, the load behind it.
        """
        return {
            "damping_ratio": self.damping_ratio,
            "normal_stiffness": tool.stiffness,
            "carrier_mass": normal_load / 9.81 + self.holder_mass,
        }


SETTINGS = {
    "figures-3-to-5": Setting(
        "chosen on a step of 100 um so that figures 3 to 5 of the paper come out at once "
        "(docs/explanation/drag.md); the paper states neither step, load, mass nor damping of them",
        "on low steps under high loads the ring ends within 4 ms, with less than a tenth of its "
        "energy in 250-350 Hz; on 50 and 75 um less than a tenth of the stored energy rings",
        normal_load=0.1,
        friction=0.1,
        damping_ratio=0.033,
        holder_mass=10e-3,
    )
}
