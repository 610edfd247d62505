"""Inject faults while a command writes: full disk, failed sync or rename, no memory, a kill.

``python benchmarks/faults.py`` runs the matrix (some minutes); ``python benchmarks/faults.py sweep
study`` some commands. Each fault must end in one line and exit code 2 (a kill in none), and the
next run must give the bytes of one that nothing disturbed. Exit code 1 if one does not.
"""

from __future__ import annotations

import argparse
import errno
import hashlib
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
# faults of the first call, the second and so on
COUNTED = (
    "sync",
    "rename",
    "memory",
    "kill",
    "kill-rename",
)
FAULTS = ("size", *COUNTED)
POINTS = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89)
# what the commands load: once, and every run is a fork of it
LOADED = (
    "pandas",
    "scipy.optimize",
    "matplotlib.figure",
    "jinja2",
    "h5py",
    "pyarrow.parquet",
    "lxml.etree",
    "cadquery",
    "ezdxf",
)


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    code: int  # negative for a signal; 99 where it has no such point
    said: str  # on the terminal, errors included


def _disturbed(fault: str, point: int) -> list[int]:
    """Let the chosen call fail, or a file end at a size; the result counts the calls."""
    count = [0]

    def failing(call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **named: Any) -> Any:
            count[0] += 1
            if count[0] == point and fault.startswith("kill"):
                os.kill(os.getpid(), signal.SIGKILL)
            if count[0] == point and fault == "memory":
                raise MemoryError
            if count[0] == point:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return call(*arguments, **named)

        return counted

    if fault in ("sync", "kill", "memory"):
        os.fsync = failing(os.fsync)
    if fault in ("rename", "kill-rename"):
        Path.replace = failing(Path.replace)
    if fault == "size":
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (point, point))
    if fault == "processor":
        resource.setrlimit(resource.RLIMIT_CPU, (point, point))
    return count


def run(command: list[str], fault: str = "none", point: int = 0) -> Done:
    """Run a command in a fork of this process, with a fault."""
    from stepblocks.cli import main as command_line

    terminal, inside = os.pipe()  # a file would end at a size, too
    child = os.fork()
    if child == 0:
        code = 70
        os.dup2(inside, 1)
        os.dup2(inside, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w", buffering=1)
        try:
            count = _disturbed(fault, point)
            code = command_line(command)
            missed = code == 0 and fault in COUNTED and count[0] < point
            code = 99 if missed else code
        except SystemExit as error:  # --help
            code = int(error.code or 0)
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    os.close(inside)
    with os.fdopen(terminal, "rb") as stream:
        said = stream.read().decode(errors="replace")
    return Done(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), said)


def commands(work: Path) -> dict[str, list[str]]:
    """Each command that writes, with ``OUT`` for where."""
    four = str(ROOT / "stimuli" / "paper-four.toml")
    grid = (
        'kind = "grid"\nrows_per_partition = 2\n[parameters]\nheight = ["12 um", "50 '
        'um"]\nfriction = [0.1, 0.2]\n'
    )
    (work / "s.toml").write_text(f'[sweep]\n{grid}normal_load = "0.5 N"\n')
    for name, trials in (("session", 6), ("longer", 20)):
        plan = (
            'heights = ["20 um", "40 um"]\nloads = ["0.4 N"]\nspeeds = ["5 mm/s"]\ntrials = '
            f"{trials}\n"
        )
        (work / "p.toml").write_text(f'schema = 1\nseed = 5\nformat = "hdf5"\n[design]\n{plan}')
        run(["simulate-session", str(work / "p.toml"), "-o", str(work / name)])
    return {
        "study": ["study", "design", four, "--seed", "1", "-o", "OUT"],
        "sweep": ["sweep", str(work / "s.toml"), "-o", "OUT", "--quiet"],
        "measure": [
            "measure",
            str(work / "session"),
            "-o",
            "OUT/features.csv",
            "--jobs",
            "1",
            "--quiet",
        ],
        "predict": ["predict", four, "-o", "OUT/table.csv"],
        "workshop": [
            "workshop",
            str(ROOT / "stimuli" / "sheaths.toml"),
            "-o",
            "OUT",
            "--only",
            "sheath-hard",
        ],
        "loop": ["loop", str(work / "longer"), "-o", "OUT", "--jobs", "1", "--quiet"],
        "build": [
            "build",
            str(ROOT / "stimuli" / "sheaths.toml"),
            "-o",
            "OUT",
            "--only",
            "sheath-hard",
            "--jobs",
            "1",
        ],
    }


def tree(folder: Path) -> dict[str, str]:
    """Hash every file; a folder has no hash, so that an empty draft is seen."""
    found = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*")}
    return {
        name: "" if path.is_dir() else hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in found.items()
    }


def disturbed(
    command: list[str], fault: str, point: int, wanted: dict[str, str], work: Path
) -> str:
    """Run a command with a fault, then without; "none" if it has no such point."""
    folder = work / "out"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    asked = [part.replace("OUT", str(folder)) for part in command]
    first = run(asked, fault, point)
    if first.code == 99 or (first.code == 0 and fault == "size"):
        return "none"
    said = [
        line
        for line in first.said.splitlines()
        if line.startswith(("stepblocks: error", "Traceback"))
    ]
    if (
        first.code != (-9 if fault.startswith("kill") else 2)
        or len(said) != (not fault.startswith("kill"))
        or "Traceback" in first.said
    ):
        return f"ended with {first.code}: {first.said.strip()[-200:]}"
    again = run(asked)
    if again.code:
        return f"the next run ended with {again.code}: {again.said.strip()[-200:]}"
    found = tree(folder)
    differing = sorted(
        name for name in wanted.keys() | found.keys() if wanted.get(name) != found.get(name)
    )
    return f"the next run differs in {', '.join(differing[:5])}" if differing else ""


def main(argv: list[str] | None = None) -> int:
    """Run the matrix that is asked for and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", nargs="*", help="commands (default: all)")
    parser.add_argument("--faults", nargs="+", choices=FAULTS, default=FAULTS)
    parser.add_argument(
        "--points",
        type=int,
        nargs="+",
        default=POINTS,
        help="which call fails; of a size, 10 bytes times 2 to this",
    )
    arguments = parser.parse_args(argv)
    failed = held = 0
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        # a list of fonts that a fault cut short would stay
        os.environ["MPLCONFIGDIR"] = str(work / "fonts")
        for name in LOADED:
            with suppress(ImportError):
                import_module(name)
        print("| command | fault | point | outcome |\n|---|---|---|---|")
        for name, command in commands(work).items():
            if arguments.command and name not in arguments.command:
                continue
            whole = work / f"whole-{name}"
            whole.mkdir()
            done = run([part.replace("OUT", str(whole)) for part in command])
            assert done.code == 0, done.said
            wanted = tree(whole)
            for fault in arguments.faults:
                for point in arguments.points:
                    point = 10 * 2**point if fault == "size" else point
                    said = disturbed(command, fault, point, wanted, work)
                    failed += said not in ("", "none")
                    held += said == ""
                    print(
                        f"| {name} | {fault} | {point} | "
                        f"{said or 'one line, then the same bytes'} |",
                        flush=True,
                    )
                    if said == "none":
                        break
    print(f"\n{held} faults held, {failed} not")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
