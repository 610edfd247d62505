"""Masks of etched steps: a GDSII layer for each etch, with monitors, marks and labels."""

import math
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd
import shapely
import shapely.affinity

from stepblocks.atomic import write_atomically
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.lettering import compute_text_width, outline_text
from stepblocks.tables import write_table

GRID = 1e-3  # to which every corner is rounded; all lengths of this file are micrometres
LEAST = 10.0  # width of what is open, and of what stays between
STREET = 500.0  # between blocks, where they are cut apart
# widths of trenches 2 mm long: narrow ones etch less deep (Franssila, Introduction to
# Microfabrication, p. 204)
MONITORS = (12.0, 40.0, 80.0, 500.0)
_PINNED = datetime(2000, 1, 1)  # a GDSII header has no zone; equal stimuli give equal bytes
_MITRED: dict[str, object] = {"join_style": "mitre", "mitre_limit": 50.0}
Shape: TypeAlias = Any  # a polygon of shapely, or several


def plan_etches(heights: Sequence[float]) -> dict[float, list[int]]:
    """Depth of each etch [m], with the indices of the heights [m] that it adds to."""
    # heights that are multiples of one depth add up from etches of 1, 2, 4, ... times it: fewer
    # masks than heights
    nanometres = [round(height * 1e9) for height in heights]
    unit = math.gcd(*nanometres)
    bits = (max(nanometres) // unit).bit_length()
    if bits < len(set(nanometres)):
        adds = {
            (unit << bit): [i for i, n in enumerate(nanometres) if n // unit >> bit & 1]
            for bit in range(bits)
        }
    else:
        adds = {
            depth: [i for i, n in enumerate(nanometres) if n == depth]
            for depth in sorted(set(nanometres))
        }
    return {depth * 1e-9: indices for depth, indices in adds.items() if indices}


def write_masks(path: Path, blocks: Sequence[StepBlock]) -> tuple[list[Path], list[str]]:
    """Write the masks of blocks and a table of their etches.

    Returns both files, and the design rules that are broken.
    """
    import gdstk

    library = gdstk.Library("STEPBLOCKS", unit=1e-6, precision=1e-9)
    cell, rows, faults = library.new_cell("MASKS"), [], []
    plan = plan_etches([block.height.nominal for block in blocks])
    # middles of the blocks, in rows of a nearly square field
    wide = max(1e6 * block.body.length.nominal for block in blocks) + STREET
    tall = max(1e6 * block.body.width.nominal for block in blocks) + STREET
    columns = math.ceil(math.sqrt(len(blocks) * tall / wide))
    places = [((0.5 + i % columns) * wide, (0.5 + i // columns) * tall) for i in range(len(blocks))]
    named = set[int]()
    for layer, (depth, indices) in enumerate(plan.items(), start=1):
        name = f"ETCH{layer} {depth * 1e6:g}UM"
        dies = [_outline_opening(blocks[i], places[i], named=i not in named) for i in indices]
        named |= set(indices)
        shapes = shapely.set_precision(
            shapely.unary_union([*dies, *_outline_marks(layer, len(plan), name)]), GRID
        )
        for polygon in getattr(shapes, "geoms", [shapes]):
            outer, *holes = (
                gdstk.Polygon(ring.coords[:-1], layer)
                for ring in (polygon.exterior, *polygon.interiors)
            )
            cell.add(*(gdstk.boolean(outer, holes, "not", 0.1 * GRID, layer) if holes else [outer]))
        cell.add(gdstk.Label(name, (-2000.0, -2600.0 * layer), layer=layer))
        cell.add(*(gdstk.Label(blocks[i].id.upper(), places[i], layer=layer) for i in indices))
        faults += [f"{path.name}: {name}: {line}" for line in find_rule_faults(shapes)]
        made = " ".join(blocks[i].id for i in indices)
        rows.append(
            {
                "layer": layer,
                "depth_um": depth * 1e6,
                "open_mm2": shapes.area * 1e-6,
                "blocks": made,
            }
        )
    with write_atomically(path) as draft:
        library.write_gds(draft, timestamp=_PINNED)
    table = path.with_suffix(".csv")
    write_table(pd.DataFrame(rows), table)
    return [path, table], faults


def find_rule_faults(shapes: Shape) -> Iterator[str]:
    """Find openings, or gaps between them, that are narrower than the least width.

    They vanish when the shape is shrunk and grown.
    """
    half = 0.5 * LEAST - GRID
    for what, way in (("open", -half), ("kept", half)):
        there_and_back = shapely.buffer(shapely.buffer(shapes, way, **_MITRED), -way, **_MITRED)
        lost = (
            shapely.difference(shapes, there_and_back)
            if way < 0.0
            else shapely.difference(there_and_back, shapes)
        )
        for part in getattr(lost, "geoms", [lost]):
            if part.area > 1.0:  # less is the rounding of slanted edges to the grid
                x, y = part.centroid.coords[0]
                where = f"got less at ({x:.1f}, {y:.1f}) um"
                yield f"what is {what} must be at least {LEAST:g} um wide, {where}"


def _outline_opening(block: StepBlock, place: tuple[float, float], named: bool) -> Shape:
    """Outline what is etched of a block: its lower side with the street, and the groove.

    A ridge stays; the name is etched where the block comes first.
    """
    half, side, feature = (
        0.5e6 * block.body.length.nominal,
        0.5e6 * block.body.width.nominal,
        block.metrology,
    )
    near, wide, low = (1e6 * one.nominal for one in (feature.distance, feature.width, feature.lane))
    lane = (side - low, side + 0.5 * STREET)
    face = shapely.box(-half - 0.5 * STREET, -side - 0.5 * STREET, 0.0, side + 0.5 * STREET)
    if feature.kind == "groove":
        face = face.union(shapely.box(near, lane[0], near + wide, lane[1]))
    else:
        face = face.difference(shapely.box(-near - wide, lane[0], -near, lane[1]))
    if named:  # in the corner of the upper face that lies furthest from the lane of the drag
        text, high = block.id.upper(), 1000.0
        middle = (
            half - 500.0 - 0.5e6 * compute_text_width(text, high * 1e-6),
            -side + 500.0 + 0.5 * high,
        )
        face = face.union(_outline_letters(text, high, middle))
    return shapely.affinity.translate(face, *place)


def _outline_letters(text: str, high: float, middle: tuple[float, float]) -> Shape:
    found = [shapely.Polygon(outer, holes) for outer, *holes in outline_text(text, high)]
    return shapely.affinity.translate(shapely.unary_union(found), *middle)


def _outline_marks(layer: int, layers: int, name: str) -> Iterator[Shape]:
    """Outline monitors and name of one etch, and the marks that align later etches."""
    y = -2600.0 * layer
    yield _outline_letters(name, 300.0, (-2000.0, y + 1000.0))
    for index, wide in enumerate(MONITORS):
        yield shapely.box(1000.0 * index, y, 1000.0 * index + wide, y + 2000.0)
    for other in range(2, layers + 1) if layer == 1 else (layer,):
        x, y = 5000.0 + 400.0 * other, -1600.0
        if layer == 1:  # a cross
            yield from (
                shapely.box(x - u, y - v, x + u, y + v) for u, v in ((10.0, 100.0), (100.0, 10.0))
            )
        else:  # four squares between its arms
            corners = ((x + u, y + v) for u in (25.0, -95.0) for v in (25.0, -95.0))
            yield from (shapely.box(u, v, u + 70.0, v + 70.0) for u, v in corners)
