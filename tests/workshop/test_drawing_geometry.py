"""No line strikes a text, no balloon crosses the frame or a text: over heights and bodies."""

import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
from ezdxf import bbox

from stepblocks.declaration.read import load_sets
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.drawing import SeriesSheet, draw_part_sheet

STIMULI = Path(__file__).parents[2] / "stimuli"
ORDER = OrderSpec(
    author="A. Maker",
    date="2026-11-23",
    revision="B",
    owner="Institute of Haptics",
    approved_by="C. Head",
)
BODIES = {
    "usual": {},
    "stock": {
        "body": {"length": "20 mm", "width": "12 mm", "mounting": "none", "engraving": "none"},
        "metrology": {"lane": "4 mm"},
    },
    "small": {
        "body": {
            "length": "16 mm",
            "width": "16 mm",
            "thickness": "6 mm",
            "mounting": {"thread": "M2", "spacing": "9 mm", "depth": "3 mm"},
        },
    },
    "flat": {"body": {"length": "40 mm", "width": "30 mm", "thickness": "6 mm"}},
    "thick": {
        "body": {
            "length": "30 mm",
            "width": "20 mm",
            "thickness": "20 mm",
            "mounting": {"thread": "M4", "spacing": "16 mm", "depth": "9 mm"},
        },
        "metrology": {"kind": "ridge"},
    },
    "through": {
        "body": {"width": "30 mm", "mounting": {"kind": "clearance", "thread": "M3"}},
        "metrology": {"lane": "5 mm"},
    },
    "plain": {"metrology": "none", "edge_radius": "5 um"},
    # the text of a length beside its arrows, holes close to the edge, a tolerance of four decimals
    "short": {"body": {"length": "18 mm", "width": "14 mm"}, "tolerance": "1.5 um"},
    "long": {"body": {"length": "60 mm", "width": "20 mm", "thickness": "12 mm"}},
    "slim": {
        "body": {
            "length": "50 mm",
            "width": "20 mm",
            "mounting": {"kind": "clearance", "thread": "M2.5"},
        },
        "metrology": {"lane": "4 mm"},
    },
    "narrow": {
        "body": {"length": "14 mm", "mounting": {"thread": "M2.5", "spacing": "9 mm"}},
        "metrology": "none",
    },
    "relieved": {"relief": {"width": "0.3 mm", "depth": "0.1 mm"}},
    "deeply relieved": {
        "body": {"length": "50 mm", "mounting": "none"},
        "relief": {"width": "1.2 mm", "depth": "0.8 mm"},
    },
    "narrowly relieved": {"relief": {"width": "0.1 mm", "depth": "0.5 mm"}},
    "two steps up": {
        "second_step": {"height": "30 um", "distance": "5 mm", "edge_radius": "4 um"},
    },
    "two steps down": {
        "edge_radius": "5 um",
        "second_step": {"height": "105 um", "distance": "2 mm", "direction": "down"},
    },
    # deviations one over the other between the arrows of a dimension
    "uneven": {
        "body": {
            "thickness": {"nominal": "12 mm", "tolerance": "+0.1 mm / -0 mm"},
            "length": {"nominal": "30 mm", "tolerance": "+0.2 mm / -0.1 mm"},
            "mounting": {
                "thread": "M2",
                "depth": {"nominal": "3 mm", "tolerance": "+0.2 mm / -0 mm"},
            },
        },
    },
    # the balloon of a shallow hole stands high, and the scale of a low step is long
    "two steps, shallow holes": {
        "body": {"thickness": "12 mm", "mounting": {"thread": "M2", "depth": "3 mm"}},
        "second_step": {"height": "8 um", "distance": "7 mm", "direction": "down"},
    },
    "two steps far apart": {
        "body": {"length": "60 mm", "width": "20 mm", "thickness": "12 mm", "mounting": "none"},
        "second_step": {"height": "12.5 um", "distance": "20 mm", "edge_radius": "12.5 um"},
    },
}


