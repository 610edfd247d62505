"""What some traces of a session say of its declaration, before it is measured as a whole."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from stepblocks.bench.declared import USUAL_RING
from stepblocks.bench.examine import TrialResult
from stepblocks.bench.faults import TraceError
from stepblocks.bench.measure import (
    Progress,
    check_output,
    check_pilots_against_session,
    measure_pilots,
)
from stepblocks.bench.session import Session, open_session
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.screening import RATE_TOLERANCE, compute_sample_rate
from stepblocks.bench.traces import Traces
from stepblocks.bench.trials import open_trials
from stepblocks.errors import BenchError
from stepblocks.files.atomic import replace_text
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.loop.calibration_check import (
    check_declared_quantity,
    compute_declared_ratio_and_std,
)
from stepblocks.loop.declared_checks import CalibrationCheck, Declared, RateCheck, SessionCheck
from stepblocks.loop.record import SCHEMA, convert_to_json_values, format_json_document
from stepblocks.loop.session_table import estimate_unloaded_zeros

_FEWEST_SAMPLES = 2  # of a record that has a rate
_FEWEST_RINGS = 3  # trials that must have rung before anything is said of the ring


def check_session(
    session: str | Path,
    output: str | Path | None = None,
    *,
    layout: TableLayout = UNDECLARED,
    progress: Progress | None = None,
) -> SessionCheck:
    """Hold some trials of a session against what it declares.

    The same trials are measured that every run over the session begins with.

    Parameters
    ----------
    session : str or Path
        Folder with a ``session.toml``; it is only read.
    output : str or Path, optional
        File that the result is also written to, JSON.
    layout : TableLayout
        How the table of trials and traces in text are written.
    progress : callable, optional
        Called after each trial with the number of trials that are done and the number of all.

    Returns
    -------
    SessionCheck
        What is shown over what is declared, with 95 % intervals, and the likely slip where they
        contradict each other.

    Raises
    ------
    BenchError
        If the session as a whole cannot be read.
    PipelineError
        If the output cannot be written.
    """
    if output is not None:
        check_output(Path(session), Path(output))
    check = _compare_traces_with_declaration(Path(session), layout, progress)
    if output is not None:
        document = {"schema": SCHEMA, **convert_to_json_values(check)}
        replace_text(Path(output), format_json_document(document))
    return check


def _compare_traces_with_declaration(
    session: Path, layout: TableLayout, progress: Progress | None
) -> SessionCheck:
    """Measure some trials of a session, and hold them against what it declares."""
    declared = open_session(session, layout)
    digest = hashlib.sha256((session / "session.toml").read_bytes()).hexdigest()
    table = open_trials(declared)
    slip = ""
    with _ClockedTraces(declared) as traces:
        results = measure_pilots(traces, table, progress)
        rate = _check_sample_rate(traces, results)
        try:
            check_pilots_against_session(traces, results)
        except BenchError as error:
            slip = str(error)
    measured, faults = [], []
    for result in results:
        if result.fault is None:
            measured.append(result)
        else:
            faults.append(result.fault)
    ring = _find_ring_frequency(measured)
    lowest, highest = USUAL_RING
    reason = ""
    if faults:
        reason = str(faults[0])
    return SessionCheck(
        looked_at=len(results),
        measured=len(measured),
        reason=reason,
        spring_constant=declared.probe.spring_constant,
        spring=_compare_quantity_with_declaration(Declared.SPRING, declared, measured),
        load=_compare_quantity_with_declaration(Declared.LOAD, declared, measured),
        rate=rate,
        ring_frequency=ring,
        rings_as_usual=ring is not None and lowest <= ring <= highest,
        slip=slip,
        digest=digest,
    )


def _compare_quantity_with_declaration(
    quantity: Declared, declared: Session, measured: Sequence[TrialResult]
) -> CalibrationCheck | None:
    """Hold what measured trials show of one quantity against the session; None of too few."""
    if not measured:
        return None
    spring_constant = declared.probe.spring_constant
    features = pd.DataFrame([result.features for result in measured])
    loads = np.array([result.trial.load for result in measured])
    known = {**estimate_unloaded_zeros(features), **declared.calibration.list_known_constants()}
    shown = _get_feature_values(measured, "normal_load_n") / loads
    if quantity is Declared.SPRING:
        shown = _get_feature_values(measured, "spring_constant_n_per_m") / spring_constant
    value = compute_declared_ratio_and_std(
        quantity, known, spring_constant, float(np.median(loads))
    )
    return check_declared_quantity(quantity, shown, value)


def _get_feature_values(measured: Sequence[TrialResult], feature: str) -> Floats:
    """Read one feature of measured trials, of shape (n,)."""
    return np.array([result.features[feature] for result in measured], dtype=np.float64)


class _ClockedTraces(Traces):
    """Traces that keep the rate of each record that was read, so that none is read twice for it."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._rates: dict[str, float] = {}  # of records that have one [Hz]

    def read(self, trial: str) -> Trace:
        """Read one trace in SI, and keep its rate."""
        trace = super().read(trial)
        if trace.time.size >= _FEWEST_SAMPLES:
            self._rates[trial] = compute_sample_rate(trace.time)
        return trace

    def get_sample_rate(self, trial: str) -> float | None:
        """Return the rate of a trace [Hz]; None where it has none or cannot be read."""
        if trial not in self._rates:
            try:
                self.read(trial)
            except TraceError:
                return None
        return self._rates.get(trial)


def _check_sample_rate(traces: _ClockedTraces, results: Sequence[TrialResult]) -> RateCheck | None:
    """Hold the clock of the traces against the declared rate; None where they have no clock."""
    acquisition = traces.session.acquisition
    if acquisition.channels.time is None:
        return None
    ratios = []
    for result in results:
        rate = traces.get_sample_rate(result.trial.record or result.trial.name)
        if rate is not None:
            ratios.append(rate / acquisition.sample_rate)
    if not ratios:
        return None
    shown = float(np.median(ratios))
    contradicts = abs(shown - 1.0) > RATE_TOLERANCE
    return RateCheck(acquisition.sample_rate, shown, min(ratios), max(ratios), contradicts)


def _find_ring_frequency(measured: Sequence[TrialResult]) -> float | None:
    """Find the frequency at which the tool rings [Hz]; None where too few trials rang."""
    rings = _get_feature_values(measured, "ring_frequency_hz")
    rings = rings[np.isfinite(rings)]
    if rings.size < _FEWEST_RINGS:
        return None
    return float(np.median(rings))
