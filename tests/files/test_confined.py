"""A file that somebody else made costs one line, whatever its reader does with it."""

import contextvars
import gc
import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

from stepblocks.errors import MetrologyError
from stepblocks.files import confined
from stepblocks.files.confined import read_confined, read_in_this_process

READERS = """
import ctypes, os, time
import numpy as np
from stepblocks.errors import StimulusError

def good(path, factor):
    print("libraries print")
    found = {"x": np.arange(6.0).reshape(2, 3) * factor, "flag": np.array([True])}
    return found | {"none": np.zeros((0, 3)), "name": path.name}

def loops(path):
    while True:
        pass

def sleeps(path):
    time.sleep(60)

def waits(path, seconds):
    time.sleep(seconds)
    return {"waited": seconds}

def fills(path):
    return {"x": np.ones(2**29)}

def dies(path):
    ctypes.string_at(0)

def leaves(path):
    raise SystemExit(3)

def fails(path):
    raise KeyError("a\\nb")

def says(path):
    raise StimulusError("height must be given [x.bin]")

def objects(path):
    return {"x": np.array([{}])}

def number(path):
    return {"pid": os.getpid()}
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    (tmp_path / "hostile_readers.py").write_text(READERS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.syspath_prepend(tmp_path)
    confined._get_reader_process(os.getpid()).close()
    path = tmp_path / "x.bin"
    path.write_bytes(b"bytes")
    yield path
    confined._get_reader_process(os.getpid()).close()


def call(path, name, *arguments):
    return read_confined(f"hostile_readers:{name}", path, *arguments, raises=MetrologyError)


def test_arrays_and_values_come_back_as_they_were(file):
    found = call(file, "good", 0.1)
    np.testing.assert_array_equal(found["x"], np.arange(6.0).reshape(2, 3) * 0.1)
    assert (found["flag"].dtype, found["none"].shape, found["name"]) == (np.bool_, (0, 3), "x.bin")
    # one other process for all calls
    assert call(file, "number") == call(file, "number") != {"pid": os.getpid()}


@pytest.fixture
def limited_by(request, tmp_path, monkeypatch):
    """How a reader is limited: by the kernel; or watched, as on systems whose kernel cannot."""
    if request.param == "psutil":
        import psutil  # noqa: F401  which on Linux imports it, too

        monkeypatch.setitem(sys.modules, "resource", None)
        (tmp_path / "sitecustomize.py").write_text('import sys\nsys.modules["resource"] = None\n')
    return request.param


WORDS = {
    "loops": r"got: it must be readable within 0 s \[x.bin\]",
    "sleeps": r"got: it must be readable within 0 s \[x.bin\]",
    "fills": r"got: it needs more than 2 GiB of memory \[x.bin\]",
    "dies": r"got: its reader ended with -11 \[x.bin\]",
    "leaves": r"file must be a sound BIN file, got: 3 \[x.bin\]",
    "fails": r"file must be a sound BIN file, got: .* \[x.bin\]",
    "objects": r"got: objects where numbers should be \[x.bin\]",
    "says": r"^height must be given \[x.bin\]$",
}


def list_readers():
    """Every reader limited in either way; the quick run watches that alone which never ends."""
    for limit in ("kernel", "psutil"):
        for reader, words in WORDS.items():
            is_repeated = limit == "psutil" and reader != "loops"
            marks = [pytest.mark.long] if is_repeated else []
            yield pytest.param(limit, reader, words, marks=marks, id=f"{limit}-{reader}")


@pytest.mark.parametrize(("limited_by", "reader", "words"), list_readers(), indirect=["limited_by"])
def test_whatever_a_reader_does_is_one_line_and_the_next_file_is_read(
    reader, words, limited_by, file, monkeypatch
):
    with monkeypatch.context() as hurried:
        if reader in ("loops", "sleeps"):
            call(file, "number")  # its start does not count
            hurried.setattr(confined, "_SECONDS", 0.3)
            hurried.setattr(confined, "_WAITING", 8.0)
        with pytest.raises(MetrologyError, match=words) as caught:
            call(file, reader)
    assert "\n" not in str(caught.value)
    assert call(file, "good", 1.0)["name"] == "x.bin"


def test_a_process_reads_what_it_wrote_itself_and_says_the_same_of_what_is_wrong(file):
    with read_in_this_process():
        assert call(file, "number") == {"pid": os.getpid()}
        for reader in ("leaves", "fails", "says", "objects"):
            with pytest.raises(MetrologyError) as here:
                call(file, reader)
            with pytest.raises(MetrologyError) as elsewhere:
                contextvars.Context().run(call, file, reader)
            assert str(here.value) == str(elsewhere.value)
    assert call(file, "number") != {"pid": os.getpid()}


def test_a_sound_file_is_read_however_long_a_busy_machine_keeps_its_reader_waiting(
    file, monkeypatch
):
    call(file, "number")
    monkeypatch.setattr(confined, "_SECONDS", 0.3)
    assert call(file, "waits", 3.0) == {"waited": 3.0}  # ten times what it may compute


@pytest.mark.parametrize(
    ("kind", "words"),
    [("pipe", "Not a plain file"), ("folder", "Is a directory"), ("none", "No such")],
)
def test_a_pipe_a_folder_and_nothing_are_no_files(kind, words, file, tmp_path):
    path = tmp_path / "odd.bin"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    with pytest.raises(MetrologyError, match=words):
        call(path, "good", 1.0)


@pytest.mark.parametrize("seen", [True, False])
def test_a_reader_that_was_killed_leaves_no_open_pipe_and_no_unsent_bytes(seen, file):
    # the kernel kills what takes too much memory; whoever asks next may or may not see it first
    reader = confined._get_reader_process(os.getpid())
    call(file, "number")
    killed = reader._process
    killed.kill()
    os.waitid(os.P_PID, killed.pid, os.WEXITED | os.WNOWAIT)
    if not seen:
        killed.poll = lambda: None  # it dies after it was looked at
    if seen:
        assert call(file, "good", 1.0)["name"] == "x.bin"
    else:
        with pytest.raises(MetrologyError, match=r"its reader ended with -9 \[x.bin\]"):
            call(file, "good", 1.0)
        assert call(file, "good", 1.0)["name"] == "x.bin"
    assert killed.stdin.closed
    assert killed.stdout.closed
    gc.collect()  # anything left open is a warning, which is an error here


def test_a_reader_ends_with_the_process_that_asked(file, tmp_path):
    code = f"""
        import os, signal
        from pathlib import Path
        from stepblocks.files.confined import read_confined
        found = read_confined("hostile_readers:number", Path({str(file)!r}), raises=ValueError)
        print(found["pid"], flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=False
    )
    assert done.returncode == -signal.SIGKILL
    for _ in range(100):
        try:
            os.kill(int(done.stdout), 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("the reader lives on")


def test_a_lower_limit_of_the_users_own_stays_and_refuses_no_file(file):
    # as a cluster sets it for every shell (ulimit -v, -d, -t): limits that nobody can raise again
    code = """
import resource, sys
from pathlib import Path
from stepblocks.files.confined import read_confined, read_in_this_process
for kind, most in ((resource.RLIMIT_AS, 3 << 30), (resource.RLIMIT_DATA, 1 << 30)):
    resource.setrlimit(kind, (most, most))
resource.setrlimit(resource.RLIMIT_CPU, (10, 10))
path = Path(sys.argv[1])
print(read_confined("hostile_readers:good", path, 2.0, raises=ValueError)["x"].tolist())
try:
    read_confined("hostile_readers:fills", path, raises=ValueError)
except ValueError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(file)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first == "[[0.0, 2.0, 4.0], [6.0, 8.0, 10.0]]"
    assert second.startswith("file must be a sound BIN file, got: it needs more than")
