"""The ledger of energy: what is put in, stored and lost, by the very velocities of each step."""

from typing import NamedTuple

import numpy as np

from stepblocks.compute.compiled import njit
from stepblocks.contact import Array
from stepblocks.drag.kernels.contact import Touch, compute_dent_energy
from stepblocks.drag.kernels.model import Ledger, Model, Passage
from stepblocks.drag.kernels.motion import Motion
from stepblocks.drag.kernels.spring import Ring
from stepblocks.drag.kernels.surface import Surface

_NOTED = len(Passage._fields)


class Powers(NamedTuple):
    """Powers over one kick [W]."""

    work: float  # of the handle or of the pulling force
    damping_x: float  # of the dampers along the drag, that of the handle's guide among them
    damping_y: float  # of the dampers upwards
    overtones: float  # of the dampers of the overtones
    friction: float  # of the grip of both contacts on the tip
    wall: float  # lost to the wall and stored in it
    impact: float  # of the lossy force of both contacts on the tip


@njit(forceinline=True)
def compute_kick_powers(
    model: Model,
    before: Motion,
    mean: Motion,
    tip_speed: float,
    tug: float,
    spring: float,
    surface: Surface,
    wall: float,
    overtone_loss: float,
) -> Powers:
    """Compute what flows over a kick.

    `before` and `mean` are the velocities where it begins and in its middle, of the first mode
    along the drag; `tip_speed` is that of the tip itself [m/s].
    """
    handle = model.handle
    damping_x = tug * (mean.handle - mean.x)
    if handle.is_driven:
        work = (spring + tug) * mean.handle
    else:
        work = handle.pull * mean.handle
        damping_x = damping_x + handle.damping * before.handle * mean.handle
    damping_y = _compute_lift_damping_power(model, before, mean)
    friction = surface.grip_x * tip_speed + surface.grip_y * mean.y
    rubbing = wall * tip_speed
    impact = surface.loss_x * tip_speed + surface.loss_y * mean.y
    return Powers(work, damping_x, damping_y, overtone_loss, friction, rubbing, impact)


@njit(forceinline=True)
def _compute_lift_damping_power(model: Model, before: Motion, mean: Motion) -> float:
    """Return the power of the damper upwards [W]."""
    damping = model.carrier.damping
    if model.carrier.is_sprung:
        return damping * (before.carrier - before.y) * (mean.carrier - mean.y)
    return damping * mean.y * mean.y


@njit(forceinline=True)
def add_powers_over_time(ledger: Ledger, powers: Powers, time: float) -> Ledger:
    """Add what flows over a time [s]."""
    handle_work = ledger.handle_work + powers.work * time
    friction_loss = ledger.friction_loss - powers.friction * time
    damping_loss = ledger.damping_loss + powers.damping_x * time
    damping_loss += powers.damping_y * time
    damping_loss += powers.overtones * time
    impact_loss = ledger.impact_loss - powers.impact * time
    tissue_loss = ledger.tissue_loss + powers.wall * time
    return Ledger(
        handle_work,
        ledger.kinetic,
        ledger.spring,
        ledger.lift,
        ledger.contact,
        ledger.bristle,
        friction_loss,
        damping_loss,
        impact_loss,
        tissue_loss,
    )


@njit(forceinline=True)
def subtract_stored_from_losses(ledger: Ledger, bristles: float, wall: float) -> Ledger:
    """Take from the losses what bristles and wall have stored over a step [J]."""
    bristle = ledger.bristle + wall
    friction_loss = ledger.friction_loss - bristles
    tissue_loss = ledger.tissue_loss - wall
    return Ledger(
        ledger.handle_work,
        ledger.kinetic,
        ledger.spring,
        ledger.lift,
        ledger.contact,
        bristle,
        friction_loss,
        ledger.damping_loss,
        ledger.impact_loss,
        tissue_loss,
    )


@njit
def compute_stored_energies(
    model: Model,
    position: Motion,
    mean: Motion,
    stretch: float,
    under: Touch,
    beyond: Touch,
    bristle_energy: float,
    ring: Ring,
) -> Ledger:
    """Return the energies that are stored at the middle of a kick, as a ledger [J]."""
    spring, handle, carrier = model.spring, model.handle, model.carrier
    kinetic_tip = 0.5 * spring.mass * (mean.x * mean.x + mean.y * mean.y)
    kinetic_carrier = 0.5 * carrier.mass * mean.carrier * mean.carrier
    kinetic = kinetic_tip + kinetic_carrier + ring.kinetic
    if not handle.is_driven:
        kinetic += 0.5 * handle.mass * mean.handle * mean.handle
    linear = 0.5 * spring.stiffness * stretch**2
    cubic = 0.25 * spring.hardening * stretch**4
    if carrier.is_sprung:
        weight_spring = 0.5 * carrier.stiffness * (position.carrier - position.y) ** 2
        lift = carrier.load * position.carrier + weight_spring
    else:
        lift = carrier.load * position.y
    return Ledger(
        handle_work=0.0,
        kinetic=kinetic,
        spring=linear + cubic + ring.elastic,
        lift=lift,
        contact=compute_dent_energy(model.contact, under, beyond),
        bristle=bristle_energy,
        friction_loss=0.0,
        damping_loss=0.0,
        impact_loss=0.0,
        tissue_loss=0.0,
    )


@njit
def _add_ledgers(ledger: Ledger, stored: Ledger, factor: float) -> Ledger:
    """Add entry by entry, the second ledger times a factor of 1 or -1."""
    return Ledger(
        ledger.handle_work + factor * stored.handle_work,
        ledger.kinetic + factor * stored.kinetic,
        ledger.spring + factor * stored.spring,
        ledger.lift + factor * stored.lift,
        ledger.contact + factor * stored.contact,
        ledger.bristle + factor * stored.bristle,
        ledger.friction_loss + factor * stored.friction_loss,
        ledger.damping_loss + factor * stored.damping_loss,
        ledger.impact_loss + factor * stored.impact_loss,
        ledger.tissue_loss + factor * stored.tissue_loss,
    )


@njit
def update_ledger_with_stored(
    ledger: Ledger, stored: Ledger, passage: Array, is_first: bool, passes: bool, ends: bool
) -> Ledger:
    """Take what is stored off the ledger at the first step, and put it on at the end [J].

    At a passage the ledger with what is stored is noted in its row, behind that of `Passage`.
    """
    if is_first:
        ledger = _add_ledgers(ledger, stored, -1.0)
    balanced = _add_ledgers(ledger, stored, 1.0)
    if passes:
        passage[_NOTED:] = np.array(balanced)
    if ends:
        return balanced
    return ledger
