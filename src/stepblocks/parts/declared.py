"""What stanzas are made of: tables, names, defaults, rules, sourced values, face demands."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from stepblocks.errors import QuantityError, UsageError
from stepblocks.mistakes import list_mistakes
from stepblocks.parts.tolerance import (
    Dimension,
    Origin,
    find_declared_origin,
    parse_declared_quantity,
    parse_plausible_quantity,
)
from stepblocks.quantities import DIMENSIONS, format_quantity, unwrap_array_scalar

# names of devices, which Windows lets no file or folder have (Microsoft Learn, Naming Files, Paths,
# and Namespaces)
_WINDOWS_DEVICES = {"con", "prn", "aux", "nul"}
_WINDOWS_DEVICES.update(f"{port}{number}" for port in ("com", "lpt") for number in range(10))


_IDENTITY = r"^[a-z][a-z0-9]*(-[a-z0-9]+)*$"
_LONGEST_IDENTITY = 40  # letters


def _refuse_device_name(name: str) -> str:
    """Return a name unchanged; refuse one that Windows reserves for a device."""
    if name in _WINDOWS_DEVICES:
        raise ValueError(f"must not be the name of a device, which Windows reserves, got {name!r}")
    return name


# Name of a stimulus: lower-case words and digits joined by hyphens; it becomes a folder and an
# engraving. So no two differ in case alone, and none has a dot, a colon or a space, which Windows
# does not take in the name of a folder
Identity = Annotated[
    str,
    Field(pattern=_IDENTITY, max_length=_LONGEST_IDENTITY),
    AfterValidator(_refuse_device_name),
]


def is_identity(name: str) -> bool:
    """Tell whether a text may be the name of a stimulus or of a set."""
    if len(name) > _LONGEST_IDENTITY or name in _WINDOWS_DEVICES:
        return False
    return re.fullmatch(_IDENTITY, name) is not None


def make_rules_validator(yield_broken_rules: Callable[[Any], Iterator[str]]) -> Any:
    """Make a validator of a whole table from a check that yields each broken rule."""

    def refuse_broken_rules(self: object) -> Any:
        """Return a table unchanged; refuse one that breaks a rule."""
        broken_rules = list(yield_broken_rules(self))
        if broken_rules:
            raise ValueError("\n".join(broken_rules))
        return self

    return model_validator(mode="after")(refuse_broken_rules)


def describe_breach(field: str, rule: str, limit: float, value: float) -> str:
    """Say that a length breaks a rule.

    Parameters
    ----------
    field : str
        Name of the field, dotted where it stands in a table.
    rule : str
        What it must do, such as ``"not exceed height"``.
    limit, value : float
        What the rule compares it with, and what it is [m].

    Returns
    -------
    str
        Such as ``"edge_radius must not exceed height (10 um), got 12.5 um"``.
    """
    limit_text = format_quantity(limit, "length")
    value_text = format_quantity(value, "length")
    return f"{field} must {rule} ({limit_text}), got {value_text}"


@dataclass(frozen=True)
class QuantityValidator(BeforeValidator):
    """A validator of a quantity that says which one, so that its value can be written back."""

    dimension: str = "ratio"


def make_positive_validator(dimension: str, *, or_zero: bool = False) -> QuantityValidator:
    """Make a validator that reads a quantity in SI, which must be positive, or may be zero."""

    def read_quantity(raw: object, info: ValidationInfo) -> float:
        """Read a quantity in SI, and refuse a wrong sign."""
        value = parse_plausible_quantity(raw, dimension, find_declared_origin(info))
        if or_zero and not value >= 0.0:
            raise QuantityError(f"must not be negative, got {raw!r}")
        if not or_zero and not value > 0.0:
            raise QuantityError(f"must be positive, got {raw!r}")
        return value

    return QuantityValidator(read_quantity, dimension=dimension)


def declare_default(
    nominal: Any = ..., tolerance: str = "", *, otherwise: str = "", source: str = ""
) -> Any:
    """Declare the default of a field.

    Parameters
    ----------
    nominal : object
        As a file would state it; the field must be given where it is left out.
    tolerance : str
        Tolerance of the default.
    otherwise : str
        Tolerance where neither the file nor ISO 2768-1 has one.
    source : str
        Where the default comes from.

    Returns
    -------
    pydantic.fields.FieldInfo
        The default of a field of a `Table`.
    """
    usual_tolerance: dict[str, Any] = {}
    if otherwise:
        usual_tolerance["otherwise"] = otherwise
    default = nominal
    if isinstance(nominal, str):
        stated = {"tolerance": tolerance, "source": source, **usual_tolerance}
        stated = {name: text for name, text in stated.items() if text}
        if stated:
            default = {"nominal": nominal, **stated}
    return Field(default, validate_default=True, json_schema_extra=usual_tolerance)


class Table(BaseModel):
    """Base of everything declared: frozen, with no unknown names."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    def __init__(self, **fields: object) -> None:
        fields = {name: unwrap_array_scalar(value) for name, value in fields.items()}
        try:
            self.__pydantic_validator__.validate_python(
                fields, self_instance=self, context=Origin.PYTHON
            )
        except ValidationError as error:  # in the words of the readers of files
            validate = partial(type(self).model_validate, context=Origin.PYTHON)
            mistakes = list_mistakes(error, type(self), fields, validate=validate)
            text = " ".join("; ".join(text for _, text in mistakes).split())
            raise UsageError(f"{type(self).__name__}: {text}") from error

    # validation of a file makes tables without it, and lists the mistakes of all of them at once
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="before")
    @classmethod
    def _add_default_tolerances(cls, raw: object) -> Any:
        """Add the default tolerance of each field to its value, where none is stated."""
        if not isinstance(raw, dict):
            return raw
        table = dict(raw)
        for name, field in cls.model_fields.items():
            usual = field.json_schema_extra
            value = table.get(name)
            if not isinstance(usual, dict) or not usual or value is None:
                continue
            if isinstance(value, dict):
                table[name] = {**usual, **value}
            else:
                table[name] = {"nominal": value, **usual}
        return table

    def __repr_args__(self) -> Iterator[tuple[str | None, object]]:
        """Yield what was declared; the defaults stand in the reference."""
        for name, value in super().__repr_args__():
            if name in self.model_fields_set:
                yield name, value

    def record(self) -> dict[str, object]:
        """Write it out in full for JSON, with the unit in the name of every field."""
        fields: dict[str, object] = {}
        for name, value in self:
            if value is None:
                continue
            fields[name] = value.record() if hasattr(value, "record") else value
        return fields

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
        name = f"value_{unit}" if unit else "value"
        return {name: self.value, "source": self.source}


