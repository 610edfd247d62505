"""How far estimates are off: on the average (bias), in size (absolute error), and from one another (spread)."""

# The paper asks whether heights are estimated "less accurately": that is the absolute error. The
# signed error that its F-test takes is the bias, which noise leaves where it is; the spread says
# whether it is noise that makes an absolute error.

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.quantities import format_column_label
from stepblocks.study import require
from stepblocks.study.analysis.anova import (
    Check,
    FTest,
    Interval,
    Term,
    check_residuals,
    make_term,
    run_f_test,
)
from stepblocks.study.analysis.mixed import MixedFit, fit_mixed_model

ANSWER = "absolute error"  # the measure that answers the paper's question
MEASURES = ("bias", ANSWER, "spread")


@dataclass(frozen=True)
class Equivalence:
    """How much two conditions can differ, by two one-sided tests."""

    # Schuirmann, D. J. (1987), J. Pharmacokinetics and Biopharmaceutics 15, 657-680,
    # doi:10.1007/BF01068419.

    first: str
    second: str
    # they differ by less than this at the 5 % level: the farther end of the 90 % interval
    bound: float
    margin: float  # that was asked about; not-a-number where none was
    statistic: float  # Student's t of the worse side against the margin
    df: float
    p: float  # probability of it or more if they differ by the margin


@dataclass(frozen=True)
class Measure:
    """One measure of accuracy: the paper's analysis of it and the mixed model beside; lengths in metres, spread in ln(metres)."""

    name: str  # one of `MEASURES`
    # participant, condition, value, and stimulus but for the spread, which is one value over all
    # blocks
    frame: Any
    f_test: FTest
    mixed: MixedFit
    checks: tuple[Check, ...]  # of the residuals of the mixed model
    equivalence: tuple[Equivalence, ...]  # of every two conditions
    groups: tuple[
        Term, ...
    ] = ()  # of participants, such as dentists and students: ``group`` and ``condition:group``
    group_intervals: tuple[Interval, ...] = ()  # differences between groups

    @property
    def logarithmic(self) -> bool:
        """Whether differences are logarithms of ratios."""
        return self.name == "spread"

    @property
    def label(self) -> str:
        """Its name with its unit, as people write it."""
        return format_column_label(f"{'ln_' if self.logarithmic else ''}{self.name}_um")


def compute_measure(frame: Any, name: str) -> tuple[Any, str]:
    """Return a table with a column ``value`` for a measure, and the column of its blocks, if it has one."""
    # The spread is the logarithm of a participant's standard deviation in a condition, pooled over
    # the blocks, within which the judgements are repeated: what a block's own bias adds is not in
    # it.
    if name != "spread":
        value = frame["error"].abs() if name == ANSWER else frame["error"]
        return frame.assign(value=value), "stimulus" if frame["stimulus"].nunique() > 1 else ""
    cell = ["participant", "condition"]
    apart = frame["error"] - frame.groupby([*cell, "stimulus"])["error"].transform("mean")
    cells = frame.assign(square=apart**2).groupby(cell, sort=False)
    left = cells.size() - cells["stimulus"].nunique()
    variance = cells["square"].sum() / left.where(left > 0)
    if not (variance > 0.0).all():
        raise StudyError(
            "spread needs judgements of a block that are repeated and differ, by every "
            "participant in every condition"
        )
    group = {"group": cells["group"].first()} if "group" in frame else {}
    return (0.5 * np.log(variance)).rename("value").to_frame().assign(**group).reset_index(), ""


def analyse_measure(frame: Any, name: str, margin: float = math.nan) -> Measure:
    """Analyse one measure; `margin` [m] is what two conditions may differ by and still count as equivalent."""
    data, block = compute_measure(frame, name)
    tested = run_f_test(data, "value", "condition", block)
    mixed = fit_mixed_model(data, "value", "condition", "participant", block)
    checks = check_residuals(mixed.residuals, data["condition"].tolist(), mixed.participant_effects)
    asked = math.nan if name == "spread" else margin
    alike = tuple(
        assess_equivalence(one, mixed.condition.df_error, asked)
        for one in mixed.intervals
        if mixed.condition
    )
    groups = compare_groups(data) if "group" in data else ((), ())
    return Measure(name, data, tested, mixed, tuple(checks), alike, *groups)


def assess_equivalence(one: Interval, df: float, margin: float = math.nan) -> Equivalence:
    """Test whether two conditions differ by less than a margin, from either side."""
    from scipy.stats import t

    require(not margin <= 0.0, f"a margin of equivalence must be positive, got {margin:g}")
    bound = abs(one.difference) + float(t.ppf(0.95, df)) * one.error
    statistic = (margin - abs(one.difference)) / one.error
    return Equivalence(
        one.first, one.second, bound, margin, statistic, df, float(t.sf(statistic, df))
    )


def compare_groups(data: Any) -> tuple[tuple[Term, ...], tuple[Interval, ...]]:
    """Compare groups of participants by a split-plot analysis of the participants' means."""
    # Winer, B. J. (1971), Statistical Principles in Experimental Design, 2nd ed., 7.2. Groups may
    # differ in size.
    keys = ["participant", "condition"]
    cells = (
        data.groupby([*keys, "stimulus"])["value"].mean()
        if "stimulus" in data
        else data.set_index(keys)["value"]
    )
    table = cells.groupby(keys).mean().unstack()
    group = data.groupby("participant")["group"].first().reindex(table.index)
    sizes = group.value_counts().sort_index()
    if len(sizes) < 2 or sizes.min() < 2 or table.isna().to_numpy().any():
        raise StudyError(
            f"groups must be at least two of at least two participants each, got {dict(sizes)}"
        )
    level = table.mean(axis=1)
    between = run_f_test(level.to_frame("value").assign(group=group), "value", "group")
    if table.shape[1] == 1:
        return between.terms, between.intervals
    own = table.sub(level, axis=0)
    left = float(((own - own.groupby(group).transform("mean")) ** 2).to_numpy().sum())
    spare = float(((own - own.mean()) ** 2).to_numpy().sum()) - left
    rows, columns = (
        (count - 1.0) * (table.shape[1] - 1) for count in (len(sizes), len(table) - len(sizes) + 1)
    )
    within = make_term("condition:group", rows, columns, spare, spare / rows / (left / columns))
    return (*between.terms, within), between.intervals
