"""The same answers on every machine: the numeric tests under other processors, threads, Pythons and library versions.

``make everywhere`` runs all of it (two hours on two cores); ``python benchmarks/everywhere.py STAGE ...`` some stages;
``--list`` names them. Prints the table of docs/portability.md. Exit code 1 if a stage fails.

A processor is imitated by what its libraries read when they load: OPENBLAS_CORETYPE picks the kernels of the linear
algebra, NPY_DISABLE_CPU_FEATURES the vector loops of numpy, NUMBA_CPU_NAME those of our compiled kernels. Pythons that
are not on the machine are left out and named.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BYTES = "bytes of a build"
NUMERIC = ("contact", "drag", "predict", "inspect", "bench", "loop", "study")  # folders of tests that compute


# makes one stimulus of each kind and prints the hash of every file
MAKE = """
import json, sys
from pathlib import Path
from stepblocks.build.make import make
from stepblocks.declare import load_declared
from stepblocks.select import stimulus_files
folder, chosen = Path(sys.argv[1]), {"step-050", "gap-050-bevelled", "crown-chamfer-over", "tip-125", "hook-125", "sheath-hard"}
for file in stimulus_files(Path("stimuli")):  # no apparatus: that is a kit
    stimuli = load_declared(file)
    for part in (one for one in stimuli.stimuli if one.id in chosen):
        make(stimuli.name, part, folder, "key")
        for path in sorted((folder / stimuli.name / part.id).iterdir()):
            import hashlib
            print(part.id, path.name, hashlib.sha256(path.read_bytes()).hexdigest())
"""


@dataclass(frozen=True)
class Stage:
    """One machine to imitate."""

    name: str
    settings: dict[str, str] = field(default_factory=dict)  # environment
    python: str = ""  # version; a fresh environment with it
    resolution: str = ""  # "lowest-direct" or "highest" of what pyproject.toml allows
    folders: tuple[str, ...] = NUMERIC


def no_simd() -> str:
    """Vector features that this numpy can disable on this processor."""
    code = (
        "from numpy._core._multiarray_umath import __cpu_dispatch__ as d, __cpu_features__ as f;"
        "print(*(n for n in d if f.get(n)))"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def stages() -> list[Stage]:
    """Every machine, the cheap ones first."""
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    kernels = [
        Stage(f"OpenBLAS kernels of {core}", one | {"OPENBLAS_CORETYPE": core})
        for core in ("Nehalem", "Haswell", "Zen", "SkylakeX")
    ]
    plain = {"NPY_DISABLE_CPU_FEATURES": no_simd(), "NUMBA_CPU_NAME": "generic", "OPENBLAS_CORETYPE": "Nehalem"}
    threads = [
        Stage(f"{count} threads", {"OMP_NUM_THREADS": count, "OPENBLAS_NUM_THREADS": count}) for count in ("1", "4")
    ]
    pythons = [Stage(f"Python {version}", one, python=version, folders=()) for version in ("3.11", "3.12", "3.13")]
    libraries = [
        Stage("oldest libraries allowed", one, python="3.11", resolution="lowest-direct", folders=()),
        Stage("newest libraries", one, python="3.13", resolution="highest", folders=()),
    ]
    return [*kernels, Stage("no vector loops", one | plain), *threads, Stage(BYTES), *pythons, *libraries]


def same_bytes(work: Path) -> tuple[str, str]:
    """Make one stimulus of each kind as each processor that is imitated would, and on each Python, and compare every file."""
    found: dict[str, set[str]] = {}
    machines = [one for one in stages() if one.name != BYTES and not one.resolution]
    for stage in machines:
        python = environment(stage, work)
        if python is None:
            continue
        command = [python, "-c", MAKE, str(work / "bytes" / stage.name)]
        settings = {**os.environ, **stage.settings, "NUMBA_CACHE_DIR": str(work / "numba" / stage.name)}
        done = subprocess.run(command, cwd=ROOT, env=settings, capture_output=True, text=True, check=False)
        if done.returncode:
            return "FAILS", f"{stage.name}: {done.stderr.strip()[-200:]}"
        found[stage.name] = set(done.stdout.splitlines())
    first = next(iter(found.values()))
    differing = {name: sorted(line.rsplit(" ", 1)[0] for line in lines - first) for name, lines in found.items()}
    wrong = [f"{name}: {', '.join(files[:3])}" for name, files in differing.items() if files]
    return ("FAILS", "; ".join(wrong)) if wrong else ("passes", f"{len(first)} files alike on {len(found)} machines")


def interpreter(version: str) -> str | None:
    """Path of a Python of this version."""
    known = [shutil.which(f"python{version}")]
    known += [str(path) for path in sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))]
    return next((path for path in known if path and _answers(path)), None)


def _answers(python: str) -> bool:
    return subprocess.run([python, "--version"], capture_output=True, check=False).returncode == 0


def environment(stage: Stage, work: Path) -> str | None:
    """Python of the stage, in an environment of its own where it asks for one; None where it cannot be had."""
    if not stage.python:
        return sys.executable
    base = interpreter(stage.python)
    if base is None:
        return None
    folder = work / re.sub(r"\W+", "-", stage.name)
    subprocess.run([base, "-m", "venv", str(folder)], check=True)
    python = str(folder / "bin" / "python")
    install = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    if stage.resolution:
        subprocess.run([*install, "uv"], check=True)
        asked = ["--resolution", stage.resolution, "-e", f"{ROOT}[dev]"]
        subprocess.run([python, "-m", "uv", "pip", "install", "-q", "--python", python, *asked], check=True)
    else:
        subprocess.run([*install, "-c", str(ROOT / "constraints.txt"), "-e", f"{ROOT}[dev]"], check=True)
    return python


def run(stage: Stage, work: Path) -> tuple[str, str]:
    """Outcome and last line of the tests of a stage."""
    try:
        if stage.name == BYTES:
            return same_bytes(work)
        python = environment(stage, work)
    except subprocess.CalledProcessError as error:
        return "not installed", str(error)[:80]
    if python is None:
        return "not run", f"no Python {stage.python} here"
    started = time.monotonic()
    asked = [str(ROOT / "tests" / folder) for folder in stage.folders] or [str(ROOT / "tests")]
    command = [python, "-m", "pytest", "-n", "auto", "--dist", "loadfile", "-p", "no:cacheprovider", *asked]
    settings = {**os.environ, **stage.settings, "NUMBA_CACHE_DIR": str(work / "numba" / stage.name)}
    done = subprocess.run(command, cwd=ROOT, env=settings, capture_output=True, text=True, check=False)
    last = next((line for line in reversed(done.stdout.splitlines()) if " in " in line), "").strip("= ")
    if done.returncode:
        print(done.stdout[-4000:], file=sys.stderr)
    return ("passes" if done.returncode == 0 else "FAILS"), last or f"{time.monotonic() - started:.0f} s"


def main() -> int:
    """Run the stages that are asked for and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stage", nargs="*", help="parts of names of stages (default: all)")
    parser.add_argument("--list", action="store_true", help="name the stages")
    arguments = parser.parse_args()
    chosen = [s for s in stages() if not arguments.stage or any(word in s.name for word in arguments.stage)]
    if arguments.list:
        print("\n".join(stage.name for stage in chosen))
        return 0
    failed = False
    print("| machine | outcome | tests |\n|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as work:
        for stage in chosen:
            outcome, told = run(stage, Path(work))
            failed |= outcome in ("FAILS", "not installed")
            print(f"| {stage.name} | {outcome} | {told} |", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
