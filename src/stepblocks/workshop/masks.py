"""Masks of etched steps in silicon: a GDSII layer for each etch, with monitors, marks and labels.

All lengths of the layout are micrometres.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pandas as pd
import shapely
import shapely.affinity

from stepblocks.errors import MachiningError
from stepblocks.files.atomic import write_atomically
from stepblocks.files.tables import write_table
from stepblocks.parts.kinds.step_block import MetrologyFeature, StepBlock
from stepblocks.parts.lettering import compute_text_width, outline_centred_text

if TYPE_CHECKING:
    from gdstk import Polygon as GdsiiPolygon

Shape: TypeAlias = Any  # a polygon of shapely, or several
Place: TypeAlias = tuple[float, float]  # x and y [um]

SILICON = "silicon"  # the material whose blocks are etched
GRID = 1e-3  # to which every corner is rounded [um]
LEAST_WIDTH = 10.0  # of what is open, and of what stays between [um]
STREET = 500.0  # between blocks, where they are cut apart [um]
# widths of trenches 2 mm long: narrow ones etch less deep (Franssila, Introduction to
# Microfabrication, p. 204) [um]
MONITORS = (12.0, 40.0, 80.0, 500.0)
_MONITOR_LENGTH = 2000.0
_MONITOR_PITCH = 1000.0
_LAYER_PITCH = 2600.0  # between the monitors of two etches, below the blocks
_NAME_HEIGHT = 1000.0  # of the capitals of a block's name
_LABEL_HEIGHT = 300.0  # of those of an etch's name
_MARGIN = 500.0  # of a name from the rim of its block
_MARKS_START = 5000.0  # x of the alignment marks
_MARK_PITCH = 400.0
_MARKS_HEIGHT = -1600.0  # y of the alignment marks
_ARM = 100.0  # of the cross of an alignment mark, from its middle
_HALF_ARM_WIDTH = 10.0
_SQUARE = 70.0  # of the squares that lie between the arms, 25 um off
_SQUARE_STARTS = (25.0, -95.0)
_LEAST_LOST_AREA = 1.0  # less is the rounding of slanted edges to the grid [um^2]
_PINNED = datetime(2000, 1, 1)  # a GDSII header has no zone; equal blocks give equal bytes


@dataclass(frozen=True)
class Etch:
    """One etch through one mask.

    Attributes
    ----------
    depth : float
        [m]
    indices : tuple of int
        Of the blocks that it deepens.
    """

    depth: float
    indices: tuple[int, ...]


def plan_etches(heights: Sequence[float]) -> list[Etch]:
    """Plan the etches that give several heights [m], with the fewest masks.

    Heights that are multiples of one depth add up from etches of 1, 2, 4, ... times that depth,
    where these are fewer than the heights.
    """
    nanometres = [round(height * 1e9) for height in heights]
    unit = math.gcd(*nanometres)
    bits = (max(nanometres) // unit).bit_length()
    distinct = sorted(set(nanometres))
    etches = []
    if bits < len(distinct):
        for bit in range(bits):
            step = unit << bit
            has_step = [bool(height // unit >> bit & 1) for height in nanometres]
            etches.append(Etch(step * 1e-9, tuple(np.flatnonzero(has_step).tolist())))
    else:
        for depth in distinct:
            is_so_high = [height == depth for height in nanometres]
            etches.append(Etch(depth * 1e-9, tuple(np.flatnonzero(is_so_high).tolist())))
    return [etch for etch in etches if etch.indices]


def write_masks(path: Path, blocks: Sequence[StepBlock]) -> list[Path]:
    """Write the masks of silicon blocks as GDSII, and a table of their etches beside it.

    Raises
    ------
    MachiningError
        If gdstk is not installed, a block has no groove or ridge to measure, or an opening is
        narrower than can be etched.
    """
    gdstk = load_gdstk()
    for block in blocks:
        if block.metrology is None:
            raise MachiningError(f"a mask needs the metrology of its blocks, got none [{block.id}]")
        if block.relief is not None:
            raise MachiningError(
                f"a mask needs blocks without a relief, which is deeper than one etch, got one "
                f"[{block.id}]"
            )
    library = gdstk.Library("STEPBLOCKS", unit=1e-6, precision=1e-9)
    cell = library.new_cell("MASKS")
    etches = plan_etches([block.height.nominal for block in blocks])
    places = _lay_out_block_middles(blocks)
    named: set[int] = set()
    rows = []
    faults: list[str] = []
    for layer, etch in enumerate(etches, start=1):
        name = f"ETCH{layer} {etch.depth * 1e6:g}UM"
        openings = []
        for index in etch.indices:
            opening = _outline_etched_opening(blocks[index], is_named=index not in named)
            openings.append(shapely.affinity.translate(opening, *places[index]))
        named.update(etch.indices)
        marks = _outline_etch_marks(layer, len(etches), name)
        shapes = shapely.set_precision(shapely.unary_union([*openings, *marks]), GRID)
        for polygon in getattr(shapes, "geoms", [shapes]):
            cell.add(*_convert_to_gdsii_polygons(polygon, layer))
        cell.add(gdstk.Label(name, (-2000.0, -_LAYER_PITCH * layer), layer=layer))
        for index in etch.indices:
            cell.add(gdstk.Label(blocks[index].id.upper(), places[index], layer=layer))
        faults += [f"{name}: {fault}" for fault in yield_layout_rule_faults(shapes)]
        made = " ".join(blocks[index].id for index in etch.indices)
        rows.append(
            {
                "layer": layer,
                "depth_um": etch.depth * 1e6,
                "open_mm2": shapes.area * 1e-6,
                "blocks": made,
            }
        )
    if faults:
        raise MachiningError("\n  ".join([f"masks break the rules of layout [{path}]", *faults]))
    with write_atomically(path) as draft:
        library.write_gds(str(draft), timestamp=_PINNED)
    table = path.with_suffix(".csv")
    write_table(pd.DataFrame(rows), table)
    return [path, table]


def load_gdstk() -> Any:
    """Load the library that writes GDSII, or say how to get it."""
    try:
        import gdstk
    except ImportError as error:
        raise MachiningError("masks need gdstk: pip install 'stepblocks[masks]'") from error
    return gdstk


def _lay_out_block_middles(blocks: Sequence[StepBlock]) -> list[Place]:
    """Place the middles of blocks in rows of a nearly square field."""
    width = max(1e6 * block.body.length.nominal for block in blocks) + STREET
    height = max(1e6 * block.body.width.nominal for block in blocks) + STREET
    columns = math.ceil(math.sqrt(len(blocks) * height / width))
    places = []
    for index in range(len(blocks)):
        row, column = divmod(index, columns)
        places.append(((0.5 + column) * width, (0.5 + row) * height))
    return places


def _convert_to_gdsii_polygons(polygon: Shape, layer: int) -> "list[GdsiiPolygon]":
    """Convert a polygon to polygons of GDSII, which have no holes."""
    gdstk = load_gdstk()
    outer = gdstk.Polygon(polygon.exterior.coords[:-1], layer)
    holes = [gdstk.Polygon(ring.coords[:-1], layer) for ring in polygon.interiors]
    if not holes:
        return [outer]
    pieces: list[GdsiiPolygon] = gdstk.boolean(outer, holes, "not", 0.1 * GRID, layer)
    return pieces


def yield_layout_rule_faults(shapes: Shape) -> Iterator[str]:
    """Find openings, or gaps between them, that are narrower than the least width.

    They vanish when the shape is shrunk and grown again, or grown and shrunk.
    """
    half = 0.5 * LEAST_WIDTH - GRID
    opened = _offset_shapes(_offset_shapes(shapes, -half), half)
    closed = _offset_shapes(_offset_shapes(shapes, half), -half)
    yield from _yield_narrow_place_faults("open", shapely.difference(shapes, opened))
    yield from _yield_narrow_place_faults("kept", shapely.difference(closed, shapes))


def _offset_shapes(shapes: Shape, distance: float) -> Shape:
    """Offset the outlines of shapes outwards, or inwards by a negative distance; corners stay."""
    return shapely.buffer(shapes, distance, join_style="mitre", mitre_limit=50.0)


def _yield_narrow_place_faults(area_name: str, lost_shapes: Shape) -> Iterator[str]:
    """Describe each place that is too narrow."""
    for part in getattr(lost_shapes, "geoms", [lost_shapes]):
        if part.area > _LEAST_LOST_AREA:
            x, y = part.centroid.coords[0]
            yield (
                f"what is {area_name} must be at least {LEAST_WIDTH:g} um wide, got less at "
                f"({x:.1f}, {y:.1f}) um"
            )


def _outline_etched_opening(block: StepBlock, *, is_named: bool) -> Shape:
    """Outline what is etched of a block about its middle: the lower side and the groove.

    The street round the block is opened, too; a ridge stays. The name stands in the corner of the
    upper face that lies furthest from the lane of the drag.
    """
    half_length = 0.5e6 * block.body.length.nominal
    half_width = 0.5e6 * block.body.width.nominal
    outside = half_width + 0.5 * STREET
    face: Shape = shapely.box(-half_length - 0.5 * STREET, -outside, 0.0, outside)
    assert block.metrology is not None
    feature = _outline_feature(block.metrology, half_width)
    is_groove = block.metrology.kind == "groove"
    face = face.union(feature) if is_groove else face.difference(feature)
    if not is_named:
        return face
    name = block.id.upper()
    half_name = 0.5e6 * compute_text_width(name, _NAME_HEIGHT * 1e-6)
    middle = (half_length - _MARGIN - half_name, -half_width + _MARGIN + 0.5 * _NAME_HEIGHT)
    return face.union(_outline_letters(name, _NAME_HEIGHT, middle))


def _outline_feature(feature: MetrologyFeature, half_width: float) -> Shape:
    """Outline the groove or the ridge in the lane at the back, out to the street."""
    near = 1e6 * feature.distance.nominal
    far = near + 1e6 * feature.width.nominal
    front = half_width - 1e6 * feature.lane.nominal
    back = half_width + 0.5 * STREET
    if feature.kind == "groove":
        return shapely.box(near, front, far, back)
    return shapely.box(-far, front, -near, back)


def _outline_letters(text: str, height: float, middle: Place) -> Shape:
    """Outline a line of text about its middle."""
    letters = [
        shapely.Polygon(outer, holes) for outer, *holes in outline_centred_text(text, height)
    ]
    return shapely.affinity.translate(shapely.unary_union(letters), *middle)


def _outline_etch_marks(layer: int, layer_count: int, etch_name: str) -> Iterator[Shape]:
    """Outline monitors and name of one etch, and the marks that align later etches to the first."""
    y = -_LAYER_PITCH * layer
    yield _outline_letters(etch_name, _LABEL_HEIGHT, (-2000.0, y + 1000.0))
    for index, width in enumerate(MONITORS):
        x = _MONITOR_PITCH * index
        yield shapely.box(x, y, x + width, y + _MONITOR_LENGTH)
    if layer > 1:
        yield from _outline_alignment_squares(layer)
        return
    for later in range(2, layer_count + 1):
        yield from _outline_alignment_cross(later)


def _outline_alignment_cross(later_layer: int) -> Iterator[Shape]:
    """Outline the cross of the first etch to which a later one is aligned."""
    x = _MARKS_START + _MARK_PITCH * later_layer
    y = _MARKS_HEIGHT
    for half_x, half_y in ((_HALF_ARM_WIDTH, _ARM), (_ARM, _HALF_ARM_WIDTH)):
        yield shapely.box(x - half_x, y - half_y, x + half_x, y + half_y)


def _outline_alignment_squares(later_layer: int) -> Iterator[Shape]:
    """Outline the four squares of a later etch between the arms of its cross."""
    x = _MARKS_START + _MARK_PITCH * later_layer
    for shift_x in _SQUARE_STARTS:
        for shift_y in _SQUARE_STARTS:
            left = x + shift_x
            low = _MARKS_HEIGHT + shift_y
            yield shapely.box(left, low, left + _SQUARE, low + _SQUARE)
