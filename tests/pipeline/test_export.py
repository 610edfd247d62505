"""``stepblocks export`` writes folders that stand alone, and refuses in one line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from stepblocks.cli import main
from stepblocks.cli.export import _SIMULATORS
from stepblocks.haptics.scenes.registry import SCENE_FORMATS

ROOT = Path(__file__).resolve().parents[2]
SET = str(ROOT / "stimuli" / "paper-ten.toml")


def test_the_command_line_offers_every_simulator():
    assert tuple(SCENE_FORMATS) == _SIMULATORS


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
    folder = tmp_path / "my scenes" / "paper-ten" / "step-030" / "forcelaw"
    elsewhere = tmp_path / "else where"
    elsewhere.mkdir()
    done = subprocess.run([sys.executable, "-I", "-S", os.path.relpath(folder / "force_law.py", elsewhere)],
                          cwd=elsewhere, capture_output=True, text=True, check=True)  # fmt: skip
    peak, formula = float(done.stdout.split()[1]), float(done.stdout.split()[4])
    assert peak == pytest.approx(formula, rel=5e-3)
    assert json.loads((folder / "event.json").read_text())["scale"] > 1.0


def test_files_of_the_user_survive_a_second_export(tmp_path):
    arguments = ["export", SET, "--for", "x3d", "-o", str(tmp_path), "--only", "step-010"]
    assert main(arguments) == 0
    folder = tmp_path / "paper-ten" / "step-010" / "x3d"
    (folder / "notes.txt").write_text("mine")
    assert main(arguments) == 0
    assert (folder / "notes.txt").read_text() == "mine"
    assert not list(folder.parent.glob(".partial*"))


def test_parts_without_a_profile_are_named_not_written(tmp_path, capsys):
    crowns = str(ROOT / "stimuli" / "crown-margins.toml")
    assert main(["export", crowns, "--for", "x3d", "-o", str(tmp_path), "--only", "crown-feather"]) == 0
    out = capsys.readouterr().out
    assert "not a block" in out
    assert "0 folders" in out


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (["--device", "joystick"], "device must be one of touch"),
        (["--only", "nothing"], "--only must match"),
        (["--load", "3"], "--load: must be a force"),
        (["--load", "-1 N"], "normal_load must be positive"),
        (["--friction", "slippery"], "--friction"),
        (["--scale", "0"], "scale must be positive"),
        (["--devices", "missing.toml"], "cannot be read"),
    ],
)
def test_wrong_input_is_one_line(extra, message, tmp_path, capsys):
    assert main(["export", SET, "--for", "usd", "-o", str(tmp_path), *extra]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
