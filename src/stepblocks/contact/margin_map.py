"""Force on an explorer dragged across the junction of crown and tooth, over gap and vertical discrepancy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact.critical_angle import margin_angles
from stepblocks.contact.energy import PAPER_TOOL, Status, Tool, release_at
from stepblocks.errors import ContactError

__all__ = ["MarginMap", "margin_map"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MarginMap:
    """Forces and energies over a grid of margins; the first axis is the gap, the second the discrepancy.

    Attributes
    ----------
    gap, discrepancy : ndarray
        The grid [m]. A positive discrepancy is a tooth that stands higher than the crown.
    crown_to_tooth, tooth_to_crown : ndarray, shape (gaps, discrepancies)
        Peak force F_px [N] of each direction; 0 where nothing catches, infinite where the tip is held.
    energy_crown_to_tooth, energy_tooth_to_crown : ndarray
        Vibration energy E_v [J]; NaN where the tip does not release.
    """

    gap: Floats
    discrepancy: Floats
    crown_to_tooth: Floats
    tooth_to_crown: Floats
    energy_crown_to_tooth: Floats
    energy_tooth_to_crown: Floats


def margin_map(
    gap: ArrayLike,
    discrepancy: ArrayLike,
    ball_radius: float,
    normal_load: float,
    friction: float,
    *,
    edge_radius: float = 0.0,
    tool: Tool = PAPER_TOOL,
) -> MarginMap:
    """Map the force of an explorer over marginal gap and vertical discrepancy.

    Parameters
    ----------
    gap : array_like, shape (n,)
        Opening between the two edges [m], not negative.
    discrepancy : array_like, shape (m,)
        Height of the tooth over the crown at the margin [m], of either sign.
    ball_radius : float
        Radius of the explorer's tip R [m].
    normal_load : float
        F_py [N].
    friction : float
        mu [1].
    edge_radius : float
        Radius r of both edges [m]; the ball then rolls over their centres with R + r, ``2 r`` farther apart.
    tool : Tool
        Spring and ring.

    Returns
    -------
    MarginMap
        Peak force and energy of both directions.

    Raises
    ------
    ContactError
        As `margin_angles` and `release_at`, or if an axis is empty or the edge radius negative.

    Notes
    -----
    Terms by Holmes et al. (1989), J. Prosthet. Dent. 62, 405. The gap is taken to be deeper than the tip sinks.

    Examples
    --------
    >>> table = margin_map([50e-6], [0.0, 20e-6], 125e-6, 1.0, 0.15)
    >>> bool(table.crown_to_tooth[0, 0] == table.tooth_to_crown[0, 0])
    True
    """
    gaps, rises = np.atleast_1d(np.asarray(gap, float)), np.atleast_1d(np.asarray(discrepancy, float))
    if gaps.ndim != 1 or rises.ndim != 1 or gaps.size == 0 or rises.size == 0:
        raise ContactError("gap and discrepancy must each be a row of at least one value")
    if not (math.isfinite(edge_radius) and edge_radius >= 0.0):
        raise ContactError(f"edge_radius must be finite and not negative, got {edge_radius:g} m")
    force, energy = np.empty((2, gaps.size, rises.size)), np.empty((2, gaps.size, rises.size))
    for i, opening in enumerate(gaps):
        for j, rise in enumerate(rises):
            angles = margin_angles(float(opening) + 2.0 * edge_radius, float(rise), ball_radius + edge_radius)
            for way, angle in enumerate(angles):
                release = release_at(angle, normal_load, friction, tool)
                held = release.status in (Status.LOCKED, Status.TOO_HIGH)
                caught = math.inf if held else 0.0
                force[way, i, j] = release.pull_force if release.status is Status.RELEASES else caught
                energy[way, i, j] = release.vibration_energy
    return MarginMap(gaps, rises, force[0], force[1], energy[0], energy[1])
