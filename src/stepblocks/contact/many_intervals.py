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
from stepblocks.contact.uncertainty import (
    SMALLEST_BALL,
    draw_standard_normal_inputs,
    find_interval_quantiles,
)

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
    force_limit: float,
    *,
    draws: int,
    seed: int = 0,
) -> IntervalEnds:
    """Estimate the intervals of force and energy of many steps.

    Parameters
    ----------
    inputs, uncertainties : mapping of array, each of shape (rows,)
        Each of `STEP_INPUTS` and its standard uncertainty [SI], inside the domain of the equations.
    force_limit : float
        Force beyond which a tip is held [N].
    draws, seed : int
        As `estimate_interval` takes them.
    """
    standard = draw_standard_normal_inputs(len(STEP_INPUTS), draws, seed)
    normal = dict(zip(STEP_INPUTS, standard, strict=True))
    count = len(inputs["height"])
    ends = np.empty((5, count))
    for rows in _iterate_row_chunks(count, draws):
        drawn = {}
        for name in STEP_INPUTS:
            drawn[name] = _draw_input(inputs[name][rows], uncertainties[name][rows], normal[name])
        nominal_ball = inputs["ball_radius"][rows, None]
        ends[:, rows] = _compute_interval_ends(drawn, nominal_ball, force_limit, draws)
    return IntervalEnds(*ends)


def _iterate_row_chunks(row_count: int, draws: int) -> Iterator[slice]:
    """Yield rows whose draws fit into memory."""
    step = max(_MOST_NUMBERS // draws, 1)
    for first in range(0, row_count, step):
        yield slice(first, min(first + step, row_count))


def _draw_input(nominal: Array, uncertainty: Array, standard_normal: Array) -> Array:
    """Draw an input, shape (rows, draws), or (rows, 1) where it is known; cut off at 0."""
    if not uncertainty.any():
        return nominal[:, None]
    return np.maximum(nominal[:, None] + uncertainty[:, None] * standard_normal, 0.0)


def _compute_interval_ends(
    drawn_inputs: Mapping[str, Array], nominal_ball: Array, force_limit: float, draws: int
) -> tuple[Array, ...]:
    """Find the ends of both intervals and the share that is held, each of shape (rows,)."""
    ball = np.maximum(drawn_inputs["ball_radius"], SMALLEST_BALL * nominal_ball)
    dimensions: dict[str, Real] = {
        "height": drawn_inputs["height"],
        "edge_radius": drawn_inputs["edge_radius"],
    }
    angle = _ANY_STEP.angles(ball, **dimensions).forward
    force, energy = kernels.compute_release_force_and_energy(
        angle,
        drawn_inputs["friction"],
        drawn_inputs["normal_load"],
        drawn_inputs["stiffness"],
        drawn_inputs["conversion"],
    )
    shape = (len(energy), draws)
    force = np.broadcast_to(force, shape)
    is_held = force > force_limit
    force_ends = find_interval_quantiles(np.where(is_held, np.inf, force), draws)
    energy_ends = find_interval_quantiles(np.where(is_held, np.inf, energy), draws)
    return (*force_ends, *energy_ends, is_held.mean(axis=1))
