"""The record of an inspection goes into predictions, drags and the loop."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from oracles.softgauge import correlated_noise, flank_gauge, write_edge_scan
from stepblocks.cli import main
from stepblocks.contact.counterface import Profile as SurfaceProfile
from stepblocks.drag.run import drag_over
from stepblocks.errors import MetrologyError
from stepblocks.records.as_built import AsBuilt, AsBuiltValue, read_as_built, write_as_built

STIMULI = str(Path(__file__).parents[2] / "stimuli")
KNOWN = ["--calibration", "0.1%", "--lateral-calibration", "0.1%"]
OPTICAL = [*KNOWN, "--stylus-radius", "0 um", "--stylus-cone", "0 deg"]


def inspect(*arguments):
    return main(["inspect", *arguments, "--set", STIMULI])


@pytest.mark.long
def test_prediction_takes_the_record_and_says_how_far_the_energy_moved(tmp_path, capsys):
    path = write_edge_scan(tmp_path / "a.csv", 50.0e-6, 14e-6)
    inspect(path, "--stimulus", "step-050", *OPTICAL, "-o", str(tmp_path / "out"))
    capsys.readouterr()
    table = tmp_path / "predictions.csv"
    source = f"{STIMULI}/paper-ten.toml"
    assert main(["predict", source, "--as-built", str(tmp_path / "out"), "-o", str(table)]) == 0
    said = capsys.readouterr().err
    # equations (1) and (2) by hand at mu = 0.15: tan^2(acos(1 - 50/139) + atan 0.15) / tan^2(acos(1
    # - 50/125) + ...) - 1
    ratio = (
        np.tan(np.arccos(1 - 50 / 139) + np.arctan(0.15))
        / np.tan(np.arccos(1 - 50 / 125) + np.arctan(0.15))
    ) ** 2
    largest = float(said.split(" % to ")[1].split(" %")[0])
    assert largest == pytest.approx((ratio - 1.0) * 100.0, abs=0.5)
    assert "edge_radius does not conform" in said
    rows = [line.split(",") for line in table.read_text().splitlines()]
    assert {row[4] for row in rows if row[1] == "step-050"} != {"50"}
    assert {row[4] for row in rows if row[1] == "step-060"} == {"60"}
    # of an arc height and radius say all: the surface itself is not written
    assert "surface itself" not in said
    assert main(["predict", source, "--as-built", str(tmp_path / "a.csv")]) == 2
    empty = tmp_path / "empty"
    empty.mkdir()
    assert main(["predict", source, "--as-built", str(empty)]) == 2


def test_a_record_whose_surface_was_changed_or_lost_is_refused(tmp_path, capsys):
    x = np.arange(-400, 400) * 1e-6
    z = flank_gauge(x, 50e-6, np.radians(40.0), 2e-6)
    z += correlated_noise(len(x), 1e-6, 5e-9, 20e-9, 2e-6, np.random.default_rng(3))
    path, out = str(tmp_path / "a.csv"), str(tmp_path / "out")
    columns = np.stack([x, z], axis=1) * 1e6
    np.savetxt(path, columns, delimiter=",", header="x_um,z_um", comments="", fmt="%.4f")
    inspect(path, "--stimulus", "step-050", *OPTICAL, "-o", out)
    record, surface = (
        tmp_path / "out" / f"step-050.as-built.{end}" for end in ("toml", "profile.csv")
    )
    text = record.read_text()
    reach = read_as_built(record).surface.position
    # level beyond what was scanned, to within one sampling interval (a range leaves out its end)
    assert (reach[0], reach[-1]) == pytest.approx((-0.5e-3, 0.5e-3), abs=1.001e-6)
    for damage, rule in (
        (
            lambda: surface.write_text(
                surface.read_text().replace("x_um,z_um\n", "x_um,z_um\n-501.0,0.0\n")
            ),
            "the one that was inspected",
        ),
        (lambda: surface.unlink(), "must lie beside the record"),
        (
            lambda: record.write_text(text.replace('profile = "', 'profile = "../')),
            "name of a file beside the record",
        ),
    ):
        damage()
        with pytest.raises(MetrologyError, match=rule):
            read_as_built(record)


def test_an_edge_that_is_no_arc_is_predicted_and_dragged_by_its_surface(tmp_path, capsys):
    # a flank of 45 deg with a corner of 12 um, tangent to both: a ball of 125 um that comes from
    # the lower face rolls up the flank itself, so the steepest slope of its centre's path is that
    # of the flank
    x = np.arange(-400, 400) * 1e-6
    z = flank_gauge(x, 50e-6, np.radians(45.0), 12e-6)
    z = z + correlated_noise(len(x), 1e-6, 1e-9, 1e-9, 2e-6, np.random.default_rng(3))
    path = tmp_path / "flank.csv"
    np.savetxt(
        path,
        np.stack([x, z], axis=1) * 1e6,
        delimiter=",",
        header="x_um,z_um",
        comments="",
        fmt="%.5f",
    )
    assert inspect(str(path), "--stimulus", "step-050", *OPTICAL, "-o", str(tmp_path / "out")) == 1
    assert "the edge is no arc; by the scanned surface itself" in capsys.readouterr().out
    record = read_as_built(tmp_path / "out" / "step-050.as-built.toml")
    assert not record.arc
    table = tmp_path / "predictions.csv"
    source = f"{STIMULI}/paper-ten.toml"
    assert main(["predict", source, "--as-built", str(tmp_path / "out"), "-o", str(table)]) == 0
    rows = pd.read_csv(table).query("stimulus == 'step-050'")
    np.testing.assert_allclose(rows["surface_critical_angle_deg"], 45.0, atol=1.0)
    # the tip dragged over the scanned surface pulls as hard as equation (1) says for that slope: F
    # = N tan(a + atan mu)
    surface = SurfaceProfile(record.surface.position, record.surface.height)
    dragged = drag_over(surface, tip_radius=125e-6, load=1.0, friction=0.15)
    expected = 1.0 * np.tan(np.radians(45.0) + np.arctan(0.15))
    assert dragged.summary["peak_force_n"] == pytest.approx(expected, rel=0.04)


@pytest.mark.long
def test_the_loop_takes_records_instead_of_scans_and_names_every_scan_that_it_cannot_use(
    shared, tmp_path, capsys
):
    session = tmp_path / "quiet"
    for path in sorted((shared / "bench" / "quiet").rglob("*")):
        if path.is_file():
            copy = session / path.relative_to(shared / "bench" / "quiet")
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    (session / "traces" / "0003.csv").unlink()
    (session / "scans" / "step-060.csv").write_text("x_um,z_um\n0,0\n")
    (session / "scans" / "step-070.csv").unlink()
    (session / "scans" / "step-080.csv").rename(tmp_path / "elsewhere.csv")
    (session / "scans" / "step-080.csv").symlink_to(tmp_path / "elsewhere.csv")
    for height in range(10, 60, 10):
        values = {
            "step_height": AsBuiltValue(height * 1e-6, 1e-6, "not-proven"),
            "edge_radius": AsBuiltValue(14e-6, 0.3e-6, "does-not-conform"),
        }
        record = AsBuilt(f"step-{height:03}", "scan.csv", "0" * 64, "two planes", values)
        write_as_built(tmp_path / f"step-{height:03}.as-built.toml", record)
    assert (
        main(
            [
                "loop",
                str(session),
                "-o",
                str(tmp_path / "out"),
                "-j",
                "1",
                "--as-built",
                str(tmp_path),
            ]
        )
        == 0
    )
    said = capsys.readouterr()
    told = [line for line in said.err.splitlines() if line.startswith("scan of")]
    assert "values or trials excluded, each with its reason in the report: 1\n" in said.out
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    # the records say 14 um where the blocks of this session are sharp; the forces contradict them
    assert result["scans"]["mean_edge_radius_m"] == pytest.approx(14e-6)
    assert result["nominal"]["error"]["ln_energy_rms"] < 0.1
    assert [line.split(":")[0] for line in told] == [
        f"scan of step-{height:03} left out" for height in (60, 70, 80)
    ]
    reasons = {one["block"]: one["reason"] for one in result["scans"]["left_out"]}
    assert "must" in reasons["step-060"]
    assert reasons["step-070"] == "no file scans/step-070.csv"
    assert reasons["step-080"] == "scans/step-080.csv leads out of the session"
    assert "leads out of the session" in (tmp_path / "out" / "report.html").read_text()