def make_block(height, body):
    """A step block of so many micrometres with one of the bodies."""
    sizes = dict(BODIES[body])
    tolerance = sizes.pop("tolerance", "1 um")
    limits = {"nominal": f"{height} um", "tolerance": tolerance}
    return StepBlock(id=f"step-{height:03}", height=limits, **sizes)


CASES = [(height, "usual") for height in range(10, 106, 5)]
CASES += [(height, name) for height in (10, 65, 105) for name in BODIES if name != "usual"]


def strokes_of(entity):
    """Everything that is drawn of an entity as lines of shapely."""
    kind = entity.dxftype()
    if kind == "LINE":
        return [shapely.LineString([entity.dxf.start.vec2, entity.dxf.end.vec2])]
    if kind == "LWPOLYLINE":
        points = [(x, y) for x, y, *_ in entity.get_points()]
        return [shapely.LineString([*points, points[0]] if entity.closed else points)]
    if kind == "CIRCLE":
        middle = shapely.Point(entity.dxf.center.x, entity.dxf.center.y)
        return [middle.buffer(entity.dxf.radius).exterior]
    return []


def overlaps_on(sheet):
    """Texts that a line strikes, and balloons over the frame or over a text or another balloon."""
    texts, lines, balloons = [], [], []
    for entity in sheet.space:
        parts = entity.virtual_entities() if entity.dxftype() == "DIMENSION" else [entity]
        for part in parts:
            if part.dxftype() in ("TEXT", "MTEXT"):
                box = bbox.extents([part], fast=False)
                if box.has_data:
                    corners = (box.extmin.x, box.extmin.y, box.extmax.x, box.extmax.y)
                    texts.append((part.plain_text(), shapely.box(*corners).buffer(-0.15)))
            lines += strokes_of(part)
        if entity.dxftype() == "CIRCLE" and entity.dxf.radius == 2.8:
            balloons.append(shapely.Point(entity.dxf.center.x, entity.dxf.center.y).buffer(2.8))
    frame = shapely.box(20.0, 10.0, 410.0, 287.0)
    tree = shapely.STRtree(lines)
    for text, box in texts:
        if len(tree.query(box, predicate="intersects")):
            yield f"struck: {text}"
        if not frame.contains(box):
            yield f"over the frame: {text}"
    for (one, box), (other, second) in itertools.combinations(texts, 2):
        if box.intersects(second):
            yield f"{one} over {other}"
    for one, other in itertools.combinations(balloons, 2):
        if one.intersects(other):
            yield f"balloons at {one.centroid} and {other.centroid}"
    for balloon in balloons:
        if not frame.contains(balloon):
            yield f"balloon over the frame at {balloon.centroid}"
        # the end of an extension line reached to the digits of a number
        if len(tree.query(balloon.buffer(-0.3), predicate="intersects")):
            yield f"struck: balloon at {balloon.centroid}"


@pytest.mark.repeats
@pytest.mark.parametrize(("height", "body"), CASES)
def test_nothing_on_the_drawing_of_a_step_block_strikes_anything(height, body):
    block = make_block(height, body)
    assert list(overlaps_on(draw_part_sheet(block, ORDER))) == []


@pytest.mark.repeats
@pytest.mark.parametrize("body", ["usual", "short", "long"])
def test_a_text_beside_its_arrows_stands_over_its_dimension_line(body):
    # ISO 129-1: where there is no room between the arrows the line is drawn on, under the value
    sheet = draw_part_sheet(make_block(65, body), ORDER)
    lines = shapely.union_all([line for one in sheet.space for line in strokes_of(one)])
    beside = 0
    for dimension in sheet.space.query("DIMENSION"):
        parts = list(dimension.virtual_entities())
        (text,) = [part for part in parts if part.dxftype() in ("TEXT", "MTEXT")]
        size = bbox.extents([text], fast=False)
        low, high = (dimension.dxf.defpoint2.vec2, dimension.dxf.defpoint3.vec2)
        upright = dimension.dxf.angle == 90.0
        middle = 0.5 * (size.extmin.vec2 + size.extmax.vec2)
        place, ends = (middle.y, (low.y, high.y)) if upright else (middle.x, (low.x, high.x))
        if min(ends) <= place <= max(ends):
            continue
        beside += 1
        along = dimension.dxf.defpoint.x if upright else dimension.dxf.defpoint.y
        foot = (along, middle.y) if upright else (middle.x, along)
        assert lines.distance(shapely.Point(foot)) < 1e-9
    assert beside >= 3


