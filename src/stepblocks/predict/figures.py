"""Draw a set's predictions: energy against height with interval, and the map of margins."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from stepblocks.contact import Array, kernels
from stepblocks.contact.counterface import Margin, Step
from stepblocks.contact.critical_angle import find_margin_angles
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import estimate_interval
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import ContactError
from stepblocks.files.figures import make_figure_and_axes, save_figure
from stepblocks.predict.predictions import collect_standard_uncertainties, make_tip_dimension

_BLUE = "#1f4e79"
_RED = "#b03030"
_DRAWS = 4000  # of the interval at each height of a curve
# a map of margins reaches at least so far [m]
_LEAST_GAP = 100e-6
_LEAST_RISE = 20e-6


def compute_margin_map_forces(
    gaps: Array, discrepancies: Array, point: OperatingPoint
) -> tuple[Array, Array]:
    """Compute the peak force [N] from crown to tooth, and back, shape (gaps, discrepancies).

    It is 0 where nothing catches, infinite where the tip is held.
    """
    # Terms by Holmes et al. (1989), J. Prosthet. Dent. 62, 405: a tooth that stands higher than the
    # crown is positive. The gap is taken to be deeper than the tip sinks.
    to_tooth, to_crown = find_margin_angles(gaps[:, None], discrepancies, point.ball_radius)
    return _compute_peak_forces(to_tooth, point), _compute_peak_forces(to_crown, point)


def _compute_peak_forces(angles: Array, point: OperatingPoint) -> Array:
    """Return peak forces [N] for critical angles; the unit spring does not affect them."""
    forces: Array
    forces, _ = kernels.compute_release_force_and_energy(
        angles, point.friction, point.normal_load, 1.0, 1.0
    )
    return forces


def write_prediction_plots(stimuli: StimulusSet, folder: Path) -> Iterator[Path]:
    """Draw what a set predicts, for each of its tips and frictions under its largest load."""
    grid = stimuli.prediction
    steps: dict[str, Step] = {}
    margins: list[Margin] = []
    for part in stimuli.stimuli:
        face = part.counterface() if part.crossed else None
        if isinstance(face, Step):
            steps[part.id] = face
        elif isinstance(face, Margin):
            margins.append(face)
    for radius, friction in product(grid.tip_radii, grid.frictions_or_law):
        point = OperatingPoint(radius, max(grid.normal_loads), friction, grid.as_tool())
        condition = f"R{radius * 1e6:g}.mu{point.friction:g}".replace("mu0.", "mu0p")
        if steps:
            path = folder / f"{stimuli.name}.energy-of-height.{condition}.png"
            _write_step_plot(stimuli, steps, point, path)
            yield path
        if margins:
            path = folder / f"{stimuli.name}.margin-map.{condition}.png"
            _write_margin_plot(margins, point, path)
            yield path


def _write_step_plot(
    stimuli: StimulusSet, steps: Mapping[str, Step], point: OperatingPoint, path: Path
) -> None:
    """Draw the energy against the height for the edge and the tolerances of a set's first step."""
    grid = stimuli.prediction
    first = next(part for part in stimuli.stimuli if part.id in steps)
    tip = make_tip_dimension(grid, point.ball_radius)
    uncertainty = collect_standard_uncertainties(first, grid, tip, point.normal_load)
    heights = [step.height for step in steps.values()]
    top = 1.25 * max(heights)
    edge_radius = steps[first.id].edge_radius
    drawn_heights = np.linspace(0.02 * top, top, 80)
    curve = [Step(height, edge_radius) for height in drawn_heights]
    draw_energy_of_height(curve, point, uncertainty, path, heights)


def _write_margin_plot(margins: Sequence[Margin], point: OperatingPoint, path: Path) -> None:
    """Draw the map of peak forces round the margins of a set."""
    widest = _LEAST_GAP
    highest = _LEAST_RISE
    marks = []
    for margin in margins:
        widest = max(widest, 1.25 * margin.opening)
        highest = max(highest, abs(margin.rise))
        marks.append((max(margin.opening, 0.0), -margin.rise))
    draw_margin_map(
        np.linspace(0.0, widest, 76),
        np.linspace(-1.25 * highest, 1.25 * highest, 81),
        point,
        path,
        marks,
    )


