"""A step that is the difference of two gauge blocks, wrung onto a base.

It is the route where a block in one piece cannot hold the height.
"""

import math
from dataclasses import dataclass, replace

from stepblocks import cad
from stepblocks.errors import MachiningError
from stepblocks.parts.body import Body
from stepblocks.parts.body_solid import WorkingFace, make_body_cuts
from stepblocks.parts.kinds.step_block import StepBlock


@dataclass(frozen=True)
class Grade:
    """Limits of a grade of gauge blocks up to 10 mm (ISO 3650:1998, table 5) [m]."""

    deviation: float  # largest deviation of the length, anywhere on the face, to either side
    variation: float  # tolerance of the variation of the length


GRADES: dict[str, Grade] = {
    "K": Grade(0.20e-6, 0.05e-6),
    "0": Grade(0.12e-6, 0.10e-6),
    "1": Grade(0.20e-6, 0.16e-6),
    "2": Grade(0.45e-6, 0.30e-6),
}

# lengths of the set of 112 pieces, in tenths of a micrometre
_COUNTS = (10005, *range(10010, 10100, 10), *range(10100, 15000, 100), *range(5000, 100001, 5000))
STANDARD_SET: tuple[float, ...] = tuple(count / 1e7 for count in _COUNTS)  # [m]

# thickness that a wrung joint may add, either block [m]; gauge makers state 0.005 to 0.02 um
WRINGING = 0.02e-6
SHORTEST = 1e-3  # length of the lower block, at least [m]
RIM = 5e-3  # of the base around the gauge blocks, at least [m]
SECTION_LENGTH = 30e-3  # section of a gauge block up to 10 mm (ISO 3650) [m]
SECTION_WIDTH = 9e-3
_SAME_LENGTH = 1e-9  # difference within which a pair gives the height [m]
_THINNEST_BASE = 3e-3  # [m]
_HOLE_COVER = 1.4  # thickness of the base over the depth of its holes, at least


@dataclass(frozen=True)
class GaugePair:
    """Two gauge blocks whose difference is a step."""

    lower: float  # length [m]
    upper: float  # length [m]
    grade: str  # of the set
    # largest deviation of the step that the grade, its variation and the wringing allow [m]
    worst: float
    # root sum of squares of the same as rectangular laws, times 2: 95 % of the pairs lie within [m]
    expected: float


def find_gauge_pair(height: float, grade: str = "0") -> GaugePair | None:
    """Find the pair of a standard set whose difference is a height [m], if there is one.

    Raises
    ------
    MachiningError
        If the grade is not one of ISO 3650.
    """
    if grade not in GRADES:
        raise MachiningError(f"grade must be one of {', '.join(GRADES)}, got {grade!r}")
    for lower in sorted(STANDARD_SET):
        if lower < SHORTEST:
            continue
        for upper in STANDARD_SET:
            if abs(upper - lower - height) < _SAME_LENGTH:
                return _make_gauge_pair(lower, upper, grade)
    return None


def require_gauge_pair(height: float, grade: str = "0") -> GaugePair:
    """Choose the pair of a standard set whose difference is a height [m].

    Raises
    ------
    MachiningError
        If no pair has this difference, or the grade is not one of ISO 3650.
    """
    pair = find_gauge_pair(height, grade)
    if pair is None:
        raise MachiningError(
            f"height must be a difference of two gauge blocks of the set, got {height * 1e3:.6g} mm"
        )
    return pair


def _make_gauge_pair(lower: float, upper: float, grade: str) -> GaugePair:
    """Make a pair, with what its lengths, their variations and the wringing add to the step."""
    limits = GRADES[grade]
    # half of the variation: the length is stated at the middle, the edge lies beside it
    edge_variation = 0.5 * limits.variation
    half_widths = [
        limits.deviation,
        limits.deviation,
        edge_variation,
        edge_variation,
        WRINGING,
        WRINGING,
    ]
    worst = sum(half_widths)
    variance = sum(half_width * half_width / 3.0 for half_width in half_widths)
    expected = 2.0 * math.sqrt(variance)
    return GaugePair(lower, upper, grade, worst, min(expected, worst))


def make_gauge_base(block: StepBlock, pair: GaugePair) -> Body:
    """Make the base of a pair: the body of the block, enlarged where the gauge blocks need it.

    Base and lower gauge block together are as thick as the body, where 3 mm are left for the
    base and its holes keep their depth.
    """
    body = block.body
    least_length = 2.0 * (SECTION_WIDTH + RIM)
    least_width = SECTION_LENGTH + 2.0 * RIM
    length = replace(body.length, nominal=max(body.length.nominal, least_length))
    width = replace(body.width, nominal=max(body.width.nominal, least_width))
    mounting = body.mounting
    least_thickness = _THINNEST_BASE
    if mounting is not None:
        least_thickness = max(_THINNEST_BASE, _HOLE_COVER * mounting.depth.nominal)
        if mounting.kind == "clearance":
            mounting = None  # the gauge blocks would cover a screw from above
    thickness = body.thickness
    left = thickness.nominal - pair.lower
    if left >= least_thickness:
        thickness = replace(thickness, nominal=left)
    changes = {"length": length, "width": width, "thickness": thickness, "mounting": mounting}
    return body.model_copy(update=changes)


@dataclass(frozen=True)
class GaugeAssembly:
    """Base and gauge blocks as solids; edge and lower face lie as in the block in one piece."""

    names: tuple[str, str, str]  # of base, lower and upper gauge block
    solids: tuple[cad.door.Body, cad.door.Body, cad.door.Body]


def build_gauge_assembly(block: StepBlock, pair: GaugePair) -> GaugeAssembly:
    """Build base and gauge blocks of a step block.

    Parameters
    ----------
    block : StepBlock
        The block in one piece.
    pair : GaugePair
        Gauge blocks whose difference is its height.

    Returns
    -------
    GaugeAssembly
        Three solids in the frame of the block.

    Raises
    ------
    SolidError
        If an operation of the kernel does not give one valid solid.
    """
    floor = -pair.lower
    half = 0.5 * SECTION_LENGTH
    base = _build_base_solid(make_gauge_base(block, pair), block.id)
    lower = cad.kernel.make_box((-SECTION_WIDTH, -half, floor), (0.0, half, 0.0))
    upper = cad.kernel.make_box((0.0, -half, floor), (SECTION_WIDTH, half, pair.upper - pair.lower))
    return GaugeAssembly(
        (
            f"{block.id}-base",
            f"gauge-block-{format_gauge_length(pair.lower)}",
            f"gauge-block-{format_gauge_length(pair.upper)}",
        ),
        (cad.kernel.move(base, (0.0, 0.0, floor)), lower, upper),
    )


def _build_base_solid(body: Body, identity: str) -> cad.door.Body:
    """Build a body with level upper side at z = 0, with its holes, edges and engraving."""
    low = (-body.half_length, -body.half_width, body.base)
    high = (body.half_length, body.half_width, 0.0)
    plain = cad.kernel.make_box(low, high)
    cuts = make_body_cuts(body, identity, [WorkingFace(0.0, 0.0)])
    if not cuts:
        return plain
    return cad.kernel.cut(plain, cuts)


def format_gauge_length(length: float) -> str:
    """Write the length of a gauge block [m] for names of solids and dimensions: ``1p0050mm``."""
    millimetres = f"{length * 1e3:.4f}".replace(".", "p")
    return f"{millimetres}mm"
