"""What a workshop is sent: files in the folder of the part, routes that reach its tolerance, and
never a file outside."""

import csv
from pathlib import Path
from typing import ClassVar

import pytest

from oracles.drawn_dimensions import drawn_dimensions
from oracles.shipped import load_shipped
from stepblocks.cli import main
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import MachiningError, PipelineError, StepblocksError
from stepblocks.parts.gauge_pair import GRADES, require_gauge_pair
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.tips import StraightTip
from stepblocks.workshop import drawing
from stepblocks.workshop.drawing import VIEWS, write_drawing
from stepblocks.workshop.routes import load_processes
from stepblocks.workshop.run import PartOrder, order_parts, tabulate_routes

STIMULI = Path(__file__).parents[2] / "stimuli"


@pytest.fixture(scope="module")
def orders(tmp_path_factory):
    folder = tmp_path_factory.mktemp("orders")
    return folder, order_parts(STIMULI / "probe-tips.toml", folder, only="tip-125")


def test_one_order_names_the_files_of_its_part_and_a_tip_has_no_routes(orders):
    folder, (order,) = orders
    assert order.name == "probe-tips/tip-125"
    assert order.routes == ()
    assert {path.name for path in order.files} == {
        *(f"tip-125.drawing.{form}" for form in ("dxf", "svg", "pdf")),
        "tip-125.plan.qif",
        *(f"tip-125.inspection-sheet.{form}" for form in ("csv", "html")),
    }
    assert all(
        path.is_file() and path.parent == folder / "probe-tips" / "tip-125" for path in order.files
    )


@pytest.mark.long
def test_a_capability_may_be_a_text_or_metres_and_decides_which_route_reaches(tmp_path):
    found = []
    for capability in ("0.5 um", 0.5e-6, None):
        (order,) = order_parts(
            [str(STIMULI / "paper-ten.toml")], str(tmp_path), only="step-050", capability=capability
        )
        found.append(
            {route.name: (route.deviation, "height" not in route.missed) for route in order.routes}
        )
    assert found[0] == found[1]
    assert found[0]["one piece"] == (0.5e-6, True)  # 0.5 um of a workshop against +-1 um asked for
    assert found[2]["one piece"] == (2e-6, False)  # ground, not lapped
    assert found[0]["gauge blocks, grade K"] == found[2]["gauge blocks, grade K"]


@pytest.mark.long
def test_a_block_with_the_sizes_of_another_is_said_where_it_is_ordered(tmp_path, capsys):
    blocks = [
        {"id": "first", "height": "25 um"},
        {"id": "higher", "height": "26 um"},
        {"id": "again", "height": "25 um", "material": "brass"},
        {"id": "rounded", "height": "25 um", "edge_radius": "5 um"},
    ]
    alike = StimulusSet.declare("mine", step_block=blocks).describe_alike()
    assert list(alike) == ["again"]
    assert alike["again"].startswith("again has the sizes of first: height 25 um")
    text = "\n".join(f'[[step_block]]\nid = "{one["id"]}"\nheight = "25 um"' for one in blocks[:2])
    (tmp_path / "mine.toml").write_text(text)
    assert main(["workshop", str(tmp_path / "mine.toml"), "-o", str(tmp_path / "out")]) == 0
    assert "mine/higher: higher has the sizes of first: height 25 µm" in capsys.readouterr().out


