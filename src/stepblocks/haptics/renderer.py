"""The reference renderer: experiment 2 of the paper, for any device with position and force."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact import Array
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.errors import HapticsError
from stepblocks.haptics import proxy_kernel as kernel

_APPROACH = 40e-6  # before the notch, and the least travel behind it, unscaled [m]
_FARTHEST = 1e3  # a place [m] or velocity [m/s] beyond is no number of a hand
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
            if not (math.isfinite(value) and value > 0.0):
                raise HapticsError(f"{name} must be positive and finite, got {value:g}")
        if not (math.isfinite(damping) and damping >= 0.0):
            raise HapticsError(f"damping must be finite and not negative, got {damping:g} N s/m")
        self.path = path.scaled(scale)
        self.scale = scale
        self.period = 1.0 / rate
        self.stiffness = point.tool.stiffness / scale
        self.wall = self.stiffness
        if wall is not None:
            self.wall = wall
        self.force: Array = np.zeros(3)
        self._good: Array = np.zeros(3)  # last force that was meant [N]
        ring_ratio = 0.0
        if event:
            ring_ratio = math.sqrt(point.tool.conversion)
        self._settings = np.zeros(1, kernel.SETTING)
        self._settings["stiffness"] = self.stiffness
        self._settings["wall"] = self.wall
        self._settings["friction"] = point.friction
        self._settings["damping"] = damping
        self._settings["period"] = self.period
        self._settings["ring"] = ring_ratio
        self._settings["omega"] = math.tau * point.tool.frequency
        self._settings["decay"] = point.tool.decay_time
        self.knots = _build_knot_records(self.path)
        self._states = np.zeros(1, kernel.STATE)
        self.reset(np.array([self.path.x[0], 0.0, float(self.path.z.max()) + 1.0]))

    def __repr__(self) -> str:
        return f"Renderer(scale {self.scale:g}, {1.0 / self.period:g} Hz, {self.stiffness:g} N/m)"

    def reset(self, position: Array) -> None:
        """Put the proxy where the hand is [m], free."""
        knots = self.path.x
        x = float(np.clip(position[0], knots[0], knots[-1]))
        piece = np.searchsorted(knots, x, side="right") - 1
        self._states[0] = 0
        self._states["x"] = x
        self._states["y"] = position[1]
        self._states["height"] = position[2]
        self._states["ring_time"] = -1.0  # there was no event yet
        self._states["piece"] = np.clip(piece, 0, len(knots) - 2)
        self.force[:] = 0.0
        self._good[:] = 0.0
        self._share = 1.0  # of the force that the hand gets, below 1 after a fault
        self.faults = 0

    def tick(self, position: Array, velocity: Array) -> Array:
        """Return the force on the hand [N] at its position [m] and velocity [m/s].

        Shape (3,) each; the next tick overwrites the force. A position or velocity that is not a
        number, or beyond a kilometre, is counted in `faults` and moves nothing: the last good force
        fades to zero over 10 ms, and grows again as slowly afterwards.
        """
        _refuse_non_vectors(position, velocity)
        step = self.period / _FADE
        if not (is_plausible_for_hand(position) and is_plausible_for_hand(velocity)):
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
        approach = _APPROACH * self.scale
        step = direction * float(speed) * self.period
        start = notch - direction * approach
        ticks = math.inf
        if step:
            ticks = (approach + travel) / abs(step)
        if not (load >= 0.0 and 0.0 < ticks <= _MOST_TICKS):
            raise HapticsError(
                f"a drag must have a load, and 1 to {_MOST_TICKS} ticks, got {load:g} N, and "
                f"{travel:g} m at {speed:g} m/s"
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
        moved, _ = self.proxy
        return Drag(
            time=np.asarray(np.arange(record.shape[1]) * self.period, dtype=np.float64),
            hand=place,
            pull=pull,
            force=force,
            peak=float(pull.max()),
            events=self.events,
            crossed=direction * (moved - notch) > 1e-9 * self.scale,
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


def is_plausible_for_hand(values: Array) -> bool:
    """Tell whether a position [m] or velocity [m/s] can be one of a hand: numbers within 1 km."""
    size: float = sum(map(abs, values.tolist()))
    return size <= _FARTHEST


def _build_knot_records(path: CentrePath) -> NDArray[np.void]:
    """Make records of the kernel for the knots of a path: slopes beside each, and what it holds."""
    first, last = path.slope_start, path.slope_end
    before = np.concatenate([first[:1], last])
    after = np.concatenate([first, last[-1:]])
    is_notch = after - before > _KINK
    knots = np.zeros(len(path.x), kernel.PATH)
    knots["x"] = path.x
    knots["z"] = path.z
    knots["first"] = after
    knots["last"] = np.append(last, 0.0)
    knots["up"] = is_notch & (after > _KINK)
    knots["down"] = is_notch & (before < -_KINK)
    return knots


def _refuse_non_vectors(position: object, velocity: object) -> None:
    """Refuse values that are not vectors; the compiled tick does not check."""
    shapes = (getattr(position, "shape", None), getattr(velocity, "shape", None))
    if shapes == ((3,), (3,)):
        return
    raise HapticsError(
        "position and velocity must be arrays of shape (3,), got "
        f"{type(position).__name__} {getattr(position, 'shape', '')} and "
        f"{type(velocity).__name__} {getattr(velocity, 'shape', '')}"
    )
