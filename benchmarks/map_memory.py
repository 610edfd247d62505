"""Memory of a 4096 x 4096 scan: input and result as memory maps, so that the process shows what the work itself needs.

Run: python benchmarks/map_memory.py
"""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from stepblocks.contact.path.map import map_path
from stepblocks.contact.path.tip import Ball


def peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    size = 4096
    with tempfile.TemporaryDirectory() as folder:
        z = np.memmap(Path(folder) / "z.f4", dtype=np.float32, mode="w+", shape=(size, size))
        rng = np.random.default_rng(2)
        for row in range(0, size, 256):
            z[row : row + 256] = rng.normal(size=(256, size)) * 50e-9 + 25e-6 * (np.arange(size) > size // 2)
        z.flush()
        out = np.memmap(Path(folder) / "out.f8", dtype=np.float64, mode="w+", shape=(size, size))
        map_path(np.asarray(z[:300, :300]), 1e-6, Ball(50e-6), contacts=False)
        before = peak_mib()
        start = time.perf_counter()
        map_path(z, 1e-6, Ball(125e-6), contacts=False, out=out)
        seconds = time.perf_counter() - start
        files = (z.nbytes + out.nbytes) / 2**20
        print(f"4096 x 4096, R = 125 samples: {seconds:.1f} s")
        print(f"peak memory {before:.0f} -> {peak_mib():.0f} MiB, of which mapped files at most {files:.0f} MiB")


if __name__ == "__main__":
    main()
