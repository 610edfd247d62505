"""Does a trace belong to its row? Found out from the whole session, after every trace was measured.

A trace carries its conditions in itself: the normal force is the load, the slope of the ramp is stiffness times
speed, and peak, sliding and normal force together give the angle of the edge and so the height of the block,
whatever the friction was. A trace that contradicts its row in one of these, where the session as a whole does not,
belongs elsewhere.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.trials import Trial

Array = NDArray[np.float64]

_LOAD_FACTOR = 1.25  # measured over declared load, against the median of the session
_SLOPE_FACTOR = 1.5  # ramp over speed, against the median of the session
_WILD_FACTOR = 3.0  # the session as a whole: more than this is a matter of units
_UNIT_FACTOR = 100.0  # one trial: more than this may be a matter of units
_ANGLE_SIGMAS = 8.0
_ANGLE_SHARE = 0.12  # least relative deviation of the sine of half the angle
_FEWEST = 5  # trials of a block, to know its angle
_FEATURES = ("normal_load_n", "loading_slope_n_per_s", "peak_force_n", "sliding_friction")


@dataclass
class LabelCheck:
    """Collects 72 bytes per trial and names the trials whose trace belongs elsewhere.

    Examples
    --------
    >>> check = LabelCheck()
    >>> for row in range(1, 21):
    ...     load = 1.0 if row % 2 else 0.5
    ...     check.add(Trial(str(row), row, load=load), {"normal_load_n": 0.5 if row == 7 else load}, row)
    >>> check.faults()
    {7: 'mislabelled: the normal force is 0.5 N, the load of this row is 1 N'}
    """

    rows: array[int] = field(default_factory=lambda: array("q"))
    blocks: array[int] = field(default_factory=lambda: array("q"))
    digests: array[int] = field(default_factory=lambda: array("Q"))
    numbers: array[float] = field(default_factory=lambda: array("d"))
    names: dict[str, int] = field(default_factory=dict)

    def add(self, trial: Trial, features: dict[str, float], digest: int) -> None:
        """Take note of one measured trial; `digest` identifies the samples of its trace."""
        self.rows.append(trial.row)
        self.blocks.append(self.names.setdefault(trial.block, len(self.names)))
        self.digests.append(digest)
        self.numbers.extend((trial.load, trial.speed, *(features.get(name, math.nan) for name in _FEATURES)))

    def faults(self) -> dict[int, str]:
        """Reasons by row, for every trial whose trace belongs elsewhere."""
        if not self.rows:
            return {}
        load, speed, normal, slope, peak, friction = np.array(self.numbers, dtype=float).reshape(-1, 6).T
        found: dict[int, str] = {}
        self._loads(load, normal, found)
        self._speeds(speed, slope, found)
        self._copies(found)
        # inverse of equation (1): a = atan(F_px / F_py) - atan(mu)
        self._angles(np.arctan(peak / normal) - np.arctan(friction), found)
        return found

    def _loads(self, load: Array, normal: Array, found: dict[int, str]) -> None:
        def told(index: int) -> str:
            return f"the normal force is {normal[index]:.3g} N, the load of this row is {load[index]:.3g} N"

        ratio = normal / load
        usual = _median(ratio)
        for index, wrong in _outliers(ratio, usual, _LOAD_FACTOR):
            found.setdefault(self.rows[index], f"{wrong}: {told(index)}")
        if _off(np.array([usual]), 1.0, _WILD_FACTOR)[0]:
            found |= {
                self.rows[index]: f"units: {told(index)}" for index in np.flatnonzero(np.isfinite(ratio)).tolist()
            }

    def _speeds(self, speed: Array, slope: Array, found: dict[int, str]) -> None:
        ratio = slope / speed
        usual = _median(ratio)
        for index, wrong in _outliers(ratio, usual, _SLOPE_FACTOR):
            found.setdefault(
                self.rows[index],
                f"{wrong}: the ramp of {slope[index]:.3g} N/s means {slope[index] / usual * 1e3:.3g} mm/s, "
                f"the speed of this row is {speed[index] * 1e3:.3g} mm/s",
            )

    def _copies(self, found: dict[int, str]) -> None:
        clean = np.array([i for i in np.argsort(self.rows, kind="stable") if self.rows[i] not in found], dtype=np.intp)
        digests = np.array(self.digests, dtype=np.uint64)[clean]
        _, first, which = np.unique(digests, return_index=True, return_inverse=True)
        for copy in np.flatnonzero(first[which] != np.arange(len(clean))):
            index, earlier = clean[copy], clean[first[which[copy]]]
            for one, other in ((index, earlier), (earlier, index)):
                found[self.rows[one]] = f"duplicate: the same samples stand for row {self.rows[other]}"

    def _angles(self, angle: Array, found: dict[int, str]) -> None:
        """Compare sin(a/2), which is sqrt(H / 2R) by equation (2), of each trial with the blocks.

        Only a trace that fits another block goes.
        """
        size, block = np.sin(0.5 * angle), np.array(self.blocks)
        known = np.isfinite(size) & ~np.isin(self.rows, list(found))
        groups = {int(name): size[known & (block == name)] for name in np.unique(block)}
        groups = {name: sizes for name, sizes in groups.items() if sizes.size >= _FEWEST}
        if len(groups) < 2:
            return
        medians = {name: float(np.median(sizes)) for name, sizes in groups.items()}
        deviations = [np.abs(sizes - medians[name]) / 0.6745 for name, sizes in groups.items()]
        spread = float(np.median(np.concatenate(deviations)))
        labels = {number: name for name, number in self.names.items()}
        for index in np.flatnonzero(known):
            own = int(block[index])
            if own not in medians:
                continue
            miss = abs(size[index] - medians[own])
            nearest = min(medians, key=lambda name: abs(medians[name] - size[index]))
            fits = abs(size[index] - medians[nearest]) < 0.25 * miss
            if nearest != own and fits and miss > max(_ANGLE_SIGMAS * spread, _ANGLE_SHARE * medians[own]):
                found.setdefault(
                    self.rows[index],
                    f"mislabelled: the forces are those of block {labels[nearest]}, the row says {labels[own]}",
                )


def _median(ratio: Array) -> float:
    finite = ratio[np.isfinite(ratio)]
    return float(np.median(finite)) if finite.size else math.nan


def _outliers(ratio: Array, usual: float, factor: float) -> list[tuple[int, str]]:
    """Trials whose ratio is not the usual one, each with what may be wrong."""
    units = _off(ratio, usual, _UNIT_FACTOR)
    wrong = np.flatnonzero(_off(ratio, usual, factor)).tolist()
    return [(index, "units changed or mislabelled" if units[index] else "mislabelled") for index in wrong]


def _off(ratio: Array, usual: float, factor: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.isfinite(ratio) & ((ratio > usual * factor) | (ratio < usual / factor))
