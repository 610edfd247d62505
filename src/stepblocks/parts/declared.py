"""What stanzas are made of: tables, names, sourced values, materials, face demands."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from stepblocks.errors import QuantityError, UsageError
from stepblocks.mistakes import list_mistakes
from stepblocks.parts.tolerance import Dimension, parse_sensible
from stepblocks.quantities import DIMENSIONS, format_quantity, parse_quantity

# names of devices, which Windows lets no file or folder have (Microsoft Learn, Naming Files, Paths,
# and Namespaces)
_WINDOWS_DEVICES = {"con", "prn", "aux", "nul"}
_WINDOWS_DEVICES.update(f"{port}{number}" for port in ("com", "lpt") for number in range(10))


def _refuse_device_name(name: str) -> str:
    if name in _WINDOWS_DEVICES:
        raise ValueError(f"must not be the name of a device, which Windows reserves, got {name!r}")
    return name


# Name of a stimulus: lower-case words and digits joined by hyphens; it becomes a folder and an
# engraving. So no two differ in case alone, and none has a dot, a colon or a space, which Windows
# does not take in the name of a folder
Identity = Annotated[
    str,
    Field(pattern=r"^[a-z][a-z0-9]*(-[a-z0-9]+)*$", max_length=40),
    AfterValidator(_refuse_device_name),
]


def make_rules_validator(check: Callable[[Any], Iterator[str]]) -> Any:
    """Make a validator of a check of a whole table.

    The check yields broken rules; nothing or ``""`` where all hold.
    """

    def check_table(self: object) -> Any:
        if broken := [text for text in check(self) if text]:
            raise ValueError("\n".join(broken))
        return self

    return model_validator(mode="after")(check_table)


def check_rule(holds: bool, field: str, rule: str, limit: float, value: float) -> str:
    """Return the message of a rule that a length breaks; ``""`` where it holds."""
    least, got = format_quantity(limit, "length"), format_quantity(value, "length")
    return "" if holds else f"{field} must {rule} ({least}), got {got}"


def check_below(field: str, rule: str, value: float, limit: float) -> str:
    """Say that a length must lie below a limit; ``""`` where it does."""
    return check_rule(value < limit, field, rule, limit, value)


@dataclass(frozen=True)
class QuantityValidator(BeforeValidator):
    """A validator of a quantity that says which one, so that its value can be written back."""

    dimension: str = "ratio"


def read_positive(dimension: str, *, or_zero: bool = False) -> QuantityValidator:
    """Read a quantity in SI that must be positive, or may be zero."""

    def read(raw: object) -> float:
        value = parse_sensible(raw, dimension)
        QuantityError.require(
            value > 0.0 or (value == 0.0 and or_zero),
            f"must {'not be negative' if or_zero else 'be positive'}, got {raw!r}",
        )
        return value

    return QuantityValidator(read, dimension=dimension)


def declare_default(
    nominal: Any = ..., tolerance: str = "", *, otherwise: str = "", source: str = ""
) -> Any:
    """Declare the default of a field.

    `otherwise` is its tolerance where neither the file nor ISO 2768-1 has one.
    """
    more: dict[str, Any] = {"otherwise": otherwise} if otherwise else {}
    beside = {"tolerance": tolerance, "source": source, **more}
    fields = {"nominal": nominal, **{name: text for name, text in beside.items() if text}}
    return Field(
        fields if len(fields) > 1 and isinstance(nominal, str) else nominal,
        validate_default=True,
        json_schema_extra=more,
    )


class Table(BaseModel):
    """Base of everything declared: frozen, and nothing unknown let through."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    def __init__(self, **fields: object) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:  # in the words of the readers of files
            mistakes = list_mistakes(error, type(self), fields)
            text = " ".join("; ".join(text for _, text in mistakes).split())
            raise UsageError(f"{type(self).__name__}: {text}") from error

    # validation of a file makes tables without it, and lists the mistakes of all of them at once
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="before")
    @classmethod
    def _with_usual_tolerances(cls, raw: object) -> Any:
        if not isinstance(raw, dict):
            return raw
        given = dict(raw)
        for name, field in cls.model_fields.items():
            more = field.json_schema_extra
            one = given.get(name)
            if isinstance(more, dict) and more and one is not None:
                given[name] = {**more, **one} if isinstance(one, dict) else {"nominal": one, **more}
        return given

    def __repr_args__(self) -> Iterator[tuple[str | None, object]]:
        # what was declared; the defaults stand in the reference
        return (one for one in super().__repr_args__() if one[0] in self.model_fields_set)

    def record(self) -> dict[str, object]:
        """Write it out in full for JSON, with the unit in the name of every field."""
        return {
            name: value.record() if hasattr(value, "record") else value
            for name, value in self
            if value is not None
        }

    def dimensions(self, prefix: str = "") -> Iterator[tuple[str, Dimension]]:
        """Yield every dimension with the name of its field, dotted where it stands in a table."""
        for name, value in self:
            if isinstance(value, Dimension):
                yield prefix + name, value
            elif isinstance(value, Table):
                yield from value.dimensions(f"{prefix}{name}.")


