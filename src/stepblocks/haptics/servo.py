"""The servo loop, a thousand times a second.

It reads the hand, ticks the renderer, holds the force within limits and gives it back.
"""

import ctypes
import gc
import os
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.contact import Array
from stepblocks.files.atomic import write_atomically
from stepblocks.haptics.hands import Hand
from stepblocks.haptics.renderer import Renderer, is_plausible_for_hand

RATE = 1000.0  # Hz
# What is written of every tick; `force` is the renderer's, `applied` what the limits left of it
COLUMNS = (
    "time_s",
    "x_m",
    "y_m",
    "z_m",
    *(f"{name}_{axis}_n" for name in ("force", "applied") for axis in "xyz"),
    "pull_n",
    "held",
    "events",
    "late_s",
)


_WATCHED = 60e-6  # before a tick is due the clock is watched instead of slept through [s]


def request_real_time_priority(priority: int) -> bool:
    """Ask the system to wake this thread before others and on time; return whether it will.

    A sleep may otherwise last 50 us longer. Only Linux has such a call, and grants it to those
    whom its administrator allows it.
    """
    # Threads that it starts take the priority over. Who holds the interpreter while the servo waits
    # for it needs one too, though a lower one: any other program could else put both off.
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(29, 1, 0, 0, 0)  # PR_SET_TIMERSLACK, in nanoseconds, of this thread
    if sys.platform == "linux":
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except (OSError, AttributeError):
            return False
        return True
    else:
        return False


@dataclass(frozen=True)
class Limits:
    """What a hand is never asked to bear, and when it is let go."""

    force: float = 7.0  # N; above the peak of most desk-top devices
    growth: float = (
        5e3  # how fast a force may grow [N/s]; it may fall at once, as it does at a release
    )
    late: float = 200e-6  # a tick this late is logged [s]
    # after so long without a tick, an answer of the hand, or a position that is a number, the force
    # is off until the hand has let go [s]
    dead: float = 0.05
    jump: float = 10.0  # and where the hand was faster between two ticks [m/s]
    rise: float = 0.02  # in which the force grows after the hand has taken hold [s]


