"""The frame: base, seat of the blocks, two portals and the shafts between them.

All sizes are in millimetres; x runs along the drag, y along the edge, z up from the tip.
"""

import itertools
from collections.abc import Iterator

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.solids import (
    Deviations,
    make_bore_mm,
    make_box_mm,
    make_rod_mm,
    repeat_bore_along_axis,
)

SHAFT_RISE = 11.0  # of the axes of the shafts over the lower face of the carriage
SHAFTS = {"left": -30.0, "right": 30.0}  # y of their axes
_SHAFT = 8.0  # diameter
_H6 = Deviations(0.0, -9e-6)  # of 6 to 10 mm (ISO 286-2) [m]
_PORTALS = {"rear": -116.0, "front": 44.0}  # x of their rear faces
_FEET_OF_THE_PORTALS = (-44.0, 44.0)  # y of their screws
SCREWS_OF_THE_SHANK_CLAMP = -52.0  # x of screws into the base
SCREWS_OF_THE_SHEATH_JAW = -20.0
SCREWS_OF_THE_JAWS = (72.0, 88.0)  # their y
RELEASE_SCREW = (46.0, 80.0)
SCREWS_OF_THE_BRACKET = ((70.0, -6.0), (70.0, 6.0))
_SEAT_SCREWS = ((0.0, -10.0), (0.0, 10.0))
_BLOCK_SCREWS = (-6.0, 6.0)  # their x


def yield_frame_components(carriage_low_mm: float) -> Iterator[Component]:
    """Yield the components of the frame, for a carriage whose lower face lies at a height [mm]."""
    shaft_height = carriage_low_mm + SHAFT_RISE
    yield _make_base_plate()
    yield _make_block_seat()
    for name, x in _PORTALS.items():
        yield _make_portal(name, x, shaft_height)
    for name, y in SHAFTS.items():
        rod = make_rod_mm("x", (-116.0, y, shaft_height), _SHAFT, 172.0, _H6)
        yield Component(
            f"shaft-{name}",
            "Shaft",
            "steel",
            rods=(rod,),
            designation="precision shaft 8 h6 x 172, hardened (ISO 286-2)",
        )


def _make_base_plate() -> Component:
    """Make the plate that carries everything, with a hole for each screw from below."""
    screws = [*_SEAT_SCREWS, *SCREWS_OF_THE_BRACKET, RELEASE_SCREW]
    for x in _PORTALS.values():
        screws += itertools.product([x + 6.0], _FEET_OF_THE_PORTALS)
    clamps = (SCREWS_OF_THE_SHANK_CLAMP, SCREWS_OF_THE_SHEATH_JAW)
    screws += itertools.product(clamps, SCREWS_OF_THE_JAWS)
    bores = []
    for x, y in screws:
        bores.append(make_bore_mm("z", (x, y, -40.0), 4.5, 10.0))
    # through which the screws of the block are reached
    access = make_bore_mm("z", (0.0, 0.0, -40.0), 7.0, 10.0)
    bores += repeat_bore_along_axis(access, "x", _BLOCK_SCREWS)
    plate = make_box_mm((-130.0, -60.0, -40.0), (80.0, 100.0, -30.0))
    return Component("base", "Base plate", "aluminium", boxes=(plate,), bores=tuple(bores))


def _make_block_seat() -> Component:
    """Make the seat: a block lies on it against a stop, and is screwed on from below."""
    hole = make_bore_mm("z", (0.0, 0.0, -24.0), 3.4, 16.0)
    counterbore = make_bore_mm("z", (0.0, 0.0, -30.0), 6.5, 6.0)
    bores = repeat_bore_along_axis(hole, "x", _BLOCK_SCREWS)
    bores += repeat_bore_along_axis(counterbore, "x", _BLOCK_SCREWS)
    for x, y in _SEAT_SCREWS:
        bores.append(make_bore_mm("z", (x, y, -30.0), 3.3, 12.0, "M4"))
    body = make_box_mm((-17.0, -14.0, -30.0), (12.0, 14.0, -8.0))
    stop = make_box_mm((-17.0, -14.0, -8.0), (-10.0, 14.0, -2.0))
    return Component(
        "block-seat",
        "Seat of the blocks",
        "aluminium",
        boxes=(body, stop),
        bores=tuple(bores),
        is_printable=True,
    )


def _make_portal(name: str, x_mm: float, shaft_height_mm: float) -> Component:
    """Make a portal whose two columns hold the ends of the shafts."""
    top = shaft_height_mm + SHAFT_RISE
    foot = make_box_mm((x_mm, -50.0, -30.0), (x_mm + 12.0, 50.0, -18.0))
    columns = []
    for y in SHAFTS.values():
        columns.append(make_box_mm((x_mm, y - 8.0, -18.0), (x_mm + 12.0, y + 8.0, top)))
    seat = make_bore_mm("x", (x_mm, 0.0, shaft_height_mm), _SHAFT, 12.0, "H7")
    thread = make_bore_mm("z", (x_mm + 6.0, 0.0, -30.0), 3.3, 10.0, "M4")
    bores = repeat_bore_along_axis(seat, "y", SHAFTS.values())
    bores += repeat_bore_along_axis(thread, "y", _FEET_OF_THE_PORTALS)
    return Component(
        f"portal-{name}",
        f"Portal of the shafts, {name}",
        "aluminium",
        boxes=(foot, *columns),
        bores=tuple(bores),
        is_printable=True,
    )


def make_stand_in_block() -> Component:
    """Make the place of a step block, which the set of the blocks declares."""
    thread = make_bore_mm("z", (0.0, 0.0, -8.0), 2.5, 5.0, "M3")
    bores = repeat_bore_along_axis(thread, "x", _BLOCK_SCREWS)
    return Component(
        "block",
        "Step block",
        "steel",
        boxes=(make_box_mm((-10.0, -12.0, -8.0), (10.0, 12.0, 0.0)),),
        bores=tuple(bores),
        designation="any block of paper-ten",
    )
