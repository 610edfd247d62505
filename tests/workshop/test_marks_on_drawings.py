"""What a machinist reads beside the dimensions: letters, edges, burr, texture and runout."""

import re
from pathlib import Path

import pytest

from stepblocks.declaration.read import load_set
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.workshop.drawing import draw_part_sheet

STIMULI = Path(__file__).parents[2] / "stimuli"
RELIEVED = StepBlock(id="relieved", height="50 um", relief={"width": "0.3 mm", "depth": "0.1 mm"})


def find_part(name, identity):
    (part,) = (one for one in load_set(STIMULI / f"{name}.toml").stimuli if one.id == identity)
    return part


def list_texts(part):
    sheet = draw_part_sheet(part, load_set(STIMULI / "paper-ten.toml").order)
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
