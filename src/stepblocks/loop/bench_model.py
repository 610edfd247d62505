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
from stepblocks.lawsearch.law import Active, Law, Parameter
from stepblocks.rig import forward
from stepblocks.rig.effects.gauges import apply_instrument_constants
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.effects.smooth import CovariateRange, list_smooth_laws
from stepblocks.rig.forward import PEAK_FORCE, SPEED_OVER_LOAD, TOGETHER, BenchDesign
from stepblocks.rig.state import CHANNELS, DragState, compute_channels

# what the evaluation of traces may leave as an error common to many trials, one deviation per unit
# of covariate; records of known truth show a tenth of most (`benchmarks/trace_bias.py slopes`), but
# with so little for ramps the speed passed for a law of them in a session of another bench
_COMMON = {
    "ln_energy": 0.008,
    "ln_peak_force": 0.003,
    "sliding_friction": 0.001,
    "spring_constant": 0.006,
    "ln_ring_frequency": 0.002,
    "ln_decay_time": 0.03,
    "normal_load_ratio": 0.002,
}

_SET = ("height_um", "load_n", "speed_mm_s", "run_order", PEAK_FORCE, SPEED_OVER_LOAD)
# deviations of a covariate, by which the middle of such errors may be another, of channels that no
# constant of the model levels
_MIDDLE = {"ln_peak_force": 0.2, "sliding_friction": 0.2, "normal_load_ratio": 0.2}
_INTERACTING = 3  # readings of the surroundings that are asked for pair by pair
_SHARP = 1.5e-6  # m, an edge that a scan shows to be no rounder
# of the criterion: rounded edges in the scans decide among laws that explain the trials as well,
# and no more, as a stylus rounds an edge too
_SEEN = 8.0
# constants that each session has its own of, where several are explained together
OF_A_DAY = ("friction", "ln_conversion", "ln_ring_frequency", "ln_decay_time")


@lru_cache(maxsize=4)
def _find_design(
    trials: Trials, spring_constant: float, laws: tuple[tuple[str, Any], ...]
) -> BenchDesign:
    return forward.build_bench_design(
        trials.block,
        trials.covariates,
        spring_constant,
        {kind: dict(numbers) for kind, numbers in laws},
    )


