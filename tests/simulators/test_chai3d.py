"""The program for CHAI3D: built as its README says, felt by its virtual hand, its sessions read."""

import math
import os
import re
import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from oracles.scenes import assemble_scene
from stepblocks.bench.measure import measure_session
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declaration.read import load_set
from stepblocks.loop.run import loop_session
from stepblocks.rehearse.record import Rig, Truth, record_trial_by_equations
from stepblocks.simulators.compare import compare_record
from stepblocks.simulators.export import export_scenes
from stepblocks.simulators.scene import write_scene
from stepblocks.simulators.scenes import SCENE_FORMATS

SET = Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml"
STUB = Path(__file__).with_name("stubs") / "chai3d"
TEN = load_set(SET).stimuli
R, MU, SPRING, SHARE = 125e-6, 0.15, 9.81e3, 0.2
# a tip without mass passes the edge at once where the slope of the force along the arc of the ball,
# at least F_py / R, is above the spring: 1.23 N
LOAD = 1.5


def paper_force(height, load):
    """Equations (1) and (2)."""
    return load * math.tan(math.acos(1.0 - height / R) + math.atan(MU))


def read_columns_in_worker(path):
    """The columns of a file of the log, in HDF5 or CSV, and its block where that is told."""
    if path.suffix == ".csv":
        return pd.read_csv(path)
    with h5py.File(path) as file:
        table = pd.DataFrame({name: values[:] for name, values in file.items()})
        table.attrs["block"] = file.attrs["block"].decode()
    return table


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The program of the ten blocks, built by the commands that its head gives."""
    built, cmake = os.environ.get("CHAI3D_BUILD"), shutil.which("cmake")
    if not (built and cmake):
        pytest.skip("CHAI3D_BUILD names no build tree of CHAI3D 3.3")
    base = tmp_path_factory.mktemp("with space")
    export_scenes(str(SET), "chai3d", base)
    folder = base / "paper-ten" / "chai3d-blocks"
    for command in list_commands(folder, built)[:-1]:
        subprocess.run(command, shell=True, check=True, cwd=folder, capture_output=True)
    return folder


def list_commands(folder, built):
    """The commands that the head of a delivered program gives."""
    text = (folder / "blocks.cpp").read_text().replace("<build tree of CHAI3D>", built)
    lines = re.findall(r"^//   (.*)$", text, re.MULTILINE)
    return " && ".join(lines).split(" && ")


def test_the_head_of_the_program_says_how_it_is_built_and_run(tmp_path):
    """Known without CHAI3D, too: the README sends its reader there."""
    export_scenes(str(SET), "chai3d", tmp_path, only="step-050")
    folder = tmp_path / "paper-ten" / "step-050" / "chai3d"
    assert "(its head says how)" in (folder / "README.md").read_text()
    assert list_commands(folder, "CHAI3D") == [
        "cmake -B build -DCMAKE_PREFIX_PATH=CHAI3D",
        "cmake --build build",
        "build/blocks --device 0",
    ]


def read_until(stream, pattern):
    """What a program prints up to what it must show; a minute of its lines at most."""
    text = ""
    while not re.search(pattern, text):
        text += stream.read(150)
        assert len(text) < 200_000, f"never showed {pattern}"
    return text


def drive(folder, keys, *options):
    command = [folder / "build" / "blocks", "--blocks", folder, *options]
    return subprocess.run(command, input=keys, capture_output=True, text=True, check=False)


def test_the_program_drags_as_its_readme_says(program):
    block = program.parent / "step-050" / "chai3d"
    text = (block / "README.md").read_text()
    (said,) = re.findall(r"`(echo 1 \| build/blocks --blocks \.)`", text)
    release = float(text.split("| +x | releases |")[1].split("|")[1].split()[0])
    built = os.environ["CHAI3D_BUILD"]
    for command in (f"cmake -B build -DCMAKE_PREFIX_PATH={built}", "cmake --build build", said):
        done = subprocess.run(
            command, shell=True, check=True, cwd=block, capture_output=True, text=True
        )
    (peak,) = re.findall(r"peak (\S+) N", done.stdout)
    assert float(peak) == pytest.approx(release, rel=2e-3)
    assert "releases 1, crossed" in done.stdout


def test_keys_switch_block_and_ring(program):
    found = drive(program, "1\n0\nv\n0\nq\n").stdout
    drags = re.findall(
        r"block (\d+), vibration (\w+)\npeak ([\d.]+) N, formula ([\d.]+), releases (\d), crossed",
        found,
    )
    assert [(number, ring, releases) for number, ring, _, _, releases in drags] == [
        ("1", "on", "1"),
        ("10", "on", "1"),
        ("10", "off", "1"),
    ]
    for *_, peak, formula, _ in drags:
        assert float(peak) == pytest.approx(float(formula), rel=0.01)


def test_the_ring_follows_what_was_released_under_any_load(program, tmp_path):
    """Its amplitude is sqrt(C_v) F_px of equation (1); the record is its event to `compare`."""
    loads = (0.1, 0.3, 1.0)
    keys = "".join(f"l {load}\n1\n" for load in loads)
    done = drive(program, f"s 0.5\n{keys}q\n", "--log", tmp_path / "log", "--noise", "0").stdout
    found = re.findall(r"released at (\S+) N, .* ring (\S+) N", done)
    assert len(found) == len(loads)
    for trial, (load, words) in enumerate(zip(loads, found, strict=True), start=1):
        force = paper_force(10e-6, load)
        released, amplitude = map(float, words)
        assert released == pytest.approx(force, rel=0.02)
        assert amplitude == pytest.approx(math.sqrt(SHARE) * force, rel=0.02)
        (record,) = (tmp_path / "log" / "traces").glob(f"{trial:04d}.*")
        scores = compare_record(record, f"{SET}/step-010", normal_load=load).set_index("part")
        assert scores["difference_jnd"]["score"] < 1.0


def test_measure_finds_forces_and_energies_of_the_file_in_a_session_of_the_program(
    program, tmp_path
):
    """Ten blocks at 1.5 N: equations (1) and (2); heights by them from what was measured."""
    keys = "\n".join("1234567890")
    drive(program, f"l {LOAD}\n{keys}\nq\n", "--log", tmp_path / "log")
    table = measure_session(tmp_path / "log", jobs=1)
    heights = np.array([block.height.nominal for block in TEN])
    forces = np.array([paper_force(height, LOAD) for height in heights])
    assert list(table["status"]) == ["ok"] * 10
    assert list(table["regime"]) == ["snap"] * 10
    assert table["sliding_friction"].to_numpy() == pytest.approx(MU, rel=5e-3)
    assert table["spring_constant_n_per_m"].to_numpy() == pytest.approx(SPRING, rel=2e-3)
    assert table["height_um"].to_numpy() == pytest.approx(heights * 1e6, rel=1e-6)
    assert table["peak_force_n"].to_numpy() == pytest.approx(forces, rel=0.015)
    energies = SHARE * forces**2 / (2.0 * SPRING)
    assert table["vibration_energy_j"].to_numpy() == pytest.approx(energies, rel=0.025)
    angles = np.arctan(table["peak_force_n"] / LOAD) - math.atan(MU)
    assert (R * (1.0 - np.cos(angles))).to_numpy() == pytest.approx(heights, abs=0.3e-6)
    for trial, block in enumerate(TEN[:8], start=1):  # the others are beyond a hand
        (record,) = (tmp_path / "log" / "traces").glob(f"{trial:04d}.*")
        scores = compare_record(record, f"{SET}/{block.id}", normal_load=LOAD).set_index("part")
        assert scores["difference_jnd"]["score"] < 1.0


def test_the_loop_finds_nothing_missing_in_a_session_of_the_program(program, tmp_path):
    """Loads at which a tip without mass snaps: five blocks at three loads and three speeds."""
    keys = [
        f"l {load}\ns {speed}\n" + "\n".join("12345")
        for load in (1.3, 1.6, 2.0)
        for speed in (2.0, 4.0, 8.0)
    ]
    drive(program, "\n".join([*keys, "q\n"]), "--log", tmp_path / "log")
    result = loop_session(tmp_path / "log", tmp_path / "loop", jobs=1)
    assert result.verdict == "none"


def test_without_hdf5_the_log_has_the_same_columns_as_csv(program, tmp_path):
    built = os.environ["CHAI3D_BUILD"]
    plain = shutil.copytree(program, tmp_path / "paper-ten" / "chai3d-blocks")
    shutil.rmtree(plain / "build")
    options = f"-DCMAKE_PREFIX_PATH={built}", "-DCMAKE_DISABLE_FIND_PACKAGE_HDF5=ON"
    subprocess.run(["cmake", "-B", "build", *options], check=True, cwd=plain, capture_output=True)
    subprocess.run(["cmake", "--build", "build"], check=True, cwd=plain, capture_output=True)
    for folder, name in ((program, "log"), (plain, "plain")):
        done = drive(folder, "1\nq\n", "--blocks", program, "--log", tmp_path / name)
        assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "plain" / "traces" / "0001.csv")
    if not (tmp_path / "log" / "traces" / "0001.h5").exists():
        pytest.skip("no C library of HDF5")
    with h5py.File(tmp_path / "log" / "traces" / "0001.h5") as file:
        assert set(table.columns) == set(file)
        assert file.attrs["rate_hz"] == 1e4
        for name, values in file.items():
            assert table[name].to_numpy() == pytest.approx(values[:], rel=1e-8, abs=1e-12)


def test_a_device_gives_no_force_before_it_is_calibrated_and_at_most_3_newton(program, tmp_path):
    """The demonstration runs as a device does, with a thread of its own, and drags by itself."""
    command = [program / "build" / "blocks", "--blocks", program, "--device", "demo"]
    with subprocess.Popen(
        [*command, "--log", tmp_path / "log", "--load", "1.5"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as one:
        before = read_until(one.stderr, r"kept 0 +\n.*kept 0 +\n")
        one.stdin.write("c\n9\n")  # of 90 um: 11 N
        one.stdin.flush()
        clipped = read_until(one.stderr, r"block 9 .* limited [1-9]")
        one.stdin.write("3\n")  # of 30 um: 1.7 N
        one.stdin.flush()
        read_until(one.stderr, r"block 3 .* releases 3, last at 1\.7")
        said, _ = one.communicate("q\n", timeout=60.0)
    assert "limited to 3 N" in said
    assert "it slips at 11.1 N: the force is clipped at 3 N" in said
    assert set(re.findall(r"load +(\S+) N", before)) == {"0.000"}
    assert re.search(r"load +1\.5", clipped)
    trials = pd.read_csv(tmp_path / "log" / "trials.csv").set_index("trial")
    assert "step-030" in set(trials["block"])
    table = measure_session(tmp_path / "log", jobs=1)
    good = table[(table["status"] == "ok") & (table["block"] == "step-030")]
    assert len(good)
    # every tick from the calibration on, in the air too, with nothing lost between two files
    stretches = [
        read_columns_in_worker(path) for path in sorted((tmp_path / "log" / "ticks").iterdir())
    ]
    ticks = pd.concat(stretches, ignore_index=True)
    assert np.diff(ticks["time_s"]) == pytest.approx(1.0 / 4e3, rel=1e-6)
    blocks = {one.attrs["block"] for one in stretches if one.attrs}  # CSV does not tell it
    assert not blocks or {"step-010", "step-090", "step-030"} <= blocks
    assert (ticks["normal_n"].abs() < 0.01).mean() > 0.2
    assert ticks["releases"].max() >= len(trials)
    assert good["peak_force_n"].to_numpy() == pytest.approx(paper_force(30e-6, LOAD), rel=0.03)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--load", "-1"], "--load, --limit, --speed and --rate must be positive"),
        (["--colour", "red"], "are known, got --colour"),
        (["--device", "7"], "there is no device 7"),
        (["--blocks", "/nowhere"], "must lie where the export put it"),
    ],
)
def test_the_program_refuses_in_one_line_what_it_cannot_do(program, options, words):
    done = drive(program, "q\n", *options)
    assert done.returncode == 2
    assert words in done.stderr.strip().splitlines()[-1]


def test_the_program_leaves_a_folder_that_is_there_as_it_is(program, tmp_path):
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "mine.txt").write_text("mine")
    done = drive(program, "1\nq\n", "--log", tmp_path / "log")
    assert done.returncode == 2
    assert "--log must name a folder that can be made and is not there yet" in done.stderr
    assert [path.name for path in (tmp_path / "log").iterdir()] == ["mine.txt"]


DRIVER = r"""
#include "SessionLog.h"
int main(int, char** arguments)
{
    stepblock::cSessionLog log;
    if (!log.begin(arguments[1], 1e4, 0.0)) return 2;
    std::vector<stepblock::Tick> ticks;
    double time, pull, load, hand;
    while (std::scanf("%lf %lf %lf %lf", &time, &pull, &load, &hand) == 4)
    {
        if (time == 0.0 && !ticks.empty())
        {
            if (!log.add({0, 1, 0.0, 0.0}, ticks)) return 2;
            ticks.clear();
        }
        ticks.push_back({time, -pull, load, 0.0, hand, hand, 0});
    }
    return log.add({0, 1, 0.0, 0.0}, ticks) ? 0 : 2;
}
"""


@pytest.mark.long
def test_the_log_by_itself_writes_a_session_that_measure_reads(tmp_path):
    """Records of a rehearsed bench, whose truth is known, written by the delivered header."""
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        pytest.skip("no c++")
    scene = assemble_scene(TEN[4], OperatingPoint(R, 0.5, MU))
    (tmp_path / "chai3d").mkdir()
    write_scene(tmp_path / "chai3d", scene, SCENE_FORMATS["chai3d"])
    (tmp_path / "drive.cpp").write_text(DRIVER)
    include = f"-I{STUB}", f"-I{tmp_path / 'chai3d'}"
    strict = "-std=c++11", "-Wall", "-Wextra", "-Werror", "-pedantic"
    command = [compiler, *strict, *include, tmp_path / "drive.cpp", "-o", tmp_path / "drive"]
    subprocess.run(command, check=True)
    peak, speed = paper_force(50e-6, 0.5), 5e-3
    truth = Truth(0.5, MU * 0.5, SPRING * speed, peak, 0.4, 300.0, 0.02)
    random = np.random.default_rng(34)
    rows = []
    for _ in range(4):
        trace, *_ = record_trial_by_equations(truth, Rig(), random)
        rows += zip(trace.time, trace.tangential, trace.normal, speed * trace.time, strict=True)
    text = "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in rows)
    done = subprocess.run(
        [tmp_path / "drive", tmp_path / "log"], input=text, text=True, check=False
    )
    assert done.returncode == 0
    table = measure_session(tmp_path / "log", jobs=1)
    assert list(table["status"]) == ["ok"] * 4
    assert list(table["block"]) == ["step-050"] * 4
    assert table["height_um"].to_numpy() == pytest.approx(50.0)
    assert table["load_n"].to_numpy() == pytest.approx(0.5, rel=0.01)  # from the ticks
    assert table["speed_mm_s"].to_numpy() == pytest.approx(5.0, rel=0.01)
    assert table["peak_force_n"].to_numpy() == pytest.approx(peak, rel=0.01)
    assert table["ring_amplitude_n"].to_numpy() == pytest.approx(0.4, rel=0.05)
    assert table["spring_constant_n_per_m"].to_numpy() == pytest.approx(SPRING, rel=0.02)
