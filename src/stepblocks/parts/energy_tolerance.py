"""What a stimulus file may ask for instead of dimensional tolerances: the vibration energy within a share of its nominal.

Which tolerances keep it follows from contact mechanics, which this folder does not know: `stepblocks.parts.energy_tolerances`
resolves what is declared here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict

from stepblocks.parts.tolerance import Dimension
from stepblocks.quantities import parse_quantity


def _at_least_zero(dimension: str) -> BeforeValidator:
    def parse(raw: object) -> float:
        value = parse_quantity(raw, dimension)
        if value < 0.0:
            raise ValueError(f"must not be negative, got {raw!r}")
        return value

    return BeforeValidator(parse)


def _share(raw: object) -> float:
    value = parse_quantity(raw, "ratio")
    if not 0.0 < value < 1.0:
        raise ValueError(f"must lie between 0 and 100 %, got {raw!r}")
    return value


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)


class Finest(_Table):
    """Smallest deviations to either side that can be made and measured; what is left out is assumed."""

    # Of a step's height [m]; 0.1 um, somewhat less than two wrung gauge blocks of grade 0 hold
    height: Annotated[float, _at_least_zero("length")] = 0.1e-6
    # Of the working edge and of the tip [m]; 0.5 um, about what an arc fit on a profile resolves
    edge_radius: Annotated[float, _at_least_zero("length")] = 0.5e-6
    ball_radius: Annotated[float, _at_least_zero("length")] = 0.5e-6


class EnergyTolerance(_Table):
    """A tolerance of the vibration energy."""

    within: Annotated[float, BeforeValidator(_share)]  # Allowed relative change of the energy to either side [1]
    # Deviation of the tip's radius that is given [m]; left out, the tip has a share of the budget like the block
    ball_radius: Annotated[float, _at_least_zero("length")] | None = None
    # Deviation of mu that spends the budget before the block does [1]
    friction: Annotated[float, _at_least_zero("ratio")] = 0.0
    # Deviation of the load that does so, as a share of the load [1]
    normal_load: Annotated[float, _at_least_zero("ratio")] = 0.0
    finest: Finest = Finest()  # What can be made at all


class EnergyBudget(EnergyTolerance):
    """The same, resolved."""

    tips: tuple[Dimension, ...]  # Tips with the tolerance that they may have [m]
    worst_low: float  # Relative change of the energy at the worst corners of all conditions [1]
    worst_high: float
    conditions: int  # Combinations of tip, step and friction in which the energy is kept


def _table_of(raw: object) -> object:
    return raw if isinstance(raw, dict | EnergyTolerance) else {"within": raw}


# A share such as ``"10 %"``, or a table with `within` and what spends the budget
EnergyToleranceField = Annotated[EnergyTolerance, BeforeValidator(_table_of)]


def require_energy_tolerance(energy: EnergyTolerance | None, named: dict[str, Dimension], tip_is_free: bool) -> None:
    """Refuse a dimension toleranced by an energy that is not given, and an energy from which nothing follows."""
    left = [name for name, dimension in named.items() if dimension.by_energy]
    if left and energy is None:
        raise ValueError(f"energy_tolerance must be given where {left[0]} has tolerance = 'by energy'")
    if energy is not None and not left and not tip_is_free:
        names = " or ".join(named)
        raise ValueError(f"energy_tolerance must leave something to tolerance: give {names} tolerance = 'by energy'")


def plain_budget(energy: EnergyTolerance) -> dict[str, Any]:
    """Write an energy tolerance out for JSON, with the unit in the name of every field."""
    return dict(_items(energy))


def _items(energy: EnergyTolerance) -> Iterator[tuple[str, Any]]:
    yield "within", energy.within
    if energy.ball_radius is not None:
        yield "ball_radius_deviation_m", energy.ball_radius
    yield "friction_deviation", energy.friction
    yield "normal_load_deviation_share", energy.normal_load
    for name in Finest.model_fields:
        yield f"finest_{name}_m", getattr(energy.finest, name)
    if isinstance(energy, EnergyBudget):
        yield "tips", [{"ball_radius_m": tip.nominal, "deviation_m": tip.upper} for tip in energy.tips]
        yield "worst_low", energy.worst_low
        yield "worst_high", energy.worst_high
        yield "conditions", energy.conditions
