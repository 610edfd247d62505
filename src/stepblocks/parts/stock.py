"""The stock that a bench block is made from."""

import math

from stepblocks import cad
from stepblocks.parts.body import Block
from stepblocks.parts.revolution import Point3

STOCK = 1e-3  # on every face, sawn or milled [m]
_STOCK_STEP = 0.5e-3  # sizes of stock are whole numbers of it [m]
_ROUNDING = 1e-9  # share of a step by which a size may exceed a whole number of them


def compute_stock_corners(block: Block) -> tuple[Point3, Point3]:
    """Compute lower and upper corner of the stock [m] in the frame of the block."""
    if block.stock is not None:
        x, y, z = block.stock
    else:
        x, y, z = (_choose_stock_size(side) for side in block.sides)
    _, _, height = block.sides
    base = block.body.base - min(STOCK, 0.5 * (z - height))
    return (-0.5 * x, -0.5 * y, base), (0.5 * x, 0.5 * y, base + z)


def _choose_stock_size(block_size: float) -> float:
    """Choose the size of the stock of a side [m], with its allowance on both faces."""
    steps = math.ceil((block_size + 2.0 * STOCK) / _STOCK_STEP - _ROUNDING)
    return steps * _STOCK_STEP


def build_stock_solid(block: Block) -> cad.door.Body:
    """Build the stock as a solid."""
    low, high = compute_stock_corners(block)
    return cad.kernel.make_box(low, high)
