"""What a simulated session is to be: design, model, scatter, rig and planted effects, read from a TOML file."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from stepblocks.contact.effects.catalogue import named_laws
from stepblocks.errors import PipelineError, QuantityError
from stepblocks.quantities import quantity_parser

_MOST_TRIALS = 1_000_000


def _quantity(dimension: str) -> BeforeValidator:
    parse = quantity_parser(dimension)

    def read(value: object) -> float:
        try:
            return parse(value)
        except QuantityError as error:
            raise ValueError(str(error)) from error

    return BeforeValidator(read)


Length = Annotated[float, _quantity("length"), Field(ge=0.0)]
Force = Annotated[float, _quantity("force"), Field(ge=0.0)]
Speed = Annotated[float, _quantity("speed"), Field(gt=0.0)]
Frequency = Annotated[float, _quantity("frequency"), Field(gt=0.0)]
Time = Annotated[float, _quantity("time"), Field(gt=0.0)]
Ratio = Annotated[float, _quantity("ratio"), Field(ge=0.0)]
Stiffness = Annotated[float, _quantity("stiffness"), Field(gt=0.0)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Model(_Part):
    """The nominal model: equations (1) and (2) and the ring."""

    spring_constant: Stiffness = 9810.0
    tip_radius: Length = 125e-6
    friction: Ratio = 0.15
    conversion: Ratio = 0.20
    ring_frequency: Frequency = 300.0
    decay_time: Time = 21.2e-3
    sympathetic: Ratio = 0.25
    ring: Literal["damped", "rubbing"] = "damped"


class Design(_Part):
    """Conditions: the full factorial of heights, loads and speeds, `repeats` times, of which `trials` are drawn."""

    heights: list[Length] = Field(min_length=1)
    loads: list[Annotated[float, _quantity("force"), Field(gt=0.0)]] = Field(min_length=1)
    speeds: list[Speed] = Field(min_length=1)
    repeats: int = Field(default=1, ge=1, le=_MOST_TRIALS)
    trials: int | None = Field(default=None, ge=1, le=_MOST_TRIALS)
    operators: list[str] = ["A", "B"]


class Scatter(_Part):
    """Standard deviations: of ln energy, friction and load from trial to trial, of the height from block to block."""

    energy: Ratio = 0.05
    friction: Ratio = 0.005
    load: Ratio = 0.004
    height: Length = 0.5e-6


class RigPart(_Part):
    """What the rig adds to a trace."""

    sample_rate: Frequency = 10e3
    noise: Force = 4.5e-3
    quantum: Force = 0.5e-3
    hum: Force = 3e-3
    mains: Frequency = 50.0
    drift_n_per_s: float = 0.0
    start_up: Force = 0.0
    bandwidth: Frequency | None = None


class PlantedEffect(_Part):
    """A change of one slot of the model: a law of the catalogue, or a named form of one covariate."""

    law: str = ""  # A law of the catalogue, such as ``running_in``; slot and form are its own then
    # Its parameters in SI units; those not given keep the value at which a search begins
    parameters: dict[str, float] = {}
    # Which part of the model: ``contact_geometry`` (radius of the ball plus that of the edge [m]), ``friction`` [1],
    # ``normal_load`` [N], ``stiffness`` [N/m], ``conversion`` [1], ``drag`` (a force on the pull [N]), ``sensor``
    # (gain of the tangential channel [1])
    slot: Literal["contact_geometry", "friction", "normal_load", "stiffness", "conversion", "drag", "sensor"] | None = (
        None
    )
    change: Literal["add", "multiply"] = "add"  # ``add`` to the slot or ``multiply`` it
    # ``constant`` g = size; ``linear`` g = size (c - reference) / span; ``power`` g = size (c / reference)^exponent;
    # ``exponential`` g = size exp(-(c - reference) / span); ``levels`` g = levels[c], 0 for a label not named
    form: Literal["constant", "linear", "power", "exponential", "levels"] = "constant"
    covariate: str = "none"  # A column of the table, ``peak_force_n`` of the nominal model, or ``none``
    # Numbers of the form, in the units of slot and covariate. Added as it is, multiplied as 1 + g; a power that
    # multiplies is the factor itself
    size: float = Field(default=1.0, allow_inf_nan=False)
    reference: float = Field(default=0.0, allow_inf_nan=False)
    span: float = Field(default=1.0, allow_inf_nan=False)
    exponent: float = Field(default=1.0, allow_inf_nan=False)
    levels: dict[str, float] = {}  # Change at each label of a covariate

    def apply(self, value: float, conditions: Mapping[str, float | str]) -> float:
        """Return the slot's value after the effect.

        Examples
        --------
        >>> effect = PlantedEffect(slot="friction", change="multiply", form="linear", covariate="t", size=0.1, span=2)
        >>> round(effect.apply(0.2, {"t": 4.0}), 9)
        0.24
        """
        if self.form == "constant":
            change = self.size
        elif self.form == "levels":
            change = self.levels.get(str(conditions[self.covariate]), 0.0)
        else:
            c = float(conditions[self.covariate])
            if self.form == "linear":
                change = self.size * (c - self.reference) / self.span
            elif self.form == "power":
                change = self.size * (c / self.reference) ** self.exponent
            else:
                change = self.size * math.exp(-(c - self.reference) / self.span)
        if self.change == "add":
            return value + change
        return value * (change if self.form == "power" else 1.0 + change)


class SessionPlan(_Part):
    """A whole simulated session."""

    schema_: Literal[1] = Field(alias="schema")
    title: str = "Simulated session"
    source: Literal["equations", "drag"] = "equations"
    seed: int = Field(ge=0)
    format: Literal["csv", "hdf5", "tdms", "mat"] = "hdf5"
    model: Model = Model()
    design: Design
    scatter: Scatter = Scatter()
    rig: RigPart = RigPart()
    effects: list[PlantedEffect] = []

    def blocks(self) -> list[str]:
        """Names of the blocks."""
        return [block_name(height) for height in sorted(set(self.design.heights))]

    def rows(self) -> list[dict[str, str]]:
        """Conditions of every trial in the order of the run, as the table writes them."""
        random = np.random.default_rng([self.seed, 1])
        full = [(h, n, v) for h in self.design.heights for n in self.design.loads for v in self.design.speeds]
        count = self.design.trials or len(full) * self.design.repeats
        # every combination comes before any comes again
        order = np.concatenate([random.permutation(len(full)) for _ in range(math.ceil(count / len(full)))])[:count]
        order = random.permutation(order)
        warmth = np.cumsum(random.normal(0.0, 0.35, count)) / math.sqrt(count) * 4.0 + 22.0
        wet = np.cumsum(random.normal(0.0, 1.5, count)) / math.sqrt(count) * 4.0 + 50.0
        rows = []
        for number, index in enumerate(order, start=1):
            height, load, speed = full[int(index)]
            operators = self.design.operators
            rows.append(
                {
                    "trial": str(number),
                    "block": block_name(height),
                    "height_um": f"{height * 1e6:g}",
                    "load_n": f"{load:g}",
                    "speed_mm_s": f"{speed * 1e3:g}",
                    "tip": f"tip-{self.model.tip_radius * 1e6:g}",
                    "run_order": str(number),
                    "temperature_c": f"{warmth[number - 1]:.2f}",
                    "humidity_pct": f"{wet[number - 1]:.1f}",
                    "operator": operators[int(random.integers(len(operators)))],
                }
            )
        return rows


def block_name(height: float) -> str:
    """Name of the block with a step of this height [m].

    Examples
    --------
    >>> block_name(30e-6), block_name(12.5e-6)
    ('step-030', 'step-012.5')
    """
    micrometres = height * 1e6
    whole = round(micrometres)
    return f"step-{whole:03d}" if abs(micrometres - whole) < 1e-6 else f"step-{micrometres:05.1f}"


def read_plan(path: Path) -> SessionPlan:
    """Read a plan."""
    try:
        plan = SessionPlan.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise PipelineError(f"plan cannot be read: {error.strerror} [{path}]") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise PipelineError(f"plan must be TOML: {error} [{path}]") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise PipelineError(f"`{place}`: {first['msg'].removeprefix('Value error, ')} [{path}]") from error
    for number, effect in enumerate(plan.effects, start=1):
        fault = _fault(effect, plan)
        if fault:
            raise PipelineError(f"{fault[0]} of effect {number} {fault[1]} [{path}]")
    return plan


_NUMBERS = ("height_um", "load_n", "speed_mm_s", "run_order", "temperature_c", "humidity_pct", "peak_force_n")
_LABELS = ("block", "operator", "tip")


def _fault(effect: PlantedEffect, plan: SessionPlan) -> tuple[str, str] | None:
    """Return what is wrong with an effect: the field, and the rule that it breaks."""
    if effect.law:
        laws = {law.id: law for law in named_laws(plan.blocks())}
        if effect.law not in laws:
            return "law", f"must be one of {', '.join(laws)}, got {effect.law!r}"
        names = [p.name for p in laws[effect.law].parameters]
        unknown = sorted(set(effect.parameters) - set(names))
        if unknown or not effect.parameters:
            return "parameters", f"must be among {', '.join(names)}, got {', '.join(unknown) or 'none'}"
        if effect.slot:
            return "slot", "must be left out where a law is named"
        return None
    if effect.slot is None:
        return "slot", "or law must be given"
    if plan.source == "drag" and effect.slot == "conversion":
        return "slot", "must not be conversion where the drag in time decides what rings"
    known = {"constant": ("none",), "levels": _LABELS}.get(effect.form, _NUMBERS)
    if effect.covariate not in known:
        if effect.covariate == "none":
            return "covariate", "must have a covariate unless its form is constant"
        return (
            "covariate",
            f"must be one of {', '.join(known)} where its form is {effect.form}, got {effect.covariate!r}",
        )
    if effect.span == 0.0 or (effect.form == "power" and effect.reference == 0.0):
        return "span and, of a power, reference", "must not be 0"
    return None
