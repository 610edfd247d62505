"""A probe as a clamped rod with a mass at its tip, what a sheath does to its ring, and what a test of that ring measures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.domain import require_positive
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import ContactError

Array = NDArray[np.float64]
# Euler-Bernoulli beam in units of the rod: lengths in its free length, stiffness and mass in its own; the loss is taken from the
# undamped shape, each part's loss factor weighted by its share of the strain energy
_PER_LENGTH, _HELD = 32, 48  # cubic elements of the free length, and of a bedding: frequency to 1e-7 of the closed form
_BENDING = np.array([[12.0, 6.0, -12.0, 6.0], [6.0, 4.0, -6.0, 2.0], [-12.0, -6.0, 12.0, -6.0], [6.0, 2.0, -6.0, 4.0]])
_INERTIA = (
    np.array(
        [[156.0, 22.0, 54.0, -13.0], [22.0, 4.0, 13.0, -3.0], [54.0, 13.0, 156.0, -22.0], [-13.0, -3.0, -22.0, 4.0]]
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
    """The rod held through a sheath: beyond the clamp's edge it goes on for `length` on an elastic bedding."""

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
        """Time in which the amplitude falls to 1/e [s]."""
        return 1.0 / (math.pi * self.frequency * self.loss_factor) if self.loss_factor else math.inf

    @property
    def log_decrement(self) -> float:
        """Logarithm of the ratio of two amplitudes one period apart [1]."""
        return math.pi * self.loss_factor

    def as_tool(self, like: Tool = PAPER.tool) -> Tool:
        """Return the tool that rings so, like another in all else."""
        deviation = like.frequency_deviation * self.frequency / like.frequency  # the same share
        rung = replace(like, frequency=self.frequency, frequency_deviation=deviation, decay_time=self.decay_time)
        return replace(rung, stiffness=self.stiffness)

    def mean_energy(self, duration: float) -> float:
        """Return the mean over a time of the ring's energy, that at the start taken as 1."""
        spent = 2.0 * duration / self.decay_time
        return -math.expm1(-spent) / spent if spent else 1.0


def rod_for(
    stiffness: float, frequency: float, decay_time: float, diameter: float, modulus: float, density: float
) -> Rod:
    """Find the rod of a diameter that has a stiffness, and the mass at its tip with which it rings at a frequency."""
    for name, value in (("stiffness", stiffness), ("frequency", frequency), ("decay_time", decay_time)):
        require_positive(name, value)
    section = 0.25 * math.pi * diameter**2
    bending = modulus * math.pi * diameter**4 / 64.0
    length = (3.0 * bending / stiffness) ** (1.0 / 3.0)
    rod = Rod(bending, density * section, length, 0.0, 1.0 / (math.pi * frequency * decay_time))
    # wave number times length, and what mass at the end makes it an eigenvalue: 1 + cos cosh = r b (sin cosh - cos sinh)
    beta = length * (rod.line_mass * (math.tau * frequency) ** 2 / bending) ** 0.25
    over = beta * (math.sin(beta) * math.cosh(beta) - math.cos(beta) * math.sinh(beta))
    ratio = (1.0 + math.cos(beta) * math.cosh(beta)) / over if over else math.inf
    if ratio < 0.0:
        bare = ring_of(rod).frequency
        raise ContactError(
            f"frequency must not exceed that of the bare shank of this diameter and stiffness ({bare:.4g} Hz), got {frequency:g} Hz"
        )
    return Rod(bending, rod.line_mass, length, ratio * rod.line_mass * length, rod.loss_factor)


def bush_stiffness(bore: float, outer: float, modulus: float, poisson: float) -> float:
    """Stiffness per length of a bonded bush whose core moves sideways in a rigid shell."""
    # Adkins, Gent (1954), Br. J. Appl. Phys. 5, 354, for Poisson's ratio 0.5; else Muskhelishvili's ring between rigid circles
    shear, kappa = modulus / (2.0 * (1.0 + poisson)), 3.0 - 4.0 * poisson
    grown = (outer**2 - bore**2) / (outer**2 + bore**2)
    return 8.0 * math.pi * shear * (1.0 - poisson) * kappa / (kappa**2 * math.log(outer / bore) - grown)


