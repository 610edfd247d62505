"""Everything a workshop is sent besides the STEP file: drawings, inspection sheets, and the route that reaches a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from stepblocks.artefacts.on_paper import write_sheet_csv, write_sheet_pdf
from stepblocks.artefacts.qif import write_qif
from stepblocks.atomic import alone_in, inside
from stepblocks.declare import load_declared, load_kit
from stepblocks.errors import PipelineError
from stepblocks.parts.apparatus import Kit
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.quantities import parse_quantity
from stepblocks.select import matches, stimulus_files
from stepblocks.workshop.complete import missing_from
from stepblocks.workshop.drawing import write_drawing, write_gauge_drawing
from stepblocks.workshop.gauge_route import Route, choose_pair, routes_for, write_gauge_assembly
from stepblocks.workshop.kit import write_kit

GROUND = "2 um"  # deviation of a height in one piece that is ground, not lapped


@dataclass(frozen=True)
class Order:
    """What was written for one part."""

    name: str  # ``"set/id"``
    files: tuple[Path, ...]  # drawings, for a step block also of the two-piece variant, and sheets
    routes: tuple[Route, ...]  # ways to make a step block; empty for other parts
    missing: tuple[str, ...] = ()  # from drawing and sheet, and from the STEP file where the part has been built


def order_parts(
    files: str | Path | Sequence[str | Path] | None = None,
    output: str | Path = "out",
    *,
    only: str | None = None,
    capability: str | float | None = None,
    announce: Callable[[Order], None] | None = None,
) -> list[Order]:
    """Write drawings and sheets of all parts of stimulus files, and say which route reaches each tolerance.

    Parameters
    ----------
    files : str, Path or sequence of them, optional
        Stimulus files, or folders of them; the folder ``stimuli`` where omitted.
    output : str or Path, optional
        Output folder; the files go to ``output/set/id``, where `build` puts the STEP files.
    only : str, optional
        Pattern such as ``"step-0?0"`` or ``"paper-ten/*"``.
    capability : str or float, optional
        Largest deviation of a height that the workshop holds in one piece, such as ``"1 um"``, or in metres; 2 um, ground
        and not lapped, where omitted.
    announce : callable, optional
        Called after each part.

    Returns
    -------
    list of Order
        One of each part.

    Raises
    ------
    StepblocksError
        If a file cannot be read, nothing is selected, or a folder to write to lies behind a link.
    """
    held = GROUND if capability is None else capability
    held = parse_quantity(held, "length") if isinstance(held, str) else held
    orders = []
    with alone_in(Path(output)):
        for path in stimulus_files(files):
            if (kit := load_kit(path)) is not None:
                orders += _order_kits(path.stem, kit, Path(output), only)
                if announce is not None and orders:
                    announce(orders[-1])
                continue
            declared = load_declared(path)
            for stimulus in declared.stimuli:
                if only is None or matches(only, declared.name, stimulus.id):
                    name = f"{declared.name}/{stimulus.id}"
                    orders.append(_order(name, stimulus, Path(output), held, declared.order))
                    if announce is not None:
                        announce(orders[-1])
    if not orders:
        raise PipelineError(f"selection must match at least one stimulus, got {only!r}")
    return orders


def _order_kits(set_name: str, kit: Kit, output: Path, only: str | None) -> list[Order]:
    orders = []
    for one in kit.apparatus:
        if only is None or matches(only, set_name, one.id):
            files, wrong = write_kit(_folder(output, f"{set_name}/{one.id}"), one, kit.order)
            orders.append(Order(f"{set_name}/{one.id}", tuple(files), (), tuple(wrong)))
    return orders


def _folder(output: Path, name: str) -> Path:
    folder = inside(output, name)
    if folder is None:
        raise PipelineError(f"the folder must lie in the output folder, with no link on the way [{output / name}]")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _order(name: str, stimulus: Part, output: Path, capability: float, said: OrderSpec) -> Order:
    folder = _folder(output, name)
    written = [*write_drawing(folder, stimulus, order=said), folder / f"{stimulus.id}.plan.qif"]
    write_qif(written[-1], stimulus, said)
    routes: list[Route] = []
    if isinstance(stimulus, StepBlock):
        routes = routes_for(stimulus, capability)
        if len(routes) > 1:  # two blocks of the set differ by this height
            pair = choose_pair(stimulus.height.nominal)
            assembly = folder / f"{stimulus.id}.gauge.step"
            write_gauge_assembly(assembly, stimulus, pair)
            written += [assembly, *write_gauge_drawing(folder, stimulus, pair, said)]
    sheets = [folder / f"{stimulus.id}.inspection-sheet.{form}" for form in ("csv", "pdf")]
    write_sheet_csv(sheets[0], stimulus)
    write_sheet_pdf(sheets[1], stimulus)
    step = folder / f"{stimulus.id}.step"
    missing = missing_from(stimulus, written[0], step if step.is_file() else None, sheets[0])
    return Order(name, (*written, *sheets), tuple(routes), tuple(missing))


def route_table(orders: Iterable[Order]) -> str:
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
