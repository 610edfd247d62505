"""Options only: each command hands its arguments to one function of one room.

Nothing heavy is imported before a command runs.

Exit codes: 0 done, 1 out of tolerance, 2 wrong input, 3 not proven, 70 an internal error,
130 interrupted.
"""

import io
import logging
import os
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Sequence
from typing import Annotated, NoReturn

import typer
from typer.core import TyperGroup
from typer.main import get_command

from stepblocks import __version__
from stepblocks.cli import (
    app,
    begin,
    build,
    design_set,
    drag,
    export,
    inspect,
    predict,
    session,
    study,
)
from stepblocks.cli.command import Group, describe_option_mistake
from stepblocks.compute.processes import kill_child_processes
from stepblocks.errors import StepblocksError
from stepblocks.quantities import format_units

__all__ = ["main"]

_BROKEN_PIPE = 13  # the number of SIGPIPE, which not every system names
_ENDING_SIGNALS = ("SIGTERM", "SIGINT", "SIGHUP")  # where the system has them
_GRACE = 5.0  # for what is open to be closed, when asked to end [s]
_COMPLETE = "_STEPBLOCKS_COMPLETE"  # set by the shell when it asks for completions
# One file per command or group of commands, in the order of the help
_MODULES = (begin, app, build, inspect, predict, design_set, drag, export, session, study)


def _print_version(requested: bool) -> None:
    """Print the version and end, where it is requested."""
    if requested:
        print(f"stepblocks {__version__}")
        raise typer.Exit


def _accept_global_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="print the version and exit"
        ),
    ] = False,
) -> None:
    """Haptic step stimuli: from a declaration to proven artefacts, predictions and the closed loop.

    Start with: stepblocks new block mine.toml && stepblocks build mine.toml
    """


def make_root_command() -> TyperGroup:
    """Return the whole command line."""
    root_app = typer.Typer(
        name="stepblocks",
        cls=Group,
        add_completion=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        epilog="Exit codes: 0 done, 1 out of tolerance, 2 wrong input, 3 not proven, "
        "70 an internal error.",
        callback=_accept_global_options,
        subcommand_metavar="COMMAND ...",
    )
    for module in _MODULES:
        root_app.add_typer(module.app)
    root = get_command(root_app)
    assert isinstance(root, TyperGroup)
    return root


def _run_command(words: Sequence[str]) -> int:
    """Run one command and return its exit code; errors are raised."""
    # Run one command, and let what goes wrong rise
    root = make_root_command()
    if _COMPLETE in os.environ:
        from typer.completion import completion_init

        completion_init()
        root.main([], prog_name="stepblocks", complete_var=_COMPLETE)
    with root.make_context("stepblocks", list(words)) as context:
        return int(root.invoke(context))


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    _set_up_streams_and_signals()
    try:
        if argv is None:
            argv = sys.argv[1:]
        code = _run_command(argv)
        sys.stdout.flush()
        return code
    except typer.Exit as done:  # --help, --version
        return done.exit_code
    except (BrokenPipeError, SystemExit) as ended:
        # who reads our output has seen enough, which rich says of a help by an exit; what is left
        # is flushed into nothing
        if isinstance(ended, SystemExit) and not isinstance(ended.__context__, BrokenPipeError):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + _BROKEN_PIPE
    except KeyboardInterrupt:
        print("stepblocks: interrupted", file=sys.stderr)
        return 130
    except Exception as error:
        message, code = _describe_error_with_exit_code(error)
        print(f"stepblocks: {message}", file=sys.stderr)
        return code


def _set_up_streams_and_signals() -> None:
    """Set up streams, threads of linear algebra, and the handling of signals that end a run."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file's name need not be text
            stream.reconfigure(errors="backslashreplace")
    # that it finds no folder for its cache is nothing to a user of a command
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    for library in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        # our matrices are small: threads of the linear algebra only wait for each other, and we
        # divide the work ourselves
        os.environ.setdefault(library, "1")
    if threading.current_thread() is threading.main_thread():
        # asked to end, a command takes its workers with it and leaves no draft behind
        for name in _ENDING_SIGNALS:
            number = getattr(signal, name, None)
            if number is None:
                continue
            is_default = signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)
            if is_default:  # not under nohup
                signal.signal(number, _exit_on_signal)


def _describe_error_with_exit_code(error: Exception) -> tuple[str, int]:
    """Return the line that ends a failed command, and its exit code."""
    # Return the line that ends a command, and its exit code
    if isinstance(error, typer.TyperException):
        return f"error: {describe_option_mistake(error)}", 2
    if isinstance(error, StepblocksError):
        return f"error: {format_units(error)}", error.exit_code
    if isinstance(error, OSError):  # a file that vanished, or that nobody may read
        place = ""
        if error.filename is not None:
            place = f" [{error.filename}]"
        return f"error: {error.strerror or error}{place}", 2
    if isinstance(error, MemoryError):
        return "error: this needs more memory than there is", 2
    if isinstance(error, ImportError) and "cannot open shared object file" in str(error):
        return f"error: a system library is missing: {error}", 2
    return f"internal error, not a verdict: {_save_traceback(error)}", 70


def _save_traceback(error: Exception) -> str:
    """Write the traceback to a file; return a line with the error and the path of that file."""
    message = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", prefix="stepblocks-fault-", suffix=".txt", delete=False
        ) as file:
            file.write(
                f"stepblocks {__version__}, Python {sys.version}\n{sys.argv}\n"
                f"{traceback.format_exc()}"
            )
    except OSError:
        return message
    return f"{message} (please send {file.name})"


def _exit_on_signal(number: int, _: object) -> NoReturn:
    """Kill the workers and end the command with the exit code of the signal."""
    kill_child_processes()
    # where a library waits for a worker that is no more
    late = threading.Timer(_GRACE, os._exit, (128 + number,))
    late.daemon = True
    late.start()
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)
