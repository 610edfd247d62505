"""Compare each trace with its row.

A trial that contradicts its session is flagged; a group that does so is data.
"""

import itertools
import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.signal import Array
from stepblocks.bench.trials import Trial

_LOAD_FACTOR = 1.25  # measured over declared load, against the median of the session
_SLOPE_FACTOR = 1.5  # ramp over speed, against the median of the session
_WILD_FACTOR = 3.0  # the session as a whole: more than this is a matter of units
_UNIT_FACTOR = 100.0  # one trial: more than this may be a matter of units
_ANGLE_SIGMAS = 8.0
_ANGLE_SHARE = 0.12  # least relative deviation of the sine of half the angle
_EXCHANGED = 1.15  # within which a record fits the row of another
_FEWEST = 5  # trials of a block, to know its angle
_FEATURES = ("normal_load_n", "loading_slope_n_per_s", "peak_force_n", "sliding_friction")
_FEW = 3  # trials under a load, to know its usual force
_MOST_LEVELS = 12  # of a column whose trials may have something in common
_RUN = 4  # trials that fail together
_TOGETHER = 0.5  # share of a group


@dataclass
class LabelCheck:
    """Collects 80 bytes per trial and names the trials whose trace belongs elsewhere.

    Attributes
    ----------
    labels : array[int]
        Row, block and digest of each trial.
    numbers : array[float]
        Load, speed and `_FEATURES` of each trial, SI.
    names : dict[str, int]
        Number of each block.
    trials : list[str]
        Name of each trial.
    """

    labels: "array[int]" = field(default_factory=lambda: array("Q"))
    numbers: "array[float]" = field(default_factory=lambda: array("d"))
    names: dict[str, int] = field(default_factory=dict)
    trials: list[str] = field(default_factory=list)

    def add(self, trial: Trial, features: dict[str, float], digest: int) -> None:
        """Take note of one measured trial; `digest` identifies the samples of its trace."""
        self.trials.append(trial.name)
        self.labels.extend((trial.row, self.names.setdefault(trial.block, len(self.names)), digest))
        self.numbers.extend(
            (trial.load, trial.speed, *(features.get(name, math.nan) for name in _FEATURES))
        )

    def faults(self) -> dict[int, str]:
        """Reasons by row, for every trial whose trace belongs elsewhere."""
        rows, blocks, digests = np.array(self.labels, dtype=np.uint64).reshape(-1, 3).T
        load, speed, normal, slope, peak, friction = (
            np.array(self.numbers, dtype=float).reshape(-1, 6).T
        )
        found: dict[int, str] = {}

        def add_faults(ratio: Array, factor: float, describe: Callable[[int, float], str]) -> None:
            finite = ratio[np.isfinite(ratio)]
            usual = float(np.median(finite)) if finite.size else math.nan
            units = _is_off(ratio, usual, _UNIT_FACTOR)
            for index in np.flatnonzero(_is_off(ratio, usual, factor)).tolist():
                wrong = "units changed or mislabelled" if units[index] else "mislabelled"
                found.setdefault(int(rows[index]), f"{wrong}: {describe(index, usual)}")

        def describe_load(i: int, _: float) -> str:
            return f"the normal force is {normal[i]:.3g} N, the load of this row is {load[i]:.3g} N"

        # a zero or a gain of the gauge shifts all trials along one line, and is no matter of labels
        add_faults(normal / fit_load_line(load, normal)(load), _LOAD_FACTOR, describe_load)
        known = np.flatnonzero(np.isfinite(normal / load))
        usual = np.median((normal / load)[known]) if known.size else math.nan
        if _is_off(np.array([usual]), 1.0, _WILD_FACTOR)[0]:
            found |= {int(rows[i]): f"units: {describe_load(i, usual)}" for i in known.tolist()}
        add_faults(
            slope / speed,
            _SLOPE_FACTOR,
            lambda i, usual: (
                f"the ramp of {slope[i]:.3g} N/s means {slope[i] / usual * 1e3:.3g} mm/s, the "
                f"speed of this row is {speed[i] * 1e3:.3g} mm/s"
            ),
        )
        clean = np.array(
            [i for i in np.argsort(rows, kind="stable") if rows[i] not in found], dtype=np.intp
        )
        _, first, which = np.unique(digests[clean], return_index=True, return_inverse=True)
        for copy in np.flatnonzero(first[which] != np.arange(len(clean))):
            pair = int(rows[clean[copy]]), int(rows[clean[first[which[copy]]]])
            for one, other in (pair, pair[::-1]):
                found[one] = f"duplicate: the same samples stand for row {other}"
        # inverse of equation (1): a = atan(F_px / F_py) - atan(mu)
        angle = np.where(
            np.isin(rows, list(found)), math.nan, np.arctan(peak / normal) - np.arctan(friction)
        )
        names = list(self.names)
        for index, other in _find_other_blocks(angle, blocks).items():
            found.setdefault(
                int(rows[index]),
                (
                    f"mislabelled: the forces are those of block {names[other]}, the row says "
                    f"{names[int(blocks[index])]}"
                ),
            )
        # two rows that contradict their records and would not after an exchange
        ratios = (slope / speed)[np.isfinite(slope / speed)]
        usual = float(np.median(ratios)) if ratios.size else math.nan
        place = {int(row): i for i, row in enumerate(rows)}
        wrong = [row for row, reason in found.items() if reason.endswith(("mm/s", "N"))]
        for couple in itertools.combinations(wrong, 2):
            at = np.array([place[row] for row in couple])
            ramps, loads = slope[at] / usual / speed[at[::-1]], normal[at] / load[at[::-1]]
            if not np.any(_is_off(ramps, 1.0, _EXCHANGED) | _is_off(loads, 1.0, _EXCHANGED)):
                both = ", ".join(self.trials[i] for i in at)
                for row in couple:
                    found[row] += (
                        f"; exchanged rows? in [trials] of session.toml `swap = [[{both}]]` makes "
                        f"load and ramp agree, `exclude = [{both}]` leaves both out"
                    )
        return found


