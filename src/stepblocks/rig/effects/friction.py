"""Effects of friction: what its coefficient follows beside the constant of the nominal model."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.rig.forward import SPEED_OVER_LOAD
from stepblocks.rig.state import DragState, Floats

_friction = partial(Law, slot="friction")
_by_speed = partial(
    _friction,
    covariate="speed_mm_s",
    description="friction falls with speed: excess at rest {}, over a speed of {}",
)

# at which the coefficient is that of the nominal model
_LOAD = 0.6  # [N]
_SPEED = 6e-3  # [m/s]
_LEAST_LOAD = 1e-3  # where a fit strays [N]
_LEAST_FACTOR = 0.02  # on the coefficient, where a fit strays
_RATIO_UNIT = 1e-3  # of the column of speed over load, mm/(N s) [m/(N s)]


def _reduce_friction_with_load(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let friction follow a power of the load."""
    ratio = state.load / _LOAD
    factor = ratio ** -law_values["exponent"]
    return state.scaled(friction=factor)


def _add_adhesion_friction(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let adhesion press the tip on: it adds a friction force that does not depend on the load."""
    load = np.maximum(state.load, _LEAST_LOAD)
    added = law_values["adhesion_n"] / load
    return state.shifted(friction=added)


def _scale_friction_on_edge(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let friction on the edge differ by a factor from that on the faces."""
    return state.scaled(edge_factor=law_values["edge_over_face"])


def _reduce_friction_with_speed(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let friction fall from rest to sliding, after Stribeck."""
    falling = np.exp(-state.speed / law_values["stribeck_speed_m_per_s"])
    excess = law_values["excess"] * falling
    factor = 1.0 + excess
    return state.scaled(friction=factor)


def _scale_friction_by_log_speed(
    state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let friction follow the logarithm of the speed, as of dry contacts."""
    logarithm = np.log(state.speed / _SPEED)
    change = law_values["slope"] * logarithm
    factor = np.maximum(1.0 + change, _LEAST_FACTOR)
    return state.scaled(friction=factor)


def _reduce_friction_by_film(
    state: DragState, ratio_mm_per_n_s: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let a film that speed builds and load presses out carry the tip [ratio in mm/(N s)]."""
    speed_over_load = _RATIO_UNIT * ratio_mm_per_n_s
    falling = np.exp(-speed_over_load / law_values["number"])
    excess = law_values["excess"] * falling
    factor = 1.0 + excess
    return state.scaled(friction=factor)


def _scale_friction_by_speed_over_load(
    state: DragState, ratio_mm_per_n_s: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let friction follow a power of speed over load [ratio in mm/(N s)]."""
    to_reference = 0.1 * ratio_mm_per_n_s  # over 0.01 m/(N s)
    factor = to_reference ** -law_values["exponent"]
    return state.scaled(friction=factor)


def _scale_friction_by_previous_load(
    state: DragState, previous_load: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let friction follow the load of the trial before [N]."""
    ratio = previous_load / _LOAD
    factor = ratio ** law_values["exponent"]
    return state.scaled(friction=factor)


def _let_friction_settle(
    state: DragState, run_order: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let friction begin with an excess that decays over a number of trials."""
    fading = np.exp(-run_order / law_values["settling_trials"])
    excess = law_values["excess"] * fading
    factor = np.maximum(1.0 + excess, _LEAST_FACTOR)
    return state.scaled(friction=factor)


def _make_settling_law(
    law_id: str,
    form: str,
    *,
    settling_trials: float,
    least_settling_trials: float,
    covariate: str,
    description: str,
    how_to_decide: str,
) -> Law:
    """Make the law of friction that settles after a fresh contact, or after a rest.

    It settles over so many `settling_trials`, and over `least_settling_trials` at least.
    """
    shapes = []
    for factor in (0.3, 0.8, 2.0, 8.0):
        shapes.append({"settling_trials": settling_trials * factor})
    excess = Parameter("excess", "1", 0.0, -0.95, 20.0, 0.05)
    duration = Parameter(
        "settling_trials",
        "1",
        settling_trials,
        least_settling_trials,
        1000.0,
        0.2 * settling_trials,
    )
    return _friction(
        law_id,
        form,
        (excess, duration),
        _let_friction_settle,
        covariate=covariate,
        shapes=tuple(shapes),
        description=description,
        how_to_decide=how_to_decide,
    )


FRICTION_LAWS: tuple[Law, ...] = (
    _friction(
        "load_dependent_friction",  # an elastic contact after Hertz has p = 1/3
        "mu (F_py / 0.6 N)^-p",
        (Parameter("exponent", "1", 0.0, -3.0, 3.0, 0.05),),
        _reduce_friction_with_load,
        covariate="load_n",
        description="friction falls with load: exponent",
    ),
    _friction(
        "adhesive_friction",
        "mu + A / F_py",
        (Parameter("adhesion_n", "N", 0.0, 0.0, 1.0, 3e-3),),
        _add_adhesion_friction,
        covariate="load_n",
        rank=1,
        description="adhesion adds to friction, whatever the load: a force of",
        how_to_decide="drag at a tenth of the load, or clean tip and block",
    ),
    _friction(
        "edge_friction",
        "e mu while the tip climbs, mu on the faces",
        (Parameter("edge_over_face", "1", 1.0, 0.1, 4.0, 0.03),),
        _scale_friction_on_edge,
        description="friction on the edge over that on the faces is",
        how_to_decide="turn the blocks round, and drag a block with a fresh edge",
    ),
    _by_speed(
        "stribeck_friction",
        "mu (1 + s exp(-v / v_s))",
        (
            Parameter("excess", "1", 0.0, -0.95, 10.0, 0.05),
            Parameter("stribeck_speed_m_per_s", "m/s", 5e-3, 5e-4, 1e-1, 1e-3),
        ),
        _reduce_friction_with_speed,
        shapes=tuple({"stribeck_speed_m_per_s": speed} for speed in (1.5e-3, 4e-3, 9e-3, 2.5e-2)),
    ),
    _by_speed(
        "stribeck_friction~logarithmic",
        "mu (1 + s ln(v / 6 mm/s))",
        (Parameter("slope", "1", 0.0, -2.0, 2.0, 0.03),),
        _scale_friction_by_log_speed,
        rank=1,
        description="friction goes with the logarithm of speed: slope",
    ),
    _friction(
        "hersey_friction",
        "mu (1 + s exp(-(v / F_py) / h))",
        (
            Parameter("excess", "1", 0.0, -0.95, 10.0, 0.05),
            Parameter("number", "m/(N s)", 8e-3, 5e-4, 2e-1, 1e-3),
        ),
        _reduce_friction_by_film,
        covariate=SPEED_OVER_LOAD,
        shapes=tuple({"number": number} for number in (3e-3, 8e-3, 2e-2, 5e-2)),
        description="friction follows speed over load: excess at rest {}, over a ratio of {}",
    ),
    _friction(
        "hersey_friction~power",
        "mu ((v / F_py) / 0.01 m/(N s))^-p",
        (Parameter("exponent", "1", 0.0, -2.0, 2.0, 0.03),),
        _scale_friction_by_speed_over_load,
        covariate=SPEED_OVER_LOAD,
        rank=1,
        description="friction follows speed over load: exponent",
    ),
    _friction(
        "carried_over",
        "mu (F_before / 0.6 N)^p",
        (Parameter("exponent", "1", 0.0, -2.0, 2.0, 0.03),),
        _scale_friction_by_previous_load,
        covariate="previous_load_n",
        description="friction follows the load of the trial before: exponent",
        how_to_decide="repeat one trial after a light and after a heavy one",
    ),
    _make_settling_law(
        "running_in",
        "mu (1 + s exp(-n / n0))",
        settling_trials=50.0,
        least_settling_trials=3.0,
        covariate="run_order",
        description="friction runs in: excess at first {}, trials to settle {}",
        how_to_decide="drag a fresh or cleaned block: friction begins high again",
    ),
    _make_settling_law(
        "rest",
        "mu (1 + s exp(-n / n0)), n trials since a rest",
        settling_trials=5.0,
        least_settling_trials=0.5,
        covariate="trials_since_rest",
        description="friction differs after a rest: excess at first {}, trials to settle {}",
        how_to_decide="repeat one trial before and after a rest",
    ),
)
