"""The kinds of experiment: what each asks, and how its answers are read, simulated and analysed."""

# A new design of a study is one more entry of `EXPERIMENTS` with its functions.

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.study import require
from stepblocks.study.analysis.accuracy import MEASURES, analyse_measure
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.analysis.psychometric import fit_psychometric
from stepblocks.study.analysis.results import Curve, PowerLaw
from stepblocks.study.design import Design, design_constant_stimuli, design_crossover
from stepblocks.study.simulate import (
    Observer,
    estimate_heights,
    simulate_comparison,
    simulate_sensation,
)

Row = Mapping[str, str]
Texts = Sequence[tuple[str, ...]]


LARGEST_ESTIMATE = 20.0  # times the highest block [1]; what is above is a slip of the pen
RATINGS = (1, 7)  # lowest and highest


@dataclass(frozen=True)
class Experiment:
    """One kind of experiment."""

    title: str  # of the report
    sheet_title: str  # of the run sheets, which must not tell too much
    answers: tuple[str, ...]  # columns that are written down
    design: Callable[
        ..., Design
    ]  # of participants, blocks, repetitions, seed, and by name what it `needs`
    # of a planned trial, its answer, the largest estimate [um] and the ends of the ratings: columns
    # of the tidy table, in SI
    read: Callable[[Row, Row, float, tuple[int, int]], dict[str, Any]]
    # of the trials (the design, with what `simulate_answers` adds), observer and generator: texts
    # for `answers`
    simulate: Callable[[Any, Observer, np.random.Generator], Texts]
    # of the tidy table and the margin within which conditions count as equivalent [m]: fields of
    # `StudyResult`
    analyse: Callable[[Any, float], dict[str, Any]]
    needs: tuple[str, ...] = ()  # options beside the size: "probes", "standard"
    paired: bool = False  # each block is compared with a standard, given before or after it