def make_sourced_validator(quantity: str) -> BeforeValidator:
    """Make a validator that reads a positive value with its source."""

    def read_sourced(raw: object, info: ValidationInfo) -> Sourced:
        """Read a table with a positive value and its source."""
        if isinstance(raw, Sourced):
            return raw
        if not isinstance(raw, dict) or set(raw) != {"value", "source"}:
            raise ValueError(f"must be a table with value and source, got {raw!r:.60}")
        source = raw["source"]
        if not isinstance(source, str) or not source.strip():
            raise QuantityError(f"source must say where the value comes from, got {source!r:.60}")
        value = parse_plausible_quantity(raw["value"], quantity, find_declared_origin(info))
        if not value > 0.0:
            raise QuantityError(f"value must be positive, got {raw['value']!r:.60}")
        return Sourced(value, quantity, source)

    return BeforeValidator(read_sourced)


def read_none_as_absent(raw: object) -> object:
    """Return None for ``"none"``, the absence of a feature; anything else unchanged."""
    return None if raw == "none" else raw


def _read_zone(raw: object, info: ValidationInfo) -> Dimension:
    """Read the width of a zone as a dimension of nominal 0 that may only grow."""
    if isinstance(raw, Dimension):
        return raw
    width = parse_declared_quantity(raw, "length", find_declared_origin(info))
    if not width > 0.0:
        raise QuantityError(f"must be positive, got {format_quantity(width, 'length')}")
    return Dimension(0.0, width, 0.0)


# width of a tolerance zone, or largest roughness [m]
Zone = Annotated[Dimension, BeforeValidator(_read_zone)]


class WorkedOut:
    """Marks a field that the program finds, and that no file states."""


class WorkingFaces(Table):
    """What is asked of the faces beside the working edge; what is left out takes its default.

    Attributes
    ----------
    flatness : Dimension or None
        Flatness of either face; left out, a quarter of the height's tolerance band.
    parallelism : Dimension or None
        Parallelism of the upper face to the lower one, datum A; left out, half of that band.
    roughness : Dimension or None
        Largest Ra; left out, a twentieth of that band, at least 0.05 um.
    base_flatness : Dimension or None
        Flatness of the base; left out, 5 um.
    base_parallelism : Dimension or None
        Parallelism of the lower face to the base; left out, 10 um.
    burr : Dimension or None
        Height of a burr over the upper face near the edge; left out, the upper deviation.
    """

    flatness: Zone | None = None
    parallelism: Zone | None = None
    roughness: Zone | None = None
    base_flatness: Zone | None = None
    base_parallelism: Zone | None = None
    burr: Zone | None = None


# what a figure is, and the figure with its unit, both for people
LabelledText: TypeAlias = list[str]

# flatness, parallelism and roughness of the working faces in force
FaceDemands: TypeAlias = dict[str, Dimension]

_SMOOTHEST = 0.05  # roughness that is asked by default, at least [um]
_BASE_FLATNESS = 5e-6  # [m]
# a tilt of 10 um over the block turns the pull by less than its hundredth [m]
_BASE_PARALLELISM = 10e-6


def complete_face_demands(stated: WorkingFaces | None, governing: Dimension) -> FaceDemands:
    """Complete the demands on faces from the tolerance of the height.

    Parameters
    ----------
    stated : WorkingFaces or None
        What the file states.
    governing : Dimension
        Height whose tolerance band sets the defaults.

    Returns
    -------
    dict of str to Dimension
        Zones of nominal 0 [m] by the names of `WorkingFaces`.
    """
    band = governing.upper - governing.lower
    roughness = max(round(band * 1e6 / 20.0, 2), _SMOOTHEST) / 1e6
    burr = governing.upper
    if burr <= 0.0:
        burr = 0.5 * band
    widths = {
        "flatness": 0.25 * band,
        "parallelism": 0.5 * band,
        "roughness": roughness,
        "base_flatness": _BASE_FLATNESS,
        "base_parallelism": _BASE_PARALLELISM,
        "burr": burr,
    }
    zones: FaceDemands = {}
    for name, width in widths.items():
        zone: Dimension | None = getattr(stated, name, None)
        if zone is None:
            zone = Dimension(0.0, width, 0.0, usual=True)
        zones[name] = zone
    return zones
