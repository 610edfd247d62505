"""A design as files: what each may tell, and that nobody's work is overwritten."""

import csv
import io

import pytest

from oracles.designs import compared, crossed
from stepblocks.errors import PipelineError
from stepblocks.study.design.blocks import Item
from stepblocks.study.design.sheet import (
    format_code_key_csv,
    list_sheet_columns,
    make_blinded_row,
    write_without_replacing,
)
from stepblocks.study.design.trials import DESIGN_COLUMNS
from stepblocks.study.experiments.registry import EXPERIMENTS

BLOCKS = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in (10, 25, 50)]
BY_CODE = {"VTK": BLOCKS[2], "ABE": BLOCKS[0]}


def test_every_trial_is_a_row_that_tells_all():
    design = crossed("estimates", 2, BLOCKS, 2, 1, ("bare", "soft"))
    assert len(design.trials) == 2 * 2 * 3 * 2
    for row in design.trials:
        practised = "practice_code", "practice_standard_code"
        assert tuple(row) == (*DESIGN_COLUMNS, "factor_probe", *practised)
        item = design.blocks[row["participant"]][row["code"]]
        assert (row["stimulus"], row["engraved"]) == (item.identity, item.engraved)
        assert float(row["height_um"]) == pytest.approx(item.height * 1e6, rel=1e-8)
        assert row["standard"] == row["standard_code"] == row["standard_height_um"] == ""


def test_in_a_pair_the_standard_is_named_and_the_sheet_keeps_its_place():
    rows = compared(1, BLOCKS, 1, 1, "step-025").trials
    assert {row["standard"] for row in rows} == {"step-025"}
    for row, shown in zip(rows, map(make_blinded_row, rows), strict=True):
        places = {"standard-first": "first_code", "standard-second": "second_code"}
        assert shown[places[row["condition"]]] == row["standard_code"]
        assert {shown["first_code"], shown["second_code"]} == {row["code"], row["standard_code"]}


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_what_is_to_be_written_down_stands_at_the_end_of_a_sheet(experiment):
    columns = list_sheet_columns(experiment)
    assert columns[:2] == ("participant", "trial")
    assert columns[-len(EXPERIMENTS[experiment].answers) :] == EXPERIMENTS[experiment].answers
    assert not {"stimulus", "engraved", "height_um"} & set(columns)


def test_the_key_is_in_the_order_of_its_codes():
    assert list(csv.reader(io.StringIO(format_code_key_csv({"1": BY_CODE})))) == [
        ["participant", "code", "engraved", "stimulus", "height_um"],
        ["1", "ABE", "STEP-010", "step-010", "10"],
        ["1", "VTK", "STEP-050", "step-050", "50"],
    ]


def test_the_key_of_a_comparison_names_the_standard_too():
    key = format_code_key_csv(compared(1, BLOCKS, 1, 1, "step-025").blocks)
    assert {row["stimulus"] for row in csv.DictReader(io.StringIO(key))} == {
        b.identity for b in BLOCKS
    }


def test_a_file_that_somebody_changed_stays_and_nothing_beside_it_is_written(tmp_path):
    write_without_replacing(tmp_path / "new", {"one.csv": "1\n", "two.html": "\u00fc\n"})
    assert (tmp_path / "new" / "two.html").read_bytes() == "\u00fc\n".encode()
    write_without_replacing(tmp_path / "new", {"one.csv": "1\n"})  # the same content is no conflict
    with pytest.raises(PipelineError, match=r"one\.csv has another content already; move it away"):
        write_without_replacing(tmp_path / "new", {"three.csv": "3\n", "one.csv": "changed\n"})
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["one.csv", "two.html"]
    assert (tmp_path / "new" / "one.csv").read_text() == "1\n"
