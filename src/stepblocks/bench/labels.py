"""Compare each trace with its row.

A trial that contradicts its session is flagged; a group that does so is data.
"""

import itertools
import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.bench.faults import Evidence, FaultKind, LabelFault, TrialFault
from stepblocks.bench.signal import Array
from stepblocks.bench.trials import Trial

_LOAD_FACTOR = 1.25  # measured over declared load, against the median of the session
_SLOPE_FACTOR = 1.5  # ramp over speed, against the median of the session
_WILD_FACTOR = 3.0  # the session as a whole: more than this is a matter of units
_UNIT_FACTOR = 100.0  # one trial: more than this may be a matter of units
_ANGLE_SIGMAS = 8.0
_ANGLE_SHARE = 0.12  # least relative deviation of the sine of half the angle
_CLOSE_SHARE = 0.25  # of the deviation from the own block, within which another block fits
_SIGMA_PER_MEDIAN = 0.6745  # median of the absolute deviation of normal noise, in sigmas
_EXCHANGED = 1.15  # within which a record fits the row of another
_FEWEST = 5  # trials of a block, to know its angle
_FEATURES = ("normal_load_n", "loading_slope_n_per_s", "peak_force_n", "sliding_friction")
_FEW = 3  # trials under a load, to know its usual force
_FEWEST_LEVELS = 3  # loads, to fit a line through their usual forces
_LEAST_GAIN = 0.2  # of the line through the origin, below which no load line falls
_MOST_LEVELS = 12  # of a column whose trials may have something in common
_RUN = 4  # trials that fail together
_TOGETHER = 0.5  # share of a group

SharedLabels = tuple[tuple[str, str], ...]  # columns of the table of trials, each with a value


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

    def add(self, trial: Trial, features: Mapping[str, float], digest: int) -> None:
        """Take note of one measured trial; `digest` identifies the samples of its trace."""
        block = self.names.setdefault(trial.block, len(self.names))
        self.trials.append(trial.name)
        self.labels.extend((trial.row, block, digest))
        self.numbers.extend((trial.load, trial.speed))
        self.numbers.extend(features.get(name, math.nan) for name in _FEATURES)

    def find_label_faults(self) -> dict[int, LabelFault]:
        """Find every trial whose trace belongs elsewhere; the result has its fault by its row."""
        trials = self._collect_trials()
        faults: dict[int, LabelFault] = {}
        _add_load_faults(trials, faults)
        _add_unit_faults(trials, faults)
        _add_ramp_faults(trials, faults)
        _add_duplicate_faults(trials, faults)
        _add_block_faults(trials, faults)
        _add_exchange_hints(trials, faults)
        return faults

    def _collect_trials(self) -> "_LabelledTrials":
        """Collect the noted trials as arrays, one array for each label and feature."""
        rows, blocks, digests = np.array(self.labels, dtype=np.uint64).reshape(-1, 3).T
        numbers = np.array(self.numbers, dtype=float).reshape(-1, 2 + len(_FEATURES)).T
        return _LabelledTrials(self.trials, rows, blocks, digests, list(self.names), *numbers)


@dataclass(frozen=True)
class _LabelledTrials:
    """Labels and measured figures of n trials, each of shape (n,) and in SI."""

    names: Sequence[str]
    rows: NDArray[np.uint64]
    blocks: NDArray[np.uint64]  # by their place in `block_names`
    digests: NDArray[np.uint64]
    block_names: Sequence[str]
    load: Array
    speed: Array
    normal: Array
    slope: Array
    peak: Array
    friction: Array

    def describe_load_contradiction(self, index: int) -> str:
        """Say that the normal force of a trial contradicts its load."""
        normal, load = self.normal[index], self.load[index]
        return f"the normal force is {normal:.3g} N, the load of this row is {load:.3g} N"

    def find_usual_stiffness(self) -> float:
        """Return the median of ramp over speed [N/m]; NaN where none is known."""
        ratios = self.slope / self.speed
        return _compute_median(ratios[np.isfinite(ratios)])


def _compute_median(values: Array) -> float:
    """Return the median, or NaN where there are no values."""
    if not values.size:
        return math.nan
    return float(np.median(values))


