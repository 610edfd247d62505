"""One participant's adaptive comparison by a staircase or QUEST+; a session is played again from its answers alone."""

# The ``questplus`` package is under the GPL and cannot be a dependency here; the update is Bayes'
# rule on a grid.

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError
from stepblocks.study import require
from stepblocks.study.analysis.psychometric import Z75

Array = NDArray[np.float64]

# QUEST+ on point of subjective equality, spread and lapse rate; two down, one up on blocks higher
# than the standard training: one down, three up on pairs in order of their difficulty, which keeps
# three of four answers right
METHODS = ("quest", "staircase", "training")
# standard normal quantile of 0.5 ** 0.5, on which two down, one up converges
_Z707 = 0.5449521356173604
_SHIFTS = np.linspace(-0.5, 0.5, 31).tolist()
_SPREADS = np.geomspace(0.02, 1.5, 21).tolist()
_LAPSES = (0.0, 0.02, 0.05)
_SKIPPED = 2  # first reversals, which still search
# what a participant's answers say: the height that feels as high as the standard (the standard
# itself for a staircase) and the Weber fraction of the height, each with the ends of its 95 %
# interval
ESTIMATED = ["equal_um", "equal_low_95_um", "equal_high_95_um"]
ESTIMATED += ["weber_ratio", "weber_low_95_ratio", "weber_high_95_ratio"]


@dataclass
class Staircase:
    """A staircase with one step up after a miss and one down after several hits in a row."""

    levels: Sequence[
        float
    ]  # intensities of the stimuli that exist, ascending, for instance heights [m]
    hits_down: int = (
        2  # hits in a row that lead down: 1, 2 and 3 converge on 50, 70.7 and 79.4 % hits
    )
    # levels up after a miss; 3 with one hit down converges on 75 %: Kaernbach, C. (1991),
    # Perception & Psychophysics 49, 227-229
    up: int = 1
    reversals: list[float] = field(default_factory=list, init=False)
    _index: int = field(init=False)
    _run: int = field(default=0, init=False)
    _direction: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        if len(self.levels) < 2 or any(
            b <= a for a, b in zip(self.levels, self.levels[1:], strict=False)
        ):
            raise StudyError(f"levels must be at least two and ascend, got {list(self.levels)}")
        self._index = len(self.levels) - 1

    @property
    def level(self) -> float:
        """Level of the next trial."""
        return float(self.levels[self._index])

    def record(self, hit: bool) -> None:
        """Take the answer to the present level and move on."""
        self._run = self._run + 1 if hit else 0
        if hit and self._run < self.hits_down:
            return
        direction = -1 if hit else 1
        if self._direction == -direction:
            self.reversals.append(self.level)
        self._direction, self._run = direction, 0
        self._index = min(
            max(self._index + direction * (1 if hit else self.up), 0), len(self.levels) - 1
        )

    def threshold(self, skip: int = _SKIPPED) -> float:
        """Estimate the threshold from the reversals."""
        later = self.reversals[skip:]
        later = later[len(later) % 2 :]
        require(
            later,
            f"a threshold needs two reversals after the first {skip}, got "
            f"{len(self.reversals)} "
            "in all",
        )
        return float(np.mean(later))


class QuestPlus:
    """Choose the next stimulus so that the expected entropy of threshold, slope and lapse rate is least."""

    def __init__(
        self,
        levels: Sequence[float],
        thresholds: Sequence[float],
        slopes: Sequence[float],
        lapses: Sequence[float],
    ) -> None:
        from scipy.special import ndtr

        self._levels = np.asarray(levels, dtype=np.float64)
        grids = np.meshgrid(
            *(np.asarray(v, dtype=np.float64) for v in (thresholds, slopes, lapses)), indexing="ij"
        )
        self._grid = tuple(grid.ravel() for grid in grids)
        threshold, slope, lapse = self._grid  # who lapses errs to either side
        rising = ndtr((self._levels[:, np.newaxis] - threshold) / slope)
        self._hit: Array = lapse + (1.0 - lapse - lapse) * rising
        self.posterior: Array = np.full(threshold.size, 1.0 / threshold.size)

    def next_level(self) -> float:
        """Return the level that is expected to teach most."""
        from scipy.special import xlogy

        expected = np.zeros(len(self._levels))
        for likelihood in (self._hit, 1.0 - self._hit):
            joint = likelihood * self.posterior
            total = joint.sum(axis=1)
            expected -= xlogy(joint, joint).sum(axis=1) - xlogy(total, total)
        return float(self._levels[int(np.argmin(np.round(expected, 12)))])

    def record(self, level: float, hit: bool) -> None:
        """Take an answer."""
        (share,) = self._hit[self._levels == level]
        posterior = (share if hit else 1.0 - share) * self.posterior
        self.posterior = posterior / posterior.sum()

    def quantile(self, which: int, share: float) -> float:
        """Return a quantile of one parameter's posterior."""
        values, index = np.unique(self._grid[which], return_inverse=True)
        weights = np.bincount(index, self.posterior)
        return float(np.interp(share, np.cumsum(weights) - 0.5 * weights, values))


