"""The 95 % interval of a prediction, from the tolerances of the stimulus and of the setting it is felt in.

A tolerance is taken as a rectangular distribution over its zone (JCGM 100, 4.3.7): half its width over the root of three is the
standard uncertainty, its middle the expectation, which for a one-sided tolerance is not the nominal.
"""

from __future__ import annotations

from collections.abc import Callable

from stepblocks.contact.operating_point import OperatingPoint, Tool
from stepblocks.contact.uncertainty import Interval, interval_of, rectangular
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import Dimension

_DRAWS = 2000  # Draws of each interval: its ends scatter by 2 % of its width, and a thousand blocks still take seconds

Felt = Callable[[float, float], Interval]


def ball_of(grid: PredictionGrid, radius: float) -> Dimension:
    """Return a tip of the setting with its tolerance [m]."""
    width = grid.tolerances.tip_radius
    return Dimension(radius, width, -width)


def interval_over(grid: PredictionGrid, part: Part, step_height: float | None, ball: Dimension, backward: bool) -> Felt:
    """Prepare the interval of a part under one tip in one direction; what is held or worn is felt at a step [m]."""
    off, spec = grid.tolerances, grid.tool
    tool = Tool(spec.stiffness, spec.conversion)
    face = (
        part.sized(**{name: _middle(one) for name, one in part.sizes.items()})
        if part.crossed
        else part.counterface(step_height)
    )
    # a profile without a closed form is taken as known; its corners still stand beside the interval
    widths = {name: _half(one) for name, one in part.sizes.items() if name in face.dimensions}

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
