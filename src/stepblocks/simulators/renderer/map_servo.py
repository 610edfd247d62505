"""The reference renderer over a height map: any surface, any direction of drag, friction without preferred axes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import HapticsError
from stepblocks.simulators.renderer import map_kernel
from stepblocks.simulators.renderer.height_map import HeightMap
from stepblocks.simulators.renderer.map_contact import CONTACT, locate
from stepblocks.simulators.renderer.servo import require_settings

Array = NDArray[np.float64]
_CATCH = math.cos(0.02)  # a smaller turn between two contacts is a curved surface, not a notch


class MapRenderer:
    """A ball on a height map, held by a cone of friction, pulled by the hand through the spring of the tool.

    Examples
    --------
    >>> import numpy as np
    >>> from stepblocks.simulators.renderer.height_map import height_map
    >>> flat = height_map(np.zeros((40, 40)), (5e-6, 5e-6), 60e-6)
    >>> renderer = MapRenderer(flat, OperatingPoint(60e-6, 1.0, 0.15))
    >>> renderer.reset(np.array([1e-4, 1e-4, 1e-3]))
    >>> float(np.round(renderer.tick(np.array([1e-4, 1e-4, 50e-6]), np.zeros(3))[2], 4))
    0.0981
    """

    def __init__(
        self,
        surface: HeightMap,
        condition: OperatingPoint,
        scale: float = 1.0,
        rate: float = 10e3,
        event: bool = True,
        wall: float | None = None,
        damping: float = 0.0,
    ) -> None:
        require_settings(scale, rate, damping)
        if abs(surface.ball_radius / condition.ball_radius - 1.0) > 1e-9:
            raise HapticsError(
                f"ball_radius of the map must be the condition's ({condition.ball_radius:g} m), got {surface.ball_radius:g} m"
            )
        self.scale, self.stiffness = scale, condition.tool.stiffness / scale
        self.wall = self.stiffness if wall is None else wall
        self.period = 1.0 / rate
        self.force: Array = np.zeros(3)
        self._z, self._touched, self._radius = surface.heights * scale, surface.touched, surface.ball_radius * scale
        self._clear = surface.clear
        self._grid = np.array([*surface.origin, *surface.spacing, 1.0]) * scale
        self._state: Array = np.zeros(len(map_kernel.STATE))
        self._work: Array = np.zeros((2 * CONTACT + 2, 5))
        stride = scale * min(2.0 * min(surface.spacing), 0.03 * surface.ball_radius)
        self._parameters: Array = np.array(
            [
                self.stiffness,
                self.wall,
                condition.friction,
                damping,
                self.period,
                math.sqrt(condition.tool.conversion) if event else 0.0,
                math.tau * condition.tool.frequency,
                condition.tool.decay_time,
                stride,
                _CATCH,
            ]
        )
        self.reset(np.array([self._grid[0], self._grid[1], 1.0]))

    def reset(self, position: Array) -> None:
        """Put the proxy where the hand is, free."""
        self._state[:] = 0.0
        self._state[:3] = position
        self._state[6] = -1.0
        self.force[:] = 0.0

    def tick(self, position: Array, velocity: Array) -> Array:
        """Render one servo tick."""
        map_kernel.tick(
            position,
            velocity,
            self.force,
            self._state,
            self._parameters,
            self._z,
            self._touched,
            self._clear,
            self._grid,
            self._radius,
            self._work,
        )
        return self.force

    def height(self, x: float, y: float) -> float:
        """Height of the ball's centre at rest over a place [m]; minus infinity over nothing."""
        count = locate(x, y, self._z, self._touched, self._grid, self._radius, self._work[:CONTACT])
        return float(self._work[0, 3]) if count else -math.inf

    def drag(self, start: Array, step: tuple[float, float], load: float, resolution: float, count: int) -> Array:
        """Render many ticks under a virtual hand, see `drag_over_map`; rows: hand, spring and force, each in x and y."""
        record = np.zeros((6, count))
        map_kernel.drag(
            record,
            start,
            step[0],
            step[1],
            load,
            resolution,
            self.force,
            self._state,
            self._parameters,
            self._z,
            self._touched,
            self._clear,
            self._grid,
            self._radius,
            self._work,
        )
        return record

    @property
    def proxy(self) -> tuple[float, float, float]:
        """Where the ball's centre is [m]."""
        return float(self._state[0]), float(self._state[1]), float(self._state[2])

    @property
    def pull(self) -> tuple[float, float]:
        """Force in the tool's spring along x and y, without the ring [N]."""
        return float(self._state[4]), float(self._state[5])

    @property
    def events(self) -> int:
        """How many releases there were since the last reset."""
        return int(self._state[9])

    @property
    def release_force(self) -> float:
        """Spring force in the direction of the last release [N]; 0 before the first."""
        return float(self._state[10])


@dataclass(frozen=True)
class MapDrag:
    """One drag over a map."""

    hand: Array  # shape (n, 2); Hand [m], spring force and force on the hand [N], in x and y
    pull: Array
    force: Array
    peak: float  # Largest spring force across the edge, along x in the sense of the drag [N]
    events: int  # Releases that the renderer reported
    crossed: bool  # Whether the ball came farther than it started from, beyond the place of the peak


def drag_over_map(
    renderer: MapRenderer,
    load: float,
    start: tuple[float, float],
    travel: float,
    direction: float = 0.0,
    speed: float = 1e-3,
    resolution: float = 0.0,
) -> MapDrag:
    """Drag over a map with a hand that keeps its load."""
    way = np.array([math.cos(direction), math.sin(direction)])
    count = math.ceil(travel / (speed * renderer.period))
    height = renderer.height(*start)
    renderer.reset(np.array([*start, height + 1e-6 * renderer.scale]))
    step = (float(way[0]) * speed * renderer.period, float(way[1]) * speed * renderer.period)
    record = renderer.drag(np.array([*start, height]), step, load, resolution, count)
    across = np.sign(way[0]) * record[2] if way[0] else np.abs(record[3])
    most = int(np.argmax(across))
    beyond = float((np.array(renderer.proxy[:2]) - (record[:2, most] - record[2:4, most] / renderer.stiffness)) @ way)
    crossed = beyond > 0.1 * renderer._radius
    return MapDrag(record[:2].T, record[2:4].T, record[4:].T, float(across[most]), renderer.events, crossed)
