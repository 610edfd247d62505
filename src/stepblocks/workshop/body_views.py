"""Views of the body of a bench block: front, top, and a section through a fixing hole."""

import math

from stepblocks.parts.body import DRILL_POINT, Body, Engraving, Mounting
from stepblocks.parts.lettering import compute_text_width
from stepblocks.workshop.sheet import (
    Point,
    Sheet,
    choose_scale,
    format_scale,
    use_decimal_comma,
)

FRONT_VIEW: Point = (100.0, 240.0)
TOP_VIEW: Point = (100.0, 130.0)
_HOLE_VIEW: Point = (360.0, 131.0)  # middle of the base in the section through a hole


def draw_body(sheet: Sheet, body: Body, identity: str) -> float:
    """Draw the body from the front and from above; return the scale of both views."""
    sides = (body.length.nominal, body.width.nominal, 80.0 / 40.0 * body.thickness.nominal)
    scale = choose_scale(80.0 / (1e3 * max(sides)))
    _draw_front(sheet, body, identity, scale)
    _draw_top(sheet, body, scale)
    if body.mounting is not None:
        _draw_holes(sheet, body, body.mounting, scale)
    return scale


def _draw_front(sheet: Sheet, body: Body, identity: str, scale: float) -> None:
    k = 1e3 * scale
    half, t, c = (
        body.half_length * k,
        body.thickness.nominal * k,
        body.edge_break.nominal * k,
    )
    fx, middle = FRONT_VIEW
    fz = middle + 0.5 * t
    sheet.draw_polyline(
        [(fx + x, fz + z) for x, z in _list_octagon((-half, -t), (half, 0.0), c)], closed=True
    )
    left = fx - half
    sheet.draw_dimension(
        "thickness", (left + c, fz - t), (left + c, fz), (left - 12.0, fz), scale, upright=True
    )
    if body.engraving is not None:
        _draw_letters(sheet, body.engraving, identity, (fx, fz - 0.5 * t), (fx + half, fz), k)
    sheet.draw_leader(
        (left + 0.5 * c, fz - 0.5 * c),
        (left + 6.0, fz + 7.0),
        "{} x 45°, all other edges",
        "edge_break",
    )
    base = fz - t
    sheet.draw_datum((fx + half - 14.0, base), "B")
    sheet.point_to(
        (fx + half - 5.0, base),
        sheet.draw_tolerance_frame("flatness_base", (fx + half + 6.0, base - 12.0)),
    )
    sheet.write_text(
        (fx + half - 19.0, base - 10.0), f"front {format_scale(scale)}", 2.5, "BOTTOM_RIGHT"
    )


def _draw_letters(
    sheet: Sheet, engraving: Engraving, identity: str, middle: Point, corner: Point, k: float
) -> None:
    letter = max(0.8 * engraving.height.nominal * k, 2.5)
    sheet.write_text(middle, identity.upper(), letter, "MIDDLE_CENTER")
    end = middle[0] + 0.5 * compute_text_width(identity.upper(), letter) + 1.5, middle[1]
    # below the note of the edges, which stands 7 mm over the body
    elbow = corner[0] + 12.0
    level = min(middle[1] + 9.0, corner[1] + 0.5)
    sheet.draw_leader(end, (elbow, level), "letters {} high", "engraving_height")
    sheet.draw_leader(end, (elbow, level - 6.0), "engraved {} deep", "engraving_depth")


def _draw_top(sheet: Sheet, body: Body, scale: float) -> None:
    k = 1e3 * scale
    tx, ty = TOP_VIEW
    hx, hy, c = (
        body.half_length * k,
        body.half_width * k,
        body.edge_break.nominal * k,
    )
    sheet.draw_polyline(
        [(tx + x, ty + y) for x, y in _list_octagon((-hx, -hy), (hx, hy), c)], closed=True
    )
    sheet.draw_rectangle((tx - hx + c, ty - hy + c), (tx + hx - c, ty + hy - c), "DIMENSION")
    left, below = tx - hx, ty - hy
    sheet.draw_dimension(
        "length", (left, below + c), (tx + hx, below + c), (tx, below - 28.0), scale
    )
    sheet.draw_dimension(
        "width",
        (left + c, below),
        (left + c, ty + hy),
        (left - 12.0, ty),
        scale,
        upright=True,
        text_at=0.78,  # above the middle, where the place of the holes is led out
    )
    if "edge_position" in sheet.listed:
        sheet.draw_dimension(
            "edge_position", (left, ty + hy - c), (tx, ty + hy), (tx, ty + hy + 16.0), scale
        )
    sheet.write_text((tx, below - 35.0), f"top {format_scale(scale)}", 2.5, "BOTTOM_CENTER")


