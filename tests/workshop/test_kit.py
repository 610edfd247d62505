"""What a workshop gets of the apparatus: everything that is made has its files, everything that is
bought is listed, and the whole is read back."""

import csv
import math
import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import ezdxf
import pytest

from oracles.complete import find_missing
from stepblocks.artefacts.step.check_step import check_step
from stepblocks.bench.calibration import Calibration
from stepblocks.cad import kernel
from stepblocks.cli import main
from stepblocks.declaration.read import load_set
from stepblocks.errors import MachiningError
from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.flexure import compute_flexure_figures
from stepblocks.parts.apparatus.layout import list_assembly_stages, list_components
from stepblocks.parts.apparatus.loads import compute_normal_load, compute_pulling_load
from stepblocks.parts.apparatus.solids import make_box_mm
from stepblocks.parts.kinds.kit_part import KitPart
from stepblocks.workshop import kit as kit_module
from stepblocks.workshop.kit import find_complete_kits, write_kit_assembly_files
from stepblocks.workshop.kit_setup import Side, write_kit_setup_sheet_and_stock
from stepblocks.workshop.run import order_parts

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "stimuli" / "apparatus.toml"
SET = load_set(FILE)
PARTS = {part.id: part for part in SET.stimuli}
KIT = SET.stimuli[0].kit
COMPONENTS = list_components(KIT)


