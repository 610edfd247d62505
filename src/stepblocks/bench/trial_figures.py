"""Job: figures of chosen trials of a session, with what was fitted drawn in."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path

import numpy as np

from stepblocks.bench.measuring import pilot
from stepblocks.bench.session import Session, open_session
from stepblocks.bench.signal.features import Measurement, measure_trace
from stepblocks.bench.signal.landmarks import LandmarkError
from stepblocks.bench.signal.ring import Ring
from stepblocks.bench.signal.screening import screen_trace
from stepblocks.bench.sources import TraceError, open_source, read_trace
from stepblocks.bench.trace import Trace, Trial
from stepblocks.bench.trial_picture import TrialPicture, draw_trial
from stepblocks.bench.trial_table import open_trials
from stepblocks.errors import PipelineError

_FIRST = 12  # trials that are drawn where none are named


def draw_trials(folder: Path, output: Path, names: list[str] | None = None) -> list[Path]:
    """Draw trials of a session."""
    session = open_session(folder)
    table = open_trials(session)
    if names is None:
        chosen = list(islice(table, _FIRST))
    else:
        wanted = set(names)
        chosen = [trial for trial in table if trial.name in wanted]
        missing = sorted(wanted - {trial.name for trial in chosen})
        if missing:
            raise PipelineError(f"trial {missing[0]!r} is not in the table of trials [{session.table}]")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PipelineError(f"folder for figures cannot be made: {error.strerror} [{output}]") from error
    source = open_source(session)
    drawn = []
    try:
        tool = pilot(session, source, table)
        for trial in chosen:
            try:
                trace = read_trace(source, session, trial.name)
            except TraceError:
                continue
            path = output / f"trial-{re.sub(r'[^A-Za-z0-9._-]', '_', trial.name)}.png"
            draw_trial(_picture(session, trial, trace, tool), path)
            drawn.append(path)
    finally:
        source.close()
    return drawn


def _picture(session: Session, trial: Trial, trace: Trace, tool: tuple[float, float] | None) -> TrialPicture:
    conditions = ", ".join(f"{name} {cell}" for name, cell in list(trial.cells.items())[1:6])
    title = f"{session.title}: trial {trial.name} ({conditions})"
    reason = screen_trace(trace, session.acquisition.sample_rate, session.acquisition.range)
    if not reason:
        try:
            measured = measure_trace(trace, session.probe.spring_constant, trial.speed, tool)
        except LandmarkError as error:
            reason = str(error)
        else:
            return _measured_picture(title, trace, measured)
    return TrialPicture(title, trace.time, trace.tangential, trace.normal, notes=[f"excluded: {reason}"])


def _measured_picture(title: str, trace: Trace, measured: Measurement) -> TrialPicture:
    zero = float(trace.time[0])
    time = trace.time - zero
    approach, after, peak, found = measured.approach, measured.aftermath, measured.peak, measured.features
    slide, ramp = time < approach.onset, (time >= approach.onset) & (time <= peak.time)
    sliding = approach.sliding(time)
    ring = after.ring
    ringing = time >= after.origin
    fitted = ring.curve(time[ringing])
    if not isinstance(ring, Ring):
        fitted = fitted + approach.hum(time[ringing])
    since = time[time >= after.start] - after.start
    size = after.amplitude[0] * np.exp(-since / after.decay_time[0])
    return TrialPicture(
        title,
        trace.time,
        trace.tangential,
        trace.normal,
        curves=[
            ("sliding", trace.time[slide], sliding[slide]),
            ("ramp", trace.time[ramp], approach.line(time[ramp])),
            (f"{after.kind} ring", trace.time[ringing], fitted),
        ],
        marks={"onset": (approach.onset + zero, approach.level), "release": (peak.time + zero, peak.force)},
        # the levels of a rubbing ring change with every half cycle; it has no one envelope
        envelope=(after.start + since + zero, after.level[0], size) if isinstance(ring, Ring) else None,
        notes=_notes(found),
    )


def _notes(found: dict[str, float]) -> list[str]:
    def line(name: str, value: str, std: str, scale: float, unit: str) -> str:
        return f"{name} {found[value] * scale:.4g} ± {found[std] * scale:.2g} {unit}".rstrip()

    return [
        line("friction", "sliding_friction", "sliding_friction_std", 1.0, ""),
        line("spring", "spring_constant_n_per_m", "spring_constant_std_n_per_m", 1e-3, "N/mm"),
        line("peak", "peak_force_n", "peak_force_std_n", 1.0, "N"),
        line("ring", "ring_frequency_hz", "ring_frequency_std_hz", 1.0, "Hz"),
        line("decay", "decay_time_s", "decay_time_std_s", 1e3, "ms"),
        line("amplitude", "ring_amplitude_n", "ring_amplitude_std_n", 1.0, "N"),
        line("energy", "vibration_energy_j", "vibration_energy_std_j", 1e6, "uJ"),
    ]
