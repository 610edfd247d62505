"""The command line answers at once and speaks in one line."""

import csv
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from stepblocks.cli import main, make_parser

ROOT = Path(__file__).resolve().parents[2]
LIGHT = (
    "import sys; from stepblocks.cli import main\ntry:\n    main(sys.argv[1:])\nexcept "
    "SystemExit: pass\n"
)


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["--version"], ["build", "--help"], ["build", "--jobs", "0"], ["nonsense"], []],
)
def test_help_and_usage_errors_import_nothing_heavy(arguments):
    code = (
        LIGHT + "print(sorted({'numpy', 'cadquery', 'OCP', 'pydantic', 'pyvista', 'matplotlib', "
        "'scipy', 'pandas'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"


def leaves(parser):
    if not parser.commands:
        yield parser
    for one in parser.commands.values():
        yield from leaves(one)


EVERY = {parser.prog: parser for parser in leaves(make_parser())}


@pytest.mark.parametrize("command", EVERY)
def test_every_command_has_help_with_examples_that_parse_and_takes_what_all_take(command):
    parser, help_text = EVERY[command], EVERY[command].format_help()
    assert "usage: " in help_text
    assert max(map(len, help_text.splitlines())) <= 100
    assert {"--quiet", "--json", "--wide", "--force"} <= set(parser._option_string_actions)
    examples = [line.strip() for line in parser.epilog.splitlines()[1:]]
    assert examples
    for line in examples:
        words = shlex.split(line.partition(">")[0])
        assert line.startswith(command)
        make_parser().parse_args(words[1:])


def test_the_help_shows_every_command_in_a_group():
    text = make_parser().format_help()
    assert all(f"\n  {name} " in text for name in make_parser().commands)
    assert "more:" not in text
    words = [
        line.split()[-2:]
        for line in subprocess.run(
            [sys.executable, "-m", "stepblocks", "help", "study", "power"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()[:1]
    ]
    assert words


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["bild"], "did you mean build?"),
        (["build", "--quite"], "did you mean --quiet?"),
        (["study", "desing"], "did you mean design?"),
        (["export", "--for", "x3d", "--tip-radios", "1 um"], "did you mean --tip-radius?"),
        (["build", "--jobs", "0"], "see stepblocks build --help"),
    ],
)
def test_a_slip_of_the_pen_is_answered_in_one_line_with_what_was_meant(
    words, meant, capsys, monkeypatch
):
    monkeypatch.setattr(sys, "argv", ["stepblocks", *words])
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert meant in error


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion_knows_commands_and_options(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(word in script for word in ("simulate-session", "--tip-radius", "--list-devices"))


def test_a_file_of_ours_is_replaced_one_that_somebody_changed_is_not(tmp_path, capsys):
    source, table = str(ROOT / "stimuli" / "paper-four.toml"), tmp_path / "table.csv"
    command = ["predict", source, "-o", str(table)]
    table.write_text("mine")
    assert main(command) == 2
    assert "is not ours" in capsys.readouterr().err
    assert table.read_text() == "mine"
    assert main([*command, "--force"]) == 0
    ours = table.read_bytes()
    assert main(command) == 0
    table.write_bytes(ours + b"my own row\n")
    assert main(command) == 2
    assert table.read_bytes() == ours + b"my own row\n"


def test_a_foreign_file_in_an_output_folder_is_kept_and_named(tmp_path, capsys):
    (tmp_path / "drag.json").write_text("mine")
    assert main(["drag", "25 um", "--load", "0.5 N", "-o", str(tmp_path)]) == 2
    assert "drag.json" in capsys.readouterr().err
    assert (tmp_path / "drag.json").read_text() == "mine"


def test_tables_fit_a_hundred_columns_and_say_what_they_leave_out(capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    source = str(ROOT / "stimuli" / "paper-ten.toml")
    assert main(["predict", source]) == 0
    printed = capsys.readouterr()
    assert max(map(len, printed.out.splitlines())) <= 100
    assert "more columns: --wide" in printed.err
    assert "e+0" not in printed.out
    assert main(["predict", source, "--wide"]) == 0
    assert "intervals" in capsys.readouterr().out


def test_json_and_quiet_are_taken_at_their_word(tmp_path, capsys):
    source = str(ROOT / "stimuli" / "paper-four.toml")
    assert main(["predict", source, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["predictions"][0]["stimulus"] == "apparatus-025"
    assert main(["predict", source, "-o", str(tmp_path / "t.csv"), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert main(["export", "--list-devices", "--json"]) == 0
    assert "omega-3" in {one["device"] for one in json.loads(capsys.readouterr().out)["devices"]}


def test_colour_is_for_terminals_and_never_where_it_is_not_wanted():
    command = [sys.executable, "-m", "stepblocks", "export", "--list-devices"]
    shown = {
        name: subprocess.run(
            command, env={**os.environ, **extra}, capture_output=True, text=True, check=True
        ).stdout
        for name, extra in (
            ("plain", {}),
            ("forced", {"FORCE_COLOR": "1"}),
            ("not", {"NO_COLOR": "1"}),
        )
    }
    assert "\x1b[" not in shown["plain"] + shown["not"]
    assert "\x1b[" in shown["forced"]


def test_check_names_the_artefact_that_is_wrong_and_exits_with_one(
    shipped_output, tmp_path, capsys
):
    folder = tmp_path / "paper-ten" / "step-010"
    shutil.copytree(shipped_output / "paper-ten" / "step-010", folder)
    arguments = [
        "check",
        str(ROOT / "stimuli" / "paper-ten.toml"),
        "-o",
        str(tmp_path),
        "--only",
        "step-010",
    ]
    assert main(arguments) == 0
    assert "artefacts, all within tolerance" in capsys.readouterr().out
    path = folder / "step-010.ply"
    path.write_bytes(path.read_bytes()[:-1])
    assert main(arguments) == 1
    assert re.search(
        "1 of [0-9]+ artefacts out of tolerance: paper-ten/step-010/step-010.ply",
        capsys.readouterr().out,
    )
    assert main([*arguments, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["failed"] == ["paper-ten/step-010/step-010.ply"]


def test_predict_prints_a_table_and_writes_the_same_as_csv(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    source = str(ROOT / "stimuli" / "paper-four.toml")
    assert main(["predict", source]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "drag up" in lines[0]
    assert main(["predict", source, "-o", str(tmp_path / "table.csv")]) == 0
    table = list(csv.DictReader((tmp_path / "table.csv").read_text().splitlines()))
    shown = [line.split() for line in lines if line.startswith("apparatus")]
    assert [line[0] for line in shown] == [row["stimulus"] for row in table]
    assert (
        f"{float(table[0]['pull_force_n']):.3g}" in shown[0]
    )  # three digits, wherever the column stands


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
    command = [
        sys.executable,
        "-m",
        "stepblocks",
        "predict",
        str(ROOT / "stimuli" / "paper-ten.toml"),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 128 + signal.SIGPIPE


@pytest.mark.parametrize(
    ("arguments", "option", "said"),
    [
        (
            ["drag", "25 um", "--load", "1 m"],
            "--load",
            "must be a force such as '0.5 N', got '1 m'",
        ),
        (
            ["drag", "25 um", "--handle-mass", "1"],
            "--handle-mass",
            "must be a mass such as '3 g', got '1'",
        ),
        (["drag", "25 um", "--pull", "0 N"], "--pull", "must be positive, got 0 N"),
        (
            ["export", "--for", "x3d", "--tip-radius", "1 N"],
            "--tip-radius",
            "must be a length such as '25 um'",
        ),
        (
            ["inspect", "s.csv", "--stimulus", "a", "--resolution", "1"],
            "--resolution",
            "must be a length such as",
        ),
        (
            ["inspect", "s.csv", "--standard", "1 N"],
            "--standard",
            "must be a length such as '25 um', got '1 N'",
        ),
    ],
)
def test_a_quantity_that_cannot_be_read_is_said_with_its_option_before_anything_is_done(
    arguments, option, said, tmp_path, capsys
):
    place = tmp_path / "new"
    assert main([*arguments, "-o", str(place)]) == 2
    error = capsys.readouterr().err
    assert f"argument {option}: {said}" in error
    assert not place.exists()


def test_the_shipped_stimuli_are_copied_whole_and_nobodys_are_replaced(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "--shipped"]) == 0
    assert "6 files in stimuli: stepblocks build stimuli" in capsys.readouterr().out
    shipped = sorted((ROOT / "stimuli").glob("*.toml"))
    assert [path.name for path in sorted(Path("stimuli").iterdir())] == [
        path.name for path in shipped
    ]
    assert all((Path("stimuli") / path.name).read_bytes() == path.read_bytes() for path in shipped)
    Path("mine").mkdir()
    Path("mine/sheaths.toml").write_text("mine")
    assert main(["new", "--shipped", "mine"]) == 2
    assert (
        "there is one already; --force replaces it [mine/sheaths.toml]" in capsys.readouterr().err
    )
    assert [path.name for path in Path("mine").iterdir()] == ["sheaths.toml"]
    assert main(["new", "--shipped", "mine", "--force"]) == 0


@pytest.mark.parametrize(
    "words", ["new block .", "new block /", "feel paper-four.toml --no-open -o ."]
)
def test_a_folder_where_a_file_is_to_be_written_is_told_in_one_line(
    words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "stimuli" / "paper-four.toml", tmp_path)
    assert main(words.split()) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["paper-four.toml"]
