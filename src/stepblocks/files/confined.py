"""Bytes that others made are parsed in a process of their own, with a limit on memory and time.

Readers of HDF5, MATLAB, TDMS, STEP, meshes and the files of instruments are made for honest files.
Here a file that lies about its size, or whose reader never ends or dies, is one line and not a full
machine. ``python -m`` on this module is that process: it takes calls as lines of JSON and answers
in JSON and the bytes of arrays; nothing is unpickled, nothing evaluated. What a process has just
written itself, it may read itself, within `read_in_this_process`.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.files.limits import MEMORY, Breach, Watch, limit_this_process, ran_out_of_time
from stepblocks.files.paths import describe_system_error
from stepblocks.files.text import Document, measure_file_size

__all__ = ["MEMORY", "read_confined", "read_in_this_process"]

_SECONDS, _PER_BYTE = 15.0, 1e-6  # of the processor, and more of it for a large file [s], [s/byte]
# as long as that many times the processor time: a busy machine is no fault of the file
_WAITING = 40.0
_LARGEST_ANSWER = 2**24  # of what is no array [bytes]
_LONGEST_REASON = 300  # letters of a library's message that are shown
_GRACE = 5.0  # for a reader whose pipe is closed to end by itself [s]
_SIZE_BYTES = 8  # of the length before an answer

_reads_own_files = ContextVar("reads_own_files", default=False)

_MEMORY_RULE = f"it needs more than {MEMORY >> 30} GiB of memory"


@dataclass(frozen=True)
class _Answer:
    """What a reader found in a file, or why it refuses it."""

    values: Mapping[str, Any] = field(default_factory=dict)  # arrays and values of JSON, by name
    refusal: str = ""  # empty where the file was read
    is_ours: bool = False  # whether our own code refuses the file, with its name in the message


@contextmanager
def read_in_this_process() -> Iterator[None]:
    """Let `read_confined` read in this process within the block, for files that it wrote itself.

    A process of its own loads the CAD kernel and the readers of meshes a second time, which takes
    longer than to build a block.
    """
    token = _reads_own_files.set(True)
    try:
        yield
    finally:
        _reads_own_files.reset(token)


def read_confined(
    reader_function: str, path: Path, *arguments: object, raises: type[Exception]
) -> Document:
    """Call a reader with a path in a process of its own.

    Parameters
    ----------
    reader_function : str
        The reader, ``module:function``. It takes the path and the arguments, and returns a dict of
        arrays and values of JSON.
    path : Path
        The file; it is not resolved, a link stays one.
    *arguments : object
        More values of JSON for the reader.
    raises : type of Exception
        Raised where the file cannot be read: what our own code says of it as it stands; a limit, or
        what a library says, with the file's name.

    Returns
    -------
    dict
        What the reader returns.
    """
    request = {
        "function": reader_function,
        "arguments": [os.path.abspath(path), *arguments],  # noqa: PTH100  a link stays one
    }
    try:
        seconds = _SECONDS + _PER_BYTE * measure_file_size(path)
        if _reads_own_files.get():
            answer = _answer_request(request)
        else:
            answer = _get_reader_process(os.getpid()).send_request(request, seconds)
    except OSError as error:
        reason = describe_system_error(error, path)
        raise raises(f"file cannot be read: {reason} [{path.name}]") from error
    if answer.is_ours:
        raise raises(answer.refusal)
    if answer.refusal:
        kind = f"{path.suffix[1:].upper()} file".strip()
        raise raises(f"file must be a sound {kind}, got: {answer.refusal} [{path.name}]")
    return dict(answer.values)


class _ReaderProcess:
    """The process that reads, started when it is needed and again when it has died."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._one_at_a_time = threading.Lock()
        atexit.register(self.close)

    def send_request(self, request: Mapping[str, object], seconds: float) -> _Answer:
        """Send a request to the process and return its answer, within a limit of CPU time [s]."""
        with self._one_at_a_time:
            process = self._start_process()
            with Watch(process, seconds, _WAITING * seconds) as watch:
                try:
                    _send_request(process, {**request, "seconds": seconds})
                    return _receive_answer(process)
                except (EOFError, BrokenPipeError):
                    code = self.close(_GRACE)
                    return _Answer(refusal=_explain_early_end(code, watch.breach, seconds))
                except BaseException:
                    self.close()
                    raise

    def _start_process(self) -> subprocess.Popen[bytes]:
        """Return the process, a new one where there is none or it has died."""
        if self._process is not None and self._process.poll() is None:
            return self._process
        self.close()  # the pipes of one that has died
        search_path = [str(Path(__file__).parents[2])]
        if os.getenv("PYTHONPATH"):
            search_path.append(os.environ["PYTHONPATH"])
        environment = dict(os.environ)
        environment["OMP_NUM_THREADS"] = "1"
        environment["OPENBLAS_NUM_THREADS"] = "1"
        environment["PYTHONPATH"] = os.pathsep.join(search_path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-W", "ignore", "-m", "stepblocks.files.confined"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        return self._process

    def close(self, grace: float = 0.0) -> int | None:
        """End the process, after a moment to end by itself; return how it ended."""
        process = self._process
        self._process = None
        if process is None:
            return None
        with process, suppress(subprocess.TimeoutExpired):  # closes the pipes and waits
            try:
                return process.wait(grace)
            finally:
                process.kill()
        return None


@cache
def _get_reader_process(_pid: int) -> _ReaderProcess:
    """Return the reader of a process: one that was forked must not share its parent's."""
    return _ReaderProcess()


def _explain_early_end(code: int | None, breach: Breach | None, seconds: float) -> str:
    """Say why a reader ended before it had answered."""
    if breach is Breach.MEMORY:
        return _MEMORY_RULE
    if breach is Breach.TIME or ran_out_of_time(code):
        return f"it must be readable within {seconds:.0f} s"
    return f"its reader ended with {code}"


def _send_request(process: subprocess.Popen[bytes], request: Mapping[str, object]) -> None:
    """Write a request to a reader as a line of JSON."""
    assert process.stdin is not None
    line = json.dumps(request).encode() + b"\n"
    try:
        # nothing stays in a buffer, which closing the pipe of a dead reader would flush
        os.write(process.stdin.fileno(), line)
    except OSError as error:  # Windows calls a broken pipe an invalid argument
        raise BrokenPipeError from error


def _receive_answer(process: subprocess.Popen[bytes]) -> _Answer:
    """Read what a reader answers: a length, JSON, and the bytes of the arrays that it names."""
    assert isinstance(process.stdout, BufferedReader)
    head_size = int.from_bytes(_receive_bytes(process.stdout, _SIZE_BYTES), "little")
    head = json.loads(_receive_bytes(process.stdout, head_size, _LARGEST_ANSWER))
    values = head["values"]
    for name, dtype, shape in head["arrays"]:
        size = np.dtype(dtype).itemsize * int(np.prod(shape))
        content = _receive_bytes(process.stdout, size)
        values[name] = np.frombuffer(content, dtype).reshape(shape)
    return _Answer(values, head["refused"], head["ours"])


def _receive_bytes(stream: BufferedReader, byte_count: int, most_bytes: int = MEMORY) -> bytearray:
    """Read so many bytes of an answer, or raise EOFError."""
    if byte_count > most_bytes:
        raise EOFError
    content = bytearray(byte_count)
    if stream.readinto(content) < byte_count:
        raise EOFError
    return content


def _answer_request(request: Mapping[str, Any]) -> _Answer:
    """Call the function that a request names."""
    module, _, name = request["function"].partition(":")
    path, *arguments = request["arguments"]
    try:
        values = getattr(import_module(module), name)(Path(path), *arguments)
        _refuse_object_arrays(values)
    except MemoryError:
        return _Answer(refusal=_MEMORY_RULE)
    except KeyboardInterrupt:  # of the user, where nobody else reads
        raise
    except BaseException as error:  # a foreign reader may raise anything, even SystemExit
        is_ours = type(error).__module__.startswith("stepblocks.")
        return _Answer(refusal=_describe_refusal(error), is_ours=is_ours)
    return _Answer(values)


def _refuse_object_arrays(values: Mapping[str, object]) -> None:
    """Refuse arrays of Python objects, whose bytes cannot be sent."""
    for value in values.values():
        if isinstance(value, np.ndarray) and value.dtype.hasobject:
            raise TypeError("objects where numbers should be")


def _describe_refusal(error: BaseException) -> str:
    """Return one line on what a reader raised."""
    if isinstance(error, ZeroDivisionError):
        return "a size of zero"
    text = str(getattr(error, "strerror", None) or error)  # without the number of an error
    reason = " ".join(text.split())[:_LONGEST_REASON] or type(error).__name__
    if isinstance(error, KeyError):
        return f"no {reason}"
    return reason


def _serve_requests() -> None:
    """Answer calls until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who asks is interrupted, and closes the pipe
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries print
    for line in sys.stdin.buffer:
        request = json.loads(line)
        limit_this_process(request["seconds"])
        answers.writelines(_encode_answer(_answer_request(request)))
        answers.flush()


def _encode_answer(answer: _Answer) -> list[bytes | memoryview]:
    """Return an answer as bytes: its length, JSON, and the arrays one behind the other."""
    values: dict[str, Any] = {}
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in answer.values.items():
        if isinstance(value, np.ndarray):
            arrays[name] = np.ascontiguousarray(value)
        else:
            values[name] = value
    head = {
        "refused": answer.refusal,
        "ours": answer.is_ours,
        "values": values,
        "arrays": [[name, array.dtype.str, array.shape] for name, array in arrays.items()],
    }
    text = json.dumps(head, default=float).encode()
    contents = [array.reshape(-1).view(np.uint8).data for array in arrays.values()]
    return [len(text).to_bytes(_SIZE_BYTES, "little"), text, *contents]


if __name__ == "__main__":
    _serve_requests()
