"""Options only: each command hands its arguments to one function of one room; nothing heavy is imported before it runs.

Exit codes: 0 done, 1 out of tolerance, 2 wrong input, 3 not proven, 70 a fault of ours.
"""

import io
import os
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

from stepblocks import __version__
from stepblocks.cli.arguments import Parser, declare
from stepblocks.cli.outcome import show, writing
from stepblocks.errors import StepblocksError
from stepblocks.quantities import format_units
from stepblocks.workers import kill_workers

__all__ = ["main"]

_GRACE = 5.0  # for what is open to be closed, when asked to end [s]
# Modules of this package, one per command or family of commands
_MODULES = ("build", "inspect", "predict", "export", "bench", "study", "help")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file's name need not be text
            stream.reconfigure(errors="backslashreplace")
    for library in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        # our matrices are small: threads of the linear algebra only wait for each other, and we
        # divide the work ourselves
        os.environ.setdefault(library, "1")
    if threading.current_thread() is threading.main_thread():
        # asked to end, a command takes its workers with it and leaves no draft behind
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            if signal.getsignal(number) in (
                signal.SIG_DFL,
                signal.default_int_handler,
            ):  # not under nohup
                signal.signal(number, _end)
    try:
        arguments = make_parser().parse_args(argv)
        with writing(arguments.output, arguments.force) as written:
            outcome = arguments.run(arguments)
            written += outcome.kept
        show(outcome, arguments, written)
        sys.stdout.flush()
        return int(outcome.code)
    except BrokenPipeError:
        # who reads our output has seen enough; what is left is flushed into nothing
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except StepblocksError as error:
        print(f"stepblocks: error: {format_units(error)}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("stepblocks: interrupted", file=sys.stderr)
        return 130
    except (
        OSError
    ) as error:  # a full disk, a folder that is read only, a file where a folder should be
        place = (
            f" [{str(error.filename).partition('/.partial-')[0]}]"
            if error.filename is not None
            else ""
        )
        said = (
            "a folder must stand here, got a file"
            if isinstance(error, FileExistsError)
            else error.strerror or error
        )
        print(f"stepblocks: error: {said}{place}", file=sys.stderr)
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
        with tempfile.NamedTemporaryFile(
            "w", prefix="stepblocks-fault-", suffix=".txt", delete=False
        ) as file:
            file.write(
                f"stepblocks {__version__}, Python "
                f"{sys.version}\n{sys.argv}\n{traceback.format_exc()}"
            )
    except OSError:
        return message
    return f"{message} (please send {file.name})"


def _end(number: int, _: object) -> NoReturn:
    kill_workers()
    late = threading.Timer(
        _GRACE, os._exit, (128 + number,)
    )  # where a library waits for a worker that is no more
    late.daemon = True
    late.start()
    raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)


def make_parser() -> Parser:
    """Return the parser of the whole command line."""
    parser = Parser(
        prog="stepblocks",
        usage="stepblocks COMMAND ... | COMMAND --help | --version",
        description="Haptic step stimuli: from a declaration to proven artefacts, predictions and the "
        "closed loop.",
        epilog="exit codes: 0 done, 1 out of tolerance, 2 wrong input, 3 not proven, 70 a fault of "
        "ours\n"
        "start with: stepblocks new block mine.toml && stepblocks build mine.toml",
    )
    parser.add_argument("--version", action="version", version=f"stepblocks {__version__}")
    commands = parser.add_subparsers(
        metavar="COMMAND", required=True, prog="stepblocks", parser_class=Parser
    )
    runs, readers = dict[str, Any](), dict[str, Any]()
    for name in _MODULES:
        module = import_module(f"stepblocks.cli.{name}")
        runs |= module.COMMANDS
        readers |= getattr(module, "READERS", {})
    parser.groups = declare(commands, runs, readers)
    return parser
