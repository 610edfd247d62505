"""The accuracy of estimates: their bias, absolute error and spread."""

# The paper asks whether heights are estimated "less accurately": that is the absolute error. The
# signed error that its F-test takes is the bias, which noise leaves where it is; the spread says
# whether it is noise that makes an absolute error.

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import linalg, stats

from stepblocks.errors import StudyError
from stepblocks.files.table_rows import list_column_names
from stepblocks.files.tables import Table
from stepblocks.quantities import format_column_label
from stepblocks.study.analysis.anova import (
    FTest,
    Interval,
    Term,
    make_term,
    run_f_test,
)
from stepblocks.study.analysis.mixed import MixedFit, fit_mixed_model
from stepblocks.study.analysis.repeated import (
    Sphericity,
    assess_contrast_effect,
    compare_conditions_within_participants,
    iterate_factor_tests,
    tabulate_participant_means,
)
from stepblocks.study.columns import FACTOR, ORDER, list_factor_columns

BIAS = "bias"
ANSWER = "absolute error"  # the measure that answers the paper's question
SPREAD = "spread"
MEASURES = (BIAS, ANSWER, SPREAD)


@dataclass(frozen=True)
class Measure:
    """One measure of accuracy; lengths in metres, spread in ln(metres).

    Attributes
    ----------
    name : str
        One of `MEASURES`.
    frame : DataFrame
        participant, condition, value, and stimulus but for the spread, which is one value over all
        blocks.
    f_test : FTest
        The paper's analysis, which takes judgements of one participant for independent.
    mixed : MixedFit
        The model of repeated measures.
    corrected : Term or None
        Its test of the conditions, degrees of freedom multiplied by Huynh and Feldt's epsilon; what
        the report reads.
    sphericity : Sphericity or None
        Of the participants who judged in every condition; None for fewer than three.
    paired : tuple of Interval
        Differences of conditions by the participants' own differences.
    factors : tuple of Term
        Every declared factor and interaction, where there are several factors.
    margin : float
        Within which conditions count as equivalent [m]; not-a-number where none was asked about.
    groups, group_intervals : tuple
        Tests and differences of groups of participants, such as dentists and students.
    left : tuple of str
        Participants who have no such measure.
    """

    name: str
    frame: Table
    f_test: FTest
    mixed: MixedFit
    corrected: Term | None
    sphericity: Sphericity | None
    paired: tuple[Interval, ...]
    factors: tuple[Term, ...]
    margin: float
    groups: tuple[Term, ...] = ()
    group_intervals: tuple[Interval, ...] = ()
    left: tuple[str, ...] = ()

    @property
    def is_logarithmic(self) -> bool:
        """Whether differences are logarithms of ratios."""
        return self.name == SPREAD

    @property
    def label(self) -> str:
        """Name with unit, as it stands on an axis."""
        if self.is_logarithmic:
            return "ln(spread / um)"
        return format_column_label(f"{self.name}_um")


class MeasuredTable(NamedTuple):
    """Judgements with a column ``value``, and the column of their blocks; empty without one."""

    data: Table
    block: str


class ConditionTest(NamedTuple):
    """A test of conditions, and the sphericity that its degrees of freedom are corrected for."""

    term: Term | None
    sphericity: Sphericity | None


class GroupComparison(NamedTuple):
    """Tests of groups of participants, and the differences of every two groups."""

    terms: tuple[Term, ...]
    intervals: tuple[Interval, ...]


class Equivalence(NamedTuple):
    """Two one-sided tests of a difference.

    Attributes
    ----------
    bound : float
        What two conditions differ by less than at the 5 % level, in the unit of the difference.
    statistic, p : float
        Student's t of the worse side against a margin, and its probability; not-a-number without
        a margin.
    """

    bound: float
    statistic: float
    p: float


class _GroupedMeans(NamedTuple):
    """Means of participants (rows) in each condition (columns), and the group of each row."""

    table: Table
    group: pd.Series


