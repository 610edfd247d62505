"""The surface that the probe meets, as a profile z(x): the upper envelope of the section across the working edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stepblocks.stimulus.block import StepBlock
from stepblocks.stimulus.margin import MarginBlock

__all__ = ["breakpoints", "surface_height"]

Array = NDArray[np.float64]


def surface_height(stimulus: StepBlock | MarginBlock, x: Array) -> Array:
    """Height of the working surface across the edge.

    Parameters
    ----------
    stimulus : StepBlock or MarginBlock
        The block; its nominal dimensions count.
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
        stimulus.gap_depth.nominal,
    )


def breakpoints(stimulus: StepBlock | MarginBlock) -> tuple[float, ...]:
    """Positions where the profile has a corner, in ascending order.

    Parameters
    ----------
    stimulus : StepBlock or MarginBlock
        The block.

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


def _margin(x: Array, opening: float, gap: float, rise: float, depth: float) -> Array:
    if opening <= 0.0:
        return np.where(x < opening, 0.0, rise)
    z = np.where(x < 0.0, 0.0, -depth)
    if opening > gap:  # a margin bevelled back at 45 degrees can be seen from above
        slope = (rise + gap - opening) + (x - gap)
        z = np.where((x >= gap) & (x < opening), slope, z)
    z = np.where(x >= opening, rise, z)
    return np.where(x == 0.0, np.maximum(z, 0.0), z)
