"""What each setup of a bench block leaves, so that the last one leaves the drawing.

A face that is ground after a hole is drilled takes the depth of the hole with it, and a face that
is lapped takes the leg of its edge breaks. So a setup accepts what stays within the drawing after
all that later setups take off, at worst.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from stepblocks.parts.body import Block, Mounting
from stepblocks.parts.kinds.step_block import get_second_step
from stepblocks.parts.stock import compute_stock_corners
from stepblocks.parts.tolerance import GUARD_FACTOR, Dimension

# left on base and working faces after milling; it also takes what hardening warps [m]
GRINDING = 0.3e-3
# standard uncertainty of a length between two touches on the machine; assumed, state yours [m]
PROBE = 2.5e-6
GUARD = GUARD_FACTOR * PROBE  # taken off either limit of what a measured value may be [m]
_MILLING = 0.05e-3  # deviation of a milled height that nothing else depends on [m]
_MOST_LAPPED = 20e-6  # off the working faces after grinding, at most [m]
_LEAST_LAPPED = 4e-6  # what lapping takes off cannot be foretold more closely [m]
_MOST_GROUND_SPREAD = 50e-6  # of what is ground off the base, to either side [m]
_LEAST_GROUND_SPREAD = 7e-6  # what a grinder and a micrometer hold [m]
# shares of the tolerance of a depth that what is ground off the base may take, and the thickness of
# a counterbored block
_GROUND_SHARE = 0.2
_THICKNESS_SHARE = 0.4
_LEAST_ACCEPTED = 4e-6  # width of accepted limits below which nobody can work to them [m]
_JAWS = 3e-3  # of the stock in the jaws, at most [m]
_JAWS_SHARE = 1.0 / 3.0  # of the height of the stock in the jaws, at most


@dataclass(frozen=True)
class Band:
    """Values from the least to the largest [m]."""

    low: float
    high: float

    @classmethod
    def around(cls, middle: float, half_width: float) -> "Band":
        """Return the values within a half-width of a middle [m]."""
        return cls(middle - half_width, middle + half_width)

    @classmethod
    def from_dimension(cls, dimension: Dimension) -> "Band":
        """Return what the limits of a dimension permit."""
        return cls(*dimension.limits)

    @property
    def middle(self) -> float:
        """Middle of the band [m]."""
        return 0.5 * (self.low + self.high)

    @property
    def half_width(self) -> float:
        """Half of its width [m]; negative of an empty one."""
        return 0.5 * (self.high - self.low)

    def add_band(self, band: "Band") -> "Band":
        """Return the band of all sums with the values of another band."""
        return Band(self.low + band.low, self.high + band.high)

    def limit_half_width(self, half_width: float) -> "Band":
        """Return the band about the same middle, no wider than a half-width to either side."""
        return Band.around(self.middle, min(self.half_width, half_width))


@dataclass(frozen=True)
class SetupDimension:
    """A dimension that a setup leaves, with limits that later setups turn into the drawing's."""

    setup: int
    key: str
    label: str
    limits: Band  # of the true value [m]
    is_least: bool = False  # only the lower limit matters

    @property
    def acceptance_band(self) -> Band | None:
        """What a measured value may be [m]: within the limits by the guard band (ISO 14253-1).

        None where too little is left to work to.
        """
        band = Band(self.limits.low + GUARD, self.limits.high - GUARD)
        if not self.is_least and band.high - band.low < _LEAST_ACCEPTED:
            return None
        return band


@dataclass(frozen=True)
class Allowances:
    """What is left on a milled block, and in the jaws [m]."""

    base: float  # on the base, to be ground off
    top: float  # on the upper side over the higher working face, to be ground off
    mills_base: bool  # whether the stock has more on the base than is ground off
    mills_top: bool
    jaws: float  # height of the stock that the jaws of the first setup hold


@dataclass(frozen=True)
class _Drops:
    """How far the working faces lie below the highest one [m]."""

    left: Band
    right: Band
    between: Band | None = None  # of the face between two edges


_NO_DROP = Band(0.0, 0.0)


def compute_allowances(block: Block) -> Allowances:
    """Compute what milling leaves on a block; a tight stock leaves less to grind."""
    low, high = compute_stock_corners(block)
    on_base = max(block.body.base - low[2], 0.0)
    on_top = max(high[2] - block.highest, 0.0)
    jaws = min(_JAWS, _JAWS_SHARE * (high[2] - low[2]))
    return Allowances(
        base=min(GRINDING, on_base),
        top=min(GRINDING, on_top),
        mills_base=on_base > GRINDING,
        mills_top=on_top > GRINDING,
        jaws=jaws,
    )


