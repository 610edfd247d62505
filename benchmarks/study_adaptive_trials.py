"""Count the trials that a Weber fraction costs by QUEST+, staircase and constant stimuli.

    python benchmarks/study_adaptive_trials.py [observers]

Simulated observers compare each block with the one of 50 um; the logarithm of the height is felt
with a normal noise, 2 % lapse. The error is that of the logarithm of the Weber fraction, its root
mean square and its mean over observers; what tells no Weber fraction is counted apart.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.study.analysis.psychometric import fit_psychometric
from stepblocks.study.session import Plan, Session

HEIGHTS = {f"{height}": height * 1e-6 for height in range(10, 101, 10)}
STANDARD, LAPSE = "50", 0.02


def higher(compared: str, spread: float, generator: np.random.Generator) -> bool:
    if generator.random() < LAPSE:
        return bool(generator.random() < 0.5)
    return (
        math.log(HEIGHTS[compared] / HEIGHTS[STANDARD]) + spread * generator.standard_normal() > 0.0
    )


def fitted(hits: dict[str, list[bool]]) -> float:
    levels = sorted(hits, key=lambda code: HEIGHTS[code])
    counts, totals = [sum(hits[code]) for code in levels], [len(hits[code]) for code in levels]
    return fit_psychometric([HEIGHTS[code] for code in levels], counts, totals).weber


def constant(trials: int, spread: float, generator: np.random.Generator) -> float:
    others = [code for code in HEIGHTS if code != STANDARD]
    return fitted(
        {
            code: [higher(code, spread, generator) for _ in range(trials // len(others))]
            for code in others
        }
    )


def adaptive(method: str, trials: int, spread: float, generator: np.random.Generator) -> float:
    session = Session(Plan(method, HEIGHTS, STANDARD, trials, 10_000, 1), 1)
    while (pair := session.next_pair()) is not None:
        compared = pair.first if pair.second == STANDARD else pair.second
        session.record(pair.trial, higher(compared, spread, generator) == (compared == pair.second))
    return session.estimate()["weber_ratio"]


def main() -> None:
    observers = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    print(
        f"{observers} observers each; error of ln(Weber fraction): root mean square "
        "(mean), "
        "share "
        "that tells none"
    )
    print("Weber   trials  constant stimuli     QUEST+               staircase")
    for spread in (0.2, 0.4):
        weber = math.expm1(0.6744897501960817 * spread)
        for trials in (18, 36, 72, 144):
            cells = []
            for number, method in enumerate(("constant", "quest", "staircase")):
                errors, silent = [], 0
                for observer in range(observers):
                    generator = np.random.default_rng(
                        [number, trials, observer, round(1000 * spread)]
                    )
                    try:
                        run = (
                            constant
                            if method == "constant"
                            else lambda *a, m=method: adaptive(m, *a)
                        )
                        errors.append(math.log(run(trials, spread, generator) / weber))
                    except StudyError:
                        silent += 1
                if len(errors) > observers // 2:
                    rms = math.sqrt(np.mean(np.square(errors)))
                    cells.append(f"{rms:.2f} ({np.mean(errors):+.2f}), {silent / observers:4.0%}")
                else:
                    cells.append(f"-             , {silent / observers:4.0%}")
            print(f"{weber:.3f}   {trials:6}  " + "  ".join(f"{cell:19}" for cell in cells))


if __name__ == "__main__":
    main()
