"""The model of a session: equations (1) and (2), and the effects that were found missing.

It is evaluated for many trials at once.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.laws import FrictionLaw, build_declared_laws
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import ContactError, PipelineError
from stepblocks.lawsearch.law import ActiveEffectsAtPoints, Law, Parameter
from stepblocks.rig.state import DragState, Floats, compute_shown_channels, indent_contact

TOGETHER = " * "  # between the names of two covariates that act together
PEAK_FORCE = "peak_force_n"  # a quantity of the model that an effect may follow like a column
SPEED_OVER_LOAD = "speed_mm_s / load_n"  # of a viscous film: Hersey's number
_HEIGHT_REACH = 12.0  # standard uncertainties that the height of a block may be off
_MOST_OF_STEP = 0.8  # of its height that a step may be off: it stays a step
_HEIGHT_SCALE = 0.3e-6  # change of a height that matters [m]
_LEAST_HEIGHT_STD = 0.1e-6  # of any height [m]
_RESPONSE_STEP = 1e-4  # of a logarithm, by which a response is taken
_RADIUS_TOLERANCE = 0.01  # share by which a label may differ from the declared radius
_COLUMNS = ("height_um", "load_n", "speed_mm_s", "tip_radius_um")
_COMPUTED = ("none", "block", PEAK_FORCE, SPEED_OVER_LOAD)  # no columns of their own


class Indentation(NamedTuple):
    """How deep the edge indents the ball, a power of the force; arrays of shape (n,)."""

    depth: Floats  # at 1 N [m]
    power: Floats  # of the force across the edge [1]


@dataclass(frozen=True)
class BenchDesign:
    """What was set on the bench, in SI units; arrays of shape (n,)."""

    block: NDArray[np.str_]
    height: Floats  # nominal [m]
    load: Floats  # normal [N]
    speed: Floats  # of the handle [m/s]
    tip_radius: Floats  # m
    spring_constant: float  # nominal, of the probe [N/m]
    # what an effect may follow, as in trials.csv
    covariates: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    # of friction, whose size is fitted, and of the contact, by kind: known beforehand
    laws: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("height", "load", "speed", "tip_radius"):
            column = getattr(self, name)
            if not np.all(np.isfinite(column) & (column > 0.0)):
                raise ContactError(f"{name} of every trial must be positive and finite")
        if len(self.block) == 0:
            raise ContactError("block must name at least one trial")
        if not (np.isfinite(self.spring_constant) and self.spring_constant > 0.0):
            raise ContactError(
                f"spring_constant must be positive and finite, got {self.spring_constant:g} N/m"
            )

    @cached_property
    def block_membership(self) -> tuple[tuple[str, ...], NDArray[np.intp]]:
        """Names of the blocks' height errors, and which of them each trial has."""
        blocks, inverse = np.unique(self.block, return_inverse=True)
        names = tuple(map(make_height_error_name, blocks.tolist()))
        return names, inverse

    @cached_property
    def friction_shape(self) -> tuple[Floats, Floats]:
        """Coefficient of sliding over that at rest under 1 N; that at the release over sliding.

        Both are 1 without a law. The tip is at rest when it releases.
        """
        law = self.laws.get("friction") or FrictionLaw(lambda speed, load, place, time: 1.0)
        compute = np.vectorize(law.coefficient, otypes=[float])
        sliding = compute(self.speed, self.load, 0.0, 0.0)
        at_rest = compute(0.0, self.load, 0.0, 0.0)
        under_one_newton = law.coefficient(0.0, 1.0, 0.0, 0.0)
        return sliding / under_one_newton, at_rest / sliding

    @cached_property
    def indentation(self) -> Indentation | None:
        """Indentation by the declared contact law; None without one."""
        if "contact" not in self.laws:
            return None
        compute = np.vectorize(self.laws["contact"].power_law, otypes=[float, float])
        stiffness, power = compute(self.tip_radius)
        return Indentation(stiffness ** (-1.0 / power), 1.0 / power)


def build_bench_design(
    block: NDArray[np.str_],
    covariates: Mapping[str, NDArray[np.generic]],
    spring_constant: float,
    laws: Mapping[str, Mapping[str, Any]] | None = None,
) -> BenchDesign:
    """Convert the columns of trials.csv, and ``tip_radius_um``, to SI units.

    `laws` are known beforehand: each by name with its numbers, as `build_declared_laws` takes them.
    """
    columns = {}
    for name in _COLUMNS:
        columns[name] = np.asarray(covariates[name], dtype=np.float64)
    return BenchDesign(
        block,
        height=columns["height_um"] * 1e-6,
        load=columns["load_n"],
        speed=columns["speed_mm_s"] * 1e-3,
        tip_radius=columns["tip_radius_um"] * 1e-6,
        spring_constant=spring_constant,
        covariates=covariates,
        laws=build_declared_laws(laws or {}),
    )