def test_a_set_with_a_mistake_leaves_no_folder(tmp_path):
    (tmp_path / "bad.toml").write_text('[[step_block]]\nid = "a"\nheight = "-1 um"\n')
    with pytest.raises(StepblocksError, match="height"):
        order_parts(tmp_path / "bad.toml", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.repeats
@pytest.mark.parametrize("capability", ["0 um", "-1 um", 0.0])
def test_a_capability_must_be_positive(capability, tmp_path):
    with pytest.raises(MachiningError, match="capability must be positive"):
        order_parts(STIMULI / "paper-ten.toml", tmp_path, only="step-050", capability=capability)


def test_a_capability_has_a_unit_of_length(tmp_path):
    with pytest.raises(StepblocksError):
        order_parts(STIMULI / "paper-ten.toml", tmp_path, capability="2 N")


def test_an_order_is_announced_when_it_is_written_and_none_is_an_error(tmp_path):
    told = []
    order_parts(
        STIMULI / "sheaths.toml", tmp_path, only="sheaths/sheath-hard", announce=told.append
    )
    assert [order.name for order in told] == ["sheaths/sheath-hard"]
    with pytest.raises(PipelineError, match="--only must match"):
        order_parts(STIMULI / "sheaths.toml", tmp_path, only="step-*")


@pytest.mark.parametrize("linked", ["sheaths", "sheaths/sheath-hard"])
def test_a_folder_that_is_a_link_is_not_written_through(linked, tmp_path):
    elsewhere, output = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    (output / linked).parent.mkdir(parents=True)
    (output / linked).symlink_to(elsewhere)
    with pytest.raises(PipelineError, match="no link on the way"):
        order_parts(STIMULI / "sheaths.toml", output, only="sheath-hard")
    assert list(elsewhere.iterdir()) == []
    assert main(["workshop", str(STIMULI / "sheaths.toml"), "-o", str(output)]) == 2


@pytest.mark.long
def test_the_table_of_routes_has_a_line_for_each_with_its_note(tmp_path):
    orders = order_parts(STIMULI / "paper-ten.toml", tmp_path, only="step-010")
    lines = tabulate_routes([*orders, PartOrder("a/tip", (), ())])
    assert {line["part"] for line in lines} == {"paper-ten/step-010"}
    assert len(lines) == len(load_processes()) - 1 + len(GRADES)
    assert sum("grind, then lap both faces" in line["note"] for line in lines) == 1
    assert sum("wring 1.000 mm and 1.010 mm side by side" in line["note"] for line in lines) == len(
        GRADES
    )


def test_the_sheet_and_the_drawing_number_alike(orders):
    folder, _ = orders
    part = folder / "probe-tips" / "tip-125"
    with (part / "tip-125.inspection-sheet.csv").open() as file:
        rows = {int(row["number"]): row for row in csv.DictReader(file)}
    dimensions = drawn_dimensions(part / "tip-125.drawing.dxf")
    assert dimensions
    for one in dimensions:
        assert float(rows[one.number]["nominal_mm_or_deg"]) == pytest.approx(
            one.value * 1e3, abs=1e-6
        )


def test_a_kind_without_views_of_its_own_is_drawn_by_the_nearest_of_its_line_and_else_said_in_words(
    tmp_path, monkeypatch
):
    import ezdxf

    class LongTip(StraightTip):
        stanza: ClassVar[str] = "long_tip"

    (tip,) = [one for one in load_shipped("probe-tips").stimuli if one.id == "tip-125"]
    other = LongTip.model_construct(**dict(tip))
    (path,) = write_drawing(tmp_path, other, ["dxf"])
    assert {one.key for one in drawn_dimensions(path)} == {"shank_diameter", "length"}
    monkeypatch.setattr(drawing, "VIEWS", {})
    (path,) = write_drawing(tmp_path, other, ["dxf"])
    assert drawn_dimensions(path) == []
    said = [entity.dxf.text for entity in ezdxf.readfile(path).modelspace().query("TEXT")]
    for number, one in enumerate(other.characteristics(), start=1):
        assert any(text.startswith(f"{number}  {one.label}: ") for text in said), one.label
    assert all(issubclass(kind, Part) for kind in VIEWS)


@pytest.mark.parametrize("grade", GRADES)
def test_the_step_of_a_pair_is_never_worse_than_its_parts_allow(grade):
    # ISO 3650: twice the limit deviation and twice half the variation; a film of 0.02 um under
    # either block
    limits = GRADES[grade]
    pair = require_gauge_pair(50e-6, grade)
    assert pair.worst == pytest.approx(2.0 * limits.deviation + limits.variation + 0.04e-6)
    assert pair.expected <= pair.worst
