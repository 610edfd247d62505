"""One trial: its trace read, screened and measured."""

from dataclasses import dataclass, field
from enum import Enum
from hashlib import blake2b

import numpy as np

from stepblocks.bench.faults import FaultError, LandmarkError, TraceError, TrialFault
from stepblocks.bench.signal import Tool, Trace
from stepblocks.bench.signal.features import (
    Features,
    Measurement,
    measure_censored_trace,
    measure_trace,
)
from stepblocks.bench.signal.screening import find_trace_fault
from stepblocks.bench.traces import Traces
from stepblocks.bench.trials import Trial

_DIGEST_BYTES = 7  # of a trace; they fit the unsigned integers of `LabelCheck`

# what the fits raise where a record is unlike any trial
MEASURING_ERRORS = (FaultError, ValueError, np.linalg.LinAlgError)


class TrialStatus(Enum):
    """What the table of features says of a trial."""

    OK = "ok"
    FLAGGED = "flagged"  # measured, but unlike its label
    CENSORED = "censored"  # saturated or locked: the peak force is a lower bound
    EXCLUDED = "excluded"  # not measured


@dataclass(frozen=True)
class TrialResult:
    """What became of one trial.

    Attributes
    ----------
    trial : Trial
    fault : TrialFault or None
        Why it is excluded or censored; None where it was measured whole.
    features : Features
        Empty where it is excluded.
    digest : int
        Two traces share it only if they have the same samples.
    """

    trial: Trial
    fault: TrialFault | None = None
    features: Features = field(default_factory=dict)
    digest: int = 0

    @property
    def status(self) -> TrialStatus:
        """What the table of features says of it."""
        if self.fault is None:
            return TrialStatus.OK
        if self.features:
            return TrialStatus.CENSORED
        return TrialStatus.EXCLUDED


@dataclass(frozen=True)
class Examination:
    """A trace with what was measured of it, or why it could not be measured.

    Attributes
    ----------
    trace : Trace
    measurement : Measurement or None
    fault : TrialFault or None
    """

    trace: Trace
    measurement: Measurement | None = None
    fault: TrialFault | None = None


def examine_trial(traces: Traces, trial: Trial, tool: Tool | None) -> Examination:
    """Read, screen and measure one trace.

    Parameters
    ----------
    traces : Traces
        Traces of the session, open for reading.
    trial : Trial
    tool : Tool or None
        Frequency [Hz] and decay time [s] of its ring, where they are known.

    Raises
    ------
    TraceError
        If the trial has no trace that can be read.
    """
    session = traces.session
    acquisition = session.acquisition
    trace = traces.read(trial.record or trial.name)
    fault = find_trace_fault(trace, acquisition.sample_rate, acquisition.range)
    if fault is not None:
        return Examination(trace, fault=fault)
    try:
        measurement = measure_trace(trace, session.probe.spring_constant, trial.speed, tool)
    except LandmarkError as error:
        return Examination(trace, fault=error.fault)
    return Examination(trace, measurement)


def measure_trial(traces: Traces, trial: Trial, tool: Tool | None = None) -> TrialResult:
    """Read, screen and measure one trial; what is wrong with it is part of the result."""
    if trial.fault is not None:
        return TrialResult(trial, trial.fault)
    try:
        examination = examine_trial(traces, trial, tool)
    except TraceError as error:
        return TrialResult(trial, _join_fault_lines(error.fault))
    if examination.measurement is not None:
        digest = _compute_force_digest(examination.trace)
        return TrialResult(trial, None, examination.measurement.features, digest)
    fault = examination.fault
    if fault is None or fault.bound is None:
        return TrialResult(trial, fault)
    spring_constant = traces.session.probe.spring_constant
    features = measure_censored_trace(examination.trace, spring_constant, trial.speed, fault.bound)
    return TrialResult(trial, fault, features)


def _join_fault_lines(fault: TrialFault) -> TrialFault:
    """Return the same fault; the messages of libraries may have several lines."""
    return TrialFault(fault.kind, " ".join(fault.details.split()), fault.bound)


def _compute_force_digest(trace: Trace) -> int:
    """Hash the samples of both forces to an integer."""
    samples = trace.tangential.tobytes() + trace.normal.tobytes()
    digest = blake2b(samples, digest_size=_DIGEST_BYTES)
    return int.from_bytes(digest.digest())
