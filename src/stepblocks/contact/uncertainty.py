"""Intervals of a prediction from the uncertainties of its inputs: by sensitivities, and by drawing.

The two agree where everything is small against the distance to locking. Where they do not, the drawn interval is right:
near locking the energy has a long tail, and part of the draws do not release at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import kernels
from stepblocks.contact.critical_angle import step_angle
from stepblocks.contact.energy import Status, release_at
from stepblocks.contact.operating_point import Tool
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Inputs:
    """What a prediction for one step needs."""

    height: float  # H, r and R [m]
    edge_radius: float
    ball_radius: float
    friction: float  # mu [1]
    normal_load: float  # F_py [N]
    stiffness: float  # k [N/m]
    conversion: float  # C_v [1]


@dataclass(frozen=True)
class Spread:
    """Standard uncertainties of the inputs, each in the unit of its input; 0 where it is known."""

    height: float = 0.0  # [m]
    edge_radius: float = 0.0
    ball_radius: float = 0.0
    friction: float = 0.0  # [1]
    normal_load: float = 0.0  # [N]
    stiffness: float = 0.0  # [N/m]
    conversion: float = 0.0  # [1]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ContactError(f"uncertainty of {field.name} must be finite and not negative, got {value:g}")

    @classmethod
    def of_tolerances(cls, **half_widths: float) -> Spread:
        """Take standard uncertainties of rectangular distributions of these half-widths (JCGM 100, 4.3.7)."""
        return cls(**{name: value / math.sqrt(3.0) for name, value in half_widths.items()})


@dataclass(frozen=True)
class Interval:
    """A prediction with its intervals."""

    status: Status  # Of the nominal inputs
    force: float  # Nominal F_px [N] and E_v [J]; NaN unless it releases
    energy: float
    force_low: float  # Quantiles of the draws; infinite where that share of them is held, 0 where it does not catch
    force_high: float
    energy_low: float
    energy_high: float
    # The same from first-order sensitivities of the logarithms; NaN unless the nominal releases
    analytic_force_low: float
    analytic_force_high: float
    analytic_energy_low: float
    analytic_energy_high: float
    held_probability: float  # Share of the draws that lock or meet a riser [1]
    agrees: bool  # Whether drawn and analytic ends of the energy interval differ by less than a tenth of its width


def release_of(inputs: Inputs) -> tuple[Status, float, float]:
    """Status, F_px [N] and E_v [J] of one step by equations (1) and (2)."""
    tool = Tool(inputs.stiffness, inputs.conversion, 16e-3, 0.08e-6)
    angle = step_angle(inputs.height, inputs.ball_radius, inputs.edge_radius)
    release = release_at(angle, inputs.normal_load, inputs.friction, tool)
    return release.status, release.pull_force, release.vibration_energy


def sensitivities(inputs: Inputs) -> dict[str, tuple[float, float]]:
    """Compute the derivatives of ln F_px and of ln E_v with respect to each input, per unit of the input.

    With ``t = a + atan mu`` and ``p = R + r``: ``d ln F/da = 2 / sin 2t``, ``da/dH = 1 / (p sin a)``,
    ``da/dp = -H / (p^2 sin a)``, ``d atan mu / dmu = 1 / (1 + mu^2)``; ``ln E = 2 ln F - ln k + ln C_v``.

    Examples
    --------
    >>> inputs = Inputs(25e-6, 0.0, 125e-6, 0.15, 1.0, 9.81e3, 0.2)
    >>> f"{sensitivities(inputs)['height'][1] * 1e-6:.3f} per um"
    '0.053 per um'
    """
    status, _, _ = release_of(inputs)
    if status is not Status.RELEASES:
        raise ContactError(f"a step of {inputs.height:g} m that is {status} has no sensitivity")
    radius = inputs.ball_radius + inputs.edge_radius
    angle = float(kernels.angle_on_step(inputs.height, radius))
    per_angle = 2.0 / math.sin(2.0 * (angle + math.atan(inputs.friction)))
    by_height = per_angle / (radius * math.sin(angle))
    by_radius = -by_height * inputs.height / radius
    by_friction = per_angle / (1.0 + inputs.friction**2)
    return {
        "height": (by_height, 2.0 * by_height),
        "edge_radius": (by_radius, 2.0 * by_radius),
        "ball_radius": (by_radius, 2.0 * by_radius),
        "friction": (by_friction, 2.0 * by_friction),
        "normal_load": (1.0 / inputs.normal_load, 2.0 / inputs.normal_load),
        "stiffness": (0.0, -1.0 / inputs.stiffness),
        "conversion": (0.0, 1.0 / inputs.conversion),
    }


def interval_of(
    inputs: Inputs, spread: Spread, *, confidence: float = 0.95, draws: int = 20_000, seed: int = 0
) -> Interval:
    """Predict force and energy of a step with intervals.

    Parameters
    ----------
    inputs : Inputs
        Nominal values.
    spread : Spread
        Standard uncertainties; inputs are drawn from normal distributions, independently, and cut off at 0.
    confidence : float
        Probability of the interval.
    draws : int
        Number of draws; at most 10 million.
    seed : int
        Of the draws: the same seed gives the same interval.

    Returns
    -------
    Interval
        Nominal, drawn and analytic figures.

    Raises
    ------
    ContactError
        If the confidence does not lie between 0 and 1 or the number of draws is out of range.

    References
    ----------
    JCGM 100:2008 (sensitivities) and JCGM 101:2008 (drawing).

    Examples
    --------
    >>> inputs = Inputs(25e-6, 0.0, 125e-6, 0.15, 1.0, 9.81e3, 0.2)
    >>> interval = interval_of(inputs, Spread(height=0.5e-6))
    >>> interval.energy_low < interval.energy < interval.energy_high
    True
    """
    status, force, energy = release_of(inputs)
    forces, energies = _draw(inputs, spread, draws, seed)
    spreads = (0.0, 0.0)
    if status is Status.RELEASES:
        slopes = sensitivities(inputs)
        squares = [sum((slopes[f.name][k] * getattr(spread, f.name)) ** 2 for f in fields(spread)) for k in (0, 1)]
        spreads = (math.sqrt(squares[0]), math.sqrt(squares[1]))
    return assemble_interval(status, force, energy, forces, energies, spreads, confidence)


def assemble_interval(
    status: Status,
    force: float,
    energy: float,
    forces: Floats,
    energies: Floats,
    spreads: tuple[float, float],
    confidence: float,
) -> Interval:
    """Put an interval together from draws and from first-order uncertainties."""
    if not 0.0 < confidence < 1.0:
        raise ContactError(f"confidence must lie between 0 and 1, got {confidence:g}")
    tails = [0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)]
    # the inverse of the empirical distribution, as numpy's "inverted_cdf" has it, for both ends at once
    ends = [max(math.ceil(tail * forces.size) - 1, 0) for tail in tails]
    force_low, force_high = (float(v) for v in np.partition(forces, ends)[ends])
    energy_low, energy_high = (float(v) for v in np.partition(energies, ends)[ends])
    analytic = (math.nan, math.nan, math.nan, math.nan)
    agrees = False
    if status is Status.RELEASES:
        factor = NormalDist().inv_cdf(tails[1])
        analytic = (
            force * math.exp(-factor * spreads[0]),
            force * math.exp(factor * spreads[0]),
            energy * math.exp(-factor * spreads[1]),
            energy * math.exp(factor * spreads[1]),
        )
        width = max(analytic[3] - analytic[2], 1e-12 * energy)
        agrees = max(abs(energy_low - analytic[2]), abs(energy_high - analytic[3])) < 0.1 * width
    held = float(np.isinf(forces).mean())
    return Interval(
        status,
        force,
        energy,
        force_low,
        force_high,
        energy_low,
        energy_high,
        analytic[0],
        analytic[1],
        analytic[2],
        analytic[3],
        held,
        agrees,
    )


@lru_cache(maxsize=4)
def standard_draws(inputs: int, draws: int, seed: int) -> Floats:
    """Draw standard normal numbers, shape (inputs, draws); equal arguments give the same numbers."""
    if not 100 <= draws <= 10_000_000:
        raise ContactError(f"draws must lie between 100 and 10 million, got {draws}")
    numbers = np.random.default_rng(seed).standard_normal((inputs, draws))
    numbers.setflags(write=False)
    return numbers


def _draw(inputs: Inputs, spread: Spread, draws: int, seed: int) -> tuple[Floats, Floats]:
    """Draw forces and energies of random inputs: infinite where the tip is held, 0 where nothing catches."""
    normal = standard_draws(len(fields(spread)), draws, seed)
    drawn = {
        f.name: np.maximum(getattr(inputs, f.name) + getattr(spread, f.name) * normal[k], 0.0)
        for k, f in enumerate(fields(spread))
    }
    radius = drawn["ball_radius"] + drawn["edge_radius"]
    riser = drawn["height"] >= radius
    angle = kernels.angle_on_step(np.where(riser, 0.0, drawn["height"]), np.where(riser, 1.0, radius))
    return kernels.release(
        np.where(riser, 0.5 * math.pi, angle),
        drawn["friction"],
        drawn["normal_load"],
        drawn["stiffness"],
        drawn["conversion"],
    )
