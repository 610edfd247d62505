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
from stepblocks.study.analysis.repeated import (
    compare_conditions_within_participants,
    tabulate_participant_means,
)

_FEWEST = 3  # participants of whom one can be left out


@dataclass(frozen=True)
class Influence:
    """A difference of a planned test without one participant."""

    test: PlannedTest
    participant: str  # who is left out
    interval: Interval


def iterate_influences(analysis: Analysis, findings: Sequence[Finding]) -> Iterator[Influence]:
    """Yield the differences of every planned test without each participant.

    Where the others cannot carry the analysis, there is none.
    """
    people = sorted(analysis.frame["participant"].unique())
    if len(people) < _FEWEST:
        return
    remaining = _AllButOneParticipant(analysis)
    for finding in findings:
        for who in people:
            with suppress(StudyError):
                for interval in remaining.compare_without(finding.test, who):
                    yield Influence(finding.test, who, interval)


class _AllButOneParticipant:
    """The judgements of all participants but one."""

    def __init__(self, analysis: Analysis) -> None:
        self._analysis = analysis
        # one fit of the others serves every pair of settings; by setting and participant
        self._settings: dict[tuple[str, str], Comparisons] = {}

    def compare_without(self, test: PlannedTest, participant: str) -> Sequence[Interval]:
        """Return the differences of a planned test without the participant `participant`."""
        if isinstance(test, MeasureTest):
            means = tabulate_participant_means(test.measure.frame)
            return compare_conditions_within_participants(means.drop(participant, errors="ignore"))
        if isinstance(test, RatingTest):
            return self._compare_ratings(test, participant)
        if test.is_logarithmic:
            return [self._compare_settings(test, participant)]
        return self._compare_exponents(test, participant)

    def _compare_ratings(self, test: RatingTest, participant: str) -> Sequence[Interval]:
        """Return the odds of ratings of the others."""
        frame = self._analysis.frame
        remaining = frame[frame["participant"] != participant]
        model = test.fit.model
        fit = fit_ordinal_model(
            remaining, model.rating, model.condition, model.participant, model.beside
        )
        return fit.effects

    def _compare_settings(self, test: ContrastTest, participant: str) -> Interval:
        """Return the difference of comparisons of the others."""
        pair = []
        for setting in self._analysis.comparisons:
            if test.interval.involves(setting.setting):
                pair.append(self._get_setting_without(setting, participant))
        first, second = pair
        return compare_settings(CurveQuantity(test.quantity), first, second)

    def _get_setting_without(self, setting: Comparisons, participant: str) -> Comparisons:
        """Return a setting without a participant; the fit is made once."""
        key = (setting.setting, participant)
        if key not in self._settings:
            self._settings[key] = setting.drop_participant(participant)
        return self._settings[key]

    def _compare_exponents(self, test: ContrastTest, participant: str) -> Sequence[Interval]:
        """Return the difference of exponents of the others, if they met both conditions."""
        table = tabulate_exponents(self._analysis).drop(participant, errors="ignore")
        intervals = []
        for interval in compare_conditions_within_participants(table):
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
