"""What a machinist reads beside the dimensions: letters, edges, burr, texture and runout."""

import re
from dataclasses import replace

import pytest

from oracles.shipped import load_shipped
from stepblocks.cad.kernel import list_faces
from stepblocks.parts.characteristics import find_face_index
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.on_paper import make_inspection_sheet_table
from stepblocks.workshop.drawing import draw_part_sheet

RELIEVED = StepBlock(id="relieved", height="50 um", relief={"width": "0.3 mm", "depth": "0.1 mm"})


def find_part(name, identity):
    (part,) = (one for one in load_shipped(name).stimuli if one.id == identity)
    return part


def list_texts(part):
    sheet = draw_part_sheet(part, load_shipped("paper-ten").order)
    return [entity.dxf.text for entity in sheet.space.query("TEXT")]


def list_letters(texts):
    """Letters of datums, and of details and sections by their captions."""
    datums = [text for text in texts if re.fullmatch("[AB]", text)]
    captions = [text[0] for text in texts if re.match(r"[A-Z](-[A-Z])?   ", text)]
    return set(datums), captions


@pytest.mark.parametrize(
    "part",
    [
        find_part("paper-ten", "step-050"),
        find_part("crown-margins", "gap-050-under-020"),
        RELIEVED,
    ],
    ids=lambda part: part.id,
)
def test_no_datum_shares_its_letter_with_a_detail_or_section(part):
    datums, captions = list_letters(list_texts(part))
    assert datums == {"A", "B"}
    assert len(captions) == len(set(captions)) >= 2
    assert not datums & set(captions)


def test_edges_that_are_broken_are_the_outer_ones_and_the_working_edge_is_not():
    texts = list_texts(find_part("paper-ten", "step-050"))
    assert any("outer edges" in text for text in texts)
    assert any("Not broken: working edge, groove, letters." in text for text in texts)
    assert not any("all other edges" in text for text in texts)


def test_the_drawing_of_a_margin_limits_its_burr():
    texts = list_texts(find_part("crown-margins", "gap-050-under-020"))
    assert any(re.search("burr over tooth and crown", text) for text in texts)


def test_the_drawing_of_a_relief_says_what_its_corners_may_be():
    texts = list_texts(RELIEVED)
    assert "relief, detail F" in texts
    assert any("Inner corners of the relief (F)" in text for text in texts)
    assert not any("fillet or undercut" in text for text in texts)


def test_a_tip_says_in_words_which_shank_it_has_and_that_no_latch_is_drawn():
    # ISO 1797: type 1 is the latch shank of contra-angle handpieces, type 2 the plain one
    texts = list_texts(find_part("probe-tips", "tip-125"))
    assert any(
        text.startswith("Shank (2): ISO 1797 type 2 shank, for handpieces") for text in texts
    )
    assert any("type 1 of ISO 1797 has a latch, which is not drawn" in text for text in texts)


def test_a_shank_of_no_standard_is_not_said_to_be_one():
    tip = find_part("probe-tips", "tip-125")
    plain = tip.model_copy(update={"shank_radius": replace(tip.shank_radius, source="")})
    assert not any("Shank" in text or "1797" in text for text in list_texts(plain))


def test_every_roughness_that_a_drawing_asks_for_stands_on_the_sheet():
    for name, identity in (("probe-tips", "tip-125"), ("sheaths", "sheath-hard")):
        part = find_part(name, identity)
        table = make_inspection_sheet_table(part)
        (line,) = table[table.kind == "roughness"].itertuples()
        (note,) = (text for text in list_texts(part) if "roughness" in text)
        stated = re.fullmatch(rf"{line.number}  roughness Ra, \w+: Ra ([\d,]+) µm .*", note)
        largest = float(stated[1].replace(",", "."))
        assert float(line.upper_limit_mm_or_deg) == pytest.approx(largest * 1e-3, rel=0.02)


def test_the_height_of_a_lip_over_the_tooth_is_stated():
    lip = find_part("crown-margins", "gap-020-lip")
    assert any(
        "gap under the lip, over the tooth: 0,020 ±0,002" in text for text in list_texts(lip)
    )
    (solid,) = lip.solids()
    (size,) = (one for one in lip.characteristics() if one.key == "lip_gap")
    faces = list_faces(solid)
    tooth, under_lip = (faces[find_face_index(faces, rule, lip.id)] for rule in size.faces)
    assert under_lip.low[2] - tooth.low[2] == pytest.approx(size.nominal, abs=1e-10)


def test_the_section_of_a_crown_says_where_its_detail_lies():
    assert "margin, detail D" in list_texts(find_part("crown-margins", "crown-shoulder"))


def test_a_bore_that_is_stated_in_words_has_the_sign_of_a_diameter():
    texts = list_texts(find_part("apparatus", "arm"))
    assert any(re.search("bore 1, along y: ⌀3,00", text) for text in texts)
