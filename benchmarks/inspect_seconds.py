"""Measure how long ``stepblocks inspect`` takes from its start to the verdict.

Run from the root of the repository: ``python benchmarks/inspect_seconds.py``. A profile of 4,000
points is to take about 1 s and a map of 1,000 x 1,000 about 5 s. Judged is the processor time of
the command and of its reader, which another load changes little; the wall time stands beside it,
and what the command takes to start and to say its version. As after an installation, the code is
compiled: the first of the rounds does so, into a folder of its own. Exit code 1 if one is slower.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # the gauges are oracles of the tests

from oracles.softgauge import correlated_map, correlated_noise, edge_gauge

UM, NM = 1e-6, 1e-9
ROUNDS = 3


def least(compiled: Path, *words: str) -> tuple[float, float]:
    """Find the least wall and processor time of a command over some rounds [s]."""
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
    }
    environment |= {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPYCACHEPREFIX": str(compiled),
    }
    walls, busy = [], []
    for _ in range(ROUNDS):
        wall, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "stepblocks", *words]
        subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        walls.append(time.perf_counter() - wall)
        busy.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(walls), min(busy)


def write(folder: Path) -> dict[str, tuple[Path, str]]:
    """Write the scans: a profile over an edge, a map of an edge, and one of a grating of holes."""
    import x3pio

    random = np.random.default_rng(1)
    x = np.arange(-2000, 2000) * 0.25 * UM
    z = edge_gauge(x, 50 * UM, 5 * UM, 5e-4) + correlated_noise(
        len(x), 0.25 * UM, 10 * NM, 30 * NM, 2 * UM, random
    )
    profile = folder / "profile.csv"
    rows = np.stack([x, z], axis=1) * 1e6
    np.savetxt(profile, rows, delimiter=",", header="x_um,z_um", comments="", fmt="%.4f")
    noise = correlated_map((1000, 1000), UM, 5 * NM, 10 * NM, 3 * UM, random)
    v, u = np.mgrid[:1000, :1000]
    holes = np.where(((u - 6) % 100 < 45) & ((v + 3) % 100 < 45), -500 * NM, 0.0)
    found: dict[str, tuple[Path, str]] = {"profile of 4,000 points": (profile, "edge")}
    for name, heights, feature in (
        (
            "map of 1,000 x 1,000, edge",
            edge_gauge(np.arange(-500, 500) * UM, 50 * UM, 5 * UM)[np.newaxis, :] + noise,
            "edge",
        ),
        ("map of 1,000 x 1,000, grating", holes + noise, "groove"),
    ):
        path = folder / f"{feature}.x3p"
        x3pio.write(str(path), heights, x_scale=UM, y_scale=UM)
        found[name] = path, feature
    return found


def main() -> int:
    """Print the table; 1 if an inspection takes more than its share."""
    print(f"{'scan':32} {'wall s':>8} {'busy s':>8}")
    slow = 0
    with tempfile.TemporaryDirectory() as folder:
        compiled = Path(folder) / "compiled"
        wall, busy = least(compiled, "--version")
        print(f"{'(the start alone)':32} {wall:8.2f} {busy:8.2f}")
        for name, (path, feature) in write(Path(folder)).items():
            wall, busy = least(compiled, "inspect", str(path), "--feature", feature)
            most = 5.0 if "map" in name else 1.0
            slow += busy > most
            print(f"{name:32} {wall:8.2f} {busy:8.2f}{'  SLOW' if busy > most else ''}", flush=True)
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
