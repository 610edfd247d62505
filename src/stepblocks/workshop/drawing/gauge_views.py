"""The drawing of the two-piece block: base, two gauge blocks wrung onto it, and the step that is their difference."""

from __future__ import annotations

from stepblocks.artefacts.numbers import limits_text, millimetres
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.drawing.block_views import round_scale
from stepblocks.workshop.drawing.sheet import Sheet
from stepblocks.workshop.gauge_route import GRADES, GaugePair


def gauge_sheet(block: StepBlock, pair: GaugePair) -> Sheet:
    """Draw the assembly of a two-piece block."""
    sheet = Sheet()
    s = 4.0
    cx, cz = 130.0, 215.0
    wide, rim, thick, low = 9.0 * s, 5.0 * s, block.body.thickness.nominal * 1e3 * s, pair.lower * 1e3 * s
    high = pair.upper * 1e3 * s
    base = cz - low
    sheet.rectangle((cx - wide - rim, base - thick), (cx + wide + rim, base))
    sheet.rectangle((cx - wide, base), (cx, cz))
    sheet.rectangle((cx, base), (cx + wide, base + high))
    for number, x, y, name in (
        (1, cx - 0.5 * wide, base - 0.5 * thick, "base"),
        (2, cx - 0.5 * wide, base + 0.5 * low, "lower"),
        (3, cx + 0.5 * wide, base + 0.5 * high, "upper"),
    ):
        at = (x - 22.0 if number < 3 else x + 22.0, cz + (12.0 if number > 1 else -low - thick - 14.0))
        sheet.leader((x, y), at, f"part {number}, {name}")
    sheet.text((cx, base - thick - 24.0), f"section {s:g}:1", 2.5, "BOTTOM_CENTER")
    step = Characteristic(
        "step_height", "step height", "distance", block.height.nominal, block.height.lower, block.height.upper
    )
    zs = round_scale(40.0 / (block.height.nominal * 1e3))
    dx, dz = 320.0, 205.0
    top = dz + block.height.nominal * 1e3 * zs
    sheet.polyline([(dx - 50.0, dz), (dx, dz), (dx, top), (dx + 50.0, top)])
    sheet.line((dx, dz), (dx, dz - 10.0))
    sheet.break_line(dx - 50.0, dz - 10.0, dz)
    sheet.break_line(dx + 50.0, dz - 10.0, top)
    sheet.dimension(1, step, (dx - 26.0, dz), (dx, top), (dx - 14.0, dz), zs, 90.0)
    sheet.text((dx, dz - 20.0), f"A   edge, heights {zs:g}:1, lengths not to scale", 2.5, "BOTTOM_CENTER")
    deviation, variation = GRADES[pair.grade]
    digits = 4
    sheet.notes(
        (30.0, 150.0),
        [
            "Parts",
            f"1  base, {block.material.designation}, top lapped flat within 0.1 um where blocks are wrung",
            f"2  gauge block {millimetres(pair.lower, digits)} mm, ISO 3650 grade {pair.grade}, 30 x 9 mm",
            f"3  gauge block {millimetres(pair.upper, digits)} mm, ISO 3650 grade {pair.grade}, 30 x 9 mm",
            "",
            "Stack-up of the step",
            f"lengths of two blocks: +-{deviation * 1e6:g} um each",
            f"variation of length, half of it at the edge: +-{0.5 * variation * 1e6:g} um each",
            "wringing: +-0.02 um each",
            f"worst case +-{pair.worst * 1e6:.2f} um, 95 % within +-{pair.expected * 1e6:.2f} um",
            f"permitted: {limits_text(block.height.nominal, block.height.lower, block.height.upper)} mm",
            "",
            "Wring parts 2 and 3 side by side, long sides together, edges of the upper one not broken.",
            "The chamfer of a gauge block (0.1 to 0.3 mm) lies at the working edge: order part 3 without it, or lap it off.",
        ],
    )
    sheet.border(
        [
            ("identity", f"{block.id.upper()}-GAUGE"),
            ("material", "base as noted, gauge blocks steel"),
            ("unit", "mm"),
            ("general tolerances", "ISO 2768-m"),
            ("tolerancing", "ISO 8015, ISO 1101"),
            ("reference temperature", "20 deg C (ISO 1)"),
            ("edges", "ISO 13715"),
            ("projection, size", "first angle, A3"),
        ],
        "Step block from gauge blocks",
    )
    return sheet
