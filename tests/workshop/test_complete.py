"""A workshop can make every shipped part without asking; what is taken from drawing, STEP file or
sheet is missed."""

import csv
import re
from dataclasses import replace

import ezdxf
import pytest
from ezdxf import bbox

from oracles.complete import find_missing
from oracles.shipped import list_shipped_parts
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.files.tables import write_table
from stepblocks.parts.on_paper import make_inspection_sheet_table
from stepblocks.parts.shapes import build_solids
from stepblocks.workshop.drawing import write_drawing

STIMULI = list_shipped_parts()
# one of every layout: blocks alike but for their height are read on paper, not built each
BUILT = (
    "step-050",
    "gap-050-bevelled",
    "crown-chamfer-over",
    "crown-shoulder",
    "tip-125",
    "hook-125",
    "sheath-hard",
)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder, found = tmp_path_factory.mktemp("complete"), {}

    def write(identity):
        if identity not in found:
            part = STIMULI[identity]
            (drawing,) = write_drawing(folder, part, ("dxf",))
            sheet, step = folder / f"{identity}.csv", folder / f"{identity}.step"
            write_table(make_inspection_sheet_table(part), sheet)
            write_step_ap242(step, part, build_solids(part))
            found[identity] = part, drawing, step, sheet
        return found[identity]

    return write


@pytest.mark.repeats
@pytest.mark.parametrize("identity", sorted(STIMULI))
def test_every_shipped_part_is_complete_on_paper(identity, tmp_path):
    part = STIMULI[identity]
    (drawing,) = write_drawing(tmp_path, part, ("dxf",))
    write_table(make_inspection_sheet_table(part), tmp_path / "sheet.csv")
    assert find_missing(part, drawing, None, tmp_path / "sheet.csv") == []


@pytest.mark.repeats
@pytest.mark.parametrize("identity", BUILT)
def test_every_layout_is_complete_in_all_three_places(identity, written):
    assert find_missing(*written(identity)) == []


@pytest.mark.long
def test_a_dimension_taken_from_the_drawing_is_missed(written, tmp_path):
    part, drawing, _, _ = written("step-050")
    for number, one in list(enumerate(part.characteristics(), start=1))[::2]:
        document = ezdxf.readfile(drawing)
        space = document.modelspace()
        (mine,) = [
            e
            for e in space
            if e.has_xdata("STEPBLOCKS") and e.get_xdata("STEPBLOCKS")[0].value == one.key
        ]
        space.delete_entity(mine)
        document.saveas(tmp_path / "less.dxf")
        assert find_missing(part, tmp_path / "less.dxf") == [
            f"less.dxf: {number}  {one.label} must stand once, got 0 times"
        ]


def test_each_line_taken_from_the_sheet_is_missed_and_a_wrong_limit_is_seen(written, tmp_path):
    part, _, _, sheet = written("crown-shoulder")
    rows = list(csv.reader(sheet.read_text(encoding="utf-8").splitlines()))
    for row in range(1, len(rows)):
        less = tmp_path / "less.csv"
        with less.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(rows[:row] + rows[row + 1 :])
        (line,) = find_missing(part, sheet=less)
        assert rows[row][1] in line
    rows[1][5] = "9.9"
    with less.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    assert "upper limit" in find_missing(part, sheet=less)[0]


@pytest.mark.parametrize("identity", ["crown-chamfer-over", "tip-125"])
def test_each_dimension_taken_from_the_step_file_is_missed(identity, written, tmp_path):
    part, _, step, _ = written(identity)
    text, taken = step.read_text(), []
    for one in part.characteristics():
        for entity in ("DIMENSIONAL_LOCATION('linear distance", "DESCRIPTIVE_REPRESENTATION_ITEM("):
            found = re.search(re.escape(entity) + r"[^;]*'" + re.escape(one.label) + "'", text)
            if found:
                taken.append(one.key)
                less = text.replace(found[0], found[0].replace(f"'{one.label}'", "'gone'"))
                (tmp_path / "less.step").write_text(less)
                assert any(
                    one.label in line for line in find_missing(part, step=tmp_path / "less.step")
                ), one.label
    assert len(taken) >= 1


def test_a_surface_without_its_texture_is_missed(written, tmp_path):
    part, _, step, _ = written("step-050")
    (tmp_path / "less.step").write_text(step.read_text().replace("'surface texture'", "'gone'"))
    assert any(
        "surface texture" in line for line in find_missing(part, step=tmp_path / "less.step")
    )


def test_a_declared_dimension_that_no_characteristic_states_is_named():
    part = STIMULI["tip-125"]
    more = part.model_copy(update={"length": replace(part.length)})
    assert find_missing(more) == []
    listed = [one for one in part.characteristics() if one.key != "length"]

    class Forgetful(type(part)):
        def characteristics(self):
            return iter(listed)

    assert find_missing(Forgetful.model_construct(**dict(part))) == [
        f"tip-125: length ({part.length}) is stated by no characteristic"
    ]


def boxes(path):
    """Boxes of all texts, and of everything else that is drawn, read back from the file."""
    texts, rest = [], []
    for entity in ezdxf.readfile(path).modelspace():
        for part in entity.virtual_entities() if entity.dxftype() == "DIMENSION" else [entity]:
            extent = bbox.extents([part], fast=False)
            if extent.has_data:
                (texts if part.dxftype() in ("TEXT", "MTEXT") else rest).append((extent, part))
    return texts, rest


def apart(a, b, by=0.05):
    return (
        a.extmax.x < b.extmin.x + by
        or b.extmax.x < a.extmin.x + by
        or a.extmax.y < b.extmin.y + by
        or b.extmax.y < a.extmin.y + by
    )


@pytest.mark.long
def test_letters_stay_letters_in_svg_and_pdf(tmp_path):
    _, svg, pdf = write_drawing(tmp_path, STIMULI["step-010"])
    text = svg.read_text(encoding="utf-8")
    for said in ("STEP-010", "working edge, detail D", "0,010", "first angle (ISO 5456-2), A3"):
        assert f">{said}</text>" in text, said
    # an embedded typeface with a map to characters, not outlines
    assert b"/Type0" in pdf.read_bytes()
