"""The plan of a simulated session, read from a TOML file.

It holds the design, the model, the scatter, the rig and the planted effects.
"""

import itertools
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from stepblocks.bench.calibration import Frequency, Stiffness, Strict
from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import PipelineError
from stepblocks.files.text import read_document
from stepblocks.mistakes import format_mistakes, validate_data
from stepblocks.quantities import make_quantity_parser
from stepblocks.rehearse import Rig, Truth
from stepblocks.rig.effects.named import list_named_laws

_MOST_TRIALS = 1_000_000
NUMBERS = (
    "height_um",
    "load_n",
    "speed_mm_s",
    "run_order",
    "temperature_c",
    "humidity_pct",
    "peak_force_n",
)
_LABELS = ("block", "operator", "tip", "day")

_Length = Annotated[float, BeforeValidator(make_quantity_parser("length")), Field(ge=0.0, le=1.0)]
_Force = Annotated[float, BeforeValidator(make_quantity_parser("force")), Field(ge=0.0, le=1e3)]
_Load = Annotated[float, BeforeValidator(make_quantity_parser("force")), Field(ge=1e-6, le=1e3)]
_Speed = Annotated[float, BeforeValidator(make_quantity_parser("speed")), Field(ge=1e-6, le=10.0)]
_Time = Annotated[float, BeforeValidator(make_quantity_parser("time")), Field(gt=0.0, le=10.0)]
_Ratio = Annotated[float, BeforeValidator(make_quantity_parser("ratio")), Field(ge=0.0, le=10.0)]
_Finite = Annotated[float, Field(ge=-1e9, le=1e9)]


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
    drift_n_per_s: _Finite = Rig.drift
    start_up: _Force = Rig.start_up
    bandwidth: Frequency | None = None


class PlantedEffect(Strict):
    """A change of one slot of the model: a law of the catalogue, or a named form of one covariate.

    Attributes
    ----------
    law : str
        Of the catalogue, such as ``running_in``; slot and form are its own then.
    parameters : dict[str, float]
        Of the law, in SI; else where a search begins.
    slot : str, optional
        Part of the model: ``contact_geometry`` (radius of the ball plus that of the edge [m]),
        ``friction`` [1], ``normal_load`` [N], ``stiffness`` [N/m], ``conversion`` [1], ``drag`` (a
        force on the pull [N]), ``sensor`` (gain of the tangential channel [1]).
    change : Literal['add', 'multiply']
        As it is, or as 1 + change; a power that multiplies is the factor itself.
    form : Literal['constant', 'linear', 'power', 'exponential', 'levels']
    covariate : str
        A column of the table, ``peak_force_n`` of the nominal model, or ``none``.
    size : _Finite
        This and the next in the units of slot and covariate.
    reference : _Finite
    span : _Finite
    exponent : _Finite
    levels : dict[str, _Finite]
        Change at each label of a covariate, 0 at one not named.
    """

    law: str = ""
    parameters: dict[str, float] = Field(default_factory=dict)
    slot: Literal[
        "contact_geometry",
        "friction",
        "normal_load",
        "stiffness",
        "conversion",
        "drag",
        "sensor",
        None,
    ] = None
    change: Literal["add", "multiply"] = "add"
    form: Literal["constant", "linear", "power", "exponential", "levels"] = "constant"
    covariate: str = "none"
    size: _Finite = 1.0
    reference: _Finite = 0.0
    span: _Finite = 1.0
    exponent: _Finite = 1.0
    levels: dict[str, _Finite] = Field(default_factory=dict)

    def apply(self, value: float, conditions: Mapping[str, float | str]) -> float:
        """Return the slot's value after the effect."""
        at = conditions.get(self.covariate, 0.0)
        changes: dict[str, Callable[[], float]] = {
            "constant": lambda: self.size,
            "levels": lambda: self.levels.get(str(at), 0.0),
            "linear": lambda: self.size * (float(at) - self.reference) / self.span,
            "power": lambda: float(self.size * (float(at) / self.reference) ** self.exponent),
            "exponential": lambda: self.size * math.exp(-(float(at) - self.reference) / self.span),
        }
        change = changes[self.form]()
        factor = change if self.form == "power" else 1.0 + change
        return value + change if self.change == "add" else value * factor

    def fault(self, plan: "SessionPlan", number: int) -> str:
        """Say which field breaks which rule; empty where all is well."""
        laws = {law.id: law for law in list_named_laws(plan.blocks())}
        named = laws.get(self.law)
        names = [p.name for p in named.parameters] if named else []
        unknown = ", ".join(sorted(set(self.parameters) - set(names))) or "none"
        known = {"constant": ("none",), "levels": _LABELS}.get(self.form, NUMBERS)
        of_law = {
            f"law of effect {number} must be one of {', '.join(laws)}, got {self.law!r}": not named,
            f"law of effect {number} bends ramp and ring: source must be 'drag', got "
            f"{plan.source!r}": self.law == "hardening_spring" and plan.source != "drag",
            f"parameters of effect {number} must be among {', '.join(names)}, got {unknown}": (
                not set() < set(self.parameters) <= set(names)
            ),
            f"slot of effect {number} must be left out where a law is named": bool(self.slot),
        }
        of_form = {
            f"slot of effect {number} or law must be given": self.slot is None,
            f"slot of effect {number} must not be conversion where the drag in time decides what "
            "rings": plan.source == "drag" and self.slot == "conversion",
            f"covariate of effect {number} must have a covariate unless its form is constant": (
                self.covariate == "none" and "none" not in known
            ),
            f"covariate of effect {number} must be one of {', '.join(known)} where its form is "
            f"{self.form}, got {self.covariate!r}": self.covariate not in known,
            f"span and, of a power, reference of effect {number} must not be 0": (
                self.span == 0.0 or (self.form == "power" and self.reference == 0.0)
            ),
        }
        return next(
            (fault for fault, broken in (of_law if self.law else of_form).items() if broken), ""
        )


