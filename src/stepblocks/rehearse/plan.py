"""The plan of a simulated session, read from a TOML file.

It holds the design, the model, the scatter, the rig and the planted effects.
"""

import itertools
import math
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field

from stepblocks.bench.calibration import Frequency, Stiffness, Strict
from stepblocks.contact import Array
from stepblocks.contact.operating_point import PAPER
from stepblocks.declaration.read import load_set
from stepblocks.errors import PipelineError
from stepblocks.files.text import read_document
from stepblocks.mistakes import Mistake, format_mistakes, shorten_value, validate_file_data
from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.kinds.kit_part import KitPart
from stepblocks.quantities import make_quantity_parser
from stepblocks.rehearse.effects import Finite, PlantedEffect, Source
from stepblocks.rehearse.kit_loads import match_loads_to_kit_weights
from stepblocks.rehearse.record import Rig, Truth

_MOST_TRIALS = 1_000_000
_MEAN_TEMPERATURE, _MEAN_HUMIDITY = 22.0, 50.0  # [degrees Celsius], [%]
_WALK_SPREAD = 4.0  # factor on the walks of temperature and humidity
_WHOLE = 1e-6  # of a height from whole micrometres [um]
_Length = Annotated[float, BeforeValidator(make_quantity_parser("length")), Field(ge=0.0, le=1.0)]
_Force = Annotated[float, BeforeValidator(make_quantity_parser("force")), Field(ge=0.0, le=1e3)]
_Load = Annotated[float, BeforeValidator(make_quantity_parser("force")), Field(ge=1e-6, le=1e3)]
_Speed = Annotated[float, BeforeValidator(make_quantity_parser("speed")), Field(ge=1e-6, le=10.0)]
_Time = Annotated[float, BeforeValidator(make_quantity_parser("time")), Field(gt=0.0, le=10.0)]
_Ratio = Annotated[float, BeforeValidator(make_quantity_parser("ratio")), Field(ge=0.0, le=10.0)]


class Model(Strict):
    """The nominal model: equations (1) and (2) and the ring; what is not given is the paper's."""

    spring_constant: Stiffness = PAPER.tool.stiffness
    tip_radius: _Length = PAPER.ball_radius
    friction: _Ratio = PAPER.friction
    conversion: _Ratio = PAPER.tool.conversion
    ring_frequency: Frequency = PAPER.tool.frequency
    decay_time: _Time = PAPER.tool.decay_time
    sympathetic: _Ratio = Truth.sympathetic
    ring: Literal["damped", "rubbing"] = "damped"


class Design(Strict):
    """Conditions: the full factorial of heights, loads and speeds, `repeats` times.

    Of these, `trials` are drawn; they are spread evenly over `days`.
    """

    heights: list[_Length] = Field(min_length=1)
    loads: list[_Load] = Field(min_length=1)
    speeds: list[_Speed] = Field(min_length=1)
    repeats: int = Field(default=1, ge=1, le=_MOST_TRIALS)
    trials: int | None = Field(default=None, ge=1, le=_MOST_TRIALS)
    operators: tuple[str, ...] = ("A", "B")
    days: int = Field(default=1, ge=1, le=1000)


class Scatter(Strict):
    """Standard deviations from trial to trial, and from block to block.

    Attributes
    ----------
    energy : _Ratio
        Of ln E_v [1].
    friction : _Ratio
        [1].
    load : _Ratio
        Relative [1].
    height : _Length
        Of the blocks [m].
    """

    energy: _Ratio = 0.05
    friction: _Ratio = 0.005
    load: _Ratio = 0.004
    height: _Length = 0.5e-6


class RigPart(Strict):
    """What the rig adds to a trace; see `Rig`."""

    sample_rate: Frequency = Rig.sample_rate
    noise: _Force = Rig.noise
    quantum: _Force = Rig.quantum
    hum: _Force = Rig.hum
    mains: Frequency = Rig.mains
    drift_n_per_s: Finite = Rig.drift
    start_up: _Force = Rig.start_up
    bandwidth: Frequency | None = None


