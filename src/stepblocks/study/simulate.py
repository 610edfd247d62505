"""Whole simulated studies: run sheets filled in, and how many participants and repetitions find a difference."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.study.analysis.anova import f_test
from stepblocks.study.analysis.mixed import mixed_model
from stepblocks.study.experiments import EXPERIMENTS
from stepblocks.study.observer import Observer, estimate_heights
from stepblocks.study.sheet import sheet_rows

ANALYSES = ("f-test", "mixed")  # the paper's F-test, and the mixed model


def simulate_answers(
    design: Sequence[Mapping[str, str]],
    energies: Mapping[str, float],
    damping: Mapping[str, float],
    observer: Observer,
    seed: int,
) -> list[dict[str, str]]:
    """Fill in the run sheets of a design, from each block's energy [J] and the share of it that a condition lets through."""
    import pandas as pd

    named = [name for row in design for name in (row["stimulus"], row["standard"]) if name]
    lacking = [name for name in named if not energies.get(name, 0.0) > 0.0]
    if lacking:
        raise StudyError(f"every block must have a predicted energy, got none for {lacking[0]}")
    trials = pd.DataFrame(design)
    trials["person"], trials["setting"] = (pd.factorize(trials[name])[0] for name in ("participant", "condition"))
    trials["height"] = trials["height_um"].astype(float) * 1e-6
    shares = [damping.get(condition, 1.0) for condition in trials["condition"]]
    trials["undamped"], trials["standard_energy"] = (trials[name].map(energies) for name in ("stimulus", "standard"))
    trials["energy"] = trials["undamped"] * shares
    experiment = EXPERIMENTS[design[0]["experiment"]]
    answers = experiment.simulate(trials, observer, np.random.default_rng(seed))
    return [
        row | dict(zip(experiment.answers, texts, strict=True))
        for row, texts in zip(sheet_rows(design), answers, strict=True)
    ]


@dataclass(frozen=True)
class SimulatedStudy:
    """A study of which the power is asked."""

    participants: int
    repetitions: int  # how often each participant judges each block in each condition
    heights: tuple[float, ...]  # of the blocks [m]
    energies: tuple[float, ...]  # of each block, undamped [J]
    factors: tuple[tuple[str, float], ...]  # condition, and the share of the energy that it lets through [1]
    observer: Observer

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

    power: float  # share of studies with p below the level [1]
    low: float  # ends of its 95 % interval by Wilson
    high: float


def p_values(plan: SimulatedStudy, analysis: str, seeds: Sequence[int]) -> list[float]:
    """Simulate studies and analyse each."""
    return [_one(plan, analysis, seed) for seed in seeds]


def _one(plan: SimulatedStudy, analysis: str, seed: int) -> float:
    frame = simulated_frame(plan, seed)
    block = "stimulus" if len(plan.heights) > 1 else ""
    if analysis == "f-test":
        factors = ["condition", block] if block else ["condition"]
        return f_test(frame, "error", factors, intervals=False).terms[0].p
    term = mixed_model(frame, "error", "condition", "participant", block, intervals=False).condition
    assert term is not None  # a plan has two conditions
    return term.p


def simulated_frame(plan: SimulatedStudy, seed: int) -> Any:
    """Simulate one study to its tidy table."""
    import pandas as pd

    shape = (plan.participants, len(plan.factors), len(plan.heights), plan.repetitions)
    person, setting, block, _ = (index.ravel() for index in np.indices(shape))
    heights, energies = np.asarray(plan.heights), np.asarray(plan.energies)
    names, shares = zip(*plan.factors, strict=True)
    frame = pd.DataFrame({"person": person, "setting": setting, "height": heights[block]})
    frame["energy"] = energies[block] * np.array(shares)[setting]
    estimates = estimate_heights(frame, (heights, energies), plan.observer, np.random.default_rng(seed))
    texts = {"participant": person.astype(str), "condition": np.array(names)[setting], "stimulus": block.astype(str)}
    return frame.assign(**texts, estimate=estimates, error=estimates - heights[block])


def estimate_power(
    plan: SimulatedStudy, analysis: str = "mixed", runs: int = 200, seed: int = 1, jobs: int = 1
) -> PowerEstimate:
    """Estimate the power of a study at the 5 % level by simulation; `analysis` is one of `ANALYSES`."""
    from joblib import Parallel, delayed
    from statsmodels.stats.proportion import proportion_confint

    if analysis not in ANALYSES:
        raise StudyError(f"analysis must be one of {', '.join(ANALYSES)}, got {analysis!r}")
    if not 10 <= runs <= 100_000:
        raise StudyError(f"runs must lie between 10 and 100000, got {runs}")
    if seed < 0 or jobs < 1:
        raise StudyError(f"seed and jobs must be at least 0 and at least 1, got {seed} and {jobs}")
    seeds = [int(child.generate_state(1, np.uint64)[0]) for child in np.random.SeedSequence(seed).spawn(runs)]
    share = max(1, math.ceil(runs / (4 * jobs)))
    parts = [seeds[start : start + share] for start in range(0, runs, share)]
    found = Parallel(n_jobs=jobs)(delayed(p_values)(plan, analysis, part) for part in parts)
    hits = sum(p < 0.05 for part in found for p in part)
    low, high = proportion_confint(hits, runs, method="wilson")
    return PowerEstimate(hits / runs, float(low), float(high))
