"""Count how often bias, absolute error and spread find a change, and one that is not there.

Run as ``python benchmarks/study_accuracy.py [RUNS] [JOBS]``. Ten participants, three blocks of 50,
70 and 90 um, three repetitions, two conditions; participants differ by 3 um in level and, in the
second half, by 3 um in their response.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from stepblocks.study.analysis.accuracy import MEASURES
from stepblocks.study.design.simulate import Observer
from stepblocks.study.power import SimulatedStudy, estimate_power

CHANGES = {"nothing": (1.0, 1.0), "noise, 2.5 times": (1.0, 2.5), "bias, a fifth": (0.8, 1.0)}


def main() -> None:
    runs, jobs = (int(text) for text in (*sys.argv[1:], "2000", "1")[:2])
    print(
        f"{'participants respond':20}  {'changed':16}  {'measure':14}  {'analysis':8}  "
        "found  "
        "95 "
        f"% interval ({runs} runs)"
    )
    for spread in (0.0, 3e-6):
        observer = Observer(weber=0.0, response_noise=6e-6, condition_spread=spread)
        for change, (share, noise) in CHANGES.items():
            conditions = (("a", 1.0), ("b", share))
            plan = SimulatedStudy(
                10,
                3,
                (50e-6, 70e-6, 90e-6),
                (0.5e-5, 0.7e-5, 0.9e-5),
                conditions,
                observer,
                (1.0, noise),
            )
            for measure in MEASURES:
                for analysis in ("f-test", "mixed"):
                    # what is there is found or not after a few; a level takes many
                    found = estimate_power(
                        replace(plan, measure=measure),
                        analysis,
                        runs if change == "nothing" else max(runs // 5, 10),
                        1,
                        jobs,
                    )
                    said = (
                        f"{found.power_ratio:.3f}  {found.low_95_ratio:.3f} to "
                        f"{found.high_95_ratio:.3f}"
                    )
                    alike = "differently" if spread else "alike"
                    print(
                        f"{alike:20}  {change:16}  {measure:14}  {analysis:8}  {said}", flush=True
                    )


if __name__ == "__main__":
    main()
