"""Conditions of a set: tips, loads, frictions, steps, the tool, the probe and its rig."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from stepblocks.contact.laws import build_declared_laws
from stepblocks.contact.operating_point import (
    LIMIT_SOURCES,
    PAPER,
    Limits,
    OperatingPoint,
    Tissue,
    Tool,
)
from stepblocks.contact.rod import Rod, RodRing, Sleeve, compute_rod_ring, solve_rod_for_tool
from stepblocks.parts.declared import (
    Identity,
    Sourced,
    Table,
    make_positive_validator,
    make_rules_validator,
    make_sourced_validator,
)

PAPER_STEPS = (25e-6, 50e-6, 75e-6, 100e-6)  # H of the four blocks of the apparatus [m]
Force = Annotated[Sourced, make_sourced_validator("force")]
Ratio = Annotated[float, make_positive_validator("ratio", or_zero=True)]
_Count = Annotated[int, Field(ge=1, le=9999)]
OrderText = Annotated[str, Field(max_length=60)]
_Newtons = Annotated[float, make_positive_validator("force")]
_AT_LEAST_ONE = Field(min_length=1, max_length=100)
_Share = Annotated[Ratio, Field(lt=1.0)]  # a tolerance of all that there is leaves nothing
# m
Lengths = Annotated[
    tuple[Annotated[float, make_positive_validator("length")], ...], Field(max_length=100)
]


class ToolSpec(Table):
    """The explorer as a spring that rings; what is left out is the paper's."""

    # tangential, k [N/m]
    stiffness: Annotated[float, make_positive_validator("stiffness")] = PAPER.tool.stiffness
    conversion: Annotated[float, make_positive_validator("ratio")] = (
        PAPER.tool.conversion
    )  # C_v [1]
    ring_duration: Annotated[float, make_positive_validator("time")] = PAPER.tool.ring_duration  # s
    # W
    detection_threshold: Annotated[float, make_positive_validator("power")] = (
        PAPER.tool.detection_threshold
    )
    # of the ring [Hz]
    frequency: Annotated[float, make_positive_validator("frequency")] = PAPER.tool.frequency
    # of its amplitude [s]
    decay_time: Annotated[float, make_positive_validator("time")] = PAPER.tool.decay_time


_USUAL = {name: Sourced(value, "force", source) for name, (value, source) in LIMIT_SOURCES.items()}


class LimitsSpec(Table):
    """Tangential forces beyond which a tip does not slip, each with its source.

    Those that are left out are those of `LIMIT_SOURCES`.
    """

    strength: Force = _USUAL["strength"]  # of the tool
    spring: Force = _USUAL["spring"]  # to which it is linear
    gauge: Force = _USUAL["gauge"]  # that is shown
    hand: Force = _USUAL["hand"]  # that a hand, or the drive of a bench, pulls


class SettingTolerances(Table):
    """Tolerances of what is not on a drawing, to either side; 0 where it is left out."""

    tip_radius: Annotated[float, make_positive_validator("length", or_zero=True)] = (
        0.0  # of `PredictionGrid.tip_radii` [m]
    )
    friction: Ratio = 0.0  # 1
    normal_load: _Share = 0.0  # as a share of the load [1]
    stiffness: _Share = 0.0  # as a share of the stiffness [1]
    conversion: _Share = 0.0  # as a share of C_v [1]
    # of the ring [Hz]; left out, the paper's band
    frequency: Annotated[float, make_positive_validator("frequency", or_zero=True)] = (
        PAPER.tool.frequency_deviation
    )


class PredictionGrid(Table):
    """Conditions of the prediction: every combination of tip, load and friction."""

    tip_radii: Lengths = ()  # R [m]
    normal_loads: Annotated[tuple[_Newtons, ...], _AT_LEAST_ONE] = (PAPER.normal_load,)  # F_py [N]
    frictions: Annotated[tuple[Ratio, ...], _AT_LEAST_ONE] = (PAPER.friction,)  # mu [1]
    step_heights: Lengths = ()  # H of the sharp steps on which tips and sheaths are predicted [m]
    # by name, with their numbers; that of friction stands in the place of `frictions`
    laws: dict[str, dict[str, Any]] | None = None
    tool: ToolSpec = ToolSpec()
    tolerances: SettingTolerances = SettingTolerances()
    limits: LimitsSpec = LimitsSpec()

    @make_rules_validator
    def _yield_law_breaches(self) -> Iterator[str]:
        """Yield an overtone below the tool's frequency, and frictions beside a law of friction."""
        overtone = self.built_laws.get("tool")
        if overtone and overtone.frequency <= self.tool.frequency:
            yield (
                f"laws.tool.frequency must be above that of the tool, {self.tool.frequency:g} Hz, "
                f"got {overtone.frequency:g} Hz"
            )
        if "friction" in self.built_laws and self.frictions != (PAPER.friction,):
            yield "frictions must not be given beside laws.friction, which takes their place"

    @property
    def built_laws(self) -> dict[str, Any]:
        """The laws that are declared, by kind: friction, contact and tool."""
        return build_declared_laws(self.laws or {})

    @property
    def frictions_or_law(self) -> tuple[Any, ...]:
        """Coefficients of friction, or the law that stands in their place."""
        if self.laws and "friction" in self.laws:
            return (self.built_laws["friction"],)
        return self.frictions

    def as_tool(self) -> Tool:
        """Return the declared tool, with the tolerance of its ring and its limits."""
        limits = Limits(**{name: limit.value for name, limit in self.limits})
        return Tool(
            **dict(self.tool),
            frequency_deviation=self.tolerances.frequency,
            limits=limits,
            overtones=self.built_laws.get("tool", ()),
        )

    def make_first_operating_point(self, **overrides: Any) -> OperatingPoint:
        """Return the first of the conditions; keywords replace fields of it."""
        ball_radius = PAPER.ball_radius
        if self.tip_radii:
            ball_radius = self.tip_radii[0]
        fields = {
            "ball_radius": ball_radius,
            "normal_load": self.normal_loads[0],
            "friction": self.frictions_or_law[0],
            "tool": self.as_tool(),
            "contact": self.built_laws.get("contact"),
        }
        return OperatingPoint(**{**fields, **overrides})


