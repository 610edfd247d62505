"""One long record of many drags, cut into one trace per trial."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal import Array, Trace
from stepblocks.errors import BenchError

_FALL = 4e-3  # [s] in which a release falls
_LEAST_DISTANCE = 30e-3  # [s] between two releases
_CLEAR = 1.5  # the least release falls by this many times what else falls
_RING = 0.1  # [s] left to a ring
_LEAD = 0.08  # [s] of sliding, or of the tip in the air, that go with a drag
_AIR = 0.02  # [s] a tip that is lifted stays lifted
_LOADED = 0.2  # share of the median normal force above which the tip is on the block
_SLIDING = 0.1  # share of the rise to the next release up to which the tip slides
_SMOOTH = 5  # samples
_MOST_POINTS = 200_000  # of a curve that is drawn
_MOST_NAMES = 40  # that are written beside it
_LEAST_FALL = 1e-12  # by which no fall is divided less [N]
_LINE, _CUT = "#1f4e79", "#b03030"


def cut_drags(trace: Trace, drag_count: int) -> list[slice]:
    """Find `drag_count` drags, by the lifted tip where it is lifted between them.

    Otherwise the releases that fall most are their ends.

    Raises
    ------
    BenchError
        If the record does not show so many releases.
    """
    rate = (trace.time.size - 1) / float(trace.time[-1] - trace.time[0])
    releases = _find_releases(trace.tangential, rate, drag_count)
    loaded = _mark_loaded_samples(trace.normal, rate)
    smooth = _smooth_force(trace.tangential)
    cuts = [0]
    for release, following in itertools.pairwise(releases):
        # a cut lies in the middle of what is between the ring and the next ramp, at the end of the
        # air where there is some
        after_ring = release + min(round(_RING * rate), (following - release) // 2)
        in_air = np.flatnonzero(~loaded[after_ring:following])
        if in_air.size:
            lead = after_ring + int(in_air[-1]) - round(_LEAD * rate)
            cuts.append(max(after_ring + int(in_air[0]), lead))
        else:
            cuts.append(_find_cut_in_sliding(smooth, after_ring, following, rate))
    cuts.append(trace.time.size)
    return [slice(first, last) for first, last in itertools.pairwise(cuts)]


def _smooth_force(force: Array) -> Array:
    """Return a running mean of the force; its ends fall towards zero."""
    return np.convolve(force, np.full(_SMOOTH, 1.0 / _SMOOTH), mode="same")


def _mark_loaded_samples(normal: Array, rate: float) -> NDArray[np.bool_]:
    """Tell the samples at which the tip is on the block.

    All of them are where the normal force never rests near none.
    """
    from scipy.ndimage import uniform_filter1d

    mean = uniform_filter1d(normal, max(round(_AIR * rate), 1))
    loaded: NDArray[np.bool_] = mean > _LOADED * float(np.median(normal))
    return loaded


def _find_cut_in_sliding(
    smoothed_force: Array, after_ring: int, next_release: int, rate: float
) -> int:
    """Return the sample at which a drag begins whose tip stayed on the block.

    `smoothed_force` is the tangential force [N], `next_release` the sample of its release.
    """
    begin = smoothed_force[after_ring : after_ring + max((next_release - after_ring) // 4, 1)]
    level = float(np.median(begin))
    highest = level + _SLIDING * (smoothed_force[next_release] - level)
    sliding = np.flatnonzero(smoothed_force[after_ring:next_release] < highest)
    last = 0
    if sliding.size:
        last = int(sliding[-1])
    return after_ring + max(0, last - round(_LEAD * rate))


def _find_releases(force: Array, rate: float, release_count: int) -> list[int]:
    """Return the samples at which the tangential force [N] falls most."""
    from scipy.signal import find_peaks

    width = max(round(_FALL * rate), 2)
    smooth = _smooth_force(force)
    fall = np.maximum(smooth[:-width] - smooth[width:], 0.0)
    distance = max(round(_LEAST_DISTANCE * rate), 1)
    peaks, properties = find_peaks(fall, distance=distance, prominence=0.0)
    order = np.argsort(-properties["prominences"], kind="stable")
    heights = fall[peaks[order]]
    is_ambiguous = (
        peaks.size > release_count and heights[release_count - 1] < _CLEAR * heights[release_count]
    )
    if peaks.size < release_count or is_ambiguous:
        raise BenchError(
            f"`acquisition.split` must find one drag for each of the {release_count} trials of the "
            f"table, "
            f"the record shows {_count_outstanding_falls(heights)} releases that stand out"
        )
    return sorted(peaks[order[:release_count]].tolist())


def _count_outstanding_falls(fall_heights: Array) -> int:
    """Return how many falls stand out, by the largest ratio of neighbours in `fall_heights` [N]."""
    if fall_heights.size < 2:
        return fall_heights.size
    ratios = fall_heights[:-1] / np.maximum(fall_heights[1:], _LEAST_FALL)
    return int(np.argmax(ratios)) + 1


def draw_cuts(trace: Trace, cuts: Sequence[slice], names: Sequence[str], path: Path) -> None:
    """Draw the record with its cuts, and which trial each piece is."""
    from stepblocks.files.figures import make_figure_and_axes, save_figure

    figure, (tangential_axes, normal_axes) = make_figure_and_axes(2, 1, sharex=True, height=5.0)
    tangential_axes.set_ylabel("tangential force [N]")
    normal_axes.set_ylabel("normal force [N]")
    step = max(trace.time.size // _MOST_POINTS, 1)
    for axes, values in ((tangential_axes, trace.tangential), (normal_axes, trace.normal)):
        axes.plot(trace.time[::step], values[::step], lw=0.5, color=_LINE)
        for cut in cuts[1:]:
            axes.axvline(trace.time[cut.start], color=_CUT, lw=0.6, ls="--")
    top = float(trace.tangential.max())
    stride = max(len(cuts) // _MOST_NAMES, 1)
    for cut, name in zip(cuts[::stride], names[::stride], strict=True):
        start = trace.time[cut.start]
        tangential_axes.text(start, top, f" {name}", fontsize=6, va="top", rotation=90)
    normal_axes.set_xlabel("time [s]")
    tangential_axes.set_title(f"{len(cuts)} drags of one record", fontsize=10)
    save_figure(figure, path)
