"""A probe as a clamped rod with a mass at its tip.

The model says what a sheath does to its ring, and how much reaches clamp and finger.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from stepblocks.contact import Array
from stepblocks.contact.domain import require_positive
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import ContactError

# Euler-Bernoulli beam in units of the rod: lengths in its free length, stiffness and mass in its
# own; the loss is taken from the undamped shape, each part's loss factor weighted by its share of
# the strain energy
# cubic elements: frequency to 1e-7 of the closed form
_MOST_KEPT = 256  # rings that are kept, of some milliseconds each: a set asks for one repeatedly
_TIP = -2  # coordinate of the deflection of the tip
_SHORTEST = 1e-9  # free lengths: a shorter piece is rounding
_PER_LENGTH = 32  # of the free length
_HELD = 48  # of a bedding
_BENDING = np.array(
    [
        [12.0, 6.0, -12.0, 6.0],
        [6.0, 4.0, -6.0, 2.0],
        [-12.0, -6.0, 12.0, -6.0],
        [6.0, 2.0, -6.0, 4.0],
    ]
)
_INERTIA = (
    np.array(
        [
            [156.0, 22.0, 54.0, -13.0],
            [22.0, 4.0, 13.0, -3.0],
            [54.0, 13.0, 156.0, -22.0],
            [-13.0, -3.0, -22.0, 4.0],
        ]
    )
    / 420.0
)


@dataclass(frozen=True)
class Rod:
    """A straight rod, clamped at 0 and free at its length, with a mass at the free end."""

    bending_stiffness: float  # E I [N m^2]
    line_mass: float  # mass per length [kg/m]
    length: float  # free length [m]
    end_mass: float  # of tip and collet at the free end [kg]
    loss_factor: float  # of all that damps the bare rod [1]


@dataclass(frozen=True)
class Sleeve:
    """A sheath on the free part of the rod, bending with it."""

    start: float  # where it begins, from the clamp [m]
    length: float  # m
    bending_stiffness: float  # E I of the sheath alone about the rod's axis [N m^2]
    line_mass: float  # mass per length [kg/m]
    loss_factor: float  # of its material [1]


@dataclass(frozen=True)
class Hold:
    """The rod held through a sheath.

    Beyond the clamp's edge it goes on for `length` on an elastic bedding.
    """

    length: float  # of the bedding [m]
    line_stiffness: float  # force per length and displacement [N/m^2]
    loss_factor: float  # of the bedding [1]


@dataclass(frozen=True)
class RodRing:
    """How a rod rings after its tip is let go."""

    stiffness: float  # force per displacement of the tip at rest [N/m]
    frequency: float  # of the first mode [Hz]
    loss_factor: float  # share of the energy lost per radian [1]
    sheath_share: float  # of the strain energy [1]

    @property
    def decay_time(self) -> float:
        """Time in which the amplitude falls to 1/e [s]; infinite without a loss."""
        if not self.loss_factor:
            return math.inf
        return 1.0 / (math.pi * self.frequency * self.loss_factor)

    @property
    def log_decrement(self) -> float:
        """Logarithm of the ratio of two amplitudes one period apart [1]."""
        return math.pi * self.loss_factor

    def as_tool(self, tool: Tool = PAPER.tool) -> Tool:
        """Return the tool that rings so, equal to another in all else."""
        deviation = tool.frequency_deviation * self.frequency / tool.frequency
        return replace(
            tool,
            stiffness=self.stiffness,
            frequency=self.frequency,
            frequency_deviation=deviation,
            decay_time=self.decay_time,
        )

    def compute_mean_energy(self, duration: float) -> float:
        """Return the mean over a time [s] of the ring's energy, that at the start taken as 1."""
        spent = 2.0 * duration / self.decay_time
        if not spent:
            return 1.0
        return -math.expm1(-spent) / spent