def read_table(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("kit")
    write_kit_assembly_files(place, KIT, SET.order)
    return place


def test_the_assembly_holds_every_component_of_its_material_where_it_stands(folder):
    path = folder / "drag-rig.assembly.step"
    report = check_step(path, require_ap242=True)
    assert report.findings == ()
    assert set(report.materials) == {part.material.order_text for part in COMPONENTS}
    bodies = kernel.read_step_solids(path)
    assert len(bodies) == len(COMPONENTS)
    read = sorted(kernel.compute_volume(body) for body in bodies)
    closed_form = sorted(component.volume for component in COMPONENTS)
    assert read == pytest.approx(closed_form, rel=1e-9)
    box = bodies[0].BoundingBox()
    assert (box.xmin, box.zmax) == pytest.approx((-130.0, -30.0), abs=1e-5)  # the base


def test_the_parts_list_has_every_component_once_made_or_bought(folder):
    rows = read_table(folder / "drag-rig.parts.csv")
    assert {row["source"] for row in rows} == {"made", "bought"}
    items = [int(item) for row in rows for item in row["items"].split()]
    assert set(items) == set(range(1, len(COMPONENTS) + 1))
    made = [row["part"] for row in rows if row["source"] == "made"]
    assert made == [part.name for part in COMPONENTS if part.is_made] == list(PARTS)
    bought = {row["what"]: int(row["count"]) for row in rows if row["source"] == "bought"}
    assert bought["ball bearing 623, 3 x 10 x 4 (ISO 15)"] == 2
    assert bought["semiconductor strain gauge 350 ohm, 3 mm"] == 4
    weights = [what for what in bought if what.startswith("weight")]
    assert len(weights) == len(KIT.normal_weights) + len(KIT.pulling_weights)


def test_there_is_a_screw_for_every_thread(folder):
    threads = [bore.thread for part in COMPONENTS for bore in part.bores if bore.thread]
    # a thread through a jaw takes a screw from either side
    threads += ["M4"] * 4
    screws = {}
    for row in read_table(folder / "drag-rig.parts.csv"):
        found = re.match(r"screw ISO 4762 (M[\d.]+) ", row["what"])
        if found:
            screws[found[1]] = screws.get(found[1], 0) + int(row["count"])
    # both ends of the flexure, the block and the hook: M3
    assert screws == {thread: threads.count(thread) for thread in set(threads)}


def test_the_table_of_loads_is_the_budget_line_by_line(folder):
    rows = read_table(folder / "drag-rig.loads.csv")
    assert len(rows) == len(KIT.normal_weights) + len(KIT.pulling_weights)
    for row in rows:
        compute = compute_normal_load if row["axis"] == "normal" else compute_pulling_load
        load = compute(KIT, 1e-3 * float(row["weight_g"]))
        assert float(row["force_n"]) == pytest.approx(load.force, rel=1e-9)
        lines = ("mass", "gravity", "arm", "balance", "pivot", "pulley", "carriage")
        stds = [float(row[f"{line}_std_n"] or 0.0) for line in lines]
        assert math.hypot(*stds) == pytest.approx(float(row["std_n"]), rel=1e-9)


def test_the_lines_for_a_session_are_what_a_session_reads(folder):
    text = (folder / "drag-rig.session.toml").read_text(encoding="utf-8")
    calibration = Calibration.model_validate(tomllib.loads(text)["calibration"])
    value, std = calibration.list_known_constants()["load_bias_n"]
    heaviest = compute_normal_load(KIT, max(KIT.normal_weights))
    assert value == 0.0
    assert std == pytest.approx(heaviest.common_std, rel=0.05)  # two digits
    (row, *_) = read_table(folder / "drag-rig.flexure.csv")
    figures = compute_flexure_figures(KIT, KIT.normal_weights[0])
    assert float(row["frequency_hz"]) == pytest.approx(figures.frequency, rel=1e-9)


def test_a_picture_of_each_stage_shows_the_numbers_of_what_it_adds(folder):
    first = 1
    for number, stage in enumerate(list_assembly_stages(KIT), start=1):
        root = ElementTree.parse(folder / f"drag-rig.stage-{number}.svg").getroot()
        comments = (folder / f"drag-rig.stage-{number}.svg").read_text(encoding="utf-8")
        assert root.tag.endswith("svg")
        for item in range(first, first + len(stage.components)):
            assert f"<!-- {item} -->" in comments
        first += len(stage.components)


def test_the_assembly_drawing_lists_every_item(folder):
    text = (folder / "drag-rig.assembly.svg").read_text(encoding="utf-8")
    for said in ("DRAG-RIG", "front 1:2", "top 1:2", "left 1:2", *map(str, range(1, 33))):
        assert f">{said}</text>" in text, said
    assert all(f">{part.title}</text>" in text for part in COMPONENTS)
    # a number of EN 10027-2 is no decimal fraction
    assert ">X5CrNi18-10 (1.4301)</text>" in text
    assert "1,4301" not in text


def test_a_fit_in_a_bore_is_measured_by_what_goes_into_it():
    (arm,) = (part for part in SET.stimuli if part.id == "arm")
    for size in arm.characteristics():
        if size.kind == "diameter" and size.lower == 0.0:
            assert size.method == "pin gauges", size.label


def test_a_kit_whose_parts_are_in_each_others_way_is_refused_before_anything_is_written(
    tmp_path, monkeypatch
):
    post = Component("post", "Post", "steel", boxes=(make_box_mm((31, -1, -20), (33, 1, 5)),))
    hook = next(part for part in COMPONENTS if part.name == "hook")
    monkeypatch.setattr(kit_module, "list_components", lambda kit: [hook, post])
    with pytest.raises(MachiningError, match=r"room over the whole travel: hook and post share"):
        write_kit_assembly_files(tmp_path, KIT, SET.order)
    assert list(tmp_path.iterdir()) == []


def test_a_kit_is_ordered_as_a_whole_where_all_its_parts_are_meant():
    assert find_complete_kits(SET.stimuli) == [KIT]
    assert find_complete_kits(SET.stimuli[1:]) == []


@pytest.mark.parametrize("name", ["carriage", "flexure", "weight-hanger"])
def test_every_bore_is_made_in_one_setup_and_the_stock_holds_the_part(name, tmp_path):
    part = PARTS[name]
    page, stock = write_kit_setup_sheet_and_stock(tmp_path, part)
    text = page.read_text(encoding="utf-8")
    for number in range(1, len(part.placed_component.bores) + 1):
        assert len(re.findall(rf"\bB{number}: ", text)) == 1
    assert check_step(stock, require_ap242=True).passes
    (body,) = kernel.read_step_solids(stock)
    (solid,) = part.solids()
    inside = kernel.compute_common_volume(solid, body)
    assert inside == pytest.approx(part.volumes()[0], rel=1e-9)


def test_a_blind_bore_is_drilled_from_the_side_that_it_is_open_to():
    shape = PARTS["carriage"].placed_component
    blind = [bore for bore in shape.bores if bore.thread == "M3"]
    for bore in blind:
        assert [side for side in Side if side.gives_access_to(shape, bore)] == [Side.RIGHT]
    through = shape.bores[0]
    assert [side for side in Side if side.gives_access_to(shape, through)] == [
        Side.LEFT,
        Side.RIGHT,
    ]


def test_the_guide_shows_every_stage_and_quotes_the_budget_and_frequencies_of_the_kit():
    page = (ROOT / "docs" / "how-to" / "build-the-apparatus.md").read_text(encoding="utf-8")
    assert FILE.relative_to(ROOT).as_posix() in page
    first = 1
    for number, stage in enumerate(list_assembly_stages(KIT), start=1):
        name = f"drag-rig.stage-{number}.svg"
        assert f"](../images/{name})" in page
        picture = (ROOT / "docs" / "images" / name).read_text(encoding="utf-8")
        for item in range(first, first + len(stage.components)):
            assert f"<!-- {item} -->" in picture
        first += len(stage.components)
    load = compute_normal_load(KIT, 0.05)
    for line in load.budget:
        assert f"{line.std * 1e3:.2f} mN" in page, line.source
    assert f"{load.std * 1e3:.2f} mN of 490 mN" in page
    for mass in (0.11, 0.03):
        assert f"{compute_flexure_figures(KIT, mass).frequency:.0f} Hz" in page


@pytest.mark.repeats
@pytest.mark.parametrize("name", ["balance-rod", "hook"])
def test_a_part_of_the_kit_is_complete_on_paper_in_step_and_on_its_sheet(name, tmp_path):
    order, _ = order_parts(SET.with_parts([PARTS[name]]), tmp_path)  # and its quotation
    folder = tmp_path / "apparatus" / name
    endings = {path.name.removeprefix(f"{name}.") for path in folder.iterdir()}
    assert endings == {
        *("drawing.dxf", "drawing.svg", "drawing.pdf", "plan.qif", "setup.html", "stock.step"),
        *("inspection-sheet.csv", "inspection-sheet.html"),
    }
    assert len(order.files) == len(endings)
    drawing, sheet = folder / f"{name}.drawing.dxf", folder / f"{name}.inspection-sheet.csv"
    assert find_missing(PARTS[name], drawing, None, sheet) == []
    # the letter beside a rod or bore is explained
    shown = {text.dxf.text for text in ezdxf.readfile(drawing).modelspace().query("TEXT")}
    for label in shown & {"B1", "R1"}:
        assert any(text.startswith(f"{label} stands at ") for text in shown)


def test_no_tip_is_dragged_over_the_apparatus_and_the_message_says_so(tmp_path, capsys):
    for words in (
        ["predict", str(FILE)],
        ["export", str(FILE), "--for", "x3d", "-o", str(tmp_path / "x")],
        ["feel", str(FILE), "--no-open", "-o", str(tmp_path / "x.html")],
        ["drag", f"{FILE}/base"],
    ):
        assert main(words) == 2, words
        assert re.search("felt", capsys.readouterr().err), words
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_the_commands_build_check_and_draw_the_whole_kit(tmp_path):
    place = ["-o", str(tmp_path)]
    assert main(["build", str(FILE), *place]) == 0
    assert main(["check", str(FILE), *place]) == 0
    assert main(["workshop", str(FILE), *place]) == 0
    for part in SET.stimuli:
        assert isinstance(part, KitPart)
        assert (tmp_path / "apparatus" / part.id / f"{part.id}.setup.html").is_file()
    assert (tmp_path / "apparatus" / "drag-rig.assembly.step").is_file()
