"""Is a trace fit to be measured? Each check ends in the reason for an exclusion, or in nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.trace import Trace

Array = NDArray[np.float64]

_FEWEST_SAMPLES = 200
_RATE_TOLERANCE = 0.01
_GAP_STEPS = 1.6  # a step of the clock this many times the usual one is a gap
_FLAT_SAMPLES = 6  # equal samples in a row at the extreme of a record that was still moving
_FLAT_STEPS = 4.0  # steps of the converter that the movement would have made meanwhile
_LOWEST_RATE = 1500.0  # [Hz] five samples per cycle of a ring at 300 Hz


def screen_trace(trace: Trace, sample_rate: float, limit: float | None = None) -> str:
    """Look for what makes a trace unusable.

    Examples
    --------
    >>> t = np.arange(50) / 1e4
    >>> screen_trace(Trace(t, t, t), 1e4)
    'truncated: 50 samples are too few (at least 200)'
    """
    checks: tuple[Callable[[], str], ...] = (
        lambda: _length(trace),
        lambda: _finite(trace),
        lambda: _clock(trace.time, sample_rate),
        lambda: _alive(trace),
        lambda: _saturation("tangential", trace.tangential, limit),
        lambda: _saturation("normal", trace.normal, limit),
    )
    for check in checks:
        reason = check()
        if reason:
            return reason
    return ""


def _length(trace: Trace) -> str:
    count = trace.time.size
    if count == 0:
        return "truncated: the trace is empty"
    return f"truncated: {count} samples are too few (at least {_FEWEST_SAMPLES})" if count < _FEWEST_SAMPLES else ""


def _finite(trace: Trace) -> str:
    for name, values in (("time", trace.time), ("tangential", trace.tangential), ("normal", trace.normal)):
        bad = int(values.size - np.count_nonzero(np.isfinite(values)))
        if bad:
            return f"not-a-number: {bad} of {values.size} samples of the {name} channel"
    return ""


def _clock(time: Array, sample_rate: float) -> str:
    steps = np.diff(time)
    if float(steps.min()) <= 0.0:
        where = int(np.argmax(steps <= 0.0))
        return f"wrong clock: time does not ascend after {time[where]:.6g} s"
    step = float(np.median(steps))
    mean = float((time[-1] - time[0]) / steps.size)
    largest = float(steps.max())
    if largest > _GAP_STEPS * step:
        where = int(np.argmax(steps))
        return f"gap: {largest * 1e3:.3g} ms without samples after {time[where]:.6g} s"
    rate = 1.0 / mean
    if abs(rate / sample_rate - 1.0) > _RATE_TOLERANCE:
        return f"wrong rate: {rate:.6g} Hz, declared are {sample_rate:.6g} Hz"
    if rate < _LOWEST_RATE:
        return f"wrong rate: {rate:.6g} Hz cannot show a ring, at least {_LOWEST_RATE:.0f} Hz are needed"
    return ""


def _alive(trace: Trace) -> str:
    if float(np.ptp(trace.tangential)) == 0.0:
        return f"dead channel: the tangential force is {trace.tangential[0]:.4g} N throughout"
    if not np.any(trace.normal):
        return "dead channel: the normal force is 0 throughout"
    return ""


def _saturation(name: str, values: Array, limit: float | None) -> str:
    if limit is not None and float(np.abs(values).max()) >= limit:
        return f"saturated: the {name} force reaches the range of {limit:g} N"
    for sign, side in ((1.0, "highest"), (-1.0, "lowest")):
        signed = sign * values
        top = float(signed.max())
        at_top = signed >= top
        run, start = _longest_run(at_top)
        if run < _FLAT_SAMPLES or start < _FLAT_SAMPLES:
            continue
        before = signed[start - _FLAT_SAMPLES : start]
        speed = float(top - before[0]) / _FLAT_SAMPLES
        moves = np.abs(np.diff(values))
        moves = moves[moves > 0.0]
        if moves.size and speed * run > _FLAT_STEPS * float(moves.min()):
            return f"saturated: {run} samples in a row at the {side} {name} force, {sign * top:.4g} N"
    return ""


def _longest_run(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """Length and first index of the longest run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if not starts.size:
        return 0, 0
    longest = int(np.argmax(ends - starts))
    return int(ends[longest] - starts[longest]), int(starts[longest])