def _draw_holes(sheet: Sheet, body: Body, mounting: Mounting, scale: float) -> None:
    # Draw the fixing holes from above, with their places, and one of them in section
    k = 1e3 * scale
    tx, ty = TOP_VIEW
    hx, hy, c = (
        body.half_length * k,
        body.half_width * k,
        body.edge_break.nominal * k,
    )
    hole, half = 0.5 * mounting.hole_diameter * k, 0.5 * mounting.spacing.nominal * k
    outer = 0.5 * mounting.entry_diameter * k
    for x in (-half, half):
        if mounting.kind == "clearance":
            sheet.draw_circle((tx + x, ty), outer)
            sheet.draw_circle((tx + x, ty), hole)
        else:  # tapped from below; a hidden thread is dashed, its outer line three quarters long
            sheet.draw_circle((tx + x, ty), hole, "HIDDEN")
            sheet.draw_polyline(
                [
                    (tx + x + outer * math.cos(turn), ty + outer * math.sin(turn))
                    for turn in (math.radians(10.0 * (index + 1)) for index in range(28))
                ],
                "HIDDEN",
            )
        sheet.draw_line((tx + x - hole - 3.0, ty), (tx + x + hole + 3.0, ty), "CENTRE")
        sheet.draw_line((tx + x, ty - hole - 3.0), (tx + x, ty + hole + 3.0), "CENTRE")
    left, below, foot = tx - hx, ty - hy, ty - hole
    near, far, along = (tx - half, foot), (tx + half, foot), (tx, below - 19.0)
    # its text stands beyond the line that leads the length out
    sheet.draw_dimension("hole_spacing", near, far, along, scale, clear=hx - half)
    sheet.draw_dimension(
        "hole_position", (left, below + c), near, (tx, below - 10.0), scale, before=True
    )
    sheet.draw_dimension(
        "hole_row", (left + c, below), (tx - half, ty), (left - 24.0, ty), scale, upright=True
    )
    thread = f"{mounting.thread}-6H" if mounting.kind == "tapped" else f"for {mounting.thread}"
    sheet.draw_leader(
        (tx + half + 0.7 * hole, ty - 0.7 * hole),
        (tx + hx + 10.0, ty - 11.0),
        use_decimal_comma(f"2 x {thread}, section C"),
    )
    sheet.draw_cutting_line((tx - hx - 3.0, ty), (tx + hx + 3.0, ty), "C")
    _draw_hole_section(sheet, body, mounting)


def _draw_hole_section(sheet: Sheet, body: Body, mounting: Mounting) -> None:
    # Draw a hole in section; a thread as in ISO 6410-1, crests thick and roots thin
    x, base = _HOLE_VIEW
    tapped = mounting.kind == "tapped"
    tall = body.thickness.nominal
    shown = min(tall, 1.2 * mounting.depth.nominal) if tapped else tall
    wide = 1.6 * mounting.entry_diameter
    scale = choose_scale(min(36.0 / (shown * 1e3), 34.0 / (wide * 1e3)))
    k = 1e3 * scale
    top, half = base + shown * k, 0.5 * wide * k
    drill, entry, deep = (
        0.5 * mounting.hole_diameter * k,
        0.5 * mounting.entry_diameter * k,
        mounting.depth.nominal * k,
    )
    sheet.draw_line((x - half, base), (x + half, base))
    sheet.draw_line((x - half, top), (x + half, top), "OUTLINE" if shown == tall else "DIMENSION")
    for side in (-1.0, 1.0):
        sheet.draw_break_line(x + side * half, base, top)
        if tapped:
            outline = [
                (entry, base),
                (drill, base + entry - drill),
                (drill, base + deep),
                (0.0, base + deep + drill / math.tan(0.5 * DRILL_POINT)),
            ]
            full = base + mounting.thread_depth * k
            sheet.draw_line((x + side * entry, base), (x + side * entry, full), "DIMENSION")
            sheet.draw_line((x, full), (x + side * entry, full))
        else:
            outline = [(drill, base), (drill, top - deep), (entry, top - deep), (entry, top)]
        sheet.draw_polyline([(x + side * r, z) for r, z in outline])
        cut = [*outline, (outline[-1][0], top), (half, top), (half, base)]
        sheet.draw_hatch([(x + side * r, z) for r, z in cut])
    sheet.draw_line((x, base - 3.0), (x, top + 3.0), "CENTRE")
    low, high = (base, base + deep) if tapped else (top - deep, top)
    sheet.draw_line((x - drill, high if tapped else low), (x + drill, high if tapped else low))
    sheet.draw_dimension(
        "hole_depth",
        (x + drill, low),
        (x + drill, high),
        (x + half + 8.0, base),
        scale,
        upright=True,
    )
    sheet.write_text((x, base - 8.0), f"C-C   {format_scale(scale)}", 2.5, "BOTTOM_CENTER")
    elbow = x - half - 5.0, base + 0.5 * (top - base)
    if tapped:
        sheet.draw_leader(
            (x - entry, base + 0.4 * mounting.thread_depth * k),
            elbow,
            use_decimal_comma(f"{mounting.thread}-6H, thread {{}} deep"),
            "thread",
        )
        sheet.write_text(
            (elbow[0] - 5.0, elbow[1] - 6.0),
            use_decimal_comma(f"core ⌀{mounting.hole_diameter * 1e3:g}") + ", 6H of ISO 965-1",
            2.5,
            "RIGHT",
        )
    else:
        sheet.draw_leader(
            (x - drill, base + 3.0),
            elbow,
            use_decimal_comma(f"⌀{2e3 * drill / k:g} through, counterbored ⌀{2e3 * entry / k:g}"),
        )


def _list_octagon(low: Point, high: Point, cut: float) -> list[Point]:
    # Corners of a rectangle with broken edges, from the left end of its lower side
    (x0, z0), (x1, z1) = low, high
    return [
        *((x0 + cut, z0), (x1 - cut, z0), (x1, z0 + cut), (x1, z1 - cut)),
        *((x1 - cut, z1), (x0 + cut, z1), (x0, z1 - cut), (x0, z0 + cut)),
    ]
