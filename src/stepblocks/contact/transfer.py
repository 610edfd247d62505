"""From the tip to the clamp and the finger: what of a rod's ring reaches the sensor behind its sheath, and the hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.operating_point import PAPER
from stepblocks.contact.rod import Hold, Rod, Sleeve, assembled

Array = NDArray[np.float64]
_HIGHEST = 1000.0  # of the modes that are felt [Hz]: above it the Pacinian threshold rises steeply
_LOWEST = 50.0  # below it the hand gives way as a whole, which is no vibration [Hz]
_SAMPLES = 4000  # of a force over the paper's 16 ms


@dataclass(frozen=True)
class Mode:
    """A normal mode of a rod that is held still, mass normalised: phi at the tip, momentum G, ``sum G phi = 1``."""

    frequency: float  # Hz
    loss_factor: float  # share of the energy lost per radian [1]
    reaction: float  # force on the hold over the pull that was let go at the tip, G phi [1]
    momentum: float  # G [kg^0.5]
    tip: float  # phi at the tip [kg^-0.5]


@dataclass(frozen=True)
class Hand:
    """A hand on a handle: the skin and flesh of the grasp, a mass behind it, and the arm; along the drag."""

    handle_mass: float  # of handle or sheath's shell, without the rod [kg]
    grasp_stiffness: float  # N/m
    grasp_damping: float  # N s/m
    mass: float  # kg
    arm_stiffness: float  # N/m
    arm_damping: float  # N s/m


# Fu and Cavusoglu 2012, IEEE Trans. SMC B 42, 1633: a hand on a stylus in two directions, grasp 380 to 770 N/m and 0.8 to 1.8 N s/m,
# 0.20 to 0.22 kg, arm 79 to 272 N/m and 4.6 to 18 N s/m; the middles, as a digest of it quotes them. Identified up to 30 Hz: at
# 300 Hz it is an extrapolation. The handle's 20 g are assumed.
STYLUS_HAND = Hand(20e-3, 575.0, 1.3, 0.21, 176.0, 11.3)


def modes_of(
    rod: Rod, sleeves: Sequence[Sleeve] = (), hold: Hold | None = None, highest: float = _HIGHEST
) -> list[Mode]:
    """Return the modes of a rod with sheaths, rigidly clamped or held through a bedding, up to a frequency [Hz]."""
    from scipy.linalg import eigh

    parts, mass, losses, pushes = assembled(rod, sleeves, hold)
    values, shapes = eigh(np.sum(parts, axis=0), mass)
    unit = math.sqrt(rod.bending_stiffness / (rod.line_mass * rod.length**4)) / math.tau
    scale = math.sqrt(rod.line_mass * rod.length)  # kg^0.5
    found = []
    for value, shape in zip(values, shapes.T, strict=True):
        frequency = unit * math.sqrt(max(float(value), 0.0))
        if frequency > highest:
            break
        energies = np.array([shape @ part @ shape for part in parts])
        momentum, tip = float(pushes @ shape), float(shape[-2])
        loss = float(energies @ losses / energies.sum())
        found.append(Mode(frequency, loss, momentum * tip, momentum * scale, tip / scale))
    return found


def clamp_force(modes: Sequence[Mode], time: Array, blow: bool = False) -> Array:
    """Force on the clamp [N] after a pull of 1 N was let go at the tip, or after a blow of 1 N s there; times in s."""
    total = np.zeros_like(time)
    for one in modes:
        w = math.tau * one.frequency
        wave = w * np.sin(w * time) if blow else np.cos(w * time)
        total += one.reaction * np.exp(-0.5 * w * one.loss_factor * time) * wave
    return total


def sensed(modes: Sequence[Mode], duration: float = PAPER.tool.ring_duration) -> float:
    """Square of the force on a sensor between rod or sheath and clamp, over a time, for a pull of 1 N [s]; its energy goes with it."""
    time = np.linspace(0.0, duration, _SAMPLES)
    return float(np.trapezoid(clamp_force(modes, time) ** 2, time))


def finger_share(
    rod: Rod,
    stiffness: float,
    modes: Sequence[Mode],
    hand: Hand = STYLUS_HAND,
    duration: float = PAPER.tool.ring_duration,
) -> float:
    """Share of the energy stored at the release that the grasp of a hand takes up as vibration over a time [1]."""
    from scipy.linalg import expm, solve, solve_continuous_lyapunov

    # the modes of the held rod ride on a handle that the hand carries: q'' + w eta q' + w^2 q = -G u'' for each
    n = len(modes)
    w = np.array([math.tau * one.frequency for one in modes])
    momentum, tip = np.array([one.momentum for one in modes]), np.array([one.tip for one in modes])
    moved = hand.handle_mass + rod.line_mass * rod.length + rod.end_mass
    mass = np.diag([*np.ones(n), moved, hand.mass])
    mass[n, :n] = mass[:n, n] = momentum
    grasp = np.zeros(n + 2)
    grasp[n:] = 1.0, -1.0
    arm = np.zeros(n + 2)
    arm[n + 1] = 1.0
    spring = np.diag([*(w**2), 0.0, 0.0]) + hand.grasp_stiffness * np.outer(grasp, grasp)
    spring += hand.arm_stiffness * np.outer(arm, arm)
    damper = np.diag([*(w * [one.loss_factor for one in modes]), 0.0, 0.0])
    damper += hand.grasp_damping * np.outer(grasp, grasp) + hand.arm_damping * np.outer(arm, arm)
    system = np.block([[np.zeros_like(mass), np.eye(n + 2)], [-solve(mass, spring), -solve(mass, damper)]])
    pull = np.concatenate([tip, [1.0, 0.0]])  # 1 N on the tip moves rod and handle
    start = np.concatenate([solve(spring, pull), np.zeros(n + 2)])
    values, vectors = np.linalg.eig(system)
    parts = np.linalg.solve(vectors, start)
    parts[np.abs(values.imag) < math.tau * _LOWEST] = 0.0
    ring = np.real(vectors @ parts)
    lossy = np.concatenate([np.zeros(n + 2), grasp])
    spent = solve_continuous_lyapunov(system.T, -hand.grasp_damping * np.outer(lossy, lossy))
    later = expm(system * duration) @ ring
    return float((ring @ spent @ ring - later @ spent @ later) / (0.5 / stiffness))
