"""The whole records of a session beside its features: a table of both, and where they differ."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd

from stepblocks.bench.examine import MEASURING_ERRORS, TrialStatus, examine_trial
from stepblocks.bench.faults import TraceError
from stepblocks.bench.measure import check_output, estimate_tool, open_cached_traces
from stepblocks.bench.session import open_session
from stepblocks.bench.signal import Estimate, Tool, Trace
from stepblocks.bench.signal.features import Features, Measurement, compute_energy_features
from stepblocks.bench.signal.whole_record import WholeRecord, fit_whole_record
from stepblocks.bench.traces import Traces
from stepblocks.bench.trials import Trial, open_trials
from stepblocks.compute.cores import count_cores
from stepblocks.compute.processes import run_in_processes
from stepblocks.files.atomic import write_atomically
from stepblocks.files.layout import UNDECLARED, TableLayout

_CHUNK = 16  # trials of one call
_DIFFERS = 3.0  # standard uncertainties of both together, from which they differ
_RAMP = "loading_slope_n_per_s"
# of a quantity: the feature, its uncertainty, and the attribute of a whole record
_QUANTITIES = (
    ("peak_force_n", "peak_force_std_n", "peak_force"),
    (_RAMP, "loading_slope_std_n_per_s", "slope"),
    ("ring_frequency_hz", "ring_frequency_std_hz", "frequency"),
    ("decay_time_s", "decay_time_std_s", "decay_time"),
    ("ring_amplitude_n", "ring_amplitude_std_n", "ring_amplitude"),
)
_WITHOUT_RING = "no ramp and ring that both are recorded"


@dataclass(frozen=True)
class RecordRow:
    """One trial: its whole record beside its features.

    Attributes
    ----------
    trial : str
    reason : str
        Why there is no fit; empty where there is one.
    record : WholeRecord or None
    features : Features
        Empty where the trial was not measured.
    """

    trial: str
    reason: str = ""
    record: WholeRecord | None = None
    features: Features | None = None

    def list_contradicted_features(self) -> list[str]:
        """List the features that the whole record contradicts."""
        if self.record is None or self.features is None:
            return []
        differing = []
        for name, std_name, attribute in _QUANTITIES:
            whole: Estimate = getattr(self.record, attribute)
            spread = math.hypot(whole.std, float(self.features[std_name]))
            if abs(whole.value - float(self.features[name])) > _DIFFERS * spread:
                differing.append(name)
        return differing


@dataclass(frozen=True)
class RecordSummary:
    """What the comparison came to.

    Attributes
    ----------
    total : int
        Trials in the table.
    fitted : int
    differing : int
        Trials of which a feature and the whole record differ.
    shapes : dict[str, int]
        Number of trials by the likeliest shape of their release.
    """

    total: int
    fitted: int
    differing: int
    shapes: dict[str, int]


def write_whole_record_comparison(
    session: str | Path,
    output: str | Path,
    jobs: int | None = None,
    layout: TableLayout = UNDECLARED,
) -> RecordSummary:
    """Fit the whole record of every trial, and write it beside the features.

    Parameters
    ----------
    session : str or Path
        Folder with a ``session.toml``; it is only read.
    output : str or Path
        CSV file.
    jobs : int, optional
        Processes; as many as cores where omitted.
    layout : TableLayout
        How the table of trials and traces in text are written.

    Raises
    ------
    BenchError
        If the session as a whole cannot be read.
    PipelineError
        If the output is a folder or would replace a file of the session.
    """
    folder = Path(session)
    check_output(folder, Path(output))
    rows = fit_session_records(folder, jobs, layout)
    write_record_rows(rows, Path(output))
    shapes: dict[str, int] = {}
    differing = 0
    for row in rows:
        if row.record is not None:
            shapes[row.record.shape] = shapes.get(row.record.shape, 0) + 1
        if row.list_contradicted_features():
            differing += 1
    return RecordSummary(
        total=len(rows),
        fitted=sum(shapes.values()),
        differing=differing,
        shapes={str(shape): count for shape, count in sorted(shapes.items())},
    )


def fit_session_records(
    folder: Path,
    jobs: int | None = None,
    layout: TableLayout = UNDECLARED,
    tool: Tool | None = None,
) -> list[RecordRow]:
    """Fit the whole record of every trial of a session, in the order of its table.

    `tool` is its ring, estimated from the session where omitted.
    """
    table = open_trials(open_session(folder, layout))
    if tool is None:
        with Traces(table.session) as traces:
            tool = estimate_tool(traces, table)
    trials = iter(table)
    chunks = list(iter(lambda: tuple(islice(trials, _CHUNK)), ()))
    calls = [(folder, layout, tool, chunk) for chunk in chunks]
    rows: list[RecordRow] = []
    for done in run_in_processes(fit_whole_records, calls, jobs or count_cores()):
        rows += done
    return rows


def replace_features_by_whole_records(
    features: pd.DataFrame, rows: Sequence[RecordRow], spring_constant: float
) -> pd.DataFrame:
    """Return a table of features in which peak, ring and energy are those of the whole records.

    A trial whose record was not fitted keeps its features, and so does one whose peak force is
    only a bound. The ramp before the stretch that was fitted, and what it tells of the spring,
    stay as they are.

    Parameters
    ----------
    features : DataFrame
        As `measure_session` returns it.
    rows : sequence of RecordRow
        Of the same session.
    spring_constant : float
        Of the probe [N/m], which turns an amplitude into an energy.
    """
    replaced = features.copy()
    bounded = ~np.isfinite(features["peak_force_std_n"].to_numpy(dtype=np.float64))
    bounded_trials = set(features["trial"].astype(str)[bounded])
    places = dict(zip(features["trial"].astype(str), features.index, strict=True))
    for row in rows:
        if row.record is None or row.trial in bounded_trials or row.trial not in places:
            continue
        for name, value in _list_record_features(row.record, spring_constant).items():
            replaced.loc[places[row.trial], name] = value
    return replaced


def _list_record_features(record: WholeRecord, spring_constant: float) -> dict[str, float]:
    """Return the quantities of a whole record by their feature columns, with the energy [SI]."""
    cells: dict[str, float] = {}
    for name, std_name, attribute in _QUANTITIES:
        if name == _RAMP:
            continue
        estimate: Estimate = getattr(record, attribute)
        cells |= {name: estimate.value, std_name: estimate.std}
    return cells | compute_energy_features(record.ring_amplitude, spring_constant)


def fit_whole_records(
    folder: Path, layout: TableLayout, tool: Tool | None, trials: Sequence[Trial]
) -> list[RecordRow]:
    """Fit the whole records of some trials of a session."""
    traces = open_cached_traces(folder, layout)
    return [_fit_whole_record_of_trial(traces, tool, trial) for trial in trials]


def _fit_whole_record_of_trial(traces: Traces, tool: Tool | None, trial: Trial) -> RecordRow:
    """Fit the whole record of one trial, beginning where its features are."""
    if trial.fault is not None:
        return RecordRow(trial.name, str(trial.fault))
    try:
        examination = examine_trial(traces, trial, tool)
    except TraceError as error:
        return RecordRow(trial.name, str(error.fault))
    if examination.measurement is None:
        return RecordRow(trial.name, str(examination.fault))
    features = examination.measurement.features
    trace = _subtract_mains_hum(examination.trace, examination.measurement)
    ring = Tool(float(features["ring_frequency_hz"]), float(features["decay_time_s"]))
    if not (math.isfinite(ring.frequency) and math.isfinite(ring.decay_time)):
        return RecordRow(trial.name, _WITHOUT_RING, features=features)
    try:
        record = fit_whole_record(
            trace,
            float(features["loading_onset_s"]),
            float(features["release_time_s"]),
            ring,
        )
    except MEASURING_ERRORS as error:
        return RecordRow(trial.name, str(error), features=features)
    reason = _WITHOUT_RING if record is None else ""
    return RecordRow(trial.name, reason, record, features)


def _subtract_mains_hum(trace: Trace, measurement: Measurement) -> Trace:
    """Take the hum that the approach shows out of the tangential force."""
    hum = measurement.approach.compute_hum(trace.time - measurement.start)
    return replace(trace, tangential=trace.tangential - hum)


def write_record_rows(rows: Sequence[RecordRow], path: Path) -> None:
    """Write the table: each quantity from the whole record, then from the features."""
    columns = ["trial", "status", "reason", "release_shape", "release_shape_probability"]
    columns += ["fall_time_s", "release_time_s", "release_time_std_s", "noise_n"]
    for name, std_name, _ in _QUANTITIES:
        columns += [name, std_name, f"features_{name}", f"features_{std_name}"]
    columns.append("differs")
    with (
        write_atomically(path) as draft,
        draft.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.DictWriter(file, columns, lineterminator="\n", restval="")
        writer.writeheader()
        for row in rows:
            writer.writerow(_make_row_cells(row))


def _make_row_cells(row: RecordRow) -> dict[str, object]:
    """Describe one trial as cells of the table."""
    record = row.record
    status = TrialStatus.EXCLUDED if record is None else TrialStatus.OK
    cells: dict[str, object] = {"trial": row.trial, "status": status.value, "reason": row.reason}
    if record is not None:
        cells |= {
            "release_shape": str(record.shape),
            "release_shape_probability": record.probability,
            "fall_time_s": record.fall_time,
            "release_time_s": record.release_time.value,
            "release_time_std_s": record.release_time.std,
            "noise_n": record.noise,
            "differs": " ".join(row.list_contradicted_features()),
        }
    for name, std_name, attribute in _QUANTITIES:
        if record is not None:
            whole: Estimate = getattr(record, attribute)
            cells |= {name: whole.value, std_name: whole.std}
        if row.features is not None:
            cells |= {
                f"features_{name}": row.features[name],
                f"features_{std_name}": row.features[std_name],
            }
    return cells
