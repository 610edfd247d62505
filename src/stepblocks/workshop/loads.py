"""Statics of the apparatus: what each weight puts on the tip, and what the flexure makes of a pull, with uncertainties (GUM)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from stepblocks.parts.apparatus import ARM, Apparatus
from stepblocks.parts.kinds.machined import Machined

_PIVOT_BORE, _PULLEY_BORE, _PULLEY = 3e-3, 3e-3, 20e-3  # diameters [m]


@dataclass(frozen=True)
class Load:
    """A force on the tip."""

    mass: float  # of the weight [kg]
    force: float  # N
    std: float  # standard uncertainty [N]
    budget: tuple[tuple[str, float], ...]  # standard uncertainties by source [N]


def flexure_stiffness(kit: Apparatus) -> float:
    """Stiffness of the two leaves along the drag [N/m], clamped at both ends, which stay parallel."""
    # twice 12 E I / L^3 (Euler and Bernoulli), less the share of shear 2.4 (1 + nu) (t/L)^2, nu 0.3 (Timoshenko, 5/6)
    leaf = kit.flexure
    length, width, thick = (one.nominal for one in (leaf.length, leaf.width, leaf.thickness))
    bending = 2.0 * leaf.modulus.value * width * (thick / length) ** 3
    return bending / (1.0 + 2.4 * 1.3 * (thick / length) ** 2)


def flexure_sensitivity(kit: Apparatus) -> float:
    """Output of the full bridge over its supply, for a newton along the drag [1/N]."""
    # gauge factor times the strain 3 F (L/2 - s) / (E b t^2) under a gauge at s from the end of a leaf
    leaf = kit.flexure
    length, width, thick = (one.nominal for one in (leaf.length, leaf.width, leaf.thickness))
    lever = 0.5 * length - leaf.gauge_place.nominal
    return leaf.gauge_factor.value * 3.0 * lever / (leaf.modulus.value * width * thick**2)


def normal_load(kit: Apparatus, mass: float) -> Load:
    """Force of a weight [kg] over the tip on a level block: the arm is balanced, so it is the weight's alone."""
    # tolerances count as rectangular, and so does the friction of the pivot, whose sign is that of the last movement
    gravity, carried = kit.gravity.value, [one for one in kit.parts(mass) if one.id in ON_THE_PIVOT]
    counterweight = next(one for one in carried if one.id == "counterweight")
    pressing = gravity * math.fsum(one.mass for one in carried)
    parts = {
        "weight": kit.weight_tolerance.value * mass * gravity,
        "gravity": kit.gravity_tolerance.value * mass * gravity,
        "balance": counterweight.mass * gravity * kit.balance.limits[1] / ARM,
        "friction of the pivot": kit.friction.pivot.value * pressing * 0.5 * _PIVOT_BORE / ARM,
    }
    return _load(mass, mass * gravity, parts)


# what turns about the pivot
ON_THE_PIVOT = ("arm", "explorer-clamp", "explorer", "weight", "balance-rod", "counterweight")


def pull(kit: Apparatus, mass: float) -> Load:
    """Force along the drag of a weight with its hanger [kg], less what pulley and carriage take."""
    gravity = kit.gravity.value
    weight = mass * gravity
    # a cord that turns by a right angle presses its pulley with sqrt(2) of its tension
    pulley = math.sqrt(2.0) * weight * kit.friction.pulley.value * _PULLEY_BORE / _PULLEY
    carriage = kit.friction.carriage.value * gravity * moving_mass(kit.parts())
    parts = {
        "weight": kit.weight_tolerance.value * weight,
        "gravity": kit.gravity_tolerance.value * weight,
        # makers' coefficients scatter by half
        "friction of the pulley": 0.5 * pulley,
        "friction of the carriage": 0.5 * carriage,
    }
    return _load(mass, weight - pulley - carriage, parts)


def moving_mass(parts: Iterable[Machined]) -> float:
    """Mass that the shafts carry [kg]."""
    return math.fsum(one.mass for one in parts if one.moving)


def _load(mass: float, force: float, rectangular: dict[str, float]) -> Load:
    budget = tuple((name, half / math.sqrt(3.0)) for name, half in rectangular.items())
    return Load(mass, force, math.hypot(*(std for _, std in budget)), budget)
