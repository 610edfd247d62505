"""A stimulus set: everything one file declares, and the grid over which it shall be predicted."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from stepblocks.parts.body import Identity, Part
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.probe import DampingRig, ProbeSpec
from stepblocks.parts.sheath.declaration import Sheath, balanced
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.tips.declaration import HookTip, StraightTip
from stepblocks.quantities import format_quantity, parse_quantity, quantity_parser

Stimulus = StepBlock | MarginBlock | CrownOnTooth | StraightTip | HookTip | Sheath  # Any declared part
Surface = StepBlock | MarginBlock | CrownOnTooth  # What a tip is dragged over
# Names of the stanzas of a stimulus file
KINDS = ("step_block", "margin_block", "crown_on_tooth", "straight_tip", "hook_tip", "sheath")


def _positive(dimension: str) -> BeforeValidator:
    def parse(raw: object) -> float:
        value = parse_quantity(raw, dimension)
        if value <= 0.0:
            raise ValueError(f"must be positive, got {raw!r}")
        return value

    return BeforeValidator(parse)


def _ratio(raw: object) -> float:
    value = quantity_parser("ratio")(raw)
    if value < 0.0:
        raise ValueError(f"must not be negative, got {raw!r}")
    return value


class ToolSpec(Part):
    """The explorer as a spring that rings; what is left out is the paper's."""

    stiffness: Annotated[float, _positive("stiffness")] = 9.81e3  # Tangential stiffness k [N/m]
    conversion: Annotated[float, _positive("ratio")] = 0.20  # Share C_v of the stored energy that becomes vibration [1]
    ring_duration: Annotated[float, _positive("time")] = 16e-3  # Duration of the ring [s]
    # Detection threshold of vibration power at the fingertip [W]
    detection_threshold: Annotated[float, _positive("power")] = 0.08e-6


def _width(dimension: str) -> BeforeValidator:
    def parse(raw: object) -> float:
        value = parse_quantity(raw, dimension)
        if value < 0.0:
            raise ValueError(f"must not be negative, got {raw!r}")
        return value

    return BeforeValidator(parse)


class SettingTolerances(Part):
    """How far what is not on a drawing may be off, to either side; what is left out is taken as known."""

    tip_radius: Annotated[float, _width("length")] = 0.0  # Radius of the tips of `PredictionGrid.tip_radii` [m]
    friction: Annotated[float, _width("ratio")] = 0.0  # Coefficient of friction [1]
    # As a share of the load, of the spring's stiffness and of C_v [1]
    normal_load: Annotated[float, _width("ratio")] = 0.0
    stiffness: Annotated[float, _width("ratio")] = 0.0
    conversion: Annotated[float, _width("ratio")] = 0.0


class PredictionGrid(Part):
    """Conditions under which each stimulus is predicted: every combination of tip, load and friction."""

    # Radii R of the probe tips [m]
    tip_radii: Annotated[tuple[Annotated[float, _positive("length")], ...], Field(max_length=100)] = ()
    # Normal loads F_py [N]
    normal_loads: Annotated[tuple[Annotated[float, _positive("force")], ...], Field(min_length=1, max_length=100)]
    # Coefficients of friction mu [1]
    frictions: Annotated[tuple[Annotated[float, BeforeValidator(_ratio)], ...], Field(min_length=1, max_length=100)]
    # Heights H of sharp steps on which declared tips are predicted [m]
    step_heights: Annotated[tuple[Annotated[float, _positive("length")], ...], Field(max_length=100)] = ()
    tool: ToolSpec = ToolSpec()  # Spring and ring of the explorer
    # How far tips, frictions, loads and spring may be off, for the intervals of the predictions
    tolerances: SettingTolerances = SettingTolerances()


class StimulusSet(Part):
    """Everything one stimulus file declares."""

    name: Identity  # Name of the set and of its file
    title: Annotated[str, Field(min_length=1, max_length=200)]  # For the page: what it is and where it comes from
    source: Annotated[str, Field(max_length=500)] = ""
    prediction: PredictionGrid  # Conditions of the predictions
    step_block: tuple[StepBlock, ...] = ()
    margin_block: tuple[MarginBlock, ...] = ()
    crown_on_tooth: tuple[CrownOnTooth, ...] = ()
    straight_tip: tuple[StraightTip, ...] = ()
    hook_tip: tuple[HookTip, ...] = ()
    sheath: Annotated[tuple[Sheath, ...], BeforeValidator(balanced)] = ()
    probe: ProbeSpec | None = None  # The probe that the sheaths are made for
    damping_rig: DampingRig | None = None  # The rig on which its ring is measured

    @property
    def stimuli(self) -> tuple[Stimulus, ...]:
        """All parts in the order of the file's kinds."""
        return (
            *self.step_block,
            *self.margin_block,
            *self.crown_on_tooth,
            *self.straight_tip,
            *self.hook_tip,
            *self.sheath,
        )

    @model_validator(mode="after")
    def _names_are_unique(self) -> StimulusSet:
        seen: set[str] = set()
        for stimulus in self.stimuli:
            if stimulus.id in seen:
                raise ValueError(f"id must be unique in its set, got {stimulus.id!r} twice")
            seen.add(stimulus.id)
        if (self.straight_tip or self.hook_tip or self.sheath) and not self.prediction.step_heights:
            raise ValueError("prediction.step_heights must be given for a set with tips or sheaths, got none")
        if len(self.stimuli) > len(self.straight_tip) + len(self.hook_tip) and not self.prediction.tip_radii:
            raise ValueError("prediction.tip_radii must be given for a set with blocks, crowns or sheaths, got none")
        self._require_probe()
        if not seen:
            raise ValueError("a set must declare at least one stimulus, got none")
        return self

    def _require_probe(self) -> None:
        """Refuse sheaths without a probe and a rig, and one whose bore does not go over the shank."""
        if not self.sheath:
            return
        for name in ("probe", "damping_rig"):
            if getattr(self, name) is None:
                raise ValueError(f"{name} must be declared for a set with sheaths, got none")
        assert self.probe is not None
        shank = self.probe.shank_diameter.value
        for sheath in self.sheath:
            if sheath.bore.limits[0] < shank:
                raise ValueError(
                    f"bore must not be less than the shank ({format_quantity(shank, 'length')}) within its tolerance, "
                    f"got {sheath.bore} [sheath {sheath.id!r}]"
                )
