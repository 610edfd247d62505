"""Whole sessions of the virtual bench on disk, as laboratories keep them: design, scatter, and what
nobody writes down.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from oracles.virtual_bench import Bench, Floats, drag

_ROOM = 22.0  # temperature about which springs soften [C]
_COLUMNS = (
    "trial",
    "block",
    "height_um",
    "load_n",
    "speed_mm_s",
    "tip",
    "run_order",
    "temperature_c",
    "humidity_pct",
)


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


class _Setting(NamedTuple):
    """What is set in a trial."""

    height: float  # of the block's label [m]
    load: float  # [N]
    speed: float  # [m/s]


@dataclass(frozen=True)
class _Run:
    """What the trials of a session set and met, one entry for each."""

    settings: list[_Setting]
    walk: Floats  # random walk of rms 1 at its end
    temperature: Floats  # [C]
    wetness: Floats  # on the scale of the temperature; see `humidity`

    @property
    def humidity(self) -> Floats:
        """Relative humidity [%]."""
        return 50.0 + 6.0 * (self.wetness - _ROOM)


def write_session(folder: Path, plan: Plan, seed: int) -> list[dict[str, Any]]:
    """Write a session as laboratories keep it, and return what is true of each of its trials (also
    ``truth.json``).
    """
    random = np.random.default_rng([seed, 1])
    folder.mkdir(parents=True)
    _write_declaration(folder, plan, seed)
    true_heights = _draw_heights(plan, random)
    if plan.scans:
        _write_scans(folder / "scans", plan, true_heights, seed, random)
    run = _draw_run(plan, random)
    with (
        h5py.File(folder / "traces.h5", "w") as file,
        (folder / "trials.csv").open("w", newline="") as table,
    ):
        rows = csv.writer(table, lineterminator="\n")
        rows.writerow(_COLUMNS if plan.hide_operator else [*_COLUMNS, "operator"])
        told = []
        for trial in _drag_trials(plan, run, true_heights, seed, random):
            _write_trace(file, trial)
            row = _format_row(run, trial)
            rows.writerow(row if plan.hide_operator else [*row, trial.operator])
            told.append({"trial": trial.number, **trial.truth})
    (folder / "truth.json").write_text(json.dumps({"bench": asdict(plan.bench), "trials": told}))
    return told


def _write_declaration(folder: Path, plan: Plan, seed: int) -> None:
    """Write ``session.toml``; a certificate misses the true spring by what it says of itself."""
    miss = plan.spring_std * np.random.default_rng([seed, 3]).standard_normal()
    declared = plan.bench.stiffness * (1.0 + miss)
    lines = [
        "schema = 1",
        f'title = "{folder.name}"',
        "",
        "[probe]",
        f'spring_constant = "{declared} N/m"',
        f'tip_radius = "{plan.bench.tip_radius * 1e6:g} um"',
        "",
        "[acquisition]",
        'sample_rate = "10 kHz"',
        'traces = "traces.h5"',
        'channels = { time = "time_s", tangential = "fx_n", normal = "fy_n" }',
        "",
        "[stimuli]",
        'set = "paper-ten"',
    ]
    if plan.scans:
        lines.append('scans = "scans/{block}.csv"')
    if plan.spring_std:
        std = plan.spring_std * declared
        lines += ["", "[calibration]", f'spring_constant = ["{declared} N/m", "{std} N/m"]']
    (folder / "session.toml").write_text("\n".join(lines) + "\n")


def _draw_heights(plan: Plan, random: np.random.Generator) -> dict[float, float]:
    """Draw the true height of each block, by that of its label [m]."""
    true_heights = {}
    for height in plan.heights:
        scatter = plan.height_scatter * random.standard_normal()
        true_heights[height] = height + plan.machined_off.get(round(height * 1e6), scatter)
    return true_heights


def _write_scans(
    folder: Path,
    plan: Plan,
    true_heights: Mapping[float, float],
    seed: int,
    random: np.random.Generator,
) -> None:
    """Write a profilometer line of each block."""
    folder.mkdir()
    profilometer = np.random.default_rng([seed, 5])
    for height, true_height in true_heights.items():
        seen = true_height + plan.scan_error * profilometer.standard_normal()
        table = np.column_stack(scan(seen, plan.bench.edge_radius, random))
        path = folder / f"{_name_block(height)}.csv"
        np.savetxt(path, table, fmt="%.3f", delimiter=",", header="x_um,z_um", comments="")


def _name_block(height: float) -> str:
    """Return the label of a block of a height [m]."""
    return f"step-{round(height * 1e6):03d}"


def _draw_run(plan: Plan, random: np.random.Generator) -> _Run:
    """Draw the order of the settings, and the surroundings of the run."""
    every = [_Setting(*values) for values in product(plan.heights, plan.loads, plan.speeds)]
    drawn = random.permutation(len(every))[: plan.combinations or len(every)]
    order = random.permutation(np.arange(plan.trials) % len(drawn))
    walk = np.cumsum(random.standard_normal(plan.trials)) / math.sqrt(plan.trials)
    temperature, wetness = _ROOM + np.cumsum(random.normal(0.0, 0.15, (2, plan.trials)), axis=1)
    settings = [every[drawn[place]] for place in order]
    return _Run(settings, walk, temperature, wetness)


class _Trial(NamedTuple):
    """A trial as it was recorded."""

    number: int  # from 1
    setting: _Setting
    operator: str
    traces: tuple[Floats, Floats, Floats]  # time [s], tangential and normal force [N]
    truth: dict[str, Any]


def _drag_trials(
    plan: Plan,
    run: _Run,
    true_heights: Mapping[float, float],
    seed: int,
    random: np.random.Generator,
) -> Iterator[_Trial]:
    """Yield the trials in which the tip passes the edge."""
    passes = dict.fromkeys(plan.heights, 0)
    careless = np.random.default_rng([seed, 4])
    for number, setting in enumerate(run.settings, start=1):
        operator = "AB"[int(random.integers(2))]
        scatter = 1.0 + plan.friction_scatter * random.standard_normal()
        factor = _compute_friction_factor(plan, run, number, operator, scatter)
        share = plan.conversion_scatter * random.standard_normal()
        bench = replace(plan.bench, friction=plan.bench.friction * factor)
        if bench.conversion is not None:
            own = plan.operator_conversion.get(operator, 1.0)
            bench = replace(bench, conversion=bench.conversion * own * math.exp(share))
        if plan.chip_at and number >= plan.chip_at:
            bench = replace(bench, tip_radius=plan.chip_radius)
        let_go = 1.0
        if careless.random() < plan.let_go:
            let_go = float(careless.uniform(0.45, 0.8))
        softer = 1.0 - plan.softening * (run.temperature[number - 1] - _ROOM)
        bench = replace(
            bench,
            stiffness=bench.stiffness * softer,
            frequency=bench.frequency * math.sqrt(softer),
            edge_radius=bench.edge_radius + plan.polish * passes[setting.height],
            let_go=let_go,
        )
        passes[setting.height] += 1
        load = setting.load + plan.operator_load.get(operator, 0.0)
        true_height = true_heights[setting.height]
        own_random = np.random.default_rng([seed, 2, number])
        done = drag(bench, true_height, load, setting.speed, own_random)
        if done is not None:
            yield _Trial(number, setting, operator, done[:3], done[3])


def _compute_friction_factor(
    plan: Plan, run: _Run, number: int, operator: str, scatter: float
) -> float:
    """Factor of friction in one trial by all that is peculiar in the plan."""
    height, load, speed = run.settings[number - 1]
    factor = scatter * plan.operator_friction.get(operator, 1.0)
    factor *= math.exp(plan.wandering_friction * run.walk[number - 1])
    factor *= 1.0 + plan.running_in * math.exp(-number / plan.running_in_trials)
    if round(height * 1e6) in plan.batch_blocks:
        factor *= plan.batch_friction
    if plan.change_at and number >= plan.change_at:
        factor *= plan.change_friction
    factor *= _follow_the_hour(plan, number)
    if number > 1:
        load_before = run.settings[number - 2].load
        factor *= (load_before / 0.6) ** plan.carry_over
    if run.wetness[number - 1] > np.median(run.wetness):
        factor *= plan.wet_friction
    return factor * (1.0 + plan.hersey_excess * math.exp(-speed / load / plan.hersey_number))


def _follow_the_hour(plan: Plan, number: int) -> float:
    """Factor of friction in one trial by what goes with its number alone."""
    factor = 1.0 + plan.swing * math.cos(2.0 * math.pi * number / plan.swing_trials)
    if plan.day_levels:
        factor *= plan.day_levels[(number - 1) * len(plan.day_levels) // plan.trials]
    return factor


def _write_trace(file: h5py.File, trial: _Trial) -> None:
    """Write the record of a trial."""
    group = file.create_group(f"{trial.number:04d}")
    for name, values in zip(("time_s", "fx_n", "fy_n"), trial.traces, strict=True):
        group.create_dataset(name, data=values.astype(np.float32), track_times=False)


def _format_row(run: _Run, trial: _Trial) -> list[object]:
    """Return the row of a trial, but for its operator; see `_COLUMNS`."""
    height, load, speed = trial.setting
    return [
        trial.number,
        _name_block(height),
        round(height * 1e6),
        f"{load:g}",
        f"{speed * 1e3:g}",
        "tip-125",
        trial.number,
        f"{run.temperature[trial.number - 1]:.2f}",
        f"{run.humidity[trial.number - 1]:.1f}",
    ]
