"""The ring that the time-domain drag finds, in place of the exponential."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.energy import Status
from stepblocks.contact.event import VibrationEvent, Waveform, ring_energy
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.drag.model import DragSettings, probe_for
from stepblocks.drag.ring import ring_of
from stepblocks.drag.simulate import DragTrace, simulate
from stepblocks.drag.track import track_along
from stepblocks.errors import HapticsError

Array = NDArray[np.float64]
_RATE = 96e3  # of the simulated force; WAV files are interpolated from it
_LENGTH = 0.1  # recorded after the release [s]


def with_drag_ring(
    event: VibrationEvent, path: CentrePath, condition: OperatingPoint, speed: float = 5e-3
) -> VibrationEvent:
    """Replace the exponential of an event by the ring of a drag that is simulated in time.

    The ring is the pulling force below the level of sliding, from where it first falls through that level.
    """
    if event.status is not Status.RELEASES:
        return event
    tool = replace(condition.tool, frequency=event.frequency, decay_time=event.decay)
    probe = probe_for(tool, condition.ball_radius)
    settings = DragSettings(
        condition.normal_load, condition.friction, speed=speed, sample_rate=_RATE, ring_time=_LENGTH
    )
    trace = simulate(track_along(path, condition.ball_radius, event.direction < 0), probe, settings)
    if trace.status is not Status.RELEASES:
        raise HapticsError(
            f"the time-domain drag must release to give a ring, got {trace.status.value} [{event.stimulus} {event.drag}]"
        )
    force, delay = _swings(trace)
    found = ring_energy(force, _RATE, event)
    factor = float(np.sqrt(event.energy / found))
    own = ring_of(trace, spectra=False)
    return replace(event, waveform=Waveform(force * factor, _RATE, delay, trace.peak_force, own.energy, factor))


def _swings(trace: DragTrace) -> tuple[Array, float]:
    time, pull = trace.column("time_s"), trace.column("fx_n")
    level = trace.settings.friction * trace.settings.normal_load
    after = np.flatnonzero((time >= trace.release_time) & (pull <= level))
    if len(after) < 2:
        raise HapticsError(f"the pulling force must fall to that of sliding ({level:g} N) to ring, got none that low")
    begin = int(after[0])
    return np.asarray(level - pull[begin:]), float(time[begin] - trace.release_time)