class SessionPlan(Strict):
    """A whole simulated session.

    Attributes
    ----------
    schema_ : Literal[1]
    title : str
    source : Source
    seed : int
    format : Literal['csv', 'hdf5', 'mat', 'tdms']
    model : Model
    design : Design
    scatter : Scatter
    rig : RigPart
    effects : tuple[PlantedEffect, ...]
    apparatus : Apparatus or None
        Kit whose weights press and whose budget the load errs by; a plan names the stimulus file
        that declares it.
    """

    schema_: Literal[1] = Field(alias="schema")
    title: str = "Simulated session"
    source: Source = "equations"
    seed: int = Field(ge=0)
    format: Literal["csv", "hdf5", "mat", "tdms"] = "hdf5"
    model: Model = Model()
    design: Design
    scatter: Scatter = Scatter()
    rig: RigPart = RigPart()
    effects: tuple[PlantedEffect, ...] = ()
    apparatus: Apparatus | None = None

    def list_blocks(self) -> list[str]:
        """List the names of the blocks."""
        return [format_block_name(height) for height in sorted(set(self.design.heights))]

    def list_trial_rows(self) -> list[dict[str, str]]:
        """Return the conditions of every trial in the order of the run, as texts of the table."""
        random = np.random.default_rng([self.seed, 1])
        conditions = self._draw_conditions_in_run_order(random)
        count = len(conditions)
        temperatures = _draw_random_walk(random, count, 0.35) + _MEAN_TEMPERATURE
        humidities = _draw_random_walk(random, count, 1.5) + _MEAN_HUMIDITY
        tip = f"tip-{self.model.tip_radius * 1e6:g}"
        rows = []
        for index, (height, load, speed) in enumerate(conditions):
            number = str(index + 1)
            operator = int(random.integers(len(self.design.operators)))
            row = {
                "trial": number,
                "block": format_block_name(height),
                "height_um": f"{height * 1e6:g}",
                "load_n": f"{load:g}",
                "speed_mm_s": f"{speed * 1e3:g}",
                "tip": tip,
                "run_order": number,
                "temperature_c": f"{temperatures[index]:.2f}",
                "humidity_pct": f"{humidities[index]:.1f}",
                "operator": self.design.operators[operator],
            }
            if self.design.days > 1:
                row["day"] = str(1 + index * self.design.days // count)
            rows.append(row)
        return rows

    def _draw_conditions_in_run_order(self, generator: np.random.Generator) -> "list[_Condition]":
        """Return height, load and speed of every trial in the order of the run."""
        design = self.design
        factorial = []
        for height, load, speed in itertools.product(design.heights, design.loads, design.speeds):
            factorial.append(_Condition(height, load, speed))
        count = design.trials or len(factorial) * design.repeats
        # every combination is drawn before any is drawn again
        rounds = []
        for _ in range(math.ceil(count / len(factorial))):
            rounds.append(generator.permutation(len(factorial)))
        order = generator.permutation(np.concatenate(rounds)[:count])
        return [factorial[index] for index in order.tolist()]


class _Condition(NamedTuple):
    """Height of the step [m], load [N] and speed [m/s] of one trial."""

    height: float
    load: float
    speed: float


def _draw_random_walk(generator: np.random.Generator, step_count: int, step_std: float) -> Array:
    """Return a random walk from zero that spreads alike in any number of trials, shape (n,)."""
    return (
        np.cumsum(generator.normal(0.0, step_std, step_count))
        / math.sqrt(step_count)
        * _WALK_SPREAD
    )


def format_block_name(height: float) -> str:
    """Return the name of the block with a step of this height [m]."""
    micrometres = height * 1e6
    whole = round(micrometres)
    if abs(micrometres - whole) < _WHOLE:
        return f"step-{whole:03d}"
    return f"step-{micrometres:05.1f}"


def read_session_plan(path: Path) -> SessionPlan:
    """Read a plan, and the stimulus file of the kit that it names.

    Raises
    ------
    StepblocksError
        With all that is wrong with it, or with that file.
    """
    document = read_document(path, "plan", PipelineError)
    if "apparatus" in document:
        document["apparatus"] = _load_apparatus(document["apparatus"], path)
    plan = validate_file_data(SessionPlan, document, path, PipelineError)
    faults: list[Mistake] = []
    for number, effect in enumerate(plan.effects, start=1):
        fault = effect.find_plan_fault(number, plan.source, plan.list_blocks())
        if fault is not None:
            faults.append(("", fault))
    if plan.apparatus is not None:
        plan = _replace_loads_by_weights(plan, plan.apparatus, faults)
    if faults:
        raise PipelineError(format_mistakes(faults, path))
    return plan


def _load_apparatus(file_name: object, plan_path: Path) -> Apparatus:
    """Load the kit of the stimulus file that a plan names, beside it or absolute."""
    if not isinstance(file_name, str):
        raise PipelineError(
            f"apparatus must be the name of a stimulus file, got {shorten_value(file_name)} "
            f"[{plan_path}]"
        )
    place = plan_path.parent / file_name
    for part in load_set(place).stimuli:
        if isinstance(part, KitPart):
            return part.kit
    raise PipelineError(f"apparatus must declare a kit in [[apparatus]], got none [{place}]")


def _replace_loads_by_weights(
    plan: SessionPlan, kit: Apparatus, faults: list[Mistake]
) -> SessionPlan:
    """Replace the planned loads by those of the kit's weights, and their scatter by its budget.

    What is wrong is added to the faults.
    """
    loads, missing = match_loads_to_kit_weights(kit, plan.design.loads)
    if missing:
        asked = ", ".join(f"{load:g} N" for load in missing)
        known = ", ".join(f"{mass * kit.gravity.value:.4g} N" for mass in kit.normal_weights)
        faults.append(
            ("design", f"loads must be those of the weights of {kit.id} ({known}), got {asked}")
        )
    if "load" in plan.scatter.model_fields_set:
        rule = f"load must be left out, because {kit.id} has a budget of its own"
        faults.append(("scatter", f"{rule}, got {plan.scatter.load:g}"))
    design = plan.design.model_copy(update={"loads": loads})
    scatter = plan.scatter.model_copy(update={"load": 0.0})
    return plan.model_copy(update={"design": design, "scatter": scatter})