def solve_rod_for_tool(
    stiffness: float,
    frequency: float,
    decay_time: float,
    diameter: float,
    modulus: float,
    density: float,
) -> Rod:
    """Find the rod of a diameter that has a stiffness.

    The mass at its tip is that with which it rings at a frequency.
    """
    for name, value in (
        ("stiffness", stiffness),
        ("frequency", frequency),
        ("decay_time", decay_time),
    ):
        require_positive(name, value)
    section = 0.25 * math.pi * diameter**2
    bending = modulus * math.pi * diameter**4 / 64.0
    length = (3.0 * bending / stiffness) ** (1.0 / 3.0)
    line_mass = density * section
    loss_factor = 1.0 / (math.pi * frequency * decay_time)
    rod = Rod(bending, line_mass, length, end_mass=0.0, loss_factor=loss_factor)
    omega = math.tau * frequency
    wave_number = (line_mass * omega**2 / bending) ** 0.25
    beta = length * wave_number
    # what mass at the end makes it an eigenvalue: 1 + cos cosh = r b (sin cosh - cos sinh)
    sine, cosine = math.sin(beta), math.cos(beta)
    cosh, sinh = math.cosh(beta), math.sinh(beta)
    denominator = beta * (sine * cosh - cosine * sinh)
    ratio = math.inf
    if denominator:
        ratio = (1.0 + cosine * cosh) / denominator
    if ratio < 0.0:
        raise ContactError(
            "frequency must not exceed that of the bare shank of this diameter and stiffness "
            f"({compute_rod_ring(rod).frequency:.4g} Hz), got {frequency:g} Hz"
        )
    return replace(rod, end_mass=ratio * rod.line_mass * length)


def compute_bush_stiffness(bore: float, outer: float, modulus: float, poisson: float) -> float:
    """Stiffness per length of a bonded bush whose core moves sideways in a rigid shell [N/m^2].

    Adkins, Gent (1954), Br. J. Appl. Phys. 5, 354, for Poisson's ratio 0.5; else Muskhelishvili's
    ring between rigid circles. `bore` and `outer` are diameters [m], `modulus` is Young's [Pa].
    """
    shear = modulus / (2.0 * (1.0 + poisson))
    kappa = 3.0 - 4.0 * poisson
    thickness = (outer**2 - bore**2) / (outer**2 + bore**2)
    giving = kappa**2 * math.log(outer / bore) - thickness
    return 8.0 * math.pi * shear * (1.0 - poisson) * kappa / giving


@lru_cache(maxsize=_MOST_KEPT)
def compute_rod_ring(rod: Rod, sheath: Sleeve | Hold | None = None) -> RodRing:
    """Predict the first mode of a rod with a sheath on its free part, or held through one.

    Without a sheath the rod is clamped rigidly.
    """
    from scipy.linalg import eigh, solve

    if isinstance(sheath, Sleeve):
        _require_sleeve_on_rod(rod, sheath)
    matrices = _assemble_matrices(rod, sheath)
    total = matrices.stiffness
    # asked for as the largest flexibility, the lowest mode keeps its digits beside short elements
    last = total.shape[0] - 1
    values, shapes = eigh(matrices.mass, total, subset_by_index=[last, last])
    energies = matrices.compute_strain_energies(shapes[:, 0])
    shares = energies / energies.sum()
    push = np.eye(total.shape[0])[_TIP]
    deflections = solve(total, push, assume_a="pos")
    unit = rod.bending_stiffness / rod.length**3
    rod_mass = rod.line_mass * rod.length
    omega = math.sqrt(unit / float(values[0]) / rod_mass)
    return RodRing(
        stiffness=unit / float(deflections[_TIP]),
        frequency=omega / math.tau,
        loss_factor=float(shares @ matrices.losses),
        sheath_share=float(shares[1:].sum()),
    )


