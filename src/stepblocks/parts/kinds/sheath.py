"""Sheaths for the shank of a probe: tubes of different materials, one made as heavy as another."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar

from stepblocks import cad
from stepblocks.contact.rod import Sleeve
from stepblocks.parts.characteristics import (
    Characteristic,
    EdgeRule,
    FaceRule,
    describe_plane,
    make_characteristic,
    make_edge_break,
)
from stepblocks.parts.declared import (
    Material,
    Sourced,
    check_below,
    check_rule,
    make_rules_validator,
    make_sourced_validator,
)
from stepblocks.parts.kind import (
    FITTING_DEFLECTION,
    Finding,
    HeldPart,
    Manifold,
    MeasuredMesh,
    Verdict,
)
from stepblocks.parts.revolution import Outline, Point, Turned, make_sectors
from stepblocks.parts.tolerance import Length, PositiveLength
from stepblocks.quantities import format_quantity

# Largest relative difference in mass of two sheaths that are to weigh the same (the paper's
# sheaths: equal weight)
MASS_MATCH = 0.01
MASS_LIMIT = 1e-6  # mass of a mesh against the declared one, relative
_FLOAT32_LIMIT = 10e-9  # of lengths up to 100 mm, which GLB keeps as float32 in metres


class SheathMaterial(Material):
    """A material that bends and damps; modulus and ratios at the frequency of the ring."""

    density: Annotated[Sourced, make_sourced_validator("density")]
    modulus: Annotated[Sourced, make_sourced_validator("pressure")]  # Young's
    poisson: Annotated[Sourced, make_sourced_validator("ratio")]
    loss_factor: Annotated[Sourced, make_sourced_validator("ratio")]

    @make_rules_validator
    def _check_elasticity(self) -> Iterator[str]:
        if self.poisson.value > 0.5:
            yield f"poisson must not exceed 0.5, got {self.poisson.value:g}"


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
        bore, outer, length = self.bore.nominal, self.outer_diameter.nominal, self.length.nominal
        return Sleeve(
            self.position.nominal,
            length,
            self.material.modulus.value * math.pi * (outer**4 - bore**4) / 64.0,
            self.mass / length,
            self.material.loss_factor.value,
        )

    @property
    def mass(self) -> float:  # nominal [kg]
        return self.material.density.value * _compute_volume(
            self.bore.nominal,
            self.outer_diameter.nominal,
            self.length.nominal,
            self.edge_break.nominal,
        )

    @property
    def mass_limits(self) -> tuple[float, float]:
        """Least and greatest mass within the tolerances [kg]."""
        (thin, wide), (small, large) = self.bore.limits, self.outer_diameter.limits
        (short, long), (sharp, blunt) = self.length.limits, self.edge_break.limits
        density = self.material.density.value
        return density * _compute_volume(wide, small, short, blunt), density * _compute_volume(
            thin, large, long, max(sharp, 0.0)
        )

    def outlines(self) -> list[Outline]:
        return [[*self.outline()]]

    def outline(self) -> list[Point]:
        """Half section; the near end lies at height 0."""
        bore, outer = 0.5 * self.bore.nominal, 0.5 * self.outer_diameter.nominal
        length, c = self.length.nominal, self.edge_break.nominal
        if c == 0.0:
            return [(bore, 0.0), (outer, 0.0), (outer, length), (bore, length)]
        return [
            (bore, 0.0),
            (outer - c, 0.0),
            (outer, c),
            (outer, length - c),
            (outer - c, length),
            (bore, length),
        ]

    def hulls(self) -> list[Manifold]:
        return make_sectors(self.outline())

    def chordal_error(self, face: cad.door.Face) -> float:
        return FITTING_DEFLECTION

    def characteristics(self) -> Iterator[Characteristic]:
        bore, outer, broken = self.bore, self.outer_diameter, self.edge_break
        side = FaceRule("CYLINDER", radius=0.5 * outer.nominal)
        yield make_characteristic(
            "bore",
            "diameter",
            bore,
            FaceRule("CYLINDER", radius=0.5 * bore.nominal),
            method="pin gauges",
        )
        yield make_characteristic("outer_diameter", "diameter", outer, side)
        yield make_characteristic(
            "length",
            "distance",
            self.length,
            describe_plane(2, 0.0),
            describe_plane(2, self.length.nominal),
        )
        yield make_edge_break(
            broken,
            describe_plane(2, 0.0),
            EdgeRule(FaceRule("CONE", holds={2: 0.5 * broken.nominal}), side),
        )
        yield make_characteristic(
            "position",
            "note",
            self.position,
            label="position, from the clamp",
            method="caliper, assembled",
        )

    def measure_mesh(self, body: int, mesh: MeasuredMesh) -> Iterator[Verdict]:
        heights, radii = mesh.vertices[:, 2], mesh.radii
        yield Finding(
            "length", self.length.nominal, float(heights.max() - heights.min()), _FLOAT32_LIMIT
        )
        yield Finding(
            "radius of the bore", 0.5 * self.bore.nominal, float(radii.min()), FITTING_DEFLECTION
        )
        yield Finding(
            "outer radius",
            0.5 * self.outer_diameter.nominal,
            float(radii.max()),
            FITTING_DEFLECTION,
        )
        yield Finding(
            "mass",
            self.mass,
            self.material.density.value * mesh.volume,
            MASS_LIMIT,
            "mass",
            relative=True,
        )

    def choose_close_up(self) -> tuple[float, float, tuple[float, float, float]]:
        outer = self.outer_diameter.nominal
        return 1.0, min(0.6 * outer, 4.9e-3), (0.0, 0.0, 0.4 * outer)

    def derived(self) -> list[list[str]]:
        low, high = self.mass_limits
        return [
            [
                "mass",
                f"{format_mass(self.mass)} ({format_mass(low)} to {format_mass(high)} within "
                "tolerances)",
            ],
            ["material", self.material.designation],
        ]

    def list_missing_conditions(self, conditions: Mapping[str, Any]) -> Iterator[str]:
        missing = [name for name in ("probe", "damping_rig") if conditions[name] is None]
        yield from (f"{name} must be declared for a set with sheaths, got none" for name in missing)
        shank = 0.0 if "probe" in missing else conditions["probe"].shank_diameter.value
        if self.bore.limits[0] < shank:
            yield (
                f"bore must not be less than the shank ({format_quantity(shank, 'length')}) "
                f"within its tolerance, got {self.bore} [sheath {self.id!r}]"
            )

    @make_rules_validator
    def _check_sizes(self) -> Iterator[str]:
        bore, outer, broken = (
            self.bore.nominal,
            self.outer_diameter.nominal,
            self.edge_break.nominal,
        )
        yield check_rule(
            self.outer_diameter.limits[0] > self.bore.limits[1],
            "outer_diameter",
            "exceed bore, within their tolerances too",
            bore,
            outer,
        )
        if outer > bore:  # without a wall, nothing can be said of what is cut into it
            yield check_below(
                "edge_break",
                "be smaller than the wall and half the length",
                broken,
                0.5 * min(outer - bore, self.length.nominal),
            )


def _compute_volume(bore: float, outer: float, length: float, broken: float) -> float:
    # Tube less two rings of triangular section, by Pappus
    tube = 0.25 * math.pi * (outer**2 - bore**2) * length
    return tube - 2.0 * math.pi * broken**2 * (0.5 * outer - broken / 3.0)


def format_mass(mass: float) -> str:
    """Write a mass as people read it."""
    return f"{mass * 1e3:.4g} g"
