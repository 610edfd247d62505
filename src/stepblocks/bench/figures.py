"""Figures of chosen trials of a session, with what was fitted drawn in."""

from __future__ import annotations

import re
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.atomic import beside
from stepblocks.bench.measure import examine, pilot
from stepblocks.bench.session import open_session
from stepblocks.bench.signal import Trace, TraceError
from stepblocks.bench.signal.features import Measurement
from stepblocks.bench.signal.ring import Ring
from stepblocks.bench.traces import Traces
from stepblocks.bench.traces.split import draw_cuts
from stepblocks.bench.trials import Trial, open_trials
from stepblocks.errors import PipelineError

_FIRST = 12  # trials that are drawn where none are named
_LINE, _FIT, _SECOND, _FAINT = "#1f4e79", "#c0392b", "#7f8c8d", "#b0b7bd"
# each feature that is told beside the curves, with its standard uncertainty, the scale and unit to tell it in
_NOTES = (
    ("friction", "sliding_friction", "sliding_friction_std", 1.0, ""),
    ("spring", "spring_constant_n_per_m", "spring_constant_std_n_per_m", 1e-3, "N/mm"),
    ("peak", "peak_force_n", "peak_force_std_n", 1.0, "N"),
    ("ring", "ring_frequency_hz", "ring_frequency_std_hz", 1.0, "Hz"),
    ("decay", "decay_time_s", "decay_time_std_s", 1e3, "ms"),
    ("amplitude", "ring_amplitude_n", "ring_amplitude_std_n", 1.0, "N"),
    ("energy", "vibration_energy_j", "vibration_energy_std_j", 1e6, "uJ"),
)


def draw_trials(session: str | Path, output: str | Path, trials: list[str] | None = None) -> list[Path]:
    """Draw trials of a session, measured or excluded, the first twelve where none are named; return what was drawn."""
    output, declared = Path(output), open_session(session)
    table = open_trials(declared)
    chosen = list(islice(table, _FIRST)) if trials is None else [trial for trial in table if trial.name in trials]
    missing = sorted(set(trials or ()) - {trial.name for trial in chosen})
    if missing:
        raise PipelineError(f"trial {missing[0]!r} is not in the table of trials [{declared.table}]")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PipelineError(f"folder for figures cannot be made: {error.strerror} [{output}]") from error
    drawn = []
    with Traces(declared) as traces:
        if declared.acquisition.split:
            drawn.append(output / "cuts.png")
            draw_cuts(traces.drags[0], list(traces.drags[1].values()), list(traces.drags[1]), drawn[-1])
        tool = pilot(traces, table)
        for trial in chosen:
            with suppress(TraceError):
                examined = examine(traces, trial, tool)
                drawn.append(output / f"trial-{re.sub(r'[^A-Za-z0-9._-]', '_', trial.name)}.png")
                _draw(declared.title, trial, examined, drawn[-1])
    return drawn


def _draw(title: str, trial: Trial, examined: tuple[Trace, Measurement | None, str], path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    trace, measured, reason = examined
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    whole, near, normal = figure.subplots(3, 1, height_ratios=[2.0, 2.6, 1.0])
    conditions = ", ".join(f"{name} {cell}" for name, cell in list(trial.cells.items())[1:6])
    figure.suptitle(f"{title}: trial {trial.name} ({conditions})", fontsize=11)
    for axes in (whole, near):
        axes.plot(1e3 * trace.time, trace.tangential, ".", color=_LINE, markersize=1.8, label="measured")
        if measured is not None:
            _draw_fit(axes, trace, measured)
        axes.set_ylabel("tangential force / N")
    release, told = float(trace.time[0]), f"excluded: {reason}"
    if measured is not None:
        release, seen = release + measured.peak.time, measured.features
        notes = (f"{name} {seen[of] * by:.4g} ± {seen[std] * by:.2g} {unit}" for name, of, std, by, unit in _NOTES)
        told = "\n".join(note.rstrip() for note in notes)
    near.set_xlim(1e3 * (release - 12e-3), 1e3 * (release + 40e-3))
    box = {"facecolor": "white", "edgecolor": _FAINT, "alpha": 0.9}
    near.text(0.99, 0.97, told, transform=near.transAxes, ha="right", va="top", fontsize=8, bbox=box)
    whole.legend(loc="upper right", fontsize=8, frameon=False)
    normal.plot(1e3 * trace.time, trace.normal, color=_LINE, linewidth=0.6)
    normal.set_ylabel("normal force / N")
    normal.set_xlabel("time / ms")
    with beside(path) as draft:
        figure.savefig(draft, format="png", dpi=130, metadata={"Software": None})


def _draw_fit(axes: Any, trace: Trace, measured: Measurement) -> None:
    start = float(trace.time[0])
    time = trace.time - start
    approach, after, peak, ring = measured.approach, measured.aftermath, measured.peak, measured.aftermath.ring
    ringing = time >= after.ring.origin
    fitted = ring.curve(time[ringing])
    if isinstance(ring, Ring):
        # the levels of a rubbing ring change with every half cycle; it has no one envelope
        since = time[time >= after.start] - after.start
        size = after.amplitude[0] * np.exp(-since / after.decay_time[0])
        for sign in (1.0, -1.0):
            instants, edge = 1e3 * (after.start + since + start), after.level[0] + sign * size
            axes.plot(instants, edge, color=_SECOND, linewidth=0.9, linestyle="--")
    else:
        fitted = fitted + approach.hum(time[ringing])
    slide, ramp = time < approach.onset, (time >= approach.onset) & (time <= peak.time)
    curves = (
        ("sliding", slide, approach.sliding(time)[slide], "-"),
        ("ramp", ramp, approach.line(time[ramp]), "-."),
        (f"{after.kind} ring", ringing, fitted, "-"),
    )
    for name, where, force, style in curves:
        axes.plot(1e3 * trace.time[where], force, color=_FIT, linewidth=1.1, linestyle=style, label=name)
    for name, at, height in (("onset", approach.onset, approach.level), ("release", peak.time, peak.force)):
        axes.plot([1e3 * (at + start)], [height], marker="o", color=_FIT, markersize=4, fillstyle="none")
        axes.annotate(name, (1e3 * (at + start), height), textcoords="offset points", xytext=(5, 4), fontsize=8)
