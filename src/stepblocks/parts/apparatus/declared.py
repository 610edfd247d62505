"""What a stimulus file declares of the apparatus: every dimension is chosen there."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from stepblocks.parts.declared import (
    Identity,
    Sourced,
    Table,
    describe_breach,
    make_positive_validator,
    make_rules_validator,
    make_sourced_validator,
)
from stepblocks.parts.tolerance import PositiveLength

_Ratio = Annotated[Sourced, make_sourced_validator("ratio")]
# of weights [kg]
_Masses = Annotated[
    tuple[Annotated[float, make_positive_validator("mass")], ...],
    Field(min_length=1, max_length=50),
]

LARGEST_TRAVEL = 14e-3  # at which the hook of the cord is clear of block and portal [m]
ENDS_OF_THE_LEAVES = 30e-3  # length of the ends between which the leaves stand [m]
_WIDTH_OF_THE_ENDS = 20e-3  # [m]
_THICKEST_LEAF = 0.1  # share of its length, up to which it bends as a beam
# by which the slide of the damping rig may lift the shank that lies on it [m]
_LARGEST_LIFT = 1e-3
_LARGEST_MASS = 0.2  # of a weight that finds room on the explorer [kg]


class Flexure(Table):
    """Two parallel leaves, clamped at both ends, that bend along the drag.

    Four gauges at their roots make a full bridge.

    Attributes
    ----------
    length : Dimension
        Of a leaf between its ends [m].
    width : Dimension
        Along the edge [m].
    thickness : Dimension
        Along the drag [m].
    spacing : Dimension
        From the middle of one leaf to that of the other [m].
    gauge_place : Dimension
        Middle of a gauge from the end of its leaf [m].
    modulus : Sourced
        Young's [Pa].
    poisson : Sourced
        [1].
    gauge_factor : Sourced
        Change of resistance over strain [1].
    """

    length: PositiveLength
    width: PositiveLength
    thickness: PositiveLength
    spacing: PositiveLength
    gauge_place: PositiveLength
    modulus: Annotated[Sourced, make_sourced_validator("pressure")]
    poisson: _Ratio
    gauge_factor: _Ratio

    @make_rules_validator
    def _yield_size_breaches(self) -> Iterator[str]:
        """Yield what keeps the leaves from bending as beams, or from their ends."""
        length = self.length.nominal
        thickness = self.thickness.nominal
        thickest = _THICKEST_LEAF * length
        if thickness > thickest:
            rule = "be at most a tenth of length, so that a leaf bends as a beam"
            yield describe_breach("thickness", rule, thickest, thickness)
        widest = ENDS_OF_THE_LEAVES - thickness
        if self.spacing.nominal >= widest:
            rule = "be less than the ends of the leaves have room for"
            yield describe_breach("spacing", rule, widest, self.spacing.nominal)
        if self.spacing.nominal <= thickness:
            rule = "exceed thickness"
            yield describe_breach("spacing", rule, thickness, self.spacing.nominal)
        if self.width.nominal >= _WIDTH_OF_THE_ENDS:
            rule = "be less than the width of the ends"
            yield describe_breach("width", rule, _WIDTH_OF_THE_ENDS, self.width.nominal)
        half = 0.5 * length
        if self.gauge_place.nominal >= half:
            rule = "be less than half of length"
            yield describe_breach("gauge_place", rule, half, self.gauge_place.nominal)


class Friction(Table):
    """What bearings take, as coefficients.

    Attributes
    ----------
    pivot, pulley : Sourced
        Of their ball bearings, at half of the bore [1].
    carriage : Sourced
        Of the linear ball bearings, of the weight that they carry [1].
    """

    pivot: _Ratio
    pulley: _Ratio
    carriage: _Ratio


class Apparatus(Table):
    """The kit of the drag rig and of the damping rig.

    Attributes
    ----------
    id : str
        Name of the kit, in lower case.
    travel : Dimension
        Of the tip, half of it to either side of the edge [m].
    flexure : Flexure
        Leaves that bend along the drag.
    friction : Friction
        Of the bearings.
    normal_weights, pulling_weights : tuple of float
        Masses that press the tip on the block and that hang on the cord [kg].
    weight_tolerance : Sourced
        Largest relative deviation of a weight [1].
    weight_offset : Dimension
        How far off the tip, along the arm, a weight on the explorer may stand [m].
    balance : Dimension
        How far off its place the counterweight may be set [m].
    gravity : Sourced
        Acceleration [m/s^2].
    gravity_tolerance : Sourced
        Largest relative deviation of it at the place of use [1].
    displacement : Sourced
        By which the slide of the damping rig lifts the shank before it lets it go [m].
    """

    id: Identity
    travel: PositiveLength
    flexure: Flexure
    friction: Friction
    normal_weights: _Masses
    pulling_weights: _Masses
    weight_tolerance: _Ratio
    weight_offset: PositiveLength
    balance: PositiveLength
    gravity: Annotated[Sourced, make_sourced_validator("acceleration")]
    gravity_tolerance: _Ratio
    displacement: Annotated[Sourced, make_sourced_validator("length")]

    def record(self) -> dict[str, object]:
        """Write it out in full for JSON, with the unit in the name of every field."""
        fields = super().record()
        for name in ("normal_weights", "pulling_weights"):
            fields[f"{name}_kg"] = fields.pop(name)
        return fields

    @make_rules_validator
    def _yield_size_breaches(self) -> Iterator[str]:
        """Yield what has no room in the rig."""
        if self.travel.nominal > LARGEST_TRAVEL:
            rule = "keep the hook of the cord clear of block and portal"
            yield describe_breach("travel", rule, LARGEST_TRAVEL, self.travel.nominal)
        if self.displacement.value > _LARGEST_LIFT:
            rule = "leave the shank in its clamp"
            yield describe_breach("displacement", rule, _LARGEST_LIFT, self.displacement.value)
        heaviest = max(self.normal_weights)
        if heaviest > _LARGEST_MASS:
            yield (
                f"normal_weights must find room on the explorer ({_LARGEST_MASS * 1e3:g} g), got "
                f"{heaviest * 1e3:g} g"
            )
