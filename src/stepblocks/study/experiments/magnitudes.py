"""Magnitude estimation: a number for what is felt, on a scale of the participant's own."""

import itertools

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.anova import Interval, run_f_test
from stepblocks.study.analysis.findings import EXPONENT, Analysis, format_contrast_name
from stepblocks.study.analysis.influence import tabulate_exponents
from stepblocks.study.analysis.magnitudes import fit_power_law
from stepblocks.study.analysis.people import describe_swapped_conditions
from stepblocks.study.analysis.repeated import compare_conditions_within_participants
from stepblocks.study.columns import Row, read_number_or_nan
from stepblocks.study.design.simulate import Observer, simulate_felt_energies
from stepblocks.study.experiments.kind import Experiment, Texts

FREE_MODULUS = "free-modulus"  # each participant chooses the number of the first block

# Simulated participants
_EXPONENT = 0.5  # of the energy
_MODULUS = 10.0  # median of the number that is given to the mean energy
_MODULUS_SPREAD = 0.5  # standard deviation of its logarithm


def _read_magnitude(planned: Row, answer: Row, ratings: tuple[int, int]) -> dict[str, float]:
    """Read a magnitude [1]."""
    magnitude = read_number_or_nan(answer["magnitude_ratio"])
    if not magnitude > 0.0:
        raise StudyError(
            f"magnitude_ratio must be a positive number, got {answer['magnitude_ratio']!r}"
        )
    return {"magnitude": magnitude}


def _simulate_magnitudes(
    trials: Table, observer: Observer, generator: np.random.Generator
) -> Texts:
    """Simulate magnitudes, as participants write them."""
    energies = trials["energy"].to_numpy()
    person = trials["person"].to_numpy()
    sensations = simulate_felt_energies(energies, observer, generator)
    moduli = np.exp(_MODULUS_SPREAD * generator.standard_normal(person.max() + 1))[person]
    magnitudes = moduli * (sensations / energies.mean()) ** _EXPONENT * _MODULUS
    texts = []
    for magnitude in magnitudes:
        texts.append((f"{magnitude:.3g}",))
    return texts


def _analyse_magnitudes(frame: Table, margin: float) -> Analysis:
    """Fit a power law in each condition, and compare exponents of conditions and groups.

    Parameters
    ----------
    frame : DataFrame
        participant, condition, height [m], magnitude [1]; a group, if there are any.
    margin : float
        Of no meaning here.
    """
    laws = []
    for name, judgements in frame.groupby("condition"):
        laws.append(fit_power_law(judgements, "magnitude", "height", "participant", str(name)))
    analysis = Analysis(frame=frame, power_laws=tuple(laws))
    table = tabulate_exponents(analysis)
    exponents = compare_conditions_within_participants(table)
    if "group" in frame:
        exponents += _compare_group_exponents(frame, table, "group")
    elif len(laws) > 1 and not exponents:  # nobody met two conditions
        exponents += _compare_group_exponents(frame, table, "condition")
    return Analysis(
        frame=frame,
        power_laws=analysis.power_laws,
        exponents=exponents,
        remarks=tuple(describe_swapped_conditions(table, EXPONENT)),
    )


def _compare_group_exponents(
    frame: Table, exponent_table: Table, group_column: str
) -> tuple[Interval, ...]:
    """Compare the mean exponents of groups of participants, which a column of `frame` names.

    `exponent_table` has the exponent of each participant (rows) in each condition (columns).
    """
    groups = frame.groupby("participant")[group_column].first()
    level = exponent_table.mean(axis=1).to_frame("value").assign(group=groups)
    return run_f_test(level, "value", "group").intervals


def _list_outcomes(frame: Table) -> list[str]:
    """Name the planned tests of exponents between every two conditions, and groups."""
    names = [frame["condition"]]
    if "group" in frame:
        names.append(frame["group"])
    outcomes = []
    for levels in names:
        for first, second in itertools.combinations(sorted(set(levels)), 2):
            outcomes.append(format_contrast_name(EXPONENT, first, second))
    return outcomes


MAGNITUDE = Experiment(
    title="Magnitude estimation",
    sheet_title="Magnitude estimation",
    answers=("magnitude_ratio",),
    value="magnitude",
    factors={"modulus": (FREE_MODULUS,)},
    read=_read_magnitude,
    simulate=_simulate_magnitudes,
    quantities=(EXPONENT,),
    list_outcomes=_list_outcomes,
    analyse=_analyse_magnitudes,
    takes=("probes", "factors", "interleaved", "repetitions"),
    default_condition=FREE_MODULUS,
)