def draw_energy_of_height(
    steps: Sequence[Step],
    point: OperatingPoint,
    uncertainty: Mapping[str, float],
    path: Path,
    marked_heights: Sequence[float] = (),
) -> None:
    """Draw E_v against H with its 95 % interval and the locking height; `marked_heights` in m."""
    is_released = np.zeros(len(steps), dtype=bool)
    heights, energy, low, high = np.empty((4, len(steps)))
    for place, step in enumerate(steps):
        heights[place] = 1e6 * step.height
        interval = estimate_interval(step, point, uncertainty, draws=_DRAWS)
        is_released[place] = interval.status is Status.RELEASES
        energy[place] = 1e6 * interval.energy
        low[place] = 1e6 * interval.energy_low
        high[place] = 1e6 * interval.energy_high
    if not is_released.any():
        raise ContactError(
            "a figure of energy against height needs a height that releases, got none"
        )
    top = 10.0 * energy[is_released].max()
    is_shown = np.isfinite(low)
    figure, axis = make_figure_and_axes()
    axis.fill_between(
        heights[is_shown],
        low[is_shown],
        np.minimum(high[is_shown], top),
        alpha=0.3,
        lw=0,
        color=_BLUE,
        label="95 % interval",
    )
    axis.plot(
        heights[is_released], energy[is_released], color=_BLUE, label="$E_v$, equations (1) and (2)"
    )
    effective_radius = point.ball_radius + steps[0].edge_radius
    limit = 1e6 * float(kernels.compute_locking_height(effective_radius, point.friction))
    axis.axvline(limit, color=_RED, ls="--", lw=1, label=f"locks from {limit:.1f} um")
    axis.set(xlabel="step height H [um]", ylabel="vibration energy $E_v$ [uJ]", yscale="log")
    axis.set_ylim(top=top)
    axis.set_title(
        f"R {point.ball_radius * 1e6:g} um, {point.normal_load:g} N, mu {point.friction:g}, "
        f"C_v {point.tool.conversion:g}",
        fontsize=9,
    )
    axis.plot(
        1e6 * np.array(marked_heights),
        np.zeros(len(marked_heights)),
        "|",
        ms=9,
        color="k",
        transform=axis.get_xaxis_transform(),
        clip_on=False,
    )
    axis.legend(fontsize=8)
    save_figure(figure, path)


def draw_margin_map(
    gaps: Array,
    discrepancies: Array,
    point: OperatingPoint,
    path: Path,
    marked_margins: Sequence[tuple[float, float]] = (),
) -> None:
    """Draw the peak force of both directions over gap and discrepancy, held margins hatched.

    `marked_margins` are pairs of gap and discrepancy [m].
    """
    from matplotlib.colors import LogNorm

    figure, axes = make_figure_and_axes(1, 2, width=9.0, height=4.0)
    to_tooth, to_crown = compute_margin_map_forces(gaps, discrepancies, point)
    across, along = discrepancies * 1e6, gaps * 1e6
    forces = np.concatenate([to_tooth.ravel(), to_crown.ravel()])
    finite = forces[np.isfinite(forces) & (forces > 0)]
    norm = LogNorm(max(float(finite.min()), 1e-2), min(float(finite.max()), 50.0))
    marked_gaps, marked_discrepancies = 1e6 * np.array(marked_margins).reshape(-1, 2).T
    for axis, force, name in (
        (axes[0], to_tooth, "crown to tooth"),
        (axes[1], to_crown, "tooth to crown"),
    ):
        is_blank = ~np.isfinite(force) | (force <= 0.0)
        mesh = axis.pcolormesh(
            across, along, np.ma.masked_where(is_blank, force), norm=norm, shading="nearest"
        )
        is_held = np.where(np.isinf(force), 1.0, np.nan)
        axis.contourf(across, along, is_held, levels=[0.5, 1.5], colors="none", hatches=["//"])
        axis.axhline(100.0, color=_RED, lw=0.8, ls="--")
        axis.plot(marked_discrepancies, marked_gaps, "o", ms=4, mfc="none", color="k")
        axis.set(xlabel="discrepancy, tooth over crown [um]", ylabel="gap [um]")
        axis.set_title(f"{name} (white: no catch, hatched: held)", fontsize=9)
    figure.colorbar(mesh, ax=list(axes), label="peak force $F_{px}$ [N]")
    save_figure(figure, path)
