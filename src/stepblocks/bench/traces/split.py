"""One long record of many drags, cut into one trace per trial."""

import itertools
from pathlib import Path

import numpy as np

from stepblocks.bench.signal import Array, Trace
from stepblocks.errors import BenchError

_FALL = 4e-3  # [s] in which a release falls
_APART = 30e-3  # [s] releases are apart by more
_CLEAR = 1.5  # the least release falls by this many times what else falls
_RING = 0.1  # [s] left to a ring
_LEAD = 0.08  # [s] of sliding, or of the tip in the air, that go with a drag
_AIR = 0.02  # [s] a tip that is lifted stays lifted
_SMOOTH = 5


def cut_drags(trace: Trace, count: int) -> list[slice]:
    """Find `count` drags, by the lifted tip where it is lifted between them.

    Otherwise the releases that fall most are their ends.
    """
    from scipy.ndimage import uniform_filter1d

    rate = (trace.time.size - 1) / float(trace.time[-1] - trace.time[0])
    releases = _find_releases(trace.tangential, rate, count)
    # a cut lies in the middle of what is between the ring and the next ramp, at the end of the air
    # where there is some; all of the record is loaded where the normal force never rests near none
    loaded = uniform_filter1d(trace.normal, max(round(_AIR * rate), 1)) > 0.2 * float(
        np.median(trace.normal)
    )
    smooth = np.convolve(trace.tangential, np.full(_SMOOTH, 1.0 / _SMOOTH), mode="same")
    cuts = [0]
    for one, other in itertools.pairwise(releases):
        free = one + min(round(_RING * rate), (other - one) // 2)
        air = np.flatnonzero(~loaded[free:other])
        if air.size:
            cuts.append(max(free + int(air[0]), free + int(air[-1]) - round(_LEAD * rate)))
            continue
        level = float(np.median(smooth[free : free + max((other - free) // 4, 1)]))
        low = np.flatnonzero(smooth[free:other] < level + 0.1 * (smooth[other] - level))
        cuts.append(free + max(0, (int(low[-1]) if low.size else 0) - round(_LEAD * rate)))
    return list(itertools.starmap(slice, itertools.pairwise([*cuts, trace.time.size])))


def _find_releases(force: Array, rate: float, count: int) -> list[int]:
    from scipy.signal import find_peaks

    width = max(round(_FALL * rate), 2)
    fall = np.convolve(force, np.full(_SMOOTH, 1.0 / _SMOOTH), mode="same")
    fall = np.maximum(fall[:-width] - fall[width:], 0.0)
    found, properties = find_peaks(fall, distance=max(round(_APART * rate), 1), prominence=0.0)
    order = np.argsort(-properties["prominences"], kind="stable")
    heights = fall[found[order]]
    if found.size < count or (found.size > count and heights[count - 1] < _CLEAR * heights[count]):
        clear = (
            int(np.argmax(heights[:-1] / np.maximum(heights[1:], 1e-12))) + 1
            if found.size > 1
            else found.size
        )
        raise BenchError(
            f"`acquisition.split` must find one drag for each of the {count} trials of the table, "
            f"the record shows {clear} releases that stand out"
        )
    return sorted(found[order[:count]].tolist())


def draw_cuts(trace: Trace, cuts: list[slice], names: list[str], path: Path) -> None:
    """Draw the record with its cuts, and which trial each piece is."""
    from stepblocks.files.figures import make_figure, save_figure

    figure, axes = make_figure(2, 1, sharex=True, height=5.0)
    step = max(trace.time.size // 200_000, 1)
    for axis, values, label in (
        (axes[0], trace.tangential, "tangential"),
        (axes[1], trace.normal, "normal"),
    ):
        axis.plot(trace.time[::step], values[::step], lw=0.5, color="#1f4e79")
        axis.set_ylabel(f"{label} force [N]")
        for cut in cuts[1:]:
            axis.axvline(trace.time[cut.start], color="#b03030", lw=0.6, ls="--")
    top = float(trace.tangential.max())
    for cut, name in list(zip(cuts, names, strict=True))[:: max(len(cuts) // 40, 1)]:
        axes[0].text(trace.time[cut.start], top, f" {name}", fontsize=6, va="top", rotation=90)
    axes[1].set_xlabel("time [s]")
    axes[0].set_title(f"{len(cuts)} drags of one record", fontsize=10)
    save_figure(figure, path)