def list_dimensions_left_by_setups(block: Block) -> list[SetupDimension]:
    """List what the setups of a block must leave, in the order of the setups.

    Parameters
    ----------
    block : Block
        What is made.

    Returns
    -------
    list of LeftDimension
        Depths of holes from faces that are still to be ground, what is ground off, the thickness
        as ground, and the legs of edge breaks on faces that are still to be lapped.
    """
    allowances = compute_allowances(block)
    lapped = find_lapping_removal(block)
    ground = _find_base_grinding_removal(block, allowances)
    thickness = _find_working_thickness(block)
    mounting = block.body.mounting
    lines: list[SetupDimension] = []
    if mounting is not None and mounting.kind == "tapped":
        lines += _yield_core_hole_dimensions(mounting, ground)
    if allowances.mills_top:
        milled = Band.around(block.sides[2] + allowances.base + allowances.top, _MILLING)
        lines.append(SetupDimension(2, "milled_height", "height over both milled faces", milled))
    label = "thickness over both ground faces"
    as_ground = SetupDimension(
        4, "ground_thickness", label, _find_ground_thickness(block, thickness, lapped)
    )
    if mounting is not None and mounting.kind == "clearance":
        floor = _find_counterbore_floor(mounting, thickness, ground)
        if (
            as_ground.acceptance_band is None
        ):  # the depth is measured from a face that nobody can hold
            floor = Band.around(floor.middle, 0.0)
        label = "floor of the counterbores over the milled base"
        lines.append(SetupDimension(2, "counterbore_floor", label, floor))
    if allowances.base > 0.0:
        lines.append(SetupDimension(4, "ground_off_base", "ground off the base", ground))
    lines.append(as_ground)
    if block.body.edge_break.nominal > 0.0:
        lines += _yield_edge_break_dimensions(block, lapped)
    return lines


def _compute_face_drops(block: Block) -> _Drops:
    """Find how far each working face lies below the highest one."""
    height: Dimension = getattr(block, block.governing_field)
    low, high = height.limits
    left = Band(max(low, 0.0), max(high, 0.0))
    right = Band(max(-high, 0.0), max(-low, 0.0))
    second = get_second_step(block)
    if second is None:
        return _Drops(left, right)
    further = Band.from_dimension(second.height)
    if second.direction == "up":
        return _Drops(left.add_band(further), _NO_DROP, between=further)
    return _Drops(left, further, between=_NO_DROP)


def _find_working_thickness(block: Block) -> Band:
    """Find the thickness to work to [m]; the depth of counterbores is measured from its far end."""
    limits = Band.from_dimension(block.body.thickness)
    mounting = block.body.mounting
    if mounting is None or mounting.kind != "clearance":
        return limits
    return limits.limit_half_width(
        _THICKNESS_SHARE * Band.from_dimension(mounting.depth).half_width
    )


def find_lapping_removal(block: Block) -> Band:
    """Find what lapping may take off the higher working face [m].

    It may take a quarter of the tolerance of the thickness, and half of that of the edge breaks
    beside it.
    """
    most_lapped = min(_MOST_LAPPED, 0.5 * _find_working_thickness(block).half_width)
    if block.body.edge_break.nominal > 0.0:
        of_edge_break = Band.from_dimension(block.body.edge_break).half_width
        most_lapped = min(most_lapped, of_edge_break)
    return Band(0.0, max(most_lapped, _LEAST_LAPPED))


def _find_base_grinding_removal(block: Block, allowances: Allowances) -> Band:
    """Find what may be ground off the base [m]: a share of the tolerance of the holes in it."""
    spread = _MOST_GROUND_SPREAD
    mounting = block.body.mounting
    if mounting is not None:
        share = _GROUND_SHARE * Band.from_dimension(mounting.depth).half_width
        spread = min(spread, max(share, _LEAST_GROUND_SPREAD))
    return Band.around(allowances.base, min(spread, allowances.base))


def _yield_core_hole_dimensions(mounting: Mounting, ground_off: Band) -> Iterator[SetupDimension]:
    """Yield depth of core holes and threads from the base as it is drilled, before it is ground."""
    depth = Band.from_dimension(mounting.depth)
    drilled = Band(depth.low + ground_off.high, depth.high + ground_off.low)
    yield SetupDimension(1, "drilled_depth", "depth of the core holes", drilled)
    least = Band(mounting.thread_depth + ground_off.high, math.inf)
    yield SetupDimension(1, "tapped_depth", "full thread, at least", least, is_least=True)


def _find_ground_thickness(block: Block, thickness: Band, lapped_off: Band) -> Band:
    """Find the thickness over base and higher face before anything is lapped [m]."""
    over_left = _compute_face_drops(block).left.add_band(lapped_off)
    return Band(thickness.low + over_left.high, thickness.high + over_left.low)


def _find_counterbore_floor(mounting: Mounting, thickness: Band, ground_off: Band) -> Band:
    """Find how far the floor of the counterbores lies over the base before it is ground [m].

    The depth of a counterbore is the thickness less this floor after grinding.
    """
    depth = Band.from_dimension(mounting.depth)
    lowest = thickness.high + ground_off.high - depth.high
    highest = thickness.low + ground_off.low - depth.low
    return Band(lowest, highest)


def _yield_edge_break_dimensions(block: Block, lapped_off: Band) -> Iterator[SetupDimension]:
    """Yield the legs of edge breaks on faces that are ground, and still to be lapped or cut."""
    leg = Band.from_dimension(block.body.edge_break)
    yield SetupDimension(5, "edge_break_base", "leg at the base and of upright edges", leg)
    drops = _compute_face_drops(block)
    edge = "working edge" if drops.between is None else "first edge"
    last_edge = "working edge" if drops.between is None else "second edge"
    sides = [("left", f"left of the {edge}", drops.left)]
    if drops.between is not None:
        sides.append(("between", "between both edges", drops.between))
    sides.append(("right", f"right of the {last_edge}", drops.right))
    for side, place, drop in sides:
        taken_off = drop.add_band(lapped_off)
        limits = Band(leg.low + taken_off.high, leg.high + taken_off.low)
        label = f"leg at the upper side, {place}"
        yield SetupDimension(5, f"edge_break_{side}", label, limits)
