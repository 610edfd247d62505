"""Visible callouts: each tolerance as outlined text beside the part, with a line to the face it speaks of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stepblocks.artefacts.numbers import decimals_for, limits_text, millimetres
from stepblocks.cad.kernel import Face
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.lettering import letters, text_width

Point = tuple[float, float, float]
Line = tuple[Point, Point]


def callout_text(one: Characteristic, number: int) -> str:
    """Return what a callout says, with the number of the drawing."""
    if one.kind in ("flatness", "parallelism"):
        zone = millimetres(one.upper, max(decimals_for(one.upper), 3))
        return f"{number}  {one.label} {zone}"
    sign = {"diameter": "dia. ", "radius": "R "}.get(one.kind, "")
    return f"{number}  {one.label} {sign}{limits_text(one.nominal, one.lower, one.upper)}"


def callout_lines(text: str, place: int, part: Sequence[Face], face: Face) -> list[Line]:
    """Draw a callout in the plane before the front of a part."""
    low = np.min([one.low for one in part], axis=0)
    high = np.max([one.high for one in part], axis=0)
    size = 0.03 * float(np.max(high - low))
    x0, y, z0 = float(high[0]) + 4.0 * size, float(low[1]) - 2.0 * size, float(low[2]) + (2.0 * place + 1.0) * size
    middle = x0 + 0.5 * text_width(text, size)
    lines: list[Line] = []
    for outer, holes in letters(text, size):
        for ring in (outer, *holes):
            points = [(middle + float(u), y, z0 + float(v)) for u, v in ring]
            lines += list(zip(points, [*points[1:], points[0]], strict=True))
    end = tuple(0.5 * (a + b) for a, b in zip(face.low, face.high, strict=True))
    lines.append(((x0 - size, y, z0), (end[0], end[1], end[2])))
    return lines
