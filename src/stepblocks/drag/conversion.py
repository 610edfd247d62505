"""How much of the stored energy rings: the time-domain answer to the paper's constant C_v = 20 %.

What the spring gives up is spent on lifting the load over the edge, on friction during the slip and in every swing
after it, on the contact and on damping; only the rest rings. `RingConversion` tabulates that share by simulation and
offers it in place of the constant. The constant stays the default everywhere else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepblocks.contact.energy import Status
from stepblocks.drag.model import DragSettings, Probe
from stepblocks.drag.ring import ring_of
from stepblocks.drag.simulate import drag
from stepblocks.drag.track import step_track
from stepblocks.errors import ContactError

Floats = NDArray[np.float64]
_MOST_DRAGS = 100_000


@dataclass(frozen=True)
class RingConversion:
    """Share of the stored energy that rings, over a grid."""

    heights: Floats  # Axes: H [m], F_py [N], mu [1], handle speed [m/s]
    loads: Floats
    frictions: Floats
    speeds: Floats
    # shape (heights, loads, frictions, speeds); E_v over ``F^2 / 2k`` with the simulated peak force F; NaN where the
    # tip does not release
    share: Floats
    peak_force: Floats  # Simulated peak force [N], of the same shape
    ring_time: Floats  # Time until the ring stays below 5 % of its first swing [s]

    def at(self, height: float, load: float, friction: float, speed: float) -> float:
        """Interpolate the share [1] linearly; NaN outside the grid and beside a cell that does not release."""
        from scipy.interpolate import interpn

        axes = (self.heights, self.loads, self.frictions, self.speeds)
        used = [k for k, axis in enumerate(axes) if axis.size > 1]
        point = np.array([height, load, friction, speed])
        for k, axis in enumerate(axes):
            if not axis[0] <= point[k] <= axis[-1]:
                return float("nan")
        if not used:
            return float(self.share.ravel()[0])
        table = self.share.reshape([axes[k].size for k in used])
        return float(interpn([axes[k] for k in used], table, point[used])[0])


def snap_load(angle: float, friction: float, stiffness: float, radius_sum: float) -> float:
    """Find the load above which the tip snaps over an edge at all; below it, it climbs over without a release.

    Examples
    --------
    >>> from stepblocks.contact.critical_angle import step_angle
    >>> f"{snap_load(step_angle(25e-6, 125e-6), 0.15, 9.81e3, 125e-6):.2f} N"
    '0.48 N'
    """
    total = angle + math.atan(friction)
    if not 0.0 <= total < 0.5 * math.pi:
        raise ContactError(f"a tip that is held has no snap load (a + atan mu = {math.degrees(total):g} deg)")
    return stiffness * radius_sum * math.cos(angle) * math.cos(total) ** 2


def conversion_map(
    probe: Probe,
    ball_radius: float,
    heights: ArrayLike,
    loads: ArrayLike,
    frictions: ArrayLike,
    speeds: ArrayLike,
    edge_radius: float = 0.0,
) -> RingConversion:
    """Simulate one drag for each point of a grid of steps and settings.

    Parameters
    ----------
    probe : Probe
        Masses, springs and contact.
    ball_radius, edge_radius : float
        R and r [m].
    heights, loads, frictions, speeds : array_like
        Increasing axes [m], [N], [1], [m/s].

    Returns
    -------
    RingConversion
        Shares, peak forces and ring times.

    Raises
    ------
    ContactError
        If an axis does not increase, or if the grid has more than 100 000 points.
    """
    axes = [np.atleast_1d(np.asarray(a, dtype=np.float64)) for a in (heights, loads, frictions, speeds)]
    for name, axis in zip(("heights", "loads", "frictions", "speeds"), axes, strict=True):
        if axis.ndim != 1 or axis.size == 0 or (np.diff(axis) <= 0.0).any():
            raise ContactError(f"{name} must be a row of increasing values")
    shape = tuple(axis.size for axis in axes)
    if np.prod(shape) > _MOST_DRAGS:
        raise ContactError(f"grid has {int(np.prod(shape))} drags, more than {_MOST_DRAGS}; use a sweep")
    share, force, time = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    for h, height in enumerate(axes[0]):
        if height >= ball_radius + edge_radius:
            continue
        track = step_track(float(height), ball_radius, edge_radius)
        for i, j, k in product(*(range(n) for n in shape[1:])):
            settings = DragSettings(float(axes[1][i]), float(axes[2][j]), speed=float(axes[3][k]))
            trace = drag(track, probe, settings)
            if trace.status is Status.RELEASES:
                ring = ring_of(trace, spectra=False)
                share[h, i, j, k], force[h, i, j, k] = ring.share, trace.peak_force
                time[h, i, j, k] = ring.duration
    return RingConversion(axes[0], axes[1], axes[2], axes[3], share, force, time)
