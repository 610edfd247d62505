"""A tolerance of the vibration energy in place of dimensional tolerances."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Annotated, TypeAlias

from pydantic import BeforeValidator

from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.contact.uncertainty import compute_energy_at_corners, find_tolerances_for_energy
from stepblocks.errors import ContactError, PipelineError
from stepblocks.parts.conditions import PredictionGrid, Ratio
from stepblocks.parts.declared import Table, read_positive
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import Dimension
from stepblocks.quantities import parse_quantity

Condition: TypeAlias = tuple[Step, OperatingPoint]
# Smallest deviations to either side that can be made and measured, assumed: somewhat less than two
# wrung gauge blocks hold, and about what an arc fit on a profile resolves [m]
_FINEST = {"height": 0.1e-6, "edge_radius": 0.5e-6, "ball_radius": 0.5e-6}


def _read_share(raw: object) -> float:
    value = parse_quantity(raw, "ratio")
    if not 0.0 < value < 1.0:
        raise ValueError(f"must lie between 0 and 100 %, got {raw!r}")
    return value


class EnergyTolerance(Table):
    """A tolerance of the vibration energy."""

    within: Annotated[
        float, BeforeValidator(_read_share)
    ]  # allowed relative change of the energy to either side [1]
    # of the tip [m]; left out, the tip has a share of the budget like the block
    ball_radius: Annotated[float, read_positive("length", or_zero=True)] | None = None
    friction: Ratio = 0.0  # of mu, spent before the block's share [1]
    normal_load: Ratio = 0.0  # as a share of the load, spent likewise [1]

    def record(self) -> dict[str, object]:
        """Write it out in full for JSON."""
        told = {
            "within": self.within,
            "ball_radius_deviation_m": self.ball_radius,
            "friction_deviation": self.friction,
        }
        told["normal_load_deviation_share"] = self.normal_load
        return {name: value for name, value in told.items() if value is not None}


class EnergyBudget(EnergyTolerance):
    """The same, resolved."""

    tips: tuple[Dimension, ...]  # with the tolerance that they may have [m]
    worst_low: float  # relative change of the energy at the worst corners of all conditions [1]
    worst_high: float
    conditions: int  # combinations of tip, step and friction in which the energy is kept

    def record(self) -> dict[str, object]:
        """Write it out in full for JSON."""
        tips = [{"ball_radius_m": tip.nominal, "deviation_m": tip.upper} for tip in self.tips]
        found = {name: getattr(self, name) for name in ("worst_low", "worst_high", "conditions")}
        return super().record() | {"tips": tips} | found


# A share such as ``"10 %"``, or a table with `within` and what spends the budget
_TABLE = BeforeValidator(
    lambda raw: raw if isinstance(raw, dict | EnergyTolerance) else {"within": raw}
)
EnergyToleranceField = Annotated[EnergyTolerance, _TABLE]


def check_energy_tolerance(
    energy: EnergyTolerance | None, named: dict[str, Dimension], tip_is_free: bool
) -> str:
    """Return what an energy tolerance lacks, or what it leaves without use; else ``""``."""
    left = [name for name, dimension in named.items() if dimension.by_energy]
    if left and energy is None:
        return f"energy_tolerance must be given where {left[0]} has tolerance = 'by energy'"
    if energy is not None and not left and not tip_is_free:
        give = f"give {' or '.join(named)} tolerance = 'by energy'"
        return f"energy_tolerance must leave something to tolerance: {give}"
    return ""


def describe_energy_tolerance(energy: EnergyTolerance | None) -> list[list[str]]:
    """Say in words what a part keeps."""
    if not isinstance(energy, EnergyBudget):
        return []
    tips = ", ".join(str(tip) for tip in energy.tips)
    return [
        ["vibration energy", f"kept within {energy.within:.3g} of the nominal with a tip of {tips}"]
    ]


def resolve_energy_tolerance(part: Part, grid: PredictionGrid, set_name: str) -> Part:
    """Work out the tolerances of a part that follow from an energy, if any."""
    energy: EnergyTolerance | None = getattr(part, "energy_tolerance", None)
    if energy is None or isinstance(energy, EnergyBudget):
        return part

    place = f"[{set_name}, {part.stanza} {part.id!r}]"
    felt = [
        (face, at)
        for face, at in _list_conditions(part, grid)
        if face.release(at).status is Status.RELEASES
    ]
    if not felt:
        raise PipelineError(
            f"energy_tolerance needs a condition of the prediction that releases, got none {place}"
        )
    free = [name for name, one in part.sizes.items() if one.by_energy]
    # what is given spends the budget first
    fixed = {"friction": energy.friction, "normal_load": energy.normal_load}
    if not part.crossed:
        fixed |= {"height": 0.0, "edge_radius": 0.0}
    fixed |= {
        name: max(one.upper, -one.lower) for name, one in part.sizes.items() if not one.by_energy
    }
    if energy.ball_radius is None:
        free.append("ball_radius")
    else:
        fixed["ball_radius"] = energy.ball_radius
    plans = []
    for face, at in felt:
        where = f"R {at.ball_radius * 1e6:g} um, H {face.height * 1e6:g} um, mu {at.friction:g}"
        try:
            plan = find_tolerances_for_energy(face, at, energy.within, finest=_FINEST, fixed=fixed)
        except ContactError as error:
            raise PipelineError(f"energy_tolerance: {error} {place}") from error
        if not plan.achievable:
            asked = f"energy_tolerance of {energy.within * 100.0:.3g} %"
            raise PipelineError(
                f"{asked} can be kept by no tolerance at {where}: {plan.reason} {place}"
            )
        plans.append(plan)
    widths = {name: min(_round_down(getattr(plan, name)) for plan in plans) for name in free}
    # the narrowest of what the conditions ask for, rounded down to what a drawing says
    tips: dict[float, float] = {}
    for (_, at), plan in zip(felt, plans, strict=True):
        given = (
            energy.ball_radius if energy.ball_radius is not None else _round_down(plan.ball_radius)
        )
        tips[at.ball_radius] = min(given, tips.get(at.ball_radius, math.inf))
    corners = [
        compute_energy_at_corners(face, at, fixed | widths | {"ball_radius": tips[at.ball_radius]})
        for face, at in felt
    ]
    budget = EnergyBudget.model_construct(
        **dict(energy),
        tips=tuple(Dimension(radius, t, -t, by_energy=True) for radius, t in sorted(tips.items())),
        worst_low=min(low for low, _ in corners),
        worst_high=max(high for _, high in corners),
        conditions=len(felt),
    )
    update: dict[str, object] = {"energy_tolerance": budget}
    for name, width in widths.items():
        dimension = getattr(part, name, None)
        if dimension is not None and dimension.by_energy:
            update[name] = replace(
                dimension, upper=width, lower=0.0 - min(width, dimension.nominal)
            )
    return part.model_copy(update=update)


def _list_conditions(part: Part, grid: PredictionGrid) -> Iterator[Condition]:
    """Every block, tip and friction; the load scales all energies alike."""
    balls = grid.tip_radii if part.ball is None else (part.ball.nominal,)
    steps = (None,) if part.crossed else grid.step_heights
    for ball, step, friction in product(balls, steps, grid.frictions):
        face = part.counterface(step)
        assert isinstance(face, Step)  # no other kind may ask for an energy
        yield face, replace(PAPER, ball_radius=ball, friction=friction)


def _round_down(width: float) -> float:
    """Round a half-width down to two digits, as a drawing says it."""
    digits = math.floor(math.log10(width)) - 1
    # the small shift keeps 0.68 from becoming 0.67 where it is stored as 0.67999...
    return float(f"{math.floor(width / 10.0**digits * (1.0 + 1e-12))}e{digits}")
