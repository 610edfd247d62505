"""A block that is made by its setup sheet is the drawing: at the middle of all limits the solid is
the drawn one, and at every corner of them each dimension is within its limits.

The machinist of `oracles.setups` reads the page and cuts a solid of his own.
"""

import numpy as np
import pytest

from oracles.setups import (
    BETWEEN,
    DEPTH,
    FLOOR,
    GROUND,
    LEFT,
    LEFT_OF_FIRST,
    LEG,
    RIGHT,
    RIGHT_OF_SECOND,
    choose_middle,
    list_sources,
    make_block,
    read_setup_sheet,
    stack_corners,
)
from oracles.shipped import load_shipped
from stepblocks.cad import kernel
from stepblocks.errors import UsageError
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.setup import write_setup_sheet_and_stock

ROUNDING = 2e-9  # of the kernel's boxes [m]
NOTHING = 1e-15  # volume below which a solid is empty [m^3]: a cube of 10 um


def load_blocks():
    blocks = []
    for name in ("paper-ten", "paper-four", "crown-margins"):
        for part in load_shipped(name).stimuli:
            if isinstance(part, StepBlock | MarginBlock):
                blocks.append(part)
    return {block.id: block for block in blocks}


BLOCKS = load_blocks()
QUICK = ("apparatus-100", "step-050", "gap-050-under-020")


def leave_out(block, *fields):
    """Leave features out of a block: letters take the kernel seconds, a ridge is no edge break."""
    if "engraving" in fields:
        body = block.body.model_copy(update={"engraving": None})
        block = block.model_copy(update={"body": body})
    if "metrology" in fields:
        block = block.model_copy(update={"metrology": None})
    return block


def draw_block(seed):
    """Draw a block of either kind, with a body, tolerances and a stock of its own."""
    random = np.random.default_rng(seed)
    for _ in range(200):
        thickness = random.choice(["4 mm", "6.35 mm", "8 mm", "12 mm"])
        tolerance = random.choice(["0.05 mm", "0.2 mm", "+0.1 mm / -0 mm", "0.02 mm"])
        edge_break = random.choice(["0 mm", "0.2 mm", "0.3 mm", "0.5 mm"])
        mounting = "none"
        if random.random() < 0.8:
            mounting = {
                "kind": str(random.choice(["tapped", "clearance"])),
                "thread": str(random.choice(["M2", "M3"])),
                "depth": {
                    "nominal": str(random.choice(["2 mm", "3 mm", "5 mm"])),
                    "tolerance": str(random.choice(["0.1 mm", "0.05 mm", "+0.2 mm / -0 mm"])),
                },
            }
        body = {
            "thickness": {"nominal": str(thickness), "tolerance": str(tolerance)},
            "edge_break": {
                "nominal": str(edge_break),
                "tolerance": str(random.choice(["0.1 mm", "0.05 mm", "+0.1 mm / -0 mm"])),
            },
            "mounting": mounting,
            "engraving": "none" if random.random() < 0.9 else {},
        }
        excess = [float(random.choice([0.0, 0.2, 0.5, 2.0])) for _ in range(3)]
        stock = None
        if random.random() < 0.7:
            height = float(thickness.split()[0]) + 0.25 + excess[2]
            stock = [f"{20.0 + excess[0]} mm", f"{24.0 + excess[1]} mm", f"{height} mm"]
        fields = {"id": "drawn", "body": body, "stock": stock}
        fields["material"] = str(random.choice(["steel", "brass"]))
        try:
            if random.random() < 0.6:
                fields["height"] = str(random.choice(["10 um", "60 um", "150 um"]))
                fields["metrology"] = random.choice(["none", "groove", "ridge"])
                if fields["metrology"] != "none":
                    fields["metrology"] = {"kind": str(fields["metrology"])}
                if random.random() < 0.4:
                    width = str(random.choice(["0.1 mm", "0.3 mm", "0.9 mm"]))
                    depth = str(random.choice(["0.05 mm", "0.1 mm", "0.3 mm"]))
                    fields["relief"] = {"width": width, "depth": depth}
                elif random.random() < 0.4:
                    del fields["metrology"]
                    fields["second_step"] = {
                        "height": str(random.choice(["8 um", "40 um", "110 um"])),
                        "distance": str(random.choice(["2.5 mm", "5 mm", "7 mm"])),
                        "direction": str(random.choice(["up", "down"])),
                    }
                return StepBlock(**fields)
            fields["marginal_gap"] = "50 um"
            fields["horizontal_discrepancy"] = str(random.choice(["0 um", "40 um", "-30 um"]))
            return MarginBlock(**fields)
        except UsageError:
            continue
    raise AssertionError("no block fits")


