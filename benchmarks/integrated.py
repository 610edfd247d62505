"""Explain sessions whose contact is integrated, and measure how well E_v is then predicted.

Run as ``python benchmarks/integrated.py [SESSIONS [TRIALS]]`` (default 3 of 96). Every session is
integrated by rigid contact in ``tests/oracles/virtual_bench.py``, which shares no code with the
model of the loop: nothing is planted in it but the motion itself, which equations (1) and (2) lack.
Errors are root mean squares of ln E_v over trials held out within blocks, and over whole blocks.
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from oracles.virtual_session import Plan, write_session
from stepblocks.bench.measure import measure_session
from stepblocks.loop.block_scans import measure_block_scans
from stepblocks.loop.run import analyse_features

FIRST = 2  # seed; the model was looked at on others


def main():
    """Print a few lines per session."""
    sessions, trials = (
        int(sys.argv[i]) if len(sys.argv) > i else usual for i, usual in ((1, 3), (2, 96))
    )
    for seed in range(FIRST, FIRST + sessions):
        with tempfile.TemporaryDirectory() as folder:
            session = Path(folder) / "integrated"
            plan = Plan(trials=trials)
            write_session(session, plan, seed)
            features = measure_session(session)
            blocks = sorted(set(features["block"].dropna()))
            scans = measure_block_scans(session, "scans/{block}.csv", blocks).scans
        result = analyse_features(
            features, plan.bench.stiffness, plan.bench.tip_radius, scans, jobs=2
        )
        errors = [result.document[part]["error"] for part in ("nominal", "extended")]
        print(f"session {seed}: {result.verdict}: {result.document['finding']}")
        for name in ("ln_energy_rms", "ln_energy_rms_blocks_left_out"):
            print(f"  {name:32s} {errors[0][name]:.3f} -> {errors[1][name]:.3f}", flush=True)
        print(f"  regimes {result.document['regimes']}", flush=True)


if __name__ == "__main__":
    main()
