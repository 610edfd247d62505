"""The probe tip: a ball of radius R on a cone and a shank, straight or bent to a shepherd's hook."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pydantic import model_validator

from stepblocks.errors import ContactError
from stepblocks.parts.body import Identity, MaterialField, Part, require
from stepblocks.parts.energy_tolerance import EnergyToleranceField, require_energy_tolerance
from stepblocks.parts.tolerance import Angle, FeltPositiveLength, PositiveLength
from stepblocks.quantities import format_quantity

if TYPE_CHECKING:
    from stepblocks.contact.counterface import Counterface


class _Tip(Part):
    """What both forms share. The ball touches the origin from above: its centre lies at z = R, the cone widens upwards."""

    id: Identity  # Identity
    ball_radius: FeltPositiveLength  # Radius R of the contact sphere [m]
    cone_angle: Angle  # Half angle of the cone, tangent to the ball [rad]
    shank_radius: PositiveLength  # Radius of the shank at the end of the cone [m]
    material: MaterialField  # What it is made of
    # How much the vibration energy may vary on the steps of the set, where the ball's tolerance shall follow from it
    energy_tolerance: EnergyToleranceField | None = None

    def counterface(self, step_height: float | None = None) -> Counterface:
        """Answer a sharp step under the tip."""
        from stepblocks.contact.counterface import Step

        if step_height is None:
            raise ContactError(f"the height of the step under the probe must be given, got none [{self.id}]")
        return Step(step_height)

    @property
    def cone_start(self) -> tuple[float, float]:
        """Radius and height at which the cone leaves the ball, tangent to it [m]."""
        R, half = self.ball_radius.nominal, self.cone_angle.nominal
        return R * math.cos(half), R * (1.0 - math.sin(half))

    @property
    def cone_end(self) -> float:
        """Height at which the cone has the radius of the shank [m]."""
        radius, height = self.cone_start
        return height + (self.shank_radius.nominal - radius) / math.tan(self.cone_angle.nominal)

    @model_validator(mode="after")
    def _is_possible(self) -> _Tip:
        R, shank, half = self.ball_radius.nominal, self.shank_radius.nominal, self.cone_angle.nominal
        require_energy_tolerance(self.energy_tolerance, {"ball_radius": self.ball_radius}, False)
        if self.energy_tolerance is not None and self.energy_tolerance.ball_radius is not None:
            raise ValueError("energy_tolerance.ball_radius is for blocks; a tip states it in ball_radius itself")
        if not 0.0 < half < 0.25 * math.pi:
            raise ValueError(f"cone_angle must lie between 0 and 45 deg, got {format_quantity(half, 'angle')}")
        require(shank > R, "ball_radius", "be smaller than shank_radius", shank, R)
        return self


class StraightTip(_Tip):
    """Ball, cone and cylindrical shank on one axis."""

    length: PositiveLength  # From the contact point to the end of the shank [m]

    @model_validator(mode="after")
    def _has_a_shank(self) -> StraightTip:
        require(
            self.length.nominal > self.cone_end,
            "length",
            "exceed the end of the cone",
            self.cone_end,
            self.length.nominal,
        )
        return self


class HookTip(_Tip):
    """The shepherd's hook: ball and cone, then a wire bent in one arc, then the straight shank."""

    bend_radius: PositiveLength  # Radius of the bend at the wire's axis [m]
    bend_angle: Angle  # Angle through which the wire is bent [rad], in degrees up to below 180
    straight_length: PositiveLength  # Length of the shank beyond the bend [m]

    @model_validator(mode="after")
    def _can_be_bent(self) -> HookTip:
        if self.bend_angle.nominal <= 0.0:
            raise ValueError("bend_angle must be above 0 deg, got 0 deg")
        shank, bend = self.shank_radius.nominal, self.bend_radius.nominal
        require(bend > shank, "bend_radius", "exceed shank_radius", shank, bend)
        angle, straight = self.bend_angle.nominal, self.straight_length.nominal
        end = self.cone_end + bend * math.sin(angle) + straight * math.cos(angle)
        lowest = end - shank * math.sin(angle)
        if lowest <= 0.0:
            raise ValueError(
                f"bend_angle must keep the shank above the contact point, got {format_quantity(angle, 'angle')}, "
                f"which brings it to {format_quantity(lowest, 'length')}"
            )
        return self
