"""A file is whole or it is the one that was there before; what a killed run left goes."""

import errno
import os
import stat
import subprocess
import sys
import textwrap
from pathlib import Path

import filelock
import pytest

from stepblocks.cli import main
from stepblocks.errors import PipelineError
from stepblocks.files import atomic, paths
from stepblocks.files.atomic import (
    _remove_stale_drafts,
    lock_folder,
    replace_text,
    write_atomically,
)
from stepblocks.files.locks import LockState, try_lock


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_failure_leaves_the_old_file_and_no_draft(tmp_path):
    target = tmp_path / "table.csv"
    target.write_text("old")

    def write():
        with write_atomically(target) as draft:
            draft.write_text("half")
            raise RuntimeError("disk")

    with pytest.raises(RuntimeError, match="disk"):
        write()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["table.csv"]


def test_two_writers_of_one_file_never_share_a_draft(tmp_path):
    target = tmp_path / "table.csv"
    with write_atomically(target) as first, write_atomically(target) as second:
        assert first != second
        first.write_text("one")
        second.write_text("two")
    assert target.read_text() == "one"


def test_a_draft_swept_before_it_was_locked_is_made_again(tmp_path, monkeypatch):
    # two workers come to a new folder at once: one sweeps what the other has made and not locked
    swept, really_lock = [], atomic.try_lock

    def lock_late(file):
        if not swept:
            swept.append(file)
            _remove_stale_drafts(tmp_path)
            assert not file.parent.exists()
        return really_lock(file)

    monkeypatch.setattr(atomic, "try_lock", lock_late)
    replace_text(tmp_path / "table.csv", "whole")
    assert (tmp_path / "table.csv").read_text() == "whole"
    assert names(tmp_path) == ["table.csv"]


def killed_while_writing(target):
    code = f"""
        import os, signal
        from pathlib import Path
        from stepblocks.files.atomic import write_atomically
        with write_atomically(Path({str(target)!r})) as draft:
            draft.write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)
    """
    assert (
        subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=False).returncode == -9
    )


def test_a_killed_writer_leaves_the_old_file_and_the_next_one_sweeps_its_draft(tmp_path):
    target = tmp_path / "[odd] name*.csv"
    target.write_text("old")
    killed_while_writing(target)
    assert target.read_text() == "old"
    assert len(names(tmp_path)) == 2
    replace_text(target, "whole")
    assert target.read_text() == "whole"
    assert names(tmp_path) == [target.name]


def test_live_drafts_are_kept_and_other_files_named_like_drafts_are_not_followed(
    tmp_path,
):
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "kept.txt").write_text("kept")
    output = tmp_path / "out"
    output.mkdir()
    (output / ".partial-link").symlink_to(theirs)
    with write_atomically(output / "x.csv") as ours:
        ours.write_text("half")
        killed_while_writing(output / "y.csv")
        held = names(output)
        with lock_folder(output):
            assert set(names(output)) - {".stepblocks.lock"} < set(held)
            assert ours.read_text() == "half"
    assert names(output) == [".partial-link", "x.csv"]
    assert (theirs / "kept.txt").read_text() == "kept"


SWEEP = (
    '[sweep]\nkind = "grid"\n[parameters]\nheight = "12 um"\nnormal_load = "0.3 N"\nfriction = '
    "0.1\n"
)
SESSION = """schema = 1
[probe]
spring_constant = "9810 N/m"
tip_radius = "125 um"
[acquisition]
sample_rate = "10 kHz"
traces = "{trial}.csv"
channels = { tangential = "x", normal = "y" }
"""


@pytest.mark.parametrize("command", ["build", "sweep", "loop", "several", "workshop"])
def test_one_run_holds_an_output_folder_and_a_second_is_refused(command, tmp_path, capsys):
    stimuli = str(Path(__file__).parents[2] / "stimuli" / "sheaths.toml")
    (tmp_path / "s.toml").write_text(SWEEP)
    for session in ("a", "b"):
        (tmp_path / session).mkdir()
        (tmp_path / session / "session.toml").write_text(SESSION)
        (tmp_path / session / "trials.csv").write_text(
            "trial,speed_mm_s,load_n,block,height_um\n1,2,0.5,a,20\n"
        )
    a, b = str(tmp_path / "a"), str(tmp_path / "b")
    files = {
        "build": [stimuli],
        "sweep": [str(tmp_path / "s.toml")],
        "loop": [a],
        "several": [a, b],
        "workshop": [stimuli],
    }
    output = tmp_path / "out"
    name = "loop" if command == "several" else command
    with lock_folder(output):
        assert main([name, *files[command], "-o", str(output)]) == 2
        assert names(output) == [".stepblocks.lock"]
    assert not output.exists()
    said = capsys.readouterr().err
    assert "another run is writing into this folder" in said
    assert str(output) in said


def test_a_run_that_is_refused_leaves_no_folder_that_was_not_there(tmp_path):
    for there in (False, True):
        output = tmp_path / "out"
        if there:
            output.mkdir()

        def refuse(output=output):
            with lock_folder(output):
                raise PipelineError("k is ten times too large")

        with pytest.raises(PipelineError, match="ten times"):
            refuse()
        assert output.exists() == there