def read_number(text: str) -> float:
    """Read a finite number; not-a-number where there is none."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) and "_" not in text else math.nan


def _read_estimate(
    planned: Row, answer: Row, top: float, ratings: tuple[int, int]
) -> dict[str, Any]:
    estimate = read_number(answer["estimate_um"])
    require(
        0.0 <= estimate <= top,
        f"estimate_um must be a number from 0 to {top:g}, got {answer['estimate_um']!r}",
    )
    return {
        "estimate": estimate / 1e6,
        "error": (estimate - read_number(planned["height_um"])) / 1e6,
    }


def _read_virtual(
    planned: Row, answer: Row, top: float, ratings: tuple[int, int]
) -> dict[str, Any]:
    values, rating = (
        _read_estimate(planned, answer, top, ratings),
        read_number(answer["realism_rating"]),
    )
    low, high = ratings
    said = (
        f"realism_rating must be a whole number from {low:g} to {high:g}, got "
        f"{answer['realism_rating']!r}"
    )
    require(low <= rating <= high and rating == int(rating), said)
    return values | {"rating": int(rating)}


def _simulate_estimates(trials: Any, observer: Observer, generator: np.random.Generator) -> Texts:
    by_height = dict(zip(trials["height"], trials["undamped"], strict=True))
    known = (np.array(list(by_height)), np.array(list(by_height.values())))
    return [
        (f"{height * 1e6:.1f}",) for height in estimate_heights(trials, known, observer, generator)
    ]


def _simulate_virtual(trials: Any, observer: Observer, generator: np.random.Generator) -> Texts:
    estimates = _simulate_estimates(trials, observer, generator)
    own = generator.standard_normal(trials["person"].max() + 1)
    felt = (
        own[trials["person"]]
        + observer.realism_gain * (trials["condition"] == "vibration-on").to_numpy()
    )
    ratings = np.clip(np.round(3.5 + (felt + generator.logistic(size=len(trials)))), *RATINGS)
    return [
        (estimate, f"{rating:.0f}") for (estimate,), rating in zip(estimates, ratings, strict=True)
    ]


def _analyse_estimates(frame: Any, margin: float) -> dict[str, Any]:
    if frame["condition"].nunique() < 2:
        raise StudyError("errors of estimates are compared between conditions; this study has one")
    found, lacking = [], list[str]()
    for name in MEASURES:
        try:
            found.append(analyse_measure(frame, name, margin))
        except StudyError as error:
            if name != "spread":
                raise
            lacking.append(f"Not analysed: {error}.")
    return {"measures": tuple(found), "remarks": tuple(lacking)}


def _read_comparison(
    planned: Row, answer: Row, top: float, ratings: tuple[int, int]
) -> dict[str, Any]:
    text = answer["second_is_higher"].lower()
    if text not in ("y", "n", "yes", "no", "1", "0"):
        raise StudyError(f"second_is_higher must be y or n, got {answer['second_is_higher']!r}")
    second = text in ("y", "yes", "1")
    higher = int(second == (planned["condition"] == "standard-first"))
    return {"higher": higher, "standard": read_number(planned["standard_height_um"]) / 1e6}


def _simulate_comparisons(trials: Any, observer: Observer, generator: np.random.Generator) -> Texts:
    answers = []
    for energy, standard, order in zip(
        trials["energy"], trials["standard_energy"], trials["condition"], strict=True
    ):
        higher = simulate_comparison(energy, standard, observer, generator)
        answers.append(("y" if higher == (order == "standard-first") else "n",))
    return answers


def _analyse_comparisons(frame: Any, margin: float) -> dict[str, Any]:
    curves = [_curve(str(name), own) for name, own in frame.groupby("participant", sort=False)]
    return {"curves": (*curves, _curve("all", frame)) if len(curves) > 1 else tuple(curves)}


def _curve(who: str, own: Any) -> Curve:
    by_level = own.groupby("height")["higher"].agg(["sum", "count"])
    levels, hits, totals = (
        tuple(column.tolist()) for column in (by_level.index, by_level["sum"], by_level["count"])
    )
    try:
        fit, reason = fit_psychometric(levels, hits, totals), ""
    except StudyError as error:
        fit, reason = None, str(error)
    return Curve(who, levels, hits, totals, fit, reason)


def _read_magnitude(
    planned: Row, answer: Row, top: float, ratings: tuple[int, int]
) -> dict[str, Any]:
    magnitude = read_number(answer["magnitude_ratio"])
    require(
        magnitude > 0.0,
        f"magnitude_ratio must be a positive number, got {answer['magnitude_ratio']!r}",
    )
    return {"magnitude": magnitude}


def _simulate_magnitudes(trials: Any, observer: Observer, generator: np.random.Generator) -> Texts:
    reach, person = trials["energy"].to_numpy(), trials["person"].to_numpy()
    felt = simulate_sensation(reach, observer, generator)
    modulus = np.exp(0.5 * generator.standard_normal(person.max() + 1))[person]
    return [(f"{value:.3g}",) for value in modulus * (felt / reach.mean()) ** 0.5 * 10.0]


def fit_power_law(frame: Any, magnitude: str, level: str, participant: str) -> PowerLaw:
    """Fit ``magnitude = constant * level ** exponent`` to each participant; each keeps an own modulus."""
    # Stevens, S. S. (1957), Psychological Review 64, 153-181, doi:10.1037/h0046162.
    from scipy import stats

    if not ((frame[magnitude] > 0.0).all() and (frame[level] > 0.0).all()):
        raise StudyError(f"{magnitude} and {level} must be positive in every row")
    found = []
    for person, own in frame.groupby(participant, sort=False):
        if own[level].nunique() < 3:
            raise StudyError(
                f"an exponent needs three levels, got {own[level].nunique()} [participant {person}]"
            )
        line = stats.linregress(np.log(own[level]), np.log(own[magnitude]))
        found.append((str(person), float(line.slope), float(line.rvalue)))
    require(len(found) >= 2, f"an interval over participants needs at least two, got {len(found)}")
    slopes = [slope for _, slope, _ in found]
    mean, error = float(np.mean(slopes)), float(np.std(slopes, ddof=1)) / len(slopes) ** 0.5
    reach = float(stats.t.ppf(0.975, len(slopes) - 1)) * error
    return PowerLaw(mean, mean - reach, mean + reach, tuple(found))


ALIASES = {"2afc": "constant"}
EXPERIMENTS: dict[str, Experiment] = {
    "estimates": Experiment(
        title="Errors of height estimates",
        sheet_title="Height estimates",
        answers=("estimate_um",),
        design=partial(design_crossover, "estimates"),
        read=_read_estimate,
        simulate=_simulate_estimates,
        analyse=_analyse_estimates,
        needs=("probes",),
    ),
    "virtual": Experiment(
        title="Virtual blocks: errors and realism",
        sheet_title="Virtual blocks: height and realism",
        answers=("estimate_um", "realism_rating"),
        design=partial(design_crossover, "virtual", probes=("vibration-off", "vibration-on")),
        read=_read_virtual,
        simulate=_simulate_virtual,
        analyse=lambda frame, margin: (
            _analyse_estimates(frame, margin)
            | {"ordinal": fit_ordinal_model(frame, "rating", "condition", "participant")}
        ),
    ),
    "constant": Experiment(
        title="Comparison with a standard",
        sheet_title="Which of the two is higher",
        answers=("second_is_higher",),
        design=design_constant_stimuli,
        read=_read_comparison,
        simulate=_simulate_comparisons,
        analyse=_analyse_comparisons,
        needs=("standard",),
        paired=True,
    ),
    "magnitude": Experiment(
        title="Magnitude estimation",
        sheet_title="Magnitude estimation",
        answers=("magnitude_ratio",),
        design=partial(design_crossover, "magnitude", probes=("free-modulus",)),
        read=_read_magnitude,
        simulate=_simulate_magnitudes,
        analyse=lambda frame, margin: {
            "power_law": fit_power_law(frame, "magnitude", "height", "participant")
        },
    ),
}
