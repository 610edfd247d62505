"""Where a drag catches: critical angles in both directions, local catches, peak forces and locking."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.domain import require_positive
from stepblocks.contact.energy import Release, release_at
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.contact.path.profile import TipPath
from stepblocks.contact.path.profile_kernels import steepest_in_each
from stepblocks.errors import ContactError

Direction = Literal["forward", "backward"]


@dataclass(frozen=True)
class Catch:
    """A place where the path of the tip is steepest in the direction of the drag."""

    position: float  # of the tip's axis [m]
    contact: float  # of the edge that is touched [m]
    angle: float  # slope of the path there [rad]; 0 where it never rises, a right angle where the tip meets a riser
    supported: bool = True  # False where missing data under the tip could hide a higher contact

    def release(self, normal_load: float, friction: float, tool: Tool = PAPER.tool) -> Release:
        """Force and energy by equation (1); locking and too high a step are a status (see `release_at`)."""
        return release_at(self.angle, normal_load, friction, tool)


def steepest(path: TipPath, direction: Direction = "forward") -> Catch:
    """Find the critical angle of a path: its steepest rise towards growing x (forward) or falling x.

    It is exact to rounding and does not depend on the positions of the path.
    """
    slopes = interval_slopes(path, direction, _grid_maximum(path, direction))
    if np.isnan(slopes[:, 0]).all():
        raise ContactError("path has no two neighbouring positions with a surface under the tip")
    return _catch(path, slopes, int(np.nanargmax(slopes[:, 0])))


def catches(path: TipPath, direction: Direction = "forward", *, smallest: float = math.radians(1.0)) -> list[Catch]:
    """Every local catch along a drag, in the order in which it is met; a rise by less than `smallest` [rad] is roughness."""
    from scipy.signal import find_peaks

    require_positive("smallest", smallest, "rad")
    slopes = interval_slopes(path, direction, math.tan(smallest))
    angles = np.arctan(np.nan_to_num(np.maximum(slopes[:, 0], 0.0), nan=0.0, posinf=1e300))
    padded = np.concatenate([[0.0], angles, [0.0]])
    found = find_peaks(padded, prominence=smallest)[0] - 1
    order = found if direction == "forward" else found[::-1]
    return [_catch(path, slopes, int(k)) for k in order]


def _catch(path: TipPath, slopes: NDArray[np.float64], k: int) -> Catch:
    slope, where, contact = slopes[k]
    angle = 0.5 * math.pi if np.isposinf(slope) else math.atan(max(slope, 0.0))
    return Catch(float(where), float(contact), angle, bool(path.supported[k] and path.supported[k + 1]))


def _grid_maximum(path: TipPath, direction: Direction) -> float:
    """Find a slope that the path surely reaches, so that only steeper intervals need be searched."""
    rise = np.diff(path.height) / np.diff(path.position) * (1.0 if direction == "forward" else -1.0)
    finite = rise[np.isfinite(rise)]
    # the mean slope of an interval is never more than its greatest; a little less guards against rounding
    return float(finite.max()) * (1.0 - 1e-9) - 1e-9 if finite.size else 0.0


def interval_slopes(path: TipPath, direction: Direction, floor: float) -> NDArray[np.float64]:
    """Steepest rise between neighbouring positions, where, and the contact there; shape (n - 1, 3)."""
    if direction == "backward":
        slopes = interval_slopes(_mirrored(path), "forward", floor)[::-1].copy()
        slopes[:, 1:] *= -1.0
        return slopes
    if path.position.size < 2:
        raise ContactError("a drag needs a path of at least 2 positions")
    radius = path.tip.radius
    tolerance = max(1e-13 * (2.0 * radius), 4.0 * float(np.spacing(np.abs(path.position).max())))
    found = steepest_in_each(
        path.position, path.height, path.contact, path.element, floor, path.elements, radius, tolerance
    )
    return np.asarray(found)


def _mirrored(path: TipPath) -> TipPath:
    e = path.elements[::-1]
    elements = np.ascontiguousarray(np.column_stack([-e[:, 2], e[:, 3], -e[:, 0], e[:, 1], -e[:, 4]]))
    return replace(
        path,
        position=np.ascontiguousarray(-path.position[::-1]),
        height=np.ascontiguousarray(path.height[::-1]),
        contact=np.ascontiguousarray(-path.contact[::-1]),
        slope=path.slope[::-1],
        supported=path.supported[::-1],
        element=np.where(path.element < 0, -1, len(path.elements) - 1 - path.element)[::-1].copy(),
        elements=elements,
    )
