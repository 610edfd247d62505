"""Views of a machined part of the apparatus: front, top and side in first-angle projection, bores as circles or hidden lines."""

from __future__ import annotations

from stepblocks.parts.kinds.machined import Box, Machined, Round
from stepblocks.workshop.sheet import Sheet, round_scale

_ROOM = (150.0, 150.0)  # for the three views [mm]
_GAP = 32.0  # between views [mm]


def machined_views(sheet: Sheet, part: Machined) -> list[str]:
    """Draw a part; where its bores lie is said in words, by their numbers."""
    low, high = part.extent
    size = [1e3 * (b - a) for a, b in zip(low, high, strict=True)]
    scale = round_scale(min((_ROOM[0] - _GAP) / (size[0] + size[1]), (_ROOM[1] - _GAP) / (size[1] + size[2])))
    left, base = 45.0, 110.0 + size[1] * scale + _GAP
    views = {  # which axes lie along the sheet, the corner of each view, and the axis that looks out of it
        "front": (0, 2, left, base, "y"),
        "top": (0, 1, left, base - _GAP - size[1] * scale, "z"),
        "left": (1, 2, left + size[0] * scale + _GAP, base, "x"),
    }
    for name, (u, v, x, y, out) in views.items():
        k = 1e3 * scale
        for one in part.boxes:
            corner = x + (one.low[u] - low[u]) * k, y + (one.low[v] - low[v]) * k
            far = corner[0] + (one.high[u] - one.low[u]) * k, corner[1] + (one.high[v] - one.low[v]) * k
            sheet.rectangle(corner, far, "HIDDEN" if _covered(one, part.boxes, (u, v), out) else "OUTLINE")
        for cylinder in (*part.rods, *part.bores):
            _draw(sheet, cylinder, (u, v), (x - low[u] * k, y - low[v] * k, k), out, cylinder in part.bores)
        sheet.text((x, y - 5.0), f"{name} {scale:g}:1", 2.0)
    _over_all(sheet, (left, base, scale), size)
    notes = [f"{part.standard}." if part.standard else "Break all edges by 0.3 mm; no burr."]
    threads = sorted({one.thread for one in part.bores if one.thread})
    return notes + [f"Threads: {', '.join(threads)}, tapped where the bore is said to be for them."] * bool(threads)


def _covered(one: Box, boxes: tuple[Box, ...], axes: tuple[int, int], out: str) -> bool:
    """Tell whether another box stands before it: the top is seen from above, the others from the front and from the left."""
    w = "xyz".index(out)
    before = [each for each in boxes if (each.high[w] > one.high[w] if out == "z" else each.low[w] < one.low[w])]
    return any(all(each.low[k] <= one.low[k] and each.high[k] >= one.high[k] for k in axes) for each in before)


Placed = tuple[float, float, float]  # where the part's origin lies on the paper, and millimetres of paper to a metre


def _draw(sheet: Sheet, one: Round, axes: tuple[int, int], at: Placed, out: str, hidden: bool) -> None:
    (u, v), (x, y, k) = axes, at
    if one.axis == out:
        sheet.circle((x + one.start[u] * k, y + one.start[v] * k), 0.5 * one.diameter * k)
        return
    low, high = ((x + a * k, y + b * k) for a, b in zip(one.ends[u], one.ends[v], strict=True))
    sheet.rectangle(low, high, "HIDDEN" if hidden else "OUTLINE")


def _over_all(sheet: Sheet, at: tuple[float, float, float], size: list[float]) -> None:
    """Dimension what the part measures over all, as far as it has plane ends."""
    left, base, scale = at
    wide, deep, tall = (length * scale for length in size)
    top = base - _GAP - deep
    for key, start, end, along in (
        ("length", (left, top), (left + wide, top), (left, top - 12.0)),
        ("width", (left, top), (left, top + deep), (left - 12.0, top)),
        ("height", (left, base), (left, base + tall), (left - 12.0, base)),
    ):
        if key in sheet.listed:
            sheet.dimension(key, start, end, along, scale, upright=key != "length")