def fit_load_line(load: Array, normal: Array) -> Callable[[Array], Array]:
    """Return the line of the normal forces of a session against their loads.

    A minority of wrong rows does not move it.
    """
    from scipy.stats import theilslopes

    known = np.isfinite(load) & np.isfinite(normal)
    load, normal = load[known], normal[known]
    levels, counts = np.unique(load, return_counts=True)
    levels = levels[counts >= _FEW]
    if levels.size > _MOST_LEVELS:
        levels = np.quantile(load, np.linspace(0.0, 1.0, _MOST_LEVELS))
    if levels.size < 3:
        gain = float(np.median(normal / load)) if known.any() else 1.0
        return lambda at: gain * at
    nearest = np.abs(load[:, None] - levels).argmin(axis=1)
    middles = [
        (np.median(load[nearest == i]), np.median(normal[nearest == i])) for i in range(levels.size)
    ]
    gain, zero = theilslopes(*np.array(middles).T[::-1])[:2]
    return lambda at: np.maximum(zero + gain * at, 0.2 * gain * at)


def find_shared_faults(
    rows: Iterable[tuple[int, Mapping[str, str]]], faults: Mapping[int, str]
) -> dict[int, str]:
    """Find rows whose faults are shared by their like, and what these have in common.

    Such rows are data.
    """
    # `rows` are the measured ones with their cells. Like are trials that share a label or two, or
    # that follow one another.
    flagged = {row for row, reason in faults.items() if reason.startswith("mislabelled")}
    counts: Counter[tuple[tuple[str, str], ...]] = Counter()
    failing = counts.copy()
    levels: dict[str, set[str]] = {}
    cells: dict[int, dict[str, str]] = {}
    run: list[int] = []
    found: dict[int, str] = {}
    for row, named in rows:
        for name, value in named.items():
            levels.setdefault(name, set()).add(value)
        if row in flagged:
            cells[row] = dict(named)
            run.append(row)
        else:
            run = []
        if len(run) >= _RUN:
            found |= dict.fromkeys(run, f"trials of the rows {run[0]} to {run[-1]}")
        usable = sorted(name for name in named if len(levels[name]) <= _MOST_LEVELS)
        for size in (1, 2):
            shared_by = [
                tuple((name, named[name]) for name in names)
                for names in itertools.combinations(usable, size)
            ]
            counts.update(shared_by)
            failing.update(shared_by if row in flagged else ())
    for labels in sorted(
        counts, key=lambda labels: (-failing[labels] / counts[labels], len(labels))
    ):
        apart = all(1 < len(levels[name]) <= _MOST_LEVELS for name, _ in labels)
        if apart and failing[labels] >= max(_RUN, _TOGETHER * counts[labels]):
            shared = ", ".join(f"{name} {value}" for name, value in labels)
            like = {row for row, own in cells.items() if own.items() >= set(labels)}
            found |= dict.fromkeys(like - found.keys(), f"trials of {shared}")
    return found


def _find_other_blocks(angle: Array, block: NDArray[np.uint64]) -> dict[int, int]:
    # Find trials whose angle fits another block and not their own.
    size = np.sin(0.5 * angle)
    known = np.isfinite(size)
    names, counts = np.unique(block[known], return_counts=True)
    names = names[counts >= _FEWEST]
    if len(names) < 2:
        return {}
    medians = np.array([np.median(size[known & (block == name)]) for name in names])
    rows = np.flatnonzero(known & np.isin(block, names))
    own = medians[np.searchsorted(names, block[rows])]
    miss = np.abs(size[rows] - own)
    spread = float(np.median(miss / 0.6745))
    apart = np.abs(size[rows, None] - medians)
    nearest = names[apart.argmin(axis=1)]
    other = (
        (nearest != block[rows])
        & (apart.min(axis=1) < 0.25 * miss)
        & (miss > np.maximum(_ANGLE_SIGMAS * spread, _ANGLE_SHARE * own))
    )
    return dict(zip(rows[other].tolist(), map(int, nearest[other]), strict=True))


def _is_off(ratio: Array, usual: float, factor: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.isfinite(ratio) & ((ratio > usual * factor) | (ratio < usual / factor))
