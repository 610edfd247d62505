"""What is dragged over and under what, the command's files, and what it refuses."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from oracles.shipped import load_shipped
from stepblocks.cli import main
from stepblocks.contact.counterface import Margin, Profile, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER
from stepblocks.drag.probe import PAPER_DRAG, DragSettings
from stepblocks.drag.run import drag_over
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.subject import resolve_subject
from stepblocks.drag.track import build_track
from stepblocks.errors import PipelineError
from stepblocks.predict.predictions import predict_by_formula


def test_the_drag_command_leaves_traces_figures_and_a_summary(tmp_path, capsys):
    out = tmp_path / "with space"
    assert main(["drag", "75 um", "--load", "0.2 N", "--speed", "2 mm/s", "-o", str(out)]) == 0
    assert "releases" in capsys.readouterr().out
    summary = json.loads((out / "drag.json").read_text())
    assert summary["ledger_error"] < 1e-3
    assert summary["peak_force_n"] == pytest.approx(summary["equation_1"]["peak_force_n"], rel=0.05)
    trace = pd.read_csv(out / "trace.csv")
    assert {"time_s", "fx_n", "fy_n"} <= set(trace.columns)
    assert trace.fx_n.max() == pytest.approx(summary["peak_force_n"], rel=5e-3)
    for name in ("force.png", "spectra.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")


def test_a_scanned_profile_can_be_dragged_both_ways(tmp_path, capsys):
    x = np.linspace(-800, 800, 1601)
    z = np.where(x < 0, 0.0, 30.0)
    profile = tmp_path / "scan.csv"
    pd.DataFrame({"x_um": x, "z_um": z}).to_csv(profile, index=False)
    base = ["drag", str(profile), "--load", "0.5 N", "--speed", "20 mm/s", "-o"]
    assert main([*base, str(tmp_path / "up")]) == 0
    assert json.loads((tmp_path / "up" / "drag.json").read_text())["status"] == "releases"
    assert main([*base, str(tmp_path / "down"), "--backward"]) == 0
    assert json.loads((tmp_path / "down" / "drag.json").read_text())["status"] == "no-catch"
    assert not (tmp_path / "down" / "spectra.png").exists()


STIMULI = Path(__file__).resolve().parents[2] / "stimuli"


def drag_summary(tmp_path, *arguments):
    out = tmp_path / "declared"
    common = [
        "--stimuli",
        str(STIMULI),
        "--speed",
        "2 mm/s",
        "--ring-time",
        "20 ms",
        "-o",
        str(out),
    ]
    assert main(["drag", *arguments, *common]) == 0
    return json.loads((out / "drag.json").read_text())


@pytest.mark.long
def test_a_declared_block_is_dragged_over_under_the_conditions_of_its_set(tmp_path):
    # Origin: paper-ten declares 125 um, 0.3 N and mu 0.15 first; equation (1) by hand.
    found = drag_summary(tmp_path, "paper-ten/step-050")
    formula = 0.3 * math.tan(math.acos(1 - 50 / 125) + math.atan(0.15))
    assert found["settings"]["normal_load"] == 0.3
    assert found["equation_1"]["peak_force_n"] == pytest.approx(formula, rel=1e-12)
    assert found["peak_force_n"] == pytest.approx(formula, rel=0.05)
    heavier = drag_summary(tmp_path, "step-050", "--load", "0.5 N", "--friction", "0.2")
    assert heavier["settings"]["normal_load"] == 0.5
    assert heavier["settings"]["friction"] == 0.2


@pytest.mark.repeats
@pytest.mark.parametrize(
    "name", ["gap-100", "gap-050-over-020", "gap-050-under-020", "gap-050-bevelled"]
)
def test_a_crown_margin_is_dragged_over_in_either_direction(name):
    angles = {
        p.drag_direction: p.release
        for p in predict_by_formula(load_shipped("crown-margins"))
        if (p.stimulus, p.point.ball_radius, p.point.normal_load, p.point.friction)
        == (name, 60e-6, 1.0, 0.15)
    }
    for way, backward in (("tooth-to-crown", False), ("crown-to-tooth", True)):
        subject = resolve_subject(
            f"{STIMULI}/crown-margins.toml/{name}", {"load": 1.0}, backward, None
        )
        release = angles[way]
        assert way in subject.name
        assert subject.face.angles(subject.point.ball_radius)[backward] == pytest.approx(
            release.angle, rel=1e-12
        )
        track = build_track(subject.face, subject.point.ball_radius, backward)
        trace = simulate_drag(
            track, PAPER_DRAG, DragSettings(1.0, 0.15, speed=2e-3, ring_time=1e-3)
        )
        assert trace.status == release.status
        if release.status is Status.RELEASES:
            # steel gives 0.7 um under 1 N, and the blow of the edge adds v sqrt(k m) = 10 mN
            assert trace.peak_force == pytest.approx(release.pull_force, rel=0.10)


def test_a_declared_tip_is_dragged_over_the_steps_of_its_set(tmp_path):
    found = drag_summary(tmp_path, "tip-125", "--step-height", "50 um")
    formula = 0.5 * math.tan(math.acos(1 - 50 / 125) + math.atan(0.15))
    assert found["equation_1"]["peak_force_n"] == pytest.approx(formula, rel=1e-12)


def test_down_a_step_nothing_catches(tmp_path):
    assert drag_summary(tmp_path, "step-050", "--backward")["status"] == "no-catch"
    assert drag_summary(tmp_path, "50 um", "--backward")["status"] == "no-catch"


@pytest.mark.long
def test_the_same_drag_leaves_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        assert main(["drag", "25 um", "--speed", "40 mm/s", "-o", str(tmp_path / name)]) == 0
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["0,0", "100,nan", "200,5"], "z_um must be a finite number, got nan"),
        (["0,0", "100,inf", "200,5"], "z_um must be a finite number, got inf"),
        (["nan,0", "100,1", "200,5"], "x_um must be a finite number, got nan"),
        ([], "no rows"),
        (["0,0"], "at least 2 points, got 1"),
        (["200,0", "100,1", "0,5"], "must not decrease"),
        (["1,0", "1,1", "1,2"], "must extend along x"),
        (["-900,0", "0,0", "0,130", "900,130"], "too-high"),
    ],
)
def test_a_profile_that_is_none_is_one_line_with_its_file(tmp_path, capsys, rows, message):
    path = tmp_path / "profile.csv"
    path.write_text("\n".join(["x_um,z_um", *rows]) + "\n")
    assert main(["drag", str(path), "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "profile.csv" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_points_at_any_distance_are_the_same_profile(tmp_path):
    # a ramp and a sharp step, drawn with few points and with many at random places
    summaries = []
    corners = [(-800.0, 0.0), (0.0, 0.0), (0.0, 30.0), (800.0, 30.0)]
    extra = [(x, 0.0 if x < 0 else 30.0) for x in np.random.default_rng(1).uniform(-800, 800, 90)]
    for name, points in (("few", corners), ("many", sorted(corners + extra, key=lambda p: p[0]))):
        pd.DataFrame(points, columns=["x_um", "z_um"]).to_csv(tmp_path / f"{name}.csv", index=False)
        subject = resolve_subject(str(tmp_path / f"{name}.csv"), {}, False, None)
        trace = simulate_drag(
            build_track(subject.face, 125e-6), PAPER_DRAG, DragSettings(0.5, 0.15)
        )
        summaries.append((subject.face.angles(125e-6)[0], trace.peak_force))
    assert summaries[0] == pytest.approx(summaries[1], rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["25"], "stimulus must be a step height"),
        (["nowhere.csv"], "cannot be read"),
        (["25 um", "--load", "1 m"], "--load: must be a force"),
        (["25 um", "--load", "-1 N"], "normal_load must be positive"),
        (["200 um"], "too-high"),
        (["25 um", "--pull", "0 N"], "--pull: must be positive"),
        (["25 um", "--speed", "0 mm/s"], "--speed: must be positive"),
        (["25 um", "--sample-rate", "1 GHz", "--speed", "50 mm/s"], "record fewer"),
        (["step-999", "--stimuli", str(STIMULI)], "declared in"),
        (["other/step-050", "--stimuli", str(STIMULI)], "declared in"),
        (
            ["step-050", "--stimuli", str(STIMULI), "--edge-radius", "1 um"],
            "--edge-radius is for a plain step",
        ),
        (
            ["tip-029", "--stimuli", str(STIMULI), "--tip-radius", "1 um"],
            "--tip-radius must not be given",
        ),
        (
            ["step-050", "--stimuli", str(STIMULI), "--step-height", "1 um"],
            "--step-height is for a declared tip",
        ),
        (["25 um", "--step-height", "60 um"], "step_height is for a declared tip"),
        (["step-050", "--stimuli", "nowhere"], "--stimuli: path 'nowhere' does not exist"),
        (["25 um", "--friction", "-0.1"], "friction must be finite and not negative"),
        (["25 um", "--tip-radius", "0 um"], "radius must be positive"),
        (["25 um", "--speed", "1e-9 m/s"], "drag faster"),
    ],
)
def test_a_wrong_drag_is_one_line_and_exit_code_two(tmp_path, capsys, arguments, message):
    assert main(["drag", *arguments, "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_notebook_drags_over_a_counterface_as_the_command_over_the_height(tmp_path):
    assert (
        main(
            ["drag", "30 um", "--load", "0.5 N", "--speed", "10 mm/s", "-o", str(tmp_path / "out")]
        )
        == 0
    )
    done = drag_over(Step(30e-6), load=0.5, speed=10e-3)
    summary = json.loads((tmp_path / "out" / "drag.json").read_text())
    assert {k: v for k, v in done.summary.items() if k != "subject"} == {
        k: summary[k] for k in summary if k != "subject"
    }
    trace = pd.read_csv(tmp_path / "out" / "trace.csv", float_precision="round_trip")
    assert (done.frame.to_numpy() == trace.to_numpy()).all()


def test_the_paper_stands_where_nothing_is_said_and_what_is_said_takes_its_place():
    plain = resolve_subject("25 um", {})
    assert (plain.face, plain.point) == (Step(25e-6), PAPER)
    said = resolve_subject(
        "25 um",
        {"tip_radius": 60e-6, "load": 0.4, "friction": 0.1, "stiffness": 5e3, "frequency": 250.0},
    )
    assert (said.point.ball_radius, said.point.normal_load, said.point.friction) == (
        60e-6,
        0.4,
        0.1,
    )
    assert (said.point.tool.stiffness, said.point.tool.frequency) == (5e3, 250.0)
    assert said.point.tool.decay_time == PAPER.tool.decay_time
    assert resolve_subject("25 um", {"edge_radius": 3e-6}).face == Step(25e-6, 3e-6)


def test_the_ring_of_a_drag_decays_as_the_tool_unless_a_damping_is_given():
    # Origin: zeta = 1 / (2 pi f T); 14.2 ms at 300 Hz are 3.7 % of critical damping.
    assert drag_over("25 um", speed=20e-3).trace.probe.damping_ratio == pytest.approx(
        0.0373, abs=1e-4
    )
    assert drag_over("25 um", damping_ratio=0.0, speed=20e-3).trace.probe.damping_ratio == 0.0


def test_a_stimulus_keeps_its_own_dimensions_and_is_named_with_its_direction():
    margin = resolve_subject(f"{STIMULI}/crown-margins.toml/gap-100", {}, backward=True)
    assert isinstance(margin.face, Margin)
    assert margin.name == "gap-100, crown-to-tooth"
    tip = resolve_subject(f"{STIMULI}/probe-tips.toml/tip-125", {"step_height": 40e-6})
    assert (tip.point.ball_radius, tip.face) == (125e-6, Step(40e-6))
    assert tip.name == "tip-125 over a step of 40 um"


def test_an_identity_in_two_sets_must_be_distinguished(tmp_path):
    text = (STIMULI / "paper-ten.toml").read_text()
    for name in ("one", "two"):
        (tmp_path / f"{name}.toml").write_text(text.replace('set = "paper-ten"', f'set = "{name}"'))
    with pytest.raises(PipelineError, match="is several: one/step-050, two/step-050"):
        resolve_subject("step-050", {}, stimuli=tmp_path)
    assert resolve_subject("two/step-050", {}, stimuli=tmp_path).face == Step(50e-6)


def test_a_profile_in_millimetres_is_the_profile_in_micrometres(tmp_path):
    (tmp_path / "um.csv").write_text("x_um,z_um\n-900,0\n0,0\n0,30\n900,30\n")
    (tmp_path / "mm.csv").write_text("x_mm,z_mm\n-0.9,0\n0,0\n0,0.03\n0.9,0.03\n")
    um, mm = (resolve_subject(tmp_path / f"{unit}.csv", {}).face for unit in ("um", "mm"))
    assert isinstance(um, Profile)
    assert um.z == pytest.approx(mm.z)
    assert um.angles(125e-6)[0] == pytest.approx(Step(30e-6).angles(125e-6)[0], rel=1e-9)
    with pytest.raises(PipelineError, match="has its own shape"):
        resolve_subject(tmp_path / "um.csv", {"edge_radius": 1e-6})
