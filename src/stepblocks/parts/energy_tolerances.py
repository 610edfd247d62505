"""Stimulus files with every tolerance a number: those that shall keep an energy are worked out here.

What a file asks for knows no contact mechanics; this is where "the energy of this block shall be within 10 %" becomes the
tolerances that drawing, STEP file and prediction use.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.tolerancing import TolerancePlan, energy_at_corners, tolerances_for_energy
from stepblocks.errors import ContactError, PipelineError
from stepblocks.parts.energy_tolerance import EnergyBudget, EnergyTolerance
from stepblocks.parts.set import KINDS, PredictionGrid, StimulusSet
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.tips.declaration import HookTip, StraightTip
from stepblocks.parts.tolerance import Dimension

Felt = StepBlock | StraightTip | HookTip
Condition = tuple[Step, OperatingPoint]


def with_energy_tolerances(stimuli: StimulusSet) -> StimulusSet:
    """Work out the tolerances of a set that follow from an energy."""
    update = {}
    for kind in KINDS:
        parts = getattr(stimuli, kind)
        resolved = tuple(_resolved(part, stimuli, kind) if _is_open(part) else part for part in parts)
        if any(a is not b for a, b in zip(parts, resolved, strict=True)):
            update[kind] = resolved
    return stimuli.model_copy(update=update) if update else stimuli


def _is_open(part: object) -> bool:
    energy = part.energy_tolerance if isinstance(part, Felt) else None
    return energy is not None and not isinstance(energy, EnergyBudget)


def _resolved(part: Felt, stimuli: StimulusSet, kind: str) -> Felt:
    place = f"[{stimuli.name}, {kind} {part.id!r}]"
    energy = part.energy_tolerance
    assert energy is not None
    conditions = _conditions(part, stimuli.prediction)
    felt = [(face, point) for face, point in conditions if face.release(point).status is Status.RELEASES]
    if not felt:
        raise PipelineError(f"energy_tolerance needs a condition of the prediction that releases, got none {place}")
    free = _free(part, energy)
    plans = []
    for face, point in felt:
        where = f"R {point.ball_radius * 1e6:g} um, H {face.height * 1e6:g} um, mu {point.friction:g}"
        try:
            plan = _plan(part, energy, (face, point), free)
        except ContactError as error:
            raise PipelineError(f"energy_tolerance: {error} {place}") from error
        if not plan.achievable:
            raise PipelineError(
                f"energy_tolerance of {energy.within * 100.0:.3g} % can be kept by no tolerance at {where}: {plan.reason} {place}"
            )
        plans.append(plan)
    return _with_plans(part, energy, felt, plans, free)


def _conditions(part: Felt, grid: PredictionGrid) -> Iterator[Condition]:
    """Every block, tip and friction; load, stiffness and conversion scale all energies alike and stand at one."""
    if isinstance(part, StepBlock):
        for tip, friction in product(grid.tip_radii, grid.frictions):
            yield Step(part.height.nominal, part.edge_radius.nominal), OperatingPoint(tip, 1.0, friction)
    else:
        for height, friction in product(grid.step_heights, grid.frictions):
            yield Step(height), OperatingPoint(part.ball_radius.nominal, 1.0, friction)


def _free(part: Felt, energy: EnergyTolerance) -> list[str]:
    """Names of the inputs that are to be toleranced."""
    if not isinstance(part, StepBlock):
        return ["ball_radius"]
    named = {"height": part.height, "edge_radius": part.edge_radius}
    return [name for name, one in named.items() if one.by_energy] + (
        ["ball_radius"] if energy.ball_radius is None else []
    )


def _fixed(part: Felt, energy: EnergyTolerance, free: list[str]) -> dict[str, float]:
    """Half-widths that are given: they spend the budget first."""
    fixed = {"friction": energy.friction, "normal_load": energy.normal_load}
    if isinstance(part, StepBlock):
        stated = {"height": part.height, "edge_radius": part.edge_radius}
        fixed |= {name: max(one.upper, -one.lower) for name, one in stated.items() if name not in free}
        if energy.ball_radius is not None:
            fixed["ball_radius"] = energy.ball_radius
    else:
        fixed |= {"height": 0.0, "edge_radius": 0.0}
    return fixed


def _plan(part: Felt, energy: EnergyTolerance, condition: Condition, free: list[str]) -> TolerancePlan:
    finest = {name: getattr(energy.finest, name) for name in free}
    return tolerances_for_energy(*condition, energy.within, finest=finest, fixed=_fixed(part, energy, free))


def _with_plans(
    part: Felt, energy: EnergyTolerance, felt: list[Condition], plans: list[TolerancePlan], free: list[str]
) -> Felt:
    """Give a part the narrowest of what its conditions ask for, rounded down to what a drawing says."""
    widths = {name: min(_drawn(getattr(plan, name)) for plan in plans) for name in free}
    tips: dict[float, float] = {}
    for (_, point), plan in zip(felt, plans, strict=True):
        given = energy.ball_radius if energy.ball_radius is not None else _drawn(plan.ball_radius)
        tips[point.ball_radius] = min(given, tips.get(point.ball_radius, math.inf))
    fixed = _fixed(part, energy, free) | widths
    corners = [energy_at_corners(face, at, fixed | {"ball_radius": tips[at.ball_radius]}) for face, at in felt]
    budget = EnergyBudget.model_construct(
        **{name: getattr(energy, name) for name in EnergyTolerance.model_fields},
        tips=tuple(Dimension(radius, t, -t, by_energy=True) for radius, t in sorted(tips.items())),
        worst_low=min(low for low, _ in corners),
        worst_high=max(high for _, high in corners),
        conditions=len(felt),
    )
    update: dict[str, object] = {"energy_tolerance": budget}
    for name, width in widths.items():
        dimension = getattr(part, name, None)
        if dimension is not None and dimension.by_energy:
            update[name] = replace(dimension, upper=width, lower=0.0 - min(width, dimension.nominal))
    return part.model_copy(update=update)


def _drawn(width: float) -> float:
    """Round a half-width down to two digits, as a drawing says it."""
    digits = math.floor(math.log10(width)) - 1
    # the small shift keeps 0.68 from becoming 0.67 where it is stored as 0.67999...
    return float(f"{math.floor(width / 10.0**digits * (1.0 + 1e-12))}e{digits}")
