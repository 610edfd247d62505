"""The power of studies, by simulation: how many participants are needed."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from stepblocks.compute.cluster import open_cluster
from stepblocks.compute.seam import run_calls
from stepblocks.errors import StudyError
from stepblocks.files.tables import Table, write_table
from stepblocks.quantities import check_seed
from stepblocks.study.analysis.accuracy import (
    ANSWER,
    MEASURES,
    SPREAD,
    compute_measure_values,
    correct_condition_test,
)
from stepblocks.study.analysis.anova import run_f_test
from stepblocks.study.analysis.mixed import fit_mixed_model
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.design.blocks import Declared, choose_blocks
from stepblocks.study.design.simulate import (
    REALISM,
    TYPICAL_OBSERVER,
    Observer,
    simulate_estimates,
    simulate_ratings,
)
from stepblocks.study.design.simulated_intervals import CURVE_MEASURES, plan_comparisons
from stepblocks.study.design.trials import REPETITIONS
from stepblocks.study.design.virtual import VIBRATION_OFF, VIBRATION_ON
from stepblocks.study.experiments.registry import ALIASES

if TYPE_CHECKING:
    from distributed import Client

ANALYSES = ("f-test", "mixed")  # the paper's F-test, and the mixed model
_LEVEL = 0.05  # of every test
_PEOPLE_OF_SPREAD = 2000  # of a study that tells how participants differ
_FEWEST_RUNS, _MOST_RUNS = 10, 100_000  # simulated studies


@dataclass(frozen=True)
class Power:
    """Share of the studies that find a difference, with its 95 % interval by Wilson [1]."""

    power_ratio: float
    low_95_ratio: float
    high_95_ratio: float


@dataclass(frozen=True)
class SimulatedStudy:
    """A study of which the power is asked.

    Attributes
    ----------
    participants, repetitions : int
        How many, and how often each judges each block in each condition.
    heights, energies : tuple of float
        Of the blocks [m], and of each, undamped [J].
    factors : tuple of (str, float)
        Condition, and the share of the energy that it lets through [1].
    observer : Observer
        What participants are like.
    noise : tuple of float
        How many times the response noise each condition has [1]; once where left out.
    measure : str
        What is tested, one of `MEASURES` or `REALISM`.
    effect : float
        By how much more of the measure the last condition has, beside what its share of the energy
        does [m]; of the spread in ln(spread) [1].

    Raises
    ------
    StudyError
        If the measure is unknown, there are too few participants, repetitions or conditions, or a
        share is not positive.
    """

    participants: int
    repetitions: int
    heights: tuple[float, ...]
    energies: tuple[float, ...]
    factors: tuple[tuple[str, float], ...]
    observer: Observer
    noise: tuple[float, ...] = ()
    measure: str = ANSWER
    effect: float = 0.0

    def __post_init__(self) -> None:
        if not math.isfinite(self.effect):
            raise StudyError(f"effect must be finite, got {self.effect}")
        measures = (*MEASURES, REALISM)
        if self.measure not in measures:
            raise StudyError(f"measure must be one of {', '.join(measures)}, got {self.measure!r}")
        if self.participants < 2 or self.repetitions < 1:
            raise StudyError(
                "a study needs at least 2 participants and 1 repetition, got "
                f"{self.participants} and {self.repetitions}"
            )
        if len(self.factors) < 2:
            raise StudyError(
                "a study must compare at least two conditions, which damping, noisier or probes "
                f"name, got {len(self.factors)}"
            )
        for name, share in self.factors:
            if not (math.isfinite(share) and share > 0.0):
                raise StudyError(
                    f"the share of the energy must be positive and finite, got {share:g} "
                    f"[condition {name}]"
                )


def simulate_judgement_table(plan: SimulatedStudy, seed: int) -> Table:
    """Simulate one study to its tidy table."""
    shape = (plan.participants, len(plan.factors), len(plan.heights), plan.repetitions)
    person, setting, block, _ = np.indices(shape).reshape(len(shape), -1)
    heights = np.asarray(plan.heights)
    energies = np.asarray(plan.energies)
    names = np.array([name for name, _ in plan.factors])
    shares = np.array([share for _, share in plan.factors])
    noise = np.array(plan.noise or [1.0] * len(shares))
    frame = pd.DataFrame(
        {
            "person": person,
            "setting": setting,
            "height": heights[block],
            "energy": energies[block] * shares[setting],
            "noisier": noise[setting],
        }
    )
    generator = np.random.default_rng(seed)
    estimates = simulate_estimates(frame, (heights, energies), plan.observer, generator)
    changed = setting == setting.max()  # the last condition is the one that changes realism
    return frame.assign(
        participant=person.astype(str),
        condition=names[setting],
        stimulus=block.astype(str),
        estimate=estimates,
        error=estimates - heights[block],
        rating=simulate_ratings(person, changed, plan.observer, generator),
    )


def simulate_p_value(plan: SimulatedStudy, analysis: str, seed: int) -> float:
    """Simulate a study and test its conditions; `analysis` is one of `ANALYSES`."""
    simulated = simulate_judgement_table(plan, seed)
    if plan.measure == REALISM:
        return _compute_rating_p_value(simulated)
    frame, block = compute_measure_values(simulated, plan.measure)
    frame = _add_effect_to_last_condition(frame, plan)
    if analysis == "f-test":
        test = run_f_test(frame, "value", "condition", block, intervals=False)
        (condition, *_) = test.terms
        return condition.p
    fit = fit_mixed_model(frame, "value", "condition", "participant", block, intervals=False)
    corrected = correct_condition_test(frame, fit.condition).term
    assert corrected is not None  # a plan has two conditions
    return corrected.p


def _add_effect_to_last_condition(frame: Table, plan: SimulatedStudy) -> Table:
    """Add the effect to the measure of the last condition, in a column ``value``."""
    changed, _ = plan.factors[-1]
    effect = plan.effect * (frame["condition"] == changed)
    return frame.assign(value=frame["value"] + effect)


def simulate_difference_spread(plan: SimulatedStudy, seed: int) -> float:
    """Find by simulation how participants scatter in the last less the first condition.

    It is that of the participants' means, last minus first condition, of a study with so many
    participants that it is known to a few per cent; in the unit of the measure.
    """
    many = replace(plan, participants=_PEOPLE_OF_SPREAD)
    frame, _ = compute_measure_values(simulate_judgement_table(many, seed), plan.measure)
    means = frame.groupby(["participant", "condition"])["value"].mean().unstack()
    first, last = plan.factors[0][0], plan.factors[-1][0]
    return float((means[last] - means[first]).std())


def _compute_rating_p_value(frame: Table) -> float:
    """Return the probability of ratings if conditions do not change them."""
    try:
        fit = fit_ordinal_model(frame, "rating", "condition", "participant")
    except StudyError:  # ratings without finite odds show no difference
        return 1.0
    return fit.participants.p


def estimate_power(
    plan: SimulatedStudy,
    analysis: str = "mixed",
    runs: int = 200,
    seed: int = 1,
    jobs: int = 1,
    on: "Client | None" = None,
) -> Power:
    """Estimate the power of a study at the 5 % level by simulation.

    Parameters
    ----------
    plan : SimulatedStudy
        The study.
    analysis : str
        One of `ANALYSES`.
    runs, seed, jobs : int
        Simulated studies, seed of all chance, processes (on which the outcome does not depend).
    on : distributed.Client, optional
        The cluster that simulates them; this machine where omitted.

    Raises
    ------
    StudyError
        If an option is out of range.
    """
    if analysis not in ANALYSES:
        raise StudyError(f"analysis must be one of {', '.join(ANALYSES)}, got {analysis!r}")
    if not _FEWEST_RUNS <= runs <= _MOST_RUNS:
        raise StudyError(f"runs must lie between {_FEWEST_RUNS} and {_MOST_RUNS}, got {runs}")
    if seed < 0 or jobs < 1:
        raise StudyError(f"seed and jobs must be at least 0 and at least 1, got {seed} and {jobs}")
    children = np.random.SeedSequence(seed).spawn(runs)
    studies = []
    for child in children:
        (state,) = child.generate_state(1, np.uint64)
        studies.append((plan, analysis, int(state)))
    p_values = run_calls(simulate_p_value, studies, jobs=jobs, on=on)
    significant = sum(p_value < _LEVEL for p_value in p_values)
    return _compute_power_interval(significant, runs)


def _compute_power_interval(significant_count: int, runs: int) -> Power:
    """Return the share of studies that find a difference."""
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(significant_count, runs, method="wilson")
    return Power(significant_count / runs, float(low), float(high))


def estimate_detection_power(
    participants: int, trials: int, ratio: float, observer: Observer, runs: int, seed: int
) -> Power:
    """Estimate how often a pair of blocks is distinguished.

    The shares of right answers of participants are tested against one half.

    Parameters
    ----------
    participants, trials : int
        How many, and how many comparisons each makes.
    ratio : float
        Of the energies of both blocks [1].
    observer : Observer
        What participants are like.
    runs, seed : int
        Simulated studies, and seed of all chance.

    Raises
    ------
    StudyError
        If there are fewer than two participants.
    """
    from scipy import stats

    if participants < 2:
        raise StudyError(f"a t-test over participants needs at least 2, got {participants}")
    noise = max(math.sqrt(2.0) * observer.sensation_noise, 1e-12)
    felt = float(stats.norm.cdf(abs(math.log(ratio)) / noise))
    right = (1.0 - observer.lapse) * felt + 0.5 * observer.lapse
    generator = np.random.default_rng(seed)
    shares = generator.binomial(trials, right, (runs, participants)) / trials
    means = shares.mean(axis=1) - 0.5
    errors = shares.std(axis=1, ddof=1) / math.sqrt(participants)
    limit = stats.t.ppf(1.0 - _LEVEL, participants - 1)
    return _compute_power_interval(int(np.sum(means > limit * errors)), runs)


@dataclass(frozen=True)
class _PowerQuestion:
    """What power is asked of, beside the size of the study.

    Attributes
    ----------
    heights, energies : mapping of float
        Of the blocks by their identities [m] and [J].
    conditions : tuple of str
        That are compared.
    damping, noise : mapping of float
        By condition [1]; 1 where not named.
    observer : Observer
        What participants are like.
    measure, analysis : str
        What is tested, and how.
    standard : str
        Block of comparisons that all others are compared with.
    trials : mapping of int
        Of the blocks that are compared with the standard, where the repetitions do not say them.
    effect, effect_size : float
        Of the last condition, in the unit of the measure, and over the standard deviation of the
        participants' differences [1]; one of both is zero.
    runs, seed, jobs : int
        Simulated studies per size, seed of all chance, processes.
    cluster : distributed.Client or None
        Where the studies are simulated; this machine where None.
    """

    heights: Mapping[str, float]
    energies: Mapping[str, float]
    conditions: tuple[str, ...]
    damping: Mapping[str, float]
    noise: Mapping[str, float]
    observer: Observer
    measure: str
    analysis: str
    standard: str
    trials: Mapping[str, int]
    effect: float
    effect_size: float
    runs: int
    seed: int
    jobs: int
    cluster: "Client | None"

    def check_standard(self) -> None:
        """Refuse a standard that is no block."""
        if self.standard not in self.energies:
            raise StudyError(
                f"standard must be one of the blocks {', '.join(self.energies)}, got "
                f"{self.standard!r}"
            )

    def make_interval_row(self, repetitions: int) -> dict[str, object]:
        """Return the range of a threshold or JND of one participant, as a row."""
        self.check_standard()
        trials = dict(self.trials)
        if not trials:
            trials = dict.fromkeys(self.heights, 2 * repetitions)  # in either order
            del trials[self.standard]
        plan = plan_comparisons(self.heights, self.energies, self.standard, trials, self.observer)
        return plan.make_interval_comparison_row(self.measure, self.runs, self.seed)

    def iterate_power_rows(
        self, participants: int, repetitions: int
    ) -> Iterator[dict[str, object]]:
        """Yield the power of one size for each block against the standard, as a row."""
        self.check_standard()
        trials = 2 * repetitions  # in either order
        for name, energy in self.energies.items():
            if name == self.standard:
                continue
            ratio = energy / self.energies[self.standard]
            power = estimate_detection_power(
                participants, trials, ratio, self.observer, self.runs, self.seed
            )
            yield {
                "analysis": "2afc",
                "participants": participants,
                "repetitions": repetitions,
                "judgements_each": trials,
                "stimulus": name,
                "height_um": self.heights[name] * 1e6,
                **asdict(power),
                "runs": self.runs,
            }

    def estimate_power_row(self, participants: int, repetitions: int) -> dict[str, object]:
        """Estimate the power with so many participants and repetitions; return it as a row."""
        shares, noise = [], []
        for name in self.conditions:
            shares.append((name, self.damping.get(name, 1.0)))
            noise.append(self.noise.get(name, 1.0))
        study = SimulatedStudy(
            participants=participants,
            repetitions=repetitions,
            heights=tuple(self.heights.values()),
            energies=tuple(self.energies.values()),
            factors=tuple(shares),
            observer=self.observer,
            noise=tuple(noise),
            measure=self.measure,
            effect=self.effect,
        )
        if self.effect_size:
            spread = simulate_difference_spread(study, self.seed)
            study = replace(study, effect=self.effect_size * spread)
        power = estimate_power(
            study, self.analysis, self.runs, self.seed, self.jobs, on=self.cluster
        )
        analysis = self.analysis
        if self.measure == REALISM:
            analysis = "ordinal"
        return {
            "measure": self.measure,
            "analysis": analysis,
            "participants": participants,
            "repetitions": repetitions,
            "judgements_each": repetitions * len(self.heights) * len(self.conditions),
            **asdict(power),
            "runs": self.runs,
        }


def study_power(
    source: Declared | Sequence[float],
    output: str | Path | None = None,
    *,
    seed: int,
    experiment: str = "estimates",
    probes: Sequence[str] = (),
    damping: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | None = None,
    measure: str = ANSWER,
    standard: str = "",
    trials: Mapping[str, int] = MappingProxyType({}),
    participants: Sequence[int] = (10,),
    repetitions: Sequence[int] = (REPETITIONS,),
    observer: Observer = TYPICAL_OBSERVER,
    effect: float = 0.0,
    effect_size: float = 0.0,
    analysis: str = "mixed",
    runs: int = 200,
    jobs: int = 1,
    on: "str | Client | None" = None,
    only: str | None = None,
    **felt: float,
) -> pd.DataFrame:
    """Estimate the power of studies of several sizes.

    Parameters
    ----------
    source : str, Path, StimulusSet or sequence of float
        Stimulus file, its set, or heights [m].
    output : str or Path, optional
        CSV to write.
    experiment : str
        ``"estimates"``; ``"virtual"``, with vibration off and on; or ``"constant"``, also as
        ``"2afc"``: each block against `standard`, by a t-test of the participants' shares of right
        answers against one half.
    seed, runs, jobs : int
        Seed of all chance, simulated studies per size, processes (on which the outcome does not
        depend).
    on : str or distributed.Client, optional
        A Dask cluster, as in `run_sweep`.
    probes : sequence of str
        The conditions that are compared; those of `damping` and `noise` if left out.
    damping, noise : mapping of float
        Share of the energy that a condition lets through, and how many times the response noise it
        has [1]; 1 where not named.
    measure : str
        ``"absolute error"``, which the report reads for accuracy, ``"bias"`` or ``"spread"``; of
        ``"virtual"`` also ``"realism"``, by the ordinal model, whatever `analysis` is: vibration
        moves ratings by the observer's `realism_gain`. Of ``"constant"``, ``"threshold"`` or
        ``"jnd"`` ask for the 95 % range of what is fitted to one participant, as simulated and as
        `place_heights` expects it for the same curve.
    standard : str
        Block of ``"constant"`` that all others are compared with.
    trials : mapping of int
        Of one participant with each block that is compared with the standard, for ``"threshold"``
        and ``"jnd"``; twice the repetitions with each if left out.
    participants, repetitions : sequence of int
        Sizes; every combination.
    observer, only, **felt
        As in `simulate_study` and `design_study`.
    effect : float
        By how much more of the measure the last condition has, beside what `damping` and `noise`
        do [m].
    effect_size : float
        The same over the standard deviation of the participants' differences (Cohen's d of paired
        differences) [1].
    analysis : str
        ``"mixed"`` or ``"f-test"``.

    Returns
    -------
    DataFrame
        One row per size: share of the studies that find a difference between conditions, and its 95
        % interval [1].

    Raises
    ------
    StepblocksError
        If an option is out of range, or a block does not release the probe.

    Examples
    --------
    >>> import stepblocks
    >>> table = stepblocks.study_power(
    ...     [30e-6, 60e-6], seed=1, damping={"bare": 1.0, "soft": 0.3}, participants=(4, 8), runs=10
    ... )
    >>> table["participants"].tolist()
    [4, 8]
    """
    check_seed(seed)
    blocks = choose_blocks(source, felt, only)
    energies = blocks.predict_energies()
    kind = _resolve_experiment_kind(experiment)
    vibration: tuple[str, ...] = ()
    if kind == "virtual":
        vibration = (VIBRATION_OFF, VIBRATION_ON)
    named = (*vibration, *probes, *(damping or {}), *(noise or {}))
    conditions = tuple(dict.fromkeys(named))
    if measure == REALISM:
        _check_realism_conditions(experiment, vibration, conditions)
    _check_effect(kind, measure, effect, effect_size)
    _check_curve_measure(kind, measure, trials, runs)
    heights = {item.identity: item.height for item in blocks.items}
    question = _PowerQuestion(
        heights=heights,
        energies=energies,
        conditions=conditions,
        damping=damping or {},
        noise=noise or {},
        observer=observer,
        measure=measure,
        analysis=analysis,
        standard=standard,
        trials=trials,
        effect=effect,
        effect_size=effect_size,
        runs=runs,
        seed=seed,
        jobs=jobs,
        cluster=None,
    )
    rows = list[dict[str, object]]()
    with open_cluster(on, jobs) as cluster:
        question = replace(question, cluster=cluster)
        if measure in CURVE_MEASURES:
            rows += map(question.make_interval_row, repetitions)
            participants = ()
        for people, times in itertools.product(participants, repetitions):
            if kind == "constant":
                rows += question.iterate_power_rows(people, times)
            else:
                rows.append(question.estimate_power_row(people, times))
    table = pd.DataFrame(rows)
    if output is not None:
        write_table(table, Path(output), "%.3f")
    return table


def _resolve_experiment_kind(experiment: str) -> str:
    """Return the kind of an experiment, an alias resolved; refuse one without a known power."""
    kind = ALIASES.get(experiment, experiment)
    if kind not in ("estimates", "virtual", "constant"):
        raise StudyError(
            "power is known of the experiments estimates, virtual, constant and 2afc, got "
            f"{experiment!r}"
        )
    return kind


def _check_realism_conditions(
    experiment: str, vibration: tuple[str, ...], conditions: tuple[str, ...]
) -> None:
    """Reject ratings of realism but for vibration off and on."""
    if not vibration or conditions != vibration:
        raise StudyError(
            "realism must be rated in the experiment virtual, with vibration off and on, got "
            f"{experiment} with {', '.join(conditions) or 'no conditions'}"
        )


def _check_effect(experiment: str, measure: str, effect: float, effect_size: float) -> None:
    """Reject an effect that the measure cannot have."""
    if not (math.isfinite(effect) and math.isfinite(effect_size)):
        raise StudyError(f"effect must be finite, got {effect} and {effect_size}")
    if effect and effect_size:
        raise StudyError("an effect must be stated as a length or as d, got both")
    if (effect or effect_size) and (experiment == "constant" or measure == REALISM):
        raise StudyError(f"an effect must be of {', '.join(MEASURES)}, got {measure}")
    if effect and measure == SPREAD:
        raise StudyError("an effect on the spread, which is no length, must be stated as d")


def _check_curve_measure(
    experiment: str, measure: str, trials: Mapping[str, int], runs: int
) -> None:
    """Reject a measure of comparisons in another experiment, and trials of another measure."""
    measures = " or ".join(CURVE_MEASURES)
    if measure not in CURVE_MEASURES:
        if trials:
            raise StudyError(f"trials must be given with the measure {measures}, got {measure}")
        return
    if experiment != "constant":
        raise StudyError(f"{measures} must be of the experiment constant, got {experiment}")
    if not _FEWEST_RUNS <= runs <= _MOST_RUNS:
        raise StudyError(f"runs must lie between {_FEWEST_RUNS} and {_MOST_RUNS}, got {runs}")
