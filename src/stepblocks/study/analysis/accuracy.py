"""How far estimates are off: their bias, their absolute error, and their spread."""

# The paper asks whether heights are estimated "less accurately": that is the absolute error. The
# signed error that its F-test takes is the bias, which noise leaves where it is; the spread says
# whether it is noise that makes an absolute error.

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import linalg, stats

from stepblocks.quantities import format_column_label
from stepblocks.study import Table, require
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
    assess_effect,
    assess_factors,
    average_participants,
    compare_participants,
)

ANSWER = "absolute error"  # the measure that answers the paper's question
MEASURES = ("bias", ANSWER, "spread")


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
    def logarithmic(self) -> bool:
        """Whether differences are logarithms of ratios."""
        return self.name == "spread"

    @property
    def label(self) -> str:
        """Its name with its unit, as people write it."""
        return "ln(spread / um)" if self.logarithmic else format_column_label(f"{self.name}_um")


def compute_measure(frame: Table, name: str) -> tuple[Table, str]:
    """Return a table with a column ``value``, and the column of its blocks, if it has one."""
    # The spread is the logarithm of a participant's standard deviation in a condition, pooled over
    # the blocks, within which the judgements are repeated: a block's own bias is not in it.
    if name != "spread":
        value = frame["error"].abs() if name == ANSWER else frame["error"]
        return frame.assign(value=value), "stimulus" if frame["stimulus"].nunique() > 1 else ""
    cell = ["participant", "condition"]
    apart = frame["error"] - frame.groupby([*cell, "stimulus"])["error"].transform("mean")
    cells = frame.assign(square=apart**2).groupby(cell, sort=False)
    left = cells.size() - cells["stimulus"].nunique()
    variance = cells["square"].sum() / left.where(left > 0)
    # who never varies, or judged each block once, has no spread; the others keep theirs
    lacking = set(variance[~(variance > 0.0)].index.get_level_values("participant"))
    others = ~variance.index.get_level_values("participant").isin(lacking)
    require(
        variance[others].index.get_level_values("participant").nunique() >= 2,
        "spread needs judgements of a block that are repeated and differ, by every "
        "participant in every condition",
    )
    kept = {
        column: cells[column].first()
        for column in frame
        if column == "group" or str(column).startswith("factor_")
    }
    return (0.5 * np.log(variance[others])).to_frame("value").assign(**kept).reset_index(), ""


def analyse_measure(frame: Table, name: str, margin: float = math.nan) -> Measure:
    """Analyse one measure; conditions that differ by less than `margin` [m] are equivalent."""
    require(not margin <= 0.0, f"a margin of equivalence must be positive, got {margin:g}")
    data, block = compute_measure(frame, name)
    tested = run_f_test(data, "value", "condition", block)
    mixed = fit_mixed_model(data, "value", "condition", "participant", block)
    table = average_participants(data)
    return Measure(
        name,
        data,
        tested,
        mixed,
        *correct_conditions(data, mixed.condition),
        compare_participants(table),
        assess_declared_factors(data, table.dropna()),
        margin if name != "spread" else math.nan,
        *(compare_groups(data) if "group" in data else ((), ())),
        left=tuple(sorted(set(frame["participant"]) - set(data["participant"]))),
    )


def correct_conditions(data: Table, term: Term | None) -> tuple[Term | None, Sphericity | None]:
    """Multiply the degrees of freedom of a test of conditions by Huynh and Feldt's epsilon.

    It is that of the participants who judged in every condition, within their groups.
    """
    # as car and afex of R have it
    table, group = _join_groups(data)
    if term is None or table.shape[1] < 2 or len(table) < group.nunique() + 2:
        return term, None
    sphericity = assess_effect(
        "condition", table.to_numpy(), linalg.helmert(table.shape[1]), group
    )[1]
    df, df_error = (sphericity.huynh_feldt * count for count in (term.df, term.df_error))
    return make_term("condition", df, df_error, math.nan, term.f), sphericity


def _join_groups(data: Table) -> tuple[Table, pd.Series]:
    # Return the means of participants who judged in every condition, and the group of each
    table = average_participants(data).dropna()
    own = data.assign(group=data.get("group", "")).groupby("participant")["group"].first()
    return table, own[table.index]


def assess_declared_factors(data: Table, complete: Table) -> tuple[Term, ...]:
    """Test the factors within participants that a design declares, where it has several."""
    names = [name for name in data if str(name).startswith("factor_")]
    own = data.groupby("participant")[names].nunique().max() if names else {}
    within = [name for name in names if own[name] > 1]
    cells = data.groupby("condition")[within].first().reindex(complete.columns)
    levels = {name.removeprefix("factor_"): sorted(cells[name].unique()) for name in within}
    crossed = cells.sort_values(within).index if within else []
    if len(within) < 2 or math.prod(map(len, levels.values())) != len(cells) or len(complete) < 3:
        return ()
    return tuple(assess_factors(complete[crossed], levels))


def assess_equivalence(one: Interval, margin: float = math.nan) -> tuple[float, float, float]:
    """Assess by two one-sided tests how much two conditions can differ.

    Return what they differ by less than at the 5 % level, and Student's t of the worse side against
    the margin with its probability; not-a-number without one.
    """
    # Schuirmann, D. J. (1987), J. Pharmacokinetics and Biopharmaceutics 15, 657-680,
    # doi:10.1007/BF01068419.
    bound = abs(one.difference) + float(stats.t.ppf(0.95, one.df)) * one.error
    statistic = (margin - abs(one.difference)) / one.error
    return bound, statistic, float(stats.t.sf(statistic, one.df))


def compare_groups(data: Table) -> tuple[tuple[Term, ...], tuple[Interval, ...]]:
    """Compare groups of participants by a split-plot analysis of the participants' means."""
    # Winer, B. J. (1971), Statistical Principles in Experimental Design, 2nd ed., 7.2. Groups may
    # differ in size.
    # a participant without a condition is named in the notes
    table, group = _join_groups(data)
    sizes = group.value_counts().sort_index()
    require(
        len(sizes) >= 2 and sizes.min() >= 2,
        f"groups must be at least two of at least two participants each, got {dict(sizes)}",
    )
    level = table.mean(axis=1).to_frame("value").assign(group=group)
    between = run_f_test(level, "value", "group")
    within, _ = assess_effect(
        "condition:group", table.to_numpy(), linalg.helmert(table.shape[1]), group
    )
    return (*between.terms, within), between.intervals
