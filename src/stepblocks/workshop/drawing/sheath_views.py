"""Views of a sheath: section along the axis, and the end."""

from __future__ import annotations

from collections.abc import Mapping

from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kinds.sheath import MASS_MATCH, Sheath, format_mass
from stepblocks.workshop.drawing.block_views import round_scale
from stepblocks.workshop.drawing.sheet import Point, Sheet


def sheath_views(sheet: Sheet, part: Sheath, numbered: Mapping[str, tuple[int, Characteristic]]) -> list[str]:
    """Draw a sheath in section and from its end; return the lines of its notes."""
    bore, outer, length = (one.nominal for one in (part.bore, part.outer_diameter, part.length))
    s = round_scale(min(130.0 / (length * 1e3), 70.0 / (outer * 1e3)))
    left, cy = 60.0, 190.0

    def at(z: float, r: float) -> Point:
        return left + z * 1e3 * s, cy + r * 1e3 * s

    for side in (1.0, -1.0):
        sheet.polyline([at(z, side * r) for r, z in _points(part)], closed=True)
    for z in (0.0, length):
        sheet.line(at(z, -0.5 * bore), at(z, 0.5 * bore))
    for z in (part.edge_break.nominal, length - part.edge_break.nominal):
        sheet.line(at(z, -0.5 * outer), at(z, -0.5 * bore))
        sheet.line(at(z, 0.5 * bore), at(z, 0.5 * outer))
    sheet.line(at(-0.1 * length, 0.0), at(1.1 * length, 0.0), "CENTRE")
    number, one = numbered["length"]
    sheet.dimension(
        number, one, at(0.0, -0.5 * outer), at(length, -0.5 * outer), at(0.0, -0.5 * outer - 14.0 / (1e3 * s)), s
    )
    right = at(length, 0.0)[0]
    number, one = numbered["bore"]
    sheet.dimension(number, one, at(length, -0.5 * bore), at(length, 0.5 * bore), (right + 12.0, cy), s, 90.0)
    number, one = numbered["outer_diameter"]
    sheet.dimension(number, one, at(0.0, -0.5 * outer), at(0.0, 0.5 * outer), (left - 16.0, cy), s, 90.0)
    sheet.text(
        (at(0.5 * length, 0.0)[0], at(0.0, -0.5 * outer)[1] - 26.0),
        f"section {s:g}:1, clamp on the left",
        2.5,
        "BOTTOM_CENTER",
    )
    end = (right + 80.0, cy)
    for diameter in (bore, outer - 2.0 * part.edge_break.nominal, outer):
        sheet.circle(end, 0.5e3 * diameter * s)
    reach = 0.6e3 * outer * s
    sheet.line((end[0] - reach, cy), (end[0] + reach, cy), "CENTRE")
    sheet.line((end[0], cy - reach), (end[0], cy + reach), "CENTRE")
    sheet.text((end[0], cy - reach - 6.0), f"end {s:g}:1", 2.5, "BOTTOM_CENTER")
    low, high = part.mass_limits
    return [
        f"Mass {format_mass(part.mass)}, {format_mass(low)} to {format_mass(high)} within the limits.",
        f"Weigh the made parts; a pair must agree within {MASS_MATCH:.0%}.",
    ]


def _points(part: Sheath) -> list[Point]:
    """Half section; its outline has lines only."""
    return part.outline()
