"""Options only: each command hands its arguments to one function of one room; nothing heavy is imported before it runs.

Exit codes: 0 done, 1 out of tolerance, 2 wrong input, 3 not proven, 70 a fault of ours.
"""

from __future__ import annotations

import argparse
import io
import os
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from stepblocks import __version__
from stepblocks.errors import StepblocksError

__all__ = ["main"]

# Modules of this package, one per command or family of commands, in the order of the help text
_COMMANDS = ("build", "predict", "inspect", "bench", "evidence", "workshop", "export", "study")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file's name need not be text
            stream.reconfigure(errors="backslashreplace")
    for library in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        # our matrices are small: threads of the linear algebra only wait for each other, and we divide the work ourselves
        os.environ.setdefault(library, "1")
    if threading.current_thread() is threading.main_thread():
        # asked to end, a command takes its workers with it and leaves no draft behind
        signal.signal(signal.SIGTERM, _end)
    try:
        code = int(arguments.run(arguments))
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # who reads our output has seen enough; what is left is flushed into nothing
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except StepblocksError as error:
        print(f"stepblocks: error: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("stepblocks: interrupted", file=sys.stderr)
        return 130
    except OSError as error:  # a full disk, a folder that is read only, a file where a folder should be
        place = f" [{error.filename}]" if error.filename is not None else ""
        print(f"stepblocks: error: {error.strerror or error}{place}", file=sys.stderr)
        return 2
    except MemoryError:
        print("stepblocks: error: this needs more memory than there is", file=sys.stderr)
        return 2
    except Exception as error:
        if isinstance(error, ImportError) and "cannot open shared object file" in str(error):
            print(f"stepblocks: error: a system library is missing: {error}", file=sys.stderr)
            return 2
        print(f"stepblocks: a fault of ours, not a verdict: {_fault(error)}", file=sys.stderr)
        return 70


def _fault(error: Exception) -> str:
    """Keep what a mender needs in a file, and say in one line what happened and where the file is."""
    message = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    try:
        with tempfile.NamedTemporaryFile("w", prefix="stepblocks-fault-", suffix=".txt", delete=False) as file:
            file.write(f"stepblocks {__version__}, Python {sys.version}\n{sys.argv}\n{traceback.format_exc()}")
    except OSError:
        return message
    return f"{message} (please send {file.name})"


def _end(number: int, _: object) -> NoReturn:
    raise SystemExit(128 + number)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="stepblocks",
        description="Haptic step stimuli: from a declaration to proven artefacts, predictions and the closed loop.",
    )
    parser.add_argument("--version", action="version", version=f"stepblocks {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name in _COMMANDS:
        import_module(f"stepblocks.cli.{name}").add_to(commands)
    return parser