def _mark_deviating_ratios(ratios: Array, usual_ratio: float, factor: float) -> NDArray[np.bool_]:
    """Mark the finite ratios that differ from the usual one by more than a factor."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.isfinite(ratios) & (
            (ratios > usual_ratio * factor) | (ratios < usual_ratio / factor)
        )


def _add_ratio_faults(
    trials: _LabelledTrials,
    faults: dict[int, LabelFault],
    ratios: Array,
    largest_factor: float,
    evidence: Evidence,
    describe_contradiction: Callable[[int], str],
) -> None:
    """Note the trials whose ratio is off the median of the session by more than a factor."""
    usual = _compute_median(ratios[np.isfinite(ratios)])
    may_be_units = _mark_deviating_ratios(ratios, usual, _UNIT_FACTOR)
    for index in np.flatnonzero(_mark_deviating_ratios(ratios, usual, largest_factor)).tolist():
        kind = FaultKind.MISLABELLED
        if may_be_units[index]:
            kind = FaultKind.UNITS_CHANGED
        fault = LabelFault(kind, describe_contradiction(index), evidence=evidence)
        faults.setdefault(int(trials.rows[index]), fault)


def _add_load_faults(trials: _LabelledTrials, faults: dict[int, LabelFault]) -> None:
    """Note the trials whose normal force does not follow the load as that of the session does."""
    # a zero or a gain of the gauge shifts all trials along one line, and is no matter of labels
    usual_force = fit_normal_force_line(trials.load, trials.normal)
    ratio = trials.normal / usual_force(trials.load)
    _add_ratio_faults(
        trials, faults, ratio, _LOAD_FACTOR, Evidence.LOAD, trials.describe_load_contradiction
    )


def _add_unit_faults(trials: _LabelledTrials, faults: dict[int, LabelFault]) -> None:
    """Note all trials where the session as a whole has another unit of force than its table."""
    ratio = trials.normal / trials.load
    known = np.flatnonzero(np.isfinite(ratio))
    usual = _compute_median(ratio[known])
    if not _mark_deviating_ratios(np.array([usual]), 1.0, _WILD_FACTOR)[0]:
        return
    for index in known.tolist():
        details = trials.describe_load_contradiction(index)
        fault = LabelFault(FaultKind.WRONG_UNITS, details, evidence=Evidence.LOAD)
        faults[int(trials.rows[index])] = fault


def _add_ramp_faults(trials: _LabelledTrials, faults: dict[int, LabelFault]) -> None:
    """Note the trials whose ramp does not follow the speed as that of the session does."""
    usual = trials.find_usual_stiffness()

    def describe_ramp_contradiction(index: int) -> str:
        """Say that the ramp of a trial contradicts its speed."""
        slope = trials.slope[index]
        speed_of_ramp = slope / usual * 1e3
        speed_of_row = trials.speed[index] * 1e3
        return (
            f"the ramp of {slope:.3g} N/s means {speed_of_ramp:.3g} mm/s, the speed of this row "
            f"is {speed_of_row:.3g} mm/s"
        )

    ratio = trials.slope / trials.speed
    _add_ratio_faults(
        trials, faults, ratio, _SLOPE_FACTOR, Evidence.RAMP, describe_ramp_contradiction
    )


def _add_duplicate_faults(trials: _LabelledTrials, faults: dict[int, LabelFault]) -> None:
    """Note the trials without another fault whose samples stand for two rows."""
    first_rows: dict[int, int] = {}  # first row of each digest
    for index in np.argsort(trials.rows, kind="stable"):
        row = int(trials.rows[index])
        if row in faults:
            continue
        first = first_rows.setdefault(int(trials.digests[index]), row)
        if first != row:
            faults[row] = _make_duplicate_fault(first)
            faults[first] = _make_duplicate_fault(row)


def _make_duplicate_fault(row: int) -> LabelFault:
    """Make the fault of a trial whose samples also stand for `row`."""
    details = f"the same samples stand for row {row}"
    return LabelFault(FaultKind.DUPLICATE, details, evidence=Evidence.SAMPLES)


def _add_block_faults(trials: _LabelledTrials, faults: dict[int, LabelFault]) -> None:
    """Note the trials without another fault whose critical angle is that of another block."""
    # inverse of equation (1): a = atan(F_px / F_py) - atan(mu)
    angle = np.arctan(trials.peak / trials.normal) - np.arctan(trials.friction)
    faulty = np.isin(trials.rows, list(faults))
    angle = np.where(faulty, math.nan, angle)
    for index, block in _find_blocks_with_same_angle(angle, trials.blocks).items():
        measured = trials.block_names[block]
        declared = trials.block_names[int(trials.blocks[index])]
        details = f"the forces are those of block {measured}, the row says {declared}"
        fault = LabelFault(FaultKind.MISLABELLED, details, evidence=Evidence.BLOCK)
        faults.setdefault(int(trials.rows[index]), fault)


def _find_blocks_with_same_angle(
    critical_angles: Array, block_numbers: NDArray[np.uint64]
) -> dict[int, int]:
    """Find trials whose angle fits another block better than their own, and that block.

    Angles [rad] and blocks have shape (n,); the result has the other block by the trial's index.
    """
    size = np.sin(0.5 * critical_angles)
    known = np.isfinite(size)
    names, counts = np.unique(block_numbers[known], return_counts=True)
    names = names[counts >= _FEWEST]
    if len(names) < 2:
        return {}
    medians = np.array([np.median(size[known & (block_numbers == name)]) for name in names])
    trials = np.flatnonzero(known & np.isin(block_numbers, names))
    of_own_block = medians[np.searchsorted(names, block_numbers[trials])]
    miss = np.abs(size[trials] - of_own_block)
    spread = float(np.median(miss / _SIGMA_PER_MEDIAN))
    distances = np.abs(size[trials, None] - medians)
    nearest = names[distances.argmin(axis=1)]
    is_elsewhere = nearest != block_numbers[trials]
    fits_elsewhere = distances.min(axis=1) < _CLOSE_SHARE * miss
    least_miss = np.maximum(_ANGLE_SIGMAS * spread, _ANGLE_SHARE * of_own_block)
    wrong = is_elsewhere & fits_elsewhere & (miss > least_miss)
    indices = trials[wrong].tolist()
    return dict(zip(indices, map(int, nearest[wrong]), strict=True))


def _add_exchange_hints(trials: _LabelledTrials, faults: dict[int, LabelFault]) -> None:
    """Add to the faults of two rows that an exchange of their records would agree with both."""
    usual = trials.find_usual_stiffness()
    places = {int(row): index for index, row in enumerate(trials.rows)}
    contradicting = []
    for row, fault in faults.items():
        if fault.evidence in (Evidence.LOAD, Evidence.RAMP):
            contradicting.append(row)
    for couple in itertools.combinations(contradicting, 2):
        pair = np.array([places[row] for row in couple])
        exchanged = pair[::-1]
        ramps = trials.slope[pair] / usual / trials.speed[exchanged]
        loads = trials.normal[pair] / trials.load[exchanged]
        disagrees = _mark_deviating_ratios(ramps, 1.0, _EXCHANGED) | _mark_deviating_ratios(
            loads, 1.0, _EXCHANGED
        )
        if np.any(disagrees):
            continue
        names = ", ".join(trials.names[index] for index in pair)
        hint = (
            f"; exchanged rows? in [trials] of session.toml `swap = [[{names}]]` makes load and "
            f"ramp agree, `exclude = [{names}]` leaves both out"
        )
        for row in couple:
            fault = faults[row]
            faults[row] = replace(fault, details=fault.details + hint)


def fit_normal_force_line(loads: Array, normal_forces: Array) -> Callable[[Array], Array]:
    """Fit the normal forces of a session against their loads by a line.

    A minority of wrong rows does not move it.

    Parameters
    ----------
    loads, normal_forces : Array
        Shape (n,), declared load and measured normal force [N]; NaN where unknown.

    Returns
    -------
    callable
        From loads to usual normal forces [N].
    """
    from scipy.stats import theilslopes

    known = np.isfinite(loads) & np.isfinite(normal_forces)
    loads, normal_forces = loads[known], normal_forces[known]
    levels, counts = np.unique(loads, return_counts=True)
    levels = levels[counts >= _FEW]
    if levels.size > _MOST_LEVELS:
        levels = np.quantile(loads, np.linspace(0.0, 1.0, _MOST_LEVELS))
    if levels.size < _FEWEST_LEVELS:
        usual_gain = 1.0
        if known.any():
            usual_gain = float(np.median(normal_forces / loads))
        return lambda loads: usual_gain * loads
    nearest = np.abs(loads[:, None] - levels).argmin(axis=1)
    usual_loads, usual_forces = [], []
    for level in range(levels.size):
        usual_loads.append(np.median(loads[nearest == level]))
        usual_forces.append(np.median(normal_forces[nearest == level]))
    line = theilslopes(np.array(usual_forces), np.array(usual_loads))
    gain, zero = line.slope, line.intercept
    return lambda loads: np.maximum(zero + gain * loads, _LEAST_GAIN * gain * loads)


def find_shared_label_faults(
    conditions_by_row: Iterable[tuple[int, Mapping[str, str]]], faults: Mapping[int, TrialFault]
) -> dict[int, str]:
    """Find mislabelled trials that share a label or two, or follow one another.

    What so many trials have in common is no slip of a label: such trials are data.

    Parameters
    ----------
    conditions_by_row : iterable of (int, mapping)
        Row of each measured trial, and its cells by their columns.
    faults : mapping of int to TrialFault
        Faults by row.

    Returns
    -------
    dict of int to str
        Rows that are data, each with the name of its group, such as ``trials of operator B``.
    """
    groups = _TrialGroups()
    for row, cells in conditions_by_row:
        fault = faults.get(row)
        is_flagged = fault is not None and fault.kind is FaultKind.MISLABELLED
        groups.add(row, cells, is_flagged=is_flagged)
    return groups.find_flagged_groups()


class _TrialGroups:
    """Counts trials, and flagged ones among them, by the labels that they share."""

    def __init__(self) -> None:
        self._counts: Counter[SharedLabels] = Counter()
        self._flagged_counts: Counter[SharedLabels] = Counter()
        self._levels: dict[str, set[str]] = {}  # values of each column
        self._flagged_cells: dict[int, dict[str, str]] = {}
        self._run: list[int] = []  # flagged rows that followed one another up to now
        self._shared: dict[int, str] = {}

    def add(self, row: int, cells: Mapping[str, str], *, is_flagged: bool) -> None:
        """Count one trial; trials come in the order of the table."""
        for name, value in cells.items():
            self._levels.setdefault(name, set()).add(value)
        self._update_flagged_run(row, is_flagged=is_flagged)
        labels = self._list_labels_and_pairs(cells)
        self._counts.update(labels)
        if is_flagged:
            self._flagged_cells[row] = dict(cells)
            self._flagged_counts.update(labels)

    def _update_flagged_run(self, row: int, *, is_flagged: bool) -> None:
        """Note the flagged trials that follow one another without a sound one between."""
        if not is_flagged:
            self._run = []
            return
        self._run.append(row)
        if len(self._run) >= _RUN:
            name = f"trials of the rows {self._run[0]} to {self._run[-1]}"
            self._shared |= dict.fromkeys(self._run, name)

    def _list_labels_and_pairs(self, cells: Mapping[str, str]) -> list[SharedLabels]:
        """List the labels of a trial, and the pairs of them, that others may share."""
        usable = sorted(name for name in cells if len(self._levels[name]) <= _MOST_LEVELS)
        labels: list[SharedLabels] = [((name, cells[name]),) for name in usable]
        for first, second in itertools.combinations(usable, 2):
            labels.append(((first, cells[first]), (second, cells[second])))
        return labels

    def find_flagged_groups(self) -> dict[int, str]:
        """Find the flagged rows whose group is mostly flagged; the most flagged names them."""

        def make_sort_key(labels: SharedLabels) -> tuple[float, int]:
            """Return a key that is least for the largest flagged share and the fewest labels."""
            return -self._flagged_counts[labels] / self._counts[labels], len(labels)

        shared = dict(self._shared)
        for labels in sorted(self._counts, key=make_sort_key):
            if not self._is_mostly_flagged(labels):
                continue
            name = "trials of " + ", ".join(f"{column} {value}" for column, value in labels)
            for row, cells in self._flagged_cells.items():
                if cells.items() >= set(labels):
                    shared.setdefault(row, name)
        return shared

    def _is_mostly_flagged(self, labels: SharedLabels) -> bool:
        """Tell whether most trials of a group are flagged, and its labels take several levels."""
        for name, _ in labels:
            if not 1 < len(self._levels[name]) <= _MOST_LEVELS:
                return False
        least = max(_RUN, _TOGETHER * self._counts[labels])
        return self._flagged_counts[labels] >= least
