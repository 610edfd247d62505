"""A step that is the difference of two gauge blocks.

It is the route where one piece cannot hold the height.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

from stepblocks import cad
from stepblocks.artefacts.step.write import write_conforming
from stepblocks.cad.pmi import PmiDimension, PmiItem
from stepblocks.errors import MachiningError
from stepblocks.parts.body import Body, make_body_cuts
from stepblocks.parts.kinds.step_block import StepBlock

# ISO 3650:1998, table 5, up to 10 mm: limit deviation of length anywhere, and tolerance of its
# variation, in metres.
GRADES: dict[str, tuple[float, float]] = {
    "K": (0.20e-6, 0.05e-6),
    "0": (0.12e-6, 0.10e-6),
    "1": (0.20e-6, 0.16e-6),
    "2": (0.45e-6, 0.30e-6),
}

_COUNTS = (10005, *range(10010, 10100, 10), *range(10100, 15000, 100), *range(5000, 100001, 5000))
STANDARD_SET: tuple[float, ...] = tuple(count / 1e7 for count in _COUNTS)

# thickness that a wrung joint may add, either block [m]; gauge makers state 0.005 to 0.02 um
WRINGING = 0.02e-6
RIM = 5e-3  # of the base around the gauge blocks, at least [m]
SECTION = (30e-3, 9e-3)  # section of a gauge block up to 10 mm (ISO 3650) [m]


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


def choose_pair(height: float, grade: str = "0") -> GaugePair:
    """Choose the pair of a standard set whose difference is a height."""
    MachiningError.require(
        grade in GRADES, f"grade must be one of {', '.join(GRADES)}, got {grade!r}"
    )
    deviation, variation = GRADES[grade]
    pairs = (
        (a, b)
        for a in sorted(STANDARD_SET)
        if a >= 1e-3
        for b in STANDARD_SET
        if abs(b - a - height) < 1e-9
    )
    if (pair := next(pairs, None)) is None:
        raise MachiningError(
            f"height must be a difference of two gauge blocks of the set, got {height * 1e3:.6g} mm"
        )
    # half of the variation: length is stated at the middle, the edge lies beside it
    parts = [deviation] * 2 + [0.5 * variation] * 2 + [WRINGING] * 2
    expected = 2.0 * math.sqrt(sum(part * part / 3.0 for part in parts))
    return GaugePair(*pair, grade, sum(parts), min(expected, sum(parts)))


def choose_base(block: StepBlock, pair: GaugePair) -> Body:
    """Choose the base: the body that is asked for, enlarged where the gauge blocks need it.

    Base and lower gauge block together are as thick as the body, where 3 mm are left for the
    base and its holes keep their depth.
    """
    body = block.body
    long, wide = SECTION
    sizes: dict[str, object] = {
        name: replace(size, nominal=max(size.nominal, least))
        for name, size, least in (
            ("length", body.length, 2.0 * (wide + RIM)),
            ("width", body.width, long + 2.0 * RIM),
        )
    }
    thick = body.thickness.nominal - pair.lower
    deep = 3e-3 if body.mounting is None else max(3e-3, 1.4 * body.mounting.depth.nominal)
    if body.mounting is not None and body.mounting.kind == "clearance":
        sizes["mounting"] = None  # the gauge blocks would cover a screw from above
    return body.model_copy(
        update={
            **sizes,
            "thickness": replace(
                body.thickness, nominal=thick if thick >= deep else body.thickness.nominal
            ),
        }
    )


def write_gauge_assembly(path: Path, block: StepBlock, pair: GaugePair) -> None:
    """Write base and gauge blocks as a STEP file of three parts.

    Edge and lower face lie as in the one-piece block.
    """
    long, wide = SECTION
    floor = -pair.lower
    half = 0.5 * long
    body = choose_base(block, pair)
    sides = body.half_length, body.half_width
    plain = cad.kernel.make_box((-sides[0], -sides[1], body.base), (*sides, 0.0))
    cuts = make_body_cuts(body, block.id, 0.0)
    base = cad.kernel.cut(plain, cuts) if cuts else plain
    pieces = [f"{length * 1e3:.4f}".replace(".", "p") + "mm" for length in (pair.lower, pair.upper)]
    bodies = [
        (f"{block.id}-base", cad.kernel.move(base, (0.0, 0.0, floor))),
        (
            f"gauge-block-{pieces[0]}",
            cad.kernel.make_box((-wide, -half, floor), (0.0, half, 0.0)),
        ),
        (
            f"gauge-block-{pieces[1]}",
            cad.kernel.make_box((0.0, -half, floor), (wide, half, pair.upper - pair.lower)),
        ),
    ]
    deviation, _ = GRADES[pair.grade]
    dimensions, tops = [], []
    for index, length in ((1, pair.lower), (2, pair.upper)):
        bottom, top = (
            PmiItem(index, face) for face in cad.kernel.find_end_faces(bodies[index][1], 2)
        )
        dimensions.append(
            (
                f"length of gauge block {pieces[index - 1]}",
                PmiDimension("distance", (bottom, top), length, -deviation, deviation),
            )
        )
        tops.append(top)
    height = block.height
    write_conforming(
        path,
        f"{block.id}-gauge",
        bodies,
        block.material,
        [
            *dimensions,
            (
                "step height",
                PmiDimension(
                    "distance", (tops[0], tops[1]), height.nominal, height.lower, height.upper
                ),
            ),
        ],
    )
