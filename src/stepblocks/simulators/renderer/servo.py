"""The reference renderer: what experiment 2 of the paper needs, for any device that reports a position and takes a force."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.errors import HapticsError
from stepblocks.simulators.renderer import kernel

Array = NDArray[np.float64]


def require_settings(scale: float, rate: float, damping: float) -> None:
    """Refuse a magnification [1] or rate [Hz] that is not positive, or a damping [N s/m] below 0."""
    for name, value in (("scale", scale), ("rate", rate)):
        if not (math.isfinite(value) and value > 0.0):
            raise HapticsError(f"{name} must be positive and finite, got {value:g}")
    if not (math.isfinite(damping) and damping >= 0.0):
        raise HapticsError(f"damping must be finite and not negative, got {damping:g} N s/m")


class Renderer:
    """A proxy on the path of the ball's centre, pulled by the hand through the spring of the tool.

    Magnifying the path by S and dividing the spring by S leaves every force as it was; the ring is computed from the
    force at release and therefore carries the energy of the unscaled tool at any S.

    Examples
    --------
    >>> import numpy as np
    >>> from stepblocks.contact.path.centre import corner_path
    >>> flat = corner_path([(-1e-3, 0.0), (1e-3, 0.0)], 125e-6)
    >>> renderer = Renderer(flat, OperatingPoint(125e-6, 1.0, 0.15))
    >>> renderer.reset(np.array([0.0, 0.0, 2e-4]))
    >>> float(np.round(renderer.tick(np.array([0.0, 0.0, 115e-6]), np.zeros(3))[2], 4))
    0.0981
    """

    def __init__(
        self,
        path: CentrePath,
        condition: OperatingPoint,
        scale: float = 1.0,
        rate: float = 10e3,
        event: bool = True,
        wall: float | None = None,
        damping: float = 0.0,
    ) -> None:
        require_settings(scale, rate, damping)
        self.path, self.scale = path.scaled(scale), scale
        self.stiffness = condition.tool.stiffness / scale
        self.wall = self.stiffness if wall is None else wall
        self.period = 1.0 / rate
        ring = math.sqrt(condition.tool.conversion) if event else 0.0
        self.force: Array = np.zeros(3)
        self._state: Array = np.zeros(len(kernel.STATE))
        self._parameters: Array = np.array(
            [
                self.stiffness,
                self.wall,
                condition.friction,
                damping,
                self.period,
                ring,
                math.tau * condition.tool.frequency,
                condition.tool.decay_time,
            ]
        )
        before = np.concatenate([self.path.slope_start[:1], self.path.slope_end])
        after = np.concatenate([self.path.slope_start, self.path.slope_end[-1:]])
        notch = after - before > 1e-3  # a kink of the path, not the chords of a circle
        self._up: NDArray[np.bool_] = notch & (after > 1e-3)
        self._down: NDArray[np.bool_] = notch & (before < -1e-3)
        self.reset(np.array([self.path.x[0], 0.0, float(self.path.z.max()) + 1.0]))

    def reset(self, position: Array) -> None:
        """Put the proxy where the hand is, free."""
        x = float(np.clip(position[0], self.path.x[0], self.path.x[-1]))
        piece = int(np.clip(np.searchsorted(self.path.x, x, side="right") - 1, 0, len(self.path.x) - 2))
        self._state[:] = 0.0
        self._state[0], self._state[1], self._state[2] = x, position[1], piece
        self._state[5], self._state[9] = -1.0, position[2]
        self.force[:] = 0.0

    def tick(self, position: Array, velocity: Array) -> Array:
        """Render one servo tick."""
        path = self.path
        kernel.tick(
            position,
            velocity,
            self.force,
            self._state,
            self._parameters,
            path.x,
            path.z,
            path.slope_start,
            path.slope_end,
            self._up,
            self._down,
        )
        return self.force

    def drag(self, start: Array, step: float, load: float, resolution: float, count: int) -> Array:
        """Render many ticks under a virtual hand, see `stepblocks.simulators.renderer.hand.drag`.

        Parameters
        ----------
        start : ndarray, shape (3,)
            First position of the hand [m].
        step : float
            Its advance along x per tick [m].
        load : float
            Normal load that it keeps [N].
        resolution : float
            Step to which positions are rounded [m]; 0 rounds nothing.
        count : int
            Ticks.

        Returns
        -------
        ndarray, shape (3, count)
            Position of the hand along x [m], spring force and force on the hand along x [N].
        """
        path, record = self.path, np.zeros((3, count))
        kernel.drag(
            record,
            start,
            step,
            load,
            resolution,
            self.force,
            self._state,
            self._parameters,
            path.x,
            path.z,
            path.slope_start,
            path.slope_end,
            self._up,
            self._down,
        )
        return record

    @property
    def proxy(self) -> tuple[float, float]:
        """Where the proxy is across and along the edge [m]."""
        return float(self._state[0]), float(self._state[1])

    @property
    def pull(self) -> float:
        """Force in the tool's spring, without the ring [N]; positive where the hand pulls towards +x."""
        return float(self._state[4])

    @property
    def events(self) -> int:
        """How many releases there were since the last reset."""
        return int(self._state[7])

    @property
    def release_force(self) -> float:
        """Spring force at the last release [N]; 0 before the first."""
        return float(self._state[8])
