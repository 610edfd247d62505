"""A sheet of paper: what is drawn on it measures the part, and every characteristic keeps its
number."""

import math

import pytest

from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.revolution import list_outline_points
from stepblocks.workshop.paper import HEIGHT, WIDTH, View, choose_standard_scale
from stepblocks.workshop.sheet import Note, Sheet
from stepblocks.workshop.title_block import draw_border

STEP = Characteristic("step", "step height", "distance", 10e-6, -1e-6, 1e-6)
SHANK = Characteristic("shank", "shank", "diameter", 2.35e-3, -32e-6, 0.0)
FLAT = Characteristic("flat", "flatness", "flatness", 0.0, 0.0, 0.5e-6)
PARALLEL = Characteristic("parallel", "parallelism", "parallelism", 0.0, 0.0, 2e-6)


@pytest.fixture
def sheet():
    return Sheet([STEP, SHANK, FLAT, PARALLEL])


def texts(sheet):
    return [entity.dxf.text for entity in sheet.space.query("TEXT")]


def dimensions(sheet):
    return list(sheet.space.query("DIMENSION"))


@pytest.mark.parametrize(
    ("wanted", "scale"),
    [(1.0, 1.0), (0.99, 0.5), (3.9, 2.0), (47.0, 20.0), (5000.0, 5000.0), (0.024, 0.02)],
)
def test_scales_are_those_that_a_drawing_uses_and_never_too_large(wanted, scale):
    # ISO 5455: 1, 2, 5 times powers of ten
    assert choose_standard_scale(wanted) == pytest.approx(scale, rel=1e-12)
    assert choose_standard_scale(wanted) <= wanted * (1.0 + 1e-9)


def test_a_view_stretches_heights_alone_where_it_says_so():
    assert View((100.0, 50.0), 4.0).map_to_paper(1e-3, -2e-3) == pytest.approx((104.0, 42.0))
    assert View((100.0, 50.0), 4.0, 4000.0).map_to_paper(1e-3, 10e-6) == pytest.approx(
        (104.0, 90.0)
    )


@pytest.mark.parametrize("upright", [False, True])
@pytest.mark.parametrize("scale", [1.0, 4000.0])
def test_a_dimension_measures_the_part_at_any_scale_either_way(scale, upright, sheet):
    long = 10e-6 * 1e3 * scale
    ends = (
        ((100.0, 100.0), (100.0, 100.0 + long))
        if upright
        else ((100.0, 100.0), (100.0 + long, 100.0))
    )
    sheet.draw_dimension("step", *ends, (90.0, 90.0), scale, upright=upright)
    (one,) = dimensions(sheet)
    assert one.get_measurement() * one.override().get("dimlfac") == pytest.approx(0.010, abs=1e-12)
    assert [str(tag.value) for tag in one.get_xdata("STEPBLOCKS")[:2]] == ["step", "1"]
    assert sheet.numbers == {1}
    assert texts(sheet) == ["1"]


@pytest.mark.parametrize("upright", [False, True])
@pytest.mark.parametrize("long", [5.0, 200.0])
def test_the_text_of_a_narrow_dimension_stands_beside_it_and_its_balloon_beyond(
    long, upright, sheet
):
    axis = 1 if upright else 0
    ends = (
        ((100.0, 100.0), (100.0, 100.0 + long))
        if upright
        else ((100.0, 100.0), (100.0 + long, 100.0))
    )
    sheet.draw_dimension("step", *ends, (90.0, 90.0), 4000.0, upright=upright)
    (balloon,) = sheet.space.query("CIRCLE")
    if long < 50.0:
        assert balloon.dxf.center[axis] > 100.0 + long
    else:
        assert 100.0 < balloon.dxf.center[axis] < 100.0 + long


def test_a_diameter_says_so_with_unequal_deviations(sheet):
    sheet.draw_dimension("shank", (0.0, 0.0), (94.0, 0.0), (47.0, 10.0), 40.0)
    (one,) = dimensions(sheet)
    style = one.override()
    assert style.get("dimpost") == "⌀<>"
    assert style.get("dimdec") == 3
    assert (style.get("dimtp"), style.get("dimtm")) == pytest.approx((0.0, 0.032), abs=1e-12)


