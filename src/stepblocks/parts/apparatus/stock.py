"""The stock that a part of the apparatus is made from: a piece of plate or bar, or of round bar."""

import math

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.solids import Box, Cylinder

_ALLOWANCE = 1e-3  # on every face, sawn or milled [m]
_STEP = 0.5e-3  # sizes of stock are whole numbers of it [m]
_ROUNDING = 1e-9  # share of a step by which a size may exceed a whole number of them


def choose_stock_solid(component: Component) -> Box | Cylinder:
    """Choose the stock around a component, in its frame [m].

    What is made of rods alone along one axis is turned from round bar.
    """
    if not component.is_turned:
        return _choose_plate_box(component.bounding_box)
    rods = component.rods
    widest = max(rods, key=lambda rod: rod.diameter)
    along = widest.axis_index
    low, high = component.bounding_box.low[along], component.bounding_box.high[along]
    length = _round_up_to_stock_step(high - low + 2.0 * _ALLOWANCE)
    start = list(widest.start)
    start[along] = 0.5 * (low + high - length)
    x, y, z = start
    diameter = _round_up_to_stock_step(widest.diameter + 2.0 * _ALLOWANCE)
    return Cylinder(widest.axis, (x, y, z), diameter, length)


def _choose_plate_box(component_box: Box) -> Box:
    """Choose a piece of plate or bar around a box [m]."""
    low = []
    high = []
    for near, far in zip(component_box.low, component_box.high, strict=True):
        size = _round_up_to_stock_step(far - near + 2.0 * _ALLOWANCE)
        middle = 0.5 * (near + far)
        low.append(middle - 0.5 * size)
        high.append(middle + 0.5 * size)
    return Box((low[0], low[1], low[2]), (high[0], high[1], high[2]))


def _round_up_to_stock_step(size: float) -> float:
    """Round a size up to a whole number of steps [m]."""
    return math.ceil(size / _STEP - _ROUNDING) * _STEP
