"""The command line answers at once and speaks in one line."""

import ast
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

from stepblocks.cli import main, make_root_command

ROOT = Path(__file__).resolve().parents[2]
HEAVY = {"numpy", "cadquery", "OCP", "pyvista", "matplotlib", "scipy", "pandas"}
LIGHT = (
    "import sys; from stepblocks.cli import main; main(sys.argv[1:])\n"
    "print(sorted(set(sys.modules)))"
)


def modules_after(*arguments):
    done = subprocess.run(
        [sys.executable, "-c", LIGHT, *arguments], capture_output=True, text=True, check=True
    )
    return set(ast.literal_eval(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["--version"], ["build", "--help"], ["build", "--jobs", "0"], ["nonsense"], []],
)
def test_help_and_wrong_options_import_nothing_heavy(arguments):
    assert not HEAVY & modules_after(*arguments)


def leaves(command, words=("stepblocks",)):
    """Every command that runs, with its words."""
    children = getattr(command, "commands", {})
    if not children:
        yield " ".join(words), command
    for word, child in children.items():
        yield from leaves(child, (*words, word))


EVERY = dict(leaves(make_root_command()))


def parse(command, words):
    """Let a command read its options, without running it."""
    return EVERY[command].make_context(command, list(words)).params


@pytest.mark.parametrize("command", EVERY)
def test_every_command_has_help_with_examples_that_parse_and_takes_what_all_take(
    command, capsys, monkeypatch, tmp_path
):
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").touch()  # what the examples read, where an option says that it must be there
    name = command.removeprefix("stepblocks ")
    assert main([*name.split(), "--help"]) == 0
    help_text = capsys.readouterr().out
    assert f"Usage: {command}" in help_text
    assert max(map(len, help_text.splitlines())) <= 100
    assert "list[" not in help_text  # a type of Python's
    options = {name for one in EVERY[command].params for name in one.opts}
    assert {"--quiet", "--json", "--wide", "--force"} <= options
    examples = [line.strip() for line in EVERY[command].epilog.splitlines()[1:]]
    assert examples
    for line in examples:
        assert line.startswith(command)
        assert line in help_text
        parse(command, shlex.split(line.partition(">")[0])[len(command.split()) :])


def test_the_help_shows_every_command_in_a_group(capsys):
    assert main([]) == 2
    assert "Missing command" in capsys.readouterr().err
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"│ {name} " in text for name in make_root_command().commands)
    assert "─ Commands " not in text
    assert main(["help", "study", "power"]) == 0
    assert "Usage: stepblocks study power" in capsys.readouterr().out
    assert main(["help", "nonsense"]) == 2


def test_an_option_of_several_values_takes_them_in_a_row_or_is_repeated():
    several = [Path("a"), Path("b")]
    for words in (["--as-built", "a", "b"], ["--as-built", "a", "--as-built", "b"]):
        assert parse("stepblocks loop", ["s", *words])["as_built"] == several
        taken = parse("stepblocks loop", ["s", *words, "--jobs", "2", "-o", "x"])
        assert (taken["as_built"], taken["jobs"], taken["output"]) == (several, 2, Path("x"))
    taken = parse("stepblocks study analyse", ["--data", "a", "b", "--json"])
    assert (taken["data"], taken["folder"], taken["as_json"]) == (several, None, True)
    taken = parse("stepblocks loop", ["--as-built", "a", "--", "b"])
    assert (taken["as_built"], taken["session"]) == ([Path("a")], [Path("b")])


def test_an_option_may_stand_without_its_value_where_the_help_says_so():
    assert parse("stepblocks new", ["--shipped"])["shipped"] == Path("stimuli")
    assert parse("stepblocks new", ["--shipped", "--force"])["shipped"] == Path("stimuli")
    assert parse("stepblocks new", ["--shipped", "mine"])["shipped"] == Path("mine")
    assert parse("stepblocks new", ["crown"])["shipped"] is None


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["bild"], "Did you mean 'build'?"),
        (["build", "--quite"], "(Possible options: --quiet"),
        (["study", "desing"], "Did you mean 'design'?"),
        (["export", "--for", "x3d", "--tip-radios", "1 um"], "(Possible options: --tip-radius)"),
        (["build", "--jobs", "0"], "(see stepblocks build --help)"),
        (["build", "-o"], "-o needs a value (see stepblocks build --help)"),
        (["build", "-o", "--json"], "needs a value (see stepblocks build --help)"),
        (["export", "--for", "nonsense"], "'nonsense' is not one of 'mujoco'"),
        (
            ["export"],
            "one of --for or --list-devices must be given, got none; begin with: stepblocks export",
        ),
        (["export", "--for", "usd", "--list-devices"], "must be given, got 2"),
        (["export", "--for", "usd", "--scale", "x"], "must be a ratio such as '0.15', got 'x'"),
        (["drag", "25 um", "--speed", "1 mm/s", "--pull", "1 N"], "exclude each other"),
        (["inspect", "s", "--stimulus", "a", "--standard", "1 um"], "exclude each other"),
        (["new"], "one of KIND or --shipped must be given, got none; begin with: stepblocks new"),
        (["study"], "Missing command (see stepblocks study --help)"),
    ],
)
def test_a_slip_of_the_pen_is_answered_in_one_line(words, said, capsys):
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("stepblocks: error: ")
    assert error.count("\n") == 1
    assert said in error


