"""Pictures of a drag: both forces against time, with a mark at every event, and their spectra."""

from pathlib import Path

from stepblocks.contact.energy import Status
from stepblocks.drag.ring import (
    LOADING_BAND,
    RING_BAND,
    Phase,
    compute_phase_spectrum,
    compute_spectral_band_share,
)
from stepblocks.drag.simulate import DragTrace
from stepblocks.files.figures import Axes, make_figure_and_axes, save_figure

_LABELS = {"fx_n": "tangential $F_x$ [N]", "fy_n": "normal $F_y$ [N]"}
_BANDS = {Phase.LOADING: LOADING_BAND, Phase.VIBRATION: RING_BAND}
_HIGHEST = 600.0  # of the spectra that are shown [Hz]
_BLUE, _RED, _GREY = "#1f4e79", "#b03030", "#808080"


def plot_force_with_events(trace: DragTrace, axes: "Axes", channel: str = "fx_n") -> "Axes":
    """Plot one force against time.

    The release that was asked about is marked in red, any other in grey.
    """
    milliseconds = trace.column("time_s") * 1e3
    axes.plot(milliseconds, trace.column(channel), lw=0.8, color=_BLUE)
    axes.set_ylabel(_LABELS.get(channel, channel))
    for number, event in enumerate(trace.events):
        if event.status is Status.RELEASES and number != trace.asked:
            axes.axvline(event.released_s * 1e3, color=_GREY, lw=0.5, ls=":")
    if trace.status is Status.RELEASES:
        axes.axvline(trace.release_time * 1e3, color=_RED, lw=0.8, ls="--")
    return axes


def draw_forces(trace: DragTrace, path: Path, title: str) -> None:
    """Draw both forces against time, as figure 3 of the paper does, and mark the release."""
    figure, axes = make_figure_and_axes(2, 1, sharex=True, height=4.6)
    for axis, name in zip(axes, ("fx_n", "fy_n"), strict=True):
        plot_force_with_events(trace, axis, name)
    if trace.status is Status.RELEASES:
        peak = (trace.release_time * 1e3, trace.peak_force)
        axes[0].annotate(
            f"release, $F_{{px}}$ = {trace.peak_force:.3g} N",
            peak,
            (8, 2),
            textcoords="offset points",
            va="top",
            fontsize=8,
            color=_RED,
        )
    axes[1].set_xlabel("time [ms]")
    axes[0].set_title(title, fontsize=10)
    save_figure(figure, path)


def draw_spectra(trace: DragTrace, path: Path, title: str) -> None:
    """Draw the spectra of both forces while loading and vibrating, as figures 4 and 5 do."""
    figure, axes = make_figure_and_axes(2, 2, sharex=True, height=5.0)
    for row, (channel, label) in zip(axes, (("fx_n", "$F_x$"), ("fy_n", "$F_y$")), strict=True):
        _draw_spectrum(row[0], trace, Phase.LOADING, channel, label)
        _draw_spectrum(row[1], trace, Phase.VIBRATION, channel, label)
    for axis in axes[1]:
        axis.set_xlabel("frequency [Hz]")
    figure.suptitle(title, fontsize=10)
    save_figure(figure, path)


def _draw_spectrum(axis: "Axes", trace: DragTrace, phase: Phase, channel: str, label: str) -> None:
    """Draw the spectrum of one force in one phase, and the band in which the paper finds it."""
    low, high = _BANDS[phase]
    frequency, energy = compute_phase_spectrum(trace, phase, channel)
    is_shown = frequency <= _HIGHEST
    shown = energy[is_shown]
    highest = max(float(shown.max()), 1e-300)
    axis.plot(frequency[is_shown], shown / highest, lw=0.9, color=_BLUE)
    axis.axvspan(low, high, color="#f0c040", alpha=0.25, lw=0)
    share = compute_spectral_band_share(frequency, energy, (low, high))
    axis.set_title(f"{phase}, {label}: {share:.0%} in {low:.0f}-{high:.0f} Hz", fontsize=9)
    axis.set_ylabel("relative energy")
