"""Letters of one's own in the front of a block, where they are asked for.

The truth is the volume of the letters, and where the kernel finds their floors.
"""

import numpy as np
import pytest

from stepblocks import cad
from stepblocks.declaration.read import load_sets
from stepblocks.errors import StimulusError, UsageError
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.lettering import compute_text_width
from stepblocks.parts.on_paper import make_inspection_sheet_table
from stepblocks.workshop.drawing import draw_part_sheet
from stepblocks.workshop.setup import write_setup_sheet_and_stock

HEIGHT = {"nominal": "50 um", "tolerance": "1 um"}


def make_block(**engraving):
    return StepBlock(id="step-050", height=HEIGHT, body={"engraving": engraving})


def find_floors(block):
    """Return the corners (x, z) of the faces on which the letters end, shape (n, 2, 2) [m]."""
    floor = block.body.engraving.depth.nominal - block.body.half_width
    (body,) = block.solids()
    boxes = []
    for face in cad.kernel.list_faces(body):
        if abs(face.low[1] - floor) < 1e-9 and abs(face.high[1] - floor) < 1e-9:
            boxes.append([(face.low[0], face.low[2]), (face.high[0], face.high[2])])
    return np.array(boxes)


def test_letters_stand_where_they_are_asked_for_and_take_their_volume_away():
    block = make_block(text="Lab 7", offset=["3 mm", "-1 mm"])
    floors = find_floors(block)
    height = block.body.engraving.height.nominal
    width = compute_text_width("Lab 7", height)
    low = floors[:, 0].min(axis=0)
    high = floors[:, 1].max(axis=0)
    middle = np.array([3e-3, -0.5 * block.body.thickness.nominal - 1e-3])
    assert 0.5 * (low + high) == pytest.approx(middle, abs=0.1 * height)
    assert high - low == pytest.approx([width, height], rel=0.1)
    (body,) = block.solids()
    volume = cad.kernel.compute_volume(body)
    assert volume == pytest.approx(block.volumes()[0], rel=1e-12)


def test_papers_say_the_text_and_its_place(tmp_path):
    block = make_block(text="Lab 7", offset=["3 mm", "-1 mm"])
    texts = [entity.dxf.text for entity in draw_part_sheet(block).space.query("TEXT")]
    assert "Lab 7" in texts
    assert "middle 3 right, 1 under that of the front" in texts
    labels = list(make_inspection_sheet_table(block)["characteristic"])
    assert any(label.endswith("1 mm under the middle of the front") for label in labels)
    page, _ = write_setup_sheet_and_stock(tmp_path, block, [], None)
    text = " ".join(page.read_text(encoding="utf-8").split())
    assert "engrave Lab 7, the middle of the letters 3.000 mm to the right of the middle" in text


@pytest.mark.parametrize(
    ("engraving", "rule"),
    [
        ({"text": "Lab 7", "offset": ["0 mm", "2.5 mm"]}, "leave room over and under the letters"),
        ({"text": "Lab 7", "offset": ["8.5 mm", "0 mm"]}, "'Lab 7' to fit the front"),
        ({"text": "laboratory of the university, no. 7"}, "fit the front"),
        ({"text": "a\nb"}, "printable ASCII"),
        ({"text": "µ"}, "printable ASCII"),
        ({"offset": ["1 mm"]}, "offset"),
    ],
)
def test_letters_that_do_not_fit_are_refused_by_name(engraving, rule):
    with pytest.raises(UsageError, match=rule):
        make_block(**engraving)


def test_without_a_text_the_identity_is_engraved_as_before():
    assert make_block().body.engraving.choose_text("step-050") == "STEP-050"
    assert make_block().volumes() == StepBlock(id="step-050", height=HEIGHT).volumes()


@pytest.mark.parametrize(
    ("field", "reason"),
    [
        ("hand", "turned by half a turn"),
        ("datum", "referred to the lower working face"),
        ("undercut", "a step block takes relief"),
        ("steps", "a step block takes second_step"),
    ],
)
def test_what_no_block_can_be_is_refused_with_the_reason(field, reason, tmp_path):
    path = tmp_path / "asked.toml"
    text = f'[[step_block]]\nid = "a"\nheight = "50 um"\n{field} = "left"\n'
    path.write_text(text, encoding="utf-8")
    with pytest.raises(StimulusError, match=f"{field} is not a known field.*{reason}"):
        load_sets(path)
