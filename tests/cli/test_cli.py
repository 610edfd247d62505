"""The command line answers at once and speaks in one line."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from stepblocks.cli import main

ROOT = Path(__file__).resolve().parents[2]
LIGHT = "import sys; from stepblocks.cli import main\ntry:\n    main(sys.argv[1:])\nexcept SystemExit: pass\n"


@pytest.mark.parametrize(
    "arguments", [["--help"], ["--version"], ["build", "--help"], ["build", "--jobs", "0"], ["nonsense"], []]
)
def test_help_and_usage_errors_import_nothing_heavy(arguments):
    code = (
        LIGHT
        + "print(sorted({'numpy', 'cadquery', 'OCP', 'pydantic', 'pyvista', 'matplotlib', 'scipy', 'pandas'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_every_command_has_help():
    done = subprocess.run([sys.executable, "-m", "stepblocks", "--help"], capture_output=True, text=True, check=True)
    commands = [
        line.split()[0]
        for line in done.stdout.split("commands:")[1].splitlines()
        if line.startswith("    ") and line[4] != " "
    ]
    assert {"build", "check", "predict"} <= set(commands) - {"COMMAND"}
    for command in sorted(set(commands) - {"COMMAND"}):
        text = subprocess.run(
            [sys.executable, "-m", "stepblocks", command, "--help"], capture_output=True, text=True, check=True
        )
        assert "usage: " in text.stdout


def test_check_names_the_artefact_that_is_wrong_and_exits_with_one(shipped_output, tmp_path, capsys):
    import shutil

    folder = tmp_path / "paper-ten" / "step-010"
    shutil.copytree(shipped_output / "paper-ten" / "step-010", folder)
    arguments = ["check", str(ROOT / "stimuli" / "paper-ten.toml"), "-o", str(tmp_path), "--only", "step-010"]
    assert main(arguments) == 0
    assert "artefacts, all within tolerance" in capsys.readouterr().out
    path = folder / "step-010.ply"
    path.write_bytes(path.read_bytes()[:-1])
    assert main(arguments) == 1
    assert "1 of 10 artefacts out of tolerance: paper-ten/step-010/step-010.ply" in capsys.readouterr().out
    assert main([*arguments, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["failed"] == ["paper-ten/step-010/step-010.ply"]


def test_predict_prints_a_table_and_writes_the_same_as_csv(tmp_path, capsys):
    source = str(ROOT / "stimuli" / "paper-four.toml")
    assert main(["predict", source]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:3] == ["set", "stimulus", "drag"]
    assert main(["predict", source, "-o", str(tmp_path / "table.csv")]) == 0
    assert len((tmp_path / "table.csv").read_text().splitlines()) == len(lines)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["build", "missing.toml"], "expected a stimulus file"),
        (["check", str(ROOT / "stimuli"), "-o", "no-such-folder"], "run stepblocks build first"),
        (["predict", "missing.toml"], "expected a stimulus file"),
    ],
)
def test_what_is_not_there_is_said_in_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_reader_that_has_seen_enough_gets_no_traceback():
    command = [sys.executable, "-m", "stepblocks", "predict", str(ROOT / "stimuli" / "paper-ten.toml")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 128 + signal.SIGPIPE


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["drag", "25 um", "--load", "1 m", "-o", "{}"], "--load must be a force such as '0.5 N', got '1 m'"),
        (["drag", "25 um", "--handle-mass", "1", "-o", "{}"], "--handle-mass must be a mass such as '3 g', got '1'"),
        (["drag", "25 um", "--pull", "0 N", "-o", "{}"], "--pull must be positive, got 0 N"),
        (
            ["export", "--for", "x3d", "--tip-radius", "1 N", "-o", "{}"],
            "--tip-radius: must be a length such as '25 um'",
        ),
        (["inspect", "s.csv", "--stimulus", "a", "--resolution", "1"], "must be a length such as '25 um', got '1'"),
        (["inspect", "s.csv", "--standard", "1 N"], "must be a length such as '25 um', got '1 N'"),
    ],
)
def test_a_quantity_that_cannot_be_read_is_said_with_its_option_before_anything_is_done(
    arguments, said, tmp_path, capsys
):
    place = tmp_path / "new"
    assert main([word.format(place) for word in arguments]) == 2
    assert f"stepblocks: error: {said}" in capsys.readouterr().err
    assert not place.exists()
