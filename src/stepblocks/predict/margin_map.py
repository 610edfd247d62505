"""Force on an explorer dragged across the junction of crown and tooth, over gap and vertical discrepancy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact.critical_angle import margin_angles
from stepblocks.contact.energy import Status, release_at
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MarginMap:
    """Forces and energies over a grid of margins; the first axis is the gap, the second the discrepancy."""

    gap: Floats  # The grid [m]. A positive discrepancy is a tooth that stands higher than the crown
    discrepancy: Floats
    # shape (gaps, discrepancies); Peak force F_px [N] of each direction; 0 where nothing catches, infinite where the
    # tip is held
    crown_to_tooth: Floats
    tooth_to_crown: Floats
    energy_crown_to_tooth: Floats  # Vibration energy E_v [J]; NaN where the tip does not release
    energy_tooth_to_crown: Floats


def margin_map(
    gap: ArrayLike,
    discrepancy: ArrayLike,
    ball_radius: float,
    normal_load: float,
    friction: float,
    *,
    edge_radius: float = 0.0,
    tool: Tool = PAPER.tool,
) -> MarginMap:
    """Map the force of an explorer over marginal gap and vertical discrepancy.

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
