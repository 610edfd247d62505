"""Everything a workshop is sent besides the STEP file: drawings, inspection sheets, and the route that reaches a tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from stepblocks.artefacts.inspection_sheet import write_sheet_csv, write_sheet_pdf
from stepblocks.declare import load_declared
from stepblocks.errors import MachiningError, PipelineError
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.drawing.write import write_drawing, write_gauge_drawing
from stepblocks.workshop.gauge_route import Route, choose_pair, routes_for, write_gauge_assembly


@dataclass(frozen=True)
class Order:
    """What was written for one part."""

    name: str  # ``"set/id"``
    files: tuple[Path, ...]  # Drawings, sheets, and for a step block the two-piece variant
    routes: tuple[Route, ...]  # Ways to make a step block; empty for other parts


def write_orders(
    files: list[Path],
    output: Path,
    only: str | None,
    capability: float,
    announce: Callable[[Order], None] | None = None,
) -> list[Order]:
    """Write drawings and sheets of all parts of stimulus files.

    Parameters
    ----------
    files : list of Path
        Stimulus files.
    output : Path
        Output folder; the files go to ``output/set/id``, where `build` puts the STEP files.
    only : str, optional
        Pattern such as ``"step-0?0"`` or ``"paper-ten/*"``.
    capability : float
        Largest deviation of a height that the workshop holds in one piece [m].
    announce : callable, optional
        Called after each part.

    Returns
    -------
    list of Order
        One per part.

    Raises
    ------
    PipelineError
        If nothing is selected.
    StimulusError
        If a file cannot be read.
    """
    orders = []
    for path in files:
        declared = load_declared(path)
        for stimulus in declared.stimuli:
            name = f"{declared.name}/{stimulus.id}"
            if only is not None and not (fnmatchcase(stimulus.id, only) or fnmatchcase(name, only)):
                continue
            folder = output / declared.name / stimulus.id
            folder.mkdir(parents=True, exist_ok=True)
            written = write_drawing(folder, stimulus)
            sheets = [folder / f"{stimulus.id}.inspection-sheet.{form}" for form in ("csv", "pdf")]
            write_sheet_csv(sheets[0], stimulus)
            write_sheet_pdf(sheets[1], stimulus)
            routes: list[Route] = []
            if isinstance(stimulus, StepBlock):
                routes = routes_for(stimulus, capability)
                written += _two_piece(folder, stimulus)
            order = Order(name, (*written, *sheets), tuple(routes))
            orders.append(order)
            if announce is not None:
                announce(order)
    if not orders:
        raise PipelineError(f"selection must match at least one stimulus, got {only!r}")
    return orders


def _two_piece(folder: Path, block: StepBlock) -> list[Path]:
    try:
        pair = choose_pair(block.height.nominal)
    except MachiningError:
        return []  # no two blocks of the set differ by this height; the table of routes says so by their absence
    path = folder / f"{block.id}.gauge.step"
    write_gauge_assembly(path, block, pair.grade)
    return [path, *write_gauge_drawing(folder, block, pair)]


def route_table(orders: list[Order]) -> str:
    """Return which route reaches each step block's tolerance."""
    head = f"{'part':26} {'route':22} {'deviation um':>12} {'permitted um':>12}  reaches"
    lines = [head, "-" * len(head)]
    for order in orders:
        for route in order.routes:
            lines.append(
                f"{order.name:26} {route.name:22} {route.deviation * 1e6:12.2f} {route.tolerance * 1e6:12.2f}  "
                f"{'yes' if route.reaches else 'no':7} {route.note}"
            )
    return "\n".join(lines)
