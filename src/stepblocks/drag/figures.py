"""Pictures of a drag: force against time with the release marked, and the spectra of both phases."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.contact.energy import Status
from stepblocks.drag.ring import LOADING_BAND, RING_BAND, band_share, phase_spectrum
from stepblocks.drag.simulate import DragTrace
from stepblocks.figure_file import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_force(trace: DragTrace, path: Path, title: str = "") -> None:
    """Draw both forces against time, as figure 3 of the paper does, and mark the release."""
    figure, axes = new_figure(2, 1, sharex=True, height=4.6)
    time = trace.column("time_s") * 1e3
    for axis, name, label in ((axes[0], "fx_n", "tangential $F_x$ [N]"), (axes[1], "fy_n", "normal $F_y$ [N]")):
        axis.plot(time, trace.column(name), lw=0.8, color="#1f4e79")
        axis.set_ylabel(label)
        if trace.status is Status.RELEASES:
            axis.axvline(trace.release_time * 1e3, color="#b03030", lw=0.8, ls="--")
    if trace.status is Status.RELEASES:
        axes[0].annotate(
            f"release, $F_{{px}}$ = {trace.peak_force:.3g} N",
            (trace.release_time * 1e3, trace.peak_force),
            xytext=(8, 2),
            textcoords="offset points",
            ha="left",
            va="top",
            fontsize=8,
            color="#b03030",
        )
    axes[1].set_xlabel("time [ms]")
    axes[0].set_title(title or f"Drag: {trace.status}", fontsize=10)
    save_figure(figure, path)


def draw_spectra(trace: DragTrace, path: Path, title: str = "") -> None:
    """Draw the spectra of the loading and of the vibration phase of both forces, as figures 4 and 5 do."""
    figure, axes = new_figure(2, 2, sharex=True, height=5.0)
    for row, channel in enumerate(("fx_n", "fy_n")):
        for column, (phase, band) in enumerate((("loading", LOADING_BAND), ("vibration", RING_BAND))):
            _draw_phase(axes[row][column], trace, phase, channel, band)
    for axis in axes[1]:
        axis.set_xlabel("frequency [Hz]")
    figure.suptitle(title or "Energy spectra of both phases", fontsize=10)
    save_figure(figure, path)


def _draw_phase(axis: Axes, trace: DragTrace, phase: str, channel: str, band: tuple[float, float]) -> None:
    frequency, energy = phase_spectrum(trace, phase, channel)
    shown = frequency <= 600.0
    axis.plot(frequency[shown], energy[shown] / max(float(energy[shown].max()), 1e-300), lw=0.9, color="#1f4e79")
    axis.axvspan(*band, color="#f0c040", alpha=0.25, lw=0)
    share = band_share(frequency, energy, band)
    label = "$F_x$" if channel == "fx_n" else "$F_y$"
    axis.set_title(f"{phase}, {label}: {share:.0%} in {band[0]:.0f}-{band[1]:.0f} Hz", fontsize=9)
    axis.set_ylabel("relative energy")
