"""Numbers, lines and callouts as a workshop reads them: exact decimals, limits in order, text in
front of the part."""

import math
import os
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.artefacts.step.callout import compute_bounding_box, format_callout, outline_callout
from stepblocks.artefacts.step.conform import repair_step_text
from stepblocks.cad.kernel import Face
from stepblocks.cli import main
from stepblocks.declaration.read import load_set
from stepblocks.declaration.select import find_stimulus_files
from stepblocks.errors import MachiningError
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.on_paper import (
    COLUMNS,
    choose_decimals,
    format_millimetres,
    format_size_with_deviations,
    make_inspection_sheet_table,
)
from stepblocks.records.sheet_read import read_filled_sheet

STIMULI = Path(__file__).parents[2] / "stimuli"
TEN = STIMULI / "paper-ten.toml"


@pytest.mark.parametrize("nanometres", [0, 1, 10, 125, 1000, 10_000, 32_000, 2_350_000, 39_999_999])
def test_a_length_is_printed_with_all_its_decimals_and_read_back_the_same(nanometres):
    length = nanometres * 1e-9
    text = format_millimetres(length, choose_decimals(length))
    assert round(float(text) * 1e6) == nanometres
    assert 1 <= len(text.partition(".")[2]) <= 6


def test_nothing_is_printed_as_minus_nothing():
    assert format_millimetres(-1e-12, 3) == "0.000"
    assert format_size_with_deviations(-0.0, -0.0, 0.0) == "0.0 ±0.0"


@pytest.mark.parametrize(
    ("nominal", "lower", "upper", "text"),
    [
        (1e-3, 5e-6, 9e-6, "1.000 +0.009/+0.005"),
        (1e-3, -9e-6, -5e-6, "1.000 -0.005/-0.009"),
        (1e-3, -9e-6, 5e-6, "1.000 +0.005/-0.009"),
        (1e-3, 0.0, 50e-9, "1.00000 +0.00005/0"),
    ],
)
def test_deviations_carry_their_signs_the_upper_first(nominal, lower, upper, text):
    assert format_size_with_deviations(nominal, lower, upper) == text


@pytest.fixture(scope="module")
def tip():
    return next(one for one in load_shipped("probe-tips").stimuli if one.id == "tip-125")


def test_the_sheet_lists_limits_as_values_and_angles_in_degrees(tip):
    table = make_inspection_sheet_table(tip, {"ball_radius": (125.4e-6, 0.1e-6, "conforms")})
    assert tuple(table.columns) == COLUMNS
    assert table.number.tolist() == [str(count) for count in range(1, len(table) + 1)]
    ball = table[table.characteristic.str.contains("ball")].iloc[0]
    assert (ball.measured_mm_or_deg, ball.std_mm_or_deg, ball.verdict) == (
        "0.125400",
        "0.000100",
        "conforms",
    )
    shank = table[table.kind == "diameter"].iloc[0]  # ISO 1797: 2.35 mm +0 / -0.016 mm
    assert (shank.nominal_mm_or_deg, shank.lower_limit_mm_or_deg, shank.upper_limit_mm_or_deg) == (
        "2.350",
        "2.334",
        "2.350",
    )
    cone = table[table.unit == "deg"].iloc[0]
    assert (cone.nominal_mm_or_deg, cone.lower_limit_mm_or_deg, cone.upper_limit_mm_or_deg) == (
        "16",
        "15",
        "17",
    )
    assert (table.verdict != "").sum() == 1


def test_a_zone_has_no_nominal_and_no_lower_limit():
    block = load_shipped("paper-ten").step_block[0]
    table = make_inspection_sheet_table(block)
    zones = table[table.kind.isin(["flatness", "parallelism"])]
    assert len(zones) == 5  # two faces and the base, the upper to the lower, the lower to the base
    assert set(zones.nominal_mm_or_deg) == set(zones.lower_limit_mm_or_deg) == {""}
    assert all(float(limit) > 0.0 for limit in zones.upper_limit_mm_or_deg)