def test_a_section_is_hatched_where_it_cuts_and_its_place_is_shown():
    # ISO 128-50: what is cut, and only that; ISO 128-44: a line with letters and arrows
    sheet = draw_part_sheet(StepBlock(id="step-050", height="50 um"))
    areas = [hatch.paths[0].vertices for hatch in sheet.space.query("HATCH")]
    assert len(areas) == 2
    area = sum(shapely.Polygon([(x, y) for x, y, *_ in one]).area for one in areas)
    # by hand, 5:1: a window 1.6 x 3.15 mm wide and 6 mm high, less a hole of 2.5 mm, 5 mm deep, its
    # point of 118 degrees and its countersink of 90 degrees up to 3.15 mm
    drill, entry, tall = 1.25, 1.575, 6.0
    point = drill * drill / math.tan(math.radians(59.0))
    cut = 3.2 * entry * tall - 2.0 * drill * 5.0 - point - (entry - drill) ** 2
    assert area == pytest.approx(25.0 * cut, rel=1e-9)
    letters = [one for one in sheet.space.query("TEXT") if one.dxf.text == "C"]
    assert len(letters) == 2
    assert any(one.dxf.text.startswith("C-C") for one in sheet.space.query("TEXT"))


def test_lines_are_of_one_group_and_the_title_block_stands_in_its_corner():
    # ISO 128-2, line group 0.5: wide 0.5, narrow 0.25, symbols 0.35 mm; ISO 7200: 180 mm wide
    sheet = draw_part_sheet(StepBlock(id="step-050", height="50 um"), ORDER)
    layers = ("OUTLINE", "HIDDEN", "CENTRE", "DIMENSION", "TEXT", "FRAME")
    widths = [sheet.document.layers.get(name).dxf.lineweight for name in layers]
    assert widths == [50, 25, 25, 25, 25, 35]
    areas = [bbox.extents([one]) for one in sheet.space.query("LWPOLYLINE[layer=='FRAME']")]
    corner = [one for one in areas if (one.extmax.x, one.extmin.y) == pytest.approx((410.0, 10.0))]
    assert any(one.size.x == pytest.approx(180.0) for one in corner)


@pytest.mark.repeats
@pytest.mark.parametrize("body", BODIES)
def test_scales_letters_frame_and_threads_are_those_of_the_standards(body):
    # ISO 5455: 1, 2 or 5 times a power of ten; ISO 5457: 20 mm for filing, 10 mm elsewhere;
    # ISO 3098: letters of 2.5 mm; ISO 129-1: a decimal comma; ISO 6410-1: a thread that is hidden
    # is dashed, its outer line three quarters of a circle
    block = make_block(65, body)
    sheet = draw_part_sheet(block, ORDER)
    texts = list(sheet.space.query("TEXT"))
    scales = [one for text in texts for one in re.findall(r"([\d.]+):([\d.]+)", text.dxf.text)]
    assert len(scales) >= 4
    assert all(float(a) == 1.0 or float(b) == 1.0 for a, b in scales)
    assert all(f"{float(a) * float(b):e}"[:5] in ("1.000", "2.000", "5.000") for a, b in scales)
    assert min(one.dxf.height for one in texts) >= 2.5
    pointed = {one.dxf.text for one in texts if re.search(r"\d\.\d", one.dxf.text)}
    assert pointed <= {block.material.order_text}  # a number of a material is no size
    boxes = [bbox.extents([one]) for one in sheet.space.query("LWPOLYLINE[layer=='FRAME']")]
    box = max(boxes, key=lambda one: one.size.x)
    assert (box.extmin.x, box.extmin.y) == (20.0, 10.0)
    assert (box.extmax.x, box.extmax.y) == (410.0, 287.0)
    hidden = sheet.space.query("LWPOLYLINE[layer=='HIDDEN']")
    tapped = block.body.mounting is not None and block.body.mounting.kind == "tapped"
    assert len(hidden) == 2 * tapped
    for thread in hidden:
        points = np.array(thread.get_points("xy"))
        turned = np.unwrap(np.arctan2(*(points - thread_middle(sheet, points)).T[::-1]))
        assert np.degrees(np.ptp(turned)) == pytest.approx(270.0)