def compute_measure_values(frame: Table, measure_name: str) -> MeasuredTable:
    """Compute one measure of accuracy of every judgement, or of every cell.

    The spread is the logarithm of a participant's standard deviation in a condition, pooled over
    the blocks, within which the judgements are repeated: a block's own bias is not in it.

    Parameters
    ----------
    frame : DataFrame
        participant, condition, stimulus, error [m].
    measure_name : str
        One of `MEASURES`.

    Raises
    ------
    StudyError
        If fewer than two participants have a spread.
    """
    if measure_name == SPREAD:
        return MeasuredTable(_compute_log_spreads(frame), "")
    value = frame["error"]
    if measure_name == ANSWER:
        value = value.abs()
    block = ""
    if frame["stimulus"].nunique() > 1:
        block = "stimulus"
    return MeasuredTable(frame.assign(value=value), block)


def _compute_log_spreads(frame: Table) -> Table:
    """Return ln(spread / m) of each participant in each condition, in a column ``value``.

    Columns of factors and groups are kept. Participants who never vary, or judged each block once,
    have no spread and are left out.
    """
    cell = ["participant", "condition"]
    means = frame.groupby([*cell, "stimulus"])["error"].transform("mean")
    residuals = frame["error"] - means
    cells = frame.assign(square=residuals**2).groupby(cell, sort=False)
    freedom = cells.size() - cells["stimulus"].nunique()
    variance = cells["square"].sum() / freedom.where(freedom > 0)
    constant = variance[~(variance > 0.0)].index.get_level_values("participant")
    varying = variance[~variance.index.get_level_values("participant").isin(set(constant))]
    if varying.index.get_level_values("participant").nunique() < 2:
        raise StudyError(
            "spread needs judgements of a block that are repeated and differ, by every "
            "participant in every condition"
        )
    spread = (0.5 * np.log(varying)).to_frame("value")
    for column in list_column_names(frame):
        if column == "group" or column.startswith(FACTOR):
            spread[column] = cells[column].first()
    table: Table = spread.reset_index()
    return table


def analyse_measure(frame: Table, measure_name: str, margin: float = math.nan) -> Measure:
    """Analyse one measure; conditions that differ by less than `margin` [m] are equivalent.

    Parameters
    ----------
    frame : DataFrame
        participant, condition, stimulus, error [m]; factors and groups, where there are any; and
        the order of trials where it is a covariate.
    measure_name : str
        One of `MEASURES`.
    margin : float, optional
        Of the spread, which is no length, there is none.

    Raises
    ------
    StudyError
        If the margin is not positive, or the judgements cannot carry the analysis.
    """
    if margin <= 0.0:
        raise StudyError(f"a margin of equivalence must be positive, got {margin:g}")
    if measure_name == SPREAD:
        margin = math.nan
    data, block = compute_measure_values(frame, measure_name)
    tested = run_f_test(data, "value", "condition", block)
    covariate = ORDER if ORDER in data else ""
    mixed = fit_mixed_model(data, "value", "condition", "participant", block, covariate=covariate)
    table = tabulate_participant_means(data)
    corrected, sphericity = correct_condition_test(data, mixed.condition)
    paired = compare_conditions_within_participants(table)
    factors = assess_declared_factors(data, table.dropna())
    groups = GroupComparison((), ())
    if "group" in data:
        groups = compare_participant_groups(data)
    without = set(frame["participant"]) - set(data["participant"])
    return Measure(
        name=measure_name,
        frame=data,
        f_test=tested,
        mixed=mixed,
        corrected=corrected,
        sphericity=sphericity,
        paired=paired,
        factors=factors,
        margin=margin,
        groups=groups.terms,
        group_intervals=groups.intervals,
        left=tuple(sorted(without)),
    )


