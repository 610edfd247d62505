"""Intervals of many steps at once, by the draws of `estimate_interval`.

Every row meets the same random numbers: its interval depends on the row alone, and rows that are
alike have intervals that are alike.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from stepblocks.contact import Array, kernels
from stepblocks.contact.counterface import Step
from stepblocks.contact.domain import Real
from stepblocks.contact.uncertainty import SMALLEST_BALL, draw_standard_normal, find_quantiles

# what force and energy of a step depend on, in the order of its draws
STEP_INPUTS = (
    "height",
    "edge_radius",
    "ball_radius",
    "friction",
    "normal_load",
    "stiffness",
    "conversion",
)
_MOST_NUMBERS = 500_000  # that one array of draws holds
_ANY_STEP = Step(1e-5)  # whose dimensions are given anew


@dataclass(frozen=True)
class IntervalEnds:
    """Ends of intervals of 95 %, each of shape (rows,).

    Attributes
    ----------
    force_low, force_high : array
        Quantiles of F_px [N]; infinite where that share of the draws is held, 0 where it does not
        catch.
    energy_low, energy_high : array
        Quantiles of E_v [J], likewise.
    held_probability : array
        Share of the draws that lock, meet a riser or take more than the limit [1].
    """

    force_low: Array
    force_high: Array
    energy_low: Array
    energy_high: Array
    held_probability: Array


def estimate_step_intervals(
    inputs: Mapping[str, Array],
    uncertainties: Mapping[str, Array],
    limit: float,
    *,
    draws: int,
    seed: int = 0,
) -> IntervalEnds:
    """Estimate the intervals of force and energy of many steps.

    Parameters
    ----------
    inputs, uncertainties : mapping of array, each of shape (rows,)
        Each of `STEP_INPUTS` and its standard uncertainty [SI], inside the domain of the equations.
    limit : float
        Force beyond which a tip is held [N].
    draws, seed : int
        As `estimate_interval` takes them.
    """
    standard = draw_standard_normal(len(STEP_INPUTS), draws, seed)
    normal = dict(zip(STEP_INPUTS, standard, strict=True))
    count = len(inputs["height"])
    ends = np.empty((5, count))
    for rows in _divide_rows(count, draws):
        drawn = {}
        for name in STEP_INPUTS:
            drawn[name] = _draw_input(inputs[name][rows], uncertainties[name][rows], normal[name])
        nominal_ball = inputs["ball_radius"][rows, None]
        ends[:, rows] = _find_interval_ends(drawn, nominal_ball, limit, draws)
    return IntervalEnds(*ends)


def _divide_rows(count: int, draws: int) -> Iterator[slice]:
    """Yield rows whose draws fit into memory."""
    step = max(_MOST_NUMBERS // draws, 1)
    for first in range(0, count, step):
        yield slice(first, min(first + step, count))


def _draw_input(nominal: Array, uncertainty: Array, normal: Array) -> Array:
    """Draw an input, shape (rows, draws), or (rows, 1) where it is known; cut off at 0."""
    if not uncertainty.any():
        return nominal[:, None]
    return np.maximum(nominal[:, None] + uncertainty[:, None] * normal, 0.0)


def _find_interval_ends(
    drawn: Mapping[str, Array], nominal_ball: Array, limit: float, draws: int
) -> tuple[Array, ...]:
    """Find the ends of both intervals and the share that is held, each of shape (rows,)."""
    ball = np.maximum(drawn["ball_radius"], SMALLEST_BALL * nominal_ball)
    dimensions: dict[str, Real] = {
        "height": drawn["height"],
        "edge_radius": drawn["edge_radius"],
    }
    angle = _ANY_STEP.angles(ball, **dimensions).forward
    force, energy = kernels.compute_force_and_energy(
        angle,
        drawn["friction"],
        drawn["normal_load"],
        drawn["stiffness"],
        drawn["conversion"],
    )
    shape = (len(energy), draws)
    force = np.broadcast_to(force, shape)
    is_held = force > limit
    force_ends = find_quantiles(np.where(is_held, np.inf, force), draws)
    energy_ends = find_quantiles(np.where(is_held, np.inf, energy), draws)
    return (*force_ends, *energy_ends, is_held.mean(axis=1))
