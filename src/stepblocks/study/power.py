"""How many participants and repetitions: simulated studies put through the same analysis, beside the closed form where there is one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.study.simulate import Observer, simulate_estimates

ANALYSES = ("f-test", "mixed")  # The paper's F-test, and the mixed model


@dataclass(frozen=True)
class Plan:
    """A study of which the power is asked."""

    participants: int  # How many, and how often each judges each block in each condition
    repetitions: int
    heights: tuple[float, ...]  # Heights of the blocks [m]
    energies: tuple[float, ...]  # Energy of each undamped [J]
    factors: tuple[tuple[str, float], ...]  # Condition, and the share of the energy that it lets through [1]
    observer: Observer  # What participants are like

    def __post_init__(self) -> None:
        if self.participants < 2 or self.repetitions < 1:
            raise StudyError(
                f"a study needs at least 2 participants and 1 repetition, got {self.participants} and {self.repetitions}"
            )
        if len(self.factors) < 2:
            raise StudyError(f"a study must compare at least two conditions, got {len(self.factors)}")
        bad = [(name, share) for name, share in self.factors if not (math.isfinite(share) and share > 0.0)]
        if bad:
            raise StudyError(
                f"the share of the energy must be positive and finite, got {bad[0][1]:g} [condition {bad[0][0]}]"
            )
        if len(self.heights) != len(self.energies):
            raise StudyError(f"every block must have an energy, got {len(self.heights)} and {len(self.energies)}")


@dataclass(frozen=True)
class PowerEstimate:
    """Share of simulated studies that find a difference between conditions."""

    plan: Plan  # What was simulated
    analysis: str  # One of `ANALYSES`
    power: float  # Share of studies with p below the level, and its 95 % interval by Wilson [1]
    low: float
    high: float
    runs: int  # Studies simulated


def p_values(plan: Plan, analysis: str, seeds: Sequence[int]) -> list[float]:
    """Simulate studies and analyse each."""
    return [_one(plan, analysis, seed) for seed in seeds]


def _one(plan: Plan, analysis: str, seed: int) -> float:
    from stepblocks.study.analysis.anova import f_test
    from stepblocks.study.analysis.mixed import mixed_model

    frame = simulated_frame(plan, seed)
    if analysis == "f-test":
        blocks = ["condition", "stimulus"] if len(plan.heights) > 1 else ["condition"]
        return f_test(frame, "error", blocks, intervals=False).terms[0].p
    if analysis == "mixed":
        block = "stimulus" if len(plan.heights) > 1 else ""
        term = mixed_model(frame, "error", "condition", "participant", block, intervals=False).condition
        assert term is not None  # a plan has two conditions
        return term.p
    raise StudyError(f"analysis must be one of {', '.join(ANALYSES)}, got {analysis!r}")


def simulated_frame(plan: Plan, seed: int) -> Any:
    """Simulate one study."""
    import pandas as pd

    shape = (plan.participants, len(plan.factors), len(plan.heights), plan.repetitions)
    person, condition, block, _ = (index.ravel() for index in np.indices(shape))
    heights, energies = np.asarray(plan.heights), np.asarray(plan.energies)
    reach = energies[block] * np.array([share for _, share in plan.factors])[condition]
    estimate = simulate_estimates(
        person, condition, reach, heights[block], (heights, energies), plan.observer, np.random.default_rng(seed)
    )
    names = np.array([name for name, _ in plan.factors])
    columns = {"participant": person.astype(str), "condition": names[condition], "stimulus": block.astype(str)}
    return pd.DataFrame({**columns, "height": heights[block], "estimate": estimate, "error": estimate - heights[block]})


def estimate_power(
    plan: Plan, analysis: str = "mixed", runs: int = 200, seed: int = 1, jobs: int = 1, level: float = 0.05
) -> PowerEstimate:
    """Estimate the power of a study by simulation."""
    from joblib import Parallel, delayed
    from statsmodels.stats.proportion import proportion_confint

    if analysis not in ANALYSES:
        raise StudyError(f"analysis must be one of {', '.join(ANALYSES)}, got {analysis!r}")
    if not 10 <= runs <= 100_000:
        raise StudyError(f"runs must lie between 10 and 100000, got {runs}")
    if seed < 0 or jobs < 1 or not 0.0 < level < 1.0:
        raise StudyError(
            f"seed, jobs and level must be at least 0, at least 1 and between 0 and 1, got {seed}, {jobs}, {level}"
        )
    seeds = [int(child.generate_state(1, np.uint64)[0]) for child in np.random.SeedSequence(seed).spawn(runs)]
    share = max(1, math.ceil(runs / (4 * jobs)))
    parts = [seeds[start : start + share] for start in range(0, runs, share)]
    found = Parallel(n_jobs=jobs)(delayed(p_values)(plan, analysis, part) for part in parts)
    hits = sum(p < level for part in found for p in part)
    low, high = proportion_confint(hits, runs, method="wilson")
    return PowerEstimate(plan, analysis, hits / runs, float(low), float(high), runs)


def closed_form_power(
    differences: Mapping[str, float], judgements: int, sd: float, df_error: float, level: float = 0.05
) -> float:
    """Power of an F-test of means by the noncentral F distribution.

    Examples
    --------
    >>> round(closed_form_power({"a": 0.0, "b": 0.5}, 64, 1.0, 126), 3)
    0.801
    """
    from scipy.stats import f, ncf

    means = np.array(list(differences.values()))
    noncentrality = judgements * float(((means - means.mean()) ** 2).sum()) / sd**2
    df = len(means) - 1
    if noncentrality < 1e-12:  # scipy's noncentral F is wrong at zero, where it is the central one
        return level
    return float(ncf.sf(f.isf(level, df, df_error), df, df_error, noncentrality))
