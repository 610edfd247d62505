"""Run the tests under other processors, threads, Pythons and library versions.

``make everywhere`` runs all of it (some hours on two cores), in cells of a machine and a folder of
tests; ``python benchmarks/everywhere.py WORD ...`` those with a word in their name, ``--list``
names them. What passes is noted in out/everywhere and not run again while source and tests are the
same, so that a run may be broken off and taken up. Prints the table of the report. Exit
code 1 if a cell fails.

A processor is imitated by what its libraries read when they load: OPENBLAS_CORETYPE picks the
kernels of the linear algebra, NPY_DISABLE_CPU_FEATURES the vector loops of numpy, NUMBA_CPU_NAME
those of our compiled kernels. Pythons that are not on the machine are left out and named.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import portable

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "out" / "everywhere"
RECORD = KEPT / "record.json"
LONGEST = 3600.0  # s, for a cell; one that takes longer hangs
PORTABLE = "portable"  # the cell that runs every command without the system calls of POSIX
WHEELS = "wheels"  # the cell that asks pip for wheels of other systems
BYTES = "bytes"  # the cell that builds every shipped stimulus and compares the files
# folders of tests that compute
NUMERIC = (
    "contact",
    "rig",
    "drag",
    "predict",
    "inspect",
    "bench",
    "rehearse",
    "lawsearch",
    "loop",
    "study",
)
TOP = "top"  # the tests that lie in no folder
OTHERS = (
    *(
        "artefacts",
        "build",
        "cad",
        "cli",
        "compute",
        "declaration",
        "files",
        "haptics",
        "literature",
    ),
    *("parts", "records", "scans", "simulators", "workshop", TOP),
)
# what names platform, Python or library versions, and a page that shows them
NAMING = {"manifest.json", "record.json", "index.html"}


@dataclass(frozen=True)
class Machine:
    """One machine to imitate."""

    name: str
    settings: dict[str, str] = field(default_factory=dict)  # environment
    python: str = ""  # version; an environment with it
    resolution: str = ""  # "lowest-direct" or "highest" of what pyproject.toml allows
    cells: tuple[str, ...] = (*NUMERIC, BYTES)


def no_simd() -> str:
    """Vector features that this numpy can disable on this processor."""
    code = (
        "from numpy._core._multiarray_umath import __cpu_dispatch__ as d, __cpu_features__ as f;"
        "print(*(n for n in d if f.get(n)))"
    )
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()


def machines() -> list[Machine]:
    """List few machines on which each setting stands at least once; the first four run in CI.

    The fourth differs from the third in everything that an imitated processor can change, so
    that its tests and the bytes of both say in CI what the machines below say one by one.
    """

    def threads(count: int, **more: str) -> dict[str, str]:
        return {"OMP_NUM_THREADS": str(count), "OPENBLAS_NUM_THREADS": str(count), **more}

    nehalem, whole = threads(1, OPENBLAS_CORETYPE="Nehalem"), (*NUMERIC, BYTES, *OTHERS)
    plain = {"NPY_DISABLE_CPU_FEATURES": no_simd(), "NUMBA_CPU_NAME": "generic"}
    haswell, zen = threads(4, OPENBLAS_CORETYPE="Haswell"), threads(1, OPENBLAS_CORETYPE="Zen")
    return [
        Machine("no system calls of POSIX, console of cp1252", cells=(PORTABLE,)),
        Machine("Windows, macOS, Linux on ARM", cells=(WHEELS,)),
        Machine("this processor", cells=(BYTES,)),
        Machine("no vector loops", nehalem | plain),
        Machine("OpenBLAS kernels of Nehalem", nehalem),
        Machine("Python 3.12, Haswell, 4 threads", haswell, "3.12", cells=whole),
        Machine("Python 3.13, Zen", zen, "3.13", cells=whole),
        Machine(
            "oldest libraries, SkylakeX",
            threads(1, OPENBLAS_CORETYPE="SkylakeX"),
            "3.11",
            "lowest-direct",
            whole,
        ),
        Machine("newest libraries, 4 threads", threads(4), "3.13", "highest", whole),
    ]


def state() -> str:
    """Hash of what the outcome of a cell hangs on."""
    files = [ROOT / "pyproject.toml", ROOT / "constraints.txt"]
    files += [path for name in ("src", "tests", "stimuli") for path in (ROOT / name).rglob("*")]
    known = hashlib.sha256()
    for path in sorted(
        path for path in files if path.is_file() and "__pycache__" not in path.parts
    ):
        known.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return known.hexdigest()[:16]


def commit() -> str:
    """Name the commit, with a star where the tree is another."""
    told = subprocess.run(
        ["git", "describe", "--always", "--dirty=*", "--exclude=*"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return told.stdout.strip() or "no repository"


def interpreter(version: str) -> str | None:
    """Path of a Python of this version."""
    known = [shutil.which(f"python{version}")]
    known += [
        str(path) for path in sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    ]
    return next((path for path in known if path and _answers(path)), None)


def _answers(python: str) -> bool:
    return subprocess.run([python, "--version"], capture_output=True, check=False).returncode == 0


def environment(machine: Machine) -> str | None:
    """Find the Python of a machine, in an environment of its own; None where there is none."""
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    if not machine.resolution and machine.python in ("", here):
        return sys.executable
    base = interpreter(machine.python)
    if base is None:
        return None
    wanted = hashlib.sha256(
        (ROOT / "pyproject.toml").read_bytes() + (ROOT / "constraints.txt").read_bytes()
    ).hexdigest()
    folder = KEPT / "environments" / f"{machine.python}-{machine.resolution or 'constraints'}"
    python, ready = str(folder / "bin" / "python"), folder / "ready"
    if ready.is_file() and ready.read_text() == wanted:
        return python
    subprocess.run([base, "-m", "venv", str(folder)], check=True)
    subprocess.run(
        [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "uv"], check=True
    )
    asked = (
        ["--resolution", machine.resolution]
        if machine.resolution
        else ["-c", str(ROOT / "constraints.txt")]
    )
    install = [python, "-m", "uv", "pip", "install", "-q", "--python", python]
    subprocess.run([*install, *asked, "-e", f"{ROOT}[dev]"], check=True)
    ready.write_text(wanted)
    return python


def tested(python: str, cell: str, settings: dict[str, str]) -> tuple[bool, dict[str, Any]]:
    """Run the tests of a folder; whether they pass, and how many did."""
    asked = (
        sorted(map(str, (ROOT / "tests").glob("test_*.py"))) if cell == TOP else [f"tests/{cell}"]
    )
    command = [
        python,
        "-m",
        "pytest",
        "-n",
        "auto",
        "--dist",
        "loadfile",
        "--no-loadscope-reorder",
        "-p",
        "no:cacheprovider",
        *asked,
    ]
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            env=settings,
            capture_output=True,
            text=True,
            check=False,
            timeout=LONGEST,
        )
    except subprocess.TimeoutExpired as late:
        print((late.stdout or b"").decode()[-6000:], file=sys.stderr)
        return False, {}
    if done.returncode:
        print(done.stdout[-6000:], done.stderr[-2000:], file=sys.stderr)
    counts = {
        kind: re.search(rf"(\d+) {kind}", done.stdout)
        for kind in ("passed", "failed", "skipped", "error")
    }
    return done.returncode == 0, {kind: int(found[1]) for kind, found in counts.items() if found}


def built(python: str, settings: dict[str, str]) -> tuple[bool, dict[str, Any]]:
    """Build every shipped stimulus; return success and the hash of each file without a machine."""
    with tempfile.TemporaryDirectory() as work:
        command = [python, "-m", "stepblocks", "build", "-o", work, "--jobs", "1", "--quiet"]
        done = subprocess.run(
            command, cwd=ROOT, env=settings, capture_output=True, text=True, check=False
        )
        print(done.stderr[-2000:], file=sys.stderr, end="")
        files = [
            path
            for path in sorted(Path(work).rglob("*"))
            if path.is_file() and path.name not in NAMING
        ]
        hashes = {
            str(path.relative_to(work)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in files
        }
    return done.returncode == 0, {"files": hashes}


def run(machine: Machine, cell: str) -> dict[str, Any]:
    """Outcome of a cell, and what was found."""
    try:
        python = environment(machine)
    except subprocess.CalledProcessError as error:
        return {"outcome": "not installed", "why": str(error)[:80]}
    if python is None:
        return {"outcome": "not run", "why": f"no Python {machine.python} here"}
    own = {"PYTHONPATH": str(ROOT / "src")}
    # this Python for this processor takes what the suite has compiled
    if python != sys.executable or "NUMBA_CPU_NAME" in machine.settings:
        own["NUMBA_CACHE_DIR"] = str(KEPT / "compiled" / re.sub(r"\W+", "-", machine.name))
    settings = {**os.environ, **machine.settings, **own}
    started = time.monotonic()
    if cell == PORTABLE:
        good, found = portable.check_commands(python, settings)
        pages_good, pages = portable.check_pages(python, settings)
        good = good and pages_good
        found = {count: found[count] + pages[count] for count in found}
    elif cell == WHEELS:
        good, found = portable.resolve_wheels()
    elif cell == BYTES:
        good, found = built(python, settings)
    else:
        good, found = tested(python, cell, settings)
    return {
        "outcome": "passes" if good else "FAILS",
        **found,
        "seconds": round(time.monotonic() - started),
    }


def row(machine: Machine, found: dict[str, dict[str, Any]]) -> str:
    """Line of the table: what was run on a machine and how it ended."""
    here = {
        cell: found[f"{machine.name}: {cell}"]
        for cell in machine.cells
        if f"{machine.name}: {cell}" in found
    }
    wrong = [
        f"{cell} {one['outcome']} {one.get('why', '')}".strip()
        for cell, one in here.items()
        if one["outcome"] != "passes"
    ]
    tests = [one for cell, one in here.items() if cell != BYTES]
    told = [
        f"{sum(one.get(kind, 0) for one in tests)} {kind}"
        for kind in ("passed", "failed", "skipped")
    ]
    if missing := [cell for cell in machine.cells if cell not in here]:
        told.append(f"not run: {', '.join(missing)}")
    # other versions of a kernel or a writer of meshes may write other bytes; the same ones must not
    alike = [f"{one.name}: {BYTES}" for one in machines() if one.resolution == machine.resolution]
    reference = next((found[name]["files"] for name in alike if name in found), {})
    if files := here.get(BYTES, {}).get("files"):
        other = sorted(
            name
            for name in reference.keys() | files.keys()
            if reference.get(name) != files.get(name)
        )
        told.append(
            f"{len(files)} files"
            if not other
            else f"{len(other)} files differ: {', '.join(other[:3])}"
        )
        wrong += ["bytes differ"] if other else []
    return (
        f"| {machine.name} | {'; '.join(wrong) or ('passes' if here else 'not run')} | "
        f"{', '.join(told)} |"
    )


def main() -> int:
    """Run the cells that are asked for and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("word", nargs="*", help="parts of names of cells (default: all)")
    parser.add_argument("--list", action="store_true", help="name the cells that would be run")
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), help="begin no cell after so long"
    )
    arguments = parser.parse_args()
    everything, now = machines(), state()
    record = json.loads(RECORD.read_text()) if RECORD.is_file() else {}
    found = {
        name: one
        for name, one in record.items()
        if one["state"] == now and one["outcome"] == "passes"
    }
    asked = [
        (f"{machine.name}: {cell}", machine, cell)
        for machine in everything
        for cell in machine.cells
    ]
    asked = [
        one for one in asked if not arguments.word or any(word in one[0] for word in arguments.word)
    ]
    pending = [one for one in asked if one[0] not in found]
    if arguments.list:
        print("\n".join(name for name, *_ in pending))
        return 0
    KEPT.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    for name, machine, cell in pending:
        if time.monotonic() - started > 60.0 * arguments.minutes:
            break
        print(name, end=" ", file=sys.stderr, flush=True)
        found[name] = {"state": now, "commit": commit(), **run(machine, cell)}
        print(
            found[name]["outcome"],
            f"{found[name].get('seconds', 0)} s",
            file=sys.stderr,
            flush=True,
        )
        record[name] = found[name]
        draft = RECORD.with_suffix(".draft")
        draft.write_text(json.dumps(record, indent=1))
        draft.replace(RECORD)
    chosen = {name for name, *_ in asked}
    print("| machine | outcome | tests |\n|---|---|---|")
    rows = [
        row(machine, found)
        for machine in everything
        if any(f"{machine.name}: {cell}" in chosen for cell in machine.cells)
    ]
    print("\n".join(rows))
    whole = [one for one in rows if "| passes |" in one and "not run" not in one]
    print(f"\n{len(whole)} of {len(everything)} machines pass")
    return int(
        any(found[name]["outcome"] in ("FAILS", "not installed") for name in chosen & found.keys())
        or any("differ" in one for one in rows)
    )


if __name__ == "__main__":
    sys.exit(main())
