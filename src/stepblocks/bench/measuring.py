"""One trial from its row to its features, or to the reason why it has none."""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import blake2b
from itertools import islice

from stepblocks.bench.session import Session
from stepblocks.bench.signal.features import Measurement, measure_trace, tool_of
from stepblocks.bench.signal.landmarks import LandmarkError
from stepblocks.bench.signal.screening import screen_trace
from stepblocks.bench.sources import TraceError, TraceSource, read_trace
from stepblocks.bench.trace import Trace, Trial
from stepblocks.bench.trial_table import TrialTable

_PILOTS = 16


@dataclass(frozen=True)
class TrialResult:
    """What became of one trial."""

    trial: Trial  # Its row
    reason: str = ""  # Why it is excluded; empty where it was measured
    features: dict[str, float] = field(default_factory=dict)  # Its features; empty where it is excluded
    digest: int = 0  # Identifies the samples of its trace; 0 where there is none


def trace_digest(trace: Trace) -> int:
    """Return a number that two traces share only if they have the same samples."""
    digest = blake2b(trace.tangential.tobytes(), digest_size=7)
    digest.update(trace.normal.tobytes())
    return int.from_bytes(digest.digest())


def measure_trial(
    session: Session, source: TraceSource, trial: Trial, tool: tuple[float, float] | None = None
) -> TrialResult:
    """Read, screen and measure one trial."""
    if trial.fault:
        return TrialResult(trial, trial.fault)
    try:
        trace = read_trace(source, session, trial.name)
        reason = screen_trace(trace, session.acquisition.sample_rate, session.acquisition.range)
        if reason:
            return TrialResult(trial, reason)
        measured: Measurement = measure_trace(trace, session.probe.spring_constant, trial.speed, tool)
    except (TraceError, LandmarkError) as fault:
        return TrialResult(trial, " ".join(str(fault).split()))
    return TrialResult(trial, "", measured.features, trace_digest(trace))


def pilot(session: Session, source: TraceSource, table: TrialTable) -> tuple[float, float] | None:
    """Learn the tool's frequency [Hz] and decay time [s] from trials spread evenly over the session.

    Which trials depends on their number alone, so that every run and any number of workers measure alike.
    """
    stride = max(table.count // _PILOTS, 1)
    chosen = (trial for trial in table if (trial.row - 1) % stride == 0)
    results = (measure_trial(session, source, trial) for trial in islice(chosen, _PILOTS))
    return tool_of(result.features for result in results if not result.reason)
