"""A file is whole or it is the one that was there before; what a killed run left goes."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from stepblocks.atomic import beside, replace_text


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_failure_leaves_the_old_file_and_no_draft(tmp_path):
    target = tmp_path / "table.csv"
    target.write_text("old")

    def write():
        with beside(target) as draft:
            draft.write_text("half")
            raise RuntimeError("disk")

    with pytest.raises(RuntimeError, match="disk"):
        write()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["table.csv"]


def test_two_writers_of_one_file_never_share_a_draft(tmp_path):
    target = tmp_path / "table.csv"
    with beside(target) as first, beside(target) as second:
        assert first != second
        first.write_text("one")
        second.write_text("two")
    assert target.read_text() == "one"


def test_a_killed_writer_leaves_the_old_file(tmp_path):
    target = tmp_path / "table.csv"
    target.write_text("old")
    code = f"""
        import os, signal
        from pathlib import Path
        from stepblocks.atomic import beside
        with beside(Path({str(target)!r})) as draft:
            draft.write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
    """
    assert subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=False).returncode == -9
    assert target.read_text() == "old"
    assert len(names(tmp_path)) == 2


def test_drafts_of_dead_runs_are_swept_and_those_of_the_living_stay(tmp_path):
    target = tmp_path / "[odd] name*.csv"
    stale, fresh = (tmp_path / f".partial-{word}-{target.name}" for word in ("stale", "fresh"))
    other = tmp_path / ".partial-stale-other.csv"
    for path in (stale, fresh, other):
        path.write_text("half")
    for path in (stale, other):
        os.utime(path, (0, 0))
    replace_text(target, "whole")
    assert names(tmp_path) == sorted([target.name, fresh.name, other.name])


def test_what_is_renamed_has_reached_the_disk(tmp_path, monkeypatch):
    done = []
    fsync, replace = os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda number: (done.append("sync"), fsync(number)))
    monkeypatch.setattr(Path, "replace", lambda self, to: (done.append("rename"), replace(self, to))[1])
    replace_text(tmp_path / "a.txt", "text")
    assert done == ["sync", "rename", "sync"]
