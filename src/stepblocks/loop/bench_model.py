"""The model of a session in the form that the search takes.

It has channels, constants, effects and common errors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.operating_point import Tool
from stepblocks.lawsearch.forward_model import Floats, Systematic, Trials
from stepblocks.lawsearch.law import ActiveEffects, ActiveEffectsAtPoints, Law, Parameter
from stepblocks.rig import forward
from stepblocks.rig.effects.gauges import apply_instrument_constants
from stepblocks.rig.effects.geometry import make_exchange_law
from stepblocks.rig.effects.grammar.compose import list_composed_laws
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.forward import PEAK_FORCE, SPEED_OVER_LOAD, TOGETHER, BenchDesign
from stepblocks.rig.state import CHANNELS, DragState, compute_shown_channels

# errors common to many trials that the evaluation of traces may leave in each channel, as one
# standard deviation per unit of covariate. Records of known truth show a tenth of most
# (`benchmarks/trace_bias.py slopes`), but with so little for ramps the speed passed for a law of
# them in a session of another bench.
COMMON_ERRORS = {
    "ln_energy": 0.008,
    "ln_peak_force": 0.003,
    "sliding_friction": 0.001,
    "spring_constant": 0.006,
    "ln_ring_frequency": 0.002,
    "ln_decay_time": 0.03,
    "normal_load_ratio": 0.002,
}
# deviations of a covariate by which the middle of such errors may differ, in channels that no
# constant of the model levels
_MIDDLE_SHIFTS = {"ln_peak_force": 0.2, "sliding_friction": 0.2, "normal_load_ratio": 0.2}
# covariates that are set or computed; all others are readings of the surroundings
_SET = ("height_um", "load_n", "speed_mm_s", "run_order", PEAK_FORCE, SPEED_OVER_LOAD)
_MOST_READINGS = 3  # of the surroundings that are tried pair by pair
_RAMP = "spring_constant"  # the channel that is no logarithm
_RAMP_COLUMNS = 5  # powers of the logarithm of the peak force over which it is smoothed
_LEAST_PER_COLUMN = 2  # trials
_LEAST_SPREAD = 1e-9  # of a logarithm, below which all its values are equal
_MOST_LABELS = 8  # of a covariate that is tried
# blocks of which any two may have exchanged their labels, by how much they must differ [m], and how
# far from that the difference that is found may lie: a share of it, and three deviations of blocks
_MOST_EXCHANGED, _LEAST_EXCHANGED = 12, 2e-6
_SHARE_EXCHANGED, _REACH_EXCHANGED = 0.5, 4e-6
# numbers that may act under each label by itself, columns of labels, and their labels
_GROUPED = ("height_um", "load_n", "speed_mm_s", "run_order")
_MOST_GROUPINGS, _MOST_GROUPS = 2, 4
_WIDE_RANGE = 5.0  # ratio of the ends of a range from which it is divided by logarithms
_CLOSE_SHARE = 0.1  # of neighbouring readings that may be closer than is stated of a range
_FEW_SETTINGS = 20  # distinct values below which a range may be divided by logarithms
_FEWEST_PEAKS, _LEAST_PEAK_RANGE = 11, 1.001  # from which laws may follow the peak force
_TRIALS_PER_BLOCK = 6  # from which laws may differ by block
_SHARP = 1.5e-6  # m, radius below which an edge is sharp for all that a scan can show
# by which the criterion of rounded edges falls where scans show them: it decides among laws that
# explain the trials as well, and no more, since a stylus rounds an edge too
_SEEN_IN_SCANS = 8.0
# constants that each session has its own of, where several are explained together
OF_A_DAY = ("friction", "ln_conversion", "ln_ring_frequency", "ln_decay_time")


@lru_cache(maxsize=8)
def _build_cached_design(
    trials: Trials, spring_constant: float, laws: tuple[tuple[str, Any], ...]
) -> BenchDesign:
    """Build what was set on the bench, once for each table of trials."""
    known_laws = convert_laws_to_dicts(laws)
    return forward.build_bench_design(trials.block, trials.covariates, spring_constant, known_laws)


@lru_cache(maxsize=8)
def _repeat_trials(trials: Trials, repeat_count: int) -> Trials:
    """Repeat a table several times, one after the other."""
    return trials.take(np.tile(np.arange(len(trials)), repeat_count))


def _repeat_values_per_trial(
    point_values: Mapping[str, float | Floats], trial_count: int
) -> dict[str, float | Floats]:
    """Give each trial at every point the values of that point."""
    repeated: dict[str, float | Floats] = {}
    for name, value in point_values.items():
        repeated[name] = np.repeat(value, trial_count) if isinstance(value, np.ndarray) else value
    return repeated


def convert_laws_to_dicts(laws: tuple[tuple[str, Any], ...]) -> dict[str, dict[str, Any]]:
    """Turn the known laws of a model from pairs into numbers by the kind of the law."""
    return {kind: dict(numbers) for kind, numbers in laws}


@dataclass(frozen=True)
class SessionModel:
    """Forward model of a session.

    Attributes
    ----------
    tool : Tool
        The nominal spring, and the ring with which the fit begins.
    height_std : float
        Standard deviation of the heights of blocks that are not scanned [m].
    scanned : Mapping[str, tuple[float, float]] | None
        Block to height and standard uncertainty [m].
    scanned_radius : tuple[float, float] | None
        Mean radius of the edges from their scans, and its uncertainty [m].
    known : Mapping[str, tuple[float, float]]
        Constants of the gauges that are certified or tared, with their uncertainties.
    laws : tuple of pairs
        Laws of friction and contact that are known beforehand, by kind: of each its name under
        ``law``, and its numbers.
    own : Mapping[str, Mapping[str, float]]
        Of several sessions, named in the column ``session``: constants that are known in each.
    quantities : ClassVar
        What scatters among trials, by its slot.
    """

    tool: Tool
    height_std: float = 1e-6
    scanned: Mapping[str, tuple[float, float]] | None = None
    scanned_radius: tuple[float, float] | None = None
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    laws: tuple[tuple[str, Any], ...] = ()
    own: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    quantities: ClassVar = ("friction", "normal_load", "conversion")

    @property
    def known_gauge_constants(self) -> dict[str, float]:
        """Values of the constants of the gauges that are known."""
        return {name: value for name, (value, _) in self.known.items()}

    def order(self, trials: Trials) -> Floats:
        """Order in time, shape (n,): the run order where there is one, else that of the table."""
        run_order = None
        if "run_order" in trials.covariates:
            run_order = trials.numeric("run_order")
        if run_order is None:
            return np.arange(float(len(trials)))
        return run_order

    def cells(self, trials: Trials) -> list[tuple[object, ...]]:
        """Trials of one block, load and speed, under the same labels, are replicates."""
        labels = [name for name in trials.covariates if trials.numeric(name) is None]
        names = ("load_n", "speed_mm_s", *labels)
        columns = [trials.covariates[name].tolist() for name in names]
        return list(zip(trials.block.tolist(), *columns, strict=True))

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        """Constants of the nominal model and the height errors of the blocks of a table."""
        design = _build_cached_design(trials, self.tool.stiffness, self.laws)
        nominal = forward.list_fitted_constants(design, self.tool, self.height_std, self.scanned)
        constants = list(map(self._apply_certified_spring, nominal))
        constants += self._list_bench_constants()
        if not self.own:
            return tuple(constants)
        of_a_day, common = [], []
        for p in constants:
            if p.name not in OF_A_DAY:
                common.append(p)
                continue
            for session in self.own:
                of_a_day.append(replace(p, name=format_session_constant_name(p.name, session)))
        return (*of_a_day, *common)

    def _apply_certified_spring(self, parameter: Parameter) -> Parameter:
        """Give the stiffness constant the prior of its certificate, if there is one."""
        spring = self.known.get("spring_constant")
        if spring is None or parameter.name != "stiffness_ratio":
            return parameter
        stiffness, std = spring
        nominal = self.tool.stiffness
        return replace(parameter, start=stiffness / nominal, prior_std=std / nominal)

    def _list_bench_constants(self) -> list[Parameter]:
        """List the constants of damper, edges and weights beside those of the contact."""
        # whether the gauge sees what the tool's damper takes is unknown
        constants = [Parameter("damper_share", "1", 0.5, -1.0, 2.0, 0.1, 0.5)]
        if self.scanned_radius and self.scanned_radius[0] < _SHARP:
            radius, std = self.scanned_radius
            constants.append(Parameter("edge_radius", "m", radius, 0.0, 3.0 * _SHARP, 1e-7, std))
        load = self.known.get("load_bias_n")
        if load is not None:
            bias, std = load
            constants.append(Parameter("load_error", "N", bias, -0.25, 0.6, 1e-3, std))
        return constants

    def systematics(self, trials: Trials) -> list[Systematic]:
        """Errors that the evaluation of traces may share among trials.

        A constant, and along height, load, speed, a square and products of them.
        """
        design = _build_cached_design(trials, self.tool.stiffness, self.laws)
        height = _standardise_values(np.log(design.height))
        load = _standardise_values(np.log(design.load))
        speed = _standardise_values(np.log(design.speed))
        columns = (height, load, speed, height**2, height * load, load * speed, height * speed)
        ramp = _smooth_ramp_readings(trials)
        errors = []
        for channel in CHANNELS:
            if channel not in trials.channels:
                continue
            # about which middle the errors change is unknown, and it differs without some trials
            middle = np.full(len(trials), _MIDDLE_SHIFTS.get(channel, 0.0))
            for column in (*columns, middle):
                if np.any(column):
                    # a relative error; all channels but the ramp are logarithms
                    shown = column
                    if channel == _RAMP:
                        shown = column * ramp
                    errors.append(Systematic(channel, shown, COMMON_ERRORS[channel]))
        return errors

    def compute_state(
        self,
        trials: Trials,
        values: Mapping[str, float | Floats],
        effects: ActiveEffectsAtPoints = (),
    ) -> DragState:
        """Fill all slots, effects applied; of several sessions with the constants of each."""
        constants: dict[str, float | Floats] = {**self.known_gauge_constants}
        if self.own:
            sessions = trials.covariates["session"].tolist()
            values = {**values, **_expand_daily_values_to_trials(values, sessions)}
            constants = self._expand_constants_to_trials(constants, sessions)
        design = _build_cached_design(trials, self.tool.stiffness, self.laws)
        state = forward.build_extended_state(design, values, effects)
        if not constants:
            return state
        return apply_instrument_constants(state, None, constants)

    def _expand_constants_to_trials(
        self, constants: Mapping[str, float | Floats], sessions: Sequence[str]
    ) -> dict[str, float | Floats]:
        """Give each trial the constants of its session, and defaults where its session has none."""
        spread: dict[str, float | Floats] = {}
        for name, usual in constants.items():
            of_trials = [self.own[session].get(name, usual) for session in sessions]
            spread[name] = np.array(of_trials)
        return spread

    def candidates(self, trials: Trials) -> tuple[Law, ...]:
        """Return every effect that may be asked of a table, but for those that scans rule out."""
        radius = self.scanned_radius[0] if self.scanned_radius else None
        laws = list_candidate_laws(trials, list_covariate_ranges(trials), scanned_radius=radius)
        return tuple(map(self._limit_by_calibration, laws))

    def _limit_by_calibration(self, law: Law) -> Law:
        """Limit the constants of gauges and load by their calibrations.

        They are what is added to the known constants: a calibration says how much that may be.
        """
        if law.slot not in ("sensor", "normal_load"):
            return law
        parameters = []
        for p in law.parameters:
            if p.name in self.known:
                parameters.append(replace(p, prior_std=self.known[p.name][1]))
            else:
                parameters.append(p)
        return replace(law, parameters=tuple(parameters))

    def predict(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        """Predict all channels, shape (n, 7)."""
        return compute_shown_channels(self.compute_state(trials, values, effects))

    def predict_stack(
        self, trials: Trials, points: Mapping[str, Floats], effects: ActiveEffectsAtPoints = ()
    ) -> Floats:
        """Predict all channels at k points of the constants, shape (k, n, 7).

        The points are trials of one long table, since a trial shows its own state alone.
        """
        count = len(next(iter(points.values())))
        stacked = _repeat_trials(trials, count)
        values = _repeat_values_per_trial(points, len(trials))
        active = [(law, _repeat_values_per_trial(of_law, len(trials))) for law, of_law in effects]
        predicted = compute_shown_channels(self.compute_state(stacked, values, active))
        return predicted.reshape(count, len(trials), -1)

    def responses(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        """Change of the channels with what scatters from trial to trial, shape (n, 7, 3)."""
        return forward.compute_channel_responses(self.compute_state(trials, values, effects))


def _smooth_ramp_readings(trials: Trials) -> Floats:
    """Smooth the readings of the ramp over the peak force, shape (n,); 1 where there is none.

    A spring that hardens and a gauge that is not linear change the ramp with the force that it
    reaches. By each reading, an error in proportion would hold the noise of that reading, and what
    is left of a law beside it would be that noise again: an effect that no bench has.
    """
    smooth = np.ones(len(trials))
    if _RAMP not in trials.channels:
        return smooth
    ramp = trials.values[:, trials.channels.index(_RAMP)]
    known = np.isfinite(ramp)
    if not known.any():
        return smooth
    smooth[known] = np.median(ramp[known])
    if "ln_peak_force" not in trials.channels:
        return smooth
    force = trials.values[:, trials.channels.index("ln_peak_force")]
    is_whole = known & np.isfinite(force)
    if is_whole.sum() < _LEAST_PER_COLUMN * _RAMP_COLUMNS:
        return smooth
    powers = np.vander(force[is_whole] - force[is_whole].mean(), _RAMP_COLUMNS)
    smooth[is_whole] = powers @ np.linalg.lstsq(powers, ramp[is_whole], rcond=None)[0]
    return smooth


def format_session_constant_name(constant: str, session: str) -> str:
    """Return what a constant of one session among several is called."""
    return f"{constant}[{session}]"


def _expand_daily_values_to_trials(
    values_by_session_name: Mapping[str, float | Floats], sessions: Sequence[str]
) -> dict[str, float | Floats]:
    """Give each trial the constants of the day of its session."""
    session_names, session_of_trial = np.unique(sessions, return_inverse=True)
    trial_numbers = np.arange(len(sessions))
    spread: dict[str, float | Floats] = {}
    for name in OF_A_DAY:
        of_sessions = []
        for session in session_names.tolist():
            value = values_by_session_name[format_session_constant_name(name, session)]
            of_sessions.append(np.broadcast_to(value, len(sessions)))
        spread[name] = np.stack(of_sessions)[session_of_trial, trial_numbers]
    return spread


def _standardise_values(logarithms: Floats) -> Floats:
    """Scale numbers to mean 0 and deviation 1; equal ones to zeros."""
    spread = float(np.std(logarithms))
    # the mean of equal numbers may differ from them in the last bit
    if spread <= _LEAST_SPREAD:
        return np.zeros_like(logarithms)
    return np.asarray((logarithms - logarithms.mean()) / spread)


def list_covariate_ranges(trials: Trials) -> tuple[CovariateRange, ...]:
    """List the range of every covariate that varies, and of the quantities that laws may follow."""
    ranges = []
    for name in trials.covariates:
        of_column = _make_covariate_range(trials, name)
        if of_column is not None:
            ranges.append(of_column)
    peak_force = _make_peak_force_range(trials)
    if peak_force is not None:
        ranges.append(peak_force)
    varying = {where.name for where in ranges}
    if {"load_n", "speed_mm_s"} <= varying:
        ratio = np.unique(_compute_speed_over_load(trials))
        low, high = float(ratio[0]), float(ratio[-1])
        ranges.append(CovariateRange(SPEED_OVER_LOAD, low, high, True, distinct=len(ratio)))
    grouped = _build_grouped_ranges(ranges)
    ranges += _build_paired_ranges(ranges)
    ranges += grouped
    blocks = tuple(map(str, np.unique(trials.block)))
    if 2 < len(blocks) <= len(trials) / _TRIALS_PER_BLOCK:
        ranges.append(CovariateRange("block", labels=blocks, distinct=len(blocks)))
    return tuple(ranges)


def _make_covariate_range(trials: Trials, covariate: str) -> CovariateRange | None:
    """Find the range of one column; None where it does not vary or has too many labels."""
    labels = np.unique(trials.covariates[covariate])
    distinct = len(labels)
    if covariate == "tip_radius_um" or distinct < 2:
        return None
    numbers = trials.numeric(covariate)
    if numbers is None:
        if distinct > _MOST_LABELS:
            return None
        return CovariateRange(covariate, labels=tuple(map(str, labels)), distinct=distinct)
    low, high = float(numbers.min()), float(numbers.max())
    by_logarithm = low > 0.0 and high > _WIDE_RANGE * low and distinct < _FEW_SETTINGS
    closest = float(np.quantile(np.diff(labels.astype(np.float64)), _CLOSE_SHARE))
    return CovariateRange(covariate, low, high, by_logarithm, (), distinct, closest=closest)


def _make_peak_force_range(trials: Trials) -> CovariateRange | None:
    """Find the range of the measured peak forces [N]; None where they are few or all alike."""
    if "ln_peak_force" not in trials.channels:
        return None
    logarithm = trials.values[:, trials.channels.index("ln_peak_force")]
    force = np.exp(logarithm[np.isfinite(logarithm)])
    if force.size < _FEWEST_PEAKS or not force.max() > _LEAST_PEAK_RANGE * force.min():
        return None
    return CovariateRange(PEAK_FORCE, float(force.min()), float(force.max()), True)


def _build_paired_ranges(ranges: Sequence[CovariateRange]) -> list[CovariateRange]:
    """Pair the readings of the surroundings, which may act together."""
    readings = []
    for where in ranges:
        if not where.labels and where.distinct > 2 and where.name not in _SET:
            readings.append(where)
    pairs = []
    for first, second in combinations(readings[:_MOST_READINGS], 2):
        name = TOGETHER.join((first.name, second.name))
        pairs.append(CovariateRange(name, pair=(first, second)))
    return pairs


def _build_grouped_ranges(ranges: Sequence[CovariateRange]) -> list[CovariateRange]:
    """Let what is set, and the run, act under each label of a column by itself."""
    groups, numbers = [], []
    for where in ranges:
        if where.labels and len(where.labels) <= _MOST_GROUPS:
            groups.append(where)
        if where.name in _GROUPED and where.distinct > 2:
            numbers.append(where)
    grouped = []
    for labels in groups[:_MOST_GROUPINGS]:
        for number in numbers:
            name = TOGETHER.join((labels.name, number.name))
            grouped.append(CovariateRange(name, pair=(labels, number)))
    return grouped


def _compute_speed_over_load(trials: Trials) -> NDArray[np.generic]:
    """Divide speed by load, which a viscous film follows [mm/s/N]."""
    return np.asarray(np.divide(trials.covariates["speed_mm_s"], trials.covariates["load_n"]))


def get_covariate_column(trials: Trials, predicted: Floats, covariate: str) -> NDArray[np.generic]:
    """Return what an effect follows: a column of the table, or what the model computes.

    Parameters
    ----------
    trials : Trials
    predicted : Floats
        Shape (n, c), all channels.
    covariate : str
        Name of a column, or of a quantity of the model.
    """
    if covariate == PEAK_FORCE:
        return np.asarray(np.exp(predicted[:, trials.channels.index("ln_peak_force")]))
    if covariate == SPEED_OVER_LOAD:
        return _compute_speed_over_load(trials)
    return trials.covariates[covariate]


def _list_block_exchange_laws(trials: Trials, blocks: Sequence[str]) -> list[Law]:
    """List the exchanges of the labels of any two blocks, by what their heights differ."""
    if not 1 < len(blocks) <= _MOST_EXCHANGED or "height_um" not in trials.covariates:
        return []
    stated = np.asarray(trials.covariates["height_um"], dtype=np.float64) * 1e-6
    heights = {}
    for block in blocks:
        heights[block] = float(np.median(stated[trials.block == block]))
    laws = []
    for first, second in combinations(blocks, 2):
        difference = heights[second] - heights[first]
        if abs(difference) < _LEAST_EXCHANGED:
            continue
        law = make_exchange_law(first, second)
        (parameter,) = law.parameters
        reach = min(_SHARE_EXCHANGED * abs(difference), _REACH_EXCHANGED)
        low, high = difference - reach, difference + reach
        laws.append(replace(law, parameters=(replace(parameter, low=low, high=high),)))
    return laws


def list_candidate_laws(
    trials: Trials,
    ranges: Sequence[CovariateRange],
    include_ruled_out: bool = False,
    scanned_radius: float | None = None,
) -> tuple[Law, ...]:
    """List every effect that may be asked of a table: laws whose covariate varies, and smooths.

    Parameters
    ----------
    trials : Trials
    ranges : sequence of CovariateRange
        Of the covariates that vary.
    include_ruled_out : bool
        Whether effects are listed that constants imitate, or that scans rule out.
    scanned_radius : float, optional
        Mean radius of the scanned edges [m].
    """
    varying = {where.name for where in ranges} | {"none", "block"}
    sharp = scanned_radius is not None and scanned_radius < _SHARP
    # friction imitates a tilt exactly: a search would only find the rounding between the two
    by_scans = "edge_rounding" if sharp else "tip_radius_error"
    ruled_out = {"block_tilt", by_scans}
    laws = []
    blocks = np.unique(trials.block).tolist()
    exchanged = _list_block_exchange_laws(trials, blocks)
    for law in (*list_named_laws(blocks), *exchanged):
        if law.covariate not in varying or (law.id in ruled_out and not include_ruled_out):
            continue
        if scanned_radius and law.id == "edge_rounding":
            laws.append(replace(law, evidence=_SEEN_IN_SCANS))
        else:
            laws.append(law)
    return (*laws, *list_composed_laws(ranges))