@dataclass(frozen=True)
class Plan:
    """What all participants of an adaptive study have in common."""

    method: str  # one of `METHODS`
    heights: Mapping[str, float]  # of each block [m] by its code
    standard: str  # code of the block that all others are compared with
    trials: int  # most comparisons of a participant
    reversals: int  # a staircase ends after so many
    seed: int  # decides which of a pair comes first
    # predicted discriminability of each block from the standard [1]; of training
    ease: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require(
            self.method in METHODS,
            f"method must be one of {', '.join(METHODS)}, got {self.method!r}",
        )
        require(
            self.standard in self.heights,
            f"standard must be one of the blocks, got {self.standard!r}",
        )
        require(
            self.trials >= 1 and self.reversals >= 4 and self.seed >= 0,
            f"trials, reversals and seed must be at least 1, 4 and 0, got {self.trials}, "
            f"{self.reversals} and {self.seed}",
        )
        if len(set(self.heights.values())) < len(self.heights):
            raise StudyError("blocks of an adaptive study must differ in height")
        if len(self.compared) < 2:
            higher = (
                " higher than the standard"
                if self.method == "staircase"
                else " beside the standard"
            )
            raise StudyError(
                f"a {self.method} needs at least 2 blocks{higher}, got {len(self.compared)}"
            )

    @property
    def compared(self) -> tuple[str, ...]:
        """Codes of the blocks that may be compared with the standard, ascending in height."""
        base = self.heights[self.standard]
        codes = sorted(self.heights, key=lambda code: self.heights[code])
        if self.method == "staircase":
            return tuple(code for code in codes if self.heights[code] > base)
        others = (code for code in codes if code != self.standard)
        return tuple(sorted(others, key=lambda code: self.ease.get(code, 0.0)))


@dataclass(frozen=True)
class Pair:
    """The next comparison: codes in the order in which the blocks are given."""

    trial: int  # from 1
    first: str
    second: str

    def beside(self, standard: str) -> str:
        """Return the code that is not the standard's."""
        return self.first if self.second == standard else self.second


class Session:
    """The comparisons of one participant, from the answers given so far."""

    def __init__(self, plan: Plan, participant: int) -> None:
        self.plan, self.participant = plan, participant
        self.right: bool | None = None  # whether the last answer was, of a staircase
        self.answers: list[tuple[Pair, bool]] = []  # and whether the second was called higher
        self._next: Pair | None = None
        base = plan.heights[plan.standard]
        self._levels = {
            code: plan.ease.get(code, math.log(plan.heights[code] / base)) for code in plan.compared
        }
        self._by_level = {level: code for code, level in self._levels.items()}
        levels = list(self._levels.values())
        steps = {"staircase": (2, 1), "training": (1, 3)}.get(plan.method)
        self._stairs = Staircase(levels, *steps) if steps else None
        self._quest = QuestPlus(levels, _SHIFTS, _SPREADS, _LAPSES)

    def __str__(self) -> str:
        pair = self.next_pair()
        if pair is None:
            return f"participant {self.participant}: done after {len(self.answers)} trials"
        return (
            f"participant {self.participant}, trial {pair.trial}: first {pair.first}, then "
            f"{pair.second}"
        )

    def next_pair(self) -> Pair | None:
        """Return the next comparison."""
        done = len(self.answers)
        if self._next is not None and self._next.trial == done + 1:
            return self._next
        ended = (
            self._stairs
            and self.plan.method == "staircase"
            and len(self._stairs.reversals) >= self.plan.reversals
        )
        if done >= self.plan.trials or ended:
            return None
        level = self._stairs.level if self._stairs else self._quest.next_level()
        pair = (self.plan.standard, self._by_level[level])
        chance = np.random.default_rng([self.plan.seed, self.participant, done])
        first, second = pair if chance.random() < 0.5 else pair[::-1]
        self._next = Pair(done + 1, first, second)
        return self._next

    def record(self, trial: int, second_is_higher: bool) -> None:
        """Take the answer to the next comparison."""
        pair, done = self.next_pair(), len(self.answers)
        if pair is None:
            raise StudyError(
                f"participant {self.participant} is done after {done} trials, got trial {trial}"
            )
        if trial != pair.trial:
            raise StudyError(
                f"trial must be {pair.trial}, the next of participant {self.participant}, got "
                f"{trial}"
            )
        compared = pair.beside(self.plan.standard)
        higher = second_is_higher == (compared == pair.second)
        if self._stairs:
            self.right = higher == (
                self.plan.heights[compared] > self.plan.heights[self.plan.standard]
            )
            self._stairs.record(self.right)
        else:
            self._quest.record(self._levels[compared], higher)
        self.answers.append((pair, second_is_higher))

    def estimate(self) -> dict[str, float]:
        """Return what the answers say, in the columns `ESTIMATED`."""
        base = self.plan.heights[self.plan.standard] * 1e6
        require(
            self.plan.method != "training", "training keeps a trainee at 75 % and estimates nothing"
        )
        if self._stairs is None:
            equal = [
                base * math.exp(self._quest.quantile(0, share)) for share in (0.5, 0.025, 0.975)
            ]
            weber = [
                math.expm1(Z75 * self._quest.quantile(1, share)) for share in (0.5, 0.025, 0.975)
            ]
            return dict(zip(ESTIMATED, (*equal, *weber), strict=True))
        later = self._stairs.reversals[_SKIPPED:]
        if (
            sum(level == self._stairs.levels[0] for level in later) > len(later) // 3
        ):  # two of three troughs
            raise StudyError(
                "the staircase rests on its lowest block: the threshold is below what the "
                "blocks "
                "can tell"
            )
        fraction = math.expm1(Z75 * self._stairs.threshold() / _Z707)  # it alone tells no interval
        return dict(zip(ESTIMATED, (base, base, base, fraction, math.nan, math.nan), strict=True))
