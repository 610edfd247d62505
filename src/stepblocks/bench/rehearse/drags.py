"""Trials of a simulated session from the drag in time: the tip climbs, slips, flies and rubs as its equations say."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stepblocks.bench.rehearse.waveform import Rig, disturbed, oversampling
from stepblocks.bench.signal.trace import Trace
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import Tool
from stepblocks.drag.model import DragSettings, probe_for
from stepblocks.drag.ring import ring_of
from stepblocks.drag.simulate import simulate
from stepblocks.drag.track import step_track

_LEAST_SLIDE, _MOST_SLIDE = 50e-3, 80e-3  # [s] before the edge, as of the records from the equations


@dataclass(frozen=True)
class TrueDrag:
    """What one trial of a drag in time is."""

    height: float  # Of step, ball and edge [m]
    tip_radius: float
    edge_radius: float
    friction: float  # Coefficient of friction [1]
    load: float  # Normal load [N]
    speed: float  # Of the handle [m/s]
    stiffness: float  # Of the tool: spring [N/m], its natural frequency [Hz], decay of its amplitude [s]
    frequency: float
    decay_time: float
    pull: float = 0.0  # Steady force along the drag that the gauge reads beside the tip's [N]


@dataclass(frozen=True)
class DraggedTrial:
    """A record and what is true of it."""

    trace: Trace  # The record
    peak_force: float  # Largest tangential force before the slip [N]
    amplitude: float  # First swing below sliding, carried back to the release by the damping of the tool [N]
    release: float  # Instant of the peak [s]


def drag_trial(true: TrueDrag, rig: Rig, random: np.random.Generator, gain: float = 1.0) -> DraggedTrial | None:
    """Simulate one trial and record it.

    Examples
    --------
    >>> trial = drag_trial(
    ...     TrueDrag(40e-6, 125e-6, 0.0, 0.15, 0.8, 10e-3, 9810.0, 300.0, 21e-3), Rig(), np.random.default_rng(1))
    >>> round(trial.peak_force, 1)
    1.2
    """
    factor = oversampling(rig)
    omega = 2.0 * math.pi * true.frequency
    slide = float(random.uniform(_LEAST_SLIDE, _MOST_SLIDE))
    tool = Tool(true.stiffness, frequency=true.frequency, decay_time=true.decay_time)
    probe = probe_for(tool, true.tip_radius)
    settings = DragSettings(
        true.load,
        true.friction,
        speed=true.speed,
        lead=true.speed * slide,
        ring_time=rig.tail * true.decay_time,
        sample_rate=rig.sample_rate * factor,
    )
    done = simulate(step_track(true.height, true.tip_radius, true.edge_radius), probe, settings)
    if done.status is not Status.RELEASES:
        return None
    ring = ring_of(done, spectra=False)
    count = done.rows.shape[0] // factor * factor
    time = done.column("time_s")[:count]
    phase = float(random.uniform(0.0, 2.0 * math.pi))
    start = np.exp(-time / true.decay_time) * np.cos(omega * time + phase)
    force = done.column("fx_n")[:count] + true.pull + rig.start_up * np.where(time < slide, start, 0.0)
    trace = disturbed(gain * force, done.column("fy_n")[:count], rig, random)
    amplitude = ring.amplitude * math.exp(math.pi / (omega * true.decay_time))
    return DraggedTrial(trace, done.peak_force + true.pull, amplitude, done.release_time)
