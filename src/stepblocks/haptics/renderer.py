"""The reference renderer: experiment 2 of the paper, for any device with position and force."""

import math
from dataclasses import dataclass

import numpy as np

from stepblocks.contact import Array
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.errors import HapticsError
from stepblocks.haptics import proxy_kernel as kernel

_APPROACH = 40e-6  # before the notch, and the least travel behind it, unscaled [m]
_FADE = 0.01  # of the force after an input that is not a number [s]
_MOST_TICKS = 20_000_000  # of one drag, in memory
_KINK = 1e-3  # change of slope that is a notch of the path, not the chords of a circle [1]


@dataclass(frozen=True, eq=False)
class Drag:
    """One drag over an edge.

    Attributes
    ----------
    time, hand : ndarray, shape (n,)
        Of each tick [s]; position of the hand along the drag [m].
    pull, force : ndarray, shape (n,)
        In the spring, positive where the hand pulls; on the hand, of spring and ring [N].
    peak : float
        Largest force in the spring [N].
    events : int
        Releases.
    crossed : bool
        Whether the proxy left the notch.
    """

    time: Array
    hand: Array
    pull: Array
    force: Array
    peak: float
    events: int
    crossed: bool


class Renderer:
    """A proxy on the path of the ball's centre, pulled by the hand through the spring of the tool.

    Parameters
    ----------
    path : CentrePath
        Of the ball's centre over the surface, unscaled; `Counterface.centre_path` gives it.
    point : OperatingPoint
        Friction and tool; ball and load are in the path and in the hand.
    scale, rate : float
        Magnification S of the path, by which the spring is divided: forces and ring stay; rate of
        the servo loop [Hz].
    event : bool
        Whether a release rings; False is the paper's condition without vibration.
    wall, damping : float
        Spring along the load, that of the tool over S if left out [N/m]; of the hand's velocity in
        contact [N s/m].

    Raises
    ------
    HapticsError
        If scale or rate is not positive, or the damping negative.

    Examples
    --------
    >>> from stepblocks.contact.operating_point import PAPER
    >>> from stepblocks.contact.counterface import Step
    >>> renderer = Renderer(Step(50e-6).centre_path(125e-6), PAPER)
    >>> renderer.reset(np.array([-1e-3, 0.0, 2e-4]))
    >>> float(np.round(renderer.tick(np.array([-1e-3, 0.0, 115e-6]), np.zeros(3))[2], 4))
    0.0981
    """

    def __init__(
        self,
        path: CentrePath,
        point: OperatingPoint,
        *,
        scale: float = 1.0,
        rate: float = 10e3,
        event: bool = True,
        wall: float | None = None,
        damping: float = 0.0,
    ) -> None:
        for name, value in (("scale", scale), ("rate", rate)):
            HapticsError.require(
                math.isfinite(value) and value > 0.0,
                f"{name} must be positive and finite, got {value:g}",
            )
        HapticsError.require(
            math.isfinite(damping) and damping >= 0.0,
            f"damping must be finite and not negative, got {damping:g} N s/m",
        )
        self.path = path.scaled(scale)
        self.scale = scale
        self.period = 1.0 / rate
        self.stiffness = point.tool.stiffness / scale
        self.wall = self.stiffness if wall is None else wall
        self.force: Array = np.zeros(3)
        self._good: Array = np.zeros(3)  # last force that was meant [N]
        ring = math.sqrt(point.tool.conversion) if event else 0.0
        setting = (
            self.stiffness,
            self.wall,
            point.friction,
            damping,
            self.period,
            ring,
            math.tau * point.tool.frequency,
            point.tool.decay_time,
        )
        self._settings = np.array([setting], kernel.SETTING)
        first, last = self.path.slope_start, self.path.slope_end
        before, after = np.concatenate([first[:1], last]), np.concatenate([first, last[-1:]])
        notch = after - before > _KINK
        up, down = notch & (after > _KINK), notch & (before < -_KINK)
        columns = (self.path.x, self.path.z, after, np.append(last, 0.0), up, down)
        self.knots = np.array(list(zip(*columns, strict=True)), kernel.PATH)
        self._states = np.zeros(1, kernel.STATE)
        self.reset(np.array([self.path.x[0], 0.0, float(self.path.z.max()) + 1.0]))

    def __repr__(self) -> str:
        return f"Renderer(scale {self.scale:g}, {1.0 / self.period:g} Hz, {self.stiffness:g} N/m)"

    def reset(self, position: Array) -> None:
        """Put the proxy where the hand is [m], free."""
        x = float(np.clip(position[0], self.path.x[0], self.path.x[-1]))
        piece = int(
            np.clip(np.searchsorted(self.path.x, x, side="right") - 1, 0, len(self.path.x) - 2)
        )
        self._states[0] = (x, position[1], position[2], 0.0, -1.0, 0.0, 0.0, piece, 0, False)
        self.force[:] = self._good[:] = 0.0
        self._share, self.faults = 1.0, 0

    def tick(self, position: Array, velocity: Array) -> Array:
        """Return the force on the hand [N] at its position [m] and velocity [m/s].

        Shape (3,) each; the next tick overwrites the force. A position or velocity that is not a
        number is counted in `faults` and moves nothing: the last good force fades to zero over 10
        ms, and grows again as slowly afterwards.
        """
        if getattr(position, "shape", None) != (3,) or getattr(velocity, "shape", None) != (3,):
            raise HapticsError(
                "position and velocity must be arrays of shape (3,), got "
                f"{type(position).__name__} {getattr(position, 'shape', '')} and "
                f"{type(velocity).__name__} {getattr(velocity, 'shape', '')}"
            )
        step = self.period / _FADE
        if not math.isfinite(sum(position.tolist()) + sum(velocity.tolist())):
            self.faults += 1
            self.force[:] = self._share * self._good
            self._share = max(self._share - step, 0.0)
            return self.force
        kernel.tick(position, velocity, self.force, self._states, self._settings, self.knots)
        self._good[:] = self.force
        if self._share < 1.0:
            self.force *= self._share
            self._share = min(self._share + step, 1.0)
        return self.force

    def drag(
        self,
        load: float,
        travel: float,
        direction: float = 1.0,
        speed: float = 1e-3,
        resolution: float = 0.0,
    ) -> Drag:
        """Drag over the notch by a virtual hand that keeps its load [N], as the bench does.

        The device rounds positions to its resolution [m]. No force is limited, neither here nor in
        `tick`: a program that drives a device does that.
        """
        # travel behind the notch [m] and speed [m/s] in the magnified frame, towards +x or -x
        notch, height, _ = self.path.find_notch(direction)
        approach, step = _APPROACH * self.scale, direction * float(speed) * self.period
        start = notch - direction * approach
        ticks = (approach + travel) / abs(step) if step else math.inf
        HapticsError.require(
            load >= 0.0 and 0.0 < ticks <= _MOST_TICKS,
            f"a drag must have a load, and 1 to {_MOST_TICKS} ticks, got {load:g} N, and "
            f"{travel:g} m at {speed:g} m/s",
        )
        record = np.zeros((3, math.ceil(ticks)))
        self.reset(np.array([start, 0.0, float(self.path.z.max()) + height]))
        hand = np.array([start, 0.0, float(np.interp(start, self.path.x, self.path.z))])
        kernel.drag(
            record,
            hand,
            step,
            float(load),
            float(resolution),
            self._states,
            self._settings,
            self.knots,
        )
        place, pull, force = direction * record
        return Drag(
            time=np.asarray(np.arange(record.shape[1]) * self.period, dtype=np.float64),
            hand=place,
            pull=pull,
            force=force,
            peak=float(pull.max()),
            events=self.events,
            crossed=direction * (self.proxy[0] - notch) > 1e-9 * self.scale,
        )

    @property
    def proxy(self) -> tuple[float, float]:
        """Where the proxy is across and along the edge [m]."""
        return float(self._states["x"][0]), float(self._states["y"][0])

    @property
    def pull(self) -> float:
        """Force in the spring without the ring [N]; positive where the hand pulls towards +x."""
        return float(self._states["pull"][0])

    @property
    def events(self) -> int:
        """How many releases there were since the last reset."""
        return int(self._states["events"][0])

    @property
    def release_force(self) -> float:
        """Spring force at the last release [N]; 0 before the first."""
        return float(self._states["release"][0])