def _require_sleeve_on_rod(rod: Rod, sleeve: Sleeve) -> None:
    """Refuse a sheath that does not lie on the free length of the rod."""
    end = sleeve.start + sleeve.length
    ends_on_rod = end <= rod.length * (1.0 + 1e-12)
    if sleeve.length > 0.0 and sleeve.start >= 0.0 and ends_on_rod:
        return
    raise ContactError(
        f"a sheath must lie on the free length of the shank, 0 to {rod.length * 1e3:.4g} "
        f"mm from the clamp, got {sleeve.start * 1e3:.4g} to {end * 1e3:.4g} mm"
    )


class _Matrices(NamedTuple):
    """Matrices of the free coordinates, n of them, in units of the rod."""

    parts: list[Array]  # stiffness of the rod and of its sheath, each of shape (n, n)
    mass: Array  # of both together, shape (n, n)
    losses: Array  # loss factors of rod and sheath, shape (2,)
    pushes: Array  # what the inertia pushes when all is shifted sideways, shape (n,)

    @property
    def stiffness(self) -> Array:
        """Stiffness of rod and sheath together, shape (n, n)."""
        return np.asarray(np.sum(self.parts, axis=0))

    def compute_strain_energies(self, shape: Array) -> Array:
        """Strain energies of rod and sheath in a shape, shape (2,)."""
        return np.array([shape @ part @ shape for part in self.parts])


def _assemble_matrices(rod: Rod, sheath: Sleeve | Hold | None) -> _Matrices:
    """Assemble the elements between the nodes: deflection and slope at each are coordinates."""
    nodes = _choose_node_positions(rod, sheath)
    of_rod, of_sheath, mass = np.zeros((3, 2 * nodes.size, 2 * nodes.size))
    for index, (begin, end) in enumerate(itertools.pairwise(nodes)):
        span = end - begin
        block = slice(2 * index, 2 * index + 4)
        turn = np.array([1.0, span, 1.0, span])
        scale = np.outer(turn, turn)
        bending = scale * _BENDING / span**3
        inertia = scale * _INERTIA * span
        of_rod[block, block] += bending
        mass[block, block] += inertia
        middle = 0.5 * (begin + end) * rod.length
        if isinstance(sheath, Sleeve) and sheath.start < middle < sheath.start + sheath.length:
            stiffening = sheath.bending_stiffness / rod.bending_stiffness
            of_sheath[block, block] += stiffening * bending
            mass[block, block] += sheath.line_mass / rod.line_mass * inertia
        if isinstance(sheath, Hold) and middle < 0.0:
            bedding = sheath.line_stiffness * rod.length**4 / rod.bending_stiffness
            of_sheath[block, block] += bedding * inertia
    mass[_TIP, _TIP] += rod.end_mass / (rod.line_mass * rod.length)
    sheath_loss = 0.0
    if sheath is not None:
        sheath_loss = sheath.loss_factor
    losses = np.array([rod.loss_factor, sheath_loss])
    clamped = 2  # deflection and slope of a rigid clamp
    if isinstance(sheath, Hold):
        clamped = 0
    free = slice(clamped, None)
    pushes = np.tile([1.0, 0.0], nodes.size) @ mass
    parts = [of_rod[free, free], of_sheath[free, free]]
    return _Matrices(parts, mass[free, free], losses, pushes[free])


def _choose_node_positions(rod: Rod, sheath: Sleeve | Hold | None) -> Array:
    """Place the nodes in units of the free length; every end of a sheath is one."""
    ends = {0.0, 1.0}
    if isinstance(sheath, Sleeve):
        for place in (sheath.start, sheath.start + sheath.length):
            ends.add(min(place / rod.length, 1.0))
    elif sheath is not None:
        ends.add(-sheath.length / rod.length)
    pieces = sorted(ends)
    kept = pieces[:1]
    for begin, end in itertools.pairwise(pieces):
        if end - begin > _SHORTEST:
            kept.append(end)
    spans = []
    for begin, end in itertools.pairwise(kept):
        count = max(1, math.ceil(_PER_LENGTH * (end - begin)))
        if end <= 0.0:  # on the bedding
            count = _HELD
        spans.append(np.linspace(begin, end, count, endpoint=False))
    return np.concatenate([*spans, kept[-1:]])


