"""Pairs of gauge blocks give the step, their stack-up is that of ISO 3650, and the assembly file
conforms."""

from pathlib import Path

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.artefacts.step.check_step import check_step
from stepblocks.artefacts.step.gauge_assembly import write_gauge_assembly
from stepblocks.cad import kernel
from stepblocks.cli import main
from stepblocks.errors import MachiningError
from stepblocks.parts.gauge_pair import (
    GRADES,
    STANDARD_SET,
    make_gauge_base,
    require_gauge_pair,
)
from stepblocks.workshop.setup import write_setup_sheet_and_stock

STIMULI = Path(__file__).parents[2] / "stimuli"
BLOCK = load_shipped("paper-ten").step_block[4]


def test_the_set_is_that_of_112_pieces_up_to_10_mm():
    # makers' lists: 1 of 1.0005, 9 of 1.001-1.009, 49 of 1.01-1.49, 49 of 0.5-24.5 (20 of them up
    # to 10), 4 of 25-100
    assert len(STANDARD_SET) == len(set(STANDARD_SET)) == 1 + 9 + 49 + 20


@pytest.mark.parametrize("um", [0.5, 1, 5, 10, 25, 30, 50, 75, 100, 480])
def test_the_difference_of_the_pair_is_the_step(um):
    pair = require_gauge_pair(um * 1e-6)
    assert pair.upper - pair.lower == pytest.approx(um * 1e-6, abs=1e-12)
    assert pair.lower >= 1e-3


def test_what_no_pair_gives_is_refused():
    with pytest.raises(MachiningError, match="difference of two gauge blocks"):
        require_gauge_pair(10.2e-6)
    with pytest.raises(MachiningError, match="grade must be"):
        require_gauge_pair(10e-6, "5")


@pytest.mark.parametrize("grade", GRADES)
def test_the_stack_up_holds_every_pair_and_95_percent_lie_within_the_expected(grade):
    random = np.random.default_rng(1)
    pair = require_gauge_pair(50e-6, grade)
    deviation, variation = GRADES[grade].deviation, GRADES[grade].variation
    error = sum(
        random.uniform(-limit, limit, 100_000)
        for limit in [deviation] * 2 + [0.5 * variation] * 2 + [0.02e-6] * 2
    )
    assert np.abs(error).max() <= pair.worst
    assert np.mean(np.abs(error) <= pair.expected) == pytest.approx(0.95, abs=0.025)


def test_the_assembly_file_conforms_and_its_step_is_the_height(tmp_path):
    path = tmp_path / "a.step"
    pair = require_gauge_pair(BLOCK.height.nominal)
    write_gauge_assembly(path, BLOCK, pair)
    report = check_step(path, require_ap242=True)
    assert report.passes
    assert [one.value for one in report.dimensions] == pytest.approx(
        [pair.lower, pair.upper, BLOCK.height.nominal], abs=1e-12
    )
    # the step between faces of two bodies too
    assert all(abs(one.deviation) < 1e-9 for one in report.dimensions)
    assert path.read_text().count("NEXT_ASSEMBLY_USAGE_OCCURRENCE") == 3
    tops = [
        max(face.high[2] for face in kernel.list_faces(body))
        for body in kernel.read_step_solids(path)
    ]
    assert tops[2] - tops[1] == pytest.approx(BLOCK.height.nominal, abs=1e-9)


def test_the_setup_sheet_states_the_parts_of_the_assembly_and_its_base(tmp_path):
    pair = require_gauge_pair(BLOCK.height.nominal)
    page, _ = write_setup_sheet_and_stock(tmp_path, BLOCK, (), pair)
    text = " ".join(page.read_text().split())  # as it is read
    # base and lower gauge block are together as thick as the body that is asked for
    base = make_gauge_base(BLOCK, pair)
    assert base.thickness.nominal + pair.lower == pytest.approx(8e-3)
    assert base.mounting == BLOCK.body.mounting
    assert f"x {base.thickness.nominal * 1e3:.7g} mm" in text
    for length in (pair.lower, pair.upper):
        assert f"{length * 1e3:.4f} mm, 30 x 9 mm" in text
    assert f"at worst ±{pair.worst * 1e6:.2f} µm" in text
    assert "two gauge blocks" not in write_setup_sheet_and_stock(tmp_path, BLOCK)[0].read_text()


def test_a_base_that_the_stock_has_no_room_for_is_said_on_the_setup_sheet(tmp_path):
    # two gauge blocks of 9 mm by 30 mm with 5 mm round them: 28 mm by 40 mm
    pair = require_gauge_pair(BLOCK.height.nominal)
    for stock, said in (((27e-3, 45e-3, 12e-3), True), ((30e-3, 45e-3, 12e-3), False)):
        block = BLOCK.model_copy(update={"stock": stock})
        text = " ".join(
            write_setup_sheet_and_stock(tmp_path, block, (), pair)[0].read_text().split()
        )
        assert ("needs a larger stock than the block in one piece" in text) is said


@pytest.mark.long
def test_the_workshop_command_writes_everything_and_prints_the_routes(tmp_path, capsys):
    arguments = [
        "workshop",
        str(STIMULI / "paper-ten.toml"),
        "--only",
        "step-050",
        "-o",
        str(tmp_path),
    ]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "gauge blocks, grade 0" in text
    assert "no gauge-block drawing" in text  # of gauge-block steel alone
    names = {path.name for path in (tmp_path / "paper-ten" / "step-050").iterdir()}
    assert {
        f"step-050.{end}"
        for end in (
            "drawing.dxf",
            "drawing.svg",
            "drawing.pdf",
            "plan.qif",
            "gauge.step",
            "inspection-sheet.csv",
            "inspection-sheet.html",
            "routes.csv",
            "setup.html",
            "stock.step",
        )
    } == names
    assert main([*arguments[:-2], "-o", str(tmp_path), "--only", "nothing"]) == 2


@pytest.mark.long
def test_what_is_said_of_several_parts_stands_once_and_counts_them(capsys, tmp_path):
    two = tmp_path / "two.toml"
    two.write_text(
        '[[step_block]]\nid = "step-{height_um:03}"\nheight = { values = ["20 um", "50 um"] }\n'
    )
    assert main(["workshop", str(two), "-o", str(tmp_path / "out")]) == 0
    text = capsys.readouterr().out
    assert text.count("no gauge-block drawing") == 1
    assert "two/step-020 and 1 more: no gauge-block drawing" in text