class Gum(Table):
    """Gum beside the margin: a Kelvin-Voigt wall that the flank of the tool presses.

    Attributes
    ----------
    indentation : float
        Indentation by the tool [m]; a gentle touch is assumed.
    contact : float
        Length of the contact of the flank with the gum along the tool [m]; assumed.
    shear_modulus : Sourced
        Shear modulus [Pa], in a table with its source.
    loss_factor : Sourced
        Loss factor [1], in a table with its source.
    friction : Sourced
        Coefficient of friction on the gum [1], in a table with its source.
    """

    indentation: Annotated[float, make_positive_validator("length")] = 0.2e-3
    contact: Annotated[float, make_positive_validator("length")] = 1e-3
    shear_modulus: Annotated[Sourced, make_sourced_validator("pressure")] = Sourced(
        83e3,
        "pressure",
        "masticatory mucosa, mean of patients: Wakabayashi, Suzuki 2013, doi "
        "10.1177/1758736013483298",
    )
    loss_factor: Annotated[Sourced, make_sourced_validator("ratio")] = Sourced(
        0.3, "ratio", "assumed at 300 Hz; the relaxation that is published takes minutes"
    )
    friction: Annotated[Sourced, make_sourced_validator("ratio")] = Sourced(
        0.1, "ratio", "assumed: wet with saliva"
    )

    def make_tissue(self, ring_frequency: float) -> Tissue:
        """Return the wall at the frequency of a ring [Hz].

        A long tool on an incompressible half space: N = pi/4 E* L d with E* = 4 G (Popov 2017,
        Contact Mechanics and Friction, 2.3.2), tangential over normal stiffness
        2 (1 - nu) / (2 - nu) = 2/3 (Mindlin); damping eta k / w.
        """
        normal_stiffness = math.pi * self.shear_modulus.value * self.contact
        stiffness = 2.0 / 3.0 * normal_stiffness
        damping = self.loss_factor.value * stiffness / (math.tau * ring_frequency)
        friction = self.friction.value * normal_stiffness * self.indentation
        return Tissue(stiffness, damping, friction)


class OrderSpec(Table):
    """The order, as title blocks and certificates state it; a field left out stays blank."""

    author: OrderText = ""
    date: Annotated[str, Field(pattern=r"^(\d{4}-[01]\d-[0-3]\d)?$")] = ""  # of the drawings
    revision: OrderText = ""
    quantity: _Count = 1  # of each part
    # of a part by its id, where it is another: { step-050 = 3 }
    quantities: dict[Identity, _Count] = Field(default_factory=dict, max_length=1000)
    owner: OrderText = ""  # organisation that owns the drawings (ISO 7200, legal owner)
    approved_by: OrderText = ""
    # of part and series drawings; limits in inches are rounded inwards from the millimetres
    drawing_units: Literal["mm", "inch"] = "mm"

    def count_ordered_parts(self, part_id: str) -> int:
        """Return how many of a part are ordered."""
        return self.quantities.get(part_id, self.quantity)


NO_ORDER = OrderSpec()


class ProbeSpec(Table):
    """The probe as a clamped rod with a mass at its tip.

    Its free length follows from the stiffness, the mass from the frequency.
    """

    stiffness: Annotated[Sourced, make_sourced_validator("stiffness")]  # of the tip along the drag
    frequency: Annotated[Sourced, make_sourced_validator("frequency")]  # at which it rings
    # in which its amplitude falls to 1/e
    decay_time: Annotated[Sourced, make_sourced_validator("time")]
    shank_diameter: Annotated[Sourced, make_sourced_validator("length")]
    modulus: Annotated[Sourced, make_sourced_validator("pressure")]  # Young's modulus of the rod
    density: Annotated[Sourced, make_sourced_validator("density")]  # of the rod

    def make_rod(self) -> Rod:
        """Return the rod that it is taken for."""
        return solve_rod_for_tool(
            self.stiffness.value,
            self.frequency.value,
            self.decay_time.value,
            self.shank_diameter.value,
            self.modulus.value,
            self.density.value,
        )

    def predict_ring(self, sleeve: Sleeve | None = None) -> RodRing:
        """Predict how it rings, bare or with a sheath on its shank."""
        return compute_rod_ring(self.make_rod(), sleeve)


class DampingRig(Table):
    """The rig that moves a tip by a fixed distance and lets it go."""

    displacement: Annotated[Sourced, make_sourced_validator("length")]  # that distance
    # standard deviation of one sample of the displacement
    noise: Annotated[Sourced, make_sourced_validator("length")]
    sample_rate: Annotated[Sourced, make_sourced_validator("frequency")]
    # relative standard uncertainty wanted of the logarithmic decrement
    uncertainty: Annotated[Sourced, make_sourced_validator("ratio")]
