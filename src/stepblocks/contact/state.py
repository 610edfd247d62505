"""The slots of the model of one drag, filled for every trial: what an effect may change."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import kernels
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]

# What a trial shows: logarithms of J, N, Hz and s; spring constant over its nominal value; measured over set load
CHANNELS = (
    "ln_energy",
    "ln_peak_force",
    "sliding_friction",
    "spring_constant",
    "ln_ring_frequency",
    "ln_decay_time",
    "normal_load_ratio",
)

_STEEPEST = np.deg2rad(89.0)  # beyond it the tip locks; the fit needs a finite slope back into the domain


@dataclass(frozen=True)
class DragState:
    """Every quantity of equations (1) and (2) per trial, and where the bench shows something else than the contact."""

    height: Floats  # shape (n,); Step height H and radius sum R + r [m]
    radius: Floats
    tilt: Floats  # Slope added to the path of the tip [rad]
    friction: Floats  # Coefficient of friction [1]
    load: Floats  # Normal load at the contact and as set by the weights [N]
    set_load: Floats
    climb_load: Floats  # Load that appears only while the tip is lifted [N]
    sensed_offset: Floats  # What the normal gauge sees beyond the set load [N]
    speed: Floats  # Speed of the handle [m/s]
    stiffness: Floats  # Spring constant of the ramp and of the ring [N/m]
    ring_stiffness: Floats
    hardening: Floats  # Cubic coefficient g of ``F = u + g u^3`` with u = k x [1/N^2]
    conversion: Floats  # Share C_v of the stored energy that rings [1]
    lost_energy: Floats  # Energy spent before the ring [J]
    drag: Floats  # Tangential force beside friction [N]: at any time, and while the tip climbs alone
    climb_drag: Floats
    damping: Floats  # Factor on the rate of decay [1]
    gain: Floats  # Gain of the tangential gauge [1]
    lag: Floats  # Time constant of the gauge [s]
    frequency: Floats  # Nominal ring frequency [Hz] and decay time [s]
    decay_time: Floats
    nominal_stiffness: float  # Stiffness to which frequency and channel refer [N/m]

    def angle(self) -> Floats:
        """Slope of the path at release plus angle of friction [rad], held below locking."""
        share = np.clip(self.height / self.radius, 1e-9, 1.0)
        critical = kernels.angle_on_step(share, 1.0)
        return np.asarray(np.clip(critical + self.tilt + np.arctan(self.friction), -1.0, _STEEPEST))

    def locked(self) -> NDArray[np.bool_]:
        """Where the tip never climbs."""
        share = np.clip(self.height / self.radius, 1e-9, 1.0)
        critical = kernels.angle_on_step(share, 1.0) + self.tilt + np.arctan(self.friction)
        return np.asarray((critical >= 0.5 * np.pi) | (self.height >= self.radius))

    def peak_force(self) -> Floats:
        """Tangential force on the tool at release [N]; equation (1)."""
        load = np.maximum(self.load + self.climb_load, 1e-3)
        return np.asarray(np.maximum(load * np.tan(self.angle()) + self.drag + self.climb_drag, 1e-4))

    def loading_time(self) -> Floats:
        """Time from the first load on the edge to release [s]: the ramp from sliding to the peak."""
        sliding = np.maximum(self.load, 1e-3) * np.tan(np.arctan(self.friction) + self.tilt) + self.drag
        rise = np.maximum(self.peak_force() - sliding, 0.0)
        return np.asarray(rise / (self.stiffness * self.speed))

    def changed(self, **slots: Any) -> DragState:
        """Return a copy with some slots changed; cheaper than ``dataclasses.replace`` in inner loops."""
        copy = object.__new__(DragState)
        copy.__dict__.update(self.__dict__)
        copy.__dict__.update(slots)
        return copy


_SLOTS = tuple(f.name for f in fields(DragState) if f.name != "nominal_stiffness")


def observe(state: DragState) -> Floats:
    """Return all channels of a state.

    The energy is what an amplitude of force A shows, ``A^2 / 2k`` with the nominal k: the square of the gauge's gain
    enters, and a spring that is stiffer in load and ring stores less but shows the same amplitude. A gauge of
    first order shows a ramp late by its time constant, so the peak falls short by ``k v tau (1 - exp(-t / tau))``, and
    the ring with its amplitude over ``sqrt(1 + (2 pi f tau)^2)``.
    """
    from stepblocks.contact.channel_kernel import channels_of

    slots = state.__dict__
    columns = [np.ascontiguousarray(slots[name], dtype=np.float64) for name in _SLOTS]
    count = columns[0].size
    if any(column.size != count for column in columns):
        raise ContactError(f"every slot must hold {count} trials, got {sorted({c.size for c in columns})}")
    return np.asarray(channels_of(*columns, float(state.nominal_stiffness)))
