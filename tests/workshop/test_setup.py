"""A setup sheet: the stock holds the part, the machine accepts only what it can prove, and a step
is not milled."""

import re

import pytest

from oracles.shipped import load_shipped
from stepblocks.artefacts.step.check_step import check_step
from stepblocks.cad import kernel
from stepblocks.parts.shapes import build_solids
from stepblocks.parts.stock import STOCK, compute_stock_corners
from stepblocks.workshop.setup import PROBE, write_setup_sheet_and_stock

STEP = load_shipped("paper-ten").step_block[4]
MARGIN = load_shipped("crown-margins").margin_block[0]


@pytest.mark.parametrize("block", [STEP, MARGIN], ids=lambda block: block.id)
def test_the_stock_holds_the_part_with_its_allowance_on_every_face(block, tmp_path):
    _, stock = write_setup_sheet_and_stock(tmp_path, block)
    assert check_step(stock, require_ap242=True).passes
    (body,) = kernel.read_step_solids(stock)
    low, high = compute_stock_corners(block)
    ((_, part),) = build_solids(block)
    around = kernel.list_faces(part)
    for axis in range(3):
        assert min(face.low[axis] for face in around) - low[axis] > STOCK - 1e-6
        assert high[axis] - max(face.high[axis] for face in around) > STOCK - 1e-6
    inside = sum(solid.Volume() for solid in part.intersect(body).Solids()) * 1e-9
    assert inside == pytest.approx(kernel.compute_volume(part), rel=1e-9)


def cells(page):
    return [re.findall(r"<td>([^<]*)", row) for row in page.read_text().split("<tr>")]


def test_what_the_machine_cannot_prove_is_measured_off_it(tmp_path):
    page, _ = write_setup_sheet_and_stock(tmp_path, STEP)
    rows = {row[1]: row for row in cells(page) if len(row) == 6}
    assert len(rows) == len(list(STEP.characteristics()))
    # 20 +-0.2 mm less a guard band of 1.65 x 2.5 um on either side (ISO 14253-1)
    assert rows["length"][3:5] == ["setup 2", "19.804 to 20.196"]
    assert rows["step height"][3].startswith("off the machine: profilometer")
    for one in STEP.characteristics():
        if one.upper - one.lower < 8.0 * 1.65 * PROBE:
            assert rows[one.label][3].startswith("off the machine")


def test_the_sheet_says_that_a_step_is_lapped_or_wrung_and_how_the_burr_is_checked(tmp_path):
    page, _ = write_setup_sheet_and_stock(tmp_path, load_shipped("paper-ten").step_block[0])
    text = page.read_text()
    assert "A step of 10 µm is lapped or wrung, not milled." in text
    assert "Burr check" in text
    assert "more than 1 µm within" in text.replace("\n", " ")
    assert "harden and temper" in text
    assert "Stock 22.0 x 26.0 x 10.5 mm" in text


def test_level_faces_have_no_step_to_lap_and_a_gap_is_cut_last(tmp_path):
    level = next(one for one in load_shipped("crown-margins").margin_block if one.rise == 0.0)
    text = write_setup_sheet_and_stock(tmp_path, level)[0].read_text()
    assert "The working faces lie level" in text
    assert "Cut the gap last" in text
    assert "A step of" not in text
