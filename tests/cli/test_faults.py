"""An internal error has an exit code of its own; what the disk refuses ends in one line."""

import csv
import errno
import os
from pathlib import Path

import numpy as np
import pytest

from stepblocks.cli import main
from stepblocks.cli.outcome import protect_outputs
from stepblocks.records.as_built import read_as_built

FOUR = str(Path(__file__).resolve().parents[2] / "stimuli" / "paper-four.toml")


def one_line(capsys):
    captured = capsys.readouterr()
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    return lines[0]


def test_an_internal_error_exits_with_70_and_keeps_its_details_in_a_file(
    monkeypatch, capsys, tmp_path
):
    def fail(*_):
        raise ZeroDivisionError("a\nb")

    monkeypatch.setattr("stepblocks.declaration.read.find_stimulus_files", fail)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["predict", FOUR]) == 70
    line = one_line(capsys)
    assert line.startswith(
        "stepblocks: internal error, not a verdict: ZeroDivisionError: a b (please send "
    )
    (kept,) = tmp_path.iterdir()
    assert str(kept) in line
    assert "Traceback" in kept.read_text()


def test_a_folder_that_is_read_only_is_named(monkeypatch, capsys, tmp_path):
    mkdir = Path.mkdir

    def refuse(path, *modes, **more):
        if tmp_path in path.parents:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        mkdir(path, *modes, **more)

    monkeypatch.setattr(Path, "mkdir", refuse)
    assert main(["predict", FOUR, "-o", str(tmp_path / "table.csv")]) == 2
    place = tmp_path / "table.csv"
    refusal = f"stepblocks: error: output cannot be written: Read-only file system [{place}]"
    assert one_line(capsys) == refusal


def test_a_file_where_a_folder_should_be_is_named(capsys, tmp_path):
    (tmp_path / "out").write_text("mine")
    assert main(["predict", FOUR, "-o", str(tmp_path / "out" / "table.csv")]) == 2
    assert "a folder must stand here, got a file" in one_line(capsys)
    assert (tmp_path / "out").read_text() == "mine"


GRID = (
    '[sweep]\nkind = "grid"\n[parameters]\nheight = "12 um"\nnormal_load = "0.3 N"\nfriction = '
    "0.1\n"
)
PLAN = (
    'schema = 1\nseed = 5\n[design]\nheights = ["20 um"]\nloads = ["0.4 N"]\nspeeds = ["5 '
    'mm/s"]\ntrials = 1\n'
)
SHEATHS = str(Path(FOUR).with_name("sheaths.toml"))
WRITERS = {
    "new": ["new", "block", "OUT/mine.toml"],
    "build": ["build", SHEATHS, "-o", "OUT", "--only", "sheath-hard", "--jobs", "1"],
    "workshop": ["workshop", SHEATHS, "-o", "OUT", "--only", "sheath-hard"],
    "predict": ["predict", FOUR, "-o", "OUT/table.csv"],
    "plots": ["predict", FOUR, "--plots", "OUT"],
    "drag": ["drag", "25 um", "--load", "0.5 N", "-o", "OUT"],
    "sweep": ["sweep", "IN/sweep.toml", "-o", "OUT"],
    "export": ["export", FOUR, "--for", "forcelaw", "-o", "OUT"],
    "feel": ["feel", FOUR, "-o", "OUT/feel.html", "--no-open"],
    "simulate-session": ["simulate-session", "IN/plan.toml", "-o", "OUT/session"],
    "study design": ["study", "design", FOUR, "--seed", "1", "-o", "OUT"],
}


