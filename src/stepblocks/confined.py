"""Bytes that others made are parsed in a process of their own, with a limit on memory and time.

Readers of HDF5, MATLAB, TDMS, STEP, meshes and the files of instruments are made for honest files. Here a file that lies
about its size, or whose reader never ends or dies, is one line and not a full machine. ``python -m`` on this module is that
process: it takes calls as lines of JSON and answers in JSON and the bytes of arrays; nothing is unpickled, nothing evaluated.
"""

from __future__ import annotations

import atexit
import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.text_file import plain_size

Answer = tuple[dict[str, Any], str, bool]  # what was found; else what is wrong, and whether our own code says so

MEMORY = 2 * 2**30  # that a reader may fill [bytes]; what its libraries map but do not fill comes on top
_MAPPED = 4 * 2**30
_SECONDS, _PER_BYTE = 15.0, 1e-6  # of the processor, and more of it for a large file [s], [s/byte]
_WAITING = 4.0  # as long as that many times the processor time, on a machine that does something else too
_LARGEST_ANSWER = 2**24  # of what is no array [bytes]
_ours: ContextVar[bool] = ContextVar("ours", default=False)


@contextmanager
def written_by_us() -> Iterator[None]:
    """Read in this process what this process has just written."""
    token = _ours.set(True)
    try:
        yield
    finally:
        _ours.reset(token)


def read_confined(function: str, path: Path, *arguments: Any, raises: type[Exception]) -> dict[str, Any]:
    """Call ``module:function`` with a path and more arguments of JSON; it returns arrays and values of JSON by name.

    What our own code says of the file is raised as it stands; a limit, or what a library says of it, with the file's name.
    """
    request = {"function": function, "arguments": [os.path.abspath(path), *arguments]}  # noqa: PTH100  a link stays one
    try:
        seconds = _SECONDS + _PER_BYTE * plain_size(path)
        found, refused, ours = _answer(request) if _ours.get() else _reader(os.getpid()).call(request, seconds)
    except OSError as error:
        raise raises(f"file cannot be read: {error.strerror or error} [{path.name}]") from error
    if refused:
        kind = f"{path.suffix[1:].upper()} file".strip()
        raise raises(refused if ours else f"file must be a sound {kind}, got: {refused} [{path.name}]")
    return found


class _Reader:
    """The process that reads, started when it is needed and again when it has died."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._one_at_a_time = threading.Lock()
        atexit.register(self.close)

    def call(self, request: dict[str, Any], seconds: float) -> Answer:
        late = f"it must be readable within {seconds:.0f} s"
        with self._one_at_a_time:
            try:
                process = self._started()
                assert process.stdin is not None
                process.stdin.write(json.dumps({**request, "seconds": seconds}).encode() + b"\n")
                process.stdin.flush()
                deadline = time.monotonic() + _WAITING * seconds
                size = int.from_bytes(self._received(8, deadline), "little")
                answer = json.loads(self._received(size, deadline, _LARGEST_ANSWER))
                arrays = [(name, np.dtype(kind), shape) for name, kind, shape in answer["arrays"]]
                found = {
                    name: np.frombuffer(self._received(kind.itemsize * int(np.prod(shape)), deadline), kind)
                    for name, kind, shape in arrays
                }
            except TimeoutError:
                self.close()
                return {}, late, False
            except (EOFError, BrokenPipeError):
                code = self.close(5.0)
                return {}, late if code == -signal.SIGXCPU else f"its reader ended with {code}", False
            except BaseException:
                self.close()
                raise
        values = answer["values"] | {name: found[name].reshape(shape) for name, _, shape in arrays}
        return values, answer["refused"], answer["ours"]

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            paths = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
            own = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(paths)}
            command = [sys.executable, "-P", "-W", "ignore", "-m", "stepblocks.confined"]
            pipe, null, environment = subprocess.PIPE, subprocess.DEVNULL, {**os.environ, **own}
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=null, env=environment)
            self._received(8, time.monotonic() + 120.0)  # it says when it is ready
        return self._process

    def _received(self, count: int, deadline: float, most: int = MEMORY) -> bytearray:
        """Read so many bytes of an answer."""
        if self._process is None or self._process.stdout is None or count > most:
            raise EOFError
        whole, at, number = bytearray(count), 0, self._process.stdout.fileno()
        while at < count:
            if not select.select([number], [], [], max(deadline - time.monotonic(), 0.0))[0]:
                raise TimeoutError
            read = os.readv(number, [memoryview(whole)[at:]])
            if not read:
                raise EOFError
            at += read
        return whole

    def close(self, grace: float = 0.0) -> int | None:
        """End the process, after a moment in which it may do so itself; return of what it ended then."""
        process, self._process = self._process, None
        if process is None:
            return None
        with process, suppress(subprocess.TimeoutExpired):  # closes the pipes and waits
            try:
                return process.wait(grace)
            finally:
                process.kill()
        return None


_reader = cache(lambda pid: _Reader())  # one for each process: a fork must not share its parent's


def _answer(request: dict[str, Any]) -> Answer:
    module, _, name = request["function"].partition(":")
    path, *arguments = request["arguments"]
    try:
        found = getattr(import_module(module), name)(Path(path), *arguments)
        if any(isinstance(one, np.ndarray) and one.dtype.hasobject for one in found.values()):
            raise TypeError("objects where numbers should be")
    except MemoryError:
        return {}, f"it needs more than {MEMORY >> 30} GiB of memory", False
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a foreign reader may raise anything, and one of them leaves the interpreter
        said = " ".join(str(error).split())[:300] or type(error).__name__
        return {}, said, type(error).__module__.startswith("stepblocks.")
    return found, "", False


def _serve() -> None:
    """Answer calls until nobody asks any more."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (_MAPPED, _MAPPED))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who asks is interrupted, and closes the pipe
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print
    answers.write(bytes(8))
    answers.flush()
    for line in sys.stdin.buffer:
        request = json.loads(line)
        spent = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        resource.setrlimit(resource.RLIMIT_CPU, (int(spent + request["seconds"]) + 1, hard))
        found, refused, ours = _answer(request)
        arrays = {name: np.ascontiguousarray(one) for name, one in found.items() if isinstance(one, np.ndarray)}
        values = {name: one for name, one in found.items() if name not in arrays}
        told = [[name, one.dtype.str, one.shape] for name, one in arrays.items()]
        content = {"refused": refused, "ours": ours, "values": values, "arrays": told}
        head = json.dumps(content, default=float).encode()
        answers.write(len(head).to_bytes(8, "little") + head)
        for one in arrays.values():
            answers.write(one.reshape(-1).view(np.uint8).data)
        answers.flush()


if __name__ == "__main__":
    _serve()