@pytest.mark.parametrize(("elbow", "side"), [((120.0, 60.0), 1.0), ((80.0, 60.0), -1.0)])
def test_a_leader_stands_on_the_side_away_from_its_tip_with_the_limits_in_its_text(
    elbow, side, sheet
):
    sheet.draw_characteristic_leader("step", (100.0, 50.0), elbow, "R {} of the step")
    said, number = texts(sheet)
    assert said == "R 0,010 ±0,001 of the step"
    assert number == "1"
    (balloon,) = sheet.space.query("CIRCLE")
    assert side * (balloon.dxf.center.x - elbow[0]) > 3.0
    sheet.draw_leader((100.0, 50.0), elbow, "working edge")
    assert texts(sheet)[-1] == "working edge"
    assert sheet.numbers == {1}


def test_a_frame_holds_sign_zone_and_datum_with_the_number_beside(sheet):
    left = sheet.draw_tolerance_frame("flat", (50.0, 40.0))
    assert left == (50.0, 43.0)
    assert texts(sheet) == ["0,0005", "3"]
    sheet.draw_tolerance_frame("parallel", (50.0, 60.0), "A")
    assert texts(sheet)[2:] == ["0,002", "A", "4"]
    assert sheet.numbers == {3, 4}


def test_an_arrow_points_from_its_tail_to_its_tip(sheet):
    sheet.draw_pointer_to_face((10.0, 0.0), (0.0, 30.0))  # down from the height of the frame
    (solid,) = sheet.space.query("SOLID")
    tip, one, other = solid.dxf.vtx0, solid.dxf.vtx1, solid.dxf.vtx2
    assert (tip.x, tip.y) == (10.0, 0.0)
    assert one.y == pytest.approx(other.y)
    assert one.y > 0.0
    assert tip.distance(one) == pytest.approx(2.5)


def test_the_title_block_lies_in_the_lower_right_corner_inside_the_frame(sheet):
    draw_border(
        sheet, "Step block", {"identity": "STEP-010", "material": "steel", "mass": "29.1 g"}
    )
    said = texts(sheet)
    assert said[0] == "Step block"
    for name, value in (
        ("identity", "STEP-010"),
        ("mass", "29.1 g"),
        ("general tolerances", "ISO 2768-m"),
    ):
        assert said[said.index(name) + 1] == value
    for entity in sheet.space.query("TEXT"):
        x, y = entity.get_placement()[1].vec2
        assert WIDTH - 190.0 < x < WIDTH - 10.0
        assert 10.0 < y < 0.5 * HEIGHT


def test_notes_go_down_line_by_line(sheet):
    sheet.write_notes((20.0, 100.0), [Note("one"), Note("two"), Note("three")])
    heights = [entity.dxf.insert.y for entity in sheet.space.query("TEXT")]
    assert heights == [100.0, 95.0, 90.0]
    sheet.write_notes((20.0, 50.0), [Note("4  one that states a characteristic", "shank")])
    assert sheet.numbers == {2}


def test_the_symbol_of_a_surface_stands_on_it_with_its_roughness_in_micrometres():
    rough = Sheet([Characteristic("rough", "roughness", "roughness", 0.0, 0.0, 0.1e-6)])
    rough.draw_surface_texture((50.0, 40.0), "rough")
    assert texts(rough) == ["Ra 0,1", "1"]
    lowest = min(y for line in rough.space.query("LWPOLYLINE") for _, y in line.get_points("xy"))
    assert lowest == 40.0


@pytest.mark.parametrize("middle", [45.0, -135.0])
def test_an_arc_is_drawn_through_its_middle_point_the_short_way_or_the_long(middle):
    def on(degrees):
        return 3e-3 + 2e-3 * math.cos(math.radians(degrees)), -1e-3 + 2e-3 * math.sin(
            math.radians(degrees)
        )

    points = list_outline_points([on(0.0), (on(middle), on(90.0))], 0.05e-6)
    assert points[-1] == pytest.approx(on(90.0))
    assert all(math.hypot(x - 3e-3, y + 1e-3) == pytest.approx(2e-3) for x, y in points)
    assert min(math.dist(point, on(middle)) for point in points) < 0.05e-3


def test_an_outline_of_lines_stays_as_it_is():
    outline = [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (0.0, 2.0)]
    assert list_outline_points(outline, 0.05e-6) == outline
