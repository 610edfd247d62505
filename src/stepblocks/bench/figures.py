"""Figures of chosen trials of a session, with what was fitted drawn in."""

import re
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from stepblocks.bench.examine import Examination, examine_trial
from stepblocks.bench.faults import TraceError
from stepblocks.bench.measure import estimate_tool
from stepblocks.bench.session import open_session
from stepblocks.bench.signal import Array, Tool, Trace
from stepblocks.bench.signal.features import Features, Measurement
from stepblocks.bench.traces import Traces
from stepblocks.bench.traces.split import draw_cuts
from stepblocks.bench.trials import Trial, TrialTable, open_trials
from stepblocks.errors import PipelineError
from stepblocks.files.figures import make_figure_and_axes, save_figure
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.tables import escape_formula

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FIRST = 12  # trials that are drawn where none are named
_SHOWN_CELLS = slice(1, 6)  # of a row of the table of trials, in the title
_BEFORE_RELEASE, _AFTER_RELEASE = 12e-3, 40e-3  # [s] shown of a release
_LINE, _FIT = "#1f4e79", "#c0392b"


class _Note(NamedTuple):
    """A feature that is written beside the curves, with scale and unit in which it is written."""

    label: str
    feature: str
    std: str
    scale: float
    unit: str

    def format_line(self, features: Features) -> str:
        """Return the line of the feature with its standard uncertainty."""
        value = features[self.feature] * self.scale
        std = features[self.std] * self.scale
        return f"{self.label} {value:.4g} ± {std:.2g} {self.unit}".rstrip()


_NOTES = (
    _Note("friction", "sliding_friction", "sliding_friction_std", 1.0, ""),
    _Note("spring", "spring_constant_n_per_m", "spring_constant_std_n_per_m", 1e-3, "N/mm"),
    _Note("peak", "peak_force_n", "peak_force_std_n", 1.0, "N"),
    _Note("ring", "ring_frequency_hz", "ring_frequency_std_hz", 1.0, "Hz"),
    _Note("decay", "decay_time_s", "decay_time_std_s", 1e3, "ms"),
    _Note("amplitude", "ring_amplitude_n", "ring_amplitude_std_n", 1.0, "N"),
    _Note("energy", "vibration_energy_j", "vibration_energy_std_j", 1e6, "uJ"),
)


class _Curve(NamedTuple):
    """A fitted curve: what it is, instants [s] and force [N], each of shape (n,)."""

    name: str
    time: Array
    force: Array


def draw_trials(
    session: str | Path,
    output: str | Path,
    trials: list[str] | None = None,
    tool: Tool | None = None,
    layout: TableLayout = UNDECLARED,
) -> list[Path]:
    """Draw trials of a session, measured or excluded.

    Parameters
    ----------
    session : str or Path
        Folder with a ``session.toml``.
    output : str or Path
        Folder to write to.
    trials : list of str, optional
        Names; the first twelve where omitted.
    tool : Tool, optional
        Its ring; estimated from the session where omitted.
    layout : TableLayout
        As `measure_session` takes it.

    Returns
    -------
    list of Path
        What was drawn. A trial whose trace cannot be read is left out.

    Raises
    ------
    PipelineError
        If a trial is not in the table of trials.
    """
    output = Path(output)
    declared = open_session(session, layout)
    table = open_trials(declared)
    chosen = _find_trials_by_name(table, trials)
    drawn = []
    with Traces(declared) as traces:
        if declared.acquisition.split:
            path = output / "cuts.png"
            drags = traces.drags
            draw_cuts(drags.record, list(drags.cuts.values()), list(drags.cuts), path)
            drawn.append(path)
        tool = tool or estimate_tool(traces, table)
        for trial in chosen:
            with suppress(TraceError):
                examination = examine_trial(traces, trial, tool)
                path = output / _make_figure_file_name(trial)
                _draw_trial_figure(declared.title, trial, examination, path)
                drawn.append(path)
    return drawn


def _find_trials_by_name(table: TrialTable, trial_names: list[str] | None) -> list[Trial]:
    """Return the trials of these names, plain or escaped; the first ones without names."""
    if trial_names is None:
        return list(islice(table, _FIRST))
    missing = set(trial_names)
    chosen = []
    for trial in table:
        known = {trial.name, escape_formula(trial.name)}  # features have escaped names
        if known & set(trial_names):
            chosen.append(trial)
            missing -= known
    if missing:
        raise PipelineError(
            f"trial {min(missing)!r} is not in the table of trials [{table.session.table}]"
        )
    return chosen


def _make_figure_file_name(trial: Trial) -> str:
    """Return the file name of the figure of a trial."""
    name = re.sub(r"[^A-Za-z0-9._-]", "_", trial.name)
    return f"trial-{name}.png"


def _draw_trial_figure(title: str, trial: Trial, examination: Examination, path: Path) -> None:
    """Draw both forces of a trial: the tangential one whole and near the release."""
    trace, measurement = examination.trace, examination.measurement
    figure, (whole, near, normal) = make_figure_and_axes(3, 1, width=11.0, height=8.5)
    cells = list(trial.cells.items())[_SHOWN_CELLS]
    conditions = ", ".join(f"{name} {cell}" for name, cell in cells)
    figure.suptitle(f"{title}: trial {trial.name} ({conditions})", fontsize=11)
    curves = []
    if measurement is None:
        caption = f"excluded: {examination.fault}"
        release = float(trace.time[0])
    else:
        caption = "\n".join(note.format_line(measurement.features) for note in _NOTES)
        release = measurement.start + measurement.peak.time
        curves = list(_iterate_fitted_curves(trace, measurement))
    for axes in (whole, near):
        _draw_tangential_force(axes, trace, curves)
    near.set_xlim(1e3 * (release - _BEFORE_RELEASE), 1e3 * (release + _AFTER_RELEASE))
    near.text(0.99, 0.97, caption, transform=near.transAxes, ha="right", va="top", fontsize=8)
    whole.legend(loc="upper right", fontsize=8, frameon=False)
    normal.plot(1e3 * trace.time, trace.normal, color=_LINE, linewidth=0.6)
    normal.set(xlabel="time / ms", ylabel="normal force / N")
    save_figure(figure, path)


def _draw_tangential_force(axes: "Axes", trace: Trace, curves: list[_Curve]) -> None:
    """Draw the measured tangential force and the curves that were fitted to it."""
    time = 1e3 * trace.time
    axes.plot(time, trace.tangential, ".", color=_LINE, markersize=1.8, label="measured")
    for curve in curves:
        axes.plot(1e3 * curve.time, curve.force, color=_FIT, linewidth=1.1, label=curve.name)
    axes.set_ylabel("tangential force / N")


def _iterate_fitted_curves(trace: Trace, measurement: Measurement) -> Iterator[_Curve]:
    """Yield the curves that were fitted to the tangential force: sliding, ramp and ring."""
    approach, after = measurement.approach, measurement.aftermath
    release = measurement.peak.time
    time = trace.time - measurement.start
    sliding = time[time < approach.onset]
    yield _Curve("sliding", sliding + measurement.start, approach.compute_sliding_curve(sliding))
    ramp = time[(time >= approach.onset) & (time <= release)]
    yield _Curve("ramp", ramp + measurement.start, approach.compute_ramp_line(ramp))
    ringing = time[time >= after.ring.time_zero]
    force = after.ring.compute_curve(ringing)
    hum = np.zeros_like(ringing)  # a damped ring was fitted with its hum
    if not after.rings_freely:
        hum = approach.compute_hum(ringing)
    yield _Curve("ring", ringing + measurement.start, force + hum)
