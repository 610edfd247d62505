"""A bench that yields features instead of traces: designs, scatter, height errors, any effect
planted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.operating_point import Tool
from stepblocks.lawsearch.forward_model import Trials
from stepblocks.lawsearch.law import ActiveEffects
from stepblocks.loop.bench_model import SessionModel
from stepblocks.rig.forward import make_height_error_name
from stepblocks.rig.state import CHANNELS, compute_shown_channels

__all__ = [
    "BenchScatter",
    "bench_trials",
    "block_errors",
    "block_scans",
    "design_columns",
    "noise_free",
]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class BenchScatter:
    """Scatter of a bench.

    Attributes
    ----------
    energy : float
        Standard deviation of ln E_v between trials [1].
    friction : float
        Standard deviation of the coefficient of friction between trials [1].
    height : float
        Standard deviation of the height of a block [m].
    load : float
        Relative standard deviation of the normal load between trials, seen by the gauge [1].
    force : float
        Noise of a force sample [N].
    """

    energy: float = 0.07
    friction: float = 0.005
    height: float = 1e-6
    load: float = 0.004
    force: float = 4.5e-3


def design_columns(trials: int, seed: int) -> dict[str, NDArray[Any]]:
    """Lay out a session like the shared ones: eight blocks, four loads, four speeds, random order,
    drifting climate.

    Parameters
    ----------
    trials : int
        Number of drags.
    seed : int
        Seed of order and climate.

    Returns
    -------
    dict
        Columns as in trials.csv, with ``block`` and ``tip_radius_um``.
    """
    generator = np.random.default_rng(seed)
    cells = [
        (h, n, v)
        for h in range(10, 90, 10)
        for n in (0.3, 0.5, 0.8, 1.1)
        for v in (2.0, 5.0, 10.0, 20.0)
    ]
    rounds = -(-trials // len(cells))
    order = np.concatenate([generator.permutation(len(cells)) for _ in range(rounds)])[:trials]
    chosen = np.array([cells[i] for i in generator.permutation(order)])
    time = np.arange(trials) / max(trials - 1, 1)
    phase, depth = generator.uniform(0.0, 2.0 * np.pi), generator.uniform(1.0, 3.0)
    temperature = 22.0 + depth * np.sin(2.0 * np.pi * generator.uniform(0.5, 1.5) * time + phase)
    humidity = 47.0 + np.cumsum(generator.normal(0.0, 12.0 / np.sqrt(trials), trials))
    return {
        "block": np.array([f"step-{int(h):03d}" for h in chosen[:, 0]]),
        "height_um": chosen[:, 0],
        "load_n": chosen[:, 1],
        "speed_mm_s": chosen[:, 2],
        "run_order": np.arange(1.0, trials + 1.0),
        "temperature_c": np.round(temperature + generator.normal(0.0, 0.4, trials), 2),
        "humidity_pct": np.round(humidity + generator.normal(0.0, 1.0, trials), 1),
        "operator": generator.choice(["A", "B"], trials),
        "tip_radius_um": np.full(trials, 125.0),
    }


def block_errors(
    columns: Mapping[str, NDArray[Any]], seed: int, std: float = 1e-6
) -> dict[str, float]:
    """Height errors of the blocks of a bench [m], normal, held within four deviations."""
    generator = np.random.default_rng([seed, 2])
    blocks = [str(b) for b in np.unique(columns["block"])]
    drawn = np.clip(generator.standard_normal(len(blocks)), -4.0, 4.0) * std
    return dict(zip(blocks, drawn.tolist(), strict=True))


def block_scans(
    columns: Mapping[str, NDArray[Any]], seed: int, std: float = 1e-6
) -> dict[str, tuple[float, float]]:
    """Scan those blocks: height and standard uncertainty of 15 nm [m]."""
    generator = np.random.default_rng([seed, 3])
    nominal = {
        str(b): float(h) * 1e-6 for b, h in zip(columns["block"], columns["height_um"], strict=True)
    }
    errors = block_errors(columns, seed, std)
    return {
        b: (nominal[b] + e + float(generator.normal(0.0, 15e-9)), 15e-9) for b, e in errors.items()
    }


def bench_trials(
    columns: Mapping[str, NDArray[Any]],
    seed: int,
    effects: ActiveEffects = (),
    scatter: BenchScatter | None = None,
    truth: Mapping[str, float] | None = None,
) -> Trials:
    """Measure a design on the bench.

    Parameters
    ----------
    columns : mapping
        Columns of `design_columns`.
    seed : int
        Seed of specimens and scatter.
    effects : tuple of (Effect, values)
        What the nominal model lacks.
    scatter : BenchScatter, optional
        Scatter of the bench.
    truth : mapping, optional
        Constants other than friction 0.16, conversion 0.22, 300 Hz, 20 ms.

    Returns
    -------
    Trials
        Features with their uncertainties; a trial beyond the gauge's 5 N or locked has none.
    """
    scatter = scatter or BenchScatter()
    generator = np.random.default_rng([seed, 1])
    n = len(columns["block"])
    empty, model, values = _bench(columns, seed, scatter.height, truth)
    state = model.compute_state(empty, values, effects)
    stray = np.exp(generator.normal(0.0, scatter.load, n))
    # friction and conversion scatter from trial to trial: the first moves three channels at once
    state = state.changed(
        friction=np.maximum(state.friction + generator.normal(0.0, scatter.friction, n), 0.01),
        load=state.load * stray,
        sensed_offset=state.sensed_offset + (stray - 1.0) * state.set_load,
        conversion=state.conversion * np.exp(generator.normal(0.0, scatter.energy, n)),
    )
    exact = compute_shown_channels(state)
    amplitude = np.sqrt(2.0 * 9810.0 * np.exp(exact[:, 0]))
    force = np.exp(exact[:, 1])
    load = columns["load_n"]
    std = np.stack(
        [
            0.2 * scatter.force / amplitude + 1e-3,
            0.3 * scatter.force / force + 1e-4,
            0.05 * scatter.force / load + 1e-5,
            1.5e-2 * scatter.force / force * columns["speed_mm_s"] / 5.0 + 2e-4,
            6e-3 * scatter.force / amplitude / 10.0 + 2e-5,
            0.05 * scatter.force / amplitude + 1e-3,
            0.05 * scatter.force / load + 1e-5,
        ],
        axis=1,
    )
    values_seen = exact + std * generator.standard_normal((n, 7))
    values_seen[(force > 5.0) | state.mark_locked_trials()] = np.nan
    rows = np.asarray(np.isfinite(values_seen).any(axis=1))
    return Trials(empty.covariates, CHANNELS, values_seen, std, columns["block"]).take(rows)


def noise_free(
    columns: Mapping[str, NDArray[Any]],
    seed: int,
    effects: ActiveEffects = (),
    truth: Mapping[str, float] | None = None,
    height_std: float = 1e-6,
) -> Floats:
    """Channels of a design on the same blocks without scatter or noise, shape (n, 7)."""
    empty, model, values = _bench(columns, seed, height_std, truth)
    return model.predict(empty, values, effects)


def _bench(
    columns: Mapping[str, NDArray[Any]],
    seed: int,
    height_std: float,
    truth: Mapping[str, float] | None,
) -> tuple[Trials, SessionModel, dict[str, float]]:
    covariates = {name: column for name, column in columns.items() if name != "block"}
    n = len(columns["block"])
    empty = Trials(covariates, CHANNELS, np.zeros((n, 7)), np.zeros((n, 7)), columns["block"])
    values = {
        "friction": 0.16,
        "ln_conversion": float(np.log(0.22)),
        "stiffness_ratio": 1.0,
        "ln_ring_frequency": float(np.log(300.0)),
        "ln_decay_time": float(np.log(0.02)),
    } | dict(truth or {})
    values |= {
        make_height_error_name(b): e for b, e in block_errors(columns, seed, height_std).items()
    }
    return empty, SessionModel(Tool(frequency=300.0, decay_time=0.02)), values