def check_corners(block, sheet):
    limits = {one.key: one for one in block.characteristics()}
    seen = set()
    for key, value in stack_corners(block, sheet):
        drawn = limits[key]
        low, high = drawn.nominal + drawn.lower, drawn.nominal + drawn.upper
        if key == "thread":
            high = np.inf
        assert low - ROUNDING <= value <= high + ROUNDING, (key, value, low, high)
        seen.add(key)
    return seen


def check_solid(block, sheet):
    """The solid in the middle of all limits is the drawn one but for what the edge itself takes."""
    (drawn,) = block.solids()
    made = make_block(block, sheet, choose_middle(block, sheet))
    made = kernel.move(made, (0.0, 0.0, block.body.base))
    missing = sum(one.Volume() for one in drawn.cut(made).Solids()) * 1e-9
    assert missing < NOTHING
    assert_only_the_edge_is_left(block, made.cut(drawn))
    return made


def has_nominal_middles(block):
    """Tell whether the drawn solid is the one in the middle of all limits."""
    return all(
        abs(one.lower + one.upper) < 1e-9
        for one in block.characteristics()
        if one.key in ("thickness", "edge_break", "hole_depth")
    )


def assert_only_the_edge_is_left(block, excess):
    low, high = 0.0, 0.0
    feature = getattr(block, "metrology", None)
    if feature is not None and feature.kind == "groove":
        high = feature.distance.nominal + feature.width.nominal
    if isinstance(block, MarginBlock):
        low, high = -0.2e-3, 0.2e-3
    for one in excess.Solids():
        box = one.BoundingBox()
        if one.Volume() * 1e-9 > NOTHING:
            assert box.xmin * 1e-3 > low - 1e-7
            assert box.xmax * 1e-3 < high + 1e-7


def measure_legs(solid):
    """Measure the legs of all chamfers: planes that are square to one axis alone."""
    legs = []
    for face in kernel.list_faces(solid):
        if face.kind == "PLANE":
            sides = sorted(high - low for low, high in zip(face.low, face.high, strict=True))
            if sides[0] > 1e-6:
                legs += sides[:2]
    return legs


@pytest.mark.repeats
@pytest.mark.parametrize("name", QUICK)
def test_a_block_made_by_its_sheet_is_the_drawn_one(name, tmp_path):
    block = BLOCKS[name]
    if name != QUICK[0]:
        block = leave_out(block, "engraving")
    page, _ = write_setup_sheet_and_stock(tmp_path, block)
    sheet = read_setup_sheet(page)
    assert sheet.unproven == ()
    assert {"hole_depth", "edge_break", "thickness"} <= check_corners(block, sheet)
    check_solid(block, sheet)


@pytest.mark.long
@pytest.mark.parametrize("name", QUICK[:2])
def test_holes_and_edge_breaks_of_a_solid_at_the_corners_stay_within_the_drawing(name, tmp_path):
    block = leave_out(BLOCKS[name], "metrology")
    page, _ = write_setup_sheet_and_stock(tmp_path, block)
    sheet = read_setup_sheet(page)
    depth = block.body.mounting.depth
    for index in (0, 1):
        corner = {key: band[index] for key, band in list_sources(block, sheet).items()}
        solid = make_block(block, sheet, corner, letters=False)
        for leg in measure_legs(solid):
            assert 0.2e-3 - 1e-7 <= leg <= 0.4e-3 + 1e-7
        walls = [one for one in kernel.list_faces(solid) if one.kind == "CYLINDER"]
        drilled = [
            one for one in walls if one.radius < 0.5 * block.body.mounting.hole_diameter + 1e-9
        ]
        if DEPTH in corner:
            reached = max(wall.high[2] for wall in drilled)
        else:
            thickness = corner[GROUND] - sheet.lapped * index - block.height.limits[index]
            reached = thickness - max(wall.high[2] for wall in drilled)
        assert depth.limits[0] - 1e-7 <= reached <= depth.limits[1] + 1e-7