def parse_tip_radius_um(tip_label: str, default_um: float) -> float:
    """Return the radius of a tip [um] from its label, such as ``tip-125``.

    `default_um` where the name has no number.
    """
    match = re.fullmatch(r"tip-(\d+(?:\.\d+)?)(?:um)?", str(tip_label).strip())
    if match is None:
        return default_um
    return float(match.group(1))


def read_tip_radii_um(
    tip_labels: Iterable[str], declared_um: float, place_in_message: str = ""
) -> NDArray[np.float64]:
    """Return the radii of tips [um] from their labels; refuse them if none is the declared one."""
    radii = np.array([parse_tip_radius_um(tip, declared_um) for tip in tip_labels])
    if radii.size and not np.isclose(radii, declared_um, rtol=_RADIUS_TOLERANCE).any():
        labels = ", ".join(f"{radius:g} um" for radius in np.unique(radii).tolist())
        raise PipelineError(
            f"tips of the table must agree with `probe.tip_radius`, {declared_um:g} um: their "
            f"labels say {labels}; correct either{place_in_message}"
        )
    return radii


def make_height_error_name(block: str) -> str:
    """Return the name of the height error of a block."""
    return f"height_error[{block}]"


def list_fitted_constants(
    design: BenchDesign,
    tool: Tool = PAPER.tool,
    height_std: float = 1e-6,
    scanned: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Parameter, ...]:
    """List the constants fitted to a session.

    Parameters
    ----------
    design : BenchDesign
        What was set on the bench.
    tool : Tool
        Whose ring and conversion the constants begin with.
    height_std : float
        Standard uncertainty of the height of a block that was not scanned [m].
    scanned : mapping of str to tuple of float, optional
        Height and standard uncertainty of scanned blocks [m].

    Returns
    -------
    tuple of Parameter
        Five constants of the bench, and the height error of each block.
    """
    ln_conversion = float(np.log(tool.conversion))
    ln_frequency = float(np.log(tool.frequency))
    ln_decay_time = float(np.log(tool.decay_time))
    constants = [
        Parameter("friction", "1", PAPER.friction, 0.005, 0.9, 0.02),
        Parameter("ln_conversion", "1", ln_conversion, -9.0, 4.0, 0.1),
        Parameter("stiffness_ratio", "1", 1.0, 0.2, 5.0, 0.02),
        Parameter("ln_ring_frequency", "ln Hz", ln_frequency, 3.0, 9.0, 0.01),
        Parameter("ln_decay_time", "ln s", ln_decay_time, -9.0, 1.0, 0.05),
    ]
    for block in np.unique(design.block).tolist():
        is_of_block = design.block == block
        nominal = float(design.height[is_of_block][0])
        height, spread = (scanned or {}).get(block, (nominal, height_std))
        reach = min(_HEIGHT_REACH * height_std, _MOST_OF_STEP * nominal)
        constants.append(_make_height_error_parameter(block, height - nominal, reach, spread))
    return tuple(constants)


def _make_height_error_parameter(
    block: str, start_error: float, reach: float, prior_std: float
) -> Parameter:
    """Make the height error of a block: where it begins, how far it may go, its spread [m]."""
    return Parameter(
        make_height_error_name(block),
        "m",
        start_error,
        low=start_error - reach,
        high=start_error + reach,
        scale=_HEIGHT_SCALE,
        prior_std=max(prior_std, _LEAST_HEIGHT_STD),
        block=block,
    )


@lru_cache(maxsize=64)
def _build_zero_state(trial_count: int) -> DragState:
    """Build a state of which every slot is zero.

    It is shared by all states of as many trials, and never written to.
    """
    zero = np.zeros(trial_count)
    zero.flags.writeable = False
    slots: dict[str, Any] = {slot.name: zero for slot in fields(DragState)}
    return DragState(**slots)


