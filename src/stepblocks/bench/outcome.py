"""What became of the trials of a session, counted."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from stepblocks.bench.examine import TrialStatus
from stepblocks.bench.feature_table import FeatureRow
from stepblocks.bench.trials import TrialTable
from stepblocks.errors import PipelineError


class _Outcome(NamedTuple):
    """A status with the heading of its reason."""

    status: TrialStatus
    heading: str


@dataclass
class OutcomeCounts:
    """Counts of the trials that are not in order.

    Attributes
    ----------
    counts : Counter
        Of each status with the heading of its reason.
    examples : dict of str to str
        First reason of each heading, in full.
    """

    counts: Counter[_Outcome] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)

    def count_excluded_by_heading(self) -> Counter[str]:
        """Return how many trials are excluded, by the heading of the reason."""
        excluded: Counter[str] = Counter()
        for outcome, count in self.counts.items():
            if outcome.status is TrialStatus.EXCLUDED:
                excluded[outcome.heading] = count
        return excluded

    def list_notes(self) -> list[str]:
        """Say how many trials are flagged or censored, and why."""
        notes = []
        for (status, heading), count in self.counts.items():
            if status is not TrialStatus.EXCLUDED:
                notes.append(f"{count} {status.value}: {heading}")
        return notes


def count_trial_outcomes(rows: Iterable[FeatureRow], table: TrialTable) -> OutcomeCounts:
    """Count what became of the trials of a session.

    Raises
    ------
    PipelineError
        If not one trial was measured.
    """
    outcomes = OutcomeCounts()
    for row in rows:
        if row.fault is not None:
            heading = row.fault.heading
            outcomes.counts[_Outcome(row.status, heading)] += 1
            outcomes.examples.setdefault(heading, row.reason)
    excluded = outcomes.count_excluded_by_heading()
    if excluded.total() == table.count:
        ((heading, count),) = excluded.most_common(1)
        raise PipelineError(
            f"no trial of {table.count} could be measured; {_format_times(count)} "
            f"{outcomes.examples[heading]} [{table.session.folder}]"
        )
    return outcomes


def list_session_notes(
    table: TrialTable, outcomes: OutcomeCounts, shared: Mapping[int, str]
) -> list[str]:
    """Say what a reader should know of a session.

    Parameters
    ----------
    table : TrialTable
    outcomes : OutcomeCounts
    shared : mapping of int to str
        Rows that stay as data though they contradict their traces, with the names of their groups.
    """
    notes = []
    for name in _find_constant_conditions(table):
        notes.append(f"all trials have one {name}")
    notes += outcomes.list_notes()
    for group, count in Counter(shared.values()).items():
        if count == 1:
            one_of_group = group.replace("trials", "trial", 1)
            notes.append(f"1 {one_of_group} is unlike its label and stays as data")
        else:
            notes.append(f"{count} {group} are unlike their labels together and stay as data")
    return notes


def _format_times(count: int) -> str:
    """Say how often something happened."""
    return "once" if count == 1 else f"{count} times"


def _find_constant_conditions(table: TrialTable) -> list[str]:
    """Return what the session does not vary, and of which it shows no effect."""
    levels: dict[str, set[str]] = {"block": set(), "speed": set(), "load": set()}
    for trial in table:
        levels["block"].add(trial.block)
        levels["speed"].add(str(trial.speed))
        levels["load"].add(str(trial.load))
    return [name for name, values in levels.items() if len(values) == 1]
