"""Entries of the record of an inspection, from what was measured and judged."""

import math
from typing import TypedDict

from stepblocks.inspect.budget import Component, Measured
from stepblocks.inspect.judgement import Judgement, is_angle
from stepblocks.records.inspection import (
    AngleComponentRecord,
    AngleRecord,
    JudgedAngleRecord,
    JudgedLengthRecord,
    JudgedRecord,
    LengthComponentRecord,
    LengthRecord,
    SizeRecord,
)


class _MeasuredFields(TypedDict):
    """Fields of what was measured, but for its budget."""

    value: float
    std: float
    dof: float | None
    coverage_factor: float
    interval_95: list[float]
    bound: str
    uncertainty_stated: bool


def make_size_record(key: str, measured: Measured) -> SizeRecord:
    """Return the entry of a value without limits."""
    fields = _make_measured_fields(measured)
    if is_angle(key):
        return AngleRecord(
            key=key, label=measured.name, budget=_list_angle_budget(measured), **fields
        )
    return LengthRecord(
        key=key, label=measured.name, budget=_list_length_budget(measured), **fields
    )


def make_judged_record(judgement: Judgement, measured: Measured) -> JudgedRecord:
    """Return the entry of a characteristic that was judged."""
    characteristic = judgement.characteristic
    fields = _make_measured_fields(measured)
    limits = _make_decision_fields(judgement)
    if characteristic.quantity == "angle":
        return JudgedAngleRecord(
            unit="rad", budget=_list_angle_budget(measured), **limits, **fields
        )
    return JudgedLengthRecord(unit="m", budget=_list_length_budget(measured), **limits, **fields)


class _DecisionFields(TypedDict):
    """Fields of how a characteristic was judged, but for its unit."""

    key: str
    label: str
    nominal: float
    lower_limit: float | None
    upper_limit: float | None
    guard_band: float
    conformance_probability: float
    verdict: str


def _make_decision_fields(judgement: Judgement) -> _DecisionFields:
    """Return the fields of how a characteristic was judged."""
    characteristic = judgement.characteristic
    decision = judgement.decision
    return {
        "key": characteristic.key,
        "label": characteristic.label,
        "nominal": characteristic.nominal,
        "lower_limit": _replace_infinite_by_none(decision.lower),
        "upper_limit": _replace_infinite_by_none(decision.upper),
        "guard_band": decision.guard,
        "conformance_probability": decision.probability,
        "verdict": decision.verdict.value,
    }


def _make_measured_fields(measured: Measured) -> _MeasuredFields:
    """Return the fields of a value and its uncertainty."""
    half = measured.compute_expanded_uncertainty()
    return {
        "value": measured.value,
        "std": measured.std,
        "dof": _replace_infinite_by_none(measured.dof),
        "coverage_factor": measured.coverage_factor,
        "interval_95": [measured.value - half, measured.value + half],
        "bound": measured.bound.value,
        "uncertainty_stated": measured.is_decidable,
    }


def _list_length_budget(measured: Measured) -> list[LengthComponentRecord]:
    """Return the components of a length."""
    return [LengthComponentRecord(**_make_component_fields(part)) for part in measured.components]


def _list_angle_budget(measured: Measured) -> list[AngleComponentRecord]:
    """Return the components of an angle."""
    return [AngleComponentRecord(**_make_component_fields(part)) for part in measured.components]


class _ComponentFields(TypedDict):
    """Fields of a component."""

    name: str
    std: float | None
    dof: float | None
    how: str
    assumed: bool


def _make_component_fields(part: Component) -> _ComponentFields:
    """Return the fields of a component."""
    return {
        "name": part.name,
        "std": _replace_infinite_by_none(part.std),
        "dof": _replace_infinite_by_none(part.dof),
        "how": part.how,
        "assumed": part.assumed,
    }


def _replace_infinite_by_none(value: float) -> float | None:
    """Return a number as it is where it is finite, else None."""
    return value if math.isfinite(value) else None
