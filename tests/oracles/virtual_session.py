"""Whole sessions of the virtual bench on disk, as laboratories keep them: design, scatter, and what
nobody writes down.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from oracles.virtual_bench import Bench, Floats, drag


@dataclass(frozen=True)
class Plan:
    """A session: bench, design, scatter, and what is peculiar. Numbers of trials count the run
    order from 1.
    """

    bench: Bench = field(default_factory=Bench)
    trials: int = 96
    heights: tuple[float, ...] = tuple(1e-6 * h for h in range(10, 90, 10))  # [m]
    loads: tuple[float, ...] = (0.3, 0.5, 0.8, 1.1)  # [N]
    speeds: tuple[float, ...] = (2e-3, 5e-3, 10e-3, 20e-3)  # [m/s]
    combinations: int | None = (
        None  # of height, load and speed that are used, so that each is repeated
    )
    friction_scatter: float = 0.03  # relative, from trial to trial
    conversion_scatter: float = 0.05  # of ln C_v, where there is a conversion
    height_scatter: float = 0.3e-6  # of the blocks about their label [m]
    scans: bool = True
    scan_error: float = 0.0  # of the height that the scan of a block shows [m]
    spring_std: float = (
        0.0  # relative uncertainty of the certificate of the spring, where there is one
    )
    operator_load: Mapping[str, float] = field(default_factory=dict)  # added by an operator [N]
    operator_friction: Mapping[str, float] = field(default_factory=dict)  # factor of an operator
    operator_conversion: Mapping[str, float] = field(default_factory=dict)  # factor of an operator
    hide_operator: bool = False  # the column is left out
    chip_at: int | None = None  # from this trial on the tip has another radius
    chip_radius: float = 90e-6  # [m]
    batch_blocks: tuple[int, ...] = ()  # heights [um] of blocks that came in another batch
    batch_friction: float = 1.0  # factor on them
    wandering_friction: float = 0.0  # rms of ln mu at the end of a random walk
    running_in: float = 0.0  # friction is higher by this share at first
    running_in_trials: float = 25.0  # over which that falls to 1/e
    change_at: int | None = None  # from this trial on friction is another
    change_friction: float = 1.0  # factor
    let_go: float = 0.0  # share of trials in which the operator lets go at 45 to 80 % of the peak
    swing: float = 0.0  # of friction along the run, relative
    swing_trials: float = 40.0  # its period
    day_levels: tuple[float, ...] = ()  # factors of friction, one for each equal part of the run
    carry_over: float = 0.0  # exponent of friction over the load of the trial before
    wet_friction: float = 1.0  # factor above the median humidity of the session
    softening: float = 0.0  # of the spring about 22 degrees C [1/K]
    hersey_excess: float = 0.0  # mu (1 + s exp(-(v / F_py) / h)): s
    hersey_number: float = 5e-3  # h [m/(s N)]
    # what blocks are off by in place of their scatter, by the height of their label [um] [m]
    machined_off: Mapping[int, float] = field(default_factory=dict)
    polish: float = 0.0  # growth of the radius of an edge with each pass over its block [m]


def _follow_the_hour(plan: Plan, number: int) -> float:
    """Factor of friction in one trial by what goes with its number alone."""
    factor = 1.0 + plan.swing * math.cos(2.0 * math.pi * number / plan.swing_trials)
    if plan.day_levels:
        factor *= plan.day_levels[(number - 1) * len(plan.day_levels) // plan.trials]
    return factor


def scan(height: float, radius: float, random: np.random.Generator) -> tuple[Floats, Floats]:
    """A profilometer line across the edge [um], tilted and noisy."""
    x = np.arange(-600.0, 600.0 + 0.125, 0.25)
    h, r = 1e6 * height, 1e6 * radius
    inside = np.clip(x, 0.0, r)
    z = np.where(
        x < 0.0, 0.0, np.maximum(h - r + np.sqrt(np.maximum(r * r - (inside - r) ** 2, 0.0)), 0.0)
    )
    tilt = random.uniform(-3.0, 3.0) + 3e-4 * random.standard_normal() * x
    return x, z + tilt + 0.05 * random.standard_normal(x.size)


def write_session(folder: Path, plan: Plan, seed: int) -> list[dict[str, Any]]:
    """Write a session as laboratories keep it, and return what is true of each of its trials (also
    ``truth.json``).
    """
    random = np.random.default_rng([seed, 1])
    folder.mkdir(parents=True)
    # a certificate misses the true spring by what it says of itself
    declared = plan.bench.stiffness * (
        1.0 + plan.spring_std * np.random.default_rng([seed, 3]).standard_normal()
    )
    certificate = (
        f'\n[calibration]\nspring_constant = ["{declared} N/m", "{plan.spring_std * declared} '
        'N/m"]\n'
    )
    (folder / "session.toml").write_text(
        f'schema = 1\ntitle = "{folder.name}"\n\n[probe]\nspring_constant = "{declared} N/m"\n'
        f'tip_radius = "{plan.bench.tip_radius * 1e6:g} '
        'um"\n\n[acquisition]\nsample_rate '
        "= "
        '"10 '
        'kHz"\n'
        'traces = "traces.h5"\nchannels = { time = "time_s", tangential = "fx_n", normal = '
        '"fy_n" '
        "}\n\n[stimuli]\n"
        'set = "paper-ten"\n'
        + ('scans = "scans/{block}.csv"\n' if plan.scans else "")
        + (certificate if plan.spring_std else "")
    )
    true_heights = {
        h: h + plan.machined_off.get(round(h * 1e6), plan.height_scatter * random.standard_normal())
        for h in plan.heights
    }
    if plan.scans:
        (folder / "scans").mkdir()
        profilometer = np.random.default_rng([seed, 5])
        for height, true in true_heights.items():
            seen = true + plan.scan_error * profilometer.standard_normal()
            table = np.column_stack(scan(seen, plan.bench.edge_radius, random))
            path = folder / "scans" / f"step-{round(height * 1e6):03d}.csv"
            np.savetxt(path, table, fmt="%.3f", delimiter=",", header="x_um,z_um", comments="")
    full = [(h, n, v) for h in plan.heights for n in plan.loads for v in plan.speeds]
    used = [full[i] for i in random.permutation(len(full))[: plan.combinations or len(full)]]
    order = random.permutation(np.arange(plan.trials) % len(used))
    walk = np.cumsum(random.standard_normal(plan.trials)) / math.sqrt(plan.trials)
    warmth, wet = 22.0 + np.cumsum(random.normal(0.0, 0.15, (2, plan.trials)), axis=1)
    told, passes, before = [], dict.fromkeys(plan.heights, 0), math.nan
    careless = np.random.default_rng([seed, 4])
    with (
        h5py.File(folder / "traces.h5", "w") as file,
        (folder / "trials.csv").open("w", newline="") as table,
    ):
        columns = [
            "trial",
            "block",
            "height_um",
            "load_n",
            "speed_mm_s",
            "tip",
            "run_order",
            "temperature_c",
        ]
        columns += ["humidity_pct", *([] if plan.hide_operator else ["operator"])]
        rows = csv.writer(table, lineterminator="\n")
        rows.writerow(columns)
        for number in range(1, plan.trials + 1):
            height, load, speed = used[order[number - 1]]
            operator, um = "AB"[int(random.integers(2))], round(height * 1e6)
            factor = (
                1.0 + plan.friction_scatter * random.standard_normal()
            ) * plan.operator_friction.get(operator, 1.0)
            factor *= math.exp(plan.wandering_friction * walk[number - 1])
            factor *= 1.0 + plan.running_in * math.exp(-number / plan.running_in_trials)
            factor *= plan.batch_friction if um in plan.batch_blocks else 1.0
            factor *= plan.change_friction if plan.change_at and number >= plan.change_at else 1.0
            factor *= _follow_the_hour(plan, number)
            factor *= 1.0 if math.isnan(before) else (before / 0.6) ** plan.carry_over
            factor *= plan.wet_friction if wet[number - 1] > np.median(wet) else 1.0
            factor *= 1.0 + plan.hersey_excess * math.exp(-speed / load / plan.hersey_number)
            before = load
            share = plan.conversion_scatter * random.standard_normal()
            bench = replace(plan.bench, friction=plan.bench.friction * factor)
            if bench.conversion is not None:
                own = plan.operator_conversion.get(operator, 1.0)
                bench = replace(bench, conversion=bench.conversion * own * math.exp(share))
            if plan.chip_at and number >= plan.chip_at:
                bench = replace(bench, tip_radius=plan.chip_radius)
            bench = replace(
                bench,
                stiffness=bench.stiffness * (1.0 - plan.softening * (warmth[number - 1] - 22.0)),
                frequency=bench.frequency
                * math.sqrt(1.0 - plan.softening * (warmth[number - 1] - 22.0)),
                edge_radius=bench.edge_radius + plan.polish * passes[height],
                let_go=float(careless.uniform(0.45, 0.8))
                if careless.random() < plan.let_go
                else 1.0,
            )
            passes[height] += 1
            added = plan.operator_load.get(operator, 0.0)
            done = drag(
                bench,
                true_heights[height],
                load + added,
                speed,
                np.random.default_rng([seed, 2, number]),
            )
            if done is None:
                continue
            group = file.create_group(f"{number:04d}")
            for name, values in zip(("time_s", "fx_n", "fy_n"), done[:3], strict=True):
                group.create_dataset(name, data=values.astype(np.float32), track_times=False)
            temperature, humidity = (
                f"{warmth[number - 1]:.2f}",
                f"{50.0 + 6.0 * (wet[number - 1] - 22.0):.1f}",
            )
            row = [
                number,
                f"step-{um:03d}",
                um,
                f"{load:g}",
                f"{speed * 1e3:g}",
                "tip-125",
                number,
                temperature,
                humidity,
            ]
            rows.writerow(row if plan.hide_operator else [*row, operator])
            told.append({"trial": number, **done[3]})
    (folder / "truth.json").write_text(json.dumps({"bench": asdict(plan.bench), "trials": told}))
    return told
