"""The slots of the model of one drag, filled for every trial: what an effect may change, and what a trial shows of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import kernels

Floats = NDArray[np.float64]

# what a trial shows: logarithms of J, N, Hz and s; spring constant over its nominal value; measured over set load
CHANNELS = (
    "ln_energy",
    "ln_peak_force",
    "sliding_friction",
    "spring_constant",
    "ln_ring_frequency",
    "ln_decay_time",
    "normal_load_ratio",
)

_STEEPEST = np.deg2rad(89.0)  # beyond it the tip locks; a fit needs a finite slope back into the domain
_LEAST_LOAD, _LEAST_FORCE = 1e-3, 1e-4  # N, where a fit strays


@dataclass(frozen=True)
class DragState:
    """Every quantity of equations (1) and (2) per trial, and where the bench shows something else than the contact."""

    height: Floats  # of the step H [m]
    radius: Floats  # of ball and edge together, R + r [m]
    tilt: Floats  # slope added to the path of the tip [rad]
    friction: Floats  # coefficient [1]
    load: Floats  # at the contact [N]
    set_load: Floats  # by the weights [N]
    climb_load: Floats  # appears only while the tip is lifted [N]
    sensed_offset: Floats  # what the normal gauge sees beyond the set load [N]
    speed: Floats  # of the handle [m/s]
    stiffness: Floats  # of the ramp [N/m]
    ring_stiffness: Floats  # of the ring [N/m]
    hardening: Floats  # g of ``F = u + g u^3`` with u = k x [1/N^2]
    conversion: Floats  # share C_v of the stored energy that rings [1]
    lost_energy: Floats  # spent before the ring [J]
    drag: Floats  # tangential force beside friction, at any time [N]
    climb_drag: Floats  # the same while the tip climbs [N]
    damping: Floats  # factor on the rate of decay [1]
    gain: Floats  # of the tangential gauge [1]
    lag: Floats  # time constant of that gauge [s]
    frequency: Floats  # of the ring on the nominal spring [Hz]
    decay_time: Floats  # of the ring's amplitude without further damping [s]
    nominal_stiffness: float  # to which frequency and channel refer [N/m]

    def _slope(self) -> Floats:
        share = np.clip(self.height / self.radius, 1e-9, 1.0)
        return np.asarray(kernels.angle_on_step(share, 1.0) + (self.tilt + np.arctan(self.friction)))

    def angle(self) -> Floats:
        """Slope of the path at release plus angle of friction [rad], held below locking."""
        return np.clip(self._slope(), -1.0, _STEEPEST)

    def locked(self) -> NDArray[np.bool_]:
        """Where the tip never climbs."""
        return np.asarray((self._slope() >= 0.5 * np.pi) | (self.height >= self.radius))

    def peak_force(self) -> Floats:
        """Tangential force on the tool at release [N]; equation (1)."""
        lifted = np.maximum(self.load + self.climb_load, _LEAST_LOAD)
        # the friction is in the angle, and held below locking with it
        pull = kernels.pull_force(lifted, self.angle(), 0.0)
        return np.asarray(np.maximum(pull + self.drag + self.climb_drag, _LEAST_FORCE))

    def sliding_force(self) -> Floats:
        """Tangential force on the tool before the edge [N]."""
        return np.asarray(kernels.pull_force(np.maximum(self.load, _LEAST_LOAD), self.tilt, self.friction) + self.drag)

    def loading_time(self) -> Floats:
        """Time from the first load on the edge to release [s]: the ramp from sliding to the peak."""
        rise = np.maximum(self.peak_force() - self.sliding_force(), 0.0)
        return np.asarray(rise / (self.stiffness * self.speed))

    def changed(self, **slots: Any) -> DragState:
        """Return a copy with some slots changed; cheaper than ``dataclasses.replace`` in inner loops."""
        copy = object.__new__(DragState)
        copy.__dict__.update(self.__dict__)
        copy.__dict__.update(slots)
        return copy


def observe(state: DragState) -> Floats:
    """Show the `CHANNELS` of n trials, shape (n, 7).

    The energy is what an amplitude of force A shows, ``A^2 / 2k`` with the nominal k: the square of the gauge's gain
    enters, and a spring that is stiffer in load and ring stores less but shows the same amplitude. A gauge of
    first order shows a ramp late by its time constant, so the peak falls short by ``k v tau (1 - exp(-t / tau))``, and
    the ring with its amplitude over ``sqrt(1 + (2 pi f tau)^2)``.
    """
    force, sliding = state.peak_force(), state.sliding_force()
    linear, stored = _spring(state, force)
    energy = _ringing(state.conversion * stored, state.lost_energy)
    # an amplitude of force counts as A^2 / 2k with the nominal k, whatever k it rings with
    energy = energy * (state.ring_stiffness / state.nominal_stiffness)
    peak = force
    if np.any(state.lag):
        slope, late = state.stiffness * state.speed, np.maximum(state.lag, 1e-18)
        ramp = np.maximum(force - sliding, 0.0) / slope
        peak = np.maximum(force - slope * late * (1.0 - np.exp(-np.minimum(ramp / late, 50.0))), _LEAST_FORCE)
        energy = energy / (1.0 + (2.0 * np.pi * state.frequency * late) ** 2)
    sensed = np.maximum(state.set_load + state.sensed_offset, _LEAST_LOAD)
    shown = (
        np.log(state.gain**2 * energy),
        np.log(state.gain * peak),
        state.gain * sliding / sensed,
        state.gain * state.stiffness * (force / linear) / state.nominal_stiffness,
        np.log(state.frequency * np.sqrt(state.ring_stiffness / state.nominal_stiffness)),
        np.log(state.decay_time / state.damping),
        sensed / state.set_load,
    )
    return np.stack(shown, axis=1)


def _spring(state: DragState, force: Floats) -> tuple[Floats, Floats]:
    """Force ``u = k x`` of the spring had it not hardened [N], and the energy that it stores [J]."""
    if not np.any(state.hardening > 1e-8):
        return force, kernels.stored_energy(force, state.stiffness)
    root = np.sqrt(3.0 * np.maximum(state.hardening, 1e-9))
    solved = 2.0 / root * np.sinh(np.arcsinh(1.5 * force * root) / 3.0)  # the real root of u + g u^3 = F
    linear = np.where(state.hardening > 1e-8, solved, force)
    stored = kernels.stored_energy(linear, state.stiffness) + 0.25 * state.hardening * linear**4 / state.stiffness
    return linear, stored


def _ringing(ringing: Floats, lost: Floats) -> Floats:
    """Energy left to ring: it never turns negative, below a tenth of what would ring it fades out smoothly."""
    if not np.any(lost):
        return ringing
    left, floor = ringing - lost, 0.1 * ringing
    return np.where(left > floor, left, floor * np.exp(np.minimum(left / floor - 1.0, 0.0)))
