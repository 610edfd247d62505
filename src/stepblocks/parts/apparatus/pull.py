"""What pulls: bracket, pulley, its axle and the hanger of the weights, in millimetres.

The upper side of the pulley lies at the height of the tip, so that the cord runs level.
"""

from collections.abc import Iterator

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.frame import SCREWS_OF_THE_BRACKET
from stepblocks.parts.apparatus.solids import (
    Deviations,
    make_bore_mm,
    make_box_mm,
    make_rod_mm,
    repeat_bore_along_axis,
)

PULLEY_DIAMETER = 20e-3  # [m]
PULLEY_BORE = 3e-3  # of its bearing [m]
_AXIS = (72.0, -10.0)  # x and z of the pulley
_H6 = Deviations(0.0, -6e-6)  # of a pin up to 3 mm (ISO 286-2) [m]


def yield_pull_components() -> Iterator[Component]:
    """Yield the components that pull at the hook of the carriage, from pulley to hanger."""
    x, z = _AXIS
    yield _make_pulley_bracket()
    wheel = make_rod_mm("y", (x, -2.0, z), 1e3 * PULLEY_DIAMETER, 4.0)
    yield Component(
        "pulley",
        "Pulley",
        "steel",
        rods=(wheel,),
        bores=(make_bore_mm("y", (x, -2.0, z), 1e3 * PULLEY_BORE, 4.0),),
        designation="pulley, groove 20, on ball bearing 623 (ISO 15)",
    )
    yield Component(
        "pulley-axle",
        "Axle of the pulley",
        "steel",
        rods=(make_rod_mm("y", (x, -8.0, z), 1e3 * PULLEY_BORE, 16.0, _H6),),
        designation="parallel pin 3 h6 x 16 (ISO 8734)",
    )
    plate = make_rod_mm("z", (82.0, 0.0, -160.0), 24.0, 3.0)
    stem = make_rod_mm("z", (82.0, 0.0, -157.0), 3.0, 60.0)
    yield Component("weight-hanger", "Weight hanger", "brass", rods=(plate, stem))


def _make_pulley_bracket() -> Component:
    """Make the bracket: two cheeks on a foot."""
    x, z = _AXIS
    left = make_box_mm((64.0, -8.0, -30.0), (80.0, -4.0, -2.0))
    right = make_box_mm((64.0, 4.0, -30.0), (80.0, 8.0, -2.0))
    foot = make_box_mm((64.0, -4.0, -30.0), (80.0, 4.0, -24.0))
    bearing = make_bore_mm("y", (x, 0.0, z), 1e3 * PULLEY_BORE, 4.0, "H7")
    bores = repeat_bore_along_axis(bearing, "y", (-8.0, 4.0))
    for screw_x, screw_y in SCREWS_OF_THE_BRACKET:
        bores.append(make_bore_mm("z", (screw_x, screw_y, -30.0), 3.3, 10.0, "M4"))
    return Component(
        "pulley-bracket",
        "Bracket of the pulley",
        "aluminium",
        boxes=(left, right, foot),
        bores=tuple(bores),
        is_printable=True,
    )