class SessionPlan(Strict):
    """A whole simulated session.

    Attributes
    ----------
    schema_ : Literal[1]
    title : str
    source : Literal['equations', 'drag']
    seed : int
    format : Literal['csv', 'hdf5']
    model : Model
    design : Design
    scatter : Scatter
    rig : RigPart
    effects : tuple[PlantedEffect, ...]
    """

    schema_: Literal[1] = Field(alias="schema")
    title: str = "Simulated session"
    source: Literal["equations", "drag"] = "equations"
    seed: int = Field(ge=0)
    format: Literal["csv", "hdf5"] = "hdf5"
    model: Model = Model()
    design: Design
    scatter: Scatter = Scatter()
    rig: RigPart = RigPart()
    effects: tuple[PlantedEffect, ...] = ()

    def blocks(self) -> list[str]:
        """Names of the blocks."""
        return [name_block(height) for height in sorted(set(self.design.heights))]

    def rows(self) -> list[dict[str, str]]:
        """Conditions of every trial in the order of the run, as the table writes them."""
        random = np.random.default_rng([self.seed, 1])
        design = self.design
        full = list(itertools.product(design.heights, design.loads, design.speeds))
        count = design.trials or len(full) * design.repeats
        # every combination is drawn before any is drawn again
        rounds = [random.permutation(len(full)) for _ in range(math.ceil(count / len(full)))]
        order = random.permutation(np.concatenate(rounds)[:count])
        warmth = np.cumsum(random.normal(0.0, 0.35, count)) / math.sqrt(count) * 4.0 + 22.0
        wet = np.cumsum(random.normal(0.0, 1.5, count)) / math.sqrt(count) * 4.0 + 50.0
        conditions = zip((full[i] for i in order.tolist()), warmth, wet, strict=True)
        return [
            {
                "trial": str(number),
                "block": name_block(height),
                "height_um": f"{height * 1e6:g}",
                "load_n": f"{load:g}",
                "speed_mm_s": f"{speed * 1e3:g}",
                "tip": f"tip-{self.model.tip_radius * 1e6:g}",
                "run_order": str(number),
                "temperature_c": f"{temperature:.2f}",
                "humidity_pct": f"{humidity:.1f}",
                "operator": design.operators[int(random.integers(len(design.operators)))],
            }
            | ({"day": str(1 + (number - 1) * design.days // count)} if design.days > 1 else {})
            for number, ((height, load, speed), temperature, humidity) in enumerate(conditions, 1)
        ]


def name_block(height: float) -> str:
    """Name of the block with a step of this height [m]."""
    micrometres = height * 1e6
    whole = round(micrometres)
    return f"step-{whole:03d}" if abs(micrometres - whole) < 1e-6 else f"step-{micrometres:05.1f}"


def read_plan(path: Path) -> SessionPlan:
    """Read a plan, or say all that is wrong with it."""
    plan = validate_data(
        SessionPlan, read_document(path, "plan", PipelineError), path, PipelineError
    )
    if faults := [
        ("", fault)
        for number, one in enumerate(plan.effects, start=1)
        if (fault := one.fault(plan, number))
    ]:
        raise PipelineError(format_mistakes(faults, path))
    return plan
