"""Adaptive procedures on the blocks that exist: the transformed staircase and QUEST+.

The ``questplus`` package is under the GPL and cannot be a dependency here; the update is Bayes' rule on a grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError

Array = NDArray[np.float64]


@dataclass
class Staircase:
    """A staircase with one step up after a miss and one down after several hits in a row.

    Examples
    --------
    >>> stairs = Staircase([1.0, 2.0, 3.0], hits_down=1)
    >>> for hit in (True, True, False, True):
    ...     stairs.record(hit)
    >>> stairs.level, stairs.reversals
    (1.0, [1.0, 2.0])
    """

    levels: Sequence[float]  # intensities of the stimuli that exist, ascending, for instance heights [m]
    hits_down: int = 2  # hits in a row that lead down: 1, 2 and 3 converge on 50, 70.7 and 79.4 % hits
    start: int = -1  # index of the first level; the highest where omitted
    reversals: list[float] = field(default_factory=list, init=False)
    _index: int = field(init=False)
    _run: int = field(default=0, init=False)
    _direction: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        if len(self.levels) < 2 or any(b <= a for a, b in zip(self.levels, self.levels[1:], strict=False)):
            raise StudyError(f"levels must be at least two and ascend, got {list(self.levels)}")
        if self.hits_down < 1:
            raise StudyError(f"hits_down must be at least 1, got {self.hits_down}")
        if not -len(self.levels) <= self.start < len(self.levels):
            raise StudyError(f"start must be the index of one of {len(self.levels)} levels, got {self.start}")
        self._index = self.start % len(self.levels)

    @property
    def level(self) -> float:
        """Level of the next trial."""
        return float(self.levels[self._index])

    @property
    def target(self) -> float:
        """Share of hits on which the staircase converges, ``0.5 ** (1 / hits_down)``."""
        return float(0.5 ** (1.0 / self.hits_down))

    def record(self, hit: bool) -> None:
        """Take the answer to the present level and move on."""
        self._run = self._run + 1 if hit else 0
        if hit and self._run < self.hits_down:
            return
        direction = -1 if hit else 1
        if self._direction == -direction:
            self.reversals.append(self.level)
        self._direction, self._run = direction, 0
        self._index = min(max(self._index + direction, 0), len(self.levels) - 1)

    def threshold(self, skip: int = 2) -> float:
        """Estimate the threshold from the reversals."""
        later = self.reversals[skip:]
        later = later[len(later) % 2 :]
        if not later:
            raise StudyError(
                f"a threshold needs two reversals after the first {skip}, got {len(self.reversals)} in all"
            )
        return float(np.mean(later))


class QuestPlus:
    """Choose the next stimulus so that the expected entropy of threshold, slope and lapse rate is least.

    Examples
    --------
    >>> quest = QuestPlus([1.0, 2.0, 3.0], thresholds=[1.0, 3.0], slopes=[0.5], lapses=[0.0])
    >>> quest.next_level()
    2.0
    """

    def __init__(
        self,
        levels: Sequence[float],
        thresholds: Sequence[float],
        slopes: Sequence[float],
        lapses: Sequence[float] = (0.02,),
        guess: float | None = 0.0,
    ) -> None:
        from scipy.special import ndtr

        for name, values in (("levels", levels), ("thresholds", thresholds), ("slopes", slopes), ("lapses", lapses)):
            if not len(values) or not all(math.isfinite(value) for value in values):
                raise StudyError(f"{name} must be at least one finite number, got {list(values)}")
        if min(slopes) <= 0.0:
            raise StudyError(f"slopes must be positive, got {min(slopes):g}")
        most = max(lapses) if guess is None else guess
        if not (0.0 <= most < 1.0 and min(lapses) >= 0.0 and max(lapses) + most < 1.0):
            raise StudyError(f"guess and lapses must be rates whose sum is below 1, got {most:g} and {list(lapses)}")
        self._levels = np.asarray(levels, dtype=np.float64)
        grids = np.meshgrid(*(np.asarray(v, dtype=np.float64) for v in (thresholds, slopes, lapses)), indexing="ij")
        self._grid = tuple(grid.ravel() for grid in grids)
        threshold, slope, lapse = self._grid
        rising = ndtr((self._levels[:, np.newaxis] - threshold) / slope)
        base = lapse if guess is None else guess
        self._hit: Array = base + (1.0 - base - lapse) * rising
        self._posterior: Array = np.full(threshold.size, 1.0 / threshold.size)

    def next_level(self) -> float:
        """Return the level that is expected to teach most."""
        from scipy.special import xlogy

        expected = np.zeros(len(self._levels))
        for likelihood in (self._hit, 1.0 - self._hit):
            joint = likelihood * self._posterior
            total = joint.sum(axis=1)
            expected -= xlogy(joint, joint).sum(axis=1) - xlogy(total, total)
        return float(self._levels[int(np.argmin(np.round(expected, 12)))])

    def record(self, level: float, hit: bool) -> None:
        """Take an answer."""
        found = np.flatnonzero(self._levels == level)
        if not found.size:
            raise StudyError(f"level must be one of {self._levels.tolist()}, got {level:g}")
        likelihood = self._hit[found[0]] if hit else 1.0 - self._hit[found[0]]
        posterior = likelihood * self._posterior
        if posterior.sum() <= 0.0:
            raise StudyError(f"the answer {hit} at {level:g} is impossible under every parameter of the grid")
        self._posterior = posterior / posterior.sum()

    def estimate(self) -> tuple[float, float, float]:
        """Return the posterior means."""
        threshold, slope, lapse = (float(self._posterior @ values) for values in self._grid)
        return threshold, slope, lapse

    def quantile(self, which: int, share: float) -> float:
        """Return a quantile of one parameter's posterior."""
        values, index = np.unique(self._grid[which], return_inverse=True)
        weights = np.bincount(index, self._posterior)
        return float(np.interp(share, np.cumsum(weights) - 0.5 * weights, values))

    def entropy(self) -> float:
        """Return the entropy of the posterior."""
        known = self._posterior[self._posterior > 0.0]
        return float(-(known * np.log(known)).sum())
