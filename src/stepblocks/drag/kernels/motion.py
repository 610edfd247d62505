"""The coordinates that move, and what a step makes of them."""

from typing import NamedTuple

from stepblocks.compute.compiled import njit


class Motion(NamedTuple):
    """Positions [m] or velocities [m/s] of all that moves."""

    x: float  # of the tip along the drag
    y: float  # of the tip upwards
    handle: float  # along the drag
    carrier: float  # of the weight, upwards


@njit(forceinline=True)
def compute_next_position(position: Motion, velocity: Motion, time_step: float) -> Motion:
    """Move everything by its velocity over a step."""
    return Motion(
        position.x + time_step * velocity.x,
        position.y + time_step * velocity.y,
        position.handle + time_step * velocity.handle,
        position.carrier + time_step * velocity.carrier,
    )


@njit(forceinline=True)
def average_velocities(before: Motion, after: Motion) -> Motion:
    """Return the mean velocity over a kick."""
    return Motion(
        0.5 * (after.x + before.x),
        0.5 * (after.y + before.y),
        0.5 * (after.handle + before.handle),
        0.5 * (after.carrier + before.carrier),
    )