FACES = [
    Face("PLANE", math.nan, low=(-0.01, -0.01, 0.0), high=(0.01, 0.01, 0.0)),
    Face("PLANE", math.nan, low=(0.0, -0.01, 0.0), high=(0.01, 0.01, 0.005)),
]


def test_a_callout_lies_in_one_plane_before_the_part_and_leads_to_its_face():
    text, leader = outline_callout("1  step", 0, compute_bounding_box(FACES), FACES[1])
    points = np.concatenate(text)
    assert np.ptp(points[:, 1]) == 0.0
    assert points[0, 1] < -0.01  # in front of everything
    assert points[:, 0].min() > 0.01  # to the right of everything
    assert leader[1] == pytest.approx((0.005, 0.0, 0.0025))
    above, _ = outline_callout("1  step", 1, compute_bounding_box(FACES), FACES[1])
    assert np.concatenate(above)[:, 2].min() > points[:, 2].max()


def test_outlines_of_letters_are_closed():
    outlines, _ = outline_callout("8", 0, compute_bounding_box(FACES), FACES[0])
    assert len(outlines) == 3  # the outline and either hole
    for outline in outlines:
        # each corner once: the line back to the first is none of no length
        assert len(np.unique(outline, axis=0)) == len(outline) > 3


@pytest.mark.parametrize(
    ("one", "text"),
    [
        (Characteristic("a", "ball", "radius", 125e-6, -2e-6, 2e-6), "7  ball R 0.125 ±0.002"),
        (
            Characteristic("a", "shank", "diameter", 2.35e-3, -32e-6, 0.0),
            "7  shank dia. 2.350 0/-0.032",
        ),
        (Characteristic("a", "flatness", "flatness", 0.0, 0.0, 0.5e-6), "7  flatness 0.0005"),
    ],
)
def test_a_callout_says_number_name_sign_and_limits(one, text):
    assert format_callout(one, 7) == text


@pytest.mark.parametrize("roughness", [0.1e-6, 2e-3, 1e-9, 1.25e-9])
def test_a_real_of_part_21_has_a_point(roughness):
    shape = (
        "#1 = (LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n#2 = "
        "FLATNESS_TOLERANCE('',$,#3,#4);\n"
    )
    text = mended(shape + "#5 = (GEOMETRIC_REPRESENTATION_CONTEXT(3));\n", roughness=roughness)
    (real,) = re.findall(r"'Ra',LENGTH_MEASURE\((.*?)\)", text)
    assert re.fullmatch(r"[-+]?\d+\.\d*(E[-+]?\d+)?", real)
    assert float(real) == pytest.approx(roughness * 1e3, rel=1e-12)


def test_semicolons_in_strings_do_not_end_an_instance():
    text = mended(
        "#1 = A('x;''y;');\n#7 = PRODUCT_DEFINITION\n  ();\n#8 = "
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3));\n",
        notes=[("a", "b")],
    )
    assert "#1 = A('x;''y;');" in text
    assert "#9 = DESCRIPTIVE_REPRESENTATION_ITEM('a','b');" in text


HEAD = "ISO-10303-21;\nHEADER;\nFILE_NAME('out','2031-01-01T10:00:00');\nENDSEC;\nDATA;\n"
TAIL = "ENDSEC;\nEND-ISO-10303-21;\n"


def mended(data, **more):
    return repair_step_text(f"{HEAD}{data}{TAIL}", "part", **more)


def test_limits_get_the_type_of_their_unit_and_zero_no_sign():
    units = (
        "#1 = (LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n#2 = "
        "(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));\n"
    )
    text = mended(
        units + "#3 = MEASURE_WITH_UNIT(-1.E-03,#1);\n#4 = MEASURE_WITH_UNIT(0.5,#2);\n#5 = "
        "MEASURE_WITH_UNIT(-0.,#1);\n"
    )
    assert "#3 = MEASURE_WITH_UNIT(LENGTH_MEASURE(-1.E-03),#1);" in text
    assert "#4 = MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(0.5),#2);" in text
    assert "#5 = MEASURE_WITH_UNIT(LENGTH_MEASURE(0.),#1);" in text
    assert "FILE_NAME('part','2000-01-01T00:00:00'" in text


