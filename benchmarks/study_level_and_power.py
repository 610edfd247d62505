"""Simulate level and power of both analyses beside the noncentral F distribution.

Run as ``PYTHONPATH=tests python benchmarks/study_level_and_power.py [RUNS] [JOBS]``.
"""

from __future__ import annotations

import math
import sys

from oracles.noncentral_f import closed_form_power
from stepblocks.study.design.simulate import Observer
from stepblocks.study.power import SimulatedStudy, estimate_power

NOISE = 6e-6
# energy in proportion to height: a share of 0.9 lowers estimates by a tenth
HEIGHTS, ENERGIES = (
    (70e-6, 90e-6),
    (0.7e-5, 0.9e-5),
)


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    jobs = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    print(
        f"{'analysis':8}  {'participants vary':22}  {'effect':>6}  {'closed form':>11}  "
        f"{'simulated':>9}  95 % interval ({runs} runs)"
    )
    for analysis in ("f-test", "mixed"):
        for spread, response in ((0.0, 0.0), (5e-6, 0.0), (5e-6, 6e-6)):
            for share in (1.0, 0.95):
                observer = Observer(
                    weber=0.0,
                    response_noise=NOISE,
                    participant_spread=spread,
                    condition_spread=response,
                )
                plan = SimulatedStudy(
                    8, 2, HEIGHTS, ENERGIES, (("a", 1.0), ("b", share)), observer, measure="bias"
                )
                found = estimate_power(plan, analysis, runs, seed=1, jobs=jobs)
                means = {"a": 0.0, "b": (1.0 - share) * 80e-6}
                if analysis == "mixed":
                    exact = closed_form_power(means, 8, math.hypot(response, NOISE / 2.0), 7.0)
                else:
                    exact = (
                        closed_form_power(means, 32, NOISE, 60.0)
                        if spread == response == 0.0
                        else math.nan
                    )
                kind = (
                    "not"
                    if spread == 0.0
                    else "in level"
                    if response == 0.0
                    else "in level and response"
                )
                interval = f"{found.low_95_ratio:.3f} to {found.high_95_ratio:.3f}"
                print(
                    f"{analysis:8}  {kind:22}  {1.0 - share:6.2f}  {exact:11.3f}  "
                    f"{found.power_ratio:9.3f}  {interval}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
