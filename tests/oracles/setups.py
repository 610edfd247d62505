"""A machinist who makes a block from its setup sheet alone, on a solid.

What the sheet accepts is read from its page. Each setup cuts boxes, drills and prisms of its own;
none of the program's geometry of bodies is used but the outlines of letters.
"""

import math
import re
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from stepblocks.cad import kernel
from stepblocks.parts.lettering import outline_centred_text
from stepblocks.parts.stock import compute_stock_corners

GUARD = 1.65 * 2.5e-6  # a value that is accepted may be this far off in truth [m]
FAR = 0.2  # further than any block reaches [m]
DEPTH, THREAD = "depth of the core holes", "full thread, at least"
MILLED, FLOOR = "height over both milled faces", "floor of the counterbores over the milled base"
GROUND_OFF, GROUND = "ground off the base", "thickness over both ground faces"
LEG = "leg at the base and of upright edges"
LEFT = "leg at the upper side, left of the working edge"
RIGHT = "leg at the upper side, right of the working edge"
# of a block with two steps
LEFT_OF_FIRST = "leg at the upper side, left of the first edge"
BETWEEN = "leg at the upper side, between both edges"
RIGHT_OF_SECOND = "leg at the upper side, right of the second edge"
LAPPED, RISE, SECOND = "lapped off", "rise", "rise of the second step"


@dataclass(frozen=True)
class SetupSheet:
    """What a setup sheet says, in metres."""

    left_on_base: float
    left_on_top: float
    lapped: float  # off the higher working face, at most
    countersink: float | None
    letters: float | None  # their middle over the milled base
    accepted: dict[str, tuple[float, float]]  # true limits, the guard band added again
    unproven: tuple[str, ...]  # for which the sheet states that there are no limits
    relief: tuple[float, float] | None = None  # width and depth, cut last


def _find(pattern: str, text: str) -> float | None:
    found = re.search(pattern, text)
    return float(found[1]) * 1e-3 if found else None


def read_setup_sheet(path: Path) -> SetupSheet:
    """Read a setup sheet as a person would."""
    text = " ".join(path.read_text(encoding="utf-8").split())
    accepted, unproven = {}, []
    for row in re.findall(r"<tr><td>(\d)<td>([^<]*)<td>([^<]*)<td>", text):
        _, label, limits = (cell.strip() for cell in row)
        if limits == "-":
            unproven.append(label)
        elif limits.endswith("or more"):
            accepted[label] = (float(limits.split()[0]) * 1e-3 - GUARD, math.inf)
        elif " to " in limits:
            low, high = (float(limit) * 1e-3 for limit in limits.split(" to "))
            accepted[label] = (low - GUARD, high + GUARD)
    base = _find(r"mill the base, ([\d.]+) mm left", text)
    if base is None:
        base = _find(r"the base as delivered, ([\d.]+) mm over", text)
    top = _find(r"upper side(?: as delivered,)? ([\d.]+) mm over", text)
    lapped = _find(r"Lapping takes at most ([\d.]+) mm", text)
    return SetupSheet(
        base,
        top,
        lapped,
        _find(r"countersunk 90° to ⌀ ([\d.]+) mm", text),
        _find(r"along x and ([\d.]+) mm over the base", text),
        accepted,
        tuple(unproven),
        _find_relief(text),
    )


def _find_relief(text: str) -> tuple[float, float] | None:
    """Find width and depth of a relief that is cut along the root."""
    found = re.search(r"Cut the relief last.*?: ([\d.]+) mm wide and ([\d.]+) mm deep", text)
    if found is None:
        return None
    return float(found[1]) * 1e-3, float(found[2]) * 1e-3


def list_sources(block, sheet: SetupSheet) -> dict[str, tuple[float, float]]:
    """List all that may vary, with its limits in truth [m]."""
    sources = {name: band for name, band in sheet.accepted.items() if name != THREAD}
    sources[LAPPED] = (0.0, sheet.lapped)
    sources[RISE] = getattr(block, block.governing_field).limits
    second = getattr(block, "second_step", None)
    if second is not None:
        sources[SECOND] = second.height.limits
        if second.direction == "down":
            low, high = sources[SECOND]
            sources[SECOND] = (-high, -low)
    return sources


@dataclass(frozen=True)
class Face:
    """A working face as it is lowered."""

    begin: float  # m
    end: float
    drop: float  # under the highest face
    leg: str  # of its edge breaks, as the sheet calls it