def test_names_go_to_dimensions_in_their_order_and_none_may_be_left():
    data = (
        "#1 = DIMENSIONAL_LOCATION('linear distance',$,#8,#9);\n#2 = "
        "DIMENSIONAL_LOCATION('linear distance',$,#8,#9);\n"
    )
    text = mended(data, names=[("distance", "step height"), ("to_outer", "length")])
    assert "#1 = DIMENSIONAL_LOCATION('linear distance','step height',#8,#9)" in text
    assert "#2 = DIMENSIONAL_LOCATION('linear distance','length',#8,#9)" in text
    with pytest.raises(MachiningError, match="missing third"):
        mended(data, names=[("distance", name) for name in ("first", "second", "third")])


def test_notes_and_texture_need_something_to_belong_to():
    with pytest.raises(MachiningError, match="notes must have a product"):
        mended("#1 = A();\n", notes=[("a", "b")])
    with pytest.raises(MachiningError, match="surface texture must have faces"):
        mended("#1 = A();\n", roughness=0.1e-6)


def test_every_kind_of_part_has_texts_that_part_21_may_hold():
    for path in find_stimulus_files(STIMULI):
        for stimulus in load_set(path).stimuli:
            for number, one in enumerate(stimulus.characteristics(), start=1):
                assert format_callout(one, number).replace("±", "+-").isascii()


@pytest.fixture
def sheet(tmp_path):
    """A filled sheet as a spreadsheet program writes it."""
    table = make_inspection_sheet_table(
        load_set(TEN).stimuli[1], {"step_height": (25.1e-6, 1e-7, "conforms")}
    )
    table.to_excel(tmp_path / "sheet.xlsx", index=False)
    return tmp_path / "sheet.xlsx"


def test_a_filled_spreadsheet_gives_what_was_written_in_it_in_metres(sheet):
    (height,) = read_filled_sheet(sheet)
    assert (height.value, height.std) == pytest.approx((25.1e-6, 1e-7), rel=1e-9)


def damaged(sheet, part, change):
    """Pack the spreadsheet anew with one part of it changed, its sums right."""
    with zipfile.ZipFile(sheet) as whole:
        parts = {name: whole.read(name) for name in whole.namelist()}
    parts[part] = change(parts[part])
    with zipfile.ZipFile(sheet, "w") as whole:
        for name, content in parts.items():
            whole.writestr(name, content)


@pytest.mark.parametrize("part", ["xl/workbook.xml", "xl/worksheets/sheet1.xml", "xl/styles.xml"])
@pytest.mark.parametrize("change", [lambda text: text[:-40], lambda text: text[: len(text) // 2]])
def test_a_damaged_spreadsheet_is_refused_in_one_line_with_its_name(part, change, sheet, capsys):
    damaged(sheet, part, change)
    said = refused(sheet, capsys)
    assert "must be a sound XLSX file, got: " in said


def test_a_spreadsheet_whose_compressed_bytes_are_damaged_is_refused_by_name(sheet, capsys):
    whole = bytearray(sheet.read_bytes())
    with zipfile.ZipFile(sheet) as archive:
        start = archive.getinfo("xl/worksheets/sheet1.xml").header_offset + 80
    whole[start : start + 30] = b"\xff" * 30
    sheet.write_bytes(whole)
    refused(sheet, capsys)


def test_a_pipe_that_is_called_a_spreadsheet_is_not_waited_for(tmp_path, capsys):
    os.mkfifo(tmp_path / "sheet.xlsx")
    assert "Not a plain file" in refused(tmp_path / "sheet.xlsx", capsys)


def refused(sheet, capsys):
    """What the command says of a sheet that it cannot read."""
    asked = ["inspect", str(sheet), "--set", str(TEN), "--stimulus", load_set(TEN).stimuli[1].id]
    assert main([*asked, "-o", str(sheet.parent / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.strip().endswith("sheet.xlsx]")
    return said
