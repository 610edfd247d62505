"""Everything a workshop gets besides the STEP file: drawings, sheets, routes."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from stepblocks.artefacts.step.gauge_assembly import write_gauge_assembly
from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.select import select_stimuli
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, replace_text, resolve_inside
from stepblocks.files.pages import render_page
from stepblocks.files.tables import write_table
from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.body import Block
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.gauge_pair import GaugePair, require_gauge_pair
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.kit_part import KitPart
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import Tip
from stepblocks.parts.material import MATERIALS
from stepblocks.parts.on_paper import make_inspection_sheet_table
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.quantities import parse_quantity
from stepblocks.records.qif import write_qif
from stepblocks.workshop.bundle import OrderedPart, write_bundle
from stepblocks.workshop.drawing import (
    write_drawing,
    write_gauge_drawing,
    write_series_drawing,
)
from stepblocks.workshop.gauge_reach import explain_missing_gauge_drawing, find_gauge_route
from stepblocks.workshop.kit import find_complete_kits, write_kit_assembly_files
from stepblocks.workshop.kit_setup import write_kit_setup_sheet_and_stock
from stepblocks.workshop.masks import SILICON, load_gdstk, write_masks
from stepblocks.workshop.routes import GAUGE_BLOCKS, Route, list_routes, make_route_row
from stepblocks.workshop.setup import write_setup_sheet_and_stock

_SHOWN_COLUMNS = (
    "part",
    "route",
    "reaches",
    "conforming_share",
    "missed",
    "energy_uj",
    "energy_95_low_uj",
    "energy_95_high_uj",
    "height_deviation_um",
    "permitted_um",
    "status",
    "note",
)
# why a kind has no setup sheet and no routes
_MADE_ELSEWHERE: Mapping[type, str] = {
    Tip: "shank, cone and ball are ground in one chucking, as the maker of tips has it set up",
    Sheath: "it is turned and bored in one chucking",
    CrownOnTooth: "a dental workshop mills tooth and crown from the STEP file",
}
GROUND = "2 um"  # deviation of a height in one piece that is ground, not lapped


@dataclass(frozen=True)
class PartOrder:
    """What was written for one part, or for a set as a whole.

    Attributes
    ----------
    name : str
        ``"set/id"``; of a set ``"set/series"``, ``"set/masks"`` or ``"set/quotation"``.
    files : tuple of Path
        Drawings, for a step block also of the two-piece variant, and sheets.
    routes : tuple of Route
        Ways to make a step block; empty for other parts.
    note : str
        Which block of the set has the same sizes, and why a part has no setup sheet or routes, or
        a step block no gauge-block drawing.
    is_of_set : bool
        Whether it belongs to a set as a whole and to none of its parts.
    """

    name: str
    files: tuple[Path, ...] = field(repr=False)
    routes: tuple[Route, ...] = field(repr=False)
    note: str = ""
    is_of_set: bool = field(default=False, repr=False)


def order_parts(
    files: Sets | None = None,
    output: str | Path = "out",
    *,
    only: str | None = None,
    capability: str | float | None = None,
    masks: bool = False,
    announce: Callable[[PartOrder], None] | None = None,
) -> list[PartOrder]:
    """Write drawings and sheets of all parts of stimulus files, and their routes.

    Parameters
    ----------
    files : str, Path, StimulusSet or sequence of them, optional
        Stimulus files, folders of them, or sets; the folder ``stimuli`` where omitted.
    output : str or Path, optional
        Output folder; the files go to ``output/set/id``, where `build` puts the STEP files.
    only : str, optional
        Pattern such as ``"step-0?0"`` or ``"paper-ten/*"``.
    capability : str or float, optional
        Largest deviation of a height that the workshop holds in one piece, such as ``"1 um"``, or
        in metres; 2 um, ground and not lapped, where omitted.
    masks : bool
        Whether the masks of the etched steps of each set are written, too: of its step blocks of
        silicon, as ``output/set/set.masks.gds`` with a table of the etches (extra ``masks``).
    announce : callable, optional
        Called with the order of each part as soon as it is written.

    Returns
    -------
    list of PartOrder
        One of each part, one of each series of blocks that differ in height only, one of each kit
        of the apparatus, one of the parts list and the archive for a quotation of each whole set,
        and one of the masks of each set.

    Raises
    ------
    StepblocksError
        If a file cannot be read, nothing is selected, a folder to write to lies behind a link, or
        masks are asked for and no step block is of silicon, or parts of a kit are in each other's
        way.
    """
    deviation = _parse_capability(capability)
    output = Path(output)
    orders: list[PartOrder] = []
    sets = [stimuli for stimuli, _ in load_sets(files)]
    selected = select_stimuli(sets, only)
    if masks:
        load_gdstk()  # before any part is drawn
        _require_etched_blocks([part for _, part in selected])
    with lock_folder(output):
        for stimuli, part in selected:
            order = _write_part_order(part, output, deviation, stimuli)
            orders.append(order)
            if announce is not None:
                announce(order)
        for stimuli in sets:
            parts = [part for owner, part in selected if owner is stimuli]
            series = _find_series_blocks(parts)
            if len(series) > 1:
                orders.append(_write_series_of_set(series, output, stimuli))
            for kit in find_complete_kits(parts):
                orders.append(_write_kit_of_set(kit, output, stimuli))
            if only is None:  # a part of a set is no order of it
                orders.append(_write_bundle_of_set(parts, output, stimuli))
            etched = _find_etched_blocks(parts)
            if masks and etched:
                orders.append(_write_masks_of_set(etched, output, stimuli))
    return orders


def _find_etched_blocks(parts: Sequence[Part]) -> list[StepBlock]:
    """Find the step blocks that are etched: those of silicon with a single step."""
    etched = []
    for part in parts:
        is_single_step = isinstance(part, StepBlock) and part.second_step is None
        if isinstance(part, StepBlock) and is_single_step and part.material == MATERIALS[SILICON]:
            etched.append(part)
    return etched


def _require_etched_blocks(parts: Sequence[Part]) -> None:
    """Refuse masks where nothing is etched."""
    if not _find_etched_blocks(parts):
        names = sorted({part.material.name for part in parts})
        raise PipelineError(
            f'masks need a step block of material = "{SILICON}" with a single step, got parts of '
            f"{', '.join(names)}"
        )


def _write_masks_of_set(
    blocks: Sequence[StepBlock], output: Path, stimuli: StimulusSet
) -> PartOrder:
    """Write the masks of the silicon blocks of a set."""
    folder = _make_folder_inside(output, stimuli.name)
    written = write_masks(folder / f"{stimuli.name}.masks.gds", blocks)
    return PartOrder(f"{stimuli.name}/masks", tuple(written), (), is_of_set=True)


def _parse_capability(capability: str | float | None) -> float:
    """Return the deviation that a workshop holds in one piece [m]."""
    if capability is None:
        return parse_quantity(GROUND, "length")
    if isinstance(capability, str):
        return parse_quantity(capability, "length")
    return capability


def _find_series_blocks(parts: Sequence[Part]) -> list[StepBlock]:
    """Find the blocks of a single step that differ from the first one in their heights only."""
    blocks = []
    for part in parts:
        if isinstance(part, StepBlock) and part.second_step is None:
            blocks.append(part)
    series = []
    for block in blocks:
        first = blocks[0]
        as_first = block.model_copy(update={"id": first.id, "height": first.height})
        if as_first == first:
            series.append(block)
    return series


def _write_series_of_set(
    series: Sequence[StepBlock], output: Path, stimuli: StimulusSet
) -> PartOrder:
    """Write the drawing of a series."""
    folder = _make_folder_inside(output, stimuli.name)
    drawings = write_series_drawing(folder, stimuli.name, series, stimuli.order)
    return PartOrder(f"{stimuli.name}/series", tuple(drawings), (), is_of_set=True)


def _write_bundle_of_set(parts: Sequence[Part], output: Path, stimuli: StimulusSet) -> PartOrder:
    """Write the parts list of a set, and the archive of its papers."""
    folder = _make_folder_inside(output, stimuli.name)
    alike = stimuli.describe_alike()
    ordered = [OrderedPart(part, folder / part.id, alike.get(part.id, "")) for part in parts]
    written = write_bundle(folder, stimuli, ordered)
    return PartOrder(f"{stimuli.name}/quotation", tuple(written), (), is_of_set=True)


def _write_kit_of_set(kit: Apparatus, output: Path, stimuli: StimulusSet) -> PartOrder:
    """Write what a kit has beside its parts: assembly, lists, loads and pictures."""
    folder = _make_folder_inside(output, stimuli.name)
    written = write_kit_assembly_files(folder, kit, stimuli.order)
    return PartOrder(f"{stimuli.name}/{kit.id}", tuple(written), (), is_of_set=True)


def _make_folder_inside(output: Path, name: str) -> Path:
    """Make a folder inside the output folder; raise a PipelineError if a link leads out of it."""
    folder = resolve_inside(output, name)
    if folder is None:
        raise PipelineError(
            f"the folder must lie in the output folder, with no link on the way [{output / name}]"
        )
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _write_part_order(
    part: Part, output: Path, capability: float, stimuli: StimulusSet
) -> PartOrder:
    """Write all files of one part; `capability` is what the workshop holds in one piece [m]."""
    name = f"{stimuli.name}/{part.id}"
    folder = _make_folder_inside(output, name)
    written = write_drawing(folder, part, order=stimuli.order)
    plan = folder / f"{part.id}.plan.qif"
    write_qif(plan, part, stimuli.order)
    written.append(plan)
    routes: list[Route] = []
    pair: GaugePair | None = None
    missing_drawing = ""
    if isinstance(part, StepBlock):
        routes = list_routes(part, capability, stimuli.prediction.make_first_operating_point())
        written.append(_write_routes(folder, part, name, routes))
        # two blocks of the set differ by this height
        has_pair = any(route.process.name == GAUGE_BLOCKS for route in routes)
        if has_pair and part.second_step is None:
            pair = require_gauge_pair(part.height.nominal)
            assembly = folder / f"{part.id}.gauge.step"
            write_gauge_assembly(assembly, part, pair)
            written.append(assembly)
        missing_drawing = explain_missing_gauge_drawing(part, pair)
        if pair is not None and not missing_drawing:
            route = find_gauge_route(routes, pair)
            written += write_gauge_drawing(folder, part, pair, route, stimuli.order)
    if isinstance(part, Block):
        written += write_setup_sheet_and_stock(folder, part, routes, pair)
    elif isinstance(part, KitPart):
        written += write_kit_setup_sheet_and_stock(folder, part)
    written += _write_inspection_sheet(folder, part, stimuli.order)
    notes = [
        stimuli.describe_alike().get(part.id, ""),
        _describe_missing_papers(part),
        missing_drawing,
    ]
    note = "; ".join(text for text in notes if text)
    return PartOrder(name, tuple(written), tuple(routes), note)


def _describe_missing_papers(part: Part) -> str:
    """Say why a part has no setup sheet or no routes; empty where it has both."""
    if isinstance(part, StepBlock):
        return ""
    if isinstance(part, Block):
        return "no routes: nobody publishes what a way of making leaves at a gap"
    if isinstance(part, KitPart):
        return ""
    for kind, way in _MADE_ELSEWHERE.items():
        if isinstance(part, kind):
            return f"no setup sheet and no routes: {way}"
    return "no setup sheet and no routes: they are for blocks alone"


def _write_routes(folder: Path, block: StepBlock, name: str, routes: Sequence[Route]) -> Path:
    """Write the table of the routes of a block; return its path."""
    path = folder / f"{block.id}.routes.csv"
    rows = [make_route_row(name, route) for route in routes]
    write_table(pd.DataFrame(rows), path)
    return path


def _write_inspection_sheet(folder: Path, part: Part, order: OrderSpec) -> list[Path]:
    """Write the inspection sheet as CSV and as HTML."""
    table = make_inspection_sheet_table(part)
    table_path = folder / f"{part.id}.inspection-sheet.csv"
    write_table(table, table_path)
    page_path = folder / f"{part.id}.inspection-sheet.html"
    page = render_page(
        "stepblocks.workshop",
        "sheet.html",
        part=part,
        order=order,
        rows=table.to_dict("records"),
        guard=GUARD_FACTOR,
    )
    replace_text(page_path, page)
    return [table_path, page_path]


def tabulate_routes(orders: Iterable[PartOrder]) -> list[dict[str, object]]:
    """Tabulate the routes of step blocks: height reached, energy, conforming share."""
    rows = []
    for order in orders:
        for route in order.routes:
            row = make_route_row(order.name, route)
            rows.append({column: row[column] for column in _SHOWN_COLUMNS})
    return rows
