"""What travels: carriage, flexure, yoke of the pivot, and the balanced arm with the explorer.

All sizes are in millimetres; x runs along the drag, y along the edge, z up from the tip. The axis
of the pivot lies at the height of the tip, so that a pull has no lever about it.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.declared import ENDS_OF_THE_LEAVES, Flexure
from stepblocks.parts.apparatus.frame import SHAFT_RISE, SHAFTS
from stepblocks.parts.apparatus.solids import (
    Box,
    Deviations,
    make_bore_mm,
    make_box_mm,
    make_rod_mm,
    repeat_bore_along_axis,
)
from stepblocks.parts.characteristics import (
    MICROMETER,
    Characteristic,
    FaceRule,
    make_characteristic,
)
from stepblocks.parts.material import MATERIALS
from stepblocks.parts.revolution import Point3
from stepblocks.parts.tolerance import Dimension

ARM = 40e-3  # from the pivot to the tip [m]
_PIVOT = -1e3 * ARM  # x of its axis
_FOOT = 42.0  # height of the lower ends of the leaves over the tip
_END = 6.0  # thickness of the ends of the leaves
_HALF_END = 0.5e3 * ENDS_OF_THE_LEAVES + 1.0  # from the middle of the flexure
_SCREWS = (_PIVOT - 12.0, _PIVOT + 12.0)  # x of the screws of flexure and yoke
PIVOT_BORE = 3e-3  # of the bearings of the pivot [m]
_H6 = Deviations(0.0, -6e-6)  # of a pin up to 3 mm (ISO 286-2) [m]
_H6_OF_THE_ROD = Deviations(0.0, -8e-6)  # of a rod of 3 to 6 mm, h6 (ISO 286-2) [m]
_SHANK = 2.35  # diameter of the explorer's shank
_GRIP = Deviations(10e-6, 0.0)  # of the bore that grips it [m]
_ARM_HEIGHT = 18.0  # of the middle of the arm over the tip
_WEIGHT = 24.0  # diameter of the weights
_WEIGHT_BORE = 2.5
_WEIGHT_FOOT = 22.0  # where a weight stands
_COUNTERWEIGHT = 9.0  # its diameter
_BALANCE_ROD = 4.0  # diameter
_COUNTERWEIGHT_PLACE = -85.0  # x of its middle, about
WEIGHT_NAME = "weight"


def compute_carriage_height_mm(leaf: Flexure) -> float:
    """Find the height of the lower face of the carriage over the tip [mm]."""
    return _FOOT + 1e3 * leaf.length.nominal + _END


def yield_balanced_arm_components(weight_mass: float) -> Iterator[Component]:
    """Yield the arm with clamp and explorer, a weight [kg] on it, and what balances it."""
    arm = list(_yield_arm_components())
    yield from arm
    yield _make_weight(weight_mass)
    rod = _make_balance_rod()
    yield rod
    yield _make_counterweight([*arm, rod])


def yield_carriage_components(carriage_low_mm: float) -> Iterator[Component]:
    """Yield the carriage with its linear bearings and the hook of the cord.

    Its lower face lies at a height [mm].
    """
    axis_height = carriage_low_mm + SHAFT_RISE
    bearing = make_bore_mm("x", (-63.0, 0.0, axis_height), 15.0, 46.0, "H7")
    hole = make_bore_mm("z", (0.0, 0.0, carriage_low_mm), 3.4, 22.0)
    thread = make_bore_mm("x", (-23.0, 0.0, carriage_low_mm + 6.0), 2.5, 6.0, "M3")
    bores = repeat_bore_along_axis(bearing, "y", SHAFTS.values())
    bores += repeat_bore_along_axis(hole, "x", _SCREWS)
    bores += repeat_bore_along_axis(thread, "y", _HOOK_SCREWS)
    yield Component(
        "carriage",
        "Carriage",
        "aluminium",
        boxes=(
            make_box_mm((-63.0, -42.0, carriage_low_mm), (-17.0, 42.0, carriage_low_mm + 22.0)),
        ),
        bores=tuple(bores),
        is_moving=True,
    )
    yield _make_hook(carriage_low_mm)
    for name, y in SHAFTS.items():
        tube = make_rod_mm("x", (-62.5, y, axis_height), 15.0, 45.0)
        yield Component(
            f"bearing-{name}",
            "Linear ball bearing",
            "steel",
            rods=(tube,),
            bores=(make_bore_mm("x", (-62.5, y, axis_height), 8.0, 45.0),),
            designation="linear ball bearing 8 x 15 x 45 (ISO 10285)",
            is_moving=True,
        )


_HOOK_SCREWS = (-10.0, 10.0)  # y of the screws of the hook into the carriage


def _make_hook(carriage_low_mm: float) -> Component:
    """Make the hook, at whose eye the cord pulls at the height of the tip.

    `carriage_low_mm` is the height of the lower face of the carriage over the tip [mm].
    """
    flange = make_box_mm(
        (-17.0, -14.0, carriage_low_mm + 2.0), (-13.0, 14.0, carriage_low_mm + 10.0)
    )
    beam = make_box_mm((-13.0, -4.0, carriage_low_mm + 2.0), (29.0, 4.0, carriage_low_mm + 10.0))
    post = make_box_mm((21.0, -4.0, -4.0), (29.0, 4.0, carriage_low_mm + 2.0))
    hole = make_bore_mm("x", (-17.0, 0.0, carriage_low_mm + 6.0), 3.4, 4.0)
    bores = repeat_bore_along_axis(hole, "y", _HOOK_SCREWS)
    bores.append(make_bore_mm("x", (21.0, 0.0, 0.0), 1.5, 8.0))
    return Component(
        "hook",
        "Hook of the cord",
        "aluminium",
        boxes=(flange, beam, post),
        bores=tuple(bores),
        is_moving=True,
        is_printable=True,
    )


def make_flexure(leaf: Flexure) -> Component:
    """Make the flexure in one piece: two leaves between a lower and an upper end."""
    upper_foot = _FOOT + 1e3 * leaf.length.nominal
    ends = []
    screws = []
    for low in (_FOOT - _END, upper_foot):
        ends.append(
            make_box_mm((_PIVOT - _HALF_END, -10.0, low), (_PIVOT + _HALF_END, 10.0, low + _END))
        )
        thread = make_bore_mm("z", (0.0, 0.0, low), 2.5, _END, "M3")
        screws += repeat_bore_along_axis(thread, "x", _SCREWS)
    return Component(
        "flexure",
        "Flexure with strain gauges",
        "1.4301",
        boxes=(*ends, *_make_leaves(leaf)),
        bores=tuple(screws),
        held=tuple(_yield_leaf_characteristics(leaf)),
        is_moving=True,
    )


def _make_leaves(leaf: Flexure) -> list[Box]:
    """Make the rear and the front leaf."""
    half_thickness = 0.5 * leaf.thickness.nominal
    half_width = 0.5 * leaf.width.nominal
    foot = 1e-3 * _FOOT
    leaves = []
    for side in (-1.0, 1.0):
        middle = -ARM + 0.5 * side * leaf.spacing.nominal
        low = (middle - half_thickness, -half_width, foot)
        high = (middle + half_thickness, half_width, foot + leaf.length.nominal)
        leaves.append(Box(low, high))
    return leaves


def _yield_leaf_characteristics(leaf: Flexure) -> Iterator[Characteristic]:
    """Yield the distances of the flexure that decide its stiffness and its output."""
    rear, front = _make_leaves(leaf)
    rear_x, rear_y, foot = rear.low
    front_x, _, _ = front.low
    on_leaf = (rear_x, 0.0, foot + 1e-3)
    beside_leaf = (rear_x - 1e-3, 0.0, foot)
    on_rear_side = (0.5 * (rear_x + rear.high[0]), rear_y, foot + 1e-3)
    yield _make_held_distance_characteristic(
        "leaf_length", "length of the leaves", 2, leaf.length, beside_leaf
    )
    yield _make_held_distance_characteristic(
        "leaf_width", "width of the leaves", 1, leaf.width, on_rear_side
    )
    yield _make_held_distance_characteristic(
        "leaf_1", "thickness of the rear leaf", 0, leaf.thickness, on_leaf
    )
    on_front = (front_x, 0.0, foot + 1e-3)
    yield _make_held_distance_characteristic(
        "leaf_2", "thickness of the front leaf", 0, leaf.thickness, on_front
    )
    yield _make_held_distance_characteristic(
        "leaf_spacing", "from leaf to leaf", 0, leaf.spacing, on_leaf
    )


def _make_held_distance_characteristic(
    key: str, label: str, axis: int, size: Dimension, point_on_first_face: Point3
) -> Characteristic:
    """State a distance of two plane faces with a tolerance of its own.

    The faces contain the coordinates of `point_on_first_face` [m], the second but for that along
    the axis, along which it lies higher.
    """
    holds = dict(enumerate(point_on_first_face))
    del holds[axis]
    first = FaceRule("PLANE", axis, point_on_first_face[axis], holds=holds)
    second = FaceRule("PLANE", axis, point_on_first_face[axis] + size.nominal, holds=holds)
    return make_characteristic(key, "distance", size, first, second, label=label, method=MICROMETER)


def yield_yoke_components() -> Iterator[Component]:
    """Yield the yoke with the two ball bearings of the pivot, and its axle."""
    flange = make_box_mm((-56.0, -11.0, 28.0), (-24.0, 11.0, 36.0))
    left_ear = make_box_mm((-48.0, -11.0, -6.0), (-32.0, -5.0, 28.0))
    right_ear = make_box_mm((-48.0, 5.0, -6.0), (-32.0, 11.0, 28.0))
    hole = make_bore_mm("z", (0.0, 0.0, 28.0), 3.4, 8.0)
    bearing = make_bore_mm("y", (_PIVOT, 0.0, 0.0), 10.0, 4.0, "H7")
    relief = make_bore_mm("y", (_PIVOT, 0.0, 0.0), 7.0, 2.0)
    bores = repeat_bore_along_axis(hole, "x", _SCREWS)
    bores += repeat_bore_along_axis(bearing, "y", (-11.0, 7.0))
    bores += repeat_bore_along_axis(relief, "y", (-7.0, 5.0))
    yield Component(
        "yoke",
        "Yoke of the pivot",
        "aluminium",
        boxes=(flange, left_ear, right_ear),
        bores=tuple(bores),
        is_moving=True,
    )
    for name, y in (("left", -11.0), ("right", 7.0)):
        yield Component(
            f"pivot-bearing-{name}",
            "Ball bearing",
            "steel",
            rods=(make_rod_mm("y", (_PIVOT, y, 0.0), 10.0, 4.0),),
            bores=(make_bore_mm("y", (_PIVOT, y, 0.0), 1e3 * PIVOT_BORE, 4.0),),
            designation="ball bearing 623, 3 x 10 x 4 (ISO 15)",
            is_moving=True,
        )
    yield Component(
        "axle",
        "Axle of the pivot",
        "steel",
        rods=(make_rod_mm("y", (_PIVOT, -11.0, 0.0), 1e3 * PIVOT_BORE, 22.0, _H6),),
        designation="parallel pin 3 h6 x 22 (ISO 8734)",
        is_moving=True,
    )


def _yield_arm_components() -> Iterator[Component]:
    """Yield the arm with its clamp, and the explorer, whose tip is the origin."""
    grip = replace(make_bore_mm("z", (0.0, 0.0, 14.0), _SHANK, 8.0), deviations=_GRIP)
    hub = make_box_mm((-46.0, -4.0, -5.0), (-34.0, 4.0, 22.0))
    beam = make_box_mm((-34.0, -4.0, 14.0), (-8.0, 4.0, 22.0))
    head = make_box_mm((-8.0, -8.0, 14.0), (0.0, 8.0, 22.0))
    axle_bore = make_bore_mm("y", (_PIVOT, -4.0, 0.0), 1e3 * PIVOT_BORE, 8.0, "H7")
    rod_bore = make_bore_mm("x", (-46.0, 0.0, _ARM_HEIGHT), _BALANCE_ROD, 8.0, "H7")
    front_thread = make_bore_mm("x", (-8.0, -5.0, _ARM_HEIGHT), 2.05, 8.0, "M2.5")
    back_thread = make_bore_mm("x", (-8.0, 5.0, _ARM_HEIGHT), 2.05, 8.0, "M2.5")
    half_grip = replace(grip, inward=(-1.0, 0.0, 0.0))
    yield Component(
        "arm",
        "Arm",
        "aluminium",
        boxes=(hub, beam, head),
        bores=(axle_bore, rod_bore, front_thread, back_thread, half_grip),
        is_moving=True,
        is_on_pivot=True,
    )
    hole = make_bore_mm("x", (0.0, 0.0, _ARM_HEIGHT), 2.9, 5.0)
    holes = repeat_bore_along_axis(hole, "y", (-5.0, 5.0))
    holes.append(replace(grip, inward=(1.0, 0.0, 0.0)))
    yield Component(
        "explorer-clamp",
        "Clamp of the explorer",
        "aluminium",
        boxes=(make_box_mm((0.0, -8.0, 14.0), (5.0, 8.0, 22.0)),),
        bores=tuple(holes),
        is_moving=True,
        is_on_pivot=True,
        is_printable=True,
    )
    tip = make_rod_mm("z", (0.0, 0.0, 0.0), 0.25, 8.0)
    shank = make_rod_mm("z", (0.0, 0.0, 8.0), _SHANK, 32.0)
    yield Component(
        "explorer",
        "Explorer",
        "1.4301",
        rods=(tip, shank),
        designation="tip-125 of probe-tips",
        is_moving=True,
        is_on_pivot=True,
    )


def describe_weight(mass: float) -> str:
    """Say what a weight [kg] is ordered by."""
    return f"weight {mass * 1e3:g} g, class M1 (OIML R 111-1)"


def describe_bored_weight(mass: float) -> str:
    """Say what a weight [kg] that stands on the explorer is ordered by."""
    return f"{describe_weight(mass)}, bored {_WEIGHT_BORE:g}"


def _make_weight(mass: float) -> Component:
    """Make a weight [kg] on the shank of the explorer, as high as its mass asks for."""
    rod = make_rod_mm("z", (0.0, 0.0, _WEIGHT_FOOT), _WEIGHT, 1.0)
    bore = make_bore_mm("z", (0.0, 0.0, _WEIGHT_FOOT), _WEIGHT_BORE, 1.0)
    length = mass / _get_material_density("brass") * 1e-3 / (rod.volume - bore.volume)
    return Component(
        WEIGHT_NAME,
        "Weight",
        "brass",
        rods=(replace(rod, length=length),),
        bores=(replace(bore, length=length),),
        designation=describe_bored_weight(mass),
        is_moving=True,
        is_on_pivot=True,
    )


def _make_balance_rod() -> Component:
    rod = make_rod_mm("x", (-98.0, 0.0, _ARM_HEIGHT), _BALANCE_ROD, 60.0, _H6_OF_THE_ROD)
    return Component(
        "balance-rod",
        "Rod of the counterweight",
        "1.4301",
        rods=(rod,),
        is_moving=True,
        is_on_pivot=True,
    )


def _make_counterweight(carried: list[Component]) -> Component:
    """Make the counterweight where it balances what the pivot carries without a weight.

    Its length is a whole number of tenths of a millimetre; its place makes up for the rest.
    """
    moments = []
    for part in carried:
        lever_of_part = part.centre[0] + ARM
        moments.append(part.mass * lever_of_part)
    moment = math.fsum(moments)  # [kg m]
    usual_lever = -ARM - 1e-3 * _COUNTERWEIGHT_PLACE  # [m]
    area = 0.25 * math.pi * 1e-6 * (_COUNTERWEIGHT**2 - _BALANCE_ROD**2)  # [m^2]
    mass_per_length = area * _get_material_density("brass")  # [kg/m]
    length = round(1e4 * moment / usual_lever / mass_per_length) / 10.0
    lever = moment / (1e-3 * length * mass_per_length)  # [m]
    start = (-1e3 * (ARM + lever) - 0.5 * length, 0.0, _ARM_HEIGHT)
    return Component(
        "counterweight",
        "Counterweight",
        "brass",
        rods=(make_rod_mm("x", start, _COUNTERWEIGHT, length),),
        bores=(make_bore_mm("x", start, _BALANCE_ROD, length, "H7"),),
        is_moving=True,
        is_on_pivot=True,
    )


def _get_material_density(material_key: str) -> float:
    """Find the density of a material that a file may name [kg/m^3]."""
    density = MATERIALS[material_key].density
    assert density is not None  # of every material that has a key
    return density.value
