"""Force on an explorer dragged across the junction of crown and tooth, over gap and vertical discrepancy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact import kernels
from stepblocks.contact.critical_angle import margin_angles
from stepblocks.contact.domain import require_not_negative
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MarginMap:
    """Forces and energies over a grid of margins, each of shape (gaps, discrepancies)."""

    gap: Floats  # shape (gaps,) [m]
    discrepancy: Floats  # shape (discrepancies,) [m]; positive is a tooth that stands higher than the crown
    crown_to_tooth: Floats  # peak force F_px [N]; 0 where nothing catches, infinite where the tip is held
    tooth_to_crown: Floats
    energy_crown_to_tooth: Floats  # vibration energy E_v [J]; NaN where the tip does not release
    energy_tooth_to_crown: Floats


def margin_map(gap: ArrayLike, discrepancy: ArrayLike, point: OperatingPoint, *, edge_radius: float = 0.0) -> MarginMap:
    """Map the force of an explorer over marginal gap and vertical discrepancy.

    Terms by Holmes et al. (1989), J. Prosthet. Dent. 62, 405. The gap is taken to be deeper than the tip sinks.

    Examples
    --------
    >>> from stepblocks.contact.operating_point import PAPER
    >>> table = margin_map([50e-6], [0.0, 20e-6], PAPER)
    >>> bool(table.crown_to_tooth[0, 0] == table.tooth_to_crown[0, 0])
    True
    """
    gaps, rises = np.atleast_1d(np.asarray(gap, float)), np.atleast_1d(np.asarray(discrepancy, float))
    if gaps.ndim != 1 or rises.ndim != 1 or gaps.size == 0 or rises.size == 0:
        raise ContactError("gap and discrepancy must each be a row of at least one value")
    require_not_negative("edge_radius", edge_radius, "m")
    angles = margin_angles(gaps[:, None] + 2.0 * edge_radius, rises, point.ball_radius + edge_radius)
    tool = point.tool
    found = [
        kernels.release(angle, point.friction, point.normal_load, tool.stiffness, tool.conversion) for angle in angles
    ]
    forces = [force for force, _ in found]
    energies = [np.where(np.isfinite(energy) & (energy > 0.0), energy, np.nan) for _, energy in found]
    return MarginMap(gaps, rises, *forces, *energies)
