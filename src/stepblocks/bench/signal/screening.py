"""Whether a trace can be measured at all: its samples, its clock, and the range of its gauges."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.faults import Bound, FaultKind, TrialFault
from stepblocks.bench.signal import Array, Trace

_FEWEST_SAMPLES = 200
RATE_TOLERANCE = 0.01  # share by which clock and declared rate may differ
_GAP_STEPS = 1.6  # a step of the clock this many times the usual one is a gap
_FLAT_SAMPLES = 4  # equal samples in a row at the extreme of a record that was still moving
# steps of the converter, or of the noise from sample to sample, that the movement would have made
# meanwhile
_FLAT_STEPS = 7.0
_LOWEST_RATE = 1500.0  # [Hz] five samples per cycle of a ring at 300 Hz
_SHORTEST = 1e-300  # duration of a sample that a rate is computed of [s]


def find_trace_fault(
    trace: Trace, sample_rate: float, force_limit: float | None = None
) -> TrialFault | None:
    """Find what makes a trace unusable.

    Parameters
    ----------
    trace : Trace
    sample_rate : float
        As declared [Hz].
    force_limit : float, optional
        Force at which the gauges saturate [N].

    Returns
    -------
    TrialFault or None
        The first fault; None where the trace can be measured.
    """
    fault = _find_sample_fault(trace)
    if fault is None:
        fault = _find_clock_fault(trace.time, sample_rate)
    if fault is None:
        fault = _find_dead_channel_fault(trace)
    if fault is None:
        fault = _find_saturation_fault("tangential", trace.tangential, force_limit)
    if fault is None:
        fault = _find_saturation_fault("normal", trace.normal, force_limit)
    return fault


def has_ascending_time(trace: Trace) -> bool:
    """Tell whether each sample of a trace lies after the one before it."""
    return bool(np.all(np.diff(trace.time) > 0.0))


def compute_sample_rate(time: Array) -> float:
    """Return the samples per second [Hz] of instants [s] of shape (n,), n at least 2."""
    duration = time[-1] - time[0]
    mean_step = float(duration / (time.size - 1))
    return 1.0 / max(mean_step, _SHORTEST)


def _find_sample_fault(trace: Trace) -> TrialFault | None:
    """Find too few samples, or samples that are not finite numbers."""
    count = trace.time.size
    if count == 0:
        return TrialFault(FaultKind.TRUNCATED, "the trace is empty")
    if count < _FEWEST_SAMPLES:
        details = f"{count} samples are too few (at least {_FEWEST_SAMPLES})"
        return TrialFault(FaultKind.TRUNCATED, details)
    for name, values in vars(trace).items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            details = (
                f"{bad.size} of {count} samples of the {name} channel, the first is sample "
                f"{int(bad[0]) + 1}"
            )
            return TrialFault(FaultKind.NOT_A_NUMBER, details)
    return None


def _find_clock_fault(time: Array, sample_rate: float) -> TrialFault | None:
    """Find a clock that stands still, goes back, has gaps, or another rate [Hz] than declared."""
    steps = np.diff(time)
    first_back = int(np.argmax(steps <= 0.0))
    if steps[first_back] <= 0.0:
        details = f"time does not ascend after {time[first_back]:.6g} s"
        return TrialFault(FaultKind.WRONG_CLOCK, details)
    widest = int(np.argmax(steps))
    if steps[widest] > _GAP_STEPS * float(np.median(steps)):
        gap = steps[widest] * 1e3
        details = f"{gap:.3g} ms without samples after {time[widest]:.6g} s"
        return TrialFault(FaultKind.GAP, details)
    rate = compute_sample_rate(time)
    if abs(rate / sample_rate - 1.0) > RATE_TOLERANCE:
        details = f"{rate:.6g} Hz, where {sample_rate:.6g} Hz are declared"
        return TrialFault(FaultKind.WRONG_RATE, details)
    if rate < _LOWEST_RATE:
        details = f"{rate:.6g} Hz cannot show a ring, at least {_LOWEST_RATE:.0f} Hz are needed"
        return TrialFault(FaultKind.WRONG_RATE, details)
    return None


def _find_dead_channel_fault(trace: Trace) -> TrialFault | None:
    """Find a gauge that shows nothing; an ideal one shows a weight as one number throughout."""
    if float(np.ptp(trace.tangential)) == 0.0:
        details = f"the tangential force is {trace.tangential[0]:.4g} N throughout"
        return TrialFault(FaultKind.DEAD_CHANNEL, details)
    if not np.any(trace.normal):
        return TrialFault(FaultKind.DEAD_CHANNEL, "the normal force is 0 throughout")
    return None


def _find_saturation_fault(
    channel_name: str, force: Array, force_limit: float | None
) -> TrialFault | None:
    """Find a force [N] at the declared limit, or one that stands at its extreme while it moves."""
    at_top = Bound.PEAK_FORCE
    at_bottom = Bound.RING
    if channel_name == "normal":
        at_top = at_bottom = Bound.NORMAL_FORCE
    if force_limit is not None and float(np.abs(force).max()) >= force_limit:
        details = f"the {channel_name} force reaches the range of {force_limit:g} N"
        return TrialFault(FaultKind.SATURATED, details, at_top)
    run = _find_flat_top_run(force)
    if run is not None:
        details = _describe_flat_run(run, f"highest {channel_name}", float(force.max()))
        return TrialFault(FaultKind.SATURATED, details, at_top)
    run = _find_flat_top_run(-1.0 * force)
    if run is not None:
        details = _describe_flat_run(run, f"lowest {channel_name}", float(force.min()))
        return TrialFault(FaultKind.SATURATED, details, at_bottom)
    return None


def _describe_flat_run(run: "_FlatRun", extreme: str, force: float) -> str:
    """Say how many samples stand at an extreme force [N], the highest or the lowest."""
    return f"{run.length} samples in a row at the {extreme} force, {force:.4g} N"


class _FlatRun(NamedTuple):
    """Samples in a row: the number of them, and the first."""

    length: int
    start: int


def _find_flat_top_run(force: Array) -> _FlatRun | None:
    """Find samples in a row at the highest value, to which the record was still moving."""
    moves = np.abs(np.diff(force))
    step = float(np.min(moves, where=moves > 0.0, initial=np.inf))
    top = float(force.max())
    run = _find_longest_run(force >= top)
    if run.length < _FLAT_SAMPLES or run.start < _FLAT_SAMPLES:
        return None
    # noise may touch the top before it stays there: a stretch twice as long tells how far the
    # force had still to go
    least_move = _FLAT_STEPS * (step + float(np.mean(moves[: run.start])))
    before = force[max(run.start - 2 * run.length, 0) : run.start]
    if top - float(np.median(before)) > least_move:
        return run
    return None


def _find_longest_run(mask: NDArray[np.bool_]) -> _FlatRun:
    """Find the longest run of True; of equal ones, the first."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    starts, ends = edges[::2], edges[1::2]
    lengths = ends - starts
    longest = int(np.argmax(lengths))
    return _FlatRun(int(lengths[longest]), int(starts[longest]))
