"""``stepblocks export`` writes folders that stand alone, and refuses in one line."""

import csv
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from oracles.shipped import load_shipped
from stepblocks.cli import main, make_root_command
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import choose_operating_point
from stepblocks.errors import PipelineError
from stepblocks.simulators.export import export_scenes
from stepblocks.simulators.scenes import SCENE_FORMATS

ROOT = Path(__file__).resolve().parents[2]
SET = str(ROOT / "stimuli" / "paper-ten.toml")


def test_the_command_line_offers_every_simulator():
    (option,) = (
        one for one in make_root_command().commands["export"].params if "--for" in one.opts
    )
    assert option.type_descriptor.choices == tuple(SCENE_FORMATS)


@pytest.mark.long
def test_a_folder_is_written_for_a_device_and_runs_from_elsewhere(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = [
        "export",
        SET,
        "--for",
        "forcelaw",
        "-o",
        "my scenes",
        "--only",
        "step-030",
        "--device",
        "omega-3",
        "--load",
        "1 N",
    ]
    assert main(arguments) == 0
    assert "omega-3, step-030: renders" in capsys.readouterr().out
    folder = tmp_path / "my scenes" / "paper-ten" / "step-030" / "forcelaw-omega-3"
    elsewhere = tmp_path / "else where"
    elsewhere.mkdir()
    done = subprocess.run(
        [sys.executable, "-I", "-S", os.path.relpath(folder / "force_law.py", elsewhere)],
        cwd=elsewhere,
        capture_output=True,
        text=True,
        check=True,
    )
    peak, formula = float(done.stdout.split()[1]), float(done.stdout.split()[4])
    assert peak == pytest.approx(formula, rel=5e-3)
    assert json.loads((folder / "event.json").read_text())["scale"] > 1.0


def test_a_notebook_exports_what_the_command_exports(tmp_path):
    told = []
    arguments = [
        "export",
        SET,
        "--for",
        "gltf",
        "-o",
        str(tmp_path / "a"),
        "--only",
        "step-02?",
        "--device",
        "sigma-7",
    ]
    assert main([*arguments, "--load", "0.4 N"]) == 0
    done = export_scenes(
        [SET],
        "gltf",
        str(tmp_path / "b"),
        only="step-02?",
        device="sigma-7",
        normal_load=0.4,
        progress=told.append,
    )
    assert told == done
    assert [(one.name, one.folder) for one in done] == [
        ("paper-ten/step-020", tmp_path / "b" / "paper-ten" / "step-020" / "gltf-sigma-7")
    ]
    assert done[0].plan.device == "sigma-7"
    for path in (tmp_path / "a").rglob("[!.]*.*"):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes()


def test_what_is_not_asked_for_is_the_first_of_the_sets_prediction(tmp_path):
    grid = load_shipped("sheaths").prediction
    (done,) = export_scenes([ROOT / "stimuli" / "sheaths.toml"], "x3d", tmp_path, only="*hard*")
    scene = json.loads((done.folder / "event.json").read_text())
    assert (scene["normal_load_n"], scene["friction"], scene["ball_radius_m"]) == pytest.approx(
        (grid.normal_loads[0], grid.frictions[0], grid.tip_radii[0])
    )


@pytest.mark.long
def test_a_sheath_changes_how_the_probe_rings(tmp_path):
    """The event rings as the sheathed rod does; the soft sheath ends its ring sooner."""
    stimuli, decays = load_shipped("sheaths"), {}
    for part, done in zip(
        stimuli.stimuli,
        export_scenes([ROOT / "stimuli" / "sheaths.toml"], "x3d", tmp_path),
        strict=True,
    ):
        event, ring = (
            json.loads((done.folder / "event.json").read_text())["events"][0],
            stimuli.predict_ring(part),
        )
        assert (event["frequency_hz"], event["stiffness_n_per_m"]) == pytest.approx(
            (ring.frequency, ring.stiffness)
        )
        decays[part.id] = event["decay_s"]
    assert decays["sheath-soft"] < decays["sheath-hard"]


def test_an_unknown_simulator_names_the_known_ones(tmp_path):
    with pytest.raises(
        PipelineError, match=r"--for must be one of mujoco, chai3d, .*, got 'unity'"
    ):
        export_scenes([SET], "unity", tmp_path)


def test_a_folder_that_cannot_be_written_is_named_and_leaves_nothing_half_done(tmp_path):
    (tmp_path / "paper-ten").write_text("in the way")
    with pytest.raises(PipelineError, match="output cannot be written"):
        export_scenes([SET], "x3d", tmp_path, only="step-010")
    assert [path.name for path in tmp_path.iterdir()] == ["paper-ten"]


def test_files_of_the_user_survive_a_second_export(tmp_path):
    arguments = ["export", SET, "--for", "x3d", "-o", str(tmp_path), "--only", "step-010"]
    assert main(arguments) == 0
    folder = tmp_path / "paper-ten" / "step-010" / "x3d"
    (folder / "notes.txt").write_text("mine")
    assert main(arguments) == 0
    assert (folder / "notes.txt").read_text() == "mine"
    assert not list(folder.parent.glob(".partial*"))


@pytest.mark.long
@pytest.mark.parametrize("simulator", SCENE_FORMATS)
@pytest.mark.parametrize(
    ("name", "only"), [("crown-margins", "crown-shoulder"), ("probe-tips", "hook-125")]
)
def test_crowns_and_tips_are_written_for_every_simulator(simulator, name, only, tmp_path):
    arguments = [
        "export",
        str(ROOT / "stimuli" / f"{name}.toml"),
        "--for",
        simulator,
        "-o",
        str(tmp_path / "o ut"),
        "--only",
        only,
    ]
    assert main(arguments) == 0
    folder = tmp_path / "o ut" / name / only / simulator
    scene = json.loads((folder / "event.json").read_text())
    assert [event["drag"] for event in scene["events"]] == ["+x", "-x"]
    assert (folder / "ring-up.json").is_file()


def test_the_step_under_a_tip_is_asked_for(tmp_path, capsys):
    tips = str(ROOT / "stimuli" / "probe-tips.toml")
    options = ["--for", "forcelaw", "-o", str(tmp_path), "--only", "tip-125"]
    assert (
        main(
            [
                "export",
                tips,
                *options,
                "--step-height",
                "60 um",
                "--load",
                "1 N",
                "--friction",
                "0.15",
            ]
        )
        == 0
    )
    event = json.loads(
        (tmp_path / "probe-tips" / "tip-125" / "forcelaw" / "event.json").read_text()
    )["events"][0]
    # equations (1) and (2) with the tip's own ball of 125 um
    assert event["critical_force_n"] == pytest.approx(
        math.tan(math.acos(1 - 60 / 125) + math.atan(0.15)), rel=1e-9
    )
    assert main(["export", tips, *options, "--step-height", "5 mm"]) == 2
    assert "the step under a tip is impossible" in capsys.readouterr().err


def test_the_simulated_ring_stands_in_the_files_with_the_energy_of_the_formula(tmp_path):
    soundfile = pytest.importorskip("soundfile")
    arguments = [
        "export",
        SET,
        "--for",
        "forcelaw",
        "-o",
        str(tmp_path),
        "--only",
        "step-090",
        "--load",
        "1 N",
    ]
    assert main([*arguments, "--ring", "drag"]) == 0
    folder = tmp_path / "paper-ten" / "step-090" / "forcelaw"
    event = json.loads((folder / "event.json").read_text())["events"][0]
    energy = 0.2 * 0.5 * event["critical_force_n"] ** 2 / 9.81e3
    assert event["energy_j"] == pytest.approx(energy, rel=1e-9)
    stated = json.loads((folder / "ring-up.json").read_text())
    phase = 2 * math.pi * event["frequency_hz"] * event["decay_s"]
    rule = 2 / (event["stiffness_n_per_m"] * event["decay_s"]) * (1 + 1 / phase**2)
    for name, full_scale in stated["full_scale_n"].items():
        samples, rate = soundfile.read(folder / name, dtype="float64")
        force = samples * full_scale
        assert rule * np.sum(force**2) / rate == pytest.approx(energy, rel=0.01)
        assert stated["energy_in_file_j"][name] == pytest.approx(energy, rel=0.01)
        # friction ends it: a straight envelope, gone where the exponential still has a fifth of its
        # amplitude
        assert np.abs(force[round(0.025 * rate) :]).max() < 0.02 * np.abs(force).max()
    # the drag's own share is higher than the paper's 20 %
    assert event["simulated_energy_j"] > 2.0 * energy


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (["--device", "joystick"], "device must be one of touch"),
        (["--only", "nothing"], "--only must match"),
        (["--load", "3"], "--load: must be a force"),
        (["--load", "-1 N"], "normal_load must be positive"),
        (["--friction", "slippery"], "--friction"),
        (["--scale", "0"], "scale must be positive"),
        (["--scale", "0", "--device", "touch"], "scale must be positive"),
        (["--step-height", "10 um"], "a step height is for the step under a tip"),
        (["--devices", "missing.toml"], "cannot be read"),
    ],
)
def test_wrong_input_is_one_line(extra, message, tmp_path, capsys):
    assert main(["export", SET, "--for", "usd", "-o", str(tmp_path), *extra]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def learnt(height=50e-6, load=1.0):
    """Equation (1) with what the model above holds, and equation (2) with R + r."""
    force = load * math.tan(math.acos(1 - height / 139e-6) + math.atan(0.2))
    return force, 0.25 * 0.5 * force**2 / (1.02 * 9.81e3)


def test_an_export_uses_a_learned_model(learned_model, tmp_path):
    arguments = [
        "export",
        SET,
        "--for",
        "forcelaw",
        "-o",
        str(tmp_path),
        "--only",
        "step-050",
        "--load",
        "1 N",
    ]
    assert main([*arguments, "--model", str(learned_model)]) == 0
    folder = tmp_path / "paper-ten" / "step-050" / "forcelaw"
    scene = json.loads((folder / "event.json").read_text())
    event, (force, energy) = scene["events"][0], learnt()
    assert scene["friction"] == pytest.approx(0.2)
    # the edge of 14 um is in the geometry
    assert event["critical_force_n"] == pytest.approx(force, rel=1e-6)
    assert event["energy_j"] == pytest.approx(energy, rel=1e-6)
    assert (event["frequency_hz"], event["decay_s"]) == pytest.approx((280.4, 0.02))
    learned = event["learned"]
    assert learned["status"] == "ok"
    assert learned["peak_force_low_n"] < learned["peak_force_n"] < learned["peak_force_high_n"]
    words = subprocess.run(
        [sys.executable, "-I", str(folder / "force_law.py")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(words.stdout.split()[1]) == pytest.approx(force, rel=5e-3)


@pytest.mark.long
def test_a_build_predicts_with_a_learned_model(learned_model, tmp_path):
    tips = str(ROOT / "stimuli" / "probe-tips.toml")
    arguments = ["build", tips, "-o", str(tmp_path), "--only", "tip-125", "--quiet", "--jobs", "1"]
    assert main([*arguments, "--model", str(learned_model)]) == 0
    with (tmp_path / "probe-tips" / "predictions.csv").open() as stream:
        rows = [
            row
            for row in csv.DictReader(stream)
            if row["stimulus"] == "tip-125" and row["height_um"] == "50"
        ]
    assert {row["friction"] for row in rows} == {"0.2"}
    for row in rows:
        force, energy = learnt(load=float(row["normal_load_n"]))
        assert float(row["learned_peak_force_n"]) == pytest.approx(force, rel=1e-4)
        assert float(row["learned_vibration_energy_uj"]) == pytest.approx(energy * 1e6, rel=1e-4)
        assert float(row["peak_force_n"]) > force  # equation (1) alone knows no rounded edge
        assert row["learned_status"] == "ok"


def test_a_model_that_is_none_is_refused(tmp_path, capsys):
    (tmp_path / "model.json").write_text("{}")
    arguments = [
        "export",
        SET,
        "--for",
        "x3d",
        "-o",
        str(tmp_path / "out"),
        "--model",
        str(tmp_path / "model.json"),
    ]
    assert main(arguments) == 2
    assert "model must have the format" in capsys.readouterr().err


def test_several_simulators_are_written_in_one_start(tmp_path):
    done = export_scenes(SET, ["forcelaw", "gltf", "forcelaw"], tmp_path, only="step-050")
    assert [found.folder.name for found in done] == ["forcelaw", "gltf"]
    assert all((found.folder / "README.md").is_file() for found in done)
    with pytest.raises(PipelineError, match=r"--for must be one of .*, got 'unity'"):
        export_scenes(SET, ["gltf", "unity"], tmp_path)


def test_a_scene_says_where_predict_calls_another_energy_felt(tmp_path):
    """50 um at 0.3 N by the drag in time, the same model that predict has in its column."""
    from stepblocks.predict.predictions import predict_single_drag

    (done,) = export_scenes(SET, "forcelaw", tmp_path, only="step-050", normal_load=1.0)
    text = (done.folder / "README.md").read_text()
    ratio = float(text.split(" times the formula's")[0].split()[-1])
    stimuli = load_set(SET)
    part = next(part for part in stimuli.stimuli if part.id == "step-050")
    point = choose_operating_point(stimuli, part, {"normal_load": 1.0})
    assert ratio == pytest.approx(
        predict_single_drag(part.counterface(), point).energy_over_formula, rel=1e-2
    )
