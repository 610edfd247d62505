"""One participant's adaptive comparison: which pair comes next, and what the answers say so far.

Nothing is kept but the answers: the procedure is played again from them, so a session can stop at any trial and go on, and a
record that was changed does not pass for the one that was taken.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.errors import StudyError
from stepblocks.study.analysis.psychometric import Z75
from stepblocks.study.procedures import QuestPlus, Staircase

# QUEST+ on point of subjective equality, spread and lapse rate; two down, one up on blocks higher than the standard
METHODS = ("quest", "staircase")
_Z707 = 0.5449521356173604  # standard normal quantile of 0.5 ** 0.5, on which two down, one up converges
_SHIFTS = np.linspace(-0.5, 0.5, 31)
_SPREADS = np.geomspace(0.02, 1.5, 21)
_LAPSES = (0.0, 0.02, 0.05)
_HITS_DOWN, _SKIPPED = 2, 2


@dataclass(frozen=True)
class Plan:
    """What all participants of an adaptive study have in common."""

    method: str  # one of `METHODS`
    heights: Mapping[str, float]  # of each block [m] by its code
    standard: str  # code of the block that all others are compared with
    trials: int  # most comparisons of a participant
    reversals: int  # a staircase ends after so many
    seed: int  # decides which of a pair comes first

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise StudyError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")
        if self.standard not in self.heights:
            raise StudyError(f"standard must be one of the blocks, got {self.standard!r}")
        if self.trials < 1 or self.reversals < 4 or self.seed < 0:
            raise StudyError(
                f"trials, reversals and seed must be at least 1, 4 and 0, got {self.trials}, {self.reversals} and {self.seed}"
            )
        if len(set(self.heights.values())) < len(self.heights):
            raise StudyError("blocks of an adaptive study must differ in height")
        if len(self.compared) < 2:
            higher = " higher than the standard" if self.method == "staircase" else " beside the standard"
            raise StudyError(f"a {self.method} needs at least 2 blocks{higher}, got {len(self.compared)}")

    @property
    def compared(self) -> tuple[str, ...]:
        """Codes of the blocks that may be compared with the standard, ascending in height."""
        base = self.heights[self.standard]
        codes = sorted(self.heights, key=lambda code: self.heights[code])
        if self.method == "staircase":
            return tuple(code for code in codes if self.heights[code] > base)
        return tuple(code for code in codes if code != self.standard)


@dataclass(frozen=True)
class Pair:
    """The next comparison: codes in the order in which the blocks are given."""

    trial: int  # from 1
    first: str
    second: str

    def beside(self, standard: str) -> str:
        """Return the code that is not the standard's."""
        return self.first if self.second == standard else self.second


@dataclass(frozen=True)
class Estimate:
    """What a participant's answers say."""

    equal: float  # height that feels as high as the standard [m]; the standard itself for a staircase
    equal_low: float  # ends of its 95 % interval [m]
    equal_high: float
    weber: float  # Weber fraction of the height [1]
    weber_low: float  # ends of its 95 % interval; not-a-number for a staircase, which alone tells none
    weber_high: float


class Session:
    """The comparisons of one participant, from the answers given so far."""

    def __init__(self, plan: Plan, participant: int) -> None:
        self.plan, self.participant = plan, participant
        self._answers: list[tuple[Pair, bool]] = []
        self._next: Pair | None = None
        base = plan.heights[plan.standard]
        self._levels = {code: math.log(plan.heights[code] / base) for code in plan.compared}
        self._by_level = {level: code for code, level in self._levels.items()}
        levels = list(self._levels.values())
        self._stairs = Staircase(levels, _HITS_DOWN) if plan.method == "staircase" else None
        self._quest = None if self._stairs else QuestPlus(levels, list(_SHIFTS), list(_SPREADS), _LAPSES, guess=None)

    def __str__(self) -> str:
        pair = self.next_pair()
        if pair is None:
            return f"participant {self.participant}: done after {len(self._answers)} trials"
        return f"participant {self.participant}, trial {pair.trial}: first {pair.first}, then {pair.second}"

    @property
    def answers(self) -> Sequence[tuple[Pair, bool]]:
        """Pairs and whether the second was called higher, so far."""
        return tuple(self._answers)

    def next_pair(self) -> Pair | None:
        """Return the next comparison."""
        done = len(self._answers)
        if self._next is not None and self._next.trial == done + 1:
            return self._next
        over = self._stairs is not None and len(self._stairs.reversals) >= self.plan.reversals
        if done >= self.plan.trials or over:
            return None
        level = self._stairs.level if self._stairs else self._quest.next_level() if self._quest else 0.0
        pair = (self.plan.standard, self._by_level[level])
        chance = np.random.default_rng([self.plan.seed, self.participant, done])
        first, second = pair if chance.random() < 0.5 else pair[::-1]
        self._next = Pair(done + 1, first, second)
        return self._next

    def record(self, trial: int, second_is_higher: bool) -> None:
        """Take the answer to the next comparison."""
        pair = self.next_pair()
        if pair is None:
            raise StudyError(
                f"participant {self.participant} is done after {len(self._answers)} trials, got trial {trial}"
            )
        if trial != pair.trial:
            raise StudyError(f"trial must be {pair.trial}, the next of participant {self.participant}, got {trial}")
        compared = pair.beside(self.plan.standard)
        higher = second_is_higher == (compared == pair.second)
        if self._stairs:
            self._stairs.record(higher)
        elif self._quest:
            self._quest.record(self._levels[compared], higher)
        self._answers.append((pair, second_is_higher))

    def estimate(self) -> Estimate:
        """Return what the answers say."""
        base = self.plan.heights[self.plan.standard]
        if quest := self._quest:
            equal = [base * math.exp(quest.quantile(0, share)) for share in (0.5, 0.025, 0.975)]
            weber = [math.expm1(Z75 * quest.quantile(1, share)) for share in (0.5, 0.025, 0.975)]
            return Estimate(*equal, *weber)
        assert self._stairs is not None
        later = self._stairs.reversals[_SKIPPED:]
        if sum(level == self._stairs.levels[0] for level in later) > len(later) // 3:  # two of three troughs
            raise StudyError("the staircase rests on its lowest block: the threshold is below what the blocks can tell")
        spread = self._stairs.threshold(_SKIPPED) / _Z707
        return Estimate(base, base, base, math.expm1(Z75 * spread), math.nan, math.nan)
