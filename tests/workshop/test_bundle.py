"""An order is one thing: a parts list, and an archive whose bytes are those of its papers alone."""

import csv
import zipfile
from pathlib import Path

import pytest

from stepblocks.cli import main
from stepblocks.declaration.read import load_set
from stepblocks.errors import StepblocksError
from stepblocks.workshop.run import order_parts

ORDER = """
[order]
revision = "C"
quantity = 2
quantities = { tip-b = 5 }

[[straight_tip]]
id = "tip-a"
ball_radius = "125 um"

[[straight_tip]]
id = "tip-b"
ball_radius = "60 um"
"""


def write_order(folder, name):
    (folder / "own.toml").write_text(ORDER)
    order_parts(folder / "own.toml", folder / name)
    return folder / name / "own"


def test_the_parts_list_numbers_counts_and_revises_each_part(tmp_path):
    papers = write_order(tmp_path, "out")
    with (papers / "own.parts-list.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["part_number"], row["drawing_number"], row["quantity"]) for row in rows] == [
        ("TIP-A", "OWN-TIP-A", "2"),
        ("TIP-B", "OWN-TIP-B", "5"),
    ]
    assert {row["revision"] for row in rows} == {"C"}
    assert all("no STEP file yet" in row["note"] for row in rows)  # nothing was built


@pytest.mark.long
def test_the_archive_holds_drawings_sheets_and_solids_and_is_the_same_bytes_again(tmp_path):
    first = write_order(tmp_path, "one") / "own.quotation.zip"
    with zipfile.ZipFile(first) as archive:
        names = archive.namelist()
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert "own.parts-list.csv" in names
    for part in ("tip-a", "tip-b"):
        assert f"{part}/{part}.drawing.pdf" in names
        assert f"{part}/{part}.inspection-sheet.csv" in names
    (first.parent / "tip-a" / "tip-a.step").write_text("ISO-10303-21;")
    order_parts(tmp_path / "own.toml", tmp_path / "one")
    with zipfile.ZipFile(first) as archive:
        assert "tip-a/tip-a.step" in archive.namelist()
    (first.parent / "tip-a" / "tip-a.step").unlink()
    order_parts(tmp_path / "own.toml", tmp_path / "one")
    second = write_order(tmp_path, "two") / "own.quotation.zip"
    assert first.read_bytes() == second.read_bytes()


def test_a_quantity_is_of_a_part_of_the_set(tmp_path):
    path = Path(tmp_path) / "own.toml"
    path.write_text(ORDER.replace("tip-b = 5", "tip-c = 5"))
    with pytest.raises(StepblocksError, match=r"order\.quantities must name parts .* 'tip-c'"):
        load_set(path)


@pytest.mark.long
def test_the_page_of_a_build_shows_drawings_whichever_was_run_first(tmp_path):
    (tmp_path / "own.toml").write_text(ORDER)
    arguments = [str(tmp_path / "own.toml"), "-o", str(tmp_path / "out")]
    assert main(["build", *arguments]) == 0
    page = tmp_path / "out" / "index.html"
    assert "tip-a.drawing.pdf" not in page.read_text(encoding="utf-8")
    assert main(["workshop", *arguments]) == 0
    assert "tip-a.drawing.pdf" in page.read_text(encoding="utf-8")
    assert "own.quotation.zip" in page.read_text(encoding="utf-8")
