"""Everything a workshop gets besides the STEP file: drawings, sheets, routes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.select import select_stimuli
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, replace_text, resolve_inside
from stepblocks.files.pages import render_page
from stepblocks.files.tables import write_table
from stepblocks.parts.body import Block
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.on_paper import make_sheet_table
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.quantities import parse_quantity
from stepblocks.records.qif import write_qif
from stepblocks.workshop.drawing import write_drawing, write_series_drawing
from stepblocks.workshop.gauge_route import choose_pair, write_gauge_assembly
from stepblocks.workshop.routes import Route, find_routes, make_route_row
from stepblocks.workshop.setup import write_setup

_SHOWN: tuple[str, ...] = (
    "part",
    "route",
    "reaches",
    "conforming_share",
    "energy_uj",
    "energy_95_low_uj",
    "energy_95_high_uj",
    "height_deviation_um",
    "permitted_um",
    "status",
    "note",
)
GROUND = "2 um"  # deviation of a height in one piece that is ground, not lapped


@dataclass(frozen=True)
class PartOrder:
    """What was written for one part.

    Attributes
    ----------
    name : str
        ``"set/id"``.
    files : tuple of Path
        Drawings, for a step block also of the two-piece variant, and sheets.
    routes : tuple of Route
        Ways to make a step block; empty for other parts.
    note : str
        Which block of the set has the same sizes.
    """

    name: str
    files: tuple[Path, ...] = field(repr=False)
    routes: tuple[Route, ...] = field(repr=False)
    note: str = ""


def order_parts(
    files: Sets | None = None,
    output: str | Path = "out",
    *,
    only: str | None = None,
    capability: str | float | None = None,
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
    announce : callable, optional
        Called with the order of each part as soon as it is written.

    Returns
    -------
    list of PartOrder
        One of each part, and one of each series of blocks that differ in height only.

    Raises
    ------
    StepblocksError
        If a file cannot be read, nothing is selected, or a folder to write to lies behind a link.
    """
    held = GROUND if capability is None else capability
    held = parse_quantity(held, "length") if isinstance(held, str) else held
    orders: list[PartOrder] = []
    sets = [declared for declared, _ in load_sets(files)]
    selected = select_stimuli(sets, only)
    with lock_folder(Path(output)):
        for declared, one in selected:
            orders.append(_order_part(one, Path(output), held, declared))
            if announce is not None:
                announce(orders[-1])
        for declared in sets:
            blocks = [
                one for its, one in selected if its is declared and isinstance(one, StepBlock)
            ]
            alike = [  # but for their heights
                one
                for one in blocks
                if one.model_copy(update={"id": blocks[0].id, "height": blocks[0].height})
                == blocks[0]
            ]
            if len(alike) > 1:
                drawn = write_series_drawing(
                    _make_folder(Path(output), declared.name),
                    declared.name,
                    alike,
                    declared.order,
                )
                orders.append(PartOrder(f"{declared.name}/series", tuple(drawn), ()))
    return orders


def _make_folder(output: Path, name: str) -> Path:
    folder = resolve_inside(output, name)
    if folder is None:
        raise PipelineError(
            f"the folder must lie in the output folder, with no link on the way [{output / name}]"
        )
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _order_part(part: Part, output: Path, capability: float, declared: StimulusSet) -> PartOrder:
    name = f"{declared.name}/{part.id}"
    order = declared.order
    folder = _make_folder(output, name)
    written = [*write_drawing(folder, part, order=order), folder / f"{part.id}.plan.qif"]
    write_qif(written[-1], part, order)
    routes: list[Route] = []
    pair = None
    if isinstance(part, StepBlock):
        routes = find_routes(part, capability, declared.prediction.first_point())
        written.append(folder / f"{part.id}.routes.csv")
        write_table(pd.DataFrame([make_route_row(name, route) for route in routes]), written[-1])
        # two blocks of the set differ by this height
        if any(route.process.name == "gauge blocks" for route in routes):
            pair = choose_pair(part.height.nominal)
            written.append(folder / f"{part.id}.gauge.step")
            write_gauge_assembly(written[-1], part, pair)
    if isinstance(part, Block):
        written += write_setup(folder, part, routes, pair)
    sheets = [folder / f"{part.id}.inspection-sheet.{form}" for form in ("csv", "html")]
    table = make_sheet_table(part)
    write_table(table, sheets[0])
    replace_text(
        sheets[1],
        render_page(
            "stepblocks.workshop",
            "sheet.html",
            part=part,
            order=order,
            rows=table.to_dict("records"),
            guard=GUARD_FACTOR,
        ),
    )
    return PartOrder(
        name, (*written, *sheets), tuple(routes), declared.describe_alike().get(part.id, "")
    )


def tabulate_routes(orders: Iterable[PartOrder]) -> list[dict[str, object]]:
    """Tabulate the routes of step blocks: height reached, energy, conforming share."""
    rows = (
        make_route_row(order.name, route) | {"reaches": "yes" if route.reaches else "no"}
        for order in orders
        for route in order.routes
    )
    return [{name: row[name] for name in _SHOWN} for row in rows]