def list_faces(block, value: dict[str, float]) -> list[Face]:
    """List the working faces of a block from left to right."""
    if SECOND not in value:
        rise = value[RISE]
        return [
            Face(-FAR, 0.0, max(rise, 0.0), LEFT),
            Face(0.0, FAR, max(-rise, 0.0), RIGHT),
        ]
    second_edge = block.second_step.distance.nominal
    between, behind = value[RISE], value[RISE] + value[SECOND]
    highest = max(between, behind)
    return [
        Face(-FAR, 0.0, highest, LEFT_OF_FIRST),
        Face(0.0, second_edge, highest - between, BETWEEN),
        Face(second_edge, FAR, highest - behind, RIGHT_OF_SECOND),
    ]


def choose_middle(block, sheet: SetupSheet) -> dict[str, float]:
    """Choose the middle of all limits.

    Of faces that are meant to lie level, either may be lapped lower, and none is here.
    """
    value = {name: sum(band) / 2.0 for name, band in list_sources(block, sheet).items()}
    low, high = getattr(block, block.governing_field).limits
    if low < 0.0 < high:
        for name, drop in ((GROUND, high), (LEFT, high), (RIGHT, -low)):
            if name in value:
                value[name] -= 0.5 * drop
    return value


def stack_corners(block, sheet: SetupSheet):
    """Yield what the last setup leaves at each corner of all limits, as the key and its value."""
    sources = list_sources(block, sheet)
    mounting = block.body.mounting
    for corner in product(*sources.values()):
        value = dict(zip(sources, corner, strict=True))
        off_base = value.get(GROUND_OFF, 0.0)
        lower = math.nan
        if GROUND in value:
            lower = value[GROUND] - value[LAPPED] - list_faces(block, value)[0].drop
            yield "thickness", lower
        if mounting is not None and mounting.kind == "tapped" and DEPTH in value:
            yield "hole_depth", value[DEPTH] - off_base
            yield "thread", sheet.accepted[THREAD][0] - off_base
        if mounting is not None and mounting.kind == "clearance" and FLOOR in value:
            yield "hole_depth", lower - (value[FLOOR] - off_base)
        if LEG in value:
            yield "edge_break", value[LEG]
        for face in list_faces(block, value):
            if face.leg in value:
                yield "edge_break", value[face.leg] - value[LAPPED] - face.drop


def make_block(block, sheet: SetupSheet, value: dict[str, float], letters: bool = True):
    """Make a block by its setups; return what is left of the stock, z = 0 on the ground base.

    What is cut at the edge itself (rounding, groove, gap) is left to the drawing.
    """
    low, high = compute_stock_corners(block)
    body = kernel.make_box(low, high)
    milled_base = block.body.base - sheet.left_on_base
    body = _keep_between(body, 2, milled_base, FAR)
    half_length, half_width = block.body.half_length, block.body.half_width
    body = _keep_between(body, 0, -half_length, half_length)
    body = _keep_between(body, 1, -half_width, half_width)
    body = _drill(body, block, sheet, value, milled_base)
    if MILLED in value:
        body = _keep_between(body, 2, -FAR, milled_base + value[MILLED])
    if letters and sheet.letters is not None:
        body = _engrave(body, block, milled_base + sheet.letters)
    base = milled_base + value.get(GROUND_OFF, 0.0)
    top = base + value[GROUND]
    body = _keep_between(body, 2, base, top)
    if LEG in value:
        body = _break_edges(body, block, value, base, top)
    top -= value[LAPPED]
    body = _keep_between(body, 2, -FAR, top)
    if SECOND in value:
        body = _lower_faces(body, list_faces(block, value), top)
    else:
        body = _lower_one_face(body, block, value[RISE], top)
    if sheet.relief is not None:
        width, depth = sheet.relief
        lower = top - value[RISE]
        tool = kernel.make_box((-width, -FAR, lower - depth), (0.0, FAR, lower + 0.5 * depth))
        body = kernel.cut(body, [tool])
    return kernel.move(body, (0.0, 0.0, -base))


def _keep_between(body, axis: int, low: float, high: float):
    """Cut off all that lies below and above two levels along an axis."""
    tools = []
    for start, end in ((-FAR, low), (high, FAR)):
        if end - start > 1e-9 and abs(start) < FAR + 1e-9 and abs(end) < FAR + 1e-9:
            corner, far_corner = [-FAR] * 3, [FAR] * 3
            corner[axis], far_corner[axis] = start, end
            if start < end:
                tools.append(kernel.make_box(corner, far_corner))
    return kernel.cut(body, tools)


