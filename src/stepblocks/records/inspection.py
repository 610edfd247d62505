"""The record of an inspection, ``<id>.inspection.json``: every value, its budget and its verdict.

The models are the only place that knows the keys of the file. The key of a size ends in its unit:
``value_m`` of a length, ``value_rad`` of an angle. What is infinite or unknown is null.
"""

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, SkipValidation

# text that may hold the name of a file, whose bytes may be none of UTF-8
_Text = Annotated[str, SkipValidation]

# fields whose keys end in their unit
_SIZES = (
    *("value", "std", "interval_95"),
    *("nominal", "lower_limit", "upper_limit", "guard_band"),
)


def _add_metre_suffix(field_name: str) -> str:
    """Return the key of a field of a length."""
    if field_name in _SIZES:
        return f"{field_name}_m"
    return field_name


def _add_radian_suffix(field_name: str) -> str:
    """Return the key of a field of an angle."""
    if field_name in _SIZES:
        return f"{field_name}_rad"
    return field_name


_LENGTH = ConfigDict(frozen=True, populate_by_name=True, alias_generator=_add_metre_suffix)
_ANGLE = ConfigDict(frozen=True, populate_by_name=True, alias_generator=_add_radian_suffix)


class ComponentRecord(BaseModel):
    """One component of an uncertainty budget.

    Attributes
    ----------
    name : str
        What it comes from.
    std : float or None
        Standard uncertainty [m or rad]; None where it is unknown.
    dof : float or None
        Degrees of freedom; None where they are infinite.
    how : str
        How it was evaluated.
    assumed : bool
        Whether nobody stated it, so that a default or nothing stands for it; not written.
    """

    name: str
    std: float | None
    dof: float | None
    how: str
    assumed: bool = Field(default=False, exclude=True)


class LengthComponentRecord(ComponentRecord):
    """Component of the budget of a length."""

    model_config = _LENGTH


class AngleComponentRecord(ComponentRecord):
    """Component of the budget of an angle."""

    model_config = _ANGLE


class MeasuredRecord(BaseModel):
    """A measured value with its uncertainty.

    Attributes
    ----------
    value, std : float
        Value and its combined standard uncertainty [m or rad].
    dof : float or None
        Effective degrees of freedom; None where they are infinite.
    coverage_factor : float
        Of the interval at 95 % [1].
    interval_95 : list of float
        Its two ends [m or rad].
    bound : {"", "at most", "at least"}
        Where the true value is known on one side only.
    uncertainty_stated : bool
        Whether enough is stated for a verdict.
    """

    value: float
    std: float
    dof: float | None
    coverage_factor: float
    interval_95: list[float]
    bound: str
    uncertainty_stated: bool


class LabelRecord(BaseModel):
    """Key and label of a characteristic."""

    key: str
    label: str


class DecisionRecord(LabelRecord):
    """How a characteristic was judged.

    Attributes
    ----------
    unit : {"m", "rad"}
        Of its sizes.
    nominal : float
        m or rad.
    lower_limit, upper_limit : float or None
        Limits [m or rad]; None where there is none.
    guard_band : float
        Of ISO 14253-1 [m or rad].
    conformance_probability : float
        That the true value lies within the limits [1].
    verdict : str
        Outcome of ISO 14253-1.
    """

    unit: Literal["m", "rad"]
    nominal: float
    lower_limit: float | None
    upper_limit: float | None
    guard_band: float
    conformance_probability: float
    verdict: str


# in the file the fields of the second base come before those of the first
class LengthRecord(MeasuredRecord, LabelRecord):
    """A length without limits."""

    model_config = _LENGTH
    budget: list[LengthComponentRecord]


class AngleRecord(MeasuredRecord, LabelRecord):
    """An angle without limits."""

    model_config = _ANGLE
    budget: list[AngleComponentRecord]


class JudgedLengthRecord(MeasuredRecord, DecisionRecord):
    """A length that was judged."""

    model_config = _LENGTH
    budget: list[LengthComponentRecord]


class JudgedAngleRecord(MeasuredRecord, DecisionRecord):
    """An angle that was judged."""

    model_config = _ANGLE
    budget: list[AngleComponentRecord]


SizeRecord = LengthRecord | AngleRecord
JudgedRecord = JudgedLengthRecord | JudgedAngleRecord


class NotMeasuredRecord(LabelRecord):
    """A characteristic that was not measured.

    Attributes
    ----------
    needs : str
        What would measure it, or why it was not measured.
    asked : bool
        Whether the order asks for it.
    """

    needs: str
    asked: bool


class InspectionRecord(BaseModel, frozen=True):
    """What is known of one inspected part.

    Attributes
    ----------
    stimulus : str
        Identity of the part.
    scan, scan_sha256 : str
        Name of the scan, and the hash of its bytes.
    verdict : str
        Verdict on the whole part; ``measured`` where nothing was asked for.
    statement : str
        How many characteristics were measured and how they were judged; empty of a standard.
    convention : str
        How the values are defined.
    notes : list of str
        What was left out, cut or is in doubt.
    energy_statement : str
        How far the energy of the edge moved; key ``felt``.
    values_without_limits : dict of float
        By key of the characteristic [m or rad]; key ``others_m``.
    without_limits : list of LengthRecord or AngleRecord
        The same with their budgets; key ``others``.
    characteristics : list of JudgedLengthRecord or JudgedAngleRecord
        What was judged.
    not_measured : list of NotMeasuredRecord
        What was not measured.
    """

    version: Literal[1] = Field(default=1, serialization_alias="schema")
    stimulus: str
    scan: _Text
    scan_sha256: str
    verdict: str
    statement: str
    convention: _Text
    notes: list[_Text]
    energy_statement: str = Field(serialization_alias="felt")
    values_without_limits: dict[str, float] = Field(serialization_alias="others_m")
    without_limits: list[SizeRecord] = Field(serialization_alias="others")
    characteristics: list[JudgedRecord]
    not_measured: list[NotMeasuredRecord]

    @property
    def is_complete(self) -> bool:
        """Whether everything that the order requires was measured."""
        return not any(absent.asked for absent in self.not_measured)

    def to_document(self) -> dict[str, Any]:
        """Return the record as plain data, as it is written."""
        return self.model_dump(by_alias=True)

    def to_json(self) -> str:
        """Return the text of the file."""
        return json.dumps(self.to_document(), indent=2, allow_nan=False) + "\n"
