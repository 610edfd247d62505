"""Contact's model of a session in the shape that closure asks for: channels, constants, effects, common errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.effects.catalogue import named_laws, smooth_laws
from stepblocks.contact.effects.law import Law
from stepblocks.contact.effects.smooth import CovariateRange
from stepblocks.contact.forward import BenchDesign, constants, nominal_state
from stepblocks.contact.state import CHANNELS, DragState, observe
from stepblocks.loop.search.effect import Active, Effect, Parameter
from stepblocks.loop.search.trials import Systematic, Trials

Floats = NDArray[np.float64]

# The model quantities that an effect may follow like a column
PEAK_FORCE, LOADING_TIME = "peak_force_n", "loading_time_s"

_ORDER = {LOADING_TIME: 0, PEAK_FORCE: 2}  # what gives way under load does so before the peak is known

# what the evaluation of traces may leave as an error common to many trials, one deviation per unit of covariate;
# benchmarks of the features on synthetic traces show less
_COMMON = {
    "ln_energy": 0.008,
    "ln_peak_force": 0.003,
    "sliding_friction": 0.001,
    "spring_constant": 0.006,
    "ln_ring_frequency": 0.002,
    "ln_decay_time": 0.03,
    "normal_load_ratio": 0.002,
}


@dataclass(frozen=True)
class SessionModel:
    """Forward model of a session."""

    spring_constant: float  # Nominal spring constant [N/m]
    frequency: float  # Where the fit of the ring begins [Hz], [s]
    decay_time: float
    height_std: float = 1e-6  # Standard deviation of block heights [m]
    # Heights from scans: block to (height, standard uncertainty) [m]
    scanned: Mapping[str, tuple[float, float]] | None = None
    scanned_radius: float | None = None  # Mean radius of the edges from their scans [m]
    channels: tuple[str, ...] = CHANNELS
    _designs: dict[int, tuple[Trials, BenchDesign]] = field(default_factory=dict, repr=False, compare=False)

    def design(self, trials: Trials) -> BenchDesign:
        """Return the design of a table, converted to SI units once."""
        known = self._designs.get(id(trials))
        if known is not None and known[0] is trials:
            return known[1]
        columns = {name: trials.numeric(name) for name in ("height_um", "load_n", "speed_mm_s", "tip_radius_um")}
        arrays = {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}
        design = BenchDesign(
            block=trials.block,
            height=arrays["height_um"] * 1e-6,
            load=arrays["load_n"],
            speed=arrays["speed_mm_s"] * 1e-3,
            tip_radius=arrays["tip_radius_um"] * 1e-6,
            spring_constant=self.spring_constant,
        )
        self._designs.clear()
        self._designs[id(trials)] = (trials, design)
        return design

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        """Constants of the nominal model and the height errors of the blocks of a table."""
        found = constants(self.design(trials), self.frequency, self.decay_time, self.height_std, self.scanned)
        return tuple(Parameter(**vars(c)) for c in found)

    def systematics(self, trials: Trials) -> list[Systematic]:
        """Errors that the evaluation of traces may share among trials: along height, load, speed and their squares."""
        design = self.design(trials)
        columns = [_standard(np.log(design.height)), _standard(np.log(design.load)), _standard(np.log(design.speed))]
        columns += [columns[0] ** 2, columns[0] * columns[1], columns[1] * columns[2], columns[0] * columns[2]]
        return [
            Systematic(channel, column, _COMMON[channel])
            for channel in self.channels
            for column in columns
            if channel in trials.channels and np.any(column)
        ]

    def predict(self, trials: Trials, values: Mapping[str, float], effects: Sequence[Active] = ()) -> Floats:
        """Predict all channels."""
        return observe(self.state(trials, values, effects))

    def state(self, trials: Trials, values: Mapping[str, float], effects: Sequence[Active] = ()) -> DragState:
        """Fill all slots, effects applied; in the order in which they act."""
        state = nominal_state(self.design(trials), values)
        for effect, own in sorted(effects, key=lambda pair: _ORDER.get(pair[0].covariate, 1)):
            state = effect.apply(state, trials, own)
        return state

    def responses(self, trials: Trials, values: Mapping[str, float], effects: Sequence[Active] = ()) -> Floats:
        """Change of the channels with friction, load and conversion, which scatter from trial to trial."""
        state = self.state(trials, values, effects)
        base, step = observe(state), 1e-4
        weight = state.set_load + state.sensed_offset
        moved = (
            state.changed(friction=state.friction + step),
            state.changed(load=state.load * (1.0 + step), sensed_offset=state.sensed_offset + step * weight),
            state.changed(conversion=state.conversion * (1.0 + step)),
        )
        return np.stack([(observe(other) - base) / step for other in moved], axis=2)


def _standard(column: Floats) -> Floats:
    spread = float(np.std(column))
    return np.asarray((column - column.mean()) / spread) if spread > 0.0 else np.zeros_like(column)


def _column(trials: Trials, state: DragState, covariate: str) -> Any:
    if covariate == "none":
        return None
    if covariate == "block":
        return trials.block
    if covariate == PEAK_FORCE:
        return state.peak_force()
    if covariate == LOADING_TIME:
        return state.loading_time()
    return trials.covariates[covariate]


def effect_of(law: Law) -> Effect:
    """Bind a law of contact to the table of closure."""

    def apply(state: DragState, trials: Trials, values: Mapping[str, float]) -> DragState:
        return law.apply(state, _column(trials, state, law.covariate), values)

    return Effect(
        id=law.id,
        slot=law.slot,
        covariate=law.covariate,
        form=law.form,
        parameters=tuple(Parameter(**vars(c)) for c in law.parameters),
        amplitudes=law.amplitudes,
        apply=apply,
        shapes=law.shapes,
        named=law.named,
        rank=law.rank,
    )


def covariate_ranges(trials: Trials) -> tuple[CovariateRange, ...]:
    """Return the range of every covariate that varies, and of the peak force."""
    found = []
    for name, column in trials.covariates.items():
        if name == "tip_radius_um":
            continue
        numbers = trials.numeric(name)
        if numbers is None:
            labels = tuple(str(label) for label in np.unique(column))
            if 1 < len(labels) <= 8:
                found.append(CovariateRange(name, labels=labels, distinct=len(labels)))
            continue
        distinct = len(np.unique(numbers))
        if distinct > 1:
            low, high = float(numbers.min()), float(numbers.max())
            found.append(
                CovariateRange(name, low, high, low > 0.0 and high > 5.0 * low and distinct < 20, (), distinct)
            )
    if "ln_peak_force" in trials.channels:
        force = trials.values[:, trials.channels.index("ln_peak_force")]
        force = np.exp(force[np.isfinite(force)])
        if force.size > 10 and force.max() > 1.001 * force.min():
            found.append(CovariateRange(PEAK_FORCE, float(force.min()), float(force.max()), True))
    return tuple(found)


_SHARP = 1.5e-6
_BY_DEFINITION_SAME = frozenset({"block_tilt"})
# friction imitates a tilt exactly; a search would only find the rounding between the two


def candidates(
    trials: Trials, ranges: Sequence[CovariateRange], with_imitated: bool = False, scanned_radius: float | None = None
) -> tuple[Effect, ...]:
    """Return every effect that may be asked of a table: laws whose covariate varies, and all smooths."""
    names = {r.name for r in ranges} | {"none", "block", LOADING_TIME}
    blocks = [str(b) for b in np.unique(trials.block)]
    laws = [law for law in named_laws(blocks) if law.covariate in names]
    sharp = scanned_radius is not None and scanned_radius < _SHARP
    ruled_out = "edge_rounding" if sharp else "tip_radius_error"
    laws = [law for law in laws if with_imitated or law.id != ruled_out]
    if not with_imitated:
        laws = [law for law in laws if law.id not in _BY_DEFINITION_SAME]
    return tuple(effect_of(law) for law in (*laws, *smooth_laws(ranges)))
