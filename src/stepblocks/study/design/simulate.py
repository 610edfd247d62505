"""Simulated participants, and by them how many it takes to find a difference."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from stepblocks.compute.processes import run_in_processes
from stepblocks.errors import StudyError
from stepblocks.study import RATINGS, Array, Table, require
from stepblocks.study.analysis.accuracy import (
    ANSWER,
    MEASURES,
    compute_measure,
    correct_conditions,
)
from stepblocks.study.analysis.anova import run_f_test
from stepblocks.study.analysis.mixed import fit_mixed_model
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.analysis.psychometric import Z75


@dataclass(frozen=True)
class Observer:
    """What a population of participants is like."""

    # Weber fraction of the energy [1]: the least difference that three of four judgements get right
    weber: float = 0.2
    response_noise: float = (
        5e-6  # standard deviation of what is added when a height is written down [m]
    )
    participant_spread: float = (
        3e-6  # standard deviation of the participants' own constant error [m]
    )
    condition_spread: float = (
        0.0  # standard deviation of how each participant's error differs by condition [m]
    )
    lapse: float = 0.0  # rate of answers that have nothing to do with the block [1]
    realism_gain: float = (
        1.5  # by how much vibration moves the rating on its latent scale, in logistic units [1]
    )

    def __post_init__(self) -> None:
        for name in ("weber", "response_noise", "participant_spread", "condition_spread"):
            require(
                math.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0,
                f"{name} must be finite and not negative, got {getattr(self, name):g}",
            )
        require(
            0.0 <= self.lapse < 1.0, f"lapse must be a rate from 0 to below 1, got {self.lapse:g}"
        )
        require(
            math.isfinite(self.realism_gain),
            f"realism_gain must be finite, got {self.realism_gain:g}",
        )

    @property
    def sensation_noise(self) -> float:
        """Standard deviation of the logarithm of one felt energy [1].

        That of the difference of two is ln(1 + weber) / 0.6745.
        """
        return math.log1p(self.weber) / Z75 / math.sqrt(2.0)


TYPICAL_OBSERVER = Observer()


def read_off_height(
    energy: Array, heights: Sequence[float] | Array, energies: Sequence[float] | Array
) -> Array:
    """Read the height that usually gives an energy off those that are known.

    Between these it is interpolated in logarithms.
    """
    order = np.argsort(heights)
    y, x = (
        np.log(np.asarray(heights, dtype=np.float64)[order]),
        np.log(np.asarray(energies, dtype=np.float64)[order]),
    )
    require(
        len(x) >= 2
        and np.isfinite(x).all()
        and (np.diff(x) > 0.0).all()
        and (np.diff(y) > 0.0).all(),
        "energies must be at least two, positive, and rise with the height",
    )
    line = make_interp_spline(x, y, k=1)  # beyond the ends it goes on
    return np.asarray(np.exp(line(np.log(np.asarray(energy, dtype=np.float64)))))


def simulate_sensation(
    energies: Array, observer: Observer, generator: np.random.Generator
) -> Array:
    """Let energies [J] be felt, each with its own noise."""
    return np.asarray(
        energies * np.exp(observer.sensation_noise * generator.standard_normal(len(energies)))
    )


def simulate_estimates(
    trials: Table,
    references: tuple[Array, Array],
    observer: Observer,
    generator: np.random.Generator,
) -> Array:
    """Let participants estimate heights [m].

    `references` are heights [m] and undamped energies [J] that they connect.
    """
    person, setting = trials["person"].to_numpy(), trials["setting"].to_numpy()
    heights = trials["height"].to_numpy()
    estimates = read_off_height(
        simulate_sensation(trials["energy"].to_numpy(), observer, generator), *references
    )
    estimates += observer.participant_spread * generator.standard_normal(person.max() + 1)[person]
    own = generator.standard_normal((person.max() + 1, setting.max() + 1))
    estimates += observer.condition_spread * own[person, setting]
    noisier = trials["noisier"].to_numpy() if "noisier" in trials else 1.0
    estimates += observer.response_noise * noisier * generator.standard_normal(len(heights))
    lapsed = generator.random(len(heights)) < observer.lapse
    estimates[lapsed] = generator.permutation(heights)[lapsed]
    return np.maximum(estimates, 0.0)


def rate_realism(
    person: Array, shown: Array, observer: Observer, generator: np.random.Generator
) -> Array:
    """Let participants rate realism, each from a level of her own; `shown` is what they rate up."""
    realism = generator.standard_normal(person.max() + 1)[person] + observer.realism_gain * shown
    return np.asarray(
        np.clip(np.round(3.5 + (realism + generator.logistic(size=len(person)))), *RATINGS)
    )


def simulate_comparison(
    energy: float, standard: float, observer: Observer, generator: np.random.Generator
) -> bool:
    """Let a participant compare two blocks by what they feel."""
    noise = observer.sensation_noise * float(
        generator.standard_normal() - generator.standard_normal()
    )
    higher = math.log(energy / standard) + noise > 0.0
    return bool(generator.random() < 0.5) if generator.random() < observer.lapse else higher


def _estimate_power(hits: int, runs: int) -> dict[str, float]:
    # Return the share of studies that find a difference, with the ends of its 95 % interval by
    # Wilson
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(hits, runs, method="wilson")
    return {"power_ratio": hits / runs, "low_95_ratio": float(low), "high_95_ratio": float(high)}


def estimate_detection_power(
    participants: int, trials: int, ratio: float, observer: Observer, runs: int, seed: int
) -> dict[str, float]:
    """Estimate how often a pair of blocks, whose energies have a ratio, is distinguished.

    The shares of right answers of participants are tested against one half.
    """
    from scipy import stats

    require(participants >= 2, f"a t-test over participants needs at least 2, got {participants}")
    noise = max(math.sqrt(2.0) * observer.sensation_noise, 1e-12)
    right = (1.0 - observer.lapse) * float(
        stats.norm.cdf(abs(math.log(ratio)) / noise)
    ) + 0.5 * observer.lapse
    shares = np.random.default_rng(seed).binomial(trials, right, (runs, participants)) / trials
    mean, spread = shares.mean(axis=1) - 0.5, shares.std(axis=1, ddof=1) / math.sqrt(participants)
    return _estimate_power(int(np.sum(mean > stats.t.ppf(0.95, participants - 1) * spread)), runs)


ANALYSES = ("f-test", "mixed")  # the paper's F-test, and the mixed model
REALISM = "realism"  # the measure that ratings give, tested by the ordinal model


@dataclass(frozen=True)
class SimulatedStudy:
    """A study of which the power is asked."""

    participants: int
    repetitions: int  # how often each participant judges each block in each condition
    heights: tuple[float, ...]  # of the blocks [m]
    energies: tuple[float, ...]  # of each block, undamped [J]
    # condition, and the share of the energy that it lets through [1]
    factors: tuple[tuple[str, float], ...]
    observer: Observer
    noise: tuple[
        float, ...
    ] = ()  # times the response noise, by condition [1]; alike where left out
    measure: str = ANSWER  # what is tested, one of `MEASURES` or `REALISM`

    def __post_init__(self) -> None:
        require(
            self.measure in (*MEASURES, REALISM),
            f"measure must be one of {', '.join((*MEASURES, REALISM))}, got {self.measure!r}",
        )
        require(
            self.participants >= 2 and self.repetitions >= 1,
            "a study needs at least 2 participants and 1 repetition, got "
            + " ".join(f"{self.participants} and {self.repetitions}".split()),
        )
        require(
            len(self.factors) >= 2,
            "a study must compare at least two conditions, which damping, noisier or probes name, "
            f"got {len(self.factors)}",
        )
        for name, share in self.factors:
            require(
                math.isfinite(share) and share > 0.0,
                f"the share of the energy must be positive and finite, got {share:g} [condition "
                f"{name}]",
            )


def compute_p_value(plan: SimulatedStudy, analysis: str, seed: int) -> float:
    """Simulate a study and test its conditions."""
    simulated = simulate_frame(plan, seed)
    if plan.measure == REALISM:
        with suppress(StudyError):  # ratings without finite odds show no difference
            return fit_ordinal_model(simulated, "rating", "condition", "participant").participants[
                "p"
            ]
        return 1.0
    frame, block = compute_measure(simulated, plan.measure)
    if analysis == "f-test":
        return run_f_test(frame, "value", "condition", block, intervals=False).terms[0].p
    fit = fit_mixed_model(frame, "value", "condition", "participant", block, intervals=False)
    term, _ = correct_conditions(frame, fit.condition)
    assert term is not None  # a plan has two conditions
    return term.p


def simulate_frame(plan: SimulatedStudy, seed: int) -> Table:
    """Simulate one study to its tidy table."""
    import pandas as pd

    shape = (plan.participants, len(plan.factors), len(plan.heights), plan.repetitions)
    person, setting, block, _ = (index.ravel() for index in np.indices(shape))
    heights, energies = np.asarray(plan.heights), np.asarray(plan.energies)
    names, shares = zip(*plan.factors, strict=True)
    frame = pd.DataFrame(
        {
            "person": person,
            "setting": setting,
            "height": heights[block],
            "energy": energies[block] * np.array(shares)[setting],
            "noisier": np.array(plan.noise or [1.0] * len(shares))[setting],
        }
    )
    generator = np.random.default_rng(seed)
    estimates = simulate_estimates(frame, (heights, energies), plan.observer, generator)
    return frame.assign(
        participant=person.astype(str),
        condition=np.array(names)[setting],
        stimulus=block.astype(str),
        estimate=estimates,
        error=estimates - heights[block],
        # the last condition is the one that changes realism
        rating=rate_realism(person, setting == setting.max(), plan.observer, generator),
    )


def estimate_power(
    plan: SimulatedStudy, analysis: str = "mixed", runs: int = 200, seed: int = 1, jobs: int = 1
) -> dict[str, float]:
    """Estimate the power of a study at the 5 % level by simulation.

    `analysis` is one of `ANALYSES`.
    """
    require(
        analysis in ANALYSES, f"analysis must be one of {', '.join(ANALYSES)}, got {analysis!r}"
    )
    require(10 <= runs <= 100_000, f"runs must lie between 10 and 100000, got {runs}")
    require(
        seed >= 0 and jobs >= 1,
        f"seed and jobs must be at least 0 and at least 1, got {seed} and {jobs}",
    )
    seeds = [
        int(child.generate_state(1, np.uint64)[0])
        for child in np.random.SeedSequence(seed).spawn(runs)
    ]
    found = run_in_processes(compute_p_value, ((plan, analysis, one) for one in seeds), jobs)
    return _estimate_power(sum(p < 0.05 for p in found), runs)
