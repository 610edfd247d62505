"""The 95 % interval of a prediction, from the tolerances of the stimulus and of the setting it is felt in.

A tolerance is taken as a rectangular distribution over its zone (JCGM 100, 4.3.7): half its width over the root of three is the
standard uncertainty, its middle the expectation, which for a one-sided tolerance is not the nominal.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from stepblocks.contact.margin_uncertainty import Direction, MarginInputs, MarginSpread, margin_interval_of
from stepblocks.contact.uncertainty import Inputs, Interval, Spread, interval_of
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.set import PredictionGrid
from stepblocks.parts.tolerance import Dimension

# Directions over a margin, in the order in which its angles come
WAYS: tuple[Direction, Direction] = ("tooth-to-crown", "crown-to-tooth")
_DRAWS = 2000  # Draws of each interval: its ends scatter by 2 % of its width, and a thousand blocks still take seconds

Felt = Callable[[float, float], Interval]


def known(value: float) -> Dimension:
    """Return a dimension without a tolerance [m]."""
    return Dimension(value, 0.0, 0.0)


def ball_of(grid: PredictionGrid, radius: float) -> Dimension:
    """Return a tip of the setting with its tolerance [m]."""
    width = grid.tolerances.tip_radius
    return Dimension(radius, width, -width)


def step_interval(grid: PredictionGrid, height: Dimension, edge_radius: Dimension, ball: Dimension) -> Felt:
    """Prepare the interval of a step under one tip."""
    off, tool = grid.tolerances, grid.tool

    def felt(friction: float, load: float) -> Interval:
        inputs = Inputs(
            _middle(height),
            max(_middle(edge_radius), 0.0),
            _middle(ball),
            friction,
            load,
            tool.stiffness,
            tool.conversion,
        )
        spread = Spread.of_tolerances(
            height=_half(height),
            edge_radius=_half(edge_radius),
            ball_radius=_half(ball),
            friction=off.friction,
            normal_load=off.normal_load * load,
            stiffness=off.stiffness * tool.stiffness,
            conversion=off.conversion * tool.conversion,
        )
        return interval_of(inputs, spread, draws=_DRAWS)

    return felt


def margin_interval(grid: PredictionGrid, margin: MarginBlock | CrownOnTooth, ball: Dimension, way: Direction) -> Felt:
    """Prepare the interval of a margin under one tip in one direction."""
    off, tool = grid.tolerances, grid.tool
    gap, rise, stated = margin.marginal_gap, margin.horizontal_discrepancy, margin.vertical_discrepancy
    root = math.sqrt(3.0)

    def felt(friction: float, load: float) -> Interval:
        inputs = MarginInputs(
            max(_middle(gap), 0.0),
            _middle(margin.opening),
            _middle(rise),
            _middle(ball),
            friction,
            load,
            tool.stiffness,
            tool.conversion,
        )
        spread = MarginSpread(
            _half(gap) / root,
            None if stated is None else _half(stated) / root,
            _half(rise) / root,
            _half(ball) / root,
            off.friction / root,
            off.normal_load * load / root,
            off.stiffness * tool.stiffness / root,
            off.conversion * tool.conversion / root,
        )
        return margin_interval_of(inputs, spread, way, draws=_DRAWS)

    return felt


def _middle(dimension: Dimension) -> float:
    return dimension.nominal + 0.5 * (dimension.upper + dimension.lower)


def _half(dimension: Dimension) -> float:
    return 0.5 * (dimension.upper - dimension.lower)