def build_nominal_state(design: BenchDesign, values: Mapping[str, float | Floats]) -> DragState:
    """Fill the slots from the design and the constants, each one number or one of each trial."""
    unity = np.ones(len(design.block))
    sliding, at_release = design.friction_shape
    spring_constant = design.spring_constant
    frequency = np.exp(values["ln_ring_frequency"]) * unity
    decay_time = np.exp(values["ln_decay_time"]) * unity
    load_error = values.get("load_error", 0.0) * unity
    # while the tip is held and the handle goes on, the tool's damper 2 k / (omega^2 T) takes its
    # share of the pull
    omega = 2.0 * np.pi * frequency
    damper = 2.0 * spring_constant / (omega**2 * decay_time)
    damper_share = values.get("damper_share", 0.0)
    damper_force = -damper_share * damper * design.speed
    height = design.height + _expand_height_errors_to_trials(design, values)
    radius = design.tip_radius + values.get("edge_radius", 0.0)
    conversion = np.exp(values["ln_conversion"]) * unity
    ramp_stiffness = spring_constant * values["stiffness_ratio"] * unity
    state = _build_zero_state(len(design.block)).changed(
        height=height,
        radius=radius,
        friction=values["friction"] * sliding,
        load=design.load + load_error,
        set_load=design.load,
        speed=design.speed,
        stiffness=ramp_stiffness,
        ring_stiffness=spring_constant * unity,
        conversion=conversion,
        edge_factor=at_release,
        damping=unity,
        gain=unity,
        normal_gain=unity,
        sensed_offset=load_error,
        climb_drag=damper_force,
        frequency=frequency,
        decay_time=decay_time,
        nominal_stiffness=spring_constant,
    )
    if design.indentation is None:
        return state
    return indent_contact(state, design.indentation.depth, design.indentation.power)


def _expand_height_errors_to_trials(
    design: BenchDesign, constant_values: Mapping[str, float | Floats]
) -> Floats:
    """Give each trial the height error of its block [m], shape (n,)."""
    names, block_of_trial = design.block_membership
    errors = [constant_values.get(name, 0.0) for name in names]
    if any(isinstance(error, np.ndarray) for error in errors):
        of_trials = np.stack(np.broadcast_arrays(*errors))
        return np.asarray(of_trials[block_of_trial, np.arange(len(block_of_trial))])
    return np.array(errors)[block_of_trial]


def build_extended_state(
    design: BenchDesign, values: Mapping[str, float | Floats], active: ActiveEffectsAtPoints = ()
) -> DragState:
    """Fill the slots from the constants and apply the effects.

    Release after contact, what follows the peak when it is known.
    """
    state = build_nominal_state(design, values)
    in_order = sorted(active, key=lambda effect: _make_application_sort_key(effect[0]))
    for law, law_values in in_order:
        column = None
        if law.given:
            column = compute_followed_covariate(design, state, law.covariate)
        state = law.apply(state, column, law_values)
    return state


def _make_application_sort_key(law: Law) -> tuple[bool, bool]:
    """Return the key that sorts laws by their order of application: after what they need."""
    follows_peak = law.given and law.covariate == PEAK_FORCE
    return follows_peak, law.slot == "conversion"


def split_covariate_columns(covariate: str) -> tuple[str, ...]:
    """Columns of the table of trials that an effect over a covariate needs."""
    if covariate in _COMPUTED:
        return ()
    return tuple(covariate.split(TOGETHER))


def compute_followed_covariate(
    design: BenchDesign, state: DragState, covariate: str
) -> NDArray[np.generic] | None:
    """Return the column of the design, or quantity of the state, that an effect follows."""
    if covariate == "none":
        return None
    if covariate == "block":
        return design.block
    if covariate == PEAK_FORCE:
        return state.compute_peak_force()
    if covariate == SPEED_OVER_LOAD:
        return 1e3 * design.speed / design.load
    if TOGETHER in covariate:
        columns = [design.covariates[name] for name in split_covariate_columns(covariate)]
        return np.stack(columns, axis=1)
    return design.covariates[covariate]


def compute_channel_responses(state: DragState) -> Floats:
    """Change of the channels per unit of ln friction, ln load and ln conversion.

    These three scatter among trials; the shape is (n, 7, 3).
    """
    base = compute_shown_channels(state)
    growth = 1.0 + _RESPONSE_STEP
    sensed = state.set_load + state.sensed_offset
    moved = (
        state.scaled(friction=growth),
        state.scaled(load=growth).shifted(sensed_offset=_RESPONSE_STEP * sensed),
        state.scaled(conversion=growth),
    )
    responses = []
    for changed in moved:
        change = compute_shown_channels(changed) - base
        responses.append(change / _RESPONSE_STEP)
    return np.stack(responses, axis=2)
