"""The rig of experiment 1: clamp of the shank, jaws of the sheath, and what lets the tip go.

All sizes are in millimetres. The axis of the shank lies beside the drag rig, at the height of its
tip.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.frame import (
    RELEASE_SCREW,
    SCREWS_OF_THE_JAWS,
    SCREWS_OF_THE_SHANK_CLAMP,
    SCREWS_OF_THE_SHEATH_JAW,
)
from stepblocks.parts.apparatus.solids import (
    Deviations,
    make_bore_mm,
    make_box_mm,
    repeat_bore_along_axis,
)
from stepblocks.parts.characteristics import MICROMETER, FaceRule, make_characteristic
from stepblocks.parts.tolerance import Dimension

_AXIS_Y = 80.0  # of the shank
_SHANK_RADIUS = 2.0  # of the probe that sheaths are made for
_GROOVE = Deviations(20e-6, 0.0)  # of the grooves in clamp and jaws [m]
_SENSOR_POCKET = 10.0  # diameter, for a pressure sensor of 9.5 mm
_SLIDE_FOOT = -6.0  # height of the lower face of the slide
_SLIDE_TOLERANCE = 0.05  # share of the displacement


@dataclass(frozen=True)
class _Clamp:
    """Two halves with a groove for the shank or the sheath, screwed on from below."""

    name: str
    title: str
    middle: float  # x of its screws
    half_length: float
    groove: float  # diameter
    has_sensor: bool


_CLAMPS = (
    _Clamp("shank-clamp", "Clamp of the shank", SCREWS_OF_THE_SHANK_CLAMP, 8.0, 4.0, False),
    _Clamp("sheath-jaw", "Jaw of the sheath", SCREWS_OF_THE_SHEATH_JAW, 10.0, 8.0, True),
)


def yield_damping_rig_components(displacement: float) -> Iterator[Component]:
    """Yield the components of the rig; its slide lifts the shank by a displacement [m]."""
    for clamp in _CLAMPS:
        yield _make_lower_clamp_half(clamp)
        yield _make_upper_clamp_half(clamp)
    x, y = RELEASE_SCREW
    yield Component(
        "release-post",
        "Post of the release",
        "aluminium",
        boxes=(make_box_mm((x - 6.0, y - 6.0, -30.0), (x + 6.0, y + 6.0, _SLIDE_FOOT)),),
        bores=(make_bore_mm("z", (x, y, -30.0), 3.3, 12.0, "M4"),),
    )
    yield _make_release_slide(displacement)


def _make_lower_clamp_half(clamp: _Clamp) -> Component:
    """Make the half that stands on the base, with the threads of the screws."""
    start, end = clamp.middle - clamp.half_length, clamp.middle + clamp.half_length
    groove = make_bore_mm("x", (start, _AXIS_Y, 0.0), clamp.groove, end - start)
    thread = make_bore_mm("z", (clamp.middle, 0.0, -30.0), 3.3, 30.0, "M4")
    bores = repeat_bore_along_axis(thread, "y", SCREWS_OF_THE_JAWS)
    bores.append(replace(groove, deviations=_GROOVE, inward=(0.0, 0.0, -1.0)))
    return Component(
        f"{clamp.name}-lower",
        f"{clamp.title}, lower",
        "aluminium",
        boxes=(make_box_mm((start, 66.0, -30.0), (end, 94.0, 0.0)),),
        bores=tuple(bores),
    )


def _make_upper_clamp_half(clamp: _Clamp) -> Component:
    """Make the half that is screwed on; that of the jaw has a pocket for the pressure sensor."""
    start, end = clamp.middle - clamp.half_length, clamp.middle + clamp.half_length
    groove = make_bore_mm("x", (start, _AXIS_Y, 0.0), clamp.groove, end - start)
    hole = make_bore_mm("z", (clamp.middle, 0.0, 0.0), 4.5, 12.0)
    bores = repeat_bore_along_axis(hole, "y", SCREWS_OF_THE_JAWS)
    if clamp.has_sensor:
        bores.append(make_bore_mm("z", (clamp.middle, _AXIS_Y, 10.0), _SENSOR_POCKET, 2.0))
    bores.append(replace(groove, deviations=_GROOVE, inward=(0.0, 0.0, 1.0)))
    return Component(
        f"{clamp.name}-upper",
        f"{clamp.title}, upper",
        "aluminium",
        boxes=(make_box_mm((start, 66.0, 0.0), (end, 94.0, 12.0)),),
        bores=tuple(bores),
    )


def _make_release_slide(displacement: float) -> Component:
    """Make the ground slide between post and shank, whose thickness lifts the shank."""
    top = -_SHANK_RADIUS + 1e3 * displacement
    x, y = RELEASE_SCREW
    deviation = _SLIDE_TOLERANCE * displacement
    thickness = Dimension(
        1e-3 * (top - _SLIDE_FOOT), deviation, -deviation, source="a twentieth of the displacement"
    )
    lower = FaceRule("PLANE", 2, 1e-3 * _SLIDE_FOOT)
    upper = FaceRule("PLANE", 2, 1e-3 * top)
    lift = make_characteristic(
        "lift",
        "distance",
        thickness,
        lower,
        upper,
        label="thickness, which lifts the shank",
        method=MICROMETER,
    )
    return Component(
        "release-slide",
        "Slide that lets the shank go",
        "steel",
        boxes=(make_box_mm((x - 4.0, y - 10.0, _SLIDE_FOOT), (x + 4.0, y + 10.0, top)),),
        held=(lift,),
    )
