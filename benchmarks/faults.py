"""What goes wrong while a command writes: a full disk, a sync or a rename that fails, no memory, a kill, at one point after another.

``python benchmarks/faults.py`` runs the matrix (some minutes); ``python benchmarks/faults.py sweep study`` some commands. Each
fault must end in one line and exit code 2 (a kill in none), and the next run must give the bytes of one that nothing disturbed.
Exit code 1 if one does not.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FAULTS = ("size", "sync", "rename", "memory", "kill", "kill-rename")
# runs a command with a fault at the call, or beyond the size of a file, that is asked for
RUNNER = """
import errno, os, resource, signal, sys
from pathlib import Path
fault, point, count = sys.argv[1], int(sys.argv[2]), 0
def failing(call):
    def counted(*arguments, **named):
        global count
        count += 1
        if count == point and fault.startswith("kill"):
            os.kill(os.getpid(), signal.SIGKILL)
        if count == point and fault == "memory":
            raise MemoryError
        if count == point:
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
from stepblocks.cli import main
code = main(sys.argv[3:])
sys.exit(99 if code == 0 and fault not in ("none", "size") and count < point else code)  # 99: there is no such point
"""


def commands(work: Path) -> dict[str, list[str]]:
    """Each command that writes, with ``OUT`` for where."""
    four = str(ROOT / "stimuli" / "paper-four.toml")
    grid = 'kind = "grid"\nrows_per_partition = 2\n[parameters]\nheight = ["12 um", "50 um"]\nfriction = [0.1, 0.2]\n'
    (work / "s.toml").write_text(f'[sweep]\n{grid}normal_load = "0.5 N"\n')
    for name, trials in (("session", 6), ("longer", 20)):
        plan = f'heights = ["20 um", "40 um"]\nloads = ["0.4 N"]\nspeeds = ["5 mm/s"]\ntrials = {trials}\n'
        (work / "p.toml").write_text(f'schema = 1\nseed = 5\nformat = "hdf5"\n[design]\n{plan}')
        run([*_PLAIN, "simulate-session", str(work / "p.toml"), "-o", str(work / name)])
    return {
        "study": ["study", "design", four, "--seed", "1", "-o", "OUT"],
        "sweep": ["sweep", str(work / "s.toml"), "-o", "OUT", "--quiet"],
        "measure": ["measure", str(work / "session"), "-o", "OUT/features.csv", "--jobs", "1", "--quiet"],
        "predict": ["predict", four, "-o", "OUT/table.csv"],
        "workshop": ["workshop", str(ROOT / "stimuli" / "sheaths.toml"), "-o", "OUT", "--only", "sheath-hard"],
        "loop": ["loop", str(work / "longer"), "-o", "OUT", "--jobs", "1", "--quiet"],
        "build": ["build", str(ROOT / "stimuli" / "sheaths.toml"), "-o", "OUT", "--only", "sheath-hard", "--jobs", "1"],
    }


_PLAIN = [sys.executable, "-c", RUNNER, "none", "0"]


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a command, its output kept."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=600)


def tree(folder: Path) -> dict[str, str]:
    """Hash of every file."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def disturbed(command: list[str], fault: str, point: int, wanted: dict[str, str], work: Path) -> str:
    """Run a command with a fault, then again without; what is wrong, empty where nothing is, "none" where it has no such point."""
    folder = work / "out"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    asked = [part.replace("OUT", str(folder)) for part in command]
    first = run([sys.executable, "-c", RUNNER, fault, str(point), *asked])
    if first.returncode == 99 or (first.returncode == 0 and fault == "size"):
        return "none"
    said = [line for line in first.stderr.splitlines() if line.startswith(("stepblocks: error", "Traceback"))]
    if (
        first.returncode != (-9 if fault.startswith("kill") else 2)
        or len(said) != (not fault.startswith("kill"))
        or "Traceback" in first.stderr
    ):
        return f"ended with {first.returncode}: {first.stderr.strip()[-200:]}"
    again = run([*_PLAIN, *asked])
    if again.returncode:
        return f"the next run ended with {again.returncode}: {again.stderr.strip()[-200:]}"
    found = tree(folder)
    differing = sorted(name for name in wanted.keys() | found.keys() if wanted.get(name) != found.get(name))
    return f"the next run differs in {', '.join(differing[:5])}" if differing else ""


def main(argv: list[str] | None = None) -> int:
    """Run the matrix that is asked for and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", nargs="*", help="commands (default: all)")
    parser.add_argument("--points", type=int, default=4, help="of each fault")
    parser.add_argument("--every", type=int, default=3, help="calls from one point to the next")
    arguments = parser.parse_args(argv)
    failed = held = 0
    print("| command | fault | point | outcome |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for name, command in commands(work).items():
            if arguments.command and name not in arguments.command:
                continue
            whole = work / f"whole-{name}"
            whole.mkdir()
            run([*_PLAIN, *(part.replace("OUT", str(whole)) for part in command)])
            wanted = tree(whole)
            for fault in FAULTS:
                for number in range(arguments.points):
                    point = 10 * 20**number if fault == "size" else 1 + number * arguments.every
                    said = disturbed(command, fault, point, wanted, work)
                    failed += said not in ("", "none")
                    held += said == ""
                    print(f"| {name} | {fault} | {point} | {said or 'one line, then the same bytes'} |", flush=True)
                    if said == "none":
                        break
    print(f"\n{held} faults held, {failed} not")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