def _drill(body, block, sheet: SetupSheet, value: dict[str, float], base: float):
    """Drill the holes from the milled base, and counterbore them from above."""
    mounting = block.body.mounting
    if mounting is None:
        return body
    radius = 0.5 * mounting.hole_diameter
    tools = []
    for side in (-0.5, 0.5):
        x = side * mounting.spacing.nominal
        if mounting.kind == "tapped":
            depth = value.get(DEPTH, mounting.depth.nominal + sheet.left_on_base)
            entry = 0.5 * sheet.countersink
            point = radius / math.tan(math.radians(59.0))
            outline = [
                (0.0, -1e-3),
                (entry + 1e-3, -1e-3),
                (radius, entry - radius),
                (radius, depth),
                (0.0, depth + point),
            ]
            tools.append(kernel.revolve_about_vertical(outline, (x, 0.0, base)))
        else:
            floor = value[FLOOR]
            entry = 0.5 * mounting.entry_diameter
            outline = [
                (0.0, -1e-3),
                (radius, -1e-3),
                (radius, floor),
                (entry, floor),
                (entry, 0.1),
                (0.0, 0.1),
            ]
            tools.append(kernel.revolve_about_vertical(outline, (x, 0.0, base)))
    return kernel.cut(body, tools)


def _engrave(body, block, middle: float):
    """Engrave the identity into the front at its nominal depth."""
    engraving = block.body.engraving
    front = -block.body.half_width
    tools = []
    for letter in outline_centred_text(block.id.upper(), engraving.height.nominal):
        rings = [[(float(u), front - 1e-4, middle + float(v)) for u, v in ring] for ring in letter]
        outer, *holes = rings
        tools.append(kernel.extrude(outer, (0.0, engraving.depth.nominal + 1e-4, 0.0), holes))
    return kernel.cut(body, tools)


def _break_edges(body, block, value: dict[str, float], base: float, top: float):
    """Break all edges but the working ones, each by a prism."""
    half_length, half_width = block.body.half_length, block.body.half_width
    tools = []
    faces = list_faces(block, value)
    breaks = [(-FAR, FAR, base, -1.0, value[LEG])]
    breaks += [(face.begin, face.end, top, 1.0, value[face.leg]) for face in faces]
    for begin, end, z, up, leg in breaks:  # the edges along x
        for side in (-1.0, 1.0):
            section = _corner(side * half_width, side, z, up, leg)
            outline = [(begin, y, height) for y, height in section]
            tools.append(kernel.extrude(outline, (end - begin, 0.0, 0.0)))
    for end, leg_key in ((-1.0, faces[0].leg), (1.0, faces[-1].leg)):
        for z, up, leg in ((base, -1.0, value[LEG]), (top, 1.0, value[leg_key])):
            section = _corner(end * half_length, end, z, up, leg)  # the edges along y
            outline = [(x, -FAR, height) for x, height in section]
            tools.append(kernel.extrude(outline, (0.0, 2.0 * FAR, 0.0)))
        for side in (-1.0, 1.0):  # the upright edges
            section = _corner(end * half_length, end, side * half_width, side, value[LEG])
            outline = [(x, y, base - 1e-3) for x, y in section]
            tools.append(kernel.extrude(outline, (0.0, 0.0, top - base + 2e-3)))
    return kernel.cut(body, tools)


def _corner(u: float, out_u: float, v: float, out_v: float, leg: float):
    """Outline what a chamfer of a leg takes off the corner (u, v)."""
    over = 2e-3
    return [
        (u + out_u * over, v - out_v * (leg + over)),
        (u - out_u * (leg + over), v + out_v * over),
        (u + out_u * over, v + out_v * over),
    ]


def _lower_faces(body, faces: list[Face], top: float):
    """Lower each working face by its drop."""
    boxes = []
    for face in faces:
        if face.drop > 0.0:
            boxes.append(kernel.make_box((face.begin, -FAR, top - face.drop), (face.end, FAR, FAR)))
    return kernel.cut(body, boxes)


def _lower_one_face(body, block, rise: float, top: float):
    """Lower the left face by a rise, or the right one by a negative one; a ridge stands."""
    if rise == 0.0:
        return body
    feature = getattr(block, "metrology", None)
    edge = 0.0
    if hasattr(block, "opening"):
        edge = min(block.opening.nominal, 0.0)  # a lip stands over the tooth
    if rise < 0.0:
        edge = block.marginal_gap.nominal
    x = -FAR if rise > 0.0 else FAR
    low, high = sorted((x, edge))
    tools = [(low, -FAR, high, FAR)]
    if feature is not None and feature.kind == "ridge":
        near = -feature.distance.nominal
        far = near - feature.width.nominal
        lane = block.body.half_width - feature.lane.nominal
        tools = [(low, -FAR, far, FAR), (far, -FAR, near, lane), (near, -FAR, high, FAR)]
    boxes = []
    for x0, y0, x1, y1 in tools:
        boxes.append(kernel.make_box((x0, y0, top - abs(rise)), (x1, y1, FAR)))
    return kernel.cut(body, boxes)