def correct_condition_test(data: Table, term: Term | None) -> ConditionTest:
    """Multiply the degrees of freedom of a test of conditions by Huynh and Feldt's epsilon.

    It is that of the participants who judged in every condition, within their groups, as car and
    afex of R have it. Too few participants, or one condition, leave the test as it is.
    """
    table, group = _average_complete_participants(data)
    if term is None or table.shape[1] < 2 or len(table) < group.nunique() + 2:
        return ConditionTest(term, None)
    contrasts = linalg.helmert(table.shape[1])
    sphericity = assess_contrast_effect("condition", table.to_numpy(), contrasts, group).sphericity
    df = sphericity.huynh_feldt * term.df
    df_error = sphericity.huynh_feldt * term.df_error
    return ConditionTest(make_term("condition", df, df_error, math.nan, term.f), sphericity)


def _average_complete_participants(data: Table) -> _GroupedMeans:
    """Average each participant who judged in every condition; return means and groups."""
    table = tabulate_participant_means(data).dropna()
    groups = data.assign(group=data.get("group", "")).groupby("participant")["group"].first()
    return _GroupedMeans(table, groups[table.index])


def assess_declared_factors(data: Table, complete: Table) -> tuple[Term, ...]:
    """Test the factors within participants that a design declares, where it has several.

    Parameters
    ----------
    data : DataFrame
        participant, condition, value, and a column for each declared factor.
    complete : DataFrame
        Means of the participants who judged in every condition (rows) in each condition (columns).

    Returns
    -------
    tuple of Term
        Empty unless at least two factors are crossed and there are three participants.
    """
    names = list_factor_columns(list_column_names(data))
    if len(names) < 2 or len(complete) < 3:
        return ()
    most_levels = data.groupby("participant")[names].nunique().max()
    within = [name for name in names if most_levels[name] > 1]
    if len(within) < 2:
        return ()
    cells = data.groupby("condition")[within].first().reindex(complete.columns)
    levels = {}
    for name in within:
        levels[name.removeprefix(FACTOR)] = sorted(cells[name].unique())
    if math.prod(map(len, levels.values())) != len(cells):
        return ()
    crossed = cells.sort_values(within).index
    return tuple(iterate_factor_tests(complete[crossed], levels))


def assess_equivalence(interval: Interval, margin: float = math.nan) -> Equivalence:
    """Assess by two one-sided tests how much two conditions can differ.

    Parameters
    ----------
    interval : Interval
        Their difference.
    margin : float, optional
        In the unit of the difference.

    References
    ----------
    Schuirmann, D. J. (1987), J. Pharmacokinetics and Biopharmaceutics 15, 657-680,
    doi:10.1007/BF01068419.
    """
    size = abs(interval.difference)
    bound = size + float(stats.t.ppf(0.95, interval.df)) * interval.error
    statistic = (margin - size) / interval.error
    return Equivalence(bound, statistic, float(stats.t.sf(statistic, interval.df)))


def compare_participant_groups(data: Table) -> GroupComparison:
    """Compare groups of participants by a split-plot analysis of the participants' means.

    Groups may differ in size. A participant without a condition is left out; the notes name her.

    Raises
    ------
    StudyError
        If there are fewer than two groups of at least two participants each.

    References
    ----------
    Winer, B. J. (1971), Statistical Principles in Experimental Design, 2nd ed., 7.2.
    """
    table, group = _average_complete_participants(data)
    sizes = group.value_counts().sort_index()
    if len(sizes) < 2 or not sizes.min() >= 2:
        raise StudyError(
            f"groups must be at least two of at least two participants each, got {dict(sizes)}"
        )
    level = table.mean(axis=1).to_frame("value").assign(group=group)
    between = run_f_test(level, "value", "group")
    contrasts = linalg.helmert(table.shape[1])
    within = assess_contrast_effect("condition:group", table.to_numpy(), contrasts, group).term
    return GroupComparison((*between.terms, within), between.intervals)
