"""Limits of the inputs within which a person feels the same: the energy stays within bounds."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import (
    compute_deviated_releases,
    compute_sensitivities,
    map_inputs_to_nominal_values,
)
from stepblocks.errors import ContactError

_MOST_DOUBLINGS = 60  # of the common factor, until the energy has left its bounds
_EXACT = 1e-12  # of the logarithm of the energy, to which a bound is found
# smallest deviations that can be made and measured, assumed: somewhat less than two wrung gauge
# blocks hold, and about what an arc fit on a profile resolves [m]
FINEST = {"height": 0.1e-6, "edge_radius": 0.5e-6, "ball_radius": 0.5e-6}
_MOST_CHANGE = 100.0  # of ln E; beyond it the tip is held


@dataclass(frozen=True)
class Deviations:
    """Permitted deviations of an input from its nominal, signed [SI]."""

    upper: float
    lower: float


FeltLimits: TypeAlias = dict[str, Deviations]  # by the name of the input


@dataclass(frozen=True)
class EnergyBounds:
    """By how much the energy of a ring may change and still feel the same.

    Attributes
    ----------
    rise, fall : float
        Permitted change of ln E upwards and downwards, both positive.
    """

    rise: float
    fall: float


def find_felt_limits(
    face: Counterface,
    point: OperatingPoint,
    bounds: EnergyBounds,
    free_inputs: Iterable[str],
    fixed_limits: Mapping[str, Deviations],
) -> FeltLimits:
    """Find the widest limits whose worst corners keep the energy within bounds.

    What is fixed spends the budget first. What remains is shared equally by the free inputs, in
    either direction by itself: the energy grows faster upwards than downwards. No input is asked to
    be finer than `FINEST`, or to go below zero; what it does not use of its share goes to the
    others.

    Parameters
    ----------
    face, point : Counterface, OperatingPoint
        Nominal; the drag must release.
    bounds : EnergyBounds
        Within which the energy stays.
    free_inputs : iterable of str
        Inputs that get limits, by the names of `map_inputs_to_nominal_values`.
    fixed_limits : mapping of Deviations
        Limits of other inputs.

    Returns
    -------
    FeltLimits
        Of the free inputs.

    Raises
    ------
    ContactError
        If nothing rings, or what is fixed or the finest that can be made leaves the bounds.
    """
    free_inputs = list(free_inputs)
    if face.release(point).status is not Status.RELEASES:
        raise ContactError("limits by what is felt need a drag that releases")
    slopes = compute_sensitivities(face, point, dict.fromkeys([*free_inputs, *fixed_limits], 1.0))
    wish = _LimitSearch(face, point, slopes, free_inputs, fixed_limits)
    upwards = _find_deviations_within_budget(wish, bounds.rise, +1.0)
    downwards = _find_deviations_within_budget(wish, bounds.fall, -1.0)
    limits = {}
    for name in free_inputs:
        ends = (upwards[name], downwards[name])
        limits[name] = Deviations(max(ends), min(ends))
    return limits


@dataclass(frozen=True)
class _LimitSearch:
    """Which inputs of a drag get limits, and which have them."""

    face: Counterface
    point: OperatingPoint
    slopes: Mapping[str, float]  # of ln E by each input
    free: list[str]
    fixed: Mapping[str, Deviations]


def compute_extreme_energy_changes(
    face: Counterface, point: OperatingPoint, limits: Mapping[str, Deviations]
) -> tuple[float, float]:
    """Compute the change of ln E at the weakest and the strongest corner of limits.

    Infinite where the tip is held at the strongest, or does not ring at the weakest.
    """
    slopes = compute_sensitivities(face, point, dict.fromkeys(limits, 1.0))
    changes = []
    for direction in (-1.0, +1.0):
        corner = _choose_extreme_corner(limits, slopes, direction)
        changes.append(_compute_log_energy_change(face, point, corner))
    weakest, strongest = changes
    return weakest, strongest


def _choose_extreme_corner(
    limits: Mapping[str, Deviations], slopes: Mapping[str, float], direction: float
) -> dict[str, float]:
    """Choose the deviation of each input that moves the energy furthest in a direction."""
    corner = {}
    for name, deviations in limits.items():
        if direction * slopes[name] > 0.0:
            corner[name] = deviations.upper
        else:
            corner[name] = deviations.lower
    return corner


def _compute_log_energy_change(
    face: Counterface, point: OperatingPoint, deviations: Mapping[str, float]
) -> float:
    """Compute the change of ln E where the inputs deviate; infinite where nothing rings."""
    _, energy = compute_deviated_releases(face, point, deviations)
    nominal = face.release(point).vibration_energy
    if not energy > 0.0:
        return -math.inf
    return math.log(float(energy) / nominal)


def _find_deviations_within_budget(
    wish: _LimitSearch, budget: float, direction: float
) -> dict[str, float]:
    """Share a budget of ln E in one direction; return the signed deviation of each free input."""
    spent = _choose_extreme_corner(wish.fixed, wish.slopes, direction)
    inputs = map_inputs_to_nominal_values(wish.face, wish.point)
    signs = {name: math.copysign(1.0, direction * wish.slopes[name]) for name in wish.free}

    def find_deviations(scale: float) -> dict[str, float]:
        """Return the signed deviation of each free input for equal effects of a size."""
        deviations = {}
        for name in wish.free:
            width = max(scale / abs(wish.slopes[name]), FINEST.get(name, 0.0))
            if signs[name] < 0.0:
                width = min(width, inputs[name])  # no size is negative
            deviations[name] = signs[name] * width
        return deviations

    def find_excess(scale: float) -> float:
        """Return by how much the change of ln E at a scale exceeds the budget."""
        change = _compute_log_energy_change(wish.face, wish.point, spent | find_deviations(scale))
        return min(abs(change), 1e6) - budget

    if find_excess(0.0) > 0.0:
        change = _compute_log_energy_change(wish.face, wish.point, spent | find_deviations(0.0))
        names = ", ".join([*wish.fixed, *(name for name in wish.free if name in FINEST)])
        raise ContactError(
            f"the energy must stay within {_format_energy_change(direction * budget)}, got "
            f"{_format_energy_change(change)} where {names} are as fine as they are stated or can "
            "be made"
        )
    if not wish.free:
        return {}
    outside = budget
    for _ in range(_MOST_DOUBLINGS):
        if find_excess(outside) > 0.0:
            break
        outside *= 2.0
    else:  # nothing that can become smaller takes the energy out of its bounds
        return find_deviations(outside)
    # loaded here, since every declaration that is read imports this module
    from scipy.optimize import brentq

    return find_deviations(float(brentq(find_excess, 0.0, outside, xtol=_EXACT)))


def _format_energy_change(log_change: float) -> str:
    """Write a change of ln E as a percentage; "no release" beyond `_MOST_CHANGE`."""
    if log_change > _MOST_CHANGE:
        return "no release"
    return f"{100.0 * math.expm1(log_change):+.3g} %"
