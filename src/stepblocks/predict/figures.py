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
from stepblocks.files.figures import make_figure, save_figure
from stepblocks.predict.predictions import collect_uncertainties, find_tip

_BLUE, _RED = "#1f4e79", "#b03030"


def compute_margin_map(
    gaps: Array, discrepancies: Array, point: OperatingPoint
) -> tuple[Array, Array]:
    """Compute the peak force [N] from crown to tooth, and back, shape (gaps, discrepancies).

    It is 0 where nothing catches, infinite where the tip is held.
    """
    # Terms by Holmes et al. (1989), J. Prosthet. Dent. 62, 405: a tooth that stands higher than the
    # crown is positive. The gap is taken to be deeper than the tip sinks.
    to_tooth, to_crown = find_margin_angles(gaps[:, None], discrepancies, point.ball_radius)
    conditions = point.friction, point.normal_load, 1.0, 1.0
    return kernels.compute_release(to_tooth, *conditions)[0], kernels.compute_release(
        to_crown, *conditions
    )[0]


def write_plots(stimuli: StimulusSet, folder: Path) -> Iterator[Path]:
    """Draw what a set predicts, for each of its tips and frictions under its largest load."""
    grid = stimuli.prediction
    parts = [part for part in stimuli.stimuli if part.crossed]
    faces = {part.id: part.counterface() for part in parts}
    steps = {name: face for name, face in faces.items() if isinstance(face, Step)}
    margins = {name: face for name, face in faces.items() if isinstance(face, Margin)}
    for radius, friction in product(grid.tip_radii, grid.coefficients):
        point = OperatingPoint(radius, max(grid.normal_loads), friction, grid.as_tool())
        name = f"R{radius * 1e6:g}.mu{point.friction:g}".replace("mu0.", "mu0p")
        if steps:
            path = folder / f"{stimuli.name}.energy-of-height.{name}.png"
            first = next(part for part in parts if part.id in steps)
            uncertainty = collect_uncertainties(
                first, grid, find_tip(grid, radius), point.normal_load
            )
            top = 1.25 * max(step.height for step in steps.values())
            curve = [
                Step(height, steps[first.id].edge_radius)
                for height in np.linspace(0.02 * top, top, 80)
            ]
            draw_energy_of_height(
                curve, point, uncertainty, path, [step.height for step in steps.values()]
            )
            yield path
        if margins:
            path = folder / f"{stimuli.name}.margin-map.{name}.png"
            gap = 1.25 * max(margin.opening for margin in margins.values())
            rise = 1.25 * max(*(abs(margin.rise) for margin in margins.values()), 20e-6)
            draw_margin_map(
                np.linspace(0.0, max(gap, 100e-6), 76),
                np.linspace(-rise, rise, 81),
                point,
                path,
                [(max(one.opening, 0.0), -one.rise) for one in margins.values()],
            )
            yield path


def draw_energy_of_height(
    steps: Sequence[Step],
    point: OperatingPoint,
    uncertainty: Mapping[str, float],
    path: Path,
    marks: Sequence[float] = (),
) -> None:
    """Draw E_v against H with its 95 % interval and the locking height; `marks` in m."""
    heights = 1e6 * np.array([step.height for step in steps])
    intervals = [estimate_interval(step, point, uncertainty, draws=4000) for step in steps]
    figure, axis = make_figure()
    released = np.array([one.status is Status.RELEASES for one in intervals])
    ContactError.require(
        released.any(), "a figure of energy against height needs a height that releases, got none"
    )
    energy, low, high = (
        1e6 * np.array([getattr(one, name) for one in intervals])
        for name in ("energy", "energy_low", "energy_high")
    )
    top = 10.0 * energy[released].max()
    shown = np.isfinite(low)
    axis.fill_between(
        heights[shown],
        low[shown],
        np.minimum(high[shown], top),
        alpha=0.3,
        lw=0,
        color=_BLUE,
        label="95 % interval",
    )
    axis.plot(
        heights[released], energy[released], color=_BLUE, label="$E_v$, equations (1) and (2)"
    )
    limit = 1e6 * float(
        kernels.compute_locking_height(point.ball_radius + steps[0].edge_radius, point.friction)
    )
    axis.axvline(limit, color=_RED, ls="--", lw=1, label=f"locks from {limit:.1f} um")
    axis.set(xlabel="step height H [um]", ylabel="vibration energy $E_v$ [uJ]", yscale="log")
    axis.set_ylim(top=top)
    axis.set_title(
        (
            f"R {point.ball_radius * 1e6:g} um, {point.normal_load:g} N, mu {point.friction:g}, "
            f"C_v {point.tool.conversion:g}"
        ),
        fontsize=9,
    )
    axis.plot(
        1e6 * np.array(marks),
        np.zeros(len(marks)),
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
    marks: Sequence[tuple[float, float]] = (),
) -> None:
    """Draw the peak force of both directions over gap and discrepancy, held margins hatched.

    `marks` are pairs of gap and discrepancy [m].
    """
    from matplotlib.colors import LogNorm

    figure, axes = make_figure(1, 2, width=9.0, height=4.0)
    forces = compute_margin_map(gaps, discrepancies, point)
    across, along = discrepancies * 1e6, gaps * 1e6
    finite = np.concatenate([f[np.isfinite(f) & (f > 0)] for f in forces])
    norm = LogNorm(max(float(finite.min()), 1e-2), min(float(finite.max()), 50.0))
    for axis, force, name in zip(axes, forces, ("crown to tooth", "tooth to crown"), strict=True):
        mesh = axis.pcolormesh(
            across,
            along,
            np.ma.masked_where(~np.isfinite(force) | (force <= 0.0), force),
            norm=norm,
            shading="nearest",
        )
        axis.contourf(
            across,
            along,
            np.where(np.isinf(force), 1.0, np.nan),
            levels=[0.5, 1.5],
            colors="none",
            hatches=["//"],
        )
        axis.axhline(100.0, color=_RED, lw=0.8, ls="--")
        marked_gaps, marked_discrepancies = 1e6 * np.array(marks).reshape(-1, 2).T
        axis.plot(marked_discrepancies, marked_gaps, "o", ms=4, mfc="none", color="k")
        axis.set(xlabel="discrepancy, tooth over crown [um]", ylabel="gap [um]")
        axis.set_title(f"{name} (white: no catch, hatched: held)", fontsize=9)
    figure.colorbar(mesh, ax=list(axes), label="peak force $F_{px}$ [N]")
    save_figure(figure, path)
