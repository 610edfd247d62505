"""The influence of each participant: differences of a study without her."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import pandas as pd

from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.anova import Interval
from stepblocks.study.analysis.comparisons import Comparisons, CurveQuantity, compare_settings
from stepblocks.study.analysis.findings import (
    Analysis,
    ContrastTest,
    Finding,
    MeasureTest,
    PlannedTest,
    RatingTest,
)
from stepblocks.study.analysis.ordinal import fit_ordinal_model
from stepblocks.study.analysis.repeated import average_participants, compare_participants

_FEWEST = 3  # participants of whom one can be left out


@dataclass(frozen=True)
class Influence:
    """A difference of a planned test without one participant."""

    test: PlannedTest
    participant: str  # who is left out
    interval: Interval


def leave_out_each(analysis: Analysis, findings: Sequence[Finding]) -> Iterator[Influence]:
    """Yield the differences of every planned test without each participant.

    Where the others cannot carry the analysis, there is none.
    """
    people = sorted(analysis.frame["participant"].unique())
    if len(people) < _FEWEST:
        return
    remaining = _Others(analysis)
    for finding in findings:
        for who in people:
            with suppress(StudyError):
                for interval in remaining.compare_without(finding.test, who):
                    yield Influence(finding.test, who, interval)


class _Others:
    """The judgements of all participants but one."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis = analysis
        # one fit of the others serves every pair of settings; by setting and participant
        self._settings: dict[tuple[str, str], Comparisons] = {}

    def compare_without(self, test: PlannedTest, who: str) -> Sequence[Interval]:
        """Return the differences of a planned test without the participant `who`."""
        if isinstance(test, MeasureTest):
            means = average_participants(test.measure.frame)
            return compare_participants(means.drop(who, errors="ignore"))
        if isinstance(test, RatingTest):
            return self._compare_ratings(test, who)
        if test.is_logarithmic:
            return [self._compare_settings(test, who)]
        return self._compare_exponents(test, who)

    def _compare_ratings(self, test: RatingTest, who: str) -> Sequence[Interval]:
        """Return the odds of ratings of the others."""
        frame = self._analysis.frame
        remaining = frame[frame["participant"] != who]
        model = test.fit.model
        fit = fit_ordinal_model(
            remaining, model.rating, model.condition, model.participant, model.beside
        )
        return fit.effects

    def _compare_settings(self, test: ContrastTest, who: str) -> Interval:
        """Return the difference of comparisons of the others."""
        pair = []
        for setting in self._analysis.comparisons:
            if test.interval.involves(setting.setting):
                pair.append(self._leave_out(setting, who))
        first, second = pair
        return compare_settings(CurveQuantity(test.quantity), first, second)

    def _leave_out(self, setting: Comparisons, who: str) -> Comparisons:
        """Return a setting without a participant; the fit is made once."""
        key = (setting.setting, who)
        if key not in self._settings:
            self._settings[key] = setting.leave_out(who)
        return self._settings[key]

    def _compare_exponents(self, test: ContrastTest, who: str) -> Sequence[Interval]:
        """Return the difference of exponents of the others, if they met both conditions."""
        table = tabulate_exponents(self._analysis).drop(who, errors="ignore")
        intervals = []
        for interval in compare_participants(table):
            if (interval.first, interval.second) == (test.interval.first, test.interval.second):
                intervals.append(interval)
        return intervals


def tabulate_exponents(analysis: Analysis) -> Table:
    """Return the exponent of each participant (rows) in each condition (columns)."""
    columns = {}
    for law in analysis.power_laws:
        exponents = {}
        for person in law.by_participant:
            exponents[person.participant] = person.exponent
        columns[law.condition] = exponents
    return pd.DataFrame(columns)