@dataclass(frozen=True)
class Sourced:
    """A positive value with its source.

    In a file: ``{ value = "1410 kg/m^3", source = "..." }``.
    """

    value: float  # in the SI unit of `quantity`
    quantity: str  # one of `stepblocks.quantities.DIMENSIONS`
    source: str  # never empty

    def record(self) -> dict[str, object]:
        """Return plain values for JSON, the unit in the name."""
        unit = DIMENSIONS[self.quantity].replace("**", "").replace("/", "_per_").lower()
        return {f"value_{unit}" if unit else "value": self.value, "source": self.source}


def make_sourced_validator(quantity: str) -> BeforeValidator:
    """Read a positive value with its source."""

    def read(raw: object) -> Sourced:
        if isinstance(raw, Sourced):
            return raw
        if not isinstance(raw, dict) or set(raw) != {"value", "source"}:
            raise ValueError(f"must be a table with value and source, got {raw!r:.60}")
        QuantityError.require(
            isinstance(raw["source"], str) and raw["source"].strip(),
            f"source must say where the value comes from, got {raw['source']!r:.60}",
        )
        value = parse_sensible(raw["value"], quantity)
        QuantityError.require(value > 0.0, f"value must be positive, got {raw['value']!r:.60}")
        return Sourced(value, quantity, raw["source"])

    return BeforeValidator(read)


# a quantity alone is what the order states
_ORDERED = BeforeValidator(
    lambda raw: {"value": raw, "source": "as ordered"} if isinstance(raw, str) else raw
)


