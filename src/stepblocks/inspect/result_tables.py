"""The tables of an inspection as a person reads them: values, budgets, what was not measured.

Lengths are in micrometres, angles in degrees.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stepblocks.inspect.budget import Bound, Component, Measured
from stepblocks.inspect.conformity import Decision
from stepblocks.inspect.judgement import Judgement, NotMeasured, is_angle

Row = dict[str, object]  # cells of a line by column

_CHARACTERISTICS, _BUDGET, _NOT_MEASURED = (
    "characteristics",
    "uncertainty budget",
    "not measured",
)
_NOT_STATED = "not stated"
_NOT_JUDGED = "not judged"
_MOST_DECIMALS = 6  # of a micrometre: a picometre
_DECIMALS_OF_EXACT = 4  # where no uncertainty says how many
_LIMIT_DECIMALS = 9  # to which limits are rounded, so that a limit reads as it was declared
_SIGNS = {Bound.NONE: "", Bound.AT_MOST: "<= ", Bound.AT_LEAST: ">= "}


@dataclass(frozen=True)
class _Unit:
    """A unit of the tables."""

    name: str
    factor: float  # of it in one SI unit

    def format_limit(self, size: float, number_format: str) -> str | None:
        """Write a size of a decision [m or rad]; None of an infinite one."""
        scaled = size * self.factor
        if not math.isfinite(scaled):
            return None
        return f"{round(scaled, _LIMIT_DECIMALS):{number_format}}"


_MICROMETRE = _Unit("um", 1e6)
_DEGREE = _Unit("deg", math.degrees(1.0))


def build_tables(
    values: Mapping[str, Measured],
    judged: Sequence[Judgement],
    missing: Sequence[NotMeasured],
    numbers: Mapping[str, int],
) -> dict[str, list[Row]]:
    """Build the tables of an inspection, without those that have no lines.

    Parameters
    ----------
    values : dict of Measured
        What was measured, by key.
    judged, missing : sequence
        What was judged, and what was not measured.
    numbers : dict of int
        Numbers on the drawing, by key.

    Returns
    -------
    dict of list of dict
        Lines of each table by its title.
    """
    judgements = {judgement.characteristic.key: judgement for judgement in judged}
    not_judged = {absent.characteristic.key for absent in missing}
    characteristics = []
    budget = []
    for key in _sort_keys_by_drawing_number(values, numbers):
        measured = values[key]
        judgement = judgements.get(key)
        label = measured.name
        decision = None
        if judgement is not None:
            label = judgement.characteristic.label
            decision = judgement.decision
        unit = _DEGREE if is_angle(key) else _MICROMETRE
        row = _make_value_row(numbers.get(key), label, measured, decision, unit)
        if key in not_judged:  # it has limits, and what is missing says why they do not apply
            row["verdict"] = _NOT_JUDGED
        characteristics.append(row)
        for part in measured.components:
            budget.append(_make_component_row(label, part, unit))
    not_measured = [_make_missing_row(absent, numbers) for absent in missing]
    tables = {_CHARACTERISTICS: characteristics, _BUDGET: budget, _NOT_MEASURED: not_measured}
    return {title: rows for title, rows in tables.items() if rows}


def _sort_keys_by_drawing_number(
    values: Mapping[str, Measured], numbers: Mapping[str, int]
) -> list[str]:
    """Return keys in the order of the drawing; what it does not show comes last."""
    last = len(numbers) + 1
    return sorted(values, key=lambda key: numbers.get(key, last))


def _make_value_row(
    number: int | None,
    label: str,
    measured: Measured,
    decision: Decision | None,
    unit: _Unit,
) -> Row:
    """Return the line of a value with its limits, if any."""
    half = measured.compute_expanded_uncertainty() * unit.factor
    decimals = _choose_decimals(half)
    uncertainty = _NOT_STATED
    if measured.is_decidable:
        uncertainty = f"{half:.{decimals}f}"
    row: Row = {
        "number": number,
        "characteristic": label,
        "value": f"{_SIGNS[measured.bound]}{measured.value * unit.factor:.{decimals}f}",
        "expanded_uncertainty_95": uncertainty,
        "unit": unit.name,
    }
    if decision is None:
        return row | {"lower": None, "upper": None, "guard": None, "verdict": "no limits"}
    return row | {
        "lower": unit.format_limit(decision.lower, ".7g"),
        "upper": unit.format_limit(decision.upper, ".7g"),
        "guard": unit.format_limit(decision.guard, ".3g"),
        "verdict": decision.verdict.value,
    }


def _choose_decimals(half_width: float) -> int:
    """Return the decimals that show two digits of an uncertainty, none below a picometre."""
    if not 0.0 < half_width < math.inf:
        return _DECIMALS_OF_EXACT
    return min(max(1 - math.floor(math.log10(half_width)), 0), _MOST_DECIMALS)


def _make_component_row(label: str, part: Component, unit: _Unit) -> Row:
    """Return the line of a component of a budget."""
    std = _NOT_STATED
    if not math.isnan(part.std):
        std = f"{part.std * unit.factor:.3g}"
    return {
        "characteristic": label,
        "component": part.name,
        "standard_uncertainty": std,
        "unit": unit.name,
        "how": part.how,
    }


def _make_missing_row(absent: NotMeasured, numbers: Mapping[str, int]) -> Row:
    """Return the line of a characteristic that was not measured."""
    characteristic = absent.characteristic
    return {
        "number": numbers.get(characteristic.key),
        "characteristic": characteristic.label,
        "needs": absent.reason,
    }
