"""Materials as a workshop orders them, and the densities of those that are known."""

import re
from dataclasses import dataclass
from enum import Enum
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field

from stepblocks.parts.declared import Identity, Sourced, Table, make_sourced_validator


def _read_ordered_density(raw: object) -> object:
    """Read a density alone as one that the order states."""
    if isinstance(raw, str):
        return {"value": raw, "source": "as ordered"}
    return raw


# Code points of the letters and signs that a drawing's font has: Latin, Greek and Cyrillic letters,
# and dashes, quotation marks and other signs of print
_DRAWN = ((0x20, 0x7E), (0xA0, 0x52F), (0x1E00, 0x1FFF), (0x2010, 0x2044), (0x2070, 0x22FF))


def _require_drawable_text(text: str) -> str:
    """Return a text unchanged; refuse one with a sign that a drawing cannot show."""
    for sign in text:
        is_drawn = any(first <= ord(sign) <= last for first, last in _DRAWN)
        if not is_drawn or not sign.isprintable():
            raise ValueError(
                "must be written in Latin, Greek or Cyrillic letters, digits and signs, as a "
                f"drawing shows them, got {sign!r} in {text!r}"
            )
    return text


_DrawnText = AfterValidator(_require_drawable_text)


class Material(Table):
    """A material as a workshop orders it.

    Attributes
    ----------
    name : str
        Key in stimulus files; ``"own"`` for free text.
    designation : str
        What the drawing says: free text in Latin, Greek or Cyrillic letters.
    density : Sourced or None
        Mass density [kg/m^3], such as ``"7650 kg/m3"``, alone or in a table with its source; None
        where nobody stated it.
    heat_treatment : str
        Such as ``"hardened and tempered, 58 HRC"``; may also stand in the designation.
    """

    name: Identity = "own"
    designation: Annotated[str, Field(min_length=1, max_length=80), _DrawnText]
    density: (
        Annotated[
            Sourced, make_sourced_validator("density"), BeforeValidator(_read_ordered_density)
        ]
        | None
    ) = None
    heat_treatment: Annotated[str, Field(max_length=80), _DrawnText] = ""

    @property
    def order_text(self) -> str:
        """Designation and heat treatment, as an order says them."""
        if not self.heat_treatment:
            return self.designation
        return f"{self.designation}, {self.heat_treatment}"

    @property
    def is_hardened(self) -> bool:
        """Whether the heat treatment hardens it, so that it is tapped before."""
        return re.search(r"(?<!un)harden|\bHRC\b|\bHV\b", self.order_text) is not None

    @property
    def family(self) -> "Family | None":
        """Kind of material by which ways of making differ; None if its designation is not known."""
        for family, pattern in _FAMILY_WORDS:
            if re.search(pattern, self.designation, re.IGNORECASE):
                if family is Family.STEEL and self.is_hardened:
                    return Family.HARDENED_STEEL
                return family
        return None

    def record(self) -> dict[str, object]:
        """Return plain values for JSON, the unit in the name."""
        fields: dict[str, object] = {"name": self.name, "designation": self.designation}
        if self.density is not None:
            fields["density_kg_m3"] = self.density.value
            fields["source"] = self.density.source
        if self.heat_treatment:
            fields["heat_treatment"] = self.heat_treatment
        return fields


def _make_material(name: str, designation: str, density: float, source: str) -> Material:
    """Make a material of a density [kg/m^3] with its source."""
    return Material(name=name, designation=designation, density=Sourced(density, "density", source))


# Materials that stimulus files may name
MATERIALS = {
    "steel": _make_material(
        "steel", "X90CrMoV18 (1.4112), hardened", 7700.0, "EN 10088-1:2014, table E.2"
    ),
    "aluminium": _make_material(
        "aluminium", "EN AW-6082 T6", 2700.0, "EN 573-3 data sheet, nominal"
    ),
    "brass": _make_material(
        "brass", "CuZn39Pb3 (CW614N)", 8470.0, "DIN EN 12164 data sheet, nominal"
    ),
    "pmma": _make_material("pmma", "PMMA, cast", 1190.0, "ISO 7823-1 data sheets, nominal"),
    "zirconia": _make_material(
        "zirconia", "3Y-TZP zirconia", 6050.0, "ISO 13356, minimum 6.00 g/cm3, nominal"
    ),
    "silicon": _make_material(
        "silicon",
        "Silicon wafer, single crystal",
        2329.0,
        "lattice parameter (CODATA 2018), molar mass",
    ),
    "1.4301": _make_material(
        "stainless", "X5CrNi18-10 (1.4301)", 7900.0, "EN 10088-1:2014, table E.3"
    ),
}


