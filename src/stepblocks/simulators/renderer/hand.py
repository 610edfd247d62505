"""A virtual hand: it drags at a steady speed and keeps the normal load, as the weights and pulleys of the bench do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.simulators.renderer.servo import Renderer

Array = NDArray[np.float64]
_APPROACH = 40e-6  # before the notch, and the least travel behind it, unscaled [m]


@dataclass(frozen=True)
class Drag:
    """One drag over an edge."""

    # shape (n,); Time [s], position of the hand in the direction of the drag [m], spring force and force on the hand
    # [N], both along the drag; the hand pulls against a positive spring force
    time: Array
    hand: Array
    pull: Array
    force: Array
    peak: float  # Largest spring force [N]
    events: int  # Releases that the renderer reported
    crossed: bool  # Whether the proxy left the notch


def drag(
    renderer: Renderer, load: float, travel: float, direction: float = 1.0, speed: float = 1e-3, resolution: float = 0.0
) -> Drag:
    """Drag over the notch of a renderer's path.

    Parameters
    ----------
    renderer : Renderer
        It is reset first.
    load : float
        Normal load that the hand keeps [N].
    travel : float
        How far the hand moves on after it has reached the notch, in the magnified frame [m].
    direction : float
        +1 towards +x, -1 towards -x.
    speed : float
        Speed of the hand in the magnified frame [m/s].
    resolution : float
        Step to which the device rounds the position it reports [m]; 0 rounds nothing.

    Returns
    -------
    Drag
        The record.
    """
    notch, height, _ = renderer.path.notch(direction)
    magnification = renderer.scale
    start = notch - direction * _APPROACH * magnification
    step = direction * speed * renderer.period
    count = int(np.ceil((_APPROACH * magnification + travel) / abs(step)))
    position = np.array([start, 0.0, float(np.interp(start, renderer.path.x, renderer.path.z))])
    renderer.reset(np.array([start, 0.0, float(renderer.path.z.max()) + height]))
    hand, pull, force = np.asarray(direction * renderer.drag(position, step, load, resolution, count), dtype=np.float64)
    crossed = direction * (renderer.proxy[0] - notch) > 1e-9 * magnification
    time = np.asarray(np.arange(count) * renderer.period, dtype=np.float64)
    return Drag(time, hand, pull, force, float(pull.max()), renderer.events, crossed)
