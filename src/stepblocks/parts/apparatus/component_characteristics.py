"""What a workshop must hold on a component: sizes over all, faces, held distances, cylinders."""

import math
from collections.abc import Iterator

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.solids import AXES, Cylinder
from stepblocks.parts.characteristics import (
    Characteristic,
    FaceRule,
    make_characteristic,
    make_location_characteristic,
    make_plane_rule,
)
from stepblocks.parts.tolerance import Dimension, find_general_deviation

_OVERALL = ("length", "width", "height")  # over all along x, y and z
_SIDES = ("left", "front", "base")  # from which distances along x, y and z are counted
_SAME = 1e-9  # coordinates that differ by less are one [m]
_LEAST_OFFSET = 0.5e-3  # of an axis from a side, from which on it is stated [m]
_UNCOVERED = 0.05e-3  # deviation of what the general tolerances do not cover [m]


def yield_component_characteristics(component: Component) -> Iterator[Characteristic]:
    """Yield the characteristics of a component, in the order of its inspection sheet."""
    for axis in range(3):
        yield from _yield_plane_characteristics(component, axis)
    yield from component.held
    for number, rod in enumerate(component.rods, start=1):
        yield from _yield_cylinder_characteristics(component, rod, f"rod_{number}", f"rod {number}")
    for number, bore in enumerate(component.bores, start=1):
        yield from _yield_cylinder_characteristics(
            component, bore, f"bore_{number}", f"bore {number}"
        )


def _yield_plane_characteristics(component: Component, axis: int) -> Iterator[Characteristic]:
    """Yield the size over all along an axis, and the places of the faces between its ends."""
    extent = component.bounding_box
    low, high = extent.low[axis], extent.high[axis]
    planes = _list_plane_places(component, axis)
    if not _is_at_known_place(low, planes):  # round from there: its diameter says it
        return
    lowest = make_plane_rule(axis, low)
    held = list(_yield_upper_faces_of_held_distances(component, axis))
    name = _OVERALL[axis]
    if _is_at_known_place(high, planes) and not _is_at_known_place(high, held):
        size = _make_generally_toleranced_dimension(high - low)
        highest = make_plane_rule(axis, high)
        yield make_characteristic(name, "distance", size, lowest, highest, label=f"{name} over all")
    inner = _leave_out_known_places(planes, [low, high, *held])
    for number, place in enumerate(inner, start=1):
        label = f"{name}, face {number} from the {_SIDES[axis]}"
        face = make_plane_rule(axis, place)
        yield make_location_characteristic(f"{name}_{number}", label, place - low, lowest, face)


def _list_plane_places(component: Component, axis: int) -> list[float]:
    """List where plane faces lie along an axis, ascending, each place once [m]."""
    ends: list[float] = []
    for box in component.boxes:
        ends += [box.low[axis], box.high[axis]]
    for rod in component.rods:
        if rod.axis_index == axis:
            ends += [rod.start[axis], rod.end[axis]]
    places: list[float] = []
    for end in sorted(ends):
        if not _is_at_known_place(end, places):
            places.append(end)
    return places


def _leave_out_known_places(places: list[float], known_places: list[float]) -> list[float]:
    """Return the coordinates that are none of those which are known [m]."""
    left = []
    for place in places:
        if not _is_at_known_place(place, known_places):
            left.append(place)
    return left


def _is_at_known_place(place: float, known_places: list[float]) -> bool:
    """Tell whether a coordinate is one of several."""
    return any(abs(place - known) < _SAME for known in known_places)


def _yield_upper_faces_of_held_distances(component: Component, axis: int) -> Iterator[float]:
    """Yield where the upper faces of distances with a tolerance of their own lie on an axis [m]."""
    for characteristic in component.held:
        _, upper = characteristic.faces
        if isinstance(upper, FaceRule) and upper.axis == axis:
            yield upper.at


def _yield_cylinder_characteristics(
    component: Component, cylinder: Cylinder, key: str, label: str
) -> Iterator[Characteristic]:
    """Yield the diameter of a rod or bore, and where its axis lies."""
    holds = {}
    for axis in (*cylinder.cross_axis_indices, cylinder.axis_index):
        holds[axis] = cylinder.middle[axis]
    face = FaceRule("CYLINDER", radius=0.5 * cylinder.diameter, holds=holds)
    dimension = _make_diameter_dimension(cylinder)
    description = _describe_thread_and_depth(component, cylinder)
    yield make_characteristic(
        key,
        "diameter",
        dimension,
        face,
        label=f"{label}, along {cylinder.axis}{description}",
        method=_choose_cylinder_method(component, cylinder),
    )
    for axis in cylinder.cross_axis_indices:
        low = component.bounding_box.low[axis]
        offset = cylinder.start[axis] - low
        sides = []
        for box in component.boxes:
            sides.append(box.low[axis])
        if _is_at_known_place(low, sides) and offset > _LEAST_OFFSET:
            side = make_plane_rule(axis, low)
            name = f"{label} from the {_SIDES[axis]}"
            yield make_location_characteristic(f"{key}_{AXES[axis]}", name, offset, side, face)


def _choose_cylinder_method(component: Component, cylinder: Cylinder) -> str:
    """Choose pin gauges for a bore with a fit; empty for the method that its tolerance needs."""
    if cylinder in component.rods or cylinder.deviations is None:
        return ""
    return "pin gauges"


def _make_diameter_dimension(cylinder: Cylinder) -> Dimension:
    """Make the dimension of a diameter with its own deviations, or the general ones."""
    if cylinder.deviations is None:
        return _make_generally_toleranced_dimension(cylinder.diameter)
    upper, lower = cylinder.deviations
    return Dimension(cylinder.diameter, upper, lower)


def _describe_thread_and_depth(component: Component, cylinder: Cylinder) -> str:
    """Say which thread is cut in a bore, and how deep it is where it does not go through."""
    if cylinder in component.rods:
        return ""
    thread = ""
    if cylinder.thread:
        thread = f" for {cylinder.thread}"
    axis = cylinder.axis_index
    start, end = cylinder.start[axis], cylinder.end[axis]
    for box in component.boxes:
        same_start = abs(box.low[axis] - start) < _SAME
        same_end = abs(box.high[axis] - end) < _SAME
        if same_start and same_end:
            return thread
    for rod in component.rods:
        if rod.axis == cylinder.axis and math.isclose(rod.length, cylinder.length):
            return thread
    return f"{thread}, {cylinder.length * 1e3:g} mm long"


def _make_generally_toleranced_dimension(length: float) -> Dimension:
    """Make a dimension with the general tolerance of ISO 2768-m [m]."""
    deviation = find_general_deviation(length) or _UNCOVERED
    return Dimension(length, deviation, -deviation, general=True)
