"""Estimates of heights (experiment 1 of the paper)."""

from collections.abc import Iterator

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.accuracy import MEASURES, SPREAD, Measure, analyse_measure
from stepblocks.study.analysis.findings import Analysis
from stepblocks.study.analysis.log_error import compute_log_errors
from stepblocks.study.analysis.people import describe_swapped_conditions
from stepblocks.study.analysis.repeated import tabulate_participant_means
from stepblocks.study.columns import Row, read_number_or_nan
from stepblocks.study.design.simulate import Observer, simulate_estimates
from stepblocks.study.experiments.kind import Experiment

LARGEST_ESTIMATE = 10_000.0  # um; the same for every study, so that it reveals no height


def read_estimate(planned: Row, answer: Row, ratings: tuple[int, int]) -> dict[str, float]:
    """Read an estimated height: the estimate and its error [m]."""
    estimate = read_number_or_nan(answer["estimate_um"])
    if not 0.0 <= estimate <= LARGEST_ESTIMATE:
        raise StudyError(
            f"estimate_um must be a number from 0 to {LARGEST_ESTIMATE:g}, got "
            f"{answer['estimate_um']!r}"
        )
    error = estimate - read_number_or_nan(planned["height_um"])
    return {"estimate": estimate / 1e6, "error": error / 1e6}


def simulate_estimate_texts(
    trials: Table, observer: Observer, generator: np.random.Generator
) -> list[tuple[str]]:
    """Simulate estimates in micrometres, as participants write them."""
    energy_of_height = dict(zip(trials["height"], trials["undamped"], strict=True))
    heights = np.array(list(energy_of_height))
    energies = np.array(list(energy_of_height.values()))
    estimates = simulate_estimates(trials, (heights, energies), observer, generator)
    texts = []
    for estimate in estimates:
        texts.append((f"{estimate * 1e6:.1f}",))
    return texts


def analyse_estimates(frame: Table, margin: float) -> Analysis:
    """Analyse bias, absolute error and spread of estimates.

    Parameters
    ----------
    frame : DataFrame
        participant, condition, stimulus, height [m], estimate [m], error [m].
    margin : float
        Within which conditions count as equivalent [m]; not-a-number for none.

    Raises
    ------
    StudyError
        If there is one condition, or the judgements cannot carry the analysis; where only the
        spread cannot be analysed, a remark says so.
    """
    if frame["condition"].nunique() < 2:
        raise StudyError("errors of estimates are compared between conditions; this study has one")
    measures = []
    remarks = list[str]()
    for name in MEASURES:
        try:
            measure = analyse_measure(frame, name, margin)
        except StudyError as error:
            if name != SPREAD:
                raise
            remarks.append(f"Not analysed: {error}.")
        else:
            measures.append(measure)
            remarks += _describe_participants(measure)
    log_errors = compute_log_errors(frame)
    if log_errors and log_errors[0].zeros:
        remarks.append(
            f"{log_errors[0].zeros} estimates of zero have no logarithm: left out of its error."
        )
    return Analysis(
        frame=frame, measures=tuple(measures), remarks=tuple(remarks), log_errors=log_errors
    )


def _describe_participants(measure: Measure) -> Iterator[str]:
    """Report participants whose conditions may be swapped, or who have no such measure."""
    yield from describe_swapped_conditions(tabulate_participant_means(measure.frame), measure.name)
    if measure.left:
        left = ", ".join(measure.left)
        yield f"Without {measure.name}, for answers that never vary: {left}."


def list_outcomes(frame: Table) -> list[str]:
    """Name the planned tests of estimates."""
    return list(MEASURES)


ESTIMATES = Experiment(
    title="Errors of height estimates",
    sheet_title="Height estimates",
    answers=("estimate_um",),
    value="estimate",
    factors={"probe": ("bare", "hard", "soft")},
    read=read_estimate,
    simulate=simulate_estimate_texts,
    quantities=MEASURES,
    list_outcomes=list_outcomes,
    analyse=analyse_estimates,
    takes=(
        "probes",
        "factors",
        "interleaved",
        "equivalent",
        "noise",
        "reference",
        "covariate",
        "repetitions",
    ),
)
