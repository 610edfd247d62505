"""The surface that the probe meets, as a profile z(x): the upper envelope of the section across the working edge.

Of a crown on its tooth, x runs along the path of draw and z outwards from the tooth's outer surface, as in `margin`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stepblocks.stimulus.block import StepBlock
from stepblocks.stimulus.margin import CrownOnTooth, MarginBlock

__all__ = ["breakpoints", "surface_height"]

Array = NDArray[np.float64]


def surface_height(stimulus: StepBlock | MarginBlock | CrownOnTooth, x: Array) -> Array:
    """Height of the working surface across the edge.

    Parameters
    ----------
    stimulus : StepBlock, MarginBlock or CrownOnTooth
        The block or crown; its nominal dimensions count.
    x : ndarray, shape (n,)
        Positions across the edge, from the lower to the upper side [m].

    Returns
    -------
    ndarray, shape (n,)
        Heights over the lower working face, or over the tooth [m]. On an edge itself the higher side counts.

    Examples
    --------
    A step of 50 um with a sharp edge is 0 before the edge and 50 um from the edge on; see the tests.
    """
    if isinstance(stimulus, StepBlock):
        return _step(x, stimulus.height.nominal, stimulus.edge_radius.nominal)
    return _margin(
        x,
        stimulus.opening.nominal,
        stimulus.marginal_gap.nominal,
        stimulus.horizontal_discrepancy.nominal,
        *_floor(stimulus),
    )


def _floor(margin: MarginBlock | CrownOnTooth) -> tuple[float, float]:
    """Depth of the gap where it begins [m], and how steeply it falls from there [1]."""
    if isinstance(margin, MarginBlock):
        return margin.gap_depth.nominal, 0.0
    return margin.finish_line.width.nominal, math.tan(margin.taper.nominal)


def breakpoints(stimulus: StepBlock | MarginBlock | CrownOnTooth) -> tuple[float, ...]:
    """Positions where the profile has a corner, in ascending order.

    Parameters
    ----------
    stimulus : StepBlock, MarginBlock or CrownOnTooth
        The block or crown.

    Returns
    -------
    tuple of float
        Positions across the edge [m].
    """
    if isinstance(stimulus, StepBlock):
        return (0.0, stimulus.edge_radius.nominal) if stimulus.edge_radius.nominal > 0.0 else (0.0,)
    return tuple(sorted({0.0, stimulus.marginal_gap.nominal, stimulus.opening.nominal}))


def _step(x: Array, height: float, radius: float) -> Array:
    across = np.clip(radius - x, 0.0, radius)  # from the centre of the rounding back towards the riser
    rounded = height - radius + np.sqrt(radius * radius - across * across)
    return np.where(x < 0.0, 0.0, rounded)


def _margin(x: Array, opening: float, gap: float, rise: float, depth: float, fall: float) -> Array:
    if opening <= 0.0:
        return np.where(x < opening, 0.0, rise)
    z = np.where(x < 0.0, 0.0, -depth - fall * x)
    if opening > gap:  # a margin bevelled back at 45 degrees can be seen from above
        slope = (rise + gap - opening) + (x - gap)
        z = np.where((x >= gap) & (x < opening), slope, z)
    z = np.where(x >= opening, rise, z)
    return np.where(x == 0.0, np.maximum(z, 0.0), z)
