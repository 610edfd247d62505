"""The kinds of experiment: what each asks, how answers are read, simulated and analysed."""

# A new design of a study is one more entry of `EXPERIMENTS` with its functions.

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from stepblocks.errors import StudyError
from stepblocks.study import Table, require
from stepblocks.study.analysis.accuracy import MEASURES, analyse_measure
from stepblocks.study.analysis.anova import run_f_test
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.analysis.people import find_swapped_conditions
from stepblocks.study.analysis.population import QUANTITIES, compare_settings, fit_setting
from stepblocks.study.analysis.repeated import average_participants, compare_participants
from stepblocks.study.analysis.results import (
    EXPONENT,
    PowerLaw,
    name_contrast,
)
from stepblocks.study.design.simulate import (
    REALISM,
    Observer,
    rate_realism,
    simulate_comparison,
    simulate_estimates,
    simulate_sensation,
)
from stepblocks.study.design.trials import FACTOR, ORDERS, list_levels

Row = Mapping[str, str]
Texts = Sequence[tuple[str, ...]]
LARGEST_ESTIMATE = 10_000.0  # um; the same for every study, so that it reveals no height

Fields = dict[str, Any]  # of a `StudyResult`, by name


@dataclass(frozen=True)
class Experiment:
    """One kind of experiment.

    Attributes
    ----------
    title, sheet_title : str
        Of the report, and of the run sheets, which must not reveal what is varied.
    answers : tuple of str
        Columns that a participant fills in.
    value : str
        Column of the tidy table that holds the answer.
    factors : mapping
        Factors with their levels, where a design declares none.
    read : callable
        Takes a planned trial, its answer, and the ends of the ratings; returns columns of the
        tidy table, in SI.
    simulate : callable
        Takes trials, observer and generator; returns texts for `answers`.
    quantities : tuple of str
        What is tested, beside the ratings.
    analyse : callable
        Takes the tidy table and the margin within which conditions count as equivalent [m];
        returns fields of `StudyResult`.
    takes : tuple of str
        Options of `design_study` and `simulate_study` that the design follows.
    paired : bool
        Whether each block is compared with a standard.
    adaptive : bool
        Whether each block is chosen by the answers before it.
    """

    title: str
    sheet_title: str
    answers: tuple[str, ...]
    value: str
    factors: Mapping[str, Sequence[str]]
    read: Callable[[Row, Row, tuple[int, int]], dict[str, float]]
    simulate: Callable[[Table, Observer, np.random.Generator], Texts]
    quantities: tuple[str, ...]
    analyse: Callable[[Table, float], Fields]
    takes: tuple[str, ...] = ("factors",)
    paired: bool = False
    adaptive: bool = False


def refuse_unused_options(experiment: str, **options: object) -> None:
    """Refuse options that were given and that a kind of experiment does not follow."""
    for name in (name for name, value in options.items() if value):
        follow = [kind for kind, one in EXPERIMENTS.items() if name in one.takes]
        require(
            experiment in follow,
            f"{name} is an option of {', '.join(follow)}, not of {experiment}",
        )


