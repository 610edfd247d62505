"""Measured against predicted figures of a session, before and after its effects are added."""

import numpy as np

from stepblocks.files.figures import Axes, take_axes
from stepblocks.lawsearch.explain import Explanation

BEFORE, AFTER = "#b0506a", "#2f6f9f"
CHANNELS = {  # what is drawn, with its scale and its title
    "ln_energy": (1e6, "vibration energy, µJ"),
    "ln_peak_force": (1.0, "peak force, N"),
}


def plot_agreement(
    explanation: Explanation, ax: "Axes | None", channel: str = "ln_energy"
) -> "Axes":
    """Plot one channel as measured against the nominal and the extended model."""
    from matplotlib.ticker import NullFormatter

    axis = take_axes(ax)
    scale, title = CHANNELS[channel]
    j = explanation.problem.trials.channels.index(channel)
    measured = scale * np.exp(explanation.problem.trials.values[:, j])
    for fitted, colour, label in (
        (explanation.nominal, BEFORE, "nominal"),
        (explanation.extended, AFTER, "extended"),
    ):
        axis.loglog(
            scale * np.exp(fitted.predicted[:, j]),
            measured,
            ".",
            ms=4,
            color=colour,
            alpha=0.6,
            label=label,
        )
    if np.any(np.isfinite(measured)):
        ends = [np.nanmin(measured), np.nanmax(measured)]
        axis.plot(ends, ends, color="0.4", lw=0.8)
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set(xlabel=f"predicted {title}", ylabel=f"measured {title}")
    axis.legend(fontsize=8)
    return axis
