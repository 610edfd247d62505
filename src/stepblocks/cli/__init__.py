"""Arguments to pipeline: no physics, no geometry, and nothing heavy imported before a command runs."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from stepblocks import __version__
from stepblocks.errors import StepblocksError

__all__ = ["main"]

# Modules of this package, one per command or family of commands, in the order of the help text
_COMMANDS: tuple[str, ...] = (
    "build",
    "check",
    "predict",
    "drag",
    "sweep",
    "inspect",
    "measure",
    "loop",
    "simulate_session",
    "workshop",
    "export",
    "feel",
    "study",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command."""
    parser = _parser()
    arguments = parser.parse_args(argv)
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
    except ImportError as error:
        if "cannot open shared object file" not in str(error):
            raise
        print(f"stepblocks: error: a system library is missing: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stepblocks: interrupted", file=sys.stderr)
        return 130


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
