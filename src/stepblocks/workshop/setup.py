"""The setup and probing sheet of a bench block: stock, clamping, datums, limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from stepblocks.artefacts.step.write import write_conforming_step
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.parts.body import Block
from stepblocks.parts.characteristics import FORM, Characteristic
from stepblocks.parts.gauge_pair import (
    GRADES,
    SECTION_LENGTH,
    SECTION_WIDTH,
    WRINGING,
    GaugePair,
    Grade,
    make_gauge_base,
)
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.on_paper import format_millimetres, format_size_with_deviations, format_zone
from stepblocks.parts.stock import build_stock_solid, compute_stock_corners
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.workshop.routes import Reach, Route
from stepblocks.workshop.setup_limits import (
    GRINDING,
    GUARD,
    PROBE,
    Allowances,
    SetupDimension,
    compute_allowances,
    find_lapping_removal,
    list_dimensions_left_by_setups,
)

# share of a tolerance that the guard bands may take; beyond it the machine can prove nothing
_LARGEST_GUARD_SHARE = 0.25
# in which setup a characteristic is probed, where no later setup changes it
_PROBED_IN = {
    "hole_spacing": 1,
    "hole_position": 1,
    "hole_row": 1,
    "length": 2,
    "width": 2,
    "engraving_depth": 3,
}
# after which setup a characteristic is measured off the machine; what an earlier one may leave
# stands in the table of limits of the setups
_DONE_AFTER = {
    "hole_depth": 6,
    "edge_break": 6,
    "thickness": 6,
    "relief_width": 6,
    "relief_depth": 6,
}
_ROUNDED = 1e-6  # limits of setups are whole numbers of it [m]
_SAME = 1e-3  # share of it by which a limit may miss a whole number


@dataclass(frozen=True)
class ProbedLine:
    """A line of the probing table, as texts."""

    number: str
    label: str
    limits: str
    place: str  # setup in which it is measured, or the method off the machine
    accepted: str  # what the machine accepts; ``-`` off the machine


@dataclass(frozen=True)
class SetupDimensionLine:
    """A line of the table of what the setups leave, as texts."""

    setup: str
    label: str
    accepted: str  # in millimetres; ``-`` where the drawing leaves nothing to work to


class _Letters(NamedTuple):
    """The letters of an engraving."""

    text: str
    place: str  # of their middle along the block
    middle: float  # their height over the base in the setup of the engraving [m]


def write_setup_sheet_and_stock(
    folder: Path, block: Block, routes: Sequence[Route] = (), pair: GaugePair | None = None
) -> list[Path]:
    """Write setup sheet and stock of a block.

    Parameters
    ----------
    folder : Path
        Where the files go.
    block : Block
        What is made.
    routes : sequence of Route
        Ways to make its step.
    pair : GaugePair, optional
        Gauge blocks whose difference is its height: another way, with parts of its own.

    Returns
    -------
    list of Path
        The sheet as HTML and the stock as STEP.
    """
    page = folder / f"{block.id}.setup.html"
    replace_text(page, _render_setup_sheet(block, routes, pair))
    stock = folder / f"{block.id}.stock.step"
    name = f"{block.id}-stock"
    write_conforming_step(stock, name, [(name, build_stock_solid(block))], block.material, [])
    return [page, stock]


def _render_setup_sheet(block: Block, routes: Sequence[Route], pair: GaugePair | None) -> str:
    """Render the setup sheet as HTML."""
    stock_sizes = _compute_stock_sizes(block)
    stock = [format_millimetres(size, 1) for size in stock_sizes]
    allowances = compute_allowances(block)
    left_dimensions = list_dimensions_left_by_setups(block)
    unproven = [line.label for line in left_dimensions if line.acceptance_band is None]
    letters = _describe_engraved_letters(block, allowances)
    letters_middle = format_millimetres(letters.middle, 3)
    lapped = find_lapping_removal(block).high
    last_edge = block.list_felt_edges()[-1]
    relief = second = None
    if isinstance(block, StepBlock):
        relief = block.relief
        second = block.second_step
    base = None
    grade: Grade | None = None
    if pair is not None:
        grade = GRADES[pair.grade]
        if isinstance(block, StepBlock):
            base = make_gauge_base(block, pair)
    return render_page(
        "stepblocks.workshop",
        "setup.html",
        block=block,
        stock=" x ".join(stock),
        reached="; ".join(_list_reaching_route_names(routes)),
        tight=_find_axes_of_tight_stock(block, stock_sizes),
        steps=_list_step_heights_um(block),
        second=second,
        probed=_list_probing_lines(block),
        burr=_format_largest_burr(block),
        second_burr=_format_largest_burr(last_edge),
        cut=f"{GRINDING * 1e3:g} mm",
        allowances=allowances,
        left_lines=_format_setup_dimensions(left_dimensions),
        unproven=unproven,
        countersink=_describe_countersink(block, allowances),
        letters_middle=letters_middle,
        letters=letters.text,
        letters_place=letters.place,
        lapped=format_millimetres(lapped, 3),
        probe=f"{PROBE * 1e6:g} um",
        guard=GUARD_FACTOR,
        has_gap=isinstance(block, MarginBlock),
        relief=relief,
        pair=pair,
        base=base,
        grade=grade,
        section_length=SECTION_LENGTH,
        section_width=SECTION_WIDTH,
        wringing=WRINGING,
    )


def _describe_engraved_letters(block: Block, allowances: Allowances) -> _Letters:
    """Find the letters of an engraving and their place; no text where there is none."""
    middle = allowances.base + 0.5 * block.body.thickness.nominal
    engraving = block.body.engraving
    if engraving is None:
        return _Letters("", "", middle)
    offset = _describe_letters_offset(engraving.offset[0])
    return _Letters(engraving.choose_text(block.id), offset, middle + engraving.offset[1])


def _format_largest_burr(part: Part) -> str:
    """Write the largest burr that a part may have at its working edge."""
    return f"{part.face_demands['burr'].upper * 1e6:.3g} um"


def _list_step_heights_um(block: Block) -> list[float]:
    """List the heights of the steps of a block [um]; none where its faces lie level."""
    heights = []
    for edge in block.list_felt_edges():
        if isinstance(edge, Block) and edge.first_rise != 0.0:
            heights.append(abs(edge.first_rise) * 1e6)
    return heights


def _compute_stock_sizes(block: Block) -> list[float]:
    """Return the sizes of the stock along x, y and z [m]."""
    low, high = compute_stock_corners(block)
    return [upper - lower for lower, upper in zip(low, high, strict=True)]


def _list_reaching_route_names(routes: Sequence[Route]) -> list[str]:
    """List the names of the routes that leave every characteristic as drawn, each once."""
    names: list[str] = []
    for route in routes:
        if route.reach is Reach.YES and route.name not in names:
            names.append(route.name)
    return names


def _find_axes_of_tight_stock(block: Block, stock_sizes: Sequence[float]) -> list[str]:
    """Find the axes along which the stock leaves less than two cuts."""
    tight = []
    for axis, size, side in zip("xyz", stock_sizes, block.sides, strict=True):
        if size - side < 2.0 * GRINDING:
            tight.append(axis)
    return tight


def _describe_letters_offset(from_middle: float) -> str:
    """Say how far the middle of the letters lies right of that of the front, along x [m]."""
    if from_middle == 0.0:
        return "in the middle along x"
    side = "right" if from_middle > 0.0 else "left"
    return f"{format_millimetres(abs(from_middle), 3)} mm to the {side} of the middle along x"


def _describe_countersink(block: Block, allowances: Allowances) -> str:
    """Say how wide the holes are countersunk in the milled base, so that grinding leaves enough."""
    mounting = block.body.mounting
    if mounting is None or mounting.kind != "tapped":
        return ""
    diameter = mounting.entry_diameter + 2.0 * allowances.base
    return f"{format_millimetres(diameter, 2)} mm"


def _format_setup_dimensions(dimensions: Sequence[SetupDimension]) -> list[SetupDimensionLine]:
    """List what the setups must leave, rounded into the limits [mm]."""
    lines = []
    for dimension in dimensions:
        band = dimension.acceptance_band
        accepted = "-"
        if band is not None:
            low = format_millimetres(math.ceil(band.low / _ROUNDED - _SAME) * _ROUNDED, 3)
            accepted = f"{low} or more"
            if not dimension.is_least:
                high = format_millimetres(math.floor(band.high / _ROUNDED + _SAME) * _ROUNDED, 3)
                accepted = f"{low} to {high}"
        lines.append(SetupDimensionLine(str(dimension.setup), dimension.label, accepted))
    return lines


def _list_probing_lines(block: Block) -> list[ProbedLine]:
    """List where each characteristic is measured, and what the machine accepts."""
    lines = []
    for number, characteristic in enumerate(block.characteristics(), start=1):
        place = _describe_measuring_place(characteristic)
        accepted = "-"
        if _is_proved_on_machine(characteristic):
            place = f"setup {_PROBED_IN[characteristic.key]}"
            accepted = format_acceptance_limits(characteristic)
        limits = format_drawn_limits(characteristic)
        lines.append(ProbedLine(str(number), characteristic.label, limits, place, accepted))
    return lines


def _describe_measuring_place(characteristic: Characteristic) -> str:
    """Say where a characteristic is measured that the machine does not prove."""
    place = f"off the machine: {characteristic.method}"
    if characteristic.key in _DONE_AFTER:
        return f"{place}, after setup {_DONE_AFTER[characteristic.key]}"
    return place


def _is_proved_on_machine(characteristic: Characteristic) -> bool:
    """Tell whether the machine reaches a characteristic, and proves that it conforms."""
    return characteristic.key in _PROBED_IN and is_proved_by_probe(characteristic)


def is_proved_by_probe(characteristic: Characteristic) -> bool:
    """Tell whether a touch probe on the machine can prove that a dimension conforms."""
    if characteristic.kind in (*FORM, "note"):
        return False
    tolerance = characteristic.upper - characteristic.lower
    guard_bands = 2.0 * GUARD
    return guard_bands <= _LARGEST_GUARD_SHARE * tolerance


def format_drawn_limits(characteristic: Characteristic) -> str:
    """Write the limits of a characteristic as on a drawing."""
    if characteristic.kind == "roughness":
        return f"Ra {characteristic.upper * 1e6:g} um"
    if characteristic.kind in FORM:
        return format_zone(characteristic.upper)
    return format_size_with_deviations(
        characteristic.nominal, characteristic.lower, characteristic.upper, characteristic.quantity
    )


def format_acceptance_limits(characteristic: Characteristic) -> str:
    """Write the limits within which a measured value conforms (ISO 14253-1) [mm]."""
    least = characteristic.nominal + characteristic.lower + GUARD
    largest = characteristic.nominal + characteristic.upper - GUARD
    return f"{format_millimetres(least, 3)} to {format_millimetres(largest, 3)}"
