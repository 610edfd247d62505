"""What the surface does to the tip: both contacts and their friction together."""

from typing import NamedTuple

from stepblocks.compute.compiled import njit
from stepblocks.drag.kernels.contact import Touch
from stepblocks.drag.kernels.friction import Grip
from stepblocks.drag.kernels.model import Carrier


class Surface(NamedTuple):
    """Forces of the surface on the tip [N]."""

    x: float  # all of them, along the drag
    y: float  # all of them, upwards
    loss_x: float  # lossy part of the contacts
    loss_y: float
    grip_x: float  # friction
    grip_y: float
    normal: float  # sum of both contacts along their normals
    friction: float  # sum of both contacts along their tangents


@njit(forceinline=True)
def combine_contact_forces(under: Touch, beyond: Touch, grip: Grip, grip_beyond: Grip) -> Surface:
    """Add the contact under the tip and the one beyond the kink."""
    loss_x_under = -under.loss * under.slope * under.cosine
    loss_x_beyond = beyond.loss * beyond.slope * beyond.cosine
    loss_x = loss_x_under - loss_x_beyond
    loss_y = under.loss * under.cosine + beyond.loss * beyond.cosine
    grip_x = -grip.force * under.cosine - grip_beyond.force * beyond.cosine
    grip_y_under = -grip.force * under.slope * under.cosine
    grip_y_beyond = grip_beyond.force * beyond.slope * beyond.cosine
    grip_y = grip_y_under - grip_y_beyond
    x = under.x + beyond.x + loss_x + grip_x
    y = under.y + beyond.y + loss_y + grip_y
    normal = under.normal + beyond.normal
    friction = grip.force + grip_beyond.force
    return Surface(x, y, loss_x, loss_y, grip_x, grip_y, normal, friction)


@njit(forceinline=True)
def compute_gauge_normal_force(carrier: Carrier, surface: Surface, hold: float) -> float:
    """Compute the normal force that a gauge reads [N]: of carrier or surface."""
    if carrier.is_sprung:
        return -hold
    return surface.y
