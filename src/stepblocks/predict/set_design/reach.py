"""Which block gives a target, or why none does and what would."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import ContactError
from stepblocks.predict.predictions import Model
from stepblocks.predict.set_design.curve import EnergyCurve
from stepblocks.predict.set_design.route import SizeRange
from stepblocks.predict.set_design.targets import Target, compute_threshold_energy
from stepblocks.quantities import format_quantity

# loads and tips are tried up to a factor of 16 either way, nearest first
_FACTORS = [2.0 ** (0.25 * step) for step in range(1, 17)]
_BISECTIONS = 12
_COARSE_POINTS = 16  # of a drag in time, under loads and tips that are tried
_DIGITS = 3  # of a load or a tip that is said


class Obstacle(StrEnum):
    """Why no block gives a target."""

    BELOW_THRESHOLD = "below the detection threshold"
    BELOW_FRICTION = "friction alone stores more"
    BELOW_LEAST = "below what can be built"
    ABOVE_MOST = "above what can be built"
    LOCKED = "locked"
    BEYOND_STRENGTH = "beyond the strength of the tool"
    BEYOND_SPRING = "beyond the spring"
    BEYOND_GAUGE = "beyond the gauge"
    BEYOND_HAND = "beyond a hand"
    JUMPED = "the energy jumps over it"
    SAME_SIZE = "rounds to the size of another target"


_BEYOND = {
    Status.BEYOND_STRENGTH: Obstacle.BEYOND_STRENGTH,
    Status.BEYOND_SPRING: Obstacle.BEYOND_SPRING,
    Status.BEYOND_GAUGE: Obstacle.BEYOND_GAUGE,
    Status.BEYOND_HAND: Obstacle.BEYOND_HAND,
}
_BEYOND_BY_NAME = {
    "strength": Obstacle.BEYOND_STRENGTH,
    "spring": Obstacle.BEYOND_SPRING,
    "gauge": Obstacle.BEYOND_GAUGE,
    "hand": Obstacle.BEYOND_HAND,
}


@dataclass(frozen=True)
class Placement:
    """A target with the sizes that give it.

    Attributes
    ----------
    target : Target
        What is wanted.
    size : float
        Smallest size that gives it and can be made [m].
    made_size : float
        The same, rounded to what is made [m].
    further_sizes : tuple of float
        Sizes of other branches that give it and can be made [m].
    """

    target: Target
    size: float
    made_size: float
    further_sizes: tuple[float, ...]


@dataclass(frozen=True)
class MissedTarget:
    """A target that no block gives.

    Attributes
    ----------
    target : Target
        What is wanted.
    obstacle : Obstacle
        Why it is not given.
    detail : str
        The same with figures.
    load, tip_radius : float or None
        Nearest load [N] and ball [m] that would give it, the other left as it is; None where there
        is none within a factor of 16.
    """

    target: Target
    obstacle: Obstacle
    detail: str
    load: float | None = None
    tip_radius: float | None = None

    def describe(self) -> str:
        """Say in a line what is wanted, why it is not given, and what would give it."""
        sentence = f"{self.target.wanted}: {self.obstacle}, {self.detail}"
        if self.remedy:
            sentence += f"; {self.remedy} would reach it"
        return sentence

    @property
    def remedy(self) -> str:
        """What would reach it, in words; empty where neither load nor tip would."""
        words = []
        if self.load is not None:
            words.append(f"a load of {format_quantity(self.load, 'force')}")
        if self.tip_radius is not None:
            words.append(f"a tip of {format_quantity(self.tip_radius, 'length')}")
        return " or ".join(words)


def find_block_for_target(
    target: Target, curve: EnergyCurve, sizes: SizeRange
) -> Placement | MissedTarget:
    """Find the block that gives a target, or say why there is none and what would give it."""
    found = _find_block_or_obstacle(target, curve, sizes)
    if isinstance(found, Placement) or found.obstacle is Obstacle.BELOW_THRESHOLD:
        return found
    if curve.model is Model.FORMULA and found.obstacle in _BEYOND.values():
        return found  # an energy takes the same pull under every load and with every tip
    load = _find_nearest_reaching_value(
        lambda factor: _is_target_reached(target, curve, sizes, load_factor=factor),
        curve.point.normal_load,
    )
    tip_radius = _find_nearest_reaching_value(
        lambda factor: _is_target_reached(target, curve, sizes, tip_factor=factor),
        curve.point.ball_radius,
    )
    return replace(found, load=load, tip_radius=tip_radius)


def _find_block_or_obstacle(
    target: Target, curve: EnergyCurve, sizes: SizeRange
) -> Placement | MissedTarget:
    """Find the block that gives a target, or say why there is none."""
    threshold = compute_threshold_energy(curve.point.tool)
    if target.energy < threshold:
        detail = f"nobody feels less than {format_quantity(threshold, 'energy', 3)}"
        return MissedTarget(target, Obstacle.BELOW_THRESHOLD, detail)
    found = curve.find_sizes_for_energy(target.energy)
    made = [size for size in found if sizes.contains(sizes.round_to_step(size))]
    if not made:
        return _make_missed_target(target, curve, sizes, found)
    size, *further = made
    made_size = sizes.round_to_step(size)
    status = curve.compute_release(made_size).status
    if status is not Status.RELEASES:
        asked = format_quantity(size, "length")
        detail = f"at {format_quantity(made_size, 'length')}, to which {asked} rounds"
        return MissedTarget(target, _BEYOND.get(status, Obstacle.LOCKED), detail)
    return Placement(target, size, made_size, tuple(further))


def _make_missed_target(
    target: Target, curve: EnergyCurve, sizes: SizeRange, unmakeable_sizes: tuple[float, ...]
) -> MissedTarget:
    """Say why no size beside the `unmakeable_sizes` [m] gives a target."""
    smallest = format_quantity(sizes.least, "length")
    largest = format_quantity(sizes.most, "length")
    if unmakeable_sizes:
        wanted = format_quantity(unmakeable_sizes[0], "length", 3)
        if unmakeable_sizes[0] < sizes.least:
            detail = f"it takes {wanted}, the least is {smallest}"
            return MissedTarget(target, Obstacle.BELOW_LEAST, detail)
        detail = f"it takes {wanted}, the most is {largest}"
        return MissedTarget(target, Obstacle.ABOVE_MOST, detail)
    tool = curve.point.tool
    pull = math.sqrt(2.0 * tool.stiffness * target.energy / tool.conversion)
    limit = tool.limits.first
    if curve.model is Model.FORMULA and pull > limit.force:
        detail = f"it takes a pull of {pull:.3g} N, the limit is {limit.force:.3g} N"
        return MissedTarget(target, _BEYOND_BY_NAME[limit.name], detail)
    samples, energies = curve.sizes_and_energies
    known = np.isfinite(energies)
    if not known.any():
        status = curve.compute_release(sizes.least).status
        detail = f"every size is {status}"
        return MissedTarget(target, _BEYOND.get(status, Obstacle.LOCKED), detail)
    lowest, highest = float(energies[known].min()), float(energies[known].max())
    if target.energy < lowest:
        detail = f"no size gives less than {format_quantity(lowest, 'energy', 3)}"
        obstacle = Obstacle.BELOW_FRICTION
        if curve.model is Model.DRAG:
            obstacle = Obstacle.BELOW_LEAST
        return MissedTarget(target, obstacle, detail)
    if target.energy > highest:
        detail = f"no size gives more than {format_quantity(highest, 'energy', 3)}"
        return MissedTarget(target, _find_upper_obstacle(curve, float(samples[known][-1])), detail)
    detail = "the ring changes there from one branch to another"
    return MissedTarget(target, Obstacle.JUMPED, detail)


def _find_upper_obstacle(curve: EnergyCurve, last_size: float) -> Obstacle:
    """Say what ends the energies above the last size that slips [m]."""
    if last_size >= curve.most * (1.0 - 1e-9):
        return Obstacle.ABOVE_MOST
    status = curve.compute_release(last_size * (1.0 + 1e-6)).status
    return _BEYOND.get(status, Obstacle.LOCKED)


def _is_target_reached(
    target: Target,
    curve: EnergyCurve,
    sizes: SizeRange,
    *,
    load_factor: float = 1.0,
    tip_factor: float = 1.0,
) -> bool:
    """Tell whether a target is reached under another load or with another ball."""
    try:
        point = _scale_load_and_tip(curve.point, load_factor, tip_factor)
    except ContactError:  # no such ball or load
        return False
    changed = replace(curve, point=point, drag_points=_COARSE_POINTS)
    return isinstance(_find_block_or_obstacle(target, changed, sizes), Placement)


def _scale_load_and_tip(
    point: OperatingPoint, load_factor: float, tip_factor: float
) -> OperatingPoint:
    """Return the operating point with another load and ball."""
    return replace(
        point,
        normal_load=point.normal_load * load_factor,
        ball_radius=point.ball_radius * tip_factor,
    )


def _find_nearest_reaching_value(
    is_reached: Callable[[float], bool], present_value: float
) -> float | None:
    """Find the value nearest to the present one that reaches a target, of few digits.

    Parameters
    ----------
    is_reached : callable
        Tells whether the present value times a factor does.
    present_value : float
        The value that does not.

    Returns
    -------
    float or None
        None where no factor of up to 16 does.
    """
    for failing, factor in _iterate_factor_brackets():
        if not is_reached(factor):
            continue
        for _ in range(_BISECTIONS):
            middle = math.sqrt(failing * factor)
            if is_reached(middle):
                factor = middle
            else:
                failing = middle
        return _round_away_if_reached(present_value, factor, is_reached)
    return None


def _iterate_factor_brackets() -> Iterator[tuple[float, float]]:
    """Yield factors with the one before each in the same direction, nearest to 1 first."""
    before = 1.0
    for factor in _FACTORS:
        yield 1.0 / before, 1.0 / factor
        yield before, factor
        before = factor


def _round_away_if_reached(
    present_value: float, factor: float, is_reached: Callable[[float], bool]
) -> float:
    """Return `present_value` times a factor, rounded away from it to few digits if that reaches."""
    value = present_value * factor
    unit = 10.0 ** (math.floor(math.log10(value)) - _DIGITS + 1)
    multiple = math.floor(value / unit)
    if factor > 1.0:
        multiple = math.ceil(value / unit)
    short = float(f"{multiple * unit:.{_DIGITS}g}")
    if is_reached(short / present_value):
        return short
    return value
