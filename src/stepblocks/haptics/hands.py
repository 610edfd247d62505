"""The hand that moves the probe: a mouse, or a device.

The C library of a device's maker is loaded when the device is asked for.
"""

# A hand says where it is [m], how fast it moves [m/s] and whether its dead-man switch is held, and
# takes a force [N]; axes are those of the scene: x along the drag, y along the edge, z up,
# magnified. Constants and signatures of the makers' libraries are those of their public headers:
# OpenHaptics 3.5 (HD/hd.h, hdDefines.h), Force Dimension SDK 3 (dhdc.h).

import ctypes
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from ctypes.util import find_library
from typing import NamedTuple

import numpy as np

from stepblocks.contact import Array
from stepblocks.errors import PipelineError, StudyError

_PERIOD = 1e-3  # of a servo loop [s]
_SILENCE = 0.25  # a page that sends nothing for so long has let go [s]
_SMOOTH = 0.008  # time constant with which the hand follows what a page sends in steps [s]
_FASTEST = 0.5  # of a mouse's hand in the magnified frame [m/s]


class HandState(NamedTuple):
    """Where a hand is at one tick of the servo loop."""

    position: Array  # shape (3,) [m]; the hand may change it at its next tick
    velocity: Array  # shape (3,) [m/s]; the same
    is_held: bool  # whether the dead-man switch is held


class Hand(ABC):
    """What a servo loop asks of a device."""

    motors: bool = (
        False  # whether it can push: then its switch must be let go before a trial begins
    )

    @abstractmethod
    def read(self) -> HandState:
        """Return the state at this tick.

        The loop calls it once in a tick; a virtual hand moves on with every call.
        """

    @abstractmethod
    def apply(self, force: Array) -> None:
        """Put a force on the hand [N]."""

    def close(self) -> None:
        """Let go of the device."""
        return


class Mouse(Hand):
    """A mouse whose page sends positions now and then.

    Its virtual hand keeps the load, as the weights of the bench do.
    """

    def __init__(self, load: float, wall_stiffness: float, start_height: float) -> None:
        self._load, self._wall, self._top = load, wall_stiffness, start_height
        self._position, self._velocity = np.array([0.0, 0.0, start_height]), np.zeros(3)
        self._target, self._held, self._heard, self._down = 0.0, False, -1.0, False

    def update_target(self, x: float, is_held: bool) -> None:
        """Take where the page says that the mouse is [m]."""
        self._target, self._held, self._heard = x, is_held, time.monotonic()

    def read(self) -> HandState:
        """Advance the virtual hand by one tick of 1 ms towards the last position of the page.

        It is held if the page says so and has sent something within the last 0.25 s. A hand that
        takes hold comes down from above its place. The arrays are the hand's own: they change with
        the next call, and with `apply`.
        """
        held = self._held and time.monotonic() - self._heard < _SILENCE
        if held and not self._down:
            self._position[:] = (self._target, 0.0, self._top)
        self._down = held
        step = (self._target - self._position[0]) * _PERIOD / _SMOOTH
        step = min(max(step, -_FASTEST * _PERIOD), _FASTEST * _PERIOD)
        self._position[0] += step
        self._velocity[0] = step / _PERIOD
        return HandState(self._position, self._velocity, held)

    def apply(self, force: Array) -> None:
        """Keep the load: the wall is a known spring."""
        if self._down:
            self._position[2] += (force[2] - self._load) / self._wall


def _find_first_library(names: Sequence[str]) -> str:
    """Find the first of several libraries that the system has; empty where it has none."""
    for name in names:
        path = find_library(name)
        if path:
            return path
    return ""


def _load_device_library(library: str, *names: str) -> ctypes.CDLL:
    """Load a maker's library by path, or by the first of its names that the system finds."""
    found = library or _find_first_library(names)
    if not found:
        raise StudyError(
            f"the library {' or '.join(names)} must be installed to use this device, got none; or "
            "say --library"
        )
    try:
        return ctypes.CDLL(found)
    except OSError as error:
        raise PipelineError(f"the library cannot be loaded: {error} [{found}]") from error


def _declare_library_functions(
    library: ctypes.CDLL, signatures: Mapping[str, tuple[object, object]]
) -> None:
    """Declare result and argument types of the functions of a maker's library."""
    for name, (restype, argtypes) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = restype, argtypes


