"""Tolerances by what is felt: bounds of the energy of the ring in place of micrometres."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated

from pydantic import Field, InstanceOf

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Status
from stepblocks.contact.felt_limits import (
    Deviations,
    EnergyBounds,
    FeltLimits,
    compute_extreme_energy_changes,
    find_felt_limits,
)
from stepblocks.contact.operating_point import WEBER_FRACTION, OperatingPoint
from stepblocks.errors import ContactError, StimulusError
from stepblocks.parts.conditions import PredictionGrid, Ratio
from stepblocks.parts.declared import (
    LabelledText,
    Table,
    WorkedOut,
    make_positive_validator,
    make_rules_validator,
)
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import Dimension

_WHOLE = 0.999999  # of a decimal place, which the binary number next to it may miss


@dataclass(frozen=True)
class FeltVerdict:
    """What a part keeps by its limits.

    Attributes
    ----------
    friction : Deviations
        Of the coefficient, within which the energy is kept [1].
    fall, rise : float
        Change of the energy at the weakest and the strongest corner over all conditions [1].
    conditions : int
        Combinations of tip, step and friction in which it is kept.
    """

    friction: Deviations
    fall: float
    rise: float
    conditions: int

    def record(self) -> dict[str, object]:
        """Return plain values for JSON, the unit in the names."""
        return {
            "friction_upper_deviation": self.friction.upper,
            "friction_lower_deviation": self.friction.lower,
            "energy_fall_share": self.fall,
            "energy_rise_share": self.rise,
            "conditions": self.conditions,
        }


class FeltTolerance(Table):
    """What the ring of a part may change by; limits of its sizes follow from it.

    Attributes
    ----------
    energy : float or None
        Share of the vibration energy to either side [1].
    jnd : float or None
        Just noticeable differences to either side [1].
    weber_fraction : float
        Share of the energy that makes a just noticeable difference [1].
    friction : Dimension or None
        Deviation of the coefficient of friction to either side, spent first; left out, friction
        has a share [1].
    verdict : FeltVerdict or None
        Found for the set, never written in a file.
    """

    energy: Annotated[float, make_positive_validator("ratio")] | None = None
    jnd: Annotated[float, make_positive_validator("ratio")] | None = None
    weber_fraction: Annotated[float, make_positive_validator("ratio")] = WEBER_FRACTION
    friction: Ratio | None = None
    verdict: Annotated[InstanceOf[FeltVerdict] | None, WorkedOut()] = Field(None, exclude=True)

    @make_rules_validator
    def _yield_bound_breaches(self) -> Iterator[str]:
        """Yield what keeps the bounds from being those of one thing."""
        if (self.energy is None) == (self.jnd is None):
            yield "tolerance must have either energy or jnd, not both or none"
        if self.energy is not None and self.energy >= 1.0:
            yield f"tolerance.energy must be below 100 %, got {100.0 * self.energy:g} %"

    @property
    def bounds(self) -> EnergyBounds:
        """Within which the energy stays."""
        if self.energy is not None:
            return EnergyBounds(math.log1p(self.energy), -math.log1p(-self.energy))
        assert self.jnd is not None
        span = self.jnd * math.log1p(self.weber_fraction)
        return EnergyBounds(span, span)

    def describe_bounds(self) -> str:
        """Say what is kept."""
        if self.energy is not None:
            return f"{100.0 * self.energy:g} %"
        return f"{self.jnd:g} just noticeable differences of {100.0 * self.weber_fraction:.3g} %"


def list_felt_tolerance_rows(tolerance: FeltTolerance | None) -> list[LabelledText]:
    """Say for people what a part keeps, and with which friction."""
    if tolerance is None or tolerance.verdict is None:
        return []
    verdict = tolerance.verdict
    friction = verdict.friction
    return [
        [
            "vibration energy",
            f"kept within {tolerance.describe_bounds()}: {100.0 * verdict.fall:+.2g} % to "
            f"{100.0 * verdict.rise:+.2g} % at the worst corners, with friction "
            f"{friction.upper:+.2g}/{friction.lower:+.2g}",
        ]
    ]


def has_felt_tolerance(part: Part) -> bool:
    """Whether the sizes of a part get limits by what is felt."""
    return getattr(part, "tolerance", None) is not None


def resolve_felt_tolerance(part: Part, grid: PredictionGrid) -> Part:
    """Give a part with a tolerance by what is felt the limits that follow from it.

    Raises
    ------
    StimulusError
        If nothing rings under the conditions, or no limits keep the energy.
    """
    tolerance: FeltTolerance = part.tolerance  # type: ignore[attr-defined]  # has_felt_tolerance
    conditions = list(_yield_releasing_conditions(part, grid))
    if not conditions:
        raise StimulusError("tolerance needs a condition of the prediction that releases, got none")
    fixed = {}
    free = []
    for name, size in part.sizes.items():
        has_limits_of_its_own = name not in part.counterface_fields
        if not has_limits_of_its_own and (size.by_feel or size.usual):
            free.append(name)
        else:
            fixed[name] = Deviations(size.upper, size.lower)
    if tolerance.friction is None:
        free.append("friction")
    else:
        fixed["friction"] = Deviations(tolerance.friction, -tolerance.friction)
    limits = _find_narrowest_limits(conditions, tolerance, free, fixed)
    kept = {**fixed, **limits}
    fall, rise = 0.0, 0.0
    for face, point in conditions:
        weakest, strongest = compute_extreme_energy_changes(face, point, kept)
        fall = min(fall, math.expm1(weakest))
        rise = max(rise, math.expm1(strongest))
    verdict = FeltVerdict(kept["friction"], fall, rise, len(conditions))
    update: dict[str, object] = {"tolerance": tolerance.model_copy(update={"verdict": verdict})}
    for name, field in part.counterface_fields.items():
        if name in limits:
            update[field] = _replace_deviations_by_felt(part.sizes[name], limits[name])
    return part.model_copy(update=update)


def _replace_deviations_by_felt(size: Dimension, felt_deviations: Deviations) -> Dimension:
    """Return a dimension with deviations that follow from what is felt."""
    return replace(
        size,
        upper=felt_deviations.upper,
        lower=felt_deviations.lower,
        usual=False,
        general=False,
        by_feel=True,
    )


def _yield_releasing_conditions(
    part: Part, grid: PredictionGrid
) -> Iterator[tuple[Counterface, OperatingPoint]]:
    """Yield counterface and condition wherever the tip is released, all at the first load.

    The load scales all energies alike.
    """
    face = part.counterface()
    for radius, friction in product(grid.tip_radii, grid.frictions_or_law):
        point = grid.make_first_operating_point(ball_radius=radius, friction=friction)
        if face.release(point).status is Status.RELEASES:
            yield face, point


def _find_narrowest_limits(
    conditions: list[tuple[Counterface, OperatingPoint]],
    tolerance: FeltTolerance,
    free_names: list[str],
    fixed_deviations: Mapping[str, Deviations],
) -> FeltLimits:
    """Find limits that hold under all conditions, rounded to what a drawing says."""
    found = []
    for face, point in conditions:
        try:
            found.append(
                find_felt_limits(face, point, tolerance.bounds, free_names, fixed_deviations)
            )
        except ContactError as error:
            raise StimulusError(
                f"tolerance of {tolerance.describe_bounds()} cannot be kept with a tip of "
                f"{point.ball_radius * 1e6:g} um and friction {point.friction:g}: {error}"
            ) from error
    narrowest = {}
    for name in free_names:
        upper = min(limits[name].upper for limits in found)
        lower = max(limits[name].lower for limits in found)
        narrowest[name] = Deviations(
            _round_down_to_two_digits(upper), 0.0 - _round_down_to_two_digits(-lower)
        )
    return narrowest


def _round_down_to_two_digits(width: float) -> float:
    """Round a width towards zero to two digits, as a drawing says it."""
    if width == 0.0:
        return 0.0
    decade = math.floor(math.log10(width)) - 1
    digits = math.floor(width / 10.0**decade + (1.0 - _WHOLE))
    return float(f"{digits}e{decade}")