_HIGHEST = 1000.0  # of the modes that are felt [Hz]: above it the Pacinian threshold rises steeply
_LOWEST = 50.0  # below it the hand gives way as a whole, which is no vibration [Hz]
_SAMPLES = 4000  # of a force over the paper's 16 ms


@dataclass(frozen=True)
class Mode:
    """A normal mode of a rod that is held still, mass normalised.

    Phi at the tip, momentum G, ``sum G phi = 1``.
    """

    frequency: float  # Hz
    loss_factor: float  # share of the energy lost per radian [1]
    reaction: float  # force on the hold over the pull that was let go at the tip, G phi [1]
    momentum: float  # G [kg^0.5]
    tip: float  # phi at the tip [kg^-0.5]


@dataclass(frozen=True)
class Hand:
    """A hand on a handle: the skin and flesh of the grasp, a mass behind it, and the arm.

    Along the drag.
    """

    handle_mass: float  # of handle or sheath's shell, without the rod [kg]
    grasp_stiffness: float  # N/m
    grasp_damping: float  # N s/m
    mass: float  # kg
    arm_stiffness: float  # N/m
    arm_damping: float  # N s/m


# Fu and Cavusoglu 2012, IEEE Trans. SMC B 42, 1633: a hand on a stylus in two directions, grasp 380
# to 770 N/m and 0.8 to 1.8 N s/m, 0.20 to 0.22 kg, arm 79 to 272 N/m and 4.6 to 18 N s/m; the
# middles, as a digest of it quotes them. Identified up to 30 Hz: at 300 Hz it is an extrapolation.
# The handle's 20 g are assumed.
STYLUS_HAND = Hand(20e-3, 575.0, 1.3, 0.21, 176.0, 11.3)


def compute_modes(
    rod: Rod, sheath: Sleeve | Hold | None = None, highest: float = _HIGHEST
) -> list[Mode]:
    """Return the modes of a rod up to a frequency [Hz].

    The rod is clamped rigidly or held through a sheath.
    """
    from scipy.linalg import eigh

    matrices = _assemble_matrices(rod, sheath)
    values, shapes = eigh(matrices.stiffness, matrices.mass)
    unit = math.sqrt(rod.bending_stiffness / (rod.line_mass * rod.length**4)) / math.tau
    scale = math.sqrt(rod.line_mass * rod.length)  # kg^0.5
    modes = []
    for value, shape in zip(values, shapes.T, strict=True):
        frequency = unit * math.sqrt(max(float(value), 0.0))
        if frequency > highest:
            break
        energies = matrices.compute_strain_energies(shape)
        loss_factor = float(energies @ matrices.losses / energies.sum())
        momentum = float(matrices.pushes @ shape)
        tip = float(shape[_TIP])
        mode = Mode(
            frequency,
            loss_factor,
            reaction=momentum * tip,
            momentum=momentum * scale,
            tip=tip / scale,
        )
        modes.append(mode)
    return modes


def compute_clamp_force(modes: Sequence[Mode], time: Array, *, is_blow: bool = False) -> Array:
    """Return the force on the clamp [N] after a pull of 1 N was let go at the tip; times in s.

    With `is_blow` it is the force after a blow of 1 N s at the tip.
    """
    total = np.zeros_like(time)
    for mode in modes:
        omega = math.tau * mode.frequency
        phase = omega * time
        wave = np.cos(phase)
        if is_blow:
            wave = omega * np.sin(phase)
        decay = np.exp(-0.5 * omega * mode.loss_factor * time)
        total += mode.reaction * decay * wave
    return total


def integrate_squared_clamp_force(
    modes: Sequence[Mode], duration: float = PAPER.tool.ring_duration
) -> float:
    """Integrate the square of the force on a sensor between rod or sheath and clamp [N^2 s].

    It is for a pull of 1 N, over a `duration` [s]; the energy there is in proportion to it.
    """
    time = np.linspace(0.0, duration, _SAMPLES)
    force = compute_clamp_force(modes, time)
    return float(np.trapezoid(force**2, time))


