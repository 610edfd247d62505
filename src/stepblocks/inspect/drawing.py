"""Draw a scan with what was fitted to it and its limits."""

import math
from collections.abc import Sequence

import numpy as np

from stepblocks.files.figures import Axes
from stepblocks.inspect.evaluation import Shown
from stepblocks.inspect.judgement import Judgement
from stepblocks.inspect.noise import Array

_MOST_DRAWN = 4000  # points of a profile; of more, every so many
_WELL_FITTED = 90  # part of the residuals that the lower plot is scaled to [%]
# limits drawn beside the scan
_HEIGHTS = ("step_height", "ridge_height", "horizontal_discrepancy", "groove_depth")
_SCAN, _FITTED, _LIMIT = "#1d2a36", "#f0a020", "#c8553d"
_LEFT_OUT, _RESIDUAL, _WINDOW, _WINDOW_EDGE = "#b3261e", "#5a6b7a", "#eaf0f5", "#b9c6d2"


def draw_scan(axes: Axes, shown: Shown, judged: Sequence[Judgement]) -> None:
    """Draw a profile, its windows, what was fitted and left out, and the limits of its heights."""
    thin = max(len(shown.position) // _MOST_DRAWN, 1)
    x = shown.position[::thin] * 1e6
    z = shown.height[::thin] * 1e6
    axes.plot(x, z, color=_SCAN, linewidth=1.4)
    _shade_evaluated_windows(axes, shown)
    if shown.fitted is not None:
        _draw_fit_and_residuals(axes, x, z, shown.fitted[::thin] * 1e6)
    _mark_left_out_points(axes, shown)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=7, frameon=False
        )
    lowest, highest = np.nanmin(z), np.nanmax(z)
    _draw_height_limits(axes, judged, -1.0 if _is_feature_below_faces(z) else 1.0)
    span = highest - lowest
    axes.set(
        xlim=(x[0], x[-1]),
        ylim=(lowest - 0.08 * span, highest + 0.22 * span),
        xlabel="position / um",
        ylabel="height / um",
    )
    for mark in shown.marks:
        place = (mark.position * 1e6, highest + 0.12 * span)
        axes.annotate(mark.name, place, ha="center", fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _shade_evaluated_windows(axes: Axes, shown: Shown) -> None:
    """Shade the stretches that were evaluated; the first names them in the legend."""
    for index, window in enumerate(shown.windows):
        label = None
        if window.name and index == 0:
            label = "evaluated"
        axes.axvspan(
            window.begin * 1e6,
            window.end * 1e6,
            fc=_WINDOW,
            ec=_WINDOW_EDGE,
            linewidth=0.5,
            zorder=0,
            label=label,
        )


def _draw_fit_and_residuals(
    axes: Axes, position_um: Array, height_um: Array, fitted_um: Array
) -> None:
    """Draw what was fitted, and the residuals below it, all of shape (n,) [um]."""
    axes.plot(position_um, fitted_um, color=_FITTED, linewidth=0.7, label="fitted")
    residuals = height_um - fitted_um
    below = axes.inset_axes((0.0, -0.37, 1.0, 0.16), sharex=axes)
    below.plot(position_um, residuals, color=_RESIDUAL, linewidth=0.6)
    reach = max(2.0 * float(np.nanpercentile(np.abs(residuals), _WELL_FITTED)), 1e-9)
    below.set(ylim=(-reach, reach))
    # above, where it is whole however long the numbers at the left are
    below.set_title("residual / um", loc="left", fontsize=8)
    below.tick_params(labelsize=7, labelbottom=False)


def _mark_left_out_points(axes: Axes, shown: Shown) -> None:
    """Mark the points that were left out, if any."""
    dropped = shown.dropped
    if dropped is None or not dropped.any():
        return
    axes.plot(
        shown.position[dropped] * 1e6,
        shown.height[dropped] * 1e6,
        "x",
        color=_LEFT_OUT,
        markersize=4,
        label="left out",
    )


def _is_feature_below_faces(heights: Array) -> bool:
    """Tell whether a feature lies below its faces, so that its limits are drawn there [um]."""
    lowest, highest = np.nanmin(heights), np.nanmax(heights)
    mostly_high = np.nanmedian(heights) > 0.5 * (lowest + highest)
    return bool(mostly_high and lowest < -0.5 * np.ptp(heights))


def _draw_height_limits(axes: Axes, judged: Sequence[Judgement], sign: float) -> None:
    """Draw the limits of heights, below the faces where `sign` is -1."""
    for judgement in judged:
        if judgement.characteristic.key not in _HEIGHTS:
            continue
        for limit in (judgement.decision.lower, judgement.decision.upper):
            if math.isfinite(limit):
                axes.axhline(sign * limit * 1e6, color=_LIMIT, linestyle="--", linewidth=0.8)
