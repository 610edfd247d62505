"""Run the tests under other processors, threads, Pythons and library versions.

``make everywhere`` runs all of it (some hours on two cores), in cells of a machine and a part of
the tests; ``python benchmarks/everywhere.py WORD ...`` those with a word in their name, ``--list``
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
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import portable
from joblib import cpu_count

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "out" / "everywhere"
RECORD = KEPT / "outcomes.json"
LONGEST = 3600.0  # for a cell; one that takes longer hangs [s]
SHOWN = 6000  # last characters of a cell that fails

# parts of a machine's work
PORTABLE = "portable"  # runs every command without the system calls of POSIX
WHEELS = "wheels"  # asks pip for wheels of other systems
BYTES = "bytes"  # builds every shipped stimulus and compares the files
NUMERIC = "numeric"  # the tests of the rooms that compute
OTHERS = "others"  # all other tests
ONE_PROCESS = (PORTABLE, WHEELS, BYTES)  # run as many at a time as there are cores
NUMERIC_FOLDERS = (
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
# what names platform, Python or library versions, and a page that shows them
NAMING = {"manifest.json", "record.json", "index.html"}
COUNTED = ("passed", "failed", "skipped", "error")
_environments = threading.Lock()  # of cells that run at a time, one sets an environment up


@dataclass(frozen=True)
class Machine:
    """One machine to imitate.

    Attributes
    ----------
    name : str
    settings : dict[str, str]
        Variables of the environment.
    python : str
        Version; an environment with it is set up.
    resolution : str
        "lowest-direct" or "highest" of what pyproject.toml allows; those of the constraints
        without it.
    cells : tuple[str, ...]
        What is run on it.
    """

    name: str
    settings: dict[str, str] = field(default_factory=dict)
    python: str = ""
    resolution: str = ""
    cells: tuple[str, ...] = (NUMERIC, BYTES)


@dataclass(frozen=True)
class Cell:
    """One part of the work on one machine."""

    machine: Machine
    part: str

    @property
    def name(self) -> str:
        """Name by which it is asked for and recorded."""
        return f"{self.machine.name}: {self.part}"


@dataclass(frozen=True)
class Outcome:
    """How a cell ended.

    Attributes
    ----------
    state : str
        Hash of source and tests, see `compute_state`.
    commit : str
    outcome : str
        "passes", "FAILS", "not run" or "not installed".
    why : str
        Why it was not run.
    seconds : int
    counts : dict[str, int]
        Tests or commands by how they ended.
    files : dict[str, str]
        Hashes of the files that were built.
    """

    state: str
    commit: str
    outcome: str
    why: str = ""
    seconds: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)


def list_vector_features() -> str:
    """List the vector features that this numpy can disable on this processor."""
    code = (
        "from numpy._core._multiarray_umath import __cpu_dispatch__ as d, __cpu_features__ as f;"
        "print(*(n for n in d if f.get(n)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def list_machines() -> list[Machine]:
    """List few machines on which each setting stands at least once; the first four run in CI.

    The fourth differs from the third in everything that an imitated processor can change, so
    that its tests and the bytes of both say in CI what the machines below say one by one.
    """
    whole = (NUMERIC, BYTES, OTHERS)
    nehalem = limit_threads(1) | {"OPENBLAS_CORETYPE": "Nehalem"}
    plain = {"NPY_DISABLE_CPU_FEATURES": list_vector_features(), "NUMBA_CPU_NAME": "generic"}
    haswell = limit_threads(4) | {"OPENBLAS_CORETYPE": "Haswell"}
    zen = limit_threads(1) | {"OPENBLAS_CORETYPE": "Zen"}
    skylake = limit_threads(1) | {"OPENBLAS_CORETYPE": "SkylakeX"}
    return [
        Machine("no system calls of POSIX, console of cp1252", cells=(PORTABLE,)),
        Machine("Windows, macOS, Linux on ARM", cells=(WHEELS,)),
        Machine("this processor", cells=(BYTES,)),
        Machine("no vector loops", nehalem | plain),
        Machine("OpenBLAS kernels of Nehalem", nehalem),
        Machine("Python 3.12, Haswell, 4 threads", haswell, "3.12", cells=whole),
        Machine("Python 3.13, Zen", zen, "3.13", cells=whole),
        Machine("oldest libraries, SkylakeX", skylake, "3.11", "lowest-direct", whole),
        Machine("newest libraries, 4 threads", limit_threads(4), "3.13", "highest", whole),
    ]


def limit_threads(count: int) -> dict[str, str]:
    """Return the settings that give the linear algebra a number of threads."""
    return {"OMP_NUM_THREADS": str(count), "OPENBLAS_NUM_THREADS": str(count)}


def list_cells(machines: Sequence[Machine]) -> list[Cell]:
    """List the cells of all machines."""
    cells = []
    for machine in machines:
        for part in machine.cells:
            cells.append(Cell(machine, part))
    return cells


def compute_state() -> str:
    """Return a hash of what the outcome of a cell depends on."""
    files = [ROOT / "pyproject.toml", ROOT / "constraints.txt"]
    for name in ("src", "tests", "stimuli"):
        for path in (ROOT / name).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                files.append(path)
    known = hashlib.sha256()
    for path in sorted(files):
        known.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return known.hexdigest()[:16]


def describe_commit() -> str:
    """Name the commit, with a star where the tree differs from it."""
    done = subprocess.run(
        ["git", "describe", "--always", "--dirty=*", "--exclude=*"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.strip() or "no repository"


def find_interpreter(version: str) -> str | None:
    """Find a Python of a version; None where there is none that runs."""
    found = [shutil.which(f"python{version}")]
    for path in sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python")):
        found.append(str(path))
    for python in found:
        if python and _runs(python):
            return python
    return None


def _runs(python: str) -> bool:
    """Tell whether an interpreter answers."""
    done = subprocess.run([python, "--version"], capture_output=True, check=False)
    return done.returncode == 0


def set_up_environment(machine: Machine) -> str | None:
    """Return the Python of a machine, in an environment of its own; None where there is none."""
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    if not machine.resolution and machine.python in ("", here):
        return sys.executable
    base = find_interpreter(machine.python)
    if base is None:
        return None
    declared = (ROOT / "pyproject.toml").read_bytes() + (ROOT / "constraints.txt").read_bytes()
    wanted = hashlib.sha256(declared).hexdigest()
    folder = KEPT / "environments" / f"{machine.python}-{machine.resolution or 'constraints'}"
    python, ready = str(folder / "bin" / "python"), folder / "ready"
    if ready.is_file() and ready.read_text(encoding="utf-8") == wanted:
        return python
    versions = ["-c", str(ROOT / "constraints.txt")]
    if machine.resolution:
        versions = ["--resolution", machine.resolution]
    pip = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    install = [python, "-m", "uv", "pip", "install", "-q", "--python", python]
    subprocess.run([base, "-m", "venv", str(folder)], check=True)
    subprocess.run([*pip, "uv"], check=True)
    subprocess.run([*install, *versions, "-e", f"{ROOT}[dev]"], check=True)
    ready.write_text(wanted, encoding="utf-8")
    return python


def list_tests(part: str) -> list[str]:
    """List the folders of tests of a part, and the files that lie in no folder."""
    if part == NUMERIC:
        return [f"tests/{folder}" for folder in NUMERIC_FOLDERS]
    found = []
    for path in sorted((ROOT / "tests").iterdir()):
        is_file = path.is_file() and path.match("test_*.py")
        is_folder = path.is_dir() and path.name not in NUMERIC_FOLDERS and any(path.glob("test_*"))
        if is_file or is_folder:
            found.append(str(path))
    return found


def run_tests(part: str, python: str, settings: Mapping[str, str]) -> tuple[bool, dict[str, int]]:
    """Run the quick tests of a part; return whether they pass, and how many ended in which way."""
    compile_kernels = [python, "benchmarks/compile_kernels.py"]
    subprocess.run(compile_kernels, cwd=ROOT, env=settings, capture_output=True, check=False)
    spread = ["-n", "auto", "--dist", "loadfile", "--no-loadscope-reorder"]
    command = [python, "-m", "pytest", *spread, "-p", "no:cacheprovider", *list_tests(part)]
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
        print((late.stdout or b"").decode()[-SHOWN:], file=sys.stderr)
        return False, {}
    if done.returncode:
        print(done.stdout[-SHOWN:], done.stderr[-SHOWN:], file=sys.stderr)
    counts = {}
    for kind in COUNTED:
        found = re.search(rf"(\d+) {kind}", done.stdout)
        if found:
            counts[kind] = int(found[1])
    return done.returncode == 0, counts


def build_stimuli(python: str, settings: Mapping[str, str]) -> tuple[bool, dict[str, str]]:
    """Build every shipped stimulus; return success and the hash of each file without a machine."""
    hashes = {}
    with tempfile.TemporaryDirectory() as work:
        command = [python, "-m", "stepblocks", "build", "-o", work, "--jobs", "1", "--quiet"]
        done = subprocess.run(
            command, cwd=ROOT, env=settings, capture_output=True, text=True, check=False
        )
        print(done.stderr[-SHOWN:], file=sys.stderr, end="")
        for path in sorted(Path(work).rglob("*")):
            if path.is_file() and path.name not in NAMING:
                name = path.relative_to(work).as_posix()
                hashes[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return done.returncode == 0, hashes


def run_cell(cell: Cell, state: str, commit: str) -> Outcome:
    """Run a cell; return how it ended."""
    machine = cell.machine
    try:
        with _environments:
            python = set_up_environment(machine)
    except subprocess.CalledProcessError as error:
        return Outcome(state, commit, "not installed", str(error)[:80])
    if python is None:
        return Outcome(state, commit, "not run", f"no Python {machine.python} here")
    settings = {**os.environ, **machine.settings, "PYTHONPATH": str(ROOT / "src")}
    # this Python for this processor takes what the suite has compiled
    if python != sys.executable or "NUMBA_CPU_NAME" in machine.settings:
        folder = re.sub(r"\W+", "-", machine.name)
        settings["NUMBA_CACHE_DIR"] = str(KEPT / "compiled" / folder)
    started = time.monotonic()
    counts: dict[str, int] = {}
    files: dict[str, str] = {}
    if cell.part == PORTABLE:
        commands_pass, of_commands = portable.check_commands(python, settings)
        pages_pass, of_pages = portable.check_pages(python, settings)
        passes = commands_pass and pages_pass
        counts = {kind: of_commands[kind] + of_pages[kind] for kind in of_commands}
    elif cell.part == WHEELS:
        passes, counts = portable.resolve_wheels()
    elif cell.part == BYTES:
        passes, files = build_stimuli(python, settings)
    else:
        passes, counts = run_tests(cell.part, python, settings)
    seconds = round(time.monotonic() - started)
    outcome = "passes" if passes else "FAILS"
    return Outcome(state, commit, outcome, seconds=seconds, counts=counts, files=files)


def run_cells(
    cells: Sequence[Cell], state: str, most_seconds: float
) -> Iterator[tuple[Cell, Outcome]]:
    """Run cells, those of one process as many at a time as there are cores.

    Yields
    ------
    cell : Cell
        One that was begun in time.
    outcome : Outcome
    """
    commit = describe_commit()
    started = time.monotonic()

    def run_in_time(cell: Cell) -> Outcome | None:
        """Run a cell; return None where the time is over."""
        if time.monotonic() - started > most_seconds:
            return None
        return run_cell(cell, state, commit)

    alone = [cell for cell in cells if cell.part not in ONE_PROCESS]
    beside = [cell for cell in cells if cell.part in ONE_PROCESS]
    with ThreadPoolExecutor(cpu_count()) as pool:
        outcomes = pool.map(run_in_time, beside)
        for cell, outcome in zip(beside, outcomes, strict=True):
            if outcome is not None:
                yield cell, outcome
    for cell in alone:
        outcome = run_in_time(cell)
        if outcome is not None:
            yield cell, outcome


def note_outcome(cell: Cell, outcome: Outcome) -> None:
    """Say an outcome, and put it into the record at once."""
    print(f"{cell.name} {outcome.outcome} {outcome.seconds} s", file=sys.stderr, flush=True)
    record = read_record()
    record[cell.name] = outcome
    KEPT.mkdir(parents=True, exist_ok=True)
    document = {name: asdict(known) for name, known in record.items()}
    draft = RECORD.with_suffix(".draft")
    draft.write_text(json.dumps(document, indent=1), encoding="utf-8")
    draft.replace(RECORD)


def read_record() -> dict[str, Outcome]:
    """Read the outcomes of earlier runs, by the names of their cells."""
    if not RECORD.is_file():
        return {}
    document: dict[str, dict[str, Any]] = json.loads(RECORD.read_text(encoding="utf-8"))
    return {name: Outcome(**values) for name, values in document.items()}


@dataclass(frozen=True)
class MachineResult:
    """What was run on a machine, and how it ended.

    Attributes
    ----------
    machine : Machine
    outcomes : dict[str, Outcome]
        By the part of its work.
    differing : list[str]
        Files with other bytes than on the first machine with the same libraries.
    """

    machine: Machine
    outcomes: dict[str, Outcome]
    differing: list[str]

    @property
    def passes(self) -> bool:
        """Whether all of its work was done and is right."""
        is_whole = len(self.outcomes) == len(self.machine.cells)
        return is_whole and not self.list_faults()

    def list_faults(self) -> list[str]:
        """List what is wrong, in words."""
        faults = []
        for part, outcome in self.outcomes.items():
            if outcome.outcome != "passes":
                faults.append(f"{part} {outcome.outcome} {outcome.why}".strip())
        if self.differing:
            faults.append("bytes differ")
        return faults

    def format_row(self) -> str:
        """Return the row of the table."""
        result = "; ".join(self.list_faults())
        if not result:
            result = "passes" if self.outcomes else "not run"
        said = []
        for kind in COUNTED[:3]:
            count = sum(outcome.counts.get(kind, 0) for outcome in self.outcomes.values())
            said.append(f"{count} {kind}")
        missing = [part for part in self.machine.cells if part not in self.outcomes]
        if missing:
            said.append(f"not run: {', '.join(missing)}")
        said += self._describe_files()
        return f"| {self.machine.name} | {result} | {', '.join(said)} |"

    def _describe_files(self) -> list[str]:
        """Return how many files were built, or which of them differ; empty where none were."""
        if self.differing:
            return [f"{len(self.differing)} files differ: {', '.join(self.differing[:3])}"]
        built = self.outcomes.get(BYTES)
        if built is None or not built.files:
            return []
        return [f"{len(built.files)} files"]


def find_differing_files(
    machine: Machine, machines: Sequence[Machine], outcomes: Mapping[str, Outcome]
) -> list[str]:
    """List the files of a machine that have other bytes than those of the first like it.

    Other versions of a kernel or a writer of meshes may write other bytes; the same ones must not.
    """
    own = outcomes.get(Cell(machine, BYTES).name)
    if own is None:
        return []
    alike = [known for known in machines if known.resolution == machine.resolution]
    reference = own.files
    for known in alike:
        built = outcomes.get(Cell(known, BYTES).name)
        if built is not None:
            reference = built.files
            break
    differing = []
    for name in sorted(reference.keys() | own.files.keys()):
        if reference.get(name) != own.files.get(name):
            differing.append(name)
    return differing


def judge_machines(
    machines: Sequence[Machine], outcomes: Mapping[str, Outcome]
) -> list[MachineResult]:
    """Gather the outcomes of the cells of each machine, by the names of the cells."""
    results = []
    for machine in machines:
        of_parts = {}
        for part in machine.cells:
            name = Cell(machine, part).name
            if name in outcomes:
                of_parts[part] = outcomes[name]
        differing = find_differing_files(machine, machines, outcomes)
        results.append(MachineResult(machine, of_parts, differing))
    return results


def parse_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("word", nargs="*", help="parts of names of cells (default: all)")
    parser.add_argument("--list", action="store_true", help="name the cells that would be run")
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), help="begin no cell after so long"
    )
    return parser.parse_args()


def main() -> int:
    """Run the cells that are asked for and print the table."""
    arguments = parse_arguments()
    machines = list_machines()
    state = compute_state()
    asked = select_cells(list_cells(machines), arguments.word)
    outcomes = read_passing_outcomes(state)
    pending = [cell for cell in asked if cell.name not in outcomes]
    if arguments.list:
        print("\n".join(cell.name for cell in pending))
        return 0
    for cell, outcome in run_cells(pending, state, 60.0 * arguments.minutes):
        note_outcome(cell, outcome)
        outcomes[cell.name] = outcome
    results = judge_machines(machines, outcomes)
    print_machines(results, asked)
    differs = any(result.differing for result in results)
    failed = False
    for cell in asked:
        if cell.name in outcomes:
            failed |= outcomes[cell.name].outcome in ("FAILS", "not installed")
    return int(failed or differs)


def select_cells(cells: list[Cell], words: list[str]) -> list[Cell]:
    """Select the cells whose names hold one of the words; all without a word."""
    if not words:
        return cells
    return [cell for cell in cells if any(word in cell.name for word in words)]


def read_passing_outcomes(state: str) -> dict[str, Outcome]:
    """Read the outcomes of the cells that pass with the present code, by name."""
    outcomes = {}
    for name, outcome in read_record().items():
        if outcome.state == state and outcome.outcome == "passes":
            outcomes[name] = outcome
    return outcomes


def print_machines(results: list[MachineResult], asked: list[Cell]) -> None:
    """Print the table of the machines that were asked for, and how many of all pass."""
    print("| machine | outcome | tests |\n|---|---|---|")
    for result in results:
        if any(cell.machine == result.machine for cell in asked):
            print(result.format_row())
    passing = sum(result.passes for result in results)
    print(f"\n{passing} of {len(results)} machines pass")


if __name__ == "__main__":
    sys.exit(main())
