"""Count how often the ordinal model finds an effect that is none: 10 participants, 10 ratings.

    python benchmarks/study_ordinal_level.py [runs]

Participants differ in their level, and in the second row in how they take to the vibration too (0.6
in logistic units).
"""

from __future__ import annotations

import sys

import numpy as np
import pandas as pd
from statsmodels.stats.proportion import proportion_confint

from stepblocks.study.analysis.ordinal import fit_ordinal_model


def ratings(
    response: float, generator: np.random.Generator, people: int = 10, each: int = 10
) -> pd.DataFrame:
    person = np.repeat(np.arange(people), 2 * each)
    on = np.tile(np.repeat([0, 1], each), people)
    latent = (
        generator.standard_normal(people)[person]
        + response * generator.standard_normal(people)[person] * on
    )
    rating = np.clip(np.round(4.0 + latent + generator.logistic(size=person.size)), 1, 7).astype(
        int
    )
    return pd.DataFrame(
        {
            "rating": rating,
            "condition": np.where(on, "on", "off"),
            "participant": person.astype(str),
        }
    )


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    print(f"{'participants vary':24}  F over participants      ({runs} runs, 95 % interval)")
    for name, response in (("in level", 0.0), ("in level and response", 0.6)):
        hits = 0
        for run in range(runs):
            fit = fit_ordinal_model(
                ratings(response, np.random.default_rng([run, 1])),
                "rating",
                "condition",
                "participant",
            )
            hits += fit.participants.p < 0.05
        low, high = proportion_confint(hits, runs, method="wilson")
        print(f"{name:24}  {hits / runs:.3f}  {low:.3f} to {high:.3f}", flush=True)


if __name__ == "__main__":
    main()
