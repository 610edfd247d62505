"""Measured against predicted figures of a session, before and after its effects are added."""

from dataclasses import dataclass

import numpy as np

from stepblocks.files.figures import Axes, get_or_make_axes
from stepblocks.lawsearch.findings import Explanation

BEFORE, AFTER = "#b0506a", "#2f6f9f"  # colours of the nominal and of the extended model


@dataclass(frozen=True)
class ShownChannel:
    """How a channel is drawn.

    Attributes
    ----------
    scale : float
        From its SI unit to that of the title.
    title : str
        Name and unit.
    """

    scale: float
    title: str


CHANNELS = {
    "ln_energy": ShownChannel(1e6, "vibration energy, µJ"),
    "ln_peak_force": ShownChannel(1.0, "peak force, N"),
}


def plot_agreement(
    explanation: Explanation, ax: "Axes | None", channel: str = "ln_energy"
) -> "Axes":
    """Plot one channel as measured against the nominal and the extended model.

    Parameters
    ----------
    explanation : Explanation
    ax : Axes or None
        Where to draw; new axes where it is None.
    channel : str
        One of `CHANNELS`.
    """
    from matplotlib.ticker import NullFormatter

    axis = get_or_make_axes(ax)
    shown = CHANNELS[channel]
    trials = explanation.problem.trials
    j = trials.channels.index(channel)
    measured = shown.scale * np.exp(trials.values[:, j])
    for fitted, colour, label in (
        (explanation.nominal, BEFORE, "nominal"),
        (explanation.extended, AFTER, "extended"),
    ):
        predicted = shown.scale * np.exp(fitted.predicted[:, j])
        axis.loglog(predicted, measured, ".", ms=4, color=colour, alpha=0.6, label=label)
    if np.any(np.isfinite(measured)):
        ends = [np.nanmin(measured), np.nanmax(measured)]
        axis.plot(ends, ends, color="0.4", lw=0.8)
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set(xlabel=f"predicted {shown.title}", ylabel=f"measured {shown.title}")
    axis.legend(fontsize=8)
    return axis
