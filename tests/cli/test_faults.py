"""A crash is not a verdict: what nobody foresaw ends with a code of its own, what the disk refuses with one line."""

import errno
import os
from pathlib import Path

import pytest

from stepblocks.cli import main

FOUR = str(Path(__file__).resolve().parents[2] / "stimuli" / "paper-four.toml")


def one_line(capsys):
    captured = capsys.readouterr()
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    return lines[0]


def test_a_fault_of_ours_exits_with_70_and_keeps_its_details_in_a_file(monkeypatch, capsys, tmp_path):
    def fail(*_):
        raise ZeroDivisionError("a\nb")

    monkeypatch.setattr("stepblocks.select.stimulus_files", fail)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["predict", FOUR]) == 70
    line = one_line(capsys)
    assert line.startswith("stepblocks: a fault of ours, not a verdict: ZeroDivisionError: a b (please send ")
    (kept,) = tmp_path.iterdir()
    assert str(kept) in line
    assert "Traceback" in kept.read_text()


@pytest.mark.parametrize(
    ("number", "words"), [(errno.ENOSPC, "No space left on device"), (errno.EROFS, "Read-only file system")]
)
def test_what_the_disk_refuses_is_said_in_one_line(number, words, monkeypatch, capsys, tmp_path):
    def refuse(_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", refuse)
    assert main(["predict", FOUR, "-o", str(tmp_path / "table.csv")]) == 2
    assert words in one_line(capsys)
    assert list(tmp_path.iterdir()) == []


def test_a_file_where_a_folder_should_be_is_named(capsys, tmp_path):
    (tmp_path / "out").write_text("mine")
    assert main(["predict", FOUR, "-o", str(tmp_path / "out" / "table.csv")]) == 2
    assert "Not a directory" in one_line(capsys)
    assert (tmp_path / "out").read_text() == "mine"


def test_too_little_memory_is_no_fault_of_ours(monkeypatch, capsys):
    def fail(*_):
        raise MemoryError

    monkeypatch.setattr("stepblocks.select.stimulus_files", fail)
    assert main(["predict", FOUR]) == 2
    assert one_line(capsys) == "stepblocks: error: this needs more memory than there is"
