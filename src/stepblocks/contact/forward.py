"""The nominal model of a session, equations (1) and (2), for many trials at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.state import DragState
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class BenchDesign:
    """What was set on the bench, in SI units."""

    block: NDArray[np.str_]  # shape (n,); Block of each trial
    height: Floats  # shape (n,); Nominal height [m], normal load [N], speed of the handle [m/s], radius of the tip [m]
    load: Floats
    speed: Floats
    tip_radius: Floats
    spring_constant: float  # Nominal spring constant of the probe [N/m]

    def __post_init__(self) -> None:
        for name in ("height", "load", "speed", "tip_radius"):
            column = getattr(self, name)
            if not (np.all(np.isfinite(column)) and np.all(column > 0.0)):
                raise ContactError(f"{name} of every trial must be positive and finite")
        if len(self.block) == 0:
            raise ContactError("block must name at least one trial")
        if not (np.isfinite(self.spring_constant) and self.spring_constant > 0.0):
            raise ContactError(f"spring_constant must be positive and finite, got {self.spring_constant:g} N/m")

    @cached_property
    def members(self) -> tuple[tuple[str, ...], NDArray[np.intp]]:
        """Names of the blocks' height errors, and which of them each trial has."""
        blocks, inverse = np.unique(self.block, return_inverse=True)
        return tuple(height_name(str(b)) for b in blocks), inverse

    @cached_property
    def ones(self) -> Floats:
        """One for each trial."""
        return np.ones(len(self.block))


@dataclass(frozen=True)
class Constant:
    """A constant of the nominal model: name, unit, start, bounds, and a change that matters."""

    name: str
    unit: str
    start: float
    low: float
    high: float
    scale: float
    prior_std: float = float("inf")
    block: str = ""


def height_name(block: str) -> str:
    """Name of the height error of a block."""
    return f"height_error[{block}]"


def constants(
    design: BenchDesign,
    frequency: float,
    decay_time: float,
    height_std: float = 1e-6,
    scanned: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Constant, ...]:
    """List the constants fitted to a session, as the paper did, and the height error of each block."""
    found = [
        Constant("friction", "1", 0.15, 0.005, 0.9, 0.02),
        Constant("ln_conversion", "1", float(np.log(0.2)), -9.0, 4.0, 0.1),
        Constant("stiffness_ratio", "1", 1.0, 0.2, 5.0, 0.02),
        Constant("ln_ring_frequency", "ln Hz", float(np.log(frequency)), 3.0, 9.0, 0.01),
        Constant("ln_decay_time", "ln s", float(np.log(decay_time)), -9.0, 1.0, 0.05),
    ]
    for block in np.unique(design.block):
        nominal = float(design.height[design.block == block][0])
        start, spread = 0.0, height_std
        if scanned and str(block) in scanned:
            value, own = scanned[str(block)]
            start, spread = value - nominal, max(own, 0.1e-6)
        # the bounds keep a step a step
        reach = min(12.0 * height_std, 0.8 * nominal)
        found.append(
            Constant(height_name(str(block)), "m", start, start - reach, start + reach, 0.3e-6, spread, str(block))
        )
    return tuple(found)


def nominal_state(design: BenchDesign, values: Mapping[str, float]) -> DragState:
    """Fill the slots from the design and the constants."""
    names, inverse = design.members
    errors = np.array([values.get(name, 0.0) for name in names])
    height = design.height + errors[inverse]
    one = design.ones
    zero = 0.0 * one
    stiffness = design.spring_constant * values["stiffness_ratio"] * one
    return DragState(
        height=height,
        radius=design.tip_radius,
        tilt=zero,
        friction=values["friction"] * one,
        load=design.load,
        set_load=design.load,
        climb_load=zero,
        sensed_offset=zero,
        speed=design.speed,
        stiffness=stiffness,
        ring_stiffness=design.spring_constant * one,
        hardening=zero,
        conversion=np.exp(values["ln_conversion"]) * one,
        lost_energy=zero,
        drag=zero,
        climb_drag=zero,
        damping=one,
        gain=one,
        lag=zero,
        frequency=np.exp(values["ln_ring_frequency"]) * one,
        decay_time=np.exp(values["ln_decay_time"]) * one,
        nominal_stiffness=design.spring_constant,
    )