def thread_middle(sheet, points):
    """The middle of the core hole whose thread these points are."""
    cores = [one.dxf.center.vec2 for one in sheet.space.query("CIRCLE[layer=='HIDDEN']")]
    return min(cores, key=lambda one: np.abs(np.hypot(*(points - one).T) - 3.0).max())


def test_the_straightness_of_the_riser_stands_in_a_frame_that_points_at_it():
    sheet = draw_part_sheet(StepBlock(id="step-050", height="50 um"), ORDER)
    texts = sheet.space.query("TEXT")
    (value,) = [
        one
        for one in texts
        if one.has_xdata("STEPBLOCKS")
        and one.get_xdata("STEPBLOCKS")[0].value == "riser_straightness"
    ]
    assert value.dxf.text == "0,020"
    # the arrow lies on the line of the riser, which is drawn on over the faces
    riser, level = 235.0, value.get_placement()[1].y
    tips = [one.dxf.vtx0 for one in sheet.space.query("SOLID")]
    assert any((tip.x, tip.y) == pytest.approx((riser, level)) for tip in tips)


@pytest.mark.repeats
@pytest.mark.parametrize("opening", [None, "80 um", "-60 um", "20 um"])
def test_nothing_on_the_drawing_of_a_margin_block_strikes_anything(opening):
    sizes = {} if opening is None else {"vertical_discrepancy": opening}
    rise = "100 um" if opening == "-60 um" else "30 um"
    margin = MarginBlock(id="gap-050", marginal_gap="50 um", horizontal_discrepancy=rise, **sizes)
    assert list(overlaps_on(draw_part_sheet(margin, ORDER))) == []


TURNED = [
    part
    for declared, _ in load_sets(STIMULI)
    for part in declared.stimuli
    if part.kind_name not in ("step block", "margin block")
]


@pytest.mark.parametrize("part", TURNED, ids=lambda part: part.id)
def test_nothing_on_the_drawing_of_a_tip_a_sheath_or_a_crown_strikes_anything(part):
    # a diameter with unequal deviations had stood on its dimension line
    sheet = draw_part_sheet(part, ORDER)
    assert list(overlaps_on(sheet)) == []
    # ISO 129-1: decimal commas, also in what is said in words
    said = [one.dxf.text for one in sheet.space.query("TEXT")]
    said.remove(part.material.order_text)  # 1.4301 is a name
    assert not [text for text in said if re.search(r"[0-9]\.[0-9]", text)]


def test_nothing_on_the_sheet_of_a_series_strikes_anything_and_every_height_is_in_its_table():
    blocks = [make_block(height, "short") for height in range(15, 106, 10)]
    sheet = draw_part_sheet(blocks[0], ORDER, SeriesSheet("own-ten", 1, 1, blocks))
    assert list(overlaps_on(sheet)) == []
    texts = {entity.dxf.text for entity in sheet.space.query("TEXT")}
    assert {f"STEP-{height:03}" for height in range(15, 106, 10)} <= texts
    assert {f"0,{height:03}0 ±0,0015" for height in range(15, 106, 10)} <= texts
    assert "1 of each" in texts
