"""What the parts are made of: density for the mass, a designation for the drawing and the STEP file."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """A material as a workshop orders it."""

    name: str  # Key in stimulus files
    designation: str  # What stands on the drawing
    density: float  # Density [kg/m^3]
    source: str  # Where the density comes from


# Materials that stimulus files may name
MATERIALS = (
    Material("steel", "X90CrMoV18 (1.4112), hardened", 7700.0, "EN 10088-1:2014, table E.2"),
    Material("stainless", "X5CrNi18-10 (1.4301)", 7900.0, "EN 10088-1:2014, table E.3"),
    Material("brass", "CuZn39Pb3 (CW614N)", 8470.0, "DIN EN 12164 data sheet, nominal"),
    Material("pmma", "PMMA, cast", 1190.0, "ISO 7823-1 data sheets, nominal"),
    Material("zirconia", "3Y-TZP zirconia", 6050.0, "ISO 13356, minimum 6.00 g/cm3, nominal"),
)


def material_named(name: object) -> Material:
    """Find a material by its key.

    Examples
    --------
    >>> material_named("brass").density
    8470.0
    """
    if isinstance(name, Material):
        return name
    for material in MATERIALS:
        if material.name == name:
            return material
    raise ValueError(f"must be one of {', '.join(m.name for m in MATERIALS)}, got {name!r}")
