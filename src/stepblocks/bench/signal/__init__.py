"""One trace: whether it can be measured, where things happen in it, and its figures."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from stepblocks.errors import RuleError

Array = NDArray[np.float64]
Estimate = tuple[float, float]  # a value and its standard uncertainty
Tool = tuple[float, float]  # frequency [Hz] and decay time [s] of its ring

MOST_SAMPLES = 20_000_000  # a longer trace is refused; at 10 kHz it lasts half an hour
_FEWEST_SAMPLES = 200
_RATE_TOLERANCE = 0.01
_GAP_STEPS = 1.6  # a step of the clock this many times the usual one is a gap
_FLAT_SAMPLES = 4  # equal samples in a row at the extreme of a record that was still moving
# steps of the converter, or of the noise from sample to sample, that the movement would have made
# meanwhile
_FLAT_STEPS = 7.0
_FEWEST_STILL = 40  # samples before the tip is set down, fewer say nothing of a zero
_EDGE = 8  # samples at which the load is coming on
_CALM = 7e-3  # [s] two periods of a ring, over which it averages out
_STANDS = 0.4  # of the sliding force, within which a handle that stands still is pulled
_LOADED = 10.0  # the load is at least this many times the scatter without one
_LOWEST_RATE = 1500.0  # [Hz] five samples per cycle of a ring at 300 Hz


class TraceError(RuleError):
    """A trace that cannot be used; the message is the reason for its exclusion."""


def check_size(count: int, channel: str | int) -> None:
    """Refuse a channel before it is read into memory."""
    TraceError.require(
        count <= MOST_SAMPLES,
        f"channel {channel!r} has {count} samples, more than {MOST_SAMPLES}",
    )


def join_first(names: Iterable[str]) -> str:
    """Return the first eight names."""
    return ", ".join(islice(names, 8))


@dataclass(frozen=True)
class Trace:
    """A record of both forces.

    Attributes
    ----------
    time : Array
        Shape (n,), instants of the samples [s].
    tangential : Array
        Shape (n,), force along the drag F_x [N].
    normal : Array
        Shape (n,), force into the block F_y [N].
    """

    time: Array
    tangential: Array
    normal: Array


def screen_trace(trace: Trace, sample_rate: float, limit: float | None = None) -> str:
    """Say in one line what makes a trace unusable; empty where nothing does."""
    count = trace.time.size
    if count < _FEWEST_SAMPLES:
        few = f"{count} samples are too few (at least {_FEWEST_SAMPLES})"
        return f"truncated: {few if count else 'the trace is empty'}"
    for name, values in vars(trace).items():
        bad = count - np.count_nonzero(np.isfinite(values))
        if bad:
            return f"not-a-number: {bad} of {count} samples of the {name} channel"
    if fault := _find_clock_fault(trace.time, sample_rate):
        return fault
    if float(np.ptp(trace.tangential)) == 0.0:
        return f"dead channel: the tangential force is {trace.tangential[0]:.4g} N throughout"
    if not np.any(trace.normal):
        return "dead channel: the normal force is 0 throughout"
    return _find_saturation("tangential", trace.tangential, limit) or _find_saturation(
        "normal", trace.normal, limit
    )


def _find_clock_fault(time: Array, sample_rate: float) -> str:
    steps = np.diff(time)
    back, widest = int(np.argmax(steps <= 0.0)), int(np.argmax(steps))
    # of a clock that stands still the first rule speaks
    rate = 1.0 / max(float((time[-1] - time[0]) / steps.size), 1e-300)
    rules = {
        f"wrong clock: time does not ascend after {time[back]:.6g} s": steps[back] <= 0.0,
        f"gap: {steps[widest] * 1e3:.3g} ms without samples after {time[widest]:.6g} s": (
            steps[widest] > _GAP_STEPS * float(np.median(steps))
        ),
        f"wrong rate: {rate:.6g} Hz, declared are {sample_rate:.6g} Hz": (
            abs(rate / sample_rate - 1.0) > _RATE_TOLERANCE
        ),
        f"wrong rate: {rate:.6g} Hz cannot show a ring, at least {_LOWEST_RATE:.0f} Hz are "
        "needed": rate < _LOWEST_RATE,
    }
    return next((fault for fault, broken in rules.items() if broken), "")


def _find_saturation(name: str, values: Array, limit: float | None) -> str:
    if limit is not None and float(np.abs(values).max()) >= limit:
        return f"saturated: the {name} force reaches the range of {limit:g} N"
    moves = np.abs(np.diff(values))
    step = float(np.min(moves, where=moves > 0.0, initial=np.inf))
    for sign, side in ((1.0, "highest"), (-1.0, "lowest")):
        signed = sign * values
        top = float(signed.max())
        run, start = _find_longest_run(signed >= top)
        if run < _FLAT_SAMPLES or start < _FLAT_SAMPLES:
            continue
        # noise may touch the top before it stays there: a stretch twice as long tells how far the
        # force had still to go
        least = _FLAT_STEPS * (step + float(np.mean(moves[:start])))
        if top - float(np.median(signed[max(start - 2 * run, 0) : start])) > least:
            return (
                f"saturated: {run} samples in a row at the {side} {name} force, {sign * top:.4g} N"
            )
    return ""


def _find_longest_run(mask: NDArray[np.bool_]) -> tuple[int, int]:
    # Length and first index of the longest run of True; of equal ones, the first
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    return int(ends[longest] - starts[longest]), int(starts[longest])


def find_set_down(trace: Trace) -> tuple[int, tuple[Estimate, Estimate]]:
    """Find the first sample from which the tip slides, and the zeros of both gauges.

    What comes before is an unloaded part, of which the zeros are the means, the load coming on, and
    a handle that stands still; a record may lack any of them.
    """
    zeros = ((math.nan, math.nan), (math.nan, math.nan))
    loaded = 0
    calm = max(round(_CALM * (trace.time.size - 1) / float(trace.time[-1] - trace.time[0])), 5)
    normal = np.convolve(trace.normal, np.full(5, 0.2), mode="same")
    low, high = np.percentile(normal[2:-2], (0.5, 80.0))
    on = int(np.argmax(normal[2:] > 0.5 * (low + high))) + 2
    spread = float(np.std(trace.normal[: max(on // 2, 1)]))
    if on >= _FEWEST_STILL + _EDGE and high - low >= _LOADED * max(spread, 1e-12):
        zero = float(np.median(normal[2 : on // 2]))
        mean = uniform_filter1d(trace.normal, max(min(calm, on // 4), 5))
        begin = int(np.flatnonzero(mean[: on + 1] <= zero + 0.05 * (high - zero))[-1])
        still = slice(0, begin - (on - begin) - _EDGE)  # the load comes on smoothly
        if still.stop >= _FEWEST_STILL:
            # samples are correlated: the uncertainty of the mean comes from the means of eighths
            pulled, pressed = (
                (
                    float(np.mean(one[still])),
                    float(np.std([part.mean() for part in np.array_split(one[still], 8)], ddof=1))
                    / math.sqrt(8.0),
                )
                for one in (trace.tangential, trace.normal)
            )
            zeros = pulled, pressed
        loaded = on + int(np.argmax(mean[on:] >= zero + 0.95 * (high - zero)))
    return loaded + _find_motion(trace.tangential[loaded:], zeros[0][0], calm, loaded > 0), zeros


def _find_motion(force: Array, zero: float, calm: int, pulled_up: bool) -> int:
    # Find the first sample at the sliding force; `pulled_up` where no sliding came before
    smooth = np.convolve(force, np.full(5, 0.2), mode="same")
    smooth[:2], smooth[-2:] = force[:2], force[-2:]
    rest = zero if math.isfinite(zero) else float(np.median(smooth[:calm]))
    climb = smooth[: int(np.argmax(smooth)) + 1] - rest
    # the line through the middle of the ramp meets the force at rest before the ramp begins; where
    # the spring hardens, time as a parabola of the force does
    low, middle, upper = (
        int(np.flatnonzero(np.append(True, climb < share * climb[-1]))[-1])
        for share in (0.5, 0.7, 0.9)
    )
    parabola = 7.875 * low - 11.25 * middle + 4.375 * upper
    foot = max(int(min(4.5 * middle - 3.5 * upper, parabola)), calm)
    level = float(np.median(climb[max(foot - 3 * calm, 0) : foot]))
    mean = uniform_filter1d(force, calm) - rest
    start = int(np.argmax(np.append(mean[:foot] >= 0.5 * level, True)))
    stands = (
        2 * calm <= start < foot
        and float(np.ptp(mean[: start - calm])) < _STANDS * level
        # what still climbs before the foot is a ramp, no sliding
        and float(mean[foot - calm // 2]) < 1.5 * min(level, float(mean[min(start + calm, foot)]))
    )
    if not (pulled_up or stands):
        return 0
    first = max(start - calm // 2, 0) if stands else 0
    return first + int(np.argmax(climb[first:] >= level))
