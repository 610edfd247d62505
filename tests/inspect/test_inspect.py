"""An inspection from file to verdict, exit code and as-built record."""

import json
import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from oracles.softgauge import correlated_noise, edge_gauge, flank_gauge, groove_gauge, stylus_trace
from stepblocks.artefacts.as_built import (
    AsBuilt,
    AsBuiltValue,
    list_measured_edges,
    read_as_built,
    read_records,
    write_as_built,
)
from stepblocks.cli import main
from stepblocks.contact.counterface import Profile as SurfaceProfile, find_scanned_angle
from stepblocks.drag.run import drag_over
from stepblocks.errors import MetrologyError

STIMULI = str(__import__("pathlib").Path(__file__).parents[2] / "stimuli")


def scan(path, height, radius=0.0, seed=1):
    x = np.arange(-800, 800) * 0.5e-6
    z = edge_gauge(x, height, radius, tilt=5e-4)
    z = z + correlated_noise(len(x), 0.5e-6, 10e-9, 40e-9, 2e-6, np.random.default_rng(seed))
    np.savetxt(
        path,
        np.stack([x, z], axis=1) * 1e6,
        delimiter=",",
        header="x_um,z_um",
        comments="",
        fmt="%.4f",
    )
    return str(path)


KNOWN = ["--calibration", "0.1%", "--lateral-calibration", "0.1%"]
GROOVE = ["--characteristics", "6,7"]  # depth and width
OPTICAL = [*KNOWN, "--stylus-radius", "0 um", "--stylus-cone", "0 deg"]


def inspect(*arguments):
    return main(["inspect", *arguments, "--set", STIMULI])


@pytest.mark.parametrize(
    ("height", "radius", "calibration", "code", "words"),
    [
        (50.2e-6, 0.0, "0.1 %", 0, "step-050: conforms"),
        (51.5e-6, 0.0, "0.1 %", 1, "step-050: does not conform"),
        (50.2e-6, 14e-6, "0.1 %", 1, "lowers E_v by"),
        (50.9e-6, 0.0, "0.5 %", 3, "step-050: not proven"),
    ],
)
def test_exit_codes_say_the_verdict(height, radius, calibration, code, words, tmp_path, capsys):
    path = scan(tmp_path / "a.csv", height, radius)
    options = [*OPTICAL, "--calibration", calibration, "--characteristics", "1,2"]
    assert inspect(path, "--stimulus", "step-050", *options) == code
    assert words in capsys.readouterr().out


def test_a_profile_is_inspected_without_loading_the_cad_kernel_or_what_draws(tmp_path):
    x = np.arange(-200, 200) * 1e-6
    np.savetxt(
        tmp_path / "scan.csv",
        np.stack([x, edge_gauge(x, 50e-6, 5e-6)], axis=1) * 1e6,
        delimiter=",",
    )
    code = (
        "import sys\nfrom stepblocks.cli import main\ntry:\n    main(sys.argv[1:])\nexcept "
        "SystemExit: pass\n"
    )
    heavy = "{'cadquery', 'OCP', 'vtk', 'ezdxf', 'scipy.stats', 'pandas', 'matplotlib'}"
    words = [sys.executable, "-c", f"{code}print(sorted({heavy} & set(sys.modules)))"]
    words += ["inspect", str(tmp_path / "scan.csv"), "--feature", "edge", "--units", "um"]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    assert told[0] == "scan: measured"
    assert told[-1] == "[]"


@pytest.mark.parametrize(
    ("stimulus", "options", "idle"),
    [
        (
            "step-050",
            ["--level", "line", "--edges", "1"],
            "step height must leave out --level, --edges",
        ),
        ("tip-125", ["--exclusion", "50 um"], "ball radius must leave out --exclusion"),
    ],
)
def test_an_option_that_an_evaluation_does_not_follow_is_refused(
    stimulus, options, idle, tmp_path, capsys
):
    path = scan(tmp_path / "a.csv", 50.2e-6)
    assert inspect(path, "--stimulus", stimulus, *options) == 2
    assert idle in capsys.readouterr().err


