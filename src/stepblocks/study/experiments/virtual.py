"""Virtual blocks: estimates of heights and ratings of realism (experiment 2 of the paper)."""

from dataclasses import replace

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.files.table_rows import list_rows_by_column_name
from stepblocks.files.tables import Table
from stepblocks.study.analysis.accuracy import MEASURES
from stepblocks.study.analysis.findings import Analysis
from stepblocks.study.analysis.ordinal import OrdinalFit, fit_ordinal_model
from stepblocks.study.columns import FACTOR, Row, collect_levels_of_trial, read_number_or_nan
from stepblocks.study.design.simulate import REALISM, Observer, simulate_ratings
from stepblocks.study.design.virtual import VIBRATION, VIBRATION_OFF, VIBRATION_ON
from stepblocks.study.experiments.estimates import (
    analyse_estimates,
    read_estimate,
    simulate_estimate_texts,
)
from stepblocks.study.experiments.kind import Experiment, Texts


def _read_estimate_and_rating(
    planned: Row, answer: Row, ratings: tuple[int, int]
) -> dict[str, float]:
    """Read an estimated height [m] and a rating."""
    values = read_estimate(planned, answer, ratings)
    low, high = ratings
    rating = read_number_or_nan(answer["realism_rating"])
    if not (low <= rating <= high and rating == int(rating)):
        raise StudyError(
            f"realism_rating must be a whole number from {low:g} to {high:g}, got "
            f"{answer['realism_rating']!r}"
        )
    return {**values, "rating": int(rating)}


def _simulate_estimates_and_ratings(
    trials: Table, observer: Observer, generator: np.random.Generator
) -> Texts:
    """Simulate estimates in micrometres and ratings, as participants write them."""
    estimates = simulate_estimate_texts(trials, observer, generator)
    vibrating = []
    for row in list_rows_by_column_name(trials):
        texts_of_row = {name: str(value) for name, value in row.items()}
        vibrating.append(VIBRATION_ON in collect_levels_of_trial(texts_of_row))
    people = trials["person"].to_numpy()
    ratings = simulate_ratings(people, np.array(vibrating), observer, generator)
    texts = []
    for (estimate,), rating in zip(estimates, ratings, strict=True):
        texts.append((estimate, f"{rating:.0f}"))
    return texts


def _analyse_estimates_and_ratings(frame: Table, margin: float) -> Analysis:
    """Analyse estimates, and ratings where these can be: the estimates stand by themselves."""
    analysis = analyse_estimates(frame, margin)
    try:
        fits = _fit_rating_models(frame)
    except StudyError as error:
        remark = f"Ratings are not analysed: {error}."
        return replace(analysis, remarks=(*analysis.remarks, remark))
    return replace(analysis, ordinal=fits)


def _fit_rating_models(frame: Table) -> dict[str, OrdinalFit]:
    """Return an ordinal model for each outcome of ratings."""
    tests = _get_rating_test_names(frame)
    fits = {}
    for tested, outcome in tests.items():
        beside = [column for column in tests if column != tested]
        fits[outcome] = fit_ordinal_model(frame, "rating", tested, "participant", beside)
    return fits


def _get_rating_test_names(frame: Table) -> dict[str, str]:
    """Return the name of the test of each column.

    Of several factors each is tested beside the others, for there may be more cells than
    participants.
    """
    names = {}
    for column in map(str, frame):
        if column.startswith(FACTOR):
            names[column] = f"{REALISM}, {column.removeprefix(FACTOR)}"
    return names or {"condition": REALISM}


def _list_outcomes(frame: Table) -> list[str]:
    """Name the planned tests of estimates and ratings."""
    return [*MEASURES, *_get_rating_test_names(frame).values()]


VIRTUAL = Experiment(
    title="Virtual blocks: errors and realism",
    sheet_title="Virtual blocks: height and realism",
    answers=("estimate_um", "realism_rating"),
    value="estimate",
    factors={VIBRATION: (VIBRATION_OFF, VIBRATION_ON)},
    read=_read_estimate_and_rating,
    simulate=_simulate_estimates_and_ratings,
    quantities=MEASURES,
    list_outcomes=_list_outcomes,
    analyse=_analyse_estimates_and_ratings,
    takes=(
        "factors",
        "interleaved",
        "equivalent",
        "ratings",
        "noise",
        "reference",
        "covariate",
        "question",
        "anchors",
        "repetitions",
    ),
)
