"""How long an inspection takes from the file to the verdict, the confined reader's start included, beside a raw read of it.

Run from the root of the repository: ``python benchmarks/inspect_seconds.py``. A profile of 4,000 points is to take about 1 s and a
map of 1,000 x 1,000 about 5 s. Judged is the processor time of the evaluation, which another load does not change; the wall time and
its ratio to a raw read, the confined reader included in both, stand beside it. Exit code 1 if one is slower.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # the gauges are oracles of the tests

from oracles.softgauge import correlated_map, correlated_noise, edge_gauge
from stepblocks.artefacts.scans.read import read_scan
from stepblocks.inspect.run import inspect_standard

UM, NM = 1e-6, 1e-9
ROUNDS = 3


def least(done: Callable[[], object]) -> tuple[float, float]:
    """Least wall time and least processor time of this process over some rounds [s]."""
    walls, busy = [], []
    for _ in range(ROUNDS):
        wall, own = time.perf_counter(), time.process_time()
        done()
        walls.append(time.perf_counter() - wall)
        busy.append(time.process_time() - own)
    return min(walls), min(busy)


def write(folder: Path) -> dict[str, tuple[Path, str]]:
    """Write the scans: a profile across an edge, a map of an edge and one of a grating of holes, as arrays of X3P."""
    import x3pio

    random = np.random.default_rng(1)
    x = np.arange(-2000, 2000) * 0.25 * UM
    z = edge_gauge(x, 50 * UM, 5 * UM, 5e-4) + correlated_noise(len(x), 0.25 * UM, 10 * NM, 30 * NM, 2 * UM, random)
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
    """Print the table; 1 if an inspection takes more than its share beside the raw read of its file."""
    print(f"{'scan':32} {'read s':>8} {'inspect s':>10} {'of it busy':>11} {'ratio':>7}")
    slow = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, (path, feature) in write(Path(folder)).items():
            raw, _ = least(lambda path=path: read_scan(path))
            whole, busy = least(lambda path=path, feature=feature: inspect_standard(path, feature=feature))
            most = 5.0 if "map" in name else 1.0
            slow += busy > most
            print(
                f"{name:32} {raw:8.2f} {whole:10.2f} {busy:11.2f} {whole / raw:7.1f}{'  SLOW' if busy > most else ''}",
                flush=True,
            )
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
