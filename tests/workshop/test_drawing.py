"""Drawings say what was asked for, print every decimal, and nothing on them overlaps or leaves the
sheet."""

import csv
import itertools
import math
import random

import pytest

from oracles.drawn_dimensions import drawn_dimensions
from oracles.shipped import list_shipped_parts
from stepblocks.files.tables import write_table
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.on_paper import (
    COLUMNS,
    choose_decimals,
    format_size_with_deviations,
    make_inspection_sheet_table,
)
from stepblocks.workshop.drawing import write_drawing

STIMULI = list_shipped_parts()
STIMULI["relieved-050"] = StepBlock(
    id="relieved-050", height="50 um", relief={"width": "0.3 mm", "depth": "0.1 mm"}
)
for direction in ("up", "down"):
    STIMULI[f"two-{direction}"] = StepBlock(
        id=f"two-{direction}",
        height="50 um",
        second_step={"height": "30 um", "distance": "5 mm", "direction": direction},
    )


@pytest.fixture(scope="module", params=sorted(STIMULI))
def drawing(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("drawing")
    (path,) = write_drawing(folder, STIMULI[request.param], ("dxf",))
    return STIMULI[request.param], path


@pytest.mark.repeats
def test_every_dimension_of_the_dxf_measures_and_prints_what_was_asked_for(drawing):
    stimulus, path = drawing
    listed = {
        one.key: (number, one) for number, one in enumerate(stimulus.characteristics(), start=1)
    }
    found = drawn_dimensions(path)
    # a bent wire has no straight pair of lines to measure
    assert found or stimulus.id.startswith("hook")
    for one in found:
        number, wanted = listed[one.key]
        assert one.number == number
        assert one.value == pytest.approx(wanted.nominal, abs=1e-9)
        assert (one.lower, one.upper) == pytest.approx((wanted.lower, wanted.upper), abs=1e-12)
        decimals = choose_decimals(wanted.nominal, wanted.lower, wanted.upper)
        # the decimal marker of ISO 129-1 is a comma
        assert f"{wanted.nominal * 1e3:.{decimals}f}".replace(".", ",") in one.text
    # every characteristic stands on the sheet: as dimension, as frame with a balloon, or as a note
    import ezdxf

    space = ezdxf.readfile(path).modelspace()
    texts = [entity.dxf.text.replace(",", ".") for entity in space.query("TEXT")]
    for number, wanted in listed.values():
        assert str(number) in texts or any(
            text.startswith(f"{number}  {wanted.label.replace(',', '.')}") for text in texts
        ), wanted.label


@pytest.mark.repeats
def test_no_text_overlaps_another_or_leaves_the_sheet(drawing):
    import ezdxf
    from ezdxf import bbox

    _, path = drawing
    boxes = []
    for entity in ezdxf.readfile(path).modelspace():
        parts = entity.virtual_entities() if entity.dxftype() == "DIMENSION" else [entity]
        for part in parts:
            if part.dxftype() in ("TEXT", "MTEXT"):
                extent = bbox.extents([part], fast=False)
                if extent.has_data:
                    boxes.append((extent.extmin, extent.extmax, part))
    for low, high, part in boxes:
        name = part.plain_text()
        assert low.x > 10.0, name
        assert high.x < 410.0, name
        assert low.y > 10.0, name
        assert high.y < 287.0, name
    for (a0, a1, a), (b0, b1, b) in itertools.combinations(boxes, 2):
        apart = a1.x < b0.x + 0.05 or b1.x < a0.x + 0.05 or a1.y < b0.y + 0.05 or b1.y < a0.y + 0.05
        assert apart, (a.plain_text(), b.plain_text())


def test_ten_microns_are_never_printed_as_a_hundredth_or_as_nothing():
    assert format_size_with_deviations(10e-6, -1e-6, 1e-6) == "0.010 ±0.001"
    assert format_size_with_deviations(2.35e-3, -32e-6, 0.0) == "2.350 0/-0.032"
    assert format_size_with_deviations(0.0, 0.0, 2e-6) == "0.000 +0.002/0"
    assert format_size_with_deviations(-60e-6, -3e-6, 3e-6) == "-0.060 ±0.003"
    assert choose_decimals(1.0005e-3) == 4


@pytest.mark.long
def test_svg_and_pdf_come_out_the_same_twice(tmp_path):
    first = write_drawing(tmp_path, STIMULI["step-010"], ("dxf", "svg", "pdf"))
    content = [path.read_bytes() for path in first]
    random.seed(5)  # whoever draws keeps his own random numbers
    again = write_drawing(tmp_path, STIMULI["step-010"], ("dxf", "svg", "pdf"))
    assert random.random() == random.Random(5).random()
    assert [path.read_bytes() for path in again] == content
    assert content[1].startswith(b"<?xml")
    assert content[2].startswith(b"%PDF")


@pytest.mark.parametrize("identity", sorted(STIMULI))
def test_the_inspection_sheet_has_a_line_for_every_characteristic_with_limits_in_order(
    identity, tmp_path
):
    path = tmp_path / "sheet.csv"
    write_table(make_inspection_sheet_table(STIMULI[identity]), path)
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    listed = list(STIMULI[identity].characteristics())
    assert list(rows[0]) == list(COLUMNS)
    assert [row["characteristic"] for row in rows] == [one.label for one in listed]
    for row, one in zip(rows, listed, strict=True):
        scale = 180.0 / math.pi if one.quantity == "angle" else 1e3
        assert float(row["upper_limit_mm_or_deg"]) == pytest.approx(
            (one.nominal + one.upper) * scale, abs=1e-9
        )
        assert row["measured_mm_or_deg"] == ""


def test_a_filled_sheet_carries_values_and_verdicts(tmp_path):
    measured = {"step_height": (10.02e-6, 0.05e-6, "conforms")}
    write_table(make_inspection_sheet_table(STIMULI["step-010"], measured), tmp_path / "sheet.csv")
    assert "0.010020,0.000050,conforms" in (tmp_path / "sheet.csv").read_text()
