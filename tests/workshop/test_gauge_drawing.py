"""The drawing of a step wrung from two gauge blocks: for that material alone, with what results."""

import math
import re
import zipfile

import ezdxf
import pytest

from oracles.drawn_dimensions import drawn_dimensions
from stepblocks.contact.operating_point import PAPER
from stepblocks.parts.conditions import NO_ORDER
from stepblocks.parts.gauge_pair import require_gauge_pair
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.drawing import write_gauge_drawing
from stepblocks.workshop.gauge_reach import (
    Contribution,
    explain_missing_gauge_drawing,
    find_gauge_route,
    judge_assembly_characteristics,
)
from stepblocks.workshop.gauge_views import format_number_ranges
from stepblocks.workshop.routes import Reach, list_routes
from stepblocks.workshop.run import order_parts

STEEL = "gauge-block steel, hardened, 64 HRC"
PLAIN_BODY = {"length": "28 mm", "width": "40 mm"}


def judge(block):
    """Return what decides about each characteristic of a block, by key."""
    pair = require_gauge_pair(block.height.nominal)
    route = find_gauge_route(list_routes(block, 1e-6, PAPER), pair)
    judged = judge_assembly_characteristics(block, pair, route)
    return {item.characteristic.key: item.contribution for item in judged}


def read_texts(path):
    """Return all texts of a drawing."""
    return [entity.dxf.text for entity in ezdxf.readfile(path).modelspace().query("TEXT")]


@pytest.mark.long
def test_the_order_of_a_block_of_gauge_block_steel_has_the_drawing(tmp_path):
    (tmp_path / "mine.toml").write_text(
        '[defaults.step_block.body]\nmounting = "none"\nengraving = "none"\n'
        f'[[step_block]]\nid = "wrung"\nheight = "50 um"\nmaterial = "{STEEL}"\n'
        'metrology = "none"\n'
    )
    order, *_ = order_parts(tmp_path / "mine.toml", tmp_path / "out")
    drawings = {f"wrung.gauge.{ending}" for ending in ("dxf", "svg", "pdf")}
    assert drawings <= {path.name for path in order.files}
    assert order.note == ""
    with zipfile.ZipFile(tmp_path / "out" / "mine" / "mine.quotation.zip") as archive:
        assert "wrung/wrung.gauge.pdf" in archive.namelist()


@pytest.mark.parametrize("material", ["steel", "silicon", "440C, hardened, 58 HRC", "alloy 7"])
def test_a_block_of_another_material_is_told_why_it_has_none(material):
    block = StepBlock(id="lapped", height="50 um", material=material)
    reason = explain_missing_gauge_drawing(block, require_gauge_pair(50e-6))
    assert "gauge-block steel" in reason
    assert reason.endswith(f"got {block.material.order_text}")


def test_the_drawing_states_both_lengths_the_step_and_its_uncertainty(tmp_path):
    block = StepBlock(id="wrung", height="50 um", material=STEEL)
    pair = require_gauge_pair(50e-6)
    route = find_gauge_route(list_routes(block, 1e-6, PAPER), pair)
    path, *_ = write_gauge_drawing(tmp_path, block, pair, route, NO_ORDER)
    (step,) = drawn_dimensions(path)
    assert (step.key, step.number) == ("step_height", 1)
    assert step.value == pytest.approx(50e-6, abs=1e-12)
    text = "\n".join(read_texts(path))
    assert "1,0500 - 1,0000 = 0,0500 mm" in text
    # ISO 3650, grade 0 up to 10 mm: 0.12 um and half of 0.10 um; a film of 0.02 um: of each block
    half_widths = [0.12, 0.12, 0.05, 0.05, 0.02, 0.02]
    std = math.sqrt(sum(half_width**2 / 3.0 for half_width in half_widths))
    for value in (std, 2.0 * std, sum(half_widths)):
        assert f"{value:.2f} µm".replace(".", ",") in text


def test_the_assembly_has_the_step_and_lacks_the_groove_and_a_base_that_is_too_small():
    plain = judge(StepBlock(id="a", height="50 um", material=STEEL, metrology="none"))
    assert plain["step_height"] is Contribution.GAUGE_BLOCKS
    assert plain["thickness"] is Contribution.BASE  # base and lower gauge block together
    assert plain["length"] is Contribution.BASE_SIZE  # two blocks of 9 mm, 5 mm beside them
    assert plain["flatness_upper"] is Contribution.WRINGING
    wide = judge(StepBlock(id="b", height="50 um", material=STEEL, body=PLAIN_BODY))
    assert wide["length"] is Contribution.BASE
    assert wide["groove_depth"] is Contribution.NO_FEATURE
    missed = {key for key, item in wide.items() if item.reach is Reach.NO}
    assert missed == {f"groove_{size}" for size in ("depth", "width", "length", "distance")}
    tight = {"nominal": "50 um", "tolerance": "0.3 um"}  # less than 0.38 um at worst
    assert judge(StepBlock(id="c", height=tight, material=STEEL))["step_height"].reach is Reach.NO
    screwed = {"mounting": {"kind": "clearance", "thread": "M3"}}
    covered = judge(StepBlock(id="d", height="50 um", material=STEEL, body=screwed))
    assert covered["hole_spacing"] is Contribution.NO_HOLES


def test_a_height_that_no_pair_gives_is_said():
    block = StepBlock(id="a", height="10.2 um", material=STEEL)
    assert re.search(
        r"no two gauge blocks .* 0\.0102 mm", explain_missing_gauge_drawing(block, None)
    )


def test_numbers_that_follow_one_another_are_written_as_a_range():
    assert format_number_ranges([1, 2, 3, 7, 9, 10]) == "1-3, 7, 9-10"
