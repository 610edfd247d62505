"""Under what the parts of a set are felt: tips, loads, frictions and steps, the tool, the probe that wears a sheath, its rig."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import BeforeValidator, Field

from stepblocks.contact.operating_point import PAPER
from stepblocks.parts.declared import (
    SourcedDensity,
    SourcedFrequency,
    SourcedLength,
    SourcedModulus,
    SourcedRatio,
    SourcedStiffness,
    SourcedTime,
    Table,
)
from stepblocks.quantities import parse_quantity

if TYPE_CHECKING:
    from stepblocks.contact.rod import Rod, RodRing, Sleeve


def _positive(dimension: str) -> BeforeValidator:
    def parse(raw: object) -> float:
        value = parse_quantity(raw, dimension)
        if value <= 0.0:
            raise ValueError(f"must be positive, got {raw!r}")
        return value

    return BeforeValidator(parse)


def at_least_zero(dimension: str) -> BeforeValidator:
    """Read a quantity that may be zero."""

    def parse(raw: object) -> float:
        value = parse_quantity(raw, dimension)
        if value < 0.0:
            raise ValueError(f"must not be negative, got {raw!r}")
        return value

    return BeforeValidator(parse)


class ToolSpec(Table):
    """The explorer as a spring that rings; what is left out is the paper's."""

    stiffness: Annotated[float, _positive("stiffness")] = PAPER.tool.stiffness  # tangential, k [N/m]
    conversion: Annotated[float, _positive("ratio")] = PAPER.tool.conversion  # C_v [1]
    ring_duration: Annotated[float, _positive("time")] = PAPER.tool.ring_duration  # s
    detection_threshold: Annotated[float, _positive("power")] = PAPER.tool.detection_threshold  # W


class SettingTolerances(Table):
    """How far what is not on a drawing may be off, to either side; what is left out is taken as known."""

    tip_radius: Annotated[float, at_least_zero("length")] = 0.0  # of the tips of `PredictionGrid.tip_radii` [m]
    friction: Annotated[float, at_least_zero("ratio")] = 0.0  # 1
    normal_load: Annotated[float, at_least_zero("ratio")] = 0.0  # as a share of the load [1]
    stiffness: Annotated[float, at_least_zero("ratio")] = 0.0  # as a share of the stiffness [1]
    conversion: Annotated[float, at_least_zero("ratio")] = 0.0  # as a share of C_v [1]


class PredictionGrid(Table):
    """Conditions under which each stimulus is predicted: every combination of tip, load and friction."""

    tip_radii: Annotated[tuple[Annotated[float, _positive("length")], ...], Field(max_length=100)] = ()  # R [m]
    # F_py [N]
    normal_loads: Annotated[tuple[Annotated[float, _positive("force")], ...], Field(min_length=1, max_length=100)]
    # mu [1]
    frictions: Annotated[tuple[Annotated[float, at_least_zero("ratio")], ...], Field(min_length=1, max_length=100)]
    # H of the sharp steps on which tips and sheaths are predicted [m]
    step_heights: Annotated[tuple[Annotated[float, _positive("length")], ...], Field(max_length=100)] = ()
    tool: ToolSpec = ToolSpec()
    tolerances: SettingTolerances = SettingTolerances()


class ProbeSpec(Table):
    """The probe as a clamped rod with a mass at its tip; its free length follows from the stiffness, the mass from the frequency."""

    stiffness: SourcedStiffness  # of the tip along the drag
    frequency: SourcedFrequency  # at which it rings
    decay_time: SourcedTime  # in which its amplitude falls to 1/e
    shank_diameter: SourcedLength
    modulus: SourcedModulus  # Young's modulus of the rod
    density: SourcedDensity  # of the rod

    def rod(self) -> Rod:
        """Return the rod that it is taken for."""
        from stepblocks.contact.rod import rod_for

        return rod_for(
            self.stiffness.value,
            self.frequency.value,
            self.decay_time.value,
            self.shank_diameter.value,
            self.modulus.value,
            self.density.value,
        )

    def ring(self, *sleeves: Sleeve) -> RodRing:
        """Predict how it rings, bare or with sleeves on its shank."""
        from stepblocks.contact.rod import ring_of

        return ring_of(self.rod(), sleeves)


class DampingRig(Table):
    """The rig that moves a tip by a fixed distance and lets it go."""

    displacement: SourcedLength  # that distance
    noise: SourcedLength  # standard deviation of one sample of the displacement
    sample_rate: SourcedFrequency
    uncertainty: SourcedRatio  # relative standard uncertainty wanted of the logarithmic decrement