@pytest.mark.parametrize("command", WRITERS)
def test_on_a_full_disk_every_command_ends_in_one_line_and_leaves_nothing(
    command, monkeypatch, capsys, tmp_path
):
    given, out = tmp_path / "in", tmp_path / "out"
    for folder in (given, out):
        folder.mkdir()
    (given / "sweep.toml").write_text(GRID)
    (given / "plan.toml").write_text(PLAN)

    def refuse(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", refuse)
    words = [word.replace("OUT", str(out)).replace("IN", str(given)) for word in WRITERS[command]]
    assert main([*words, "--quiet"]) == 2
    assert "No space left on device" in one_line(capsys)
    assert not [path for path in out.rglob("*") if path.is_file()]


@pytest.mark.parametrize("name", [b"\xff.csv", "µ.csv".encode(), b"-x.csv", b"a\nb.csv"])
def test_a_file_may_bear_any_name_that_the_system_knows(name, tmp_path, capsys):
    table = tmp_path / os.fsdecode(name)
    assert main(["predict", FOUR, "-o", str(table)]) == 0
    assert table.stat().st_size > 1000
    stimuli = table.with_suffix(".toml")
    stimuli.write_text(Path(FOUR).read_text(encoding="utf-8"))
    assert main(["predict", str(stimuli)]) == 0  # it names its set itself
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.repeats
@pytest.mark.parametrize("name", [b"\xff", b"a\nb", b"q'u\"o", b"-x"])
def test_a_scan_may_bear_any_name_and_its_record_is_read_back(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    x = np.arange(-200, 200)
    scan = Path(os.fsdecode(name) + ".csv")
    noise = np.random.default_rng(1).normal(0.0, 0.02, x.size)
    rows = "".join(
        f"{a},{b:.4f}\n" for a, b in zip(x, np.where(x > 0, 50.0, 0.0) + noise, strict=True)
    )
    for path in (scan, Path("other.csv")):
        path.write_text("x_um,z_um\n" + rows)
    asked = [
        "--standard",
        "50 um",
        "--tolerance",
        "1 um",
        "--feature",
        "edge",
        "--calibration",
        "0",
    ]
    out = Path(os.fsdecode(name) + "-out")
    assert main(["inspect", f"./{scan}", *asked, "-o", f"./{out}"]) == 0
    (record,) = out.glob("*.as-built.toml")
    assert read_as_built(record).height.value == pytest.approx(50e-6, abs=0.1e-6)
    assert main(["inspect", f"./{scan}", "other.csv", *asked, "-o", f"./{out}-many"]) == 0
    with (tmp_path / f"{out}-many" / "inspections.csv").open(newline="") as table:
        assert len(list(csv.reader(table))) == 3
    assert main(["drag", f"./{scan}", "-o", f"./{out}-drag"]) in (0, 1)
    assert main(["new", "block", f"./{out}.toml"]) == 0
    assert "Traceback" not in capsys.readouterr().err


def test_a_folder_that_is_not_there_is_made_for_a_table_as_for_a_report(tmp_path):
    assert main(["predict", FOUR, "-o", str(tmp_path / "none" / "table.csv")]) == 0
    assert (tmp_path / "none" / "table.csv").is_file()


def test_too_little_memory_is_no_internal_error(monkeypatch, capsys):
    def fail(*_):
        raise MemoryError

    monkeypatch.setattr("stepblocks.declaration.read.find_stimulus_files", fail)
    assert main(["predict", FOUR]) == 2
    assert one_line(capsys) == "stepblocks: error: this needs more memory than there is"


def test_what_a_build_that_failed_had_to_note_is_left_to_the_manifest_of_the_next_one(tmp_path):
    # the note said of a disturbed build what the next one says in its manifest, and an undisturbed
    # one left no note
    with protect_outputs([tmp_path], force=False):  # as far as it came
        (tmp_path / "part.step").write_text("part")
    assert "part.step" in (tmp_path / ".stepblocks.json").read_text()
    with protect_outputs([tmp_path], force=False):
        (tmp_path / "manifest.json").write_text('{"outputs": {"part.step": "its hash"}}')
    assert [path.name for path in tmp_path.iterdir() if path.name != "part.step"] == [
        "manifest.json"
    ]