def read_number(text: str) -> float:
    """Read a finite number; not-a-number where there is none."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) and "_" not in text else math.nan


def _read_estimate(planned: Row, answer: Row, ratings: tuple[int, int]) -> dict[str, float]:
    estimate = read_number(answer["estimate_um"])
    require(
        0.0 <= estimate <= LARGEST_ESTIMATE,
        f"estimate_um must be a number from 0 to {LARGEST_ESTIMATE:g}, got "
        f"{answer['estimate_um']!r}",
    )
    return {
        "estimate": estimate / 1e6,
        "error": (estimate - read_number(planned["height_um"])) / 1e6,
    }


def _read_virtual(planned: Row, answer: Row, ratings: tuple[int, int]) -> dict[str, float]:
    values = _read_estimate(planned, answer, ratings)
    low, high = ratings
    rating = read_number(answer["realism_rating"])
    require(
        low <= rating <= high and rating == int(rating),
        f"realism_rating must be a whole number from {low:g} to {high:g}, got "
        f"{answer['realism_rating']!r}",
    )
    return values | {"rating": int(rating)}


def _simulate_estimates(trials: Table, observer: Observer, generator: np.random.Generator) -> Texts:
    by_height = dict(zip(trials["height"], trials["undamped"], strict=True))
    known = (np.array(list(by_height)), np.array(list(by_height.values())))
    return [
        (f"{height * 1e6:.1f}",)
        for height in simulate_estimates(trials, known, observer, generator)
    ]


def _simulate_virtual(trials: Table, observer: Observer, generator: np.random.Generator) -> Texts:
    estimates = _simulate_estimates(trials, observer, generator)
    ratings = rate_realism(
        trials["person"].to_numpy(),
        np.array(["vibration-on" in list_levels(row) for row in trials.to_dict("records")]),
        observer,
        generator,
    )
    return [
        (estimate, f"{rating:.0f}") for (estimate,), rating in zip(estimates, ratings, strict=True)
    ]


def _analyse_estimates(frame: Table, margin: float) -> Fields:
    require(
        frame["condition"].nunique() >= 2,
        "errors of estimates are compared between conditions; this study has one",
    )
    found, lacking = [], list[str]()
    for name in MEASURES:
        try:
            one = analyse_measure(frame, name, margin)
            found.append(one)
            lacking += find_swapped_conditions(average_participants(one.frame), name)
            if one.left:
                lacking.append(
                    f"Without {name}, for answers that never vary: {', '.join(one.left)}."
                )
        except StudyError as error:
            if name != "spread":
                raise
            lacking.append(f"Not analysed: {error}.")
    return {"measures": tuple(found), "remarks": tuple(lacking)}


def _name_tests_of_ratings(frame: Table) -> dict[str, str]:
    # Name the test of each column: of several factors each is tested beside the others, for there
    # may be more cells than participants
    return {
        name: f"{REALISM}, {name.removeprefix(FACTOR)}"
        for name in map(str, frame)
        if name.startswith(FACTOR)
    } or {"condition": REALISM}


def _analyse_virtual(frame: Table, margin: float) -> Fields:
    found = _analyse_estimates(frame, margin)
    tests = _name_tests_of_ratings(frame)
    try:
        fits = {
            outcome: fit_ordinal_model(
                frame, "rating", name, "participant", [other for other in tests if other != name]
            )
            for name, outcome in tests.items()
        }
    except StudyError as error:  # the estimates stand by themselves
        return found | {"remarks": (*found["remarks"], f"Ratings are not analysed: {error}.")}
    return found | {"ordinal": fits}


def _read_comparison(planned: Row, answer: Row, ratings: tuple[int, int]) -> dict[str, float]:
    require(
        planned["condition"] in ORDERS,
        f"condition must be one of {', '.join(ORDERS)}, got {planned['condition']!r}",
    )
    text = answer["second_is_higher"].lower()
    require(
        text in ("y", "n", "yes", "no", "1", "0"),
        f"second_is_higher must be y or n, got {answer['second_is_higher']!r}",
    )
    second = text in ("y", "yes", "1")
    return {
        "higher": int(second == (planned["condition"] == "standard-first")),
        "standard": read_number(planned["standard_height_um"]) / 1e6,
    }


def _simulate_comparisons(
    trials: Table, observer: Observer, generator: np.random.Generator
) -> Texts:
    higher = [
        simulate_comparison(energy, standard, observer, generator)
        for energy, standard in zip(trials["energy"], trials["standard_energy"], strict=True)
    ]
    second = higher == (trials["condition"] == "standard-first")
    return [("y" if one else "n",) for one in second]


def _analyse_comparisons(frame: Table, margin: float) -> Fields:
    require(
        frame["standard"].nunique() == 1,
        "pairs of one study must have one standard, got "
        f"{', '.join(f'{value * 1e6:g} um' for value in sorted(frame['standard'].unique()))}",
    )
    standard = float(frame["standard"].iloc[0])
    found = tuple(
        fit_setting(str(setting), own, standard)
        for setting, own in frame.groupby(name_settings(frame))
    )
    pairs = list(itertools.combinations([one for one in found if one.model], 2))
    return {
        "comparisons": found,
        "contrasts": {
            quantity: tuple(compare_settings(quantity, *pair) for pair in pairs)
            for quantity in QUANTITIES
            if pairs
        },
    }


def name_settings(frame: Table) -> pd.Series:
    """Name the setting of each comparison: group, and levels of declared factors."""
    parts = [frame[name].astype(str) for name in frame if name == "group" or FACTOR in str(name)]
    return parts[0].str.cat(parts[1:], sep="/") if parts else pd.Series("", frame.index)


def list_outcomes(experiment: str, frame: Table) -> list[str]:
    """Name the planned tests of judgements, or of the trials of a design."""
    kind = EXPERIMENTS[experiment]
    if kind.value == "estimate":
        ratings = _name_tests_of_ratings(frame) if "realism_rating" in kind.answers else {}
        return [*kind.quantities, *ratings.values()]
    names = [name_settings(frame)] if kind.paired else [frame["condition"], frame.get("group", [])]
    pairs = [pair for own in names for pair in itertools.combinations(sorted(set(own)), 2)]
    return [name_contrast(quantity, *pair) for quantity in kind.quantities for pair in pairs]


def _read_magnitude(planned: Row, answer: Row, ratings: tuple[int, int]) -> dict[str, float]:
    magnitude = read_number(answer["magnitude_ratio"])
    require(
        magnitude > 0.0,
        f"magnitude_ratio must be a positive number, got {answer['magnitude_ratio']!r}",
    )
    return {"magnitude": magnitude}


def _simulate_magnitudes(
    trials: Table, observer: Observer, generator: np.random.Generator
) -> Texts:
    reach, person = trials["energy"].to_numpy(), trials["person"].to_numpy()
    sensations = simulate_sensation(reach, observer, generator)
    modulus = np.exp(0.5 * generator.standard_normal(person.max() + 1))[person]
    return [(f"{value:.3g}",) for value in modulus * (sensations / reach.mean()) ** 0.5 * 10.0]


def fit_power_law(
    frame: Table, magnitude: str, level: str, participant: str, condition: str = ""
) -> PowerLaw:
    """Fit ``magnitude = constant * level ** exponent`` to each participant, who keeps a modulus."""
    # Stevens, S. S. (1957), Psychological Review 64, 153-181, doi:10.1037/h0046162.
    from scipy import stats

    require(
        (frame[[magnitude, level]] > 0.0).all(axis=None),
        f"{magnitude} and {level} must be positive in every row",
    )
    found = []
    for person, own in frame.groupby(participant, sort=False):
        require(
            own[level].nunique() >= 3,
            f"an exponent needs three levels, got {own[level].nunique()} [participant {person}]",
        )
        line = stats.linregress(np.log(own[level]), np.log(own[magnitude]))
        found.append((str(person), float(line.slope), float(line.rvalue)))
    require(len(found) >= 2, f"an interval over participants needs at least two, got {len(found)}")
    slopes = [slope for _, slope, _ in found]
    mean = float(np.mean(slopes))
    reach = float(stats.t.ppf(0.975, len(slopes) - 1) * stats.sem(slopes))
    return PowerLaw(mean, mean - reach, mean + reach, tuple(found), condition)


def _analyse_magnitudes(frame: Table, margin: float) -> Fields:
    laws = [
        fit_power_law(own, "magnitude", "height", "participant", str(name))
        for name, own in frame.groupby("condition")
    ]
    table = pd.DataFrame(
        {law.condition: {who: e for who, e, _ in law.by_participant} for law in laws}
    )
    exponents = compare_participants(table)
    if "group" in frame or (len(laws) > 1 and not exponents):  # nobody met two conditions
        group = frame.groupby("participant")["group" if "group" in frame else "condition"].first()
        level = table.mean(axis=1).to_frame("value").assign(group=group)
        exponents += run_f_test(level, "value", "group").intervals
    return {
        "power_laws": tuple(laws),
        "exponents": exponents,
        "remarks": tuple(find_swapped_conditions(table, "exponent")),
    }


ALIASES = {"2afc": "constant"}
EXPERIMENTS: dict[str, Experiment] = {
    "estimates": Experiment(
        title="Errors of height estimates",
        sheet_title="Height estimates",
        answers=("estimate_um",),
        value="estimate",
        factors={"probe": ("bare", "hard", "soft")},
        read=_read_estimate,
        simulate=_simulate_estimates,
        quantities=MEASURES,
        analyse=_analyse_estimates,
        takes=(
            "probes",
            "factors",
            "interleaved",
            "equivalent",
            "noise",
            "reference",
            "repetitions",
        ),
    ),
    "virtual": Experiment(
        title="Virtual blocks: errors and realism",
        sheet_title="Virtual blocks: height and realism",
        answers=("estimate_um", "realism_rating"),
        value="estimate",
        factors={"vibration": ("vibration-off", "vibration-on")},
        read=_read_virtual,
        simulate=_simulate_virtual,
        quantities=MEASURES,
        analyse=_analyse_virtual,
        takes=(
            "factors",
            "interleaved",
            "equivalent",
            "ratings",
            "noise",
            "reference",
            "repetitions",
        ),
    ),
    "constant": Experiment(
        title="Comparison with a standard",
        sheet_title="Which of the two is higher",
        answers=("second_is_higher",),
        value="higher",
        factors={},
        read=_read_comparison,
        simulate=_simulate_comparisons,
        quantities=tuple(QUANTITIES),
        analyse=_analyse_comparisons,
        takes=("probes", "factors", "interleaved", "standard", "repetitions"),
        paired=True,
    ),
    "magnitude": Experiment(
        title="Magnitude estimation",
        sheet_title="Magnitude estimation",
        answers=("magnitude_ratio",),
        value="magnitude",
        factors={"modulus": ("free-modulus",)},
        read=_read_magnitude,
        simulate=_simulate_magnitudes,
        quantities=(EXPONENT,),
        analyse=_analyse_magnitudes,
        takes=("probes", "factors", "interleaved", "repetitions"),
    ),
}
EXPERIMENTS["adaptive"] = replace(
    EXPERIMENTS["constant"],
    title="Adaptive comparison with a standard",
    takes=("probes", "factors", "standard", "trials", "prior"),
    adaptive=True,
)
