"""Ten blocks of an own order, from TOML to drawings, STEP files, sheets, reports and certificates.

What is expected comes from the order itself: papers are read back by other libraries than wrote
them (`oracles.complete`), the profile is a soft gauge of known height.
"""

import csv
import json

import ezdxf
import numpy as np
import pytest

from oracles.complete import find_missing
from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.cli import main
from stepblocks.declaration.read import load_set
from stepblocks.parts.shapes import build_solids

ORDER = """
title = "Ten blocks of our own"

[order]
author = "A. Maker"
approved_by = "C. Head"
owner = "Institute of Haptics"
date = "2026-11-23"
revision = "B"
quantity = 2

[defaults.step_block]
material = "440C, hardened and tempered, 58 HRC"
stock = ["25 mm", "30 mm", "10 mm"]

[[step_block]]
id = "own-{height_um:03}"
height = { from = "15 um", to = "105 um", step = "10 um" }
"""
LAB = """
name = "Metrology room"
address = "Example street 1, Town"
country = "DE"
signer = "A. Signer"
temperature = "20.1 degC"
temperature_spread = "0.3 K"
measured_from = "2026-11-20"
measured_to = "2026-11-21"
certificate = "C-2026-017"

[instrument]
name = "Profilometer"
serial = "P-42"
certificate = "K-1234"
calibrated = "2026-05-01"
calibration = "0.1 %"
lateral_calibration = "0.1 %"
resolution = "1 nm"
stylus_radius = "0.5 um"
stylus_cone = "60 deg"
"""


@pytest.fixture(scope="module")
def ordered(tmp_path_factory):
    """The order, and all papers of the workshop."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "own.toml").write_text(ORDER)
    assert main(["workshop", str(folder / "own.toml"), "-o", str(folder / "out")]) == 0
    return folder


@pytest.mark.long
def test_every_dimension_stands_on_drawing_step_file_and_sheet_of_each_block(ordered):
    declared = load_set(ordered / "own.toml")
    assert len(declared.stimuli) == 10
    for block in declared.stimuli:
        papers = ordered / "out" / "own" / block.id
        step = papers / f"{block.id}.step"
        write_step_ap242(step, block, build_solids(block), declared.order)
        drawing, sheet = papers / f"{block.id}.drawing.dxf", f"{block.id}.inspection-sheet.csv"
        assert find_missing(block, drawing, step, papers / sheet) == []
        said = {one.dxf.text for one in ezdxf.readfile(drawing).modelspace().query("TEXT")}
        owner = {"Institute of Haptics", "A. Maker", "C. Head", "B", "2"}
        assert owner | {"440C, hardened and tempered, 58 HRC", block.id.upper()} <= said
        setup = (papers / f"{block.id}.setup.html").read_text()
        assert "Stock 25.0 x 30.0 x 10.0 mm" in setup
        assert "tapped, before hardening" in setup
    series = ezdxf.readfile(ordered / "out" / "own" / "own.series.dxf").modelspace()
    texts = {one.dxf.text for one in series.query("TEXT")}
    assert {block.id.upper() for block in declared.stimuli} <= texts


@pytest.mark.long
def test_a_block_may_be_named_as_it_is_engraved_and_a_wrong_name_lists_what_there_is(
    ordered, tmp_path, capsys
):
    asked = ["workshop", str(ordered / "own.toml"), "-o", str(tmp_path), "--only"]
    assert main([*asked, "OWN-065"]) == 0
    assert (tmp_path / "own" / "own-065" / "own-065.drawing.pdf").is_file()
    capsys.readouterr()
    assert main([*asked, "own-066"]) == 2
    assert "own/own-015" in capsys.readouterr().err


def fill_in(sheet, target, left_out=()):
    """Fill a sheet in as a workshop would: each value in the middle of its limits."""
    rows = list(csv.DictReader(sheet.read_text(encoding="utf-8").splitlines()))
    for row in rows:
        lower, upper = (float(row[f"{end}_limit_mm_or_deg"] or 0.0) for end in ("lower", "upper"))
        if row["characteristic"] not in left_out:
            row["measured_mm_or_deg"] = f"{0.5 * (lower + upper):.7f}"
            row["std_mm_or_deg"] = f"{(upper - lower) / 40.0:.7f}"
        row |= {"instrument": "as in the method", "inspector": "I. Spector", "date": "2026-11-21"}
    with target.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return len(rows)


def write_scan(path, height, seed):
    """Write a profile across an edge of known height, with the noise of an instrument."""
    random, x = np.random.default_rng(seed), np.arange(-400, 400) * 1e-6
    z = edge_gauge(x, height, 0.0, 5e-4)
    z += correlated_noise(len(x), 1e-6, 5e-9, 10e-9, 2e-6, random)
    rows = np.stack([x, z], axis=1) * 1e6
    np.savetxt(path, rows, "%.5f", ",", header="x_um,z_um", comments="")


@pytest.mark.long
def test_filled_sheets_and_scans_of_ten_blocks_become_a_report_and_a_certificate_for_each(
    ordered, tmp_path
):
    by_scan = ("step height", "edge radius", "burr over the upper face within 0.2 mm of the edge")
    blocks, lines, truth = load_set(ordered / "own.toml").stimuli, [], {}
    for number, block in enumerate(blocks):
        sheet = ordered / "out" / "own" / block.id / f"{block.id}.inspection-sheet.csv"
        serial, count = f"SN-{number + 1:02}", 3 if block.id == "own-065" else 1
        asked = fill_in(sheet, tmp_path / f"{block.id}-sheet.csv", left_out=by_scan)
        truth[serial] = block, asked, block.height.nominal + (number - 4.5) * 5e-8
        names = [f"{block.id}-sheet.csv", *(f"{block.id}-{one}.csv" for one in range(count))]
        for name in names[1:]:
            write_scan(tmp_path / name, truth[serial][2], 100 * number + len(lines))
        lines += [f"{name},{serial},{block.id}" for name in names]
    (tmp_path / "scans.csv").write_text("\n".join(["scan,block,stimulus", *lines, ""]))
    (tmp_path / "lab.toml").write_text(LAB)
    asked = ["inspect", str(tmp_path / "scans.csv"), "--set", str(ordered / "own.toml")]
    code = main([*asked, "--lab", str(tmp_path / "lab.toml"), "-o", str(tmp_path / "inspected")])
    statements = {}
    for serial, (block, count, height) in truth.items():
        papers = tmp_path / "inspected" / serial
        report = json.loads((papers / f"{block.id}.inspection.json").read_text())
        statements[serial] = report["statement"]
        assert report["statement"].startswith(f"{count} of {count} measured, all conform"), serial
        step = {one["key"]: one for one in report["characteristics"]}["step_height"]
        low, high = step["interval_95_m"]
        assert low < height < high
        certificate = (papers / f"{block.id}.dcc.xml").read_text()
        pdf = (papers / f"{block.id}.certificate.pdf").read_bytes()
        for said in (serial, "C-2026-017", "A. Signer", "P-42", "440C, hardened and tempered"):
            assert said in certificate
        assert pdf[:4] == b"%PDF"
        # three scans show how they repeat, one does not
        repeated = "standard uncertainty, repeatability" in certificate
        assert repeated == (block.id == "own-065")
    assert code == 0, statements
