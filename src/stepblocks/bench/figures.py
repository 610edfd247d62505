"""Figures of chosen trials of a session, with what was fitted drawn in."""

import re
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

from stepblocks.bench.measure import estimate_tool, measure_or_refuse
from stepblocks.bench.session import open_session
from stepblocks.bench.signal import Array, Tool, Trace, TraceError
from stepblocks.bench.signal.features import Measurement
from stepblocks.bench.traces import Traces
from stepblocks.bench.traces.split import draw_cuts
from stepblocks.bench.trials import Trial, open_trials
from stepblocks.errors import PipelineError
from stepblocks.files.figures import make_figure, save_figure
from stepblocks.files.tables import escape_formula

_FIRST = 12  # trials that are drawn where none are named
_LINE, _FIT = "#1f4e79", "#c0392b"
# each feature that is told beside the curves, with its standard uncertainty, the scale and unit to
# tell it in
_NOTES = (
    ("friction", "sliding_friction", "sliding_friction_std", 1.0, ""),
    ("spring", "spring_constant_n_per_m", "spring_constant_std_n_per_m", 1e-3, "N/mm"),
    ("peak", "peak_force_n", "peak_force_std_n", 1.0, "N"),
    ("ring", "ring_frequency_hz", "ring_frequency_std_hz", 1.0, "Hz"),
    ("decay", "decay_time_s", "decay_time_std_s", 1e3, "ms"),
    ("amplitude", "ring_amplitude_n", "ring_amplitude_std_n", 1.0, "N"),
    ("energy", "vibration_energy_j", "vibration_energy_std_j", 1e6, "uJ"),
)


def draw_trials(
    session: str | Path,
    output: str | Path,
    trials: list[str] | None = None,
    tool: Tool | None = None,
) -> list[Path]:
    """Draw trials of a session, measured or excluded, the first twelve where none are named.

    Return what was drawn. The tool is estimated from the session where it is omitted.
    """
    output = Path(output)
    declared = open_session(session)
    table = open_trials(declared)
    chosen = (
        list(islice(table, _FIRST))
        if trials is None
        # features have escaped names
        else [trial for trial in table if {trial.name, escape_formula(trial.name)} & set(trials)]
    )
    known = {name for trial in chosen for name in (trial.name, escape_formula(trial.name))}
    if missing := sorted(set(trials or ()) - known):
        raise PipelineError(
            f"trial {missing[0]!r} is not in the table of trials [{declared.table}]"
        )
    drawn = []
    with Traces(declared) as traces:
        if declared.acquisition.split:
            drawn.append(output / "cuts.png")
            draw_cuts(
                traces.drags[0], list(traces.drags[1].values()), list(traces.drags[1]), drawn[-1]
            )
        tool = tool or estimate_tool(traces, table)
        for trial in chosen:
            with suppress(TraceError):
                examined = measure_or_refuse(traces, trial, tool)
                drawn.append(output / f"trial-{re.sub(r'[^A-Za-z0-9._-]', '_', trial.name)}.png")
                _draw(declared.title, trial, examined, drawn[-1])
    return drawn


def _draw(
    title: str, trial: Trial, examined: tuple[Trace, Measurement | None, str], path: Path
) -> None:
    trace, measured, reason = examined
    figure, (whole, near, normal) = make_figure(3, 1, width=11.0, height=8.5)
    conditions = ", ".join(f"{name} {cell}" for name, cell in list(trial.cells.items())[1:6])
    figure.suptitle(f"{title}: trial {trial.name} ({conditions})", fontsize=11)
    time = 1e3 * trace.time
    release = float(trace.time[0])
    caption = f"excluded: {reason}"
    if measured is not None:
        release = measured.start + measured.peak.time
        seen = measured.features
        caption = "\n".join(
            f"{name} {seen[of] * by:.4g} ± {seen[std] * by:.2g} {unit}".rstrip()
            for name, of, std, by, unit in _NOTES
        )
    for axes in (whole, near):
        axes.plot(time, trace.tangential, ".", color=_LINE, markersize=1.8, label="measured")
        if measured is not None:
            for name, instants, force in _compute_curves(trace, measured):
                axes.plot(1e3 * instants, force, color=_FIT, linewidth=1.1, label=name)
        axes.set_ylabel("tangential force / N")
    near.set_xlim(1e3 * (release - 12e-3), 1e3 * (release + 40e-3))
    near.text(0.99, 0.97, caption, transform=near.transAxes, ha="right", va="top", fontsize=8)
    whole.legend(loc="upper right", fontsize=8, frameon=False)
    normal.plot(time, trace.normal, color=_LINE, linewidth=0.6)
    normal.set(xlabel="time / ms", ylabel="normal force / N")
    save_figure(figure, path)


def _compute_curves(trace: Trace, measured: Measurement) -> Iterator[tuple[str, Array, Array]]:
    # Name, instants and force of what was fitted
    approach, after, release = measured.approach, measured.aftermath, measured.peak.time
    time = trace.time - measured.start
    slide, ramp = time[time < approach.onset], time[(time >= approach.onset) & (time <= release)]
    yield "sliding", slide + measured.start, approach.sliding(slide)
    yield "ramp", ramp + measured.start, approach.line(ramp)
    ringing = time[time >= after.ring.origin]
    # a damped ring was fitted with its hum
    rest = 0.0 * ringing if after.damped else approach.hum(ringing)
    yield "ring", ringing + measured.start, after.ring.curve(ringing) + rest
