"""The probe and the settings of a drag in time.

Named settings reproduce the figures of the paper.
"""

import math
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.kernels import compute_unhardened_force
from stepblocks.contact.laws import ContactLaw, FrictionLaw, Hertz
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.errors import ContactError

_POWERS = 1.0, 4.0  # of a contact: from a spring to one that is far from any body
_RESOLUTIONS = 4.0, 1e4  # steps per period
_GRAVITY = 9.81  # m/s^2


class Mode(NamedTuple):
    """A further mode of the tool."""

    stiffness: float  # [N/m]
    mass: float  # [kg]
    damping: float  # [N s/m]


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
    overtones : tuple of Mode
        Further modes. `stiffness` is that of all modes together; mass, damping and frequency are
        those of the first.
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
    overtones: tuple[Mode, ...] = ()

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
        softest, hardest = _POWERS
        if not softest <= self.contact_power <= hardest:
            raise ContactError(
                f"contact_power must lie between 1 (linear) and 4, got {self.contact_power:g}"
            )
        if self.normal_stiffness > 0.0 and self.carrier_mass == 0.0:
            raise ContactError("carrier_mass must be positive where normal_stiffness is not 0")
        if self.hardening > 0.0 and self.overtones:
            raise ContactError("hardening is for a tool of one mode, this one has overtones")

    @property
    def first_stiffness(self) -> float:
        """Stiffness of the first mode [N/m], which gives way less than all modes together."""
        share_of_overtones = sum(self.stiffness / mode.stiffness for mode in self.overtones)
        return self.stiffness / (1.0 - share_of_overtones)

    @property
    def frequency(self) -> float:
        """Natural frequency of the first mode along the drag [Hz]."""
        return math.sqrt(self.first_stiffness / self.mass) / (2.0 * math.pi)

    def compute_indentation(self, force: float) -> float:
        """Find the indentation at which the contact bears a force [m]."""
        return float((force / self.contact_stiffness) ** (1.0 / self.contact_power))

    def compute_stretch(self, force: float) -> float:
        """Stretch of the spring under a force [m]."""
        if self.hardening > 0.0:
            force = float(compute_unhardened_force(force, self.hardening / self.stiffness**3))
        return force / self.stiffness

    def compute_energy(self, force: float, steady_force: float = 0.0) -> float:
        """Energy of the spring at a force, above that at its rest [J].

        At rest a `steady_force` [N] pulls.
        """
        if self.hardening == 0.0:
            excess = force - steady_force
            return 0.5 * excess * excess / self.stiffness
        stretch = self.compute_stretch(force)
        rest_stretch = self.compute_stretch(steady_force)
        stored = self._compute_stored_energy(stretch) - self._compute_stored_energy(rest_stretch)
        return stored - steady_force * (stretch - rest_stretch)

    def _compute_stored_energy(self, stretch: float) -> float:
        """Energy of the hardening spring at a stretch [m], in J."""
        linear = 0.5 * self.stiffness * stretch**2
        cubic = 0.25 * self.hardening * stretch**4
        return linear + cubic


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
        if (self.speed > 0.0) == (self.pulling_force > 0.0):
            raise ContactError("exactly one of speed and pulling_force must be positive")
        if self.pulling_force > 0.0 and self.handle_mass == 0.0:
            raise ContactError("handle_mass must be positive where a pulling_force acts")
        if 0.0 < self.static_friction < self.friction:
            raise ContactError(
                f"static_friction must not be less than friction ({self.friction:g})"
            )
        coarsest, finest = _RESOLUTIONS
        if not coarsest <= self.resolution <= finest:
            raise ContactError(
                f"resolution must lie between 4 and 10000 steps per period, got {self.resolution:g}"
            )

    @classmethod
    def from_point(cls, point: OperatingPoint, **changes: object) -> "DragSettings":
        """Take load, friction, speed and tissue from an operating point."""
        of_point: dict[str, object] = {
            "normal_load": point.normal_load,
            "friction": point.friction,
            "speed": point.speed,
            "tissue_stiffness": point.tissue.stiffness,
            "tissue_damping": point.tissue.damping,
            "tissue_friction": point.tissue.friction,
        }
        settings = cls(**of_point | changes)  # type: ignore[arg-type]
        law = point.friction_law
        if law is None or "friction" in changes:
            return settings
        sliding = law.coefficient(settings.speed, point.normal_load, 0.0, 0.0)
        at_rest = law.coefficient(0.0, point.normal_load, 0.0, 0.0)
        static = 0.0
        if at_rest > sliding:
            static = at_rest
        return replace(settings, friction=sliding, static_friction=static, friction_law=law)

    @property
    def friction_at_rest(self) -> float:
        """Coefficient of friction at rest [1]."""
        return self.static_friction or self.friction

    def compute_sliding_force(self, slope: float = 0.0) -> float:
        """Find the pull that slides the tip up a slope [1], N tan(atan s + atan mu) [N]."""
        tangent = (slope + self.friction) / (1.0 - slope * self.friction)
        return tangent * self.normal_load + self.tissue_friction


def build_probe_of_tool(
    tool: Tool, ball_radius: float, contact: ContactLaw | None = None, /, **changes: float
) -> Probe:
    """Return the probe that rings as a tool does.

    The contact of the probe is that of steel on steel by default.
    """
    stiffness, power = (contact or Hertz()).power_law(ball_radius)
    # the modes in a row are as soft as the tool; their masses are as their ratios say
    softness = sum(
        (tool.frequency / overtone.frequency) ** 2 / overtone.mass_ratio
        for overtone in tool.overtones
    )
    mass = tool.effective_mass * (1.0 + softness)
    overtones = []
    for overtone in tool.overtones:
        mode_mass = overtone.mass_ratio * mass
        omega = math.tau * overtone.frequency
        mode_stiffness = mode_mass * omega * omega
        damping = 2.0 * mode_mass / overtone.decay_time
        overtones.append(Mode(mode_stiffness, mode_mass, damping))
    values = {
        "stiffness": tool.stiffness,
        "mass": mass,
        "damping_ratio": tool.damping_ratio,
        "contact_stiffness": stiffness,
        "contact_power": power,
    }
    return Probe(**(values | changes), overtones=tuple(overtones))


PAPER_DRAG = build_probe_of_tool(PAPER.tool, PAPER.ball_radius)


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

    def list_probe_changes(self, tool: Tool, normal_load: float) -> dict[str, float]:
        """Return what the probe changes by this way: a round rod is as stiff along the normal."""
        weight_mass = normal_load / _GRAVITY
        return {
            "damping_ratio": self.damping_ratio,
            "normal_stiffness": tool.stiffness,
            "carrier_mass": weight_mass + self.holder_mass,
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
