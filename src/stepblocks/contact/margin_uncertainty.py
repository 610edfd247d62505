"""Intervals of the force and energy at a crown margin, in both directions, from the uncertainties of its dimensions."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from stepblocks.contact import kernels
from stepblocks.contact.critical_angle import bevelled_margin_angles
from stepblocks.contact.energy import Status, release_at
from stepblocks.contact.operating_point import Tool
from stepblocks.contact.uncertainty import Interval, assemble_interval, standard_draws
from stepblocks.errors import ContactError

Direction = Literal["tooth-to-crown", "crown-to-tooth"]


@dataclass(frozen=True)
class MarginInputs:
    """What a prediction for one crown margin needs."""

    gap: float  # Marginal gap g [m]
    # Vertical marginal discrepancy v, the distance of the corners along the drag [m]; equal to g where the end is
    # square
    opening: float
    rise: float  # Horizontal marginal discrepancy h, the height of the crown over the tooth [m], of either sign
    ball_radius: float  # R [m], mu [1], F_py [N], k [N/m], C_v [1]
    friction: float
    normal_load: float
    stiffness: float
    conversion: float


@dataclass(frozen=True)
class MarginSpread:
    """Standard uncertainties of the same inputs, in their units."""

    gap: float = 0.0  # [m]
    opening: float | None = None  # [m]; None where the end is square, and the opening varies with the gap
    rise: float = 0.0
    ball_radius: float = 0.0
    friction: float = 0.0  # [1]
    normal_load: float = 0.0  # [N]
    stiffness: float = 0.0  # [N/m]
    conversion: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ContactError(f"uncertainty of {field.name} must be finite and not negative, got {value:g}")


def margin_release_of(inputs: MarginInputs, direction: Direction) -> tuple[Status, float, float]:
    """Status, F_px [N] and E_v [J] at a margin."""
    if direction not in ("tooth-to-crown", "crown-to-tooth"):
        raise ContactError(f"direction must be tooth-to-crown or crown-to-tooth, got {direction!r}")
    angles = bevelled_margin_angles(inputs.gap, inputs.opening, inputs.rise, inputs.ball_radius)
    tool = Tool(inputs.stiffness, inputs.conversion, 16e-3, 0.08e-6)
    release = release_at(angles[direction == "crown-to-tooth"], inputs.normal_load, inputs.friction, tool)
    return release.status, release.pull_force, release.vibration_energy


def margin_interval_of(
    inputs: MarginInputs,
    spread: MarginSpread,
    direction: Direction,
    *,
    confidence: float = 0.95,
    draws: int = 20_000,
    seed: int = 0,
) -> Interval:
    """Predict force and energy at a margin with intervals.

    The sensitivities are central differences over a thousandth of each uncertainty. Where a margin stands on a border
    between two kinds of contact they hold to one side only, and the draws say so: the two intervals do not agree.

    Examples
    --------
    >>> margin = MarginInputs(50e-6, 50e-6, 0.0, 125e-6, 0.15, 1.0, 9.81e3, 0.2)
    >>> interval = margin_interval_of(margin, MarginSpread(gap=1e-6), "crown-to-tooth")
    >>> interval.agrees, interval.energy_low < interval.energy < interval.energy_high
    (True, True)
    """
    status, force, energy = margin_release_of(inputs, direction)
    names = [field.name for field in fields(MarginInputs)]
    normal = standard_draws(len(names), draws, seed)
    widths = {name: getattr(spread, name) or 0.0 for name in names}
    drawn = {name: getattr(inputs, name) + widths[name] * normal[k] for k, name in enumerate(names)}
    if spread.opening is None:
        drawn["opening"] = inputs.opening + drawn["gap"] - inputs.gap
    for name in ("gap", "friction", "normal_load", "stiffness", "conversion"):
        drawn[name] = np.maximum(drawn[name], 0.0)
    drawn["ball_radius"] = np.maximum(drawn["ball_radius"], 1e-3 * inputs.ball_radius)
    forces, energies = kernels.release(
        _angles(drawn, direction), drawn["friction"], drawn["normal_load"], drawn["stiffness"], drawn["conversion"]
    )
    spreads = (
        _first_order(inputs, widths, spread.opening is None, direction) if status is Status.RELEASES else (0.0, 0.0)
    )
    return assemble_interval(status, force, energy, forces, energies, spreads, confidence)


def _angles(drawn: dict[str, np.ndarray], direction: Direction) -> np.ndarray:
    gap, opening, rise, ball = (drawn[name] for name in ("gap", "opening", "rise", "ball_radius"))
    way = int(direction == "crown-to-tooth")
    square = kernels.margin_angles(np.maximum(opening, 0.0), rise, ball)[way]
    bevelled = kernels.bevelled_margin_angles(gap, np.maximum(opening, gap), rise, ball)[way]
    return np.asarray(np.where(opening > gap, bevelled, square))


def _first_order(
    inputs: MarginInputs, widths: dict[str, float], square: bool, direction: Direction
) -> tuple[float, float]:
    """Root sum of squares of the changes of ln F and ln E by one standard uncertainty of each input."""
    sums = [0.0, 0.0]
    for name, width in widths.items():
        step = 1e-3 * width
        if step == 0.0:
            continue
        ends = []
        for sign in (1.0, -1.0):
            moved = {
                name: max(getattr(inputs, name) + sign * step, 0.0)
                if name == "gap"
                else getattr(inputs, name) + sign * step
            }
            if name == "gap" and square:
                moved["opening"] = inputs.opening + moved["gap"] - inputs.gap
            status, force, energy = margin_release_of(replace(inputs, **moved), direction)
            ends.append((force, energy) if status is Status.RELEASES else (math.nan, math.nan))
        for k in (0, 1):
            sums[k] += (0.5e3 * math.log(ends[0][k] / ends[1][k])) ** 2
    return math.sqrt(sums[0]), math.sqrt(sums[1])