def ring_of(rod: Rod, sleeves: Sequence[Sleeve] = (), hold: Hold | None = None) -> RodRing:
    """Predict the first mode of a rod with sheaths on its free part, or held through one; rigidly clamped without `hold`."""
    from scipy.linalg import eigh, solve

    for sleeve in sleeves:
        if not (sleeve.length > 0.0 <= sleeve.start and sleeve.start + sleeve.length <= rod.length * (1.0 + 1e-12)):
            raise ContactError(
                f"a sheath must lie on the free length of the shank, 0 to {rod.length * 1e3:.4g} mm from the clamp, "
                f"got {sleeve.start * 1e3:.4g} to {(sleeve.start + sleeve.length) * 1e3:.4g} mm"
            )
    parts, mass, losses, _ = assembled(rod, sleeves, hold)
    total = np.sum(parts, axis=0)
    # asked for as the largest flexibility, the lowest mode keeps its digits beside short elements
    last = total.shape[0] - 1
    values, shapes = eigh(mass, total, subset_by_index=[last, last])
    shape = shapes[:, 0]
    energies = np.array([shape @ part @ shape for part in parts])
    shares = energies / energies.sum()
    push = np.zeros(total.shape[0])
    push[-2] = 1.0
    unit = rod.bending_stiffness / rod.length**3
    frequency = math.sqrt(unit / float(values[0]) / (rod.line_mass * rod.length)) / math.tau
    stiffness = unit / float(solve(total, push, assume_a="pos")[-2])
    return RodRing(stiffness, frequency, float(shares @ losses), float(shares[1:].sum()))


def assembled(rod: Rod, sleeves: Sequence[Sleeve], hold: Hold | None) -> tuple[list[Array], Array, Array, Array]:
    """Stiffness of rod, sheaths and bedding, the mass of all, the loss factor of each, what their inertia pushes when shifted."""
    nodes = _nodes(rod, sleeves, hold)
    shape = (2 * nodes.size, 2 * nodes.size)
    own, mass = np.zeros(shape), np.zeros(shape)
    theirs = [np.zeros(shape) for _ in (*sleeves, hold)]
    for index, (a, b) in enumerate(itertools.pairwise(nodes)):
        span, at = b - a, slice(2 * index, 2 * index + 4)
        turn = np.array([1.0, span, 1.0, span])
        scale = np.outer(turn, turn)
        bending, inertia = scale * _BENDING / span**3, scale * _INERTIA * span
        own[at, at] += bending
        mass[at, at] += inertia
        middle = 0.5 * (a + b) * rod.length
        for number, sleeve in enumerate(sleeves):
            if sleeve.start < middle < sleeve.start + sleeve.length:
                theirs[number][at, at] += sleeve.bending_stiffness / rod.bending_stiffness * bending
                mass[at, at] += sleeve.line_mass / rod.line_mass * inertia
        if hold is not None and middle < 0.0:
            theirs[-1][at, at] += hold.line_stiffness * rod.length**4 / rod.bending_stiffness * inertia
    mass[-2, -2] += rod.end_mass / (rod.line_mass * rod.length)
    losses = [rod.loss_factor, *(sleeve.loss_factor for sleeve in sleeves), hold.loss_factor if hold else 0.0]
    free = slice(0 if hold else 2, None)
    pushes = np.tile([1.0, 0.0], nodes.size) @ mass
    return [part[free, free] for part in (own, *theirs)], mass[free, free], np.array(losses), pushes[free]