class Material(Table):
    """A material as a workshop orders it.

    Attributes
    ----------
    name : str
        Key in stimulus files; ``"own"`` for free text.
    designation : str
        What the drawing says, in printable ASCII.
    density : Sourced or None
        Mass density [kg/m^3], such as ``"7650 kg/m3"``, alone or in a table with its source; None
        where nobody stated it.
    heat_treatment : str
        Such as ``"hardened and tempered, 58 HRC"``; may also stand in the designation.
    """

    name: Identity = "own"
    designation: Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[ -&(-~]+$")]
    density: Annotated[Sourced, make_sourced_validator("density"), _ORDERED] | None = None
    heat_treatment: Annotated[str, Field(max_length=80, pattern=r"^[ -&(-~]*$")] = ""

    @property
    def order_text(self) -> str:
        """Designation and heat treatment, as an order says them."""
        return ", ".join(filter(None, (self.designation, self.heat_treatment)))

    @property
    def is_hardened(self) -> bool:
        """Whether the heat treatment hardens it, so that it is tapped before."""
        return re.search(r"(?<!un)harden|\bHRC\b|\bHV\b", self.order_text) is not None

    def record(self) -> dict[str, object]:
        """Return plain values for JSON, the unit in the name."""
        fields: dict[str, object] = {}
        named = {
            "density": ("density_kg_m3", "source"),
            "modulus": ("modulus_pa", "modulus_source"),
        }
        for name, one in self:
            value, source = named.get(name, (name, f"{name}_source"))
            if isinstance(one, Sourced):
                fields |= {value: one.value, source: one.source}
            elif one:
                fields[name] = one
        return fields


# Materials that stimulus files may name, with their densities [kg/m^3]
MATERIALS = {
    key: Material(name=name, designation=text, density=Sourced(density, "density", source))
    for key, name, text, density, source in (
        ("steel", "steel", "X90CrMoV18 (1.4112), hardened", 7700.0, "EN 10088-1:2014, table E.2"),
        ("aluminium", "aluminium", "EN AW-6082 T6", 2700.0, "EN 573-3 data sheet, nominal"),
        ("brass", "brass", "CuZn39Pb3 (CW614N)", 8470.0, "DIN EN 12164 data sheet, nominal"),
        ("pmma", "pmma", "PMMA, cast", 1190.0, "ISO 7823-1 data sheets, nominal"),
        (
            "zirconia",
            "zirconia",
            "3Y-TZP zirconia",
            6050.0,
            "ISO 13356, minimum 6.00 g/cm3, nominal",
        ),
        ("1.4301", "stainless", "X5CrNi18-10 (1.4301)", 7900.0, "EN 10088-1:2014, table E.3"),
    )
}
# grades whose density is known where free text names them, with its source [kg/m^3]
_GRADES = (
    (r"440[ABC]\b|1\.4112|1\.4125|1\.4034|X46Cr13|X90CrMoV18|X105CrMo17", 7700.0, "E.2"),
    (r"17-4 ?PH|1\.4542|X5CrNiCuNb16-4", 7800.0, "E.2"),
    (r"\b304L?\b|1\.4301|1\.4307|1\.4305|\b303\b", 7900.0, "E.3"),
    (r"\b316L?\b|1\.4401|1\.4404", 8000.0, "E.3"),
)


def find_material(raw: object) -> object:
    """Find a material by its key; other text is the designation of an order."""
    if isinstance(raw, Material | dict):
        return raw
    if isinstance(raw, str) and raw in MATERIALS:
        return MATERIALS[raw]
    if not isinstance(raw, str) or (re.fullmatch("[a-z]*", raw) and raw != "stainless"):
        raise ValueError(
            f"must be one of {', '.join(MATERIALS)}, or a designation such as '440C, hardened "
            f"and tempered, 58 HRC', got {raw!r}"
        )
    designation = "stainless steel, grade not stated" if raw == "stainless" else raw
    return Material(
        designation=designation,
        density=next(
            (
                Sourced(value, "density", f"EN 10088-1:2014, table {table}")
                for grade, value, table in _GRADES
                if re.search(grade, raw)
            ),
            None,
        ),
    )


def read_none(raw: object) -> object:
    """Read ``"none"`` as the absence of a feature."""
    return None if raw == "none" else raw


MaterialField = Annotated[Material, BeforeValidator(find_material)]


def _read_zone(raw: object) -> Dimension:
    # Read the width of a zone as a dimension of nominal 0 that may only grow
    if isinstance(raw, Dimension):
        return raw
    width = parse_quantity(raw, "length")
    QuantityError.require(width > 0.0, f"must be positive, got {format_quantity(width, 'length')}")
    return Dimension(0.0, width, 0.0)


# width of a tolerance zone, or largest roughness [m]
Zone = Annotated[Dimension, BeforeValidator(_read_zone)]


class WorkingFaces(Table):
    """What is asked of the faces beside the working edge; what is left out takes its default."""

    flatness: Zone | None = None  # of either face; default a quarter of the height's tolerance band
    parallelism: Zone | None = (
        None  # of the upper face to the lower one, datum A; default half of that band
    )
    roughness: Zone | None = None  # largest Ra; default a twentieth of that band, at least 0.05 um
    base_flatness: Zone | None = None  # of the base; default 5 um
    base_parallelism: Zone | None = None  # of the lower face to the base; default 10 um
    burr: Zone | None = None  # over the upper face near the edge; default the upper deviation


# flatness, parallelism and roughness of the working faces in force
FaceDemands: TypeAlias = dict[str, Dimension]


def complete_face_demands(stated: WorkingFaces | None, governing: Dimension) -> FaceDemands:
    """Complete the demands on faces from the tolerance of the height."""
    band = governing.upper - governing.lower
    rough = max(round(band * 1e6 / 20.0, 2), 0.05) / 1e6
    widths = {
        "flatness": 0.25 * band,
        "parallelism": 0.5 * band,
        "roughness": rough,
        "base_flatness": 5e-6,
        # a tilt of 10 um over the block turns the pull by less than its hundredth
        "base_parallelism": 10e-6,
        "burr": governing.upper if governing.upper > 0.0 else 0.5 * band,
    }
    zones = {name: Dimension(0.0, width, 0.0, usual=True) for name, width in widths.items()}
    return zones | {name: zone for name, zone in stated or () if zone is not None}
