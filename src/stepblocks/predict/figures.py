"""Pictures of predictions: energy against height with its interval and locking limit, the margin map, the ring map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import Status
from stepblocks.contact.kernels import locking_height
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import interval_of
from stepblocks.drag.conversion import RingConversion
from stepblocks.errors import ContactError
from stepblocks.figure_file import new_figure, save_figure
from stepblocks.predict.margin_map import MarginMap


def draw_energy_of_height(
    faces: Sequence[Step],
    point: OperatingPoint,
    uncertainty: Mapping[str, float],
    path: Path,
    marks: dict[str, float] | None = None,
) -> None:
    """Draw E_v against H with its 95 % interval and the height at which the tip locks."""
    hs = np.array([face.height for face in faces])
    intervals = [interval_of(face, point, uncertainty, draws=4000) for face in faces]
    figure, axis = new_figure()
    released = np.array([i.status is Status.RELEASES for i in intervals])
    low = np.array([i.energy_low for i in intervals])
    high = np.array([i.energy_high for i in intervals])
    if not any(i.status is Status.RELEASES for i in intervals):
        raise ContactError("a figure of energy against height needs a height that releases, got none")
    top = 10.0 * max(i.energy for i in intervals if i.status is Status.RELEASES)
    shown = np.isfinite(low)
    axis.fill_between(
        hs[shown] * 1e6,
        low[shown] * 1e6,
        np.minimum(high[shown], top) * 1e6,
        alpha=0.3,
        lw=0,
        color="#1f4e79",
        label="95 % interval",
    )
    energy = np.array([i.energy for i in intervals])
    axis.plot(hs[released] * 1e6, energy[released] * 1e6, color="#1f4e79", label="$E_v$, equations (1) and (2)")
    limit = float(locking_height(point.ball_radius + faces[0].edge_radius, point.friction))
    axis.axvline(limit * 1e6, color="#b03030", ls="--", lw=1, label=f"locks from {limit * 1e6:.1f} um")
    axis.set(xlabel="step height H [um]", ylabel="vibration energy $E_v$ [uJ]", yscale="log")
    axis.set_ylim(top=top * 1e6)
    axis.set_title(
        f"R {point.ball_radius * 1e6:g} um, {point.normal_load:g} N, mu {point.friction:g}, C_v {point.tool.conversion:g}",
        fontsize=9,
    )
    for height in (marks or {}).values():
        axis.plot(height * 1e6, 0.0, "|", ms=9, color="k", transform=axis.get_xaxis_transform(), clip_on=False)
    axis.legend(fontsize=8)
    save_figure(figure, path)


def draw_margin_map(table: MarginMap, path: Path, marks: dict[str, tuple[float, float]] | None = None) -> None:
    """Draw the peak force of both directions over gap and discrepancy; held margins are hatched."""
    from matplotlib.colors import LogNorm

    figure, axes = new_figure(1, 2, width=9.0, height=4.0)
    forces = (table.crown_to_tooth, table.tooth_to_crown)
    finite = np.concatenate([f[np.isfinite(f) & (f > 0)] for f in forces])
    norm = LogNorm(max(float(finite.min()), 1e-2), min(float(finite.max()), 50.0))
    for axis, force, name in zip(axes, forces, ("crown to tooth", "tooth to crown"), strict=True):
        shown = np.ma.masked_where(~np.isfinite(force) | (force <= 0.0), force)
        mesh = axis.pcolormesh(table.discrepancy * 1e6, table.gap * 1e6, shown, norm=norm, shading="nearest")
        held = np.where(np.isinf(force), 1.0, np.nan)
        axis.contourf(table.discrepancy * 1e6, table.gap * 1e6, held, levels=[0.5, 1.5], colors="none", hatches=["//"])
        axis.axhline(100.0, color="#b03030", lw=0.8, ls="--")
        for gap, discrepancy in (marks or {}).values():
            axis.plot(discrepancy * 1e6, gap * 1e6, "o", ms=4, mfc="none", color="k")
        axis.set(xlabel="discrepancy, tooth over crown [um]", ylabel="gap [um]")
        axis.set_title(f"{name} (white: no catch, hatched: held)", fontsize=9)
    figure.colorbar(mesh, ax=list(axes), label="peak force $F_{px}$ [N]")
    save_figure(figure, path)


def draw_ring_share(table: RingConversion, path: Path, constant: float = 0.20) -> None:
    """Draw the share of the stored energy that rings against height, one panel per friction, beside the constant."""
    count = table.frictions.size
    figure, axes = new_figure(1, count, width=3.2 * count + 1.0, height=3.8)
    for j, axis in enumerate(np.atleast_1d(axes)):
        for i, load in enumerate(table.loads):
            for k, speed in enumerate(table.speeds):
                axis.plot(
                    table.heights * 1e6,
                    table.share[:, i, j, k],
                    marker=".",
                    lw=0.9,
                    color=f"C{i}",
                    ls=("-", "--", ":", "-.")[k % 4],
                    label=f"{load:g} N, {speed * 1e3:g} mm/s",
                )
        axis.axhline(constant, color="k", lw=1)
        axis.set_title(f"mu = {table.frictions[j]:g}, angle of friction {_degrees(table.frictions[j])}", fontsize=9)
        axis.set(xlabel="step height H [um]", ylabel="share that rings", ylim=(0.0, 1.0))
    np.atleast_1d(axes)[-1].legend(fontsize=6)
    save_figure(figure, path)


def _degrees(friction: float) -> str:
    return f"{math.degrees(math.atan(friction)):.1f} deg"
