"""The setup and probing sheet of a part of the apparatus: stock, sides, datums, limits."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from stepblocks.artefacts.step.write import write_conforming_step
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.solids import Box, Cylinder
from stepblocks.parts.apparatus.stock import choose_stock_solid
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kinds.kit_part import KitPart
from stepblocks.parts.on_paper import format_millimetres
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.workshop.setup import (
    ProbedLine,
    format_acceptance_limits,
    format_drawn_limits,
    is_proved_by_probe,
)
from stepblocks.workshop.setup_limits import PROBE

_SAME = 1e-9  # coordinates that differ by less are one [m]
_MM = 1e3  # millimetres of a metre


class Side(Enum):
    """The side of a part that is up in a setup, with its axis and its way along it."""

    BASE = ("base", 2, -1)
    TOP = ("top", 2, 1)
    LEFT = ("left", 0, -1)
    RIGHT = ("right", 0, 1)
    FRONT = ("front", 1, -1)
    BACK = ("back", 1, 1)

    @property
    def label(self) -> str:
        """What it is called."""
        label, _, _ = self.value
        return label

    def gives_access_to(self, component: Component, bore: Cylinder) -> bool:
        """Tell whether a bore is open to this side, so that a drill can enter from it."""
        _, axis, way = self.value
        if bore.axis_index != axis:
            return False
        end = bore.end[axis] if way > 0 else bore.start[axis]
        beyond = end + way * 10.0 * _SAME
        return not any(_contains_bore_axis_at(box, bore, beyond) for box in component.boxes)


@dataclass(frozen=True)
class SetupLine:
    """A setup of a sheet, as texts."""

    number: int
    side: str
    clamping: str
    datum: str
    work: Sequence[str]


def _contains_bore_axis_at(box: Box, bore: Cylinder, coordinate: float) -> bool:
    """Tell whether a box holds the point on the axis of a bore at a coordinate [m]."""
    point = list(bore.start)
    point[bore.axis_index] = coordinate
    return all(box.low[axis] - _SAME < point[axis] < box.high[axis] + _SAME for axis in range(3))


def write_kit_setup_sheet_and_stock(folder: Path, part: KitPart) -> list[Path]:
    """Write setup sheet and stock of a part of the apparatus.

    Parameters
    ----------
    folder : Path
        Where the files go.
    part : KitPart
        What is made.

    Returns
    -------
    list of Path
        The sheet as HTML and the stock as STEP.
    """
    component = part.placed_component
    stock = choose_stock_solid(component)
    setups = _list_setups(component)
    text = render_page(
        "stepblocks.workshop",
        "kit_setup.html",
        part=part,
        component=component,
        stock=_describe_stock(stock),
        setups=[line for line, _ in setups],
        probed=list(_yield_probing_lines(part, component, setups)),
        probe=f"{PROBE * 1e6:g} um",
        guard=GUARD_FACTOR,
    )
    page = folder / f"{part.id}.setup.html"
    replace_text(page, text)
    solid = folder / f"{part.id}.stock.step"
    name = f"{part.id}-stock"
    write_conforming_step(solid, name, [(name, stock.build_solid())], part.material, [])
    return [page, solid]


def _describe_stock(stock: Box | Cylinder) -> str:
    """Say what is cut off from plate, bar or round bar."""
    if isinstance(stock, Cylinder):
        diameter = format_millimetres(stock.diameter, 1)
        return f"round bar, diameter {diameter} mm, {format_millimetres(stock.length, 1)} mm long"
    sizes = " x ".join(format_millimetres(size, 1) for size in stock.sizes)
    return f"plate or bar, {sizes} mm"


def _list_setups(component: Component) -> list[tuple[SetupLine, list[Cylinder]]]:
    """List the setups of a component, each with the bores that are made in it."""
    if component.is_turned:
        return [(_make_turning_setup(component), list(component.bores))]
    setups: list[tuple[SetupLine, list[Cylinder]]] = []
    waiting = list(component.bores)
    for side in Side:
        bores = [bore for bore in waiting if side.gives_access_to(component, bore)]
        # base and top are milled in any case
        if not bores and side not in (Side.BASE, Side.TOP):
            continue
        waiting = [bore for bore in waiting if bore not in bores]
        number = len(setups) + 1
        setups.append((_make_milling_setup(component, side, number, bores), bores))
    return setups


def _make_turning_setup(component: Component) -> SetupLine:
    """Return the line of the one setup of a part that is turned."""
    work = [f"face and turn R{number}" for number in range(1, len(component.rods) + 1)]
    work += [_describe_bore_work(component, bore) for bore in component.bores]
    work.append("part off and face to length")
    return SetupLine(1, "end", "chuck", "axis of the bar, its faced end", work)


def _make_milling_setup(
    component: Component, side: Side, setup_number: int, bores: Sequence[Cylinder]
) -> SetupLine:
    """Return the line of a setup with one side up."""
    clamping = "vice on two sides, the base or a milled side on parallels"
    datum = "left, front and base as milled"
    work = []
    if side is Side.BASE:
        clamping = "vice on two long sides of the stock, base up"
        datum = "middle of the stock along x and y, its upper side along z"
        work.append("mill the base")
    elif side is Side.TOP:
        clamping = "vice, base down on parallels"
        work.append("mill the sides and all faces that are seen from above")
    work += [_describe_bore_work(component, bore) for bore in bores]
    return SetupLine(setup_number, f"{side.label} up", clamping, datum, work)


def _describe_bore_work(component: Component, bore: Cylinder) -> str:
    """Say how a bore is made."""
    name = f"B{component.bores.index(bore) + 1}"
    diameter = f"{bore.diameter * _MM:g}"
    if bore.inward is not None:
        return f"{name}: bore {diameter} with the other half screwed on"
    if bore.thread:
        return f"{name}: drill {diameter}, tap {bore.thread}-6H"
    if bore.deviations is not None:
        return f"{name}: drill and ream {diameter}"
    return f"{name}: drill {diameter}"


def _yield_probing_lines(
    part: KitPart,
    component: Component,
    setups: Sequence[tuple[SetupLine, list[Cylinder]]],
) -> Iterator[ProbedLine]:
    """Yield where each characteristic is measured, and what the machine accepts."""
    for number, characteristic in enumerate(part.characteristics(), start=1):
        place = f"off the machine: {characteristic.method}"
        accepted = "-"
        if is_proved_by_probe(characteristic):
            setup = _find_probing_setup(characteristic, component, setups)
            place = f"setup {setup.number}"
            accepted = format_acceptance_limits(characteristic)
        yield ProbedLine(
            str(number), characteristic.label, format_drawn_limits(characteristic), place, accepted
        )


def _find_probing_setup(
    characteristic: Characteristic,
    component: Component,
    setups: Sequence[tuple[SetupLine, list[Cylinder]]],
) -> SetupLine:
    """Find the setup in which a characteristic is probed: that of its bore, or the second."""
    words = characteristic.key.split("_")
    if words[0] == "bore":
        bore = component.bores[int(words[1]) - 1]
        for line, bores in setups:
            if bore in bores:
                return line
    line, _ = setups[min(1, len(setups) - 1)]
    return line