def test_the_output_holds_table_plot_json_and_a_record_that_reads_back(tmp_path, capsys):
    path = scan(tmp_path / "a.csv", 50.2e-6, 1e-6)
    out = tmp_path / "out"
    inspect(path, "--stimulus", "step-050", "-o", str(out), "--json")
    data = json.loads(capsys.readouterr().out)
    record = read_as_built(out / "step-050.as-built.toml")
    assert record.stimulus == "step-050"
    assert record.values["step_height"].value == pytest.approx(50.2e-6, abs=0.1e-6)
    assert record.values["step_height"].value == pytest.approx(
        data["characteristics"][0]["value_m"], rel=1e-8
    )
    assert json.loads((out / "step-050.inspection.json").read_text()) == data
    assert (out / "step-050.inspection.svg").read_text().startswith("<?xml")
    before = {one.name: one.read_bytes() for one in out.iterdir()}
    inspect(path, "--stimulus", "step-050", "-o", str(out))
    assert {one.name: one.read_bytes() for one in out.iterdir()} == before


def test_a_groove_is_judged_by_type_a1(tmp_path, capsys):
    x = np.arange(0, 2000) * 1e-6
    z = groove_gauge(x, 30.4e-6, 700e-6, 1300e-6, 10e-6, tilt=1e-3)
    z = z + correlated_noise(len(x), 1e-6, 10e-9, 30e-9, 3e-6, np.random.default_rng(4))
    path = tmp_path / "groove.csv"
    np.savetxt(path, np.stack([x, z], axis=1) * 1e6, delimiter=",", header="x_um,z_um", comments="")
    assert inspect(str(path), "--stimulus", "step-030", "--feature", "groove", *GROOVE, *KNOWN) == 0
    text = capsys.readouterr().out
    assert "groove depth" in text
    assert "ISO 5436-1 type A1" in text


def test_a_map_adds_repeatability_flatness_and_parallelism(tmp_path, capsys):
    random = np.random.default_rng(2)
    x = np.arange(-200, 200) * 2e-6
    rows = []
    for y in np.arange(6) * 50e-6:
        z = (
            edge_gauge(x, 40e-6, 0.0, tilt=1e-4)
            + random.normal(0.0, 20e-9) * (x > 0)
            + random.normal(0.0, 5e-9, len(x))
        )
        rows.append(np.stack([x, np.full_like(x, y), z], axis=1))
    path = tmp_path / "map.csv"
    np.savetxt(
        path,
        np.concatenate(rows) * 1e6,
        delimiter=",",
        header="x_um,y_um,z_um",
        comments="",
        fmt="%.4f",
    )
    assert inspect(str(path), "--stimulus", "step-040", "--calibration", "0.1 %", "--json") == 3
    data = json.loads(capsys.readouterr().out)
    by_key = {one["key"]: one for one in data["characteristics"] + data["others"]}
    assert {"step_height", "edge_radius", "flatness_lower", "flatness_upper", "parallelism"} <= set(
        by_key
    )
    budget = {part["name"]: part["std_m"] for part in by_key["step_height"]["budget"]}
    assert 1e-9 < budget["repeatability"] < 30e-9
    assert by_key["flatness_lower"]["value_m"] < 0.1e-6


