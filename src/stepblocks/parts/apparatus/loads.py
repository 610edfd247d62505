"""The forces of the kit's weights at the tip, with the budget of their uncertainties.

Tolerances count as rectangular (JCGM 100, 4.3.7): the standard uncertainty is their half width
over the square root of 3.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.apparatus.layout import list_components
from stepblocks.parts.apparatus.probe_arm import ARM, PIVOT_BORE
from stepblocks.parts.apparatus.pull import PULLEY_BORE, PULLEY_DIAMETER

_RECTANGULAR = 1.0 / math.sqrt(3.0)  # standard uncertainty over the half width
_SCATTER_OF_FRICTION = 0.5  # share by which the coefficients of makers may be off


class ErrorSource(Enum):
    """What the force of a weight is uncertain by."""

    MASS = "mass"
    GRAVITY = "gravity"
    ARM = "arm"
    BALANCE = "balance"
    PIVOT = "pivot"
    PULLEY = "pulley"
    CARRIAGE = "carriage"


@dataclass(frozen=True)
class ErrorComponent:
    """One line of the budget of a force.

    Attributes
    ----------
    source : ErrorSource
        Where it comes from.
    half_width : float
        Largest deviation of the force [N].
    is_common : bool
        Whether it is the same in all trials; if not, its sign changes from trial to trial.
    """

    source: ErrorSource
    half_width: float
    is_common: bool = True

    @property
    def std(self) -> float:
        """Standard uncertainty [N]."""
        return _RECTANGULAR * self.half_width


@dataclass(frozen=True)
class Load:
    """A force at the tip.

    Attributes
    ----------
    mass : float
        Of the weight [kg].
    force : float
        [N].
    budget : tuple of ErrorComponent
        What it is uncertain by.
    """

    mass: float
    force: float
    budget: tuple[ErrorComponent, ...]

    @property
    def std(self) -> float:
        """Standard uncertainty of the force in one trial [N]."""
        return _combine_stds(self.budget)

    @property
    def common_std(self) -> float:
        """Standard uncertainty of what is the same in all trials [N]."""
        common = [component for component in self.budget if component.is_common]
        return _combine_stds(common)


def _combine_stds(components: Iterable[ErrorComponent]) -> float:
    """Combine the standard uncertainties of independent components [N]."""
    stds = [component.std for component in components]
    return math.hypot(*stds)


def compute_normal_load(kit: Apparatus, weight_mass: float) -> Load:
    """Compute with what force a weight [kg] presses the tip on a level block.

    The arm is balanced without the weight, so that the force is that of the weight alone. The
    friction of the pivot has the sign of the last movement.
    """
    gravity = kit.gravity.value
    force = weight_mass * gravity
    carried = []
    for component in list_components(kit, weight_mass):
        if component.is_on_pivot:
            carried.append(component)
    counterweight = _find_component(carried, "counterweight")
    pressing = gravity * _sum_masses(carried)
    _, offset = kit.weight_offset.limits
    _, off_balance = kit.balance.limits
    unbalanced = counterweight.mass * gravity * off_balance / ARM
    pivot = kit.friction.pivot.value * pressing * 0.5 * PIVOT_BORE / ARM
    budget = (
        ErrorComponent(ErrorSource.MASS, kit.weight_tolerance.value * force),
        ErrorComponent(ErrorSource.GRAVITY, kit.gravity_tolerance.value * force),
        ErrorComponent(ErrorSource.ARM, force * offset / ARM),
        ErrorComponent(ErrorSource.BALANCE, unbalanced),
        ErrorComponent(ErrorSource.PIVOT, pivot, is_common=False),
    )
    return Load(weight_mass, force, budget)


def _sum_masses(components: Iterable[Component]) -> float:
    """Sum the masses of components [kg]."""
    return math.fsum(component.mass for component in components)


def _find_component(components: Iterable[Component], name: str) -> Component:
    """Find a component by its name."""
    for component in components:
        if component.name == name:
            return component
    raise LookupError(name)


def compute_pulling_load(kit: Apparatus, weight_mass: float) -> Load:
    """Compute with what force a weight [kg] pulls on its hanger, less what the bearings take.

    A cord that turns by a right angle presses its pulley with the square root of 2 of its tension.
    """
    gravity = kit.gravity.value
    components = list_components(kit)
    hanger = _find_component(components, "weight-hanger")
    weight = (weight_mass + hanger.mass) * gravity
    ratio = PULLEY_BORE / PULLEY_DIAMETER
    pulley = math.sqrt(2.0) * weight * kit.friction.pulley.value * ratio
    moving = []
    for component in components:
        if component.is_moving:
            moving.append(component)
    carriage = kit.friction.carriage.value * gravity * _sum_masses(moving)
    budget = (
        ErrorComponent(ErrorSource.MASS, kit.weight_tolerance.value * weight),
        ErrorComponent(ErrorSource.GRAVITY, kit.gravity_tolerance.value * weight),
        ErrorComponent(ErrorSource.PULLEY, _SCATTER_OF_FRICTION * pulley),
        ErrorComponent(ErrorSource.CARRIAGE, _SCATTER_OF_FRICTION * carriage),
    )
    return Load(weight_mass, weight - pulley - carriage, budget)


def find_largest_common_load_std(kit: Apparatus) -> float:
    """Find the largest uncertainty of a normal load that is the same in all trials [N]."""
    stds = []
    for mass in kit.normal_weights:
        load = compute_normal_load(kit, mass)
        stds.append(load.common_std)
    return max(stds)
