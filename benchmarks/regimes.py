"""Measure how well regimes and their E_v are found, on records of the bench of the tests.

Run as ``python benchmarks/regimes.py [TRIALS [REGIME [SEED]]]`` (default 400, a third of them with
static friction twice the kinetic one; where a regime is named, its trials alone, of twenty times as
many drags). It prints which regime was said of which, and for each the error of ln E_v and the
pulls of the ring's amplitude (error over its stated standard uncertainty: 1 where that is right).
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.virtual_bench import Bench, drag
from stepblocks.bench.faults import LandmarkError
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.features import measure_trace

HEIGHTS, LOADS = 1e-6 * np.arange(10, 90, 10), (0.3, 0.5, 0.8, 1.1)
SERIES = {
    "slides": (Bench(), (2e-3, 5e-3, 10e-3, 20e-3), 0.5),
    "sticks": (Bench(static_ratio=2.0), (1e-3, 3e-3, 5e-3), 0.33),
    "bell": (Bench(conversion=0.2), (2e-3, 5e-3, 10e-3, 20e-3), 0.17),
}
TOOL = (300.0, 1.0 / (0.025 * 2.0 * np.pi * 300.0))


def rows(trials, regime=None, seed=1):
    """Make one row per trial, found beside true, of all regimes or of one."""
    trials *= 20 if regime else 1
    random = np.random.default_rng(int(seed))
    for name, (bench, speeds, share) in SERIES.items():
        for _ in range(round(share * trials)):
            height, load, speed = (
                random.choice(HEIGHTS),
                random.choice(LOADS),
                random.choice(speeds),
            )
            friction = 0.15 * (1.0 + 0.03 * random.standard_normal())
            done = drag(replace(bench, friction=friction), height, load, speed, random)
            if done is None:
                continue
            truth = done[3]
            if regime and truth["regime"] != regime:
                continue
            try:
                found = measure_trace(Trace(*done[:3]), 9810.0, speed, TOOL)
            except LandmarkError as fault:
                yield {"series": name, "true": truth["regime"], "said": str(fault).split(":")[0]}
                continue
            size, std = found.aftermath.amplitude
            yield {
                "series": name,
                "true": truth["regime"],
                "said": found.regime,
                "pull": (size - truth["amplitude_n"]) / std,
                "ln_error": 2.0 * np.log(max(size, 1e-4) / max(truth["amplitude_n"], 1e-4)),
                "static": found.features["static_friction"] / friction,
            }


def main():
    """Print both tables."""
    table = pd.DataFrame(rows(int(sys.argv[1]) if len(sys.argv) > 1 else 400, *sys.argv[2:4]))
    print(pd.crosstab(table.true, table.said).to_string())
    print(f"right: {(table.true == table.said).mean():.1%} of {len(table)}")
    found = table.groupby("true").agg(
        trials=("pull", "size"),
        mean_pull=("pull", "mean"),
        rms_pull=("pull", lambda a: float(np.sqrt(np.mean(a**2)))),
        robust_pull=("pull", lambda a: float(np.median(np.abs(a)) / 0.6745)),
        median_ln_error=("ln_error", lambda a: float(np.median(np.abs(a)))),
    )
    print(found.round(3).to_string())
    static = table.static[table.true == "stick-slip"]
    print(
        f"static friction named in {static.notna().mean():.0%}; over the kinetic one "
        f"{static.median():.2f} (true 2.00)"
    )


if __name__ == "__main__":
    main()