def compute_energy_share_in_hand(
    rod: Rod,
    stiffness: float,
    modes: Sequence[Mode],
    hand: Hand = STYLUS_HAND,
    duration: float = PAPER.tool.ring_duration,
) -> float:
    """Return the share of the stored energy that a grasping hand takes up as vibration [1]."""
    from scipy.linalg import expm, solve_continuous_lyapunov

    held = _HeldRod.assemble(rod, modes, hand)
    system = held.build_first_order_matrix()
    ring = _remove_slow_modes_from_state(system, held.compute_pulled_state(modes))
    lossy = np.concatenate([np.zeros(len(held.mass)), held.grasp])
    damping = -hand.grasp_damping * np.outer(lossy, lossy)
    # the quadratic form of a state whose value the grasp spends from then on
    spent = solve_continuous_lyapunov(system.T, damping)
    later = expm(system * duration) @ ring
    spent_in_time = ring @ spent @ ring - later @ spent @ later
    stored = 0.5 / stiffness
    return float(spent_in_time / stored)


class _HeldRod(NamedTuple):
    """The modes of a rod on a handle that a hand carries.

    Coordinates are those of the n modes, then of the handle and of the mass behind the grasp, each
    mode by ``q'' + w eta q' + w^2 q = -G u''``; matrices of shape (n + 2, n + 2).
    """

    mass: Array
    damper: Array
    spring: Array
    grasp: Array  # by how much each coordinate stretches the grasp, shape (n + 2,)

    @classmethod
    def assemble(cls, rod: Rod, modes: Sequence[Mode], hand: Hand) -> "_HeldRod":
        """Assemble modes, handle and hand."""
        count = len(modes)
        omega = np.array([math.tau * mode.frequency for mode in modes])
        losses = np.array([mode.loss_factor for mode in modes])
        momentum = np.array([mode.momentum for mode in modes])
        displaced = hand.handle_mass + rod.line_mass * rod.length + rod.end_mass
        mass = np.diag([*np.ones(count), displaced, hand.mass])
        mass[count, :count] = momentum
        mass[:count, count] = momentum
        handle, arm = np.eye(count + 2)[count:]
        grasp = handle - arm
        of_grasp, of_arm = np.outer(grasp, grasp), np.outer(arm, arm)
        spring = np.diag([*(omega**2), 0.0, 0.0]) + hand.grasp_stiffness * of_grasp
        spring = spring + hand.arm_stiffness * of_arm
        damper = np.diag([*(omega * losses), 0.0, 0.0])
        damper += hand.grasp_damping * of_grasp + hand.arm_damping * of_arm
        return cls(mass, damper, spring, grasp)

    def build_first_order_matrix(self) -> Array:
        """Build the matrix of the first-order system of coordinates and their rates."""
        from scipy.linalg import solve

        zero, unity = np.zeros_like(self.mass), np.eye(len(self.mass))
        of_spring = -solve(self.mass, self.spring)
        of_damper = -solve(self.mass, self.damper)
        return np.block([[zero, unity], [of_spring, of_damper]])

    def compute_pulled_state(self, modes: Sequence[Mode]) -> Array:
        """Find coordinates and rates under 1 N on the tip, which moves rod and handle."""
        from scipy.linalg import solve

        pull = np.array([*(mode.tip for mode in modes), 1.0, 0.0])
        deflections = solve(self.spring, pull)
        at_rest = np.zeros_like(deflections)
        return np.concatenate([deflections, at_rest])


def _remove_slow_modes_from_state(system_matrix: Array, state: Array) -> Array:
    """Return a state of a first-order system without what moves more slowly than a vibration."""
    values, vectors = np.linalg.eig(system_matrix)
    parts = np.linalg.solve(vectors, state)
    is_slow = np.abs(values.imag) < math.tau * _LOWEST
    parts[is_slow] = 0.0
    return np.asarray(np.real(vectors @ parts))
