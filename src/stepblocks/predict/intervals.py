"""The 95 % interval of a prediction, from the tolerances of the stimulus and of the setting it is felt in.

A tolerance is taken as a rectangular distribution over its zone (JCGM 100, 4.3.7): half its width over the root of three is the
standard uncertainty, its middle the expectation, which for a one-sided tolerance is not the nominal.
"""

from __future__ import annotations

from collections.abc import Callable

from stepblocks.contact.counterface import Counterface, Margin, Step
from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.contact.uncertainty import Interval, interval_of, rectangular
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.set import PredictionGrid
from stepblocks.parts.tolerance import Dimension

# Directions over a margin, in the order in which its angles come
WAYS = ("tooth-to-crown", "crown-to-tooth")
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
    face = Step(_middle(height), max(_middle(edge_radius), 0.0))
    return _interval(grid, face, ball, {"height": _half(height), "edge_radius": _half(edge_radius)}, False)


def margin_interval(grid: PredictionGrid, margin: MarginBlock | CrownOnTooth, ball: Dimension, backward: bool) -> Felt:
    """Prepare the interval of a margin under one tip in one direction."""
    gap, rise, stated = margin.marginal_gap, margin.horizontal_discrepancy, margin.vertical_discrepancy
    face = Margin(max(_middle(gap), 0.0), _middle(margin.opening), _middle(rise))
    widths = {"gap": _half(gap)} | ({} if stated is None else {"opening": _half(stated)}) | {"rise": _half(rise)}
    return _interval(grid, face, ball, widths, backward)


def _interval(
    grid: PredictionGrid, face: Counterface, ball: Dimension, widths: dict[str, float], backward: bool
) -> Felt:
    off, spec = grid.tolerances, grid.tool
    tool = Tool(spec.stiffness, spec.conversion)

    def felt(friction: float, load: float) -> Interval:
        setting = {
            "ball_radius": _half(ball),
            "friction": off.friction,
            "normal_load": off.normal_load * load,
            "stiffness": off.stiffness * tool.stiffness,
            "conversion": off.conversion * tool.conversion,
        }
        point = OperatingPoint(_middle(ball), load, friction, tool)
        return interval_of(face, point, rectangular(widths | setting), backward=backward, draws=_DRAWS)

    return felt


def _middle(dimension: Dimension) -> float:
    return dimension.nominal + 0.5 * (dimension.upper + dimension.lower)


def _half(dimension: Dimension) -> float:
    return 0.5 * (dimension.upper - dimension.lower)