@pytest.mark.repeats
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_commands_and_options(shell, capsys):
    assert main(["completion", shell]) == 0
    assert "_STEPBLOCKS_COMPLETE=complete_" in capsys.readouterr().out

    def complete(line):
        environment = {
            "_STEPBLOCKS_COMPLETE": f"complete_{shell}",
            "COMP_WORDS": line,
            "COMP_CWORD": str(len(line.split(" ")) - 1),
            "_TYPER_COMPLETE_ARGS": line,
            "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        }
        done = subprocess.run(
            [sys.executable, "-m", "stepblocks"],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout

    assert "simulate-session" in complete("stepblocks s")
    assert "--tip-radius" in complete("stepblocks export --ti")
    assert "forcelaw" in complete("stepblocks export --for f")
    assert "estimates" in complete("stepblocks study design --experiment e")


@pytest.mark.parametrize("name", ["Mein Satz ü.toml", "con.toml", "2nd.toml"])
@pytest.mark.parametrize("kind", ["block", "study"])
def test_a_file_to_begin_with_is_valid_whatever_its_name(tmp_path, monkeypatch, capsys, kind, name):
    monkeypatch.chdir(tmp_path)
    assert main(["new", kind, name]) == 0
    command = capsys.readouterr().out.partition("then run: ")[2]
    assert shlex.split(command)[-1] in (name, "out/study")
    assert name in shlex.split(command)
    assert main(["predict", name]) == 0


@pytest.mark.parametrize("option", ["-o", "--perception"])
def test_what_a_command_reads_is_never_replaced_by_what_it_writes(tmp_path, capsys, option):
    # not with --force either, and not where the file is as another command wrote it
    source = tmp_path / "mine.toml"
    assert main(["new", "block", str(source)]) == 0
    before = source.read_bytes()
    capsys.readouterr()
    assert main(["predict", str(source), option, f"{tmp_path}/./mine.toml", "--force"]) == 2
    assert "output must not replace what the command reads" in capsys.readouterr().err
    assert source.read_bytes() == before


def test_no_output_of_a_command_replaces_a_file_of_somebody_else(tmp_path, capsys):
    source, pairs = str(ROOT / "stimuli" / "paper-four.toml"), tmp_path / "pairs.csv"
    pairs.write_text("mine")
    command = ["predict", source, "--perception", str(pairs)]
    assert main(command) == 2
    assert "is not ours" in capsys.readouterr().err
    assert pairs.read_text() == "mine"
    assert main([*command, "-o", str(pairs), "--force"]) == 2
    assert "--perception must be another file than --output" in capsys.readouterr().err
    assert main([*command, "--force"]) == 0
    assert main(command) == 0  # ours by now


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


@pytest.mark.long
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


def test_a_table_without_a_suffix_is_written_and_written_again(tmp_path, capsys):
    table = tmp_path / "rows.csv"
    table.write_text("height_um,normal_load_n,friction\n25,0.5,0.15\n")
    for _ in range(2):
        assert main(["predict", str(table), "-o", str(tmp_path / "out" / "felt")]) == 0
        assert "felt: 1 prediction\n" in capsys.readouterr().out
    assert "vibration_energy_uj" in (tmp_path / "out" / "felt").read_text()
    (tmp_path / "out" / "felt").write_text("filled in by hand\n")
    assert main(["predict", str(table), "-o", str(tmp_path / "out" / "felt")]) == 2
    assert (tmp_path / "out" / "felt").read_text() == "filled in by hand\n"


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
    # three digits, wherever the column stands
    assert f"{float(table[0]['peak_force_n']):.3g}" in shown[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["build", "missing.toml"], "expected a stimulus file"),
        (["check", str(ROOT / "stimuli"), "-o", "no-such-folder"], "run stepblocks build first"),
        (["predict", "missing.toml"], "expected a stimulus file"),
        (["sweep", "swep.toml"], "did you mean sweep.toml? [swep.toml]"),
        (["sweep", "goon/s.toml"], "did you mean gone? [goon/s.toml]"),
    ],
)
def test_what_is_not_there_is_said_in_one_line(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("sweep.toml").touch()
    Path("gone").mkdir()
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.repeats
@pytest.mark.parametrize(
    "words", [["predict", str(ROOT / "stimuli" / "paper-ten.toml")], ["help", "predict"], ["-h"]]
)
def test_a_reader_that_has_seen_enough_gets_no_traceback(words):
    command = [sys.executable, "-m", "stepblocks", *words]
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
    assert f"error: {option}: {said}" in error
    assert not place.exists()


def test_the_shipped_stimuli_are_copied_whole_and_nobodys_are_replaced(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "--shipped"]) == 0
    shipped = sorted((ROOT / "stimuli").glob("*.toml"))
    summary = f"{len(shipped)} files in stimuli: stepblocks build stimuli"
    assert summary in capsys.readouterr().out
    assert [path.name for path in sorted(Path("stimuli").iterdir())] == [
        path.name for path in shipped
    ]
    assert all((Path("stimuli") / path.name).read_bytes() == path.read_bytes() for path in shipped)
    Path("mine").mkdir()
    Path("mine/sheaths.toml").write_text("mine", encoding="utf-8")
    assert main(["new", "--shipped", "mine"]) == 2
    assert (
        "there is one already; --force replaces it [mine/sheaths.toml]" in capsys.readouterr().err
    )
    assert [path.name for path in Path("mine").iterdir()] == ["sheaths.toml"]
    assert main(["new", "--shipped", "mine", "--force"]) == 0


@pytest.mark.parametrize(
    "words", ["new block .", "new block /", "feel paper-four.toml --no-open -o ."]
)
def test_a_folder_where_a_file_is_to_be_written_is_reported_in_one_line(
    words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "stimuli" / "paper-four.toml", tmp_path)
    assert main(words.split()) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["paper-four.toml"]