def test_what_is_renamed_has_reached_the_disk(tmp_path, monkeypatch):
    done = []
    fsync, replace = os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda number: (done.append("sync"), fsync(number)))
    monkeypatch.setattr(
        Path, "replace", lambda self, to: (done.append("rename"), replace(self, to))[1]
    )
    replace_text(tmp_path / "a.txt", "text")
    assert done == ["sync", "rename", "sync"]


def test_a_pipe_named_like_a_draft_is_never_waited_for(tmp_path):
    """Opening a pipe that nobody writes to would sleep for ever."""
    os.mkfifo(tmp_path / ".partial-0123456789abcdef")
    script = "import sys, pathlib; from stepblocks.files.atomic import make_draft_folder\n"
    script += "with make_draft_folder(pathlib.Path(sys.argv[1])): print('made')"
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=True,
        timeout=120.0,
    )
    assert done.stdout == "made\n"


def test_a_lock_is_free_again_once_its_file_was_removed_by_its_holder(tmp_path):
    file = tmp_path / "lock"
    for _ in range(3):
        with try_lock(file) as first, try_lock(file) as second:
            assert (first, second) == (LockState.OURS, LockState.TAKEN)
        assert names(tmp_path) == []


def test_a_file_system_without_locks_is_written_to_all_the_same(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(filelock.FileLock, "acquire", refuse)
    with lock_folder(tmp_path / "out"):
        replace_text(tmp_path / "out" / "a.txt", "text")
    assert names(tmp_path / "out") == ["a.txt"]


def test_a_rename_that_windows_refuses_for_a_moment_is_tried_again(tmp_path, monkeypatch):
    attempts, really_replace = [], Path.replace

    def replace_late(path, target):
        attempts.append(path)
        if len(attempts) < 3:
            raise PermissionError(errno.EACCES, "The process cannot access the file")
        return really_replace(path, target)

    monkeypatch.setattr(atomic, "_SYSTEM_SHARES_OPEN_FILES", False)
    monkeypatch.setattr(atomic, "_RENAME_PAUSE", 0.0)
    monkeypatch.setattr(Path, "replace", replace_late)
    replace_text(tmp_path / "a.txt", "text")
    assert len(attempts) == 3
    assert (tmp_path / "a.txt").read_text() == "text"


def test_a_path_that_is_too_long_for_windows_is_called_so(tmp_path, monkeypatch):
    # Windows answers "not found"; 260 characters are one too many (MAX_PATH counts a closing zero)
    monkeypatch.setattr(paths, "_SYSTEM_HAS_SHORT_PATHS", True)
    folder = tmp_path / ("a" * (259 - len(str(tmp_path)))) / "x"
    error = FileNotFoundError(errno.ENOENT, "The system cannot find the path specified")
    words = paths.describe_system_error(error, folder.parent)
    assert words == f"a path must have at most 259 characters on Windows, got {260}; " + (
        "choose a folder nearer to the root of the drive"
    )
    assert paths.describe_system_error(error, tmp_path / "x") == error.strerror


@pytest.mark.parametrize("kind", ["pipe", "link", "device"])
def test_a_table_never_takes_the_place_of_a_device_or_a_pipe(kind, tmp_path, capsys):
    node = tmp_path / "node"
    try:
        mode = (stat.S_IFCHR if kind == "device" else stat.S_IFIFO) | 0o600
        os.mknod(node, mode, os.makedev(1, 3) if kind == "device" else 0)
    except PermissionError:
        pytest.skip("only root makes devices")
    target = node
    if kind == "link":
        target = tmp_path / "link"
        target.symlink_to(node)
    before = names(tmp_path)
    four = Path(__file__).parents[2] / "stimuli" / "paper-four.toml"
    assert main(["predict", str(four), "-o", str(target)]) == 2
    said = capsys.readouterr().err
    assert f"output must be a plain file, got a device, a pipe or a socket [{target}]" in said
    assert said.count("\n") == 1
    assert target.is_symlink() == (kind == "link")
    assert stat.S_IFMT(node.lstat().st_mode) == stat.S_IFMT(mode)
    assert names(tmp_path) == before


def test_a_link_to_a_plain_file_is_written_as_before(tmp_path):
    old = tmp_path / "old.csv"
    old.write_text("old")
    (tmp_path / "link").symlink_to(old)
    replace_text(tmp_path / "link", "new")
    assert (tmp_path / "link").read_text() == "new"


@pytest.mark.skipif(not os.access("/dev", os.W_OK), reason="only root writes there")
def test_no_output_is_put_among_the_devices_where_a_link_to_a_plain_file_may_stand():
    # /dev/stdout is one under a redirection, and the link was replaced
    place = Path("/dev/stepblocks-test.csv")
    try:
        with pytest.raises(PipelineError, match="output must be a plain file, got a device"):
            replace_text(place, "x")
        assert not place.exists()
    finally:
        place.unlink(missing_ok=True)
