"""Compare the drag in time with figures 3 to 5 of the paper and its constant C_v = 20 %.

Run: python benchmarks/drag_like_the_paper.py [-o out/contact]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from stepblocks.contact.counterface import Step
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag.probe import PAPER_DRAG, DragSettings, Probe
from stepblocks.drag.ring import (
    RING_BAND,
    compute_phase_spectrum,
    compute_spectral_band_share,
    measure_ring,
)
from stepblocks.drag.simulate import DragTrace, simulate_drag
from stepblocks.drag.track import build_step_track
from stepblocks.files.figures import make_figure_and_axes, save_figure

R = 125e-6
LIGHT = replace(PAPER_DRAG, damping_ratio=0.01)
ROD = replace(PAPER_DRAG, damping_ratio=0.033, normal_stiffness=9.81e3, carrier_mass=20e-3)
"""A round rod: as stiff along the normal as along the drag, under 10 g of weight and of holder."""
# heights [m], loads [N], frictions, speeds [m/s]
GRID = (
    [k * 10e-6 for k in range(1, 11)],
    [0.25, 0.5, 1.0],
    [0.10, 0.15, 0.20],
    [1e-3, 5e-3, 20e-3],
)
CASES = [
    (25e-6, 1.0, 0.15),
    (50e-6, 0.5, 0.15),
    (75e-6, 0.2, 0.15),
    (75e-6, 0.4, 0.15),
    (100e-6, 0.075, 0.10),
]


def row(
    name: str, probe: Probe, height: float, load: float, mu: float, **friction: float
) -> DragTrace:
    trace = simulate_drag(
        build_step_track(height, R), probe, DragSettings(load, mu, speed=5e-3, **friction)
    )
    formula = find_release(find_step_angle(height, R), load, friction.get("static_friction", mu))
    if trace.status is not Status.RELEASES:
        print(
            f"| {name} | {height * 1e6:.0f} | {load:g} | {mu:g} | {trace.status} | | | | | | | | |"
        )
        return trace
    ring = measure_ring(trace)
    normal = compute_spectral_band_share(
        *compute_phase_spectrum(trace, "vibration", "fy_n"), RING_BAND
    )
    print(
        f"| {name} | {height * 1e6:.0f} | {load:g} | {mu:g} | {trace.peak_force:.3f} | "
        f"{formula.pull_force:.3f} "
        f"| {ring.energy * 1e6:.1f} | {ring.share:.0%} | {ring.duration * 1e3:.1f} "
        f"| {ring.decay_time * 1e3:.1f} | {ring.loading_share:.0%} "
        f"| {ring.ring_band_share:.0%} | {normal:.0%} |"
    )
    return trace


def like_the_figures() -> DragTrace:
    print(
        "\n## Figures 3 to 5: 300 Hz, damping ratio 0.01 (rod: 0.033), Hertz contact of "
        "steel, 5 "
        "mm/s"
    )
    print(
        "| load acts on | H um | N | mu | peak N | eq. (1) N | "
        "E_v uJ "
        "| "
        "share "
        "| "
        "ring "
        "ms | "
        "1/e "
        "ms "
        "| 0-100 | 250-350 | F_y |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    for case in CASES:
        row("tip", LIGHT, *case)
    for case in CASES:
        row("carrier", replace(LIGHT, normal_stiffness=9.81e3, carrier_mass=case[1] / 9.81), *case)
    shown = row("rod", ROD, 100e-6, 0.1, 0.1)
    for height, load in ((75e-6, 0.2), (50e-6, 0.5), (25e-6, 1.0)):
        row("rod", replace(ROD, carrier_mass=load / 9.81 + 10e-3), height, load, 0.15)
    for kinetic in (0.03, 0.01, 0.0):
        probe = replace(ROD, carrier_mass=1.0 / 9.81 + 10e-3)
        row(
            "rod, mu falls from 0.15",
            probe,
            25e-6,
            1.0,
            kinetic,
            static_friction=0.15,
            stribeck_speed=10e-3,
        )
    return shown


def where_it_goes() -> None:
    print(
        "\n## Where the stored energy goes between release and rest, uJ (paper's probe, 5 "
        "mm/s, 1 "
        "N, mu 0.15)"
    )
    print(
        "| H um | stored | lift | rings (E_v) | other: friction, contact and "
        "damping "
        "in "
        "the "
        "slip "
        "| share |"
    )
    print("|---|---|---|---|---|---|")
    for height in (10e-6, 25e-6, 50e-6, 75e-6):
        trace = simulate_drag(
            build_step_track(height, R), PAPER_DRAG, DragSettings(1.0, 0.15, speed=5e-3)
        )
        ring = measure_ring(trace)
        time, y = trace.column("time_s"), trace.column("y_m")
        climbed = height - float(np.interp(trace.release_time, time, y))
        rest = trace.stored_energy - climbed - ring.energy
        print(
            f"| {height * 1e6:.0f} | {trace.stored_energy * 1e6:.1f} | {climbed * 1e6:.1f} "
            f"| {ring.energy * 1e6:.1f} | {rest * 1e6:.1f} | {ring.share:.0%} |"
        )


def shares() -> np.ndarray:
    """Compute the share that rings, by heights, loads, frictions, speeds; NaN where a tip locks."""
    share = np.full([len(axis) for axis in GRID], np.nan)
    for place in np.ndindex(*share.shape):
        height, load, friction, speed = (axis[k] for axis, k in zip(GRID, place, strict=True))
        trace = simulate_drag(
            build_step_track(height, R), PAPER_DRAG, DragSettings(load, friction, speed=speed)
        )
        if trace.status is Status.RELEASES:
            share[place] = measure_ring(trace, with_spectra=False).share
    return share


def share_map() -> np.ndarray:
    heights, loads, frictions, speeds = GRID
    share = shares()
    print("\n## Share of the stored energy that rings (paper: 20 % everywhere); - locks")
    for j, mu in enumerate(frictions):
        labels = " | ".join(f"{load:g} N, {v * 1e3:g} mm/s" for load in loads for v in speeds)
        print(f"\nmu = {mu:g}\n\n| H um | {labels} |\n|---|{'---|' * (len(loads) * len(speeds))}")
        for h, height in enumerate(heights):
            cells = share[h, :, j, :].ravel()
            print(
                f"| {height * 1e6:.0f} | "
                + " | ".join("-" if np.isnan(c) else f"{c:.0%}" for c in cells)
                + " |"
            )
    released = share[np.isfinite(share)]
    print(
        f"\nmedian {np.median(released):.0%}, 5 % to 95 %: {np.quantile(released, 0.05):.0%} to "
        f"{np.quantile(released, 0.95):.0%}, of {released.size} drags"
    )
    return share


def draw_ring_share(share: np.ndarray, path: Path) -> None:
    """Draw the share against height, one panel per friction, beside the constant."""
    heights, loads, frictions, speeds = GRID
    figure, axes = make_figure_and_axes(
        1, len(frictions), width=3.2 * len(frictions) + 1.0, height=3.8
    )
    for j, axis in enumerate(axes):
        for (i, load), (k, speed) in product(enumerate(loads), enumerate(speeds)):
            look = {"marker": ".", "lw": 0.9, "color": f"C{i}", "ls": ("-", "--", ":")[k]}
            axis.plot(
                1e6 * np.array(heights),
                share[:, i, j, k],
                label=f"{load:g} N, {speed * 1e3:g} mm/s",
                **look,
            )
        axis.axhline(PAPER.tool.conversion, color="k", lw=1)
        degrees = np.degrees(np.arctan(frictions[j]))
        axis.set_title(f"mu = {frictions[j]:g}, angle of friction {degrees:.1f} deg", fontsize=9)
        axis.set(xlabel="step height H [um]", ylabel="share that rings", ylim=(0.0, 1.0))
    axes[-1].legend(fontsize=6)
    save_figure(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, help="folder for the pictures")
    folder = parser.parse_args().output
    shown = like_the_figures()
    where_it_goes()
    table = share_map()
    if folder is None:
        return
    from stepblocks.drag.figures import draw_forces, draw_spectra
    from stepblocks.predict.figures import draw_energy_of_height, draw_margin_map

    draw_forces(shown, folder / "drag-force.png", "Rod, 100 um, 0.1 N, mu 0.1, 5 mm/s")
    draw_spectra(shown, folder / "drag-spectra.png", "Rod, 100 um, 0.1 N, mu 0.1, 5 mm/s")
    draw_ring_share(table, folder / "ring-share.png")
    uncertain = {"height": 0.5e-6, "ball_radius": 1e-6, "friction": 0.01, "normal_load": 0.01}
    faces = [Step(height) for height in np.linspace(2e-6, 120e-6, 60)]
    draw_energy_of_height(faces, PAPER, uncertain, folder / "energy-of-height.png")
    axis = np.linspace(0, 150e-6, 76), np.linspace(-100e-6, 100e-6, 81)
    draw_margin_map(*axis, PAPER, folder / "margin-map.png")
    print(f"\npictures in {folder}")


if __name__ == "__main__":
    main()