@dataclass(frozen=True)
class SessionModel:
    """Forward model of a session.

    Attributes
    ----------
    tool : Tool
        The nominal spring, and the ring with which the fit begins.
    height_std : float
        Of blocks that are not scanned [m].
    scanned : Mapping[str, tuple[float, float]] | None
        Block to height and standard uncertainty [m].
    scanned_radius : tuple[float, float] | None
        Of the edges from their scans: mean and uncertainty [m].
    known : Mapping[str, tuple[float, float]]
        Certified or tared.
    laws : tuple of pairs
        Laws of friction and contact that are known beforehand, by kind: of each its name under
        ``law``, and its numbers.
    own : Mapping[str, Mapping[str, float]]
        Of several sessions, named in the column ``session``: what is known in each.
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
    quantities: ClassVar = (
        "friction",
        "normal_load",
        "conversion",
    )

    def order(self, trials: Trials) -> Floats:
        """Order in time: the run order where it is given, else that of the table."""
        run_order = trials.numeric("run_order") if "run_order" in trials.covariates else None
        return np.arange(float(len(trials))) if run_order is None else run_order

    def cells(self, trials: Trials) -> list[tuple[object, ...]]:
        """Trials of one block, load and speed, under the same labels, are replicates."""
        labels = [n for n in trials.covariates if trials.numeric(n) is None]
        columns = (trials.covariates[name].tolist() for name in ("load_n", "speed_mm_s", *labels))
        return list(zip(trials.block.tolist(), *columns, strict=True))

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        """Constants of the nominal model and the height errors of the blocks of a table."""
        found = forward.list_constants(
            _find_design(trials, self.tool.stiffness, self.laws),
            self.tool,
            self.height_std,
            self.scanned,
        )
        if spring := self.known.get("spring_constant"):
            ratio, std = (one / self.tool.stiffness for one in spring)
            found = tuple(
                replace(p, start=ratio, prior_std=std) if p.name == "stiffness_ratio" else p
                for p in found
            )
        # whether the gauge sees what the tool's damper takes nobody knows
        own = [Parameter("damper_share", "1", 0.5, -1.0, 2.0, 0.1, 0.5)]
        if self.scanned_radius and self.scanned_radius[0] < _SHARP:
            own.append(
                Parameter(
                    "edge_radius",
                    "m",
                    self.scanned_radius[0],
                    0.0,
                    3.0 * _SHARP,
                    1e-7,
                    self.scanned_radius[1],
                )
            )
        if load := self.known.get("load_bias_n"):
            own.append(Parameter("load_error", "N", load[0], -0.25, 0.6, 1e-3, load[1]))
        days = [
            replace(one, name=f"{one.name}[{session}]")
            for one in found
            for session in self.own
            if one.name in OF_A_DAY
        ]
        return (*days, *(one for one in (*found, *own) if not days or one.name not in OF_A_DAY))

    def systematics(self, trials: Trials) -> list[Systematic]:
        """Errors that the evaluation of traces may share among trials.

        A constant, and along height, load, speed, a square and products of them.
        """
        design = _find_design(trials, self.tool.stiffness, self.laws)
        height, load, speed = (
            _standardise(np.log(column)) for column in (design.height, design.load, design.speed)
        )
        columns = (height, load, speed, height**2, height * load, load * speed, height * speed)
        # each is a share of what is evaluated, and the slope of the ramp alone is no logarithm;
        # about which middle they change nobody knows, and it is another without some of the trials
        return [
            Systematic(
                channel,
                column * np.nan_to_num(trials.values[:, trials.channels.index(channel)], nan=1.0)
                if channel == "spring_constant"
                else column,
                _COMMON[channel],
            )
            for channel in CHANNELS
            for column in (*columns, np.full(len(trials), _MIDDLE.get(channel, 0.0)))
            if channel in trials.channels and np.any(column)
        ]

    def state(
        self, trials: Trials, values: Mapping[str, float | Floats], effects: Active = ()
    ) -> DragState:
        """Fill all slots, effects applied; of several sessions with the constants of each."""
        constants: dict[str, float | Floats] = {name: one for name, (one, _) in self.known.items()}
        if self.own:
            days = trials.covariates["session"].tolist()
            values = {**values} | {
                name: np.array([values[f"{name}[{day}]"] for day in days]) for name in OF_A_DAY
            }
            constants = {
                name: np.array([self.own[day].get(name, usual) for day in days])
                for name, usual in constants.items()
            }
        state = forward.build_extended_state(
            _find_design(trials, self.tool.stiffness, self.laws), values, effects
        )
        return apply_instrument_constants(state, None, constants) if constants else state

    def candidates(self, trials: Trials) -> tuple[Law, ...]:
        """Return every effect that may be asked of a table.

        Knowing what the scans have ruled out.
        """
        # constants of gauges and load are what is added to the known ones: a calibration says how
        # much that may be
        open_to = {name: std for name, (_, std) in self.known.items()}

        return tuple(
            replace(
                law,
                parameters=tuple(
                    replace(p, prior_std=open_to.get(p.name, p.prior_std)) for p in law.parameters
                ),
            )
            if law.slot in ("sensor", "normal_load")
            else law
            for law in list_candidates(
                trials,
                list_covariate_ranges(trials),
                scanned_radius=self.scanned_radius and self.scanned_radius[0],
            )
        )

    def predict(self, trials: Trials, values: Mapping[str, float], effects: Active = ()) -> Floats:
        """Predict all channels."""
        return compute_channels(self.state(trials, values, effects))

    def responses(
        self, trials: Trials, values: Mapping[str, float], effects: Active = ()
    ) -> Floats:
        """Change of the channels with friction, load and conversion.

        These scatter from trial to trial.
        """
        return forward.compute_responses(self.state(trials, values, effects))


def _standardise(logarithm: Floats) -> Floats:
    spread = float(np.std(logarithm))
    # the mean of equal numbers may differ from them in the last bit
    return (
        np.asarray((logarithm - logarithm.mean()) / spread)
        if spread > 1e-9
        else np.zeros_like(logarithm)
    )


def list_covariate_ranges(trials: Trials) -> tuple[CovariateRange, ...]:
    """Return the range of every covariate that varies, and of the peak force."""
    found = []
    for name, column in trials.covariates.items():
        numbers = trials.numeric(name)
        distinct = len(np.unique(column))
        if name == "tip_radius_um" or distinct < 2:
            continue
        if numbers is not None:
            low, high = float(numbers.min()), float(numbers.max())
            found.append(
                CovariateRange(
                    name, low, high, low > 0.0 and high > 5.0 * low and distinct < 20, (), distinct
                )
            )
        elif distinct <= 8:
            found.append(
                CovariateRange(name, labels=tuple(map(str, np.unique(column))), distinct=distinct)
            )
    if "ln_peak_force" in trials.channels:
        force = trials.values[:, trials.channels.index("ln_peak_force")]
        force = np.exp(force[np.isfinite(force)])
        if force.size > 10 and force.max() > 1.001 * force.min():
            found.append(CovariateRange(PEAK_FORCE, float(force.min()), float(force.max()), True))
    if {"load_n", "speed_mm_s"} <= {place.name for place in found}:
        ratio = np.unique(np.divide(trials.covariates["speed_mm_s"], trials.covariates["load_n"]))
        found.append(
            CovariateRange(
                SPEED_OVER_LOAD, float(ratio[0]), float(ratio[-1]), True, distinct=len(ratio)
            )
        )
    climate = [
        place
        for place in found
        if not place.labels and place.distinct > 2 and place.name not in _SET
    ]
    found += [
        CovariateRange(TOGETHER.join((one.name, other.name)), pair=(one, other))
        for one, other in combinations(climate[:_INTERACTING], 2)
    ]
    blocks = tuple(str(block) for block in np.unique(trials.block))
    if 2 < len(blocks) <= len(trials) / 6:
        found.append(CovariateRange("block", labels=blocks, distinct=len(blocks)))
    return tuple(found)


def find_column(trials: Trials, predicted: Floats, covariate: str) -> NDArray[np.generic]:
    """Return what an effect follows: a column of the table, or what the model computes."""
    if covariate == PEAK_FORCE:
        return np.asarray(np.exp(predicted[:, trials.channels.index("ln_peak_force")]))
    if covariate == SPEED_OVER_LOAD:
        return np.asarray(np.divide(trials.covariates["speed_mm_s"], trials.covariates["load_n"]))
    return trials.covariates[covariate]


def list_candidates(
    trials: Trials,
    ranges: Sequence[CovariateRange],
    with_imitated: bool = False,
    scanned_radius: float | None = None,
) -> tuple[Law, ...]:
    """Return every effect that may be asked of a table.

    These are the laws whose covariate varies, and all smooths.
    """
    names = {place.name for place in ranges} | {"none", "block"}
    sharp = scanned_radius is not None and scanned_radius < _SHARP
    # friction imitates a tilt exactly; a search would only find the rounding between the two
    ruled_out = {"block_tilt", "edge_rounding" if sharp else "tip_radius_error"}
    laws = [
        # where edges are sharp their rounding is ruled out
        replace(law, evidence=_SEEN) if scanned_radius and law.id == "edge_rounding" else law
        for law in list_named_laws(np.unique(trials.block).tolist())
        if law.covariate in names
    ]
    return (
        *(law for law in laws if with_imitated or law.id not in ruled_out),
        *list_smooth_laws(ranges),
    )