class ForceDimension(Hand):
    """omega, delta, sigma and Falcon through ``libdhd``; button 0 is the dead-man switch."""

    motors = True

    def __init__(self, library: str = "") -> None:
        self._lib = lib = _load_device_library(library, "dhd", "drd")
        real, byte, whole = ctypes.c_double, ctypes.c_char, ctypes.c_int
        axes = [ctypes.POINTER(real)] * 3
        functions = {
            "dhdGetPosition": (whole, [*axes, byte]),
            "dhdGetLinearVelocity": (whole, [*axes, byte]),
            "dhdSetForce": (whole, [real, real, real, byte]),
            "dhdGetButton": (whole, [whole, byte]),
            "dhdEnableForce": (whole, [ctypes.c_ubyte, byte]),
            "dhdClose": (whole, [byte]),
            "dhdErrorGetLastStr": (ctypes.c_char_p, []),
        }
        _declare_library_functions(lib, functions)
        self._one = ctypes.c_char(b"\xff")  # -1: the device that was opened last
        self._values = [ctypes.c_double() for _ in range(6)]
        self._raise_unless_successful(lib.dhdOpen() >= 0, "be opened")
        self._raise_unless_successful(lib.dhdEnableForce(1, self._one) >= 0, "switch its forces on")

    def _raise_unless_successful(self, is_successful: bool, request: str) -> None:
        """Raise with the library's last error unless a call is `is_successful`."""
        if not is_successful:
            raise PipelineError(
                f"the device must {request}: {self._lib.dhdErrorGetLastStr().decode()}"
            )

    def read(self) -> HandState:
        """Return the state of the device, whose x points to the operator and its y to the right."""
        places = [ctypes.byref(value) for value in self._values]
        self._raise_unless_successful(
            self._lib.dhdGetPosition(*places[:3], self._one) >= 0, "tell its position"
        )
        self._raise_unless_successful(
            self._lib.dhdGetLinearVelocity(*places[3:], self._one) >= 0, "tell its velocity"
        )
        x, y, z, u, v, w = (value.value for value in self._values)
        return HandState(
            np.array([y, -x, z]),
            np.array([v, -u, w]),
            bool(self._lib.dhdGetButton(0, self._one) == 1),
        )

    def apply(self, force: Array) -> None:
        """Turn the force back into its axes."""
        self._raise_unless_successful(
            self._lib.dhdSetForce(-force[1], force[0], force[2], self._one) >= 0, "take a force"
        )

    def close(self) -> None:
        """Switch its forces off."""
        self._lib.dhdSetForce(0.0, 0.0, 0.0, self._one)
        self._lib.dhdEnableForce(0, self._one)
        self._lib.dhdClose(self._one)


class _HDError(ctypes.Structure):
    _fields_ = (("code", ctypes.c_uint), ("internal", ctypes.c_int), ("device", ctypes.c_uint))


class OpenHaptics(Hand):
    """Touch and Phantom through ``libHD``, whose scheduler calls back a thousand times a second.

    Button 1 is the dead-man switch.
    """

    motors = True
    _POSITION, _VELOCITY, _BUTTONS, _FORCE, _OUTPUT = 0x2050, 0x2051, 0x2000, 0x2700, 0x4000

    def __init__(self, library: str = "") -> None:
        self._lib = lib = _load_device_library(library, "HD")
        self._callback = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_void_p)(
            self._exchange_state_and_force
        )
        number, doubles = ctypes.c_uint, ctypes.POINTER(ctypes.c_double)
        _declare_library_functions(
            lib,
            {
                "hdInitDevice": (number, [ctypes.c_char_p]),
                "hdGetError": (_HDError, []),
                "hdGetErrorString": (ctypes.c_char_p, [number]),
                "hdGetDoublev": (None, [number, doubles]),
                "hdSetDoublev": (None, [number, doubles]),
                "hdGetIntegerv": (None, [number, ctypes.POINTER(ctypes.c_int)]),
                "hdScheduleAsynchronous": (
                    ctypes.c_ulong,
                    [type(self._callback), ctypes.c_void_p, ctypes.c_ushort],
                ),
                "hdUnschedule": (None, [ctypes.c_ulong]),
            },
        )
        self._device = lib.hdInitDevice(None)
        self._raise_noted_error("be opened")
        self._state, self._given = np.zeros(7), np.zeros(3)
        self._lock = threading.Lock()
        lib.hdEnable(self._OUTPUT)
        self._handle = lib.hdScheduleAsynchronous(self._callback, None, 0xFFFF // 2)
        lib.hdStartScheduler()
        self._raise_noted_error("start its scheduler")

    def _raise_noted_error(self, request: str) -> None:
        """Raise the error that the library has noted, if any."""
        error = self._lib.hdGetError()
        if error.code:
            raise PipelineError(
                f"the device must {request}: {self._lib.hdGetErrorString(error.code).decode()}"
            )

    def _exchange_state_and_force(self, _: object) -> int:
        """Read the state of the device and give it the force, once in a servo frame."""
        values, buttons = (ctypes.c_double * 6)(), ctypes.c_int()
        pointer = ctypes.POINTER(ctypes.c_double)
        self._lib.hdBeginFrame(self._device)
        self._lib.hdGetDoublev(self._POSITION, ctypes.cast(values, pointer))
        self._lib.hdGetDoublev(self._VELOCITY, ctypes.cast(ctypes.byref(values, 24), pointer))
        self._lib.hdGetIntegerv(self._BUTTONS, ctypes.byref(buttons))
        with self._lock:
            self._state[:] = (*values, buttons.value & 1)
            x, y, z = self._given
        self._lib.hdSetDoublev(self._FORCE, (ctypes.c_double * 3)(x, z, -y))
        self._lib.hdEndFrame(self._device)
        return 1  # HD_CALLBACK_CONTINUE

    def read(self) -> HandState:
        """Return the state of the last frame.

        The device gives millimetres; its y is up, its z points to the operator.
        """
        with self._lock:
            x, y, z, u, v, w, held = self._state.tolist()
        return HandState(
            np.array([x, -z, y]) * 1e-3, np.array([u, -w, v]) * 1e-3, is_held=held > 0.0
        )

    def apply(self, force: Array) -> None:
        """Leave the force for the next frame."""
        with self._lock:
            self._given[:] = force

    def close(self) -> None:
        """Stop the scheduler and let go."""
        self._lib.hdStopScheduler()
        self._lib.hdUnschedule(self._handle)
        self._lib.hdDisableDevice(self._device)


# by name: what opens a hand, from the path of its library, or of its record
HANDS: dict[str, Callable[[str], Hand]] = {
    "openhaptics": OpenHaptics,
    "dhd": ForceDimension,
}