def test_a_margin_and_a_tip_are_measured(tmp_path, capsys):
    random = np.random.default_rng(8)
    x = np.arange(-800, 800) * 0.25e-6
    z = np.where((x > 0.0) & (x < 50.1e-6), -80e-6, 0.0) + random.normal(0.0, 20e-9, len(x))
    path = tmp_path / "margin.csv"
    np.savetxt(
        path,
        np.stack([x, z], axis=1) * 1e6,
        delimiter=",",
        header="x_um,z_um",
        comments="",
        fmt="%.4f",
    )
    assert (
        inspect(str(path), "--stimulus", "gap-050-over-020") == 1
    )  # the crown is not overextended by 20 um
    assert "horizontal discrepancy" in capsys.readouterr().out
    grid = np.arange(-50, 51) * 2e-6
    gx, gy = np.meshgrid(grid, grid)
    cap = np.sqrt(np.maximum((125.4e-6) ** 2 - gx**2 - gy**2, 0.0)) + random.normal(
        0.0, 20e-9, gx.shape
    )
    path = tmp_path / "tip.xyz"
    np.savetxt(
        path,
        np.stack([gx.ravel(), gy.ravel(), cap.ravel()], axis=1) * 1e6,
        header="x_um y_um z_um",
        comments="",
    )
    assert inspect(str(path), "--stimulus", "tip-125", "--characteristics", "1", *KNOWN) == 0
    assert "ball radius" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.csv", "--stimulus", "step-050"], "scan must be a file"),
        (["{scan}", "--stimulus", "step-999"], "stimulus must be declared"),
        (["{scan}", "--stimulus", "step-050", "--feature", "ball"], "feature must be"),
        (["{scan}", "--stimulus", "step-050", "--unit", "mm"], "says another"),
        (["{scan}", "--stimulus", "step-050", "--exclusion", "5"], "must be a length"),
        (["{scan}", "--stimulus", "step-050", "--calibration", "much"], "must be a ratio"),
        (["{scan}", "--stimulus", "step-050", "--calibration=-1"], "calibration"),
        (["{scan}", "--stimulus", "tip-125"], "must"),
        (["{scan}", "--stimulus", "crown-shoulder"], "cannot be inspected"),
    ],
)
def test_what_cannot_be_inspected_gives_one_line_and_exit_code_2(
    arguments, words, tmp_path, capsys
):
    path = scan(tmp_path / "a.csv", 50e-6)
    assert inspect(*[one.format(scan=path) for one in arguments]) == 2
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        (b"", [], "scan must not be empty [scan.csv]"),
        (b"1\n2\n3\n" * 50, [], "a table of numbers in two columns or more, got none [scan.csv]"),
        (b"no scan at all\n", [], "a table of numbers in two columns or more, got none [scan.csv]"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0", [], "file must be text, got binary data [scan.csv]"),
        (
            b"x_um,z_um\n1,nan\n2,nan\n3,nan\n",
            [],
            "must hold at least one measured height, got none [scan.csv]",
        ),
        (
            None,
            ["--units", "furlong"],
            "unit must be one of nm, \u00b5m, mm, m, or by axis as x=mm,z=um, got 'furlong'",
        ),
        (
            None,
            ["--units", "um", "--channel", "A"],
            "name of one column, that of the heights, got A for no names [scan.csv]",
        ),
        (
            None,
            ["--units", "um", "--from", "50 um", "--to", "20 um"],
            "from 50 to 20 \u00b5m must hold 3 points, got 0",
        ),
        (
            None,
            ["--units", "um", "-o", "scan.csv"],
            "a folder must stand here, got a file [scan.csv]",
        ),
    ],
)
def test_a_strange_file_is_refused_in_one_line_that_says_what_would_do(
    content, options, words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    whole = "".join(f"{i},{50 * (i > 100) + 0.01 * (i % 3)}\n" for i in range(200)).encode()
    (tmp_path / "scan.csv").write_bytes(whole if content is None else content)
    assert main(["inspect", "scan.csv", "--feature", "edge", *options]) == 2
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.err.count("\n") == 1


def test_a_folder_without_scans_and_a_pipe_are_refused_in_one_line(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    os.mkfifo(tmp_path / "pipe.csv")
    for scan, words in (
        ("empty", "folder must hold scans, got none"),
        ("pipe.csv", "scan must be a file, got"),
    ):
        assert main(["inspect", str(tmp_path / scan)]) == 2
        captured = capsys.readouterr()
        assert words in captured.err
        assert captured.err.count("\n") == 1


def test_records_survive_odd_names_and_refuse_what_they_do_not_know(tmp_path):
    path = tmp_path / "a.toml"
    record = AsBuilt(
        "step-010",
        'my "scan"\\1\n.csv',
        "0" * 64,
        "µm",
        {"step_height": AsBuiltValue(1.00000001e-5, 2e-9, "conforms")},
    )
    write_as_built(path, record)
    back = read_as_built(path)
    assert back.scan == record.scan
    assert back.values["step_height"].value == pytest.approx(1.00000001e-5, rel=1e-9)
    for text, rule in {
        "schema = 2": "schema: input should be 1",
        "not toml": "TOML",
        path.read_text().replace('"10.0000001 um"', '"10"'): "must be a length",
        path.read_text().replace("std = ", "spread = "): "values.step_height.std is missing",
        'schema = 1\nstimulus = "a"\nscan = "b"\nscan_sha256 = ""\nconvention = '
        '""\n': "values is missing",
    }.items():
        path.write_text(text)
        with pytest.raises(MetrologyError, match=rule):
            read_as_built(path)


def test_prediction_takes_the_record_and_says_how_far_the_energy_moved(tmp_path, capsys):
    path = scan(tmp_path / "a.csv", 50.0e-6, 14e-6)
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
    assert main(["predict", source, "--as-built", str(tmp_path)]) == 2


def test_the_scanned_surface_says_what_height_and_radius_cannot_of_a_chamfered_edge():
    # a riser of 30 um below a chamfer of 45 deg up to 50 um: a ball of 125 um on the lower face
    # touches the chamfer first, at R (1 - cos 45 deg) = 36.6 um, so the critical angle is that of
    # the chamfer
    x = np.arange(-400, 400) * 1e-6
    z = np.where(x < 0.0, 0.0, np.minimum(30e-6 + x, 50e-6))
    assert np.degrees(find_scanned_angle(x, z, 125e-6)) == pytest.approx(45.0, abs=1e-6)
    assert np.degrees(find_scanned_angle(-x[::-1], z[::-1], 125e-6)) == pytest.approx(
        45.0, abs=1e-6
    )
    # a ball of 80 um meets the riser's corner first, at acos(1 - 30/80) = 51.3 deg, and that is
    # steeper than the chamfer
    assert np.degrees(find_scanned_angle(x, z, 80e-6)) == pytest.approx(
        np.degrees(np.arccos(1 - 30 / 80)), abs=0.5
    )
    assert find_scanned_angle(x, np.full_like(x, np.nan), 125e-6) is None


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


def test_an_inspected_block_speaks_in_the_closed_loop_with_its_own_height_and_edge(tmp_path):
    values = {
        "groove_depth": AsBuiltValue(50.4e-6, 20e-9, "conforms"),
        "edge_radius": AsBuiltValue(14e-6, 0.3e-6, "does-not-conform"),
    }
    write_as_built(
        tmp_path / "step-050.as-built.toml",
        AsBuilt("step-050", "scan.x3p", "0" * 64, "type A1", values),
    )
    edges = list_measured_edges(read_records([tmp_path]))
    assert edges["step-050"] == pytest.approx(
        {
            "height_m": 50.4e-6,
            "height_std_m": 20e-9,
            "edge_radius_m": 14e-6,
            "edge_radius_std_m": 0.3e-6,
        }
    )


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
    assert said.out.startswith("values or trials excluded, each with its reason in the report: 1\n")
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


@pytest.mark.parametrize(("angle", "seen"), [(45.0, 45.0), (75.0, 60.0)])
def test_the_stylus_is_taken_off_a_corner_and_a_flank_as_steep_as_its_cone_is_said(
    angle, seen, tmp_path, capsys
):
    # a stylus of 2 um and 60 deg: it rounds a corner of 4 um to 6 um, and sees no flank steeper
    # than 90 - 30 = 60 deg
    fine = np.arange(-8000, 8000) * 0.02e-6
    x = np.arange(-300, 300) * 0.5e-6
    z = np.interp(
        x,
        fine,
        stylus_trace(
            fine, flank_gauge(fine, 50e-6, np.radians(angle), 4e-6), 2e-6, np.radians(60.0)
        ),
    )
    z = z + correlated_noise(len(x), 0.5e-6, 5e-9, 10e-9, 2e-6, np.random.default_rng(1))
    path = tmp_path / "traced.csv"
    np.savetxt(
        path,
        np.stack([x, z], axis=1) * 1e6,
        delimiter=",",
        header="x_um,z_um",
        comments="",
        fmt="%.5f",
    )
    inspect(
        str(path), "--stimulus", "step-050", "--stylus-radius", "2 um", "--stylus-cone", "60 deg"
    )
    told = capsys.readouterr().out
    assert float(told.split("its flank slopes by ")[1].split()[0]) == pytest.approx(seen, abs=0.5)
    assert ("the cone of the stylus shows none steeper" in told) == (angle > 60.0)
    radius, half = (float(word) for word in told.split("edge radius  ")[1].split()[:2])
    assert abs(radius - 4.0) < half
    assert "the stylus radius of 2 µm is taken off" in told
