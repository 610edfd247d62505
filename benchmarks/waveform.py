"""Fit the drag in time to whole traces of a session of the bench of the tests.

Run as ``python benchmarks/waveform.py [TRIALS [JOBS]]`` (default 240 on two). The session is
integrated by rigid contact, so that no ring is a pure exponential; the error of ln E_v counts
trials that the parameters were not taken from.
"""

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure
from stepblocks.bench.waveform import predict_energies


def main():
    """Print one line per figure."""
    trials, jobs = (
        int(sys.argv[i]) if len(sys.argv) > i else usual for i, usual in ((1, 240), (2, 2))
    )
    with tempfile.TemporaryDirectory() as folder:
        session = Path(folder) / "integrated"
        write_session(session, Plan(trials=trials), 1)
        for waveform in (False, True):
            begin = time.perf_counter()
            table = measure(session, jobs=jobs, waveform=waveform)
            print(
                f"measured {len(table)} trials {'with' if waveform else 'without'} waveform: "
                f"{time.perf_counter() - begin:.0f} s"
            )
        for name, value in predict_energies(table, 9810.0).items():
            print(f"{name:32s} {value:.4g}")


if __name__ == "__main__":
    main()
