"""Part drawings: the sheet of a part, and of a series of blocks that differ in height."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.apparatus.layout import list_components
from stepblocks.parts.conditions import NO_ORDER, OrderSpec
from stepblocks.parts.gauge_pair import GaugePair
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.kit_part import KitPart
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import HookTip, StraightTip
from stepblocks.parts.on_paper import describe_default_demands
from stepblocks.workshop.blocks import draw_margin_block_views, draw_step_block_views
from stepblocks.workshop.crown_views import draw_crown_views
from stepblocks.workshop.gauge_reach import judge_assembly_characteristics
from stepblocks.workshop.gauge_views import draw_gauge_assembly_views
from stepblocks.workshop.kit_views import draw_assembly_views, draw_kit_part_views
from stepblocks.workshop.paper import Point, replace_decimal_points_by_commas
from stepblocks.workshop.rendering import FORMATS, write_sheet_files
from stepblocks.workshop.routes import Route
from stepblocks.workshop.sheet import Note, Sheet, UnwrittenNotes
from stepblocks.workshop.title_block import MILLIMETRES, TITLE_BLOCK_TOP, draw_border
from stepblocks.workshop.turned import (
    draw_hook_tip_views,
    draw_sheath_views,
    draw_straight_tip_views,
)

_TABLE_ROWS = 11  # of the table of a series
_TABLE_CORNER: Point = (150.0, 84.0)
_TABLE_WIDTHS = (42.0, 34.0)
_NOTES_X = 232.0  # of the first column of notes, over the title block
_NOTES_COLUMN = 92.0  # width of a column
_NOTES_ROWS = 40  # of a column, at most
_NOTES_SPACING = 5.0
_SIGNS = {"diameter": "⌀"}  # before the limits of a size in words, by kind
_TEXTURE_FOOT: Point = (100.0, 16.0)
_INCHES = "inch (ASME Y14.5), limits inwards from mm; scales stand at the views"
_HEIGHT_KEYS = ("step_height", "groove_depth", "ridge_height")  # that a series tabulates

# who draws the views of a kind and returns the notes that are still to be written; without views
# everything is said in words
VIEWS: Mapping[type, Callable[[Sheet, Any], UnwrittenNotes]] = {
    StepBlock: draw_step_block_views,
    MarginBlock: draw_margin_block_views,
    CrownOnTooth: draw_crown_views,
    StraightTip: draw_straight_tip_views,
    HookTip: draw_hook_tip_views,
    Sheath: draw_sheath_views,
    KitPart: draw_kit_part_views,
}


@dataclass(frozen=True)
class SeriesSheet:
    """One sheet of the drawing of a series of blocks that differ in their heights only."""

    name: str  # of the series
    number: int  # of the sheet, from 1
    count: int  # of sheets
    blocks: Sequence[StepBlock]  # in the table of this sheet


def write_drawing(
    folder: Path, part: Part, formats: Sequence[str] = FORMATS, order: OrderSpec = NO_ORDER
) -> list[Path]:
    """Draw a part with its views; what none of them shows is said in words.

    Parameters
    ----------
    folder : Path
        Where the files go.
    part : Part
        What is drawn.
    formats : sequence of str
        Of ``"dxf"``, ``"svg"`` and ``"pdf"``.
    order : OrderSpec
        What the title block says of the order.

    Returns
    -------
    list of Path
        A file of each format.
    """
    return write_sheet_files(
        folder, f"{part.id}.drawing", formats, lambda: draw_part_sheet(part, order)
    )


def write_series_drawing(
    folder: Path, name: str, blocks: Sequence[StepBlock], order: OrderSpec
) -> list[Path]:
    """Draw blocks that differ in their heights only, eleven in the table of each sheet."""
    written = []
    count = math.ceil(len(blocks) / _TABLE_ROWS)
    for index in range(count):
        tabulated = blocks[index * _TABLE_ROWS : (index + 1) * _TABLE_ROWS]
        sheet = SeriesSheet(name, index + 1, count, tabulated)
        stem = f"{name}.series"
        if index > 0:
            stem = f"{name}.series-{sheet.number}"
        draw = partial(draw_part_sheet, tabulated[0], order, sheet)
        written += write_sheet_files(folder, stem, FORMATS, draw)
    return written


def write_assembly_drawing(folder: Path, kit: Apparatus, order: OrderSpec) -> list[Path]:
    """Draw the components of a kit where they stand, with the numbers of its parts list."""
    components = list_components(kit)

    def draw_assembly_sheet() -> Sheet:
        """Draw the components with title block."""
        sheet = Sheet([])
        draw_assembly_views(sheet, components)
        grams = 1e3 * math.fsum(component.mass for component in components)
        fields = {
            "identity": kit.id.upper(),
            "material": "by the parts list",
            "mass": replace_decimal_points_by_commas(f"{grams:.4g} g"),
            **_list_order_fields(order),
        }
        draw_border(sheet, "Apparatus, assembly drawing", fields)
        return sheet

    return write_sheet_files(folder, f"{kit.id}.assembly", FORMATS, draw_assembly_sheet)


def write_gauge_drawing(
    folder: Path, block: StepBlock, pair: GaugePair, route: Route, order: OrderSpec
) -> list[Path]:
    """Draw the step of a block as it is wrung together from two gauge blocks on a base.

    Parameters
    ----------
    folder : Path
        Where the files go.
    block : StepBlock
        The block in one piece.
    pair : GaugePair
        Gauge blocks whose difference is its height.
    route : Route
        The route of this pair.
    order : OrderSpec
        What the title block says of the order.

    Returns
    -------
    list of Path
        ``<id>.gauge.dxf``, ``.svg`` and ``.pdf``.
    """
    judged = list(judge_assembly_characteristics(block, pair, route))

    def draw_gauge_sheet() -> Sheet:
        """Draw the assembly of base and gauge blocks with title block."""
        sheet = Sheet(block.characteristics())
        draw_gauge_assembly_views(sheet, block, pair, judged)
        fields = {
            "identity": f"{block.id.upper()}, from gauge blocks",
            "material": block.material.order_text,
            "mass": "-",
            **_list_order_fields(order),
            "quantity": str(order.count_ordered_parts(block.id)),
        }
        draw_border(sheet, "Step from two gauge blocks, assembly drawing", fields)
        return sheet

    return write_sheet_files(folder, f"{block.id}.gauge", FORMATS, draw_gauge_sheet)


def draw_part_sheet(
    part: Part, order: OrderSpec = NO_ORDER, series: SeriesSheet | None = None
) -> Sheet:
    """Draw the sheet of a part.

    Of a series the part is the first block; the letter H stands for its height, and the heights
    of all blocks stand in a table.
    """
    in_inches = order.drawing_units == "inch"
    sheet = Sheet(part.characteristics(), in_inches=in_inches)
    fields = _list_title_block_fields(part, order)
    if series is not None:
        sheet.letters = dict.fromkeys(_HEIGHT_KEYS, "H")
        fields |= _list_series_fields(series, order)
        _draw_height_table(sheet, series.blocks)
    remarks = _draw_views(sheet, part)
    notes = _list_undrawn_characteristic_notes(sheet, part)
    if part.has_working_faces:
        sheet.draw_general_surface_texture(_TEXTURE_FOOT)
        defaults = describe_default_demands(part)
        if defaults:
            remarks.append(defaults)
    if in_inches:
        remarks.append(
            "Limits rounded inwards from millimetres, which the inspection sheet states."
        )
    notes += [Note(remark) for remark in remarks]
    _write_notes(sheet, notes)
    unit = _INCHES if in_inches else MILLIMETRES
    draw_border(sheet, f"{part.title}, part drawing", fields, unit)
    return sheet


def _list_title_block_fields(part: Part, order: OrderSpec) -> dict[str, str]:
    """List the fields of the title block of a part."""
    density = part.material.density
    mass = "-"
    if density is not None:
        grams = density.value * math.fsum(part.volumes()) * 1e3
        mass = replace_decimal_points_by_commas(f"{grams:.4g} g")
    return {
        "identity": part.id.upper(),
        "material": part.material.order_text,
        "mass": mass,
        **_list_order_fields(order),
        "quantity": str(order.count_ordered_parts(part.id)),
    }


def _list_order_fields(order: OrderSpec) -> dict[str, str]:
    """List the fields of the title block that the order states."""
    stated = {
        "drawn by": order.author,
        "approved by": order.approved_by,
        "owner": order.owner,
        "date": order.date,
        "revision": order.revision,
    }
    fields = {}
    for field, text in stated.items():
        fields[field] = text or "-"
    fields["quantity"] = str(order.quantity)
    fields["sheet"] = "1 of 1"
    return fields


def _list_series_fields(series: SeriesSheet, order: OrderSpec) -> dict[str, str]:
    """List the fields of the title block that a series states otherwise than its first block."""
    return {
        "identity": f"{series.name.upper()}, series",
        "mass": "-",
        "quantity": f"{order.quantity} of each",
        "sheet": f"{series.number} of {series.count}",
    }


def _draw_height_table(sheet: Sheet, blocks: Sequence[StepBlock]) -> None:
    """Draw the table of identities and heights."""
    engraving = blocks[0].body.engraving
    heading = "identity, engraved"
    if engraving is None or engraving.text:
        heading = "identity"
    rows = [(heading, "H")]
    for block in blocks:
        height = block.height
        limits = sheet.format_size(height.nominal, height.lower, height.upper)
        rows.append((block.id.upper(), limits))
    sheet.write_table(_TABLE_CORNER, rows, _TABLE_WIDTHS)


def _draw_views(sheet: Sheet, part: Part) -> UnwrittenNotes:
    """Draw the views of a part, if its kind or a base of it has some; return the notes on them."""
    for kind in type(part).__mro__:
        if kind in VIEWS:
            return VIEWS[kind](sheet, part)
    return []


def _list_undrawn_characteristic_notes(sheet: Sheet, part: Part) -> list[Note]:
    """State in words, with its number, each characteristic that no view shows."""
    notes = []
    for key, listed in sheet.listed.items():
        if listed.number not in sheet.numbers:
            label = sheet.convert_decimal_signs(listed.characteristic.label)
            sign = _SIGNS.get(listed.characteristic.kind, "")
            text = f"{label}: {sign}{sheet.format_characteristic_limits(key)}"
            if key == "roughness":
                text = f"{label}: {_describe_contact_roughness(sheet, part)}"
            notes.append(Note(f"{listed.number}  {text}", key))
    return notes


def _describe_contact_roughness(sheet: Sheet, part: Part) -> str:
    """Say which roughness the surface has that a tip touches."""
    governing = part.governing_field.replace("_", " ")
    largest = part.face_demands["roughness"].upper
    roughness = replace_decimal_points_by_commas(f"Ra {largest * 1e6:.2f} µm")
    if sheet.in_inches:
        roughness = sheet.format_roughness(largest)
    return f"{roughness} or better, from the tolerance of the {governing}"


def _write_notes(sheet: Sheet, notes: Sequence[Note]) -> None:
    """Write notes over the title block; the columns of a long list start level."""
    rows = min(len(notes), _NOTES_ROWS)
    y = TITLE_BLOCK_TOP - 1.0 + _NOTES_SPACING * rows
    for start in range(0, len(notes), _NOTES_ROWS):
        x = _NOTES_X + _NOTES_COLUMN * (start // _NOTES_ROWS)
        sheet.write_notes((x, y), notes[start : start + _NOTES_ROWS])
