"""An inspection from file to verdict, exit code and as-built record."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from oracles.published_schemas import check_file
from oracles.softgauge import (
    correlated_noise,
    edge_gauge,
    flank_gauge,
    groove_gauge,
    stylus_trace,
    write_edge_scan,
)
from stepblocks.cli import main
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.run import inspect_standard
from stepblocks.records.as_built import (
    read_as_built,
)
from stepblocks.scans.scan import HeightMap

STIMULI = str(__import__("pathlib").Path(__file__).parents[2] / "stimuli")


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
    path = write_edge_scan(tmp_path / "a.csv", height, radius)
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
    path = write_edge_scan(tmp_path / "a.csv", 50.2e-6)
    assert inspect(path, "--stimulus", stimulus, *options) == 2
    assert idle in capsys.readouterr().err


def test_the_output_holds_table_plot_json_and_a_record_that_reads_back(tmp_path, capsys):
    path = write_edge_scan(tmp_path / "a.csv", 50.2e-6, 1e-6)
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
    check_file("inspection", out / "step-050.inspection.json")
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
    # the crown is not overextended by 20 um
    assert inspect(str(path), "--stimulus", "gap-050-over-020") == 1
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
    asked = [str(path), "--stimulus", "tip-125", "--characteristics", "1"]
    assert inspect(*asked, *OPTICAL) == 0
    assert "ball radius" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.csv", "--stimulus", "step-050"], "scan must be a file"),
        (["{scan}", "--stimulus", "step-999"], "stimulus must be declared"),
        (["{scan}", "--stimulus", "step-050", "--feature", "ball"], "feature must be"),
        (["{scan}", "--stimulus", "step-050", "--unit", "mm"], "must agree with its column"),
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
    path = write_edge_scan(tmp_path / "a.csv", 50e-6)
    assert inspect(*[one.format(scan=path) for one in arguments]) == 2
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        (b"", [], "scan must not be empty [scan.csv]"),
        (b"1\n2\n3\n" * 50, [], "a table of numbers in two columns or more, got none [scan.csv]"),
        (b"no scan at all\n", [], "table has no rows [scan.csv]"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0", [], "file must be text, got binary data [scan.csv]"),
        (
            b"x_um,z_um\n1,nan\n2,nan\n3,nan\n",
            [],
            "must hold at least one measured height, got none [scan.csv]",
        ),
        (
            None,
            ["--units", "furlong"],
            "unit must be one of nm, \u00b5m, mm, m, in, mil, uin, or by axis as x=mm,z=um, "
            "got 'furlong'",
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
            ["--units", "um", "--area", "0um", "50um", "0um", "20um"],
            "area must be four lengths on a map, from and to along x, from and to along y, got 4 "
            "on a profile",
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


@pytest.mark.long
def test_a_rectangle_of_a_map_is_judged_by_itself_and_the_whole_map_by_all_of_it(tmp_path):
    # 25 um on the lower 150 um of the map, 40 um on the others, whose edge lies elsewhere
    x, y = np.meshgrid(np.arange(600) * 2e-6, np.arange(30) * 10e-6)
    high = np.where(y <= 150e-6, np.where(x > 0.6e-3, 25e-6, 0.0), np.where(x > 0.4e-3, 40e-6, 0.0))
    scan = HeightMap(high + np.random.default_rng(3).normal(0.0, 20e-9, x.shape), 2e-6, 10e-6)
    for area, true in (((0.0, 1.2e-3, 0.0, 140e-6), 25e-6), ((0.0, 1.2e-3, 160e-6, 1.0), 40e-6)):
        found = inspect_standard(scan, feature="edge", options=EvaluationOptions(area=area))
        value = found.evaluation.values["step_height"]
        assert abs(value.value - true) < 10e-9
    whole = inspect_standard(scan, feature="edge").evaluation.values["step_height"]
    assert whole.compute_expanded_uncertainty() > 1e-6
    with pytest.raises(MetrologyError, match="height map must have at least 2 x 3 points, got 1 x"):
        inspect_standard(scan, options=EvaluationOptions(area=(0.0, 1.2e-3, 0.0, 1e-6)))


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


@pytest.mark.parametrize("degrees", [3.0, 8.0])
def test_the_interval_of_a_step_that_leans_holds_its_height_square_to_its_faces(degrees):
    # parallel faces 50 um apart, turned by an angle a, are 50 um / cos(a) apart along z
    angle = np.radians(degrees)
    x = np.arange(-1000, 1000) * 1e-6
    z = np.where(x > 0.0, 50e-6 / np.cos(angle), 0.0) + np.tan(angle) * x
    z += np.random.default_rng(3).normal(0.0, 20e-9, len(x))
    measured = inspect_standard((x, z), 50e-6, 1e-6, instrument=Instrument(0.0, 0.0, 0.0))
    height = next(iter(measured.evaluation.values.values()))
    assert abs(height.value - 50e-6) < height.compute_expanded_uncertainty()
    assert "tilt" in [component.name for component in height.components]


@pytest.mark.parametrize(
    "wrong", [{"stylus_radius": -1e-6}, {"stylus_cone": 7.0}, {"exclusion": -1e-6}]
)
def test_what_no_stylus_and_no_exclusion_can_be_is_refused(wrong):
    with pytest.raises(MetrologyError, match=r"(must|must not) .*, got"):
        EvaluationOptions(**wrong)