class Family(Enum):
    """What a way of making asks of a material."""

    HARDENED_STEEL = "hardened steel"
    STEEL = "steel"
    GAUGE_STEEL = "gauge-block steel"
    ALUMINIUM = "aluminium"
    COPPER = "copper alloy"
    NICKEL = "nickel"
    CERAMIC = "ceramic"
    SILICON = "silicon"
    POLYMER = "polymer"
    PHOTOPOLYMER = "photopolymer"


# words and numbers of designations, the narrower families first
_FAMILY_WORDS = (
    (Family.GAUGE_STEEL, r"gauge[- ]block"),
    (Family.SILICON, r"\bsilicon\b(?! carbide| nitride)"),
    (Family.PHOTOPOLYMER, r"photopolymer|photoresist|\bSLA\b"),
    (Family.POLYMER, r"PMMA|PEEK|POM\b|polymer|plastic|acryl|epoxy|nylon|resin"),
    (Family.CERAMIC, r"zirconia|TZP|alumina\b|ceramic|silicon carbide|silicon nitride|Al2O3|ZrO2"),
    (Family.ALUMINIUM, r"\bAW-?\d|alumin|AlMg|AlSi|\b[67]0\d\d\b"),
    (Family.COPPER, r"\bCu(?=[A-Z]|\b)|\bCW\d|brass|bronze|copper"),
    (Family.STEEL, r"steel|\b1\.[234]\d{3}\b|\bX\d+Cr|\b(?:303|304|316|420|430|440)[A-CL]?\b|17-4"),
    (Family.NICKEL, r"nickel|inconel"),
)


@dataclass(frozen=True)
class _Grade:
    """A grade of steel whose density is known (EN 10088-1:2014)."""

    pattern: str  # of its names in free text
    density: float  # [kg/m^3]
    table: str  # of the standard


_GRADES = (
    _Grade(r"440[ABC]\b|1\.4112|1\.4125|1\.4034|X46Cr13|X90CrMoV18|X105CrMo17", 7700.0, "E.2"),
    _Grade(r"17-4 ?PH|1\.4542|X5CrNiCuNb16-4", 7800.0, "E.2"),
    _Grade(r"\b304L?\b|1\.4301|1\.4307|1\.4305|\b303\b", 7900.0, "E.3"),
    _Grade(r"\b316L?\b|1\.4401|1\.4404", 8000.0, "E.3"),
)


def read_material(raw: object) -> object:
    """Find a material by its key; other text is the designation of an order.

    Raises
    ------
    ValueError
        If it is a single word that is no key: a designation says more.
    """
    if isinstance(raw, Material | dict):
        return raw
    if raw == "stainless":
        return Material(designation="stainless steel, grade not stated", density=None)
    if isinstance(raw, str):
        if raw in MATERIALS:
            return MATERIALS[raw]
        if not re.fullmatch("[a-z]*", raw):
            return Material(designation=raw, density=_find_steel_density(raw))
    raise ValueError(
        f"must be one of {', '.join(MATERIALS)}, or a designation such as '440C, hardened "
        f"and tempered, 58 HRC', got {raw!r}"
    )


def _find_steel_density(designation: str) -> Sourced | None:
    """Find the density of the steel that a designation names; None if it names none."""
    for grade in _GRADES:
        if re.search(grade.pattern, designation):
            return Sourced(grade.density, "density", f"EN 10088-1:2014, table {grade.table}")
    return None


MaterialField = Annotated[Material, BeforeValidator(read_material)]
