"""Friction of the tip on its bristles, and of the tool on a soft wall beside the edge."""

import math
from collections.abc import Callable
from typing import NamedTuple

from stepblocks.compute.compiled import njit
from stepblocks.drag.kernels.contact import Touch, compute_sliding_speed
from stepblocks.drag.kernels.model import Friction, Model, Wall
from stepblocks.drag.kernels.motion import Motion

FrictionLaw = Callable[[float, float, float, float], float]


class Grip(NamedTuple):
    """A tangential spring that sticks or slips."""

    force: float  # that it bears [N]
    stretch: float  # [m]


class Bristles(NamedTuple):
    """Stretch of the bristles of each contact, and of the wall [m]."""

    under: float  # of the branch under the tip
    beyond: float  # of the one beyond the kink
    wall: float


@njit(forceinline=True)
def compute_moved_spring_grip(
    bristle: float,
    travel: float,
    speed: float,
    limit: float,
    stiffness: float,
    give: float,
    damping: float,
    bends: bool,
) -> Grip:
    """Move a tangential spring by a `travel` [m] at a `speed` [m/s]; return its new grip.

    It sticks below the `limit` [N] and yields there, or bends towards it (Dahl, LuGre), implicitly,
    so that no step passes the limit. `give` is the inverse of the stiffness [m/N].
    """
    if bends and limit > 0.0:
        share = stiffness / limit
        stretch = (bristle + travel) / (1.0 + abs(travel) * share)
        rate = speed - abs(speed) * stretch * share  # of the stretch [m/s]
        force = stiffness * stretch + damping * rate
        return Grip(force, stretch)
    stretch = bristle + travel
    force = stiffness * stretch + damping * speed
    if abs(force) > limit:
        held = math.copysign(limit, force)
        return Grip(held, held * give)
    return Grip(force, stretch)


@njit(forceinline=True)
def compute_coefficient(
    friction: Friction,
    law: FrictionLaw | None,
    speed: float,
    normal: float,
    x: float,
    time: float,
) -> float:
    """Return the coefficient of friction [1] of a contact under a normal force [N]."""
    if law is not None:
        return law(speed, normal, x, time)
    if not friction.varies:
        return friction.sliding
    excess = friction.static - friction.sliding
    stribeck = excess * math.exp(-abs(speed) / friction.stribeck_speed)
    viscous = friction.viscous * abs(speed)
    return friction.sliding + stribeck + viscous


@njit
def make_starting_bristles(
    model: Model, law: FrictionLaw | None, touch: Touch, tip: Motion, speed: Motion
) -> Bristles:
    """Stretch bristles and wall as in steady sliding; where a force pulls they begin relaxed."""
    if not model.handle.is_driven:
        return Bristles(0.0, 0.0, 0.0)
    friction, wall = model.friction, model.wall
    rate = compute_sliding_speed(touch, speed)
    coefficient = compute_coefficient(friction, law, rate, touch.normal, tip.x, 0.0)
    stretch = coefficient * touch.normal * friction.give
    if wall.is_there:
        return Bristles(stretch, 0.0, wall.friction / wall.stiffness)
    return Bristles(stretch, 0.0, 0.0)


@njit(forceinline=True)
def swap_bristles_at_kink(bristles: Bristles, was_right: bool, is_right: bool) -> Bristles:
    """Swap the bristles of both branches where the tip passes a kink."""
    if is_right == was_right:
        return bristles
    return Bristles(bristles.beyond, bristles.under, bristles.wall)


@njit(forceinline=True)
def compute_moved_bristle_grip(
    friction: Friction,
    law: FrictionLaw | None,
    touch: Touch,
    bristle: float,
    tip: Motion,
    speed: Motion,
    time: float,
    time_step: float,
) -> Grip:
    """Move the bristle of a contact over a step; an open contact releases its bristle."""
    if not touch.normal > 0.0:
        return Grip(0.0, 0.0)
    rate = compute_sliding_speed(touch, speed)
    coefficient = compute_coefficient(friction, law, rate, touch.normal, tip.x, time)
    travel = rate * time_step
    limit = coefficient * touch.normal
    return compute_moved_spring_grip(
        bristle,
        travel,
        rate,
        limit,
        friction.stiffness,
        friction.give,
        friction.damping,
        friction.bends,
    )


@njit(forceinline=True)
def compute_moved_wall_grip(wall: Wall, stretch: float, speed: float, time_step: float) -> Grip:
    """Move the spring of the wall over a step; without a wall nothing rubs."""
    if not wall.is_there:
        return Grip(0.0, stretch)
    travel = speed * time_step
    give = 1.0 / wall.stiffness
    return compute_moved_spring_grip(
        stretch,
        travel,
        speed,
        wall.friction,
        wall.stiffness,
        give,
        wall.damping,
        bends=False,
    )


@njit(forceinline=True)
def compute_bristle_energy(friction: Friction, bristles: Bristles) -> float:
    """Return the energy of the bristles of both contacts [J]."""
    squares = bristles.under * bristles.under + bristles.beyond * bristles.beyond
    return 0.5 * friction.stiffness * squares


@njit(forceinline=True)
def compute_wall_energy_change(wall: Wall, stretch_before: float, stretch_after: float) -> float:
    """Return the energy that the wall's spring takes up from one stretch to another [J]."""
    return 0.5 * wall.stiffness * (stretch_after * stretch_after - stretch_before * stretch_before)
