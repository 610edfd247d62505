"""Sheaths for the shank of a probe: tubes of different materials, one made as heavy as another."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from stepblocks import cad
from stepblocks.contact.rod import Sleeve
from stepblocks.parts.characteristics import (
    Characteristic,
    EdgeRule,
    FaceRule,
    make_characteristic,
    make_edge_break_characteristic,
    make_plane_rule,
)
from stepblocks.parts.declared import (
    LabelledText,
    Sourced,
    describe_breach,
    make_rules_validator,
    make_sourced_validator,
)
from stepblocks.parts.face_characteristics import make_contact_roughness_characteristic
from stepblocks.parts.kind import (
    FITTING_DEFLECTION,
    CloseUp,
    Finding,
    HeldPart,
    Manifold,
    MeasuredMesh,
    Verdict,
)
from stepblocks.parts.material import Material
from stepblocks.parts.revolution import Outline, Point, Turned, turn_cell_into_sectors
from stepblocks.parts.tolerance import Length, PositiveLength
from stepblocks.quantities import format_quantity

# Largest relative difference in mass of two sheaths that are to weigh the same (the paper's
# sheaths: equal weight)
MASS_MATCH = 0.01
MASS_LIMIT = 1e-6  # mass of a mesh against the declared one, relative
# of lengths up to 100 mm, which GLB keeps as float32 in metres [m]
_FLOAT32_LIMIT = 10e-9
_LARGEST_POISSON = 0.5  # of a material that keeps its volume
_WIDEST_CLOSE_UP = 4.9e-3  # [m]


class SheathMaterial(Material):
    """A material that bends and damps; modulus and ratios at the frequency of the ring.

    Attributes
    ----------
    density : Sourced
        Mass density [kg/m^3], in a table with its source.
    modulus : Sourced
        Young's modulus [Pa], in a table with its source.
    poisson : Sourced
        Poisson's ratio [1], in a table with its source.
    loss_factor : Sourced
        Loss factor [1], in a table with its source.
    """

    density: Annotated[Sourced, make_sourced_validator("density")]
    modulus: Annotated[Sourced, make_sourced_validator("pressure")]
    poisson: Annotated[Sourced, make_sourced_validator("ratio")]
    loss_factor: Annotated[Sourced, make_sourced_validator("ratio")]

    def record(self) -> dict[str, object]:
        return {
            **super().record(),
            "modulus_pa": self.modulus.value,
            "modulus_source": self.modulus.source,
            "poisson": self.poisson.value,
            "poisson_source": self.poisson.source,
            "loss_factor": self.loss_factor.value,
            "loss_factor_source": self.loss_factor.source,
        }

    @make_rules_validator
    def _yield_elasticity_breaches(self) -> Iterator[str]:
        if self.poisson.value > _LARGEST_POISSON:
            yield f"poisson must not exceed {_LARGEST_POISSON:g}, got {self.poisson.value:g}"


class Sheath(Turned, HeldPart):
    """A tube over the shank; its end near the clamp lies at z = 0, its axis is z.

    Attributes
    ----------
    id : str
        Name in the set, in lower case.
    bore, outer_diameter : Dimension
        Inner and outer diameter [m].
    length : Dimension
        From end to end [m].
    edge_break : Dimension
        Leg of the 45 degree chamfer on the two outer edges [m].
    position : Dimension
        From the clamp to the near end, along the shank [m].
    material : SheathMaterial
        What it is made of, with density [kg/m^3], Young's modulus [Pa], Poisson's ratio and loss
        factor [1] at the frequency of the ring.
    """

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    stanza: ClassVar[str] = "sheath"
    kind_name: ClassVar[str] = "sheath of the probe"
    governing_field: ClassVar[str] = "bore"

    bore: PositiveLength
    outer_diameter: PositiveLength
    length: PositiveLength
    edge_break: Length
    position: Length
    material: SheathMaterial

    @property
    def sleeve(self) -> Sleeve | None:
        bore = self.bore.nominal
        outer = self.outer_diameter.nominal
        length = self.length.nominal
        modulus = self.material.modulus.value
        bending_stiffness = modulus * math.pi * (outer**4 - bore**4) / 64.0
        return Sleeve(
            self.position.nominal,
            length,
            bending_stiffness,
            self.mass / length,
            self.material.loss_factor.value,
        )

    @property
    def mass(self) -> float:
        """Nominal mass [kg]."""
        volume = _compute_tube_volume(
            self.bore.nominal,
            self.outer_diameter.nominal,
            self.length.nominal,
            self.edge_break.nominal,
        )
        return self.material.density.value * volume

    @property
    def mass_limits(self) -> tuple[float, float]:
        """Least and greatest mass within the tolerances [kg]."""
        least_bore, largest_bore = self.bore.limits
        least_outer, largest_outer = self.outer_diameter.limits
        least_length, largest_length = self.length.limits
        least_break, largest_break = self.edge_break.limits
        density = self.material.density.value
        least = _compute_tube_volume(largest_bore, least_outer, least_length, largest_break)
        largest = _compute_tube_volume(
            least_bore, largest_outer, largest_length, max(least_break, 0.0)
        )
        return density * least, density * largest

    def outlines(self) -> list[Outline]:
        return [[*self.outline()]]

    def outline(self) -> list[Point]:
        """Outline a half section; the near end lies at height 0."""
        bore = 0.5 * self.bore.nominal
        outer = 0.5 * self.outer_diameter.nominal
        length = self.length.nominal
        chamfer = self.edge_break.nominal
        if chamfer == 0.0:
            return [(bore, 0.0), (outer, 0.0), (outer, length), (bore, length)]
        return [
            (bore, 0.0),
            (outer - chamfer, 0.0),
            (outer, chamfer),
            (outer, length - chamfer),
            (outer - chamfer, length),
            (bore, length),
        ]

    def hulls(self) -> list[Manifold]:
        return turn_cell_into_sectors(self.outline())

    def chordal_error(self, face: cad.door.Face) -> float:
        return FITTING_DEFLECTION

    def characteristics(self) -> Iterator[Characteristic]:
        near_end = make_plane_rule(2, 0.0)
        far_end = make_plane_rule(2, self.length.nominal)
        inside = FaceRule("CYLINDER", radius=0.5 * self.bore.nominal)
        outside = FaceRule("CYLINDER", radius=0.5 * self.outer_diameter.nominal)
        yield make_characteristic("bore", "diameter", self.bore, inside, method="pin gauges")
        yield make_characteristic("outer_diameter", "diameter", self.outer_diameter, outside)
        yield make_characteristic("length", "distance", self.length, near_end, far_end)
        chamfer = FaceRule("CONE", holds={2: 0.5 * self.edge_break.nominal})
        yield make_edge_break_characteristic(self.edge_break, near_end, EdgeRule(chamfer, outside))
        yield make_characteristic(
            "position",
            "note",
            self.position,
            label="position, from the clamp",
            method="caliper, assembled",
        )
        yield make_contact_roughness_characteristic(
            self.face_demands["roughness"], (inside,), "bore"
        )

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        heights = mesh.vertices[:, 2]
        length = float(heights.max() - heights.min())
        yield Finding("length", self.length.nominal, length, _FLOAT32_LIMIT)
        bore = float(mesh.radii.min())
        yield Finding("radius of the bore", 0.5 * self.bore.nominal, bore, FITTING_DEFLECTION)
        outer = float(mesh.radii.max())
        nominal_outer = 0.5 * self.outer_diameter.nominal
        yield Finding("outer radius", nominal_outer, outer, FITTING_DEFLECTION)
        mass = self.material.density.value * mesh.volume
        yield Finding("mass", self.mass, mass, MASS_LIMIT, "mass", relative=True)

    def choose_close_up(self) -> CloseUp:
        outer = self.outer_diameter.nominal
        return CloseUp(1.0, min(0.6 * outer, _WIDEST_CLOSE_UP), (0.0, 0.0, 0.4 * outer))

    def derived(self) -> list[LabelledText]:
        least, largest = self.mass_limits
        mass = (
            f"{format_mass(self.mass)} ({format_mass(least)} to {format_mass(largest)} within "
            "tolerances)"
        )
        return [["mass", mass], ["material", self.material.designation]]

    def list_missing_conditions(self, conditions: Mapping[str, Any]) -> Iterator[str]:
        for name in ("probe", "damping_rig"):
            if conditions[name] is None:
                yield f"{name} must be declared for a set with sheaths, got none"
        probe = conditions["probe"]
        if probe is None:
            return
        shank = probe.shank_diameter.value
        least_bore, _ = self.bore.limits
        if least_bore < shank:
            yield (
                f"bore must not be less than the shank ({format_quantity(shank, 'length')}) "
                f"within its tolerance, got {self.bore} [sheath {self.id!r}]"
            )

    @make_rules_validator
    def _yield_size_breaches(self) -> Iterator[str]:
        """Yield what keeps the tube from having a wall."""
        bore = self.bore.nominal
        outer = self.outer_diameter.nominal
        chamfer = self.edge_break.nominal
        least_outer, _ = self.outer_diameter.limits
        _, largest_bore = self.bore.limits
        if least_outer <= largest_bore:
            rule = "exceed bore, within their tolerances too"
            yield describe_breach("outer_diameter", rule, bore, outer)
        if outer <= bore:  # without a wall, nothing can be said of what is cut into it
            return
        largest = 0.5 * min(outer - bore, self.length.nominal)
        if chamfer >= largest:
            rule = "be smaller than the wall and half the length"
            yield describe_breach("edge_break", rule, largest, chamfer)


def _compute_tube_volume(bore: float, outer: float, length: float, chamfer: float) -> float:
    """Compute the volume of a tube less two rings of triangular section [m^3], by Pappus."""
    tube = 0.25 * math.pi * (outer**2 - bore**2) * length
    return tube - 2.0 * math.pi * chamfer**2 * (0.5 * outer - chamfer / 3.0)


def format_mass(mass: float) -> str:
    """Write a mass [kg] in grams, to four digits."""
    return f"{mass * 1e3:.4g} g"