def test_a_relief_is_cut_by_the_sheet_as_it_is_drawn(tmp_path):
    block = StepBlock(
        id="relieved",
        height="50 um",
        relief={"width": "0.3 mm", "depth": "0.1 mm"},
        body={"engraving": "none", "mounting": "none"},
        metrology="none",
    )
    page, _ = write_setup_sheet_and_stock(tmp_path, block)
    sheet = read_setup_sheet(page)
    assert sheet.relief == pytest.approx((0.3e-3, 0.1e-3))
    check_corners(block, sheet)
    made = check_solid(block, sheet)
    (drawn,) = block.solids()
    assert sum(one.Volume() for one in made.cut(drawn).Solids()) * 1e-9 < NOTHING


@pytest.mark.repeats
@pytest.mark.parametrize("direction", ["up", "down"])
def test_both_steps_are_lapped_by_the_sheet_as_they_are_drawn(direction, tmp_path):
    block = StepBlock(
        id="two",
        height="50 um",
        second_step={"height": "30 um", "distance": "5 mm", "direction": direction},
        body={"engraving": "none"},
    )
    page, _ = write_setup_sheet_and_stock(tmp_path, block)
    sheet = read_setup_sheet(page)
    assert sheet.unproven == ()
    assert {LEFT_OF_FIRST, BETWEEN, RIGHT_OF_SECOND} <= set(sheet.accepted)
    assert {"hole_depth", "edge_break", "thickness"} <= check_corners(block, sheet)
    made = check_solid(block, sheet)
    (drawn,) = block.solids()
    assert sum(one.Volume() for one in made.cut(drawn).Solids()) * 1e-9 < NOTHING


def test_a_depth_that_no_setup_can_hold_is_said_and_has_no_limits(tmp_path):
    body = {"mounting": {"depth": {"nominal": "5 mm", "tolerance": "0.005 mm"}}}
    page, _ = write_setup_sheet_and_stock(
        tmp_path, StepBlock(id="tight", height="50 um", body=body)
    )
    assert read_setup_sheet(page).unproven == (DEPTH,)
    assert "no limits to work to for: depth of the core holes" in " ".join(page.read_text().split())


def test_faces_that_the_stock_leaves_no_cut_for_are_not_said_to_be_milled(tmp_path):
    block = StepBlock(id="tight", height="50 um", stock=["20 mm", "24 mm", "8.05 mm"])
    page, _ = write_setup_sheet_and_stock(tmp_path, block)
    sheet = read_setup_sheet(page)
    assert (sheet.left_on_base, sheet.left_on_top) == (0.0, 0.0)
    check_corners(block, sheet)
    assert "mill the base" not in page.read_text()


@pytest.mark.long
@pytest.mark.parametrize("name", BLOCKS)
def test_every_shipped_block_made_by_its_sheet_is_the_drawn_one(name, tmp_path):
    """Letters are made as drawn on the blocks of the quick test and on one of each kind."""
    block = BLOCKS[name]
    if name not in ("step-100", "gap-100"):
        block = leave_out(block, "engraving")
    page, _ = write_setup_sheet_and_stock(tmp_path, block)
    sheet = read_setup_sheet(page)
    assert sheet.unproven == ()
    check_corners(block, sheet)
    check_solid(block, sheet)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(60))
def test_blocks_drawn_at_random_with_any_body_and_stock_are_made_as_drawn(seed, tmp_path):
    block = draw_block(seed)
    page, _ = write_setup_sheet_and_stock(tmp_path, block)
    sheet = read_setup_sheet(page)
    check_corners(block, sheet)
    needed = {LEG, LEFT, RIGHT, LEFT_OF_FIRST, BETWEEN, RIGHT_OF_SECOND, GROUND, FLOOR}
    if has_nominal_middles(block) and needed.isdisjoint(sheet.unproven):
        check_solid(block, sheet)
    else:
        assert len(block.solids()) == 1