def _nodes(rod: Rod, sleeves: Sequence[Sleeve], hold: Hold | None) -> Array:
    """Places of the nodes in units of the free length; every end of a sheath is one."""
    ends = {0.0, 1.0, *(min(place / rod.length, 1.0) for s in sleeves for place in (s.start, s.start + s.length))}
    if hold is not None:
        ends.add(-hold.length / rod.length)
    pieces = sorted(ends)
    kept = [pieces[0], *(b for a, b in itertools.pairwise(pieces) if b - a > 1e-9)]
    counts = [_HELD if b <= 0.0 else max(1, math.ceil(_PER_LENGTH * (b - a))) for a, b in itertools.pairwise(kept)]
    spans = [np.linspace(a, b, n, endpoint=False) for (a, b), n in zip(itertools.pairwise(kept), counts, strict=True)]
    return np.concatenate([*spans, [kept[-1]]])


_RECORD = 5.0  # time constants: all but 5e-5 of the energy is recorded
_MOST_RELEASES = 10_000


@dataclass(frozen=True)
class DecayTest:
    """A planned test of one probe."""

    force: float  # that moves the tip before it is let go [N]
    peak_acceleration: float  # of the tip as it starts [m/s^2]
    log_decrement: float  # what will be read from the amplitudes [1]
    periods_above_noise: int  # whole periods until the amplitude has sunk to three times the noise
    record_time: float  # time to record [s]
    samples: int  # samples of one release
    frequency_std: float  # least standard uncertainty of the frequency from one release [Hz]
    log_decrement_std: float  # of the logarithmic decrement [1]
    releases: int  # releases after which the logarithmic decrement is known as well as wanted


def plan_decay_test(tool: Tool, displacement: float, noise: float, rate: float, wanted: float) -> DecayTest:
    """Say what a test of a tool's ring will measure, and how well; `wanted` is relative, of the logarithmic decrement."""
    for name, value in (("displacement", displacement), ("noise", noise), ("rate", rate), ("wanted", wanted)):
        require_positive(name, value)
    frequency, decay_time = tool.frequency, tool.decay_time
    if rate < 4.0 * frequency:
        raise ContactError(f"rate must be at least four samples per period ({4.0 * frequency:.4g} Hz), got {rate:g} Hz")
    if displacement <= 3.0 * noise:
        raise ContactError(
            f"displacement must exceed three times the noise ({3e6 * noise:g} um), got {displacement * 1e6:g} um"
        )
    count = max(math.ceil(_RECORD * decay_time * rate), 8)
    decrement = 1.0 / (decay_time * frequency)
    # the Cramer-Rao bound of a damped sine: least standard uncertainties of its angular frequency and decay rate [1/s]
    time = np.arange(count) / rate
    envelope, phase = np.exp(-time / decay_time), math.tau * frequency * time
    cosine, sine = envelope * np.cos(phase), envelope * np.sin(phase)
    scaled = time / decay_time  # so that all columns are of order one
    slopes = np.column_stack([cosine, -sine, -scaled * sine, -scaled * cosine]) * displacement
    least = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes) * noise**2)[2:]) / decay_time
    frequency_std, rate_std = float(least[0]) / math.tau, float(least[1])
    decrement_std = math.hypot(rate_std / frequency, decrement * frequency_std / frequency)
    releases = max(math.ceil((decrement_std / (wanted * decrement)) ** 2), 1)
    if releases > _MOST_RELEASES:
        raise ContactError(
            f"the wanted uncertainty {wanted:g} would take {releases} releases, more than {_MOST_RELEASES}"
        )
    return DecayTest(
        force=tool.stiffness * displacement,
        peak_acceleration=(math.tau * frequency) ** 2 * displacement,
        log_decrement=decrement,
        periods_above_noise=math.floor(decay_time * math.log(displacement / (3.0 * noise)) * frequency),
        record_time=count / rate,
        samples=count,
        frequency_std=frequency_std,
        log_decrement_std=decrement_std,
        releases=releases,
    )
