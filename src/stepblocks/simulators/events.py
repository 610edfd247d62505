"""Events other than the formula's: as a measured session has taught them, or with the ring of the drag in time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.model_file import LearnedModel
from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Status
from stepblocks.contact.event import Events, Learned, VibrationEvent, Waveform, ring_energy, vibration_events
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.path.centre import CentrePath
from stepblocks.drag.ring import ring_of
from stepblocks.drag.simulate import DragSettings, DragTrace, probe_for, simulate
from stepblocks.drag.track import track_along
from stepblocks.errors import HapticsError
from stepblocks.parts.kind import Part
from stepblocks.predict.trials import LearnedDrag, learned_drag

Array = NDArray[np.float64]
_RATE = 96e3  # of the simulated force [Hz]; WAV files are interpolated from it
_LENGTH = 0.1  # recorded after the release [s]


def teach(
    learned: LearnedModel, surface: Part, point: OperatingPoint, *, keep_friction: bool = False
) -> tuple[Part, OperatingPoint, Events]:
    """Apply what was learnt to a surface, its operating point and its events."""
    known = _ask(learned, surface, point, 1)
    taught = replace(point, friction=point.friction if keep_friction else known.friction, tool=known.tool)
    edge = surface.sizes.get("edge_radius")
    if edge is not None and known.edge_radius > 0.0:
        radius = min(known.edge_radius, surface.counterface().far_side)
        surface = surface.model_copy(update={"edge_radius": replace(edge, nominal=radius)})
    up, down = vibration_events(surface.counterface(), taught, surface.id)
    return surface, taught, (_told(learned, up, surface, taught), _told(learned, down, surface, taught))


def _told(learned: LearnedModel, event: VibrationEvent, surface: Part, point: OperatingPoint) -> VibrationEvent:
    if event.status is not Status.RELEASES:
        return event
    known = _ask(learned, surface, point, event.direction)
    energy = known.energy[0] if math.isfinite(known.energy[0]) else event.energy
    return replace(event, energy=energy, learned=Learned(known.status, known.peak_force, known.energy))


def _ask(learned: LearnedModel, surface: Part, point: OperatingPoint, direction: int) -> LearnedDrag:
    height = _height(surface.counterface(), point.ball_radius, direction)
    return learned_drag(learned, surface.id, height, point)


def _height(face: Counterface, ball_radius: float, direction: int) -> float:
    """Height of the step that this edge is for the ball [m]: its own, or that of the same critical angle."""
    if direction > 0 and face.ways[0] == "up":
        return face.far_side
    angle = face.centre_path(ball_radius).notch(float(direction))[2]
    return ball_radius * (1.0 - math.cos(angle))


def with_drag_ring(event: VibrationEvent, path: CentrePath, point: OperatingPoint) -> VibrationEvent:
    """Replace the exponential by the ring of a drag in time: the force below that of sliding, from where it first falls there."""
    if event.status is not Status.RELEASES:
        return event
    probe = probe_for(point.tool, point.ball_radius)
    settings = DragSettings(point.normal_load, point.friction, speed=point.speed, sample_rate=_RATE, ring_time=_LENGTH)
    trace = simulate(track_along(path, point.ball_radius, event.direction < 0), probe, settings)
    if trace.status is not Status.RELEASES:
        raise HapticsError(
            f"the time-domain drag must release to give a ring, got {trace.status.value} [{event.stimulus} {event.drag}]"
        )
    force, delay = _swings(trace)
    factor = math.sqrt(event.energy / ring_energy(force, _RATE, event.tool))
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