class Servo(threading.Thread):
    """One trial's loop in a thread of its own; `stop` ends it."""

    # In doubt it takes the force off, says why in `doubts`, and goes on when the hand has let go
    # and takes hold again.

    def __init__(
        self,
        renderer: Renderer,
        hand: Hand,
        *,
        limits: Limits = Limits(),
        seconds: float = 120.0,
        waits: bool = True,
    ) -> None:
        super().__init__(name="servo", daemon=True)
        self.renderer = renderer
        self.hand = hand
        self.limits = limits
        self._waits = waits
        self._period = renderer.period
        self._log = np.zeros((max(1, round(seconds / self._period)), len(COLUMNS)))
        self._over = threading.Event()
        self._applied = np.zeros(3)
        self._held = False
        self._share = 0.0  # of the force that is applied, growing after the hand took hold
        self._seen: Array | None = None  # the last good position [m]
        self._away = 0.0  # how long there was none [s]
        self.trusted = not hand.motors
        self.doubts: list[str] = []
        self.ticks = 0
        self.ended = ""  # why it ended: "", "stopped" or "time is up"

    def run(self) -> None:
        """Tick until stopped; whatever happens, the last force is zero."""
        # the loop shares the interpreter with the page's server, which must not keep it for long,
        # nor a collection of garbage
        interval, collects = sys.getswitchinterval(), gc.isenabled()
        sys.setswitchinterval(50e-6)
        gc.disable()
        if self._waits:
            request_real_time_priority(20)
        try:
            self.ended = self._run_ticks_until_stopped()
        finally:
            sys.setswitchinterval(interval)
            if collects:
                gc.enable()
            self._set_zero_force()

    def _run_ticks_until_stopped(self) -> str:
        """Tick until stopped or until the log is full; say why the loop ended."""
        start = time.perf_counter()
        for tick, row in enumerate(self._log):
            late = self._wait_until_due(start + tick * self._period)
            if late > self._period:
                start += late  # no burst of ticks to catch up with
            row[0] = tick * self._period
            row[-1] = late
            doubt = self._tick_unless_late(row, late)
            if doubt:
                self._set_zero_force()
                if self.trusted:
                    self.doubts.append(doubt)
                self.trusted = False
            self.ticks = tick + 1
            if self._over.is_set():
                return "stopped"
        return "time is up"

    def _tick_unless_late(self, row: Array, late: float) -> str:
        """Tick unless the loop was late; return what is in doubt, or nothing."""
        if late > self.limits.dead:
            return f"watchdog: a tick came {late * 1e3:.0f} ms late"
        try:
            return self._tick(row)
        except Exception as error:  # a hand that fails must not leave its force standing
            return f"{type(error).__name__}: {error}"

    def _tick(self, row: Array) -> str:
        """Read the hand, render, and give the force back; return what is in doubt, or nothing."""
        asked = time.perf_counter()
        position, velocity, is_held = self.hand.read()
        if self._waits and time.perf_counter() - asked > self.limits.dead:
            return "watchdog: the hand did not answer"
        if not is_held:
            self.trusted = True  # it has let go
        doubt = self._find_doubt_about_position(position)
        if doubt:
            return doubt
        is_felt = is_held and self.trusted
        if is_felt and not self._held:
            self.renderer.reset(position)
            self._share = 0.0
        self._held = is_felt
        force, pull = np.zeros(3), 0.0
        applied = force
        if is_felt:
            force = self.renderer.tick(position, velocity)
            applied = self._limit_force_and_growth(force, self._applied)
            if self.hand.motors:
                applied *= self._share
                self._share = min(self._share + self._period / self.limits.rise, 1.0)
            pull = self.renderer.pull
        self._applied = applied
        row[1:-1] = (*position, *force, *applied, pull, is_felt, self.renderer.events)
        # after the log: a virtual hand moves its own position here, and keeps its load by what is
        # rendered, not by what is left of it
        if self.hand.motors:
            self.hand.apply(applied)
        else:
            self.hand.apply(force)
        return ""

    def _find_doubt_about_position(self, position: Array) -> str:
        """Note the position of a hand with motors [m].

        Returns that the hand was lost for too long, or jumped; empty for neither.
        """
        if not self.hand.motors:
            return ""
        if not is_plausible_for_hand(position):
            self._away += self._period
            if self._away > self.limits.dead:
                return "watchdog: the hand gave no position"
            return ""
        before, reach = self._seen, self.limits.jump * (self._away + max(self._period, 1e-3))
        self._seen, self._away = np.array(position), 0.0
        if before is None or not self._held:
            return ""
        way = float(np.linalg.norm(self._seen - before))
        if way > reach:
            return f"jump: the hand moved by {way * 1e3:.3g} mm between two ticks"
        return ""

    def _set_zero_force(self) -> None:
        """Take the force off the hand."""
        self._applied = np.zeros(3)
        self._held = False
        with suppress(Exception):  # it failed before, and is asked again at the next tick
            self.hand.apply(self._applied)

    def _wait_until_due(self, due: float) -> float:
        """Sleep, then watch the clock until a tick is due; return how late it is [s]."""
        if not self._waits:
            return 0.0
        left = due - time.perf_counter()
        if left > _WATCHED:
            time.sleep(left - _WATCHED)
        late = time.perf_counter() - due
        while late < 0.0:
            late = time.perf_counter() - due
        return late

    def _limit_force_and_growth(self, force: Array, previous_force: Array) -> Array:
        """Shorten a force to what the hand may bear, and to how fast it may have grown [N]."""
        size = float(np.linalg.norm(force))
        size_before = float(np.linalg.norm(previous_force))
        limit = min(self.limits.force, size_before + self.limits.growth * self._period)
        if size <= limit:
            return force.copy()
        return force * (limit / size)

    def stop(self) -> None:
        """End the loop and wait for it."""
        self._over.set()
        if self.is_alive():
            self.join()

    def get_log_columns(self) -> dict[str, Array]:
        """Return the columns of all ticks so far."""
        return dict(zip(COLUMNS, self._log[: self.ticks].T.copy(), strict=True))

    def count_late_ticks(self) -> dict[str, float]:
        """Return how many ticks there were, how many were late, and how late.

        The lateness is its 99.9 % quantile [s].
        """
        late = self._log[: self.ticks, -1]
        late_999 = 0.0
        if self.ticks:
            late_999 = float(np.quantile(late, 0.999))
        return {
            "ticks": self.ticks,
            "late_ticks": int((late > self.limits.late).sum()),
            "late_999_s": late_999,
        }


def write_motion_file(path: Path, servo: Servo, attributes: dict[str, object]) -> None:
    """Write a trial's motion and forces as HDF5, one dataset per column.

    The file is written beside its place and renamed.
    """
    import h5py

    with write_atomically(path) as draft, h5py.File(draft, "w", track_order=True) as file:
        for name, values in servo.get_log_columns().items():
            file.create_dataset(name, data=values, compression="gzip", shuffle=True)
        file.attrs.update(
            {
                "rate_hz": RATE,
                "ended": servo.ended,
                "doubts": "; ".join(servo.doubts),
                **servo.count_late_ticks(),
                **attributes,
            }
        )
