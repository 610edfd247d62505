"""Bytes that others made are parsed in a process of their own, with a limit on memory and time.

Readers of HDF5, MATLAB, TDMS, STEP, meshes and the files of instruments are made for honest files.
Here a file that lies about its size, or whose reader never ends or dies, is one line and not a full
machine. ``python -m`` on this module is that process: it takes calls as lines of JSON and answers
in JSON and the bytes of arrays; nothing is unpickled, nothing evaluated.
"""

import atexit
import json
import os
import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from io import BufferedReader
from pathlib import Path

import numpy as np

from stepblocks.files.text import Document, measure_file_size

# what was found; else what is wrong, and whether our own code says so
Answer = tuple[Document, str, bool]

# that a reader may fill [bytes]; what its libraries map but do not fill comes on top
MEMORY = 2 * 2**30
_MAPPED = 4 * 2**30
_SECONDS, _PER_BYTE = 15.0, 1e-6  # of the processor, and more of it for a large file [s], [s/byte]
_WAITING = (
    40.0  # as long as that many times the processor time: a busy machine is no fault of the file
)
_LARGEST_ANSWER = 2**24  # of what is no array [bytes]


def read_confined(
    function: str, path: Path, *arguments: object, raises: type[Exception]
) -> Document:
    """Call ``module:function`` with a path and arguments of JSON in a process of its own.

    The result holds arrays and values of JSON, by name.
    """
    # What our own code says of the file is raised as it stands; a limit, or what a library says of
    # it, with the file's name.
    # not resolved: a link stays one
    request = {
        "function": function,
        "arguments": [os.path.abspath(path), *arguments],  # noqa: PTH100
    }
    try:
        found, refused, ours = _reader(os.getpid()).call(
            request, _SECONDS + _PER_BYTE * measure_file_size(path)
        )
    except OSError as error:
        raise raises(f"file cannot be read: {error.strerror or error} [{path.name}]") from error
    if refused:
        kind = f"{path.suffix[1:].upper()} file".strip()
        raise raises(
            refused if ours else f"file must be a sound {kind}, got: {refused} [{path.name}]"
        )
    return found


class _Reader:
    # The process that reads, started when it is needed and again when it has died
    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._one_at_a_time = threading.Lock()
        atexit.register(self.close)

    def call(self, request: Mapping[str, object], seconds: float) -> Answer:
        with self._one_at_a_time:
            process = self._start_process()
            assert process.stdin is not None
            assert isinstance(process.stdout, BufferedReader)
            watch = threading.Timer(_WAITING * seconds, process.kill)
            watch.start()
            try:
                # nothing stays in a buffer, which closing the pipe of a dead reader would flush
                os.write(
                    process.stdin.fileno(),
                    json.dumps({**request, "seconds": seconds}).encode() + b"\n",
                )
                size = int.from_bytes(_receive(process.stdout, 8), "little")
                answer = json.loads(_receive(process.stdout, size, _LARGEST_ANSWER))
                found = answer["values"]
                for name, kind, shape in answer["arrays"]:
                    size = np.dtype(kind).itemsize * int(np.prod(shape))
                    found[name] = np.frombuffer(_receive(process.stdout, size), kind).reshape(shape)
            except (EOFError, BrokenPipeError):
                code = self.close(5.0)
                late = code == -signal.SIGXCPU or watch.finished.is_set()
                rule = f"it must be readable within {seconds:.0f} s"
                return {}, rule if late else f"its reader ended with {code}", False
            except BaseException:
                self.close()
                raise
            finally:
                watch.cancel()
        return found, answer["refused"], answer["ours"]

    def _start_process(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self.close()  # the pipes of one that has died
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-W", "ignore", "-m", "stepblocks.files.confined"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={
                    **os.environ,
                    "OMP_NUM_THREADS": "1",
                    "OPENBLAS_NUM_THREADS": "1",
                    "PYTHONPATH": os.pathsep.join(
                        filter(None, [str(Path(__file__).parents[2]), os.getenv("PYTHONPATH")])
                    ),
                },
            )
        return self._process

    def close(self, grace: float = 0.0) -> int | None:
        """End the process, after a moment to end by itself; return how it ended."""
        process, self._process = self._process, None
        if process is None:
            return None
        with process, suppress(subprocess.TimeoutExpired):  # closes the pipes and waits
            try:
                return process.wait(grace)
            finally:
                process.kill()
        return None


def _receive(stream: BufferedReader, count: int, most: int = MEMORY) -> bytearray:
    # Read so many bytes of an answer
    whole = bytearray(count if count <= most else 0)
    if stream.readinto(whole) < count:
        raise EOFError
    return whole


_reader = cache(lambda pid: _Reader())  # one for each process: a fork must not share its parent's


def _answer_request(request: Document) -> Answer:
    module, _, name = request["function"].partition(":")
    path, *arguments = request["arguments"]
    try:
        found = getattr(import_module(module), name)(Path(path), *arguments)
        if any(isinstance(one, np.ndarray) and one.dtype.hasobject for one in found.values()):
            raise TypeError("objects where numbers should be")
    except MemoryError:
        return {}, f"it needs more than {MEMORY >> 30} GiB of memory", False
    except BaseException as error:  # a foreign reader may raise anything, even SystemExit
        text = str(getattr(error, "strerror", None) or error)  # without the number of an error
        reason = " ".join(text.split())[:300] or type(error).__name__
        reason = f"no {reason}" if isinstance(error, KeyError) else reason
        reason = "a size of zero" if isinstance(error, ZeroDivisionError) else reason
        return {}, reason, type(error).__module__.startswith("stepblocks.")
    return found, "", False


def _limit_process(seconds: float) -> None:
    # Limit what this process may use, and its processor time from now on; a lower limit of the
    # user's own stays
    limits = {
        resource.RLIMIT_AS: _MAPPED,
        resource.RLIMIT_DATA: MEMORY,
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_CPU: int(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]) + seconds) + 1,
    }
    for kind, most in limits.items():
        hard = resource.getrlimit(kind)[1]
        soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (soft, hard))


def _serve_requests() -> None:
    # Answer calls until nobody asks any more
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who asks is interrupted, and closes the pipe
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print
    for line in sys.stdin.buffer:
        request = json.loads(line)
        _limit_process(request["seconds"])
        found, refused, ours = _answer_request(request)
        arrays = {
            name: np.ascontiguousarray(one)
            for name, one in found.items()
            if isinstance(one, np.ndarray)
        }
        answer = {
            "refused": refused,
            "ours": ours,
            "values": {name: one for name, one in found.items() if name not in arrays},
            "arrays": [[name, one.dtype.str, one.shape] for name, one in arrays.items()],
        }
        head = json.dumps(answer, default=float).encode()
        answers.write(len(head).to_bytes(8, "little") + head)
        for one in arrays.values():
            answers.write(one.reshape(-1).view(np.uint8).data)
        answers.flush()


if __name__ == "__main__":
    _serve_requests()
