"""The springs of the tool and of the carrier, the overtones, and the kick that forces give."""

from typing import NamedTuple

import numpy as np

from stepblocks.compute.compiled import njit
from stepblocks.contact import Array
from stepblocks.drag.kernels.model import Carrier, Model, Spring
from stepblocks.drag.kernels.motion import Motion

# columns of the modes: constants of an overtone, what moves, and what a gauge reads
_STIFFNESS, _MASS, _DAMPING, DEFLECTION, _RATE, FORCE = range(6)


class Forces(NamedTuple):
    """What acts on the tip, all at one moment [N]."""

    x: float  # along the drag
    y: float  # upwards
    spring: float  # of the first mode
    hold: float  # of the weight on the tip, upwards


class Kick(NamedTuple):
    """Constants of a step in which forces change velocities, its dampers taken at the middle."""

    time: float  # [s]
    per_mass: float  # time over the mass of the tip [s/kg]
    keep_x: float  # share of the velocity along the drag that the damper leaves [1]
    gain_x: float  # share of the push along the drag that it leaves [1]
    keep_y: float  # the same upwards
    gain_y: float


class Ring(NamedTuple):
    """All overtones together after a kick."""

    rate: float  # sum of their velocities [m/s]
    stretch: float  # what a gauge of the tip's deflection reads of them [m]
    kinetic: float  # energy [J]
    elastic: float  # energy [J]
    loss: float  # power of their dampers [W]


@njit
def compute_kick_constants(model: Model, time: float) -> Kick:
    """Work out the constants of a kick over a time [s]."""
    mass = model.spring.mass
    slowing_x = 0.5 * model.spring.damping * time / mass
    slowing_y = 0.5 * model.carrier.damping * time / mass
    keep_x = (1.0 - slowing_x) / (1.0 + slowing_x)
    gain_x = 1.0 / (1.0 + slowing_x)
    keep_y = (1.0 - slowing_y) / (1.0 + slowing_y)
    gain_y = 1.0 / (1.0 + slowing_y)
    return Kick(time, time / mass, keep_x, gain_x, keep_y, gain_y)


@njit
def make_starting_overtones(model: Model, overtones: Array) -> Array:
    """Deflect each overtone as in steady sliding, or leave it at rest where a force pulls.

    `overtones` has stiffness [N/m], mass [kg] and damper [N s/m] of each, shape (n, 3); the modes
    that are returned have shape (n, 6).
    """
    modes = np.zeros((overtones.shape[0], 6))
    modes[:, :3] = overtones
    if model.handle.is_driven:
        modes[:, DEFLECTION] = model.sliding_pull / overtones[:, 0]
    return modes


@njit(forceinline=True)
def compute_spring_force(spring: Spring, stretch: float) -> float:
    """Return the force of the first mode at its stretch [N]."""
    return spring.stiffness * stretch + spring.hardening * stretch * stretch * stretch


@njit(forceinline=True)
def compute_carrier_force(carrier: Carrier, position: Motion) -> float:
    """Return the force of the weight on the tip, upwards [N]."""
    if carrier.is_sprung:
        return carrier.stiffness * (position.carrier - position.y)
    return -carrier.load


@njit(forceinline=True)
def compute_kicked_velocities(model: Model, kick: Kick, velocity: Motion, forces: Forces) -> Motion:
    """Change the velocities of first mode, tip, handle and carrier by the forces of a step."""
    spring, handle, carrier = model.spring, model.handle, model.carrier
    if handle.is_driven:
        push = kick.gain_x * (kick.per_mass * forces.x)
        drag_along = (1.0 - kick.keep_x) * handle.speed  # by the damper between handle and tip
        x = kick.keep_x * velocity.x + push + drag_along
        handle_speed = velocity.handle
    else:
        damper = spring.damping * (velocity.handle - velocity.x)
        x = velocity.x + kick.per_mass * (forces.x + damper)
        guide = handle.damping * velocity.handle
        pull = handle.pull - forces.spring - damper - guide
        handle_speed = velocity.handle + kick.time * pull / handle.mass
    if carrier.is_sprung:
        damper = carrier.damping * (velocity.carrier - velocity.y)
        y = velocity.y + kick.per_mass * (forces.y + damper)
        push = -carrier.load - forces.hold - damper
        carrier_speed = velocity.carrier + kick.time * push / carrier.mass
    else:
        push = kick.gain_y * (kick.per_mass * forces.y)
        y = kick.keep_y * velocity.y + push
        carrier_speed = velocity.carrier
    return Motion(x, y, handle_speed, carrier_speed)


@njit(forceinline=True)
def compute_damper_force(model: Model, before: Motion, mean: Motion) -> float:
    """Return the force of the damper of the first mode [N].

    Of a handle that a force pulls it is taken where the kick begins, as `accelerate` does.
    """
    if model.handle.is_driven:
        return model.spring.damping * (mean.handle - mean.x)
    return model.spring.damping * (before.handle - before.x)


@njit
def update_overtones(modes: Array, push: float, kick_time: float, drift_time: float) -> Ring:
    """Kick each overtone by the force that pushes the tip back [N], and let it drift.

    Stretch, rate and force of the modes, shape (n, 6), are replaced.
    """
    rates = stretch = kinetic = elastic = loss = 0.0
    for number in range(modes.shape[0]):
        mode = modes[number]
        stiffness, mass, damping = mode[_STIFFNESS], mode[_MASS], mode[_DAMPING]
        deflection, before = mode[DEFLECTION], mode[_RATE]
        slowing = 0.5 * damping * kick_time / mass
        pushed = kick_time / mass * (push - stiffness * deflection)
        rate = ((1.0 - slowing) * before + pushed) / (1.0 + slowing)
        mean = 0.5 * (rate + before)
        mode[DEFLECTION] = deflection + drift_time * rate
        mode[_RATE] = rate
        mode[FORCE] = stiffness * deflection + damping * mean
        rates += rate
        stretch += mode[FORCE] / stiffness
        kinetic += 0.5 * mass * mean * mean
        elastic += 0.5 * stiffness * deflection * deflection
        loss += damping * mean * mean
    return Ring(rates, stretch, kinetic, elastic, loss)
