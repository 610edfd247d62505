"""Change the core in one place at a time, and see whether the tests notice.

python benchmarks/mutations.py [ROOM ...] [--count N] [--jobs N] [--record FILE]
python benchmarks/mutations.py --sample 20 --seed 7 --seconds 300

A mutant changes one operator, number or condition of one function in a copy of the checkout. It is
noticed when a test fails. The full run goes room by room in an order drawn from ``--seed``, keeps
every outcome in the record and goes on from there the next time; a mutant that the tests of its
module let pass is tried against all tests of its room (not with ``--near``). A sample tries few
mutants of all rooms, 60 s each and ``--seconds`` in all; what does not end in that time is
undecided. Its exit code is 1 only where fewer than half of at least six that ended are noticed.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

ROOT = Path(__file__).resolve().parents[1]
HOUSE = Path("src") / "stepblocks"
# room of the source, and the folder of its tests
ROOMS = {
    "contact": "contact",
    "drag": "drag",
    "inspect": "inspect",
    "loop/search": "loop",
    "study/analysis": "study",
    "predict": "predict",
    "bench/signal": "bench",
}
EQUIVALENT = ROOT / "benchmarks" / "mutations_equivalent.json"
COMPARE = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
REVERSED = {ast.Lt: ast.Gt, ast.LtE: ast.Gt, ast.Gt: ast.Lt, ast.GtE: ast.Lt}
ARITHMETIC = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
}
CALLS = {"min": "max", "max": "min", "any": "all", "all": "any", "floor": "ceil", "ceil": "floor"}
CALLS |= {"minimum": "maximum", "maximum": "minimum", "sin": "cos", "cos": "sin"}
MEMORY = 6 * 2**30  # B, of one run of tests
SLOW = 30.0  # s; slower tests are left out of the runs of mutants


@dataclass(frozen=True)
class Mutant:
    """One change of one expression."""

    room: str
    path: str
    function: str
    line: int
    span: tuple[int, int]  # bytes of the file
    before: str
    after: str

    @property
    def key(self) -> str:
        """Name that stays the same while the function stays the same."""
        text = "|".join((self.path, self.function, self.before, self.after))
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {self.function}: {self.before}  ->  {self.after}"


def changed(node: ast.expr) -> Iterator[ast.expr]:
    """Yield each changed form of an expression."""
    if isinstance(node, ast.Compare):
        for table in (COMPARE, REVERSED):
            for place, operator in enumerate(node.ops):
                if type(operator) in table:
                    operators = list(node.ops)
                    operators[place] = table[type(operator)]()
                    yield ast.Compare(node.left, operators, node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
        if not any(
            isinstance(one, ast.Constant | ast.JoinedStr) and not is_number(one)
            for one in (node.left, node.right)
        ):
            yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif is_number(node):
        yield ast.Constant(
            node.value + 1 if isinstance(node.value, int) else node.value * 1.2 or 0.1
        )
    elif isinstance(node, ast.Call):
        name = (
            node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        )
        if name in CALLS:
            other = (
                ast.Attribute(node.func.value, CALLS[name], ast.Load())
                if isinstance(node.func, ast.Attribute)
                else ast.Name(CALLS[name], ast.Load())
            )
            yield ast.Call(other, node.args, node.keywords)
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)


def is_number(node: ast.AST) -> bool:
    """Whether a node is a literal number."""
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    )


def expressions(function: ast.FunctionDef) -> Iterator[ast.expr]:
    """Yield the expressions of a function that compute: no annotation, message or text."""

    def walk(node: ast.AST) -> Iterator[ast.expr]:
        for name, value in ast.iter_fields(node):
            if name in {"annotation", "returns", "decorator_list", "format_spec"}:
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.Raise | ast.JoinedStr | ast.Assert):
                    continue
                if isinstance(child, ast.FunctionDef | ast.ClassDef):
                    continue  # they are walked by themselves
                if isinstance(child, ast.expr):
                    yield child
                if isinstance(child, ast.AST):
                    yield from walk(child)

    yield from walk(function)


def functions(tree: ast.AST, outer: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield every function with its dotted name."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            yield outer + node.name, node
            yield from functions(node, f"{outer}{node.name}.")
        elif isinstance(node, ast.ClassDef):
            yield from functions(node, f"{outer}{node.name}.")
        else:
            yield from functions(node, outer)


def find_mutants(root: Path, room: str) -> list[Mutant]:
    """List every mutant of a room, each change of a function once."""
    found: dict[str, Mutant] = {}
    for path in sorted((root / HOUSE / room).rglob("*.py")):
        source = path.read_bytes()
        starts = [0]
        for line in source.splitlines(keepends=True):
            starts.append(starts[-1] + len(line))
        name = path.relative_to(root).as_posix()
        for function, node in functions(ast.parse(source)):
            for one in expressions(node):
                span = (
                    starts[one.lineno - 1] + one.col_offset,
                    starts[one.end_lineno - 1] + one.end_col_offset,
                )
                before = source[slice(*span)].decode()
                for form in changed(one):
                    after = ast.unparse(ast.fix_missing_locations(form))
                    after = after if isinstance(form, ast.Constant) else f"({after})"
                    mutant = Mutant(room, name, function, one.lineno, span, before, after)
                    found.setdefault(mutant.key, mutant)
    return list(found.values())


def tests_of(root: Path, mutant: Mutant) -> list[str]:
    """Name the files of tests that speak of a module, those that name the function first."""
    folder = root / "tests" / ROOMS[mutant.room]
    module = ".".join(Path(mutant.path).with_suffix("").parts[1:])
    stem = module.rpartition(".")[2]
    last = mutant.function.rpartition(".")[2].strip("_")
    say_module = re.compile(
        rf"{re.escape(module)}\b|from {re.escape(module.rpartition('.')[0])} import[^\n]*\b{stem}\b"
    )
    say_function = re.compile(rf"\b{re.escape(last)}\b")
    ranked = []
    for path in sorted(folder.rglob("test_*.py")):
        text = path.read_text(encoding="utf-8")
        named = bool(say_module.search(text)), bool(say_function.search(text)), stem in path.stem
        if any(named):
            ranked.append((-sum(named), path.relative_to(root).as_posix()))
    return [name for _, name in sorted(ranked)] or [folder.relative_to(root).as_posix()]


def room_tests(root: Path, mutant: Mutant) -> list[str]:
    """Name all files of tests of the room of a mutant."""
    folder = root / "tests" / ROOMS[mutant.room]
    return sorted(path.relative_to(root).as_posix() for path in folder.rglob("test_*.py"))


class Tree:
    """A copy of the checkout in which one mutant at a time stands."""

    def __init__(self, folder: Path):
        self.root = folder
        junk = shutil.ignore_patterns(".git", "out", ".venv", ".hypothesis", "site", "*.egg-info")
        shutil.copytree(ROOT, folder, ignore=junk, dirs_exist_ok=True)
        (folder / "out").mkdir(exist_ok=True)

    def run(self, tests: list[str], limit: float, *words: str, mutant: Mutant | None = None) -> str:
        """Run tests: ``passed``, ``failed``, ``time`` or ``none``; a mutant stands meanwhile."""
        environment = {
            **os.environ,
            "PYTHONPATH": str(self.root / "src"),
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        with tempfile.TemporaryDirectory() as scratch:
            path = self.root / mutant.path if mutant else None
            whole = path.read_bytes() if path else b""
            try:
                if path and mutant:
                    start, end = mutant.span
                    path.write_bytes(whole[:start] + mutant.after.encode() + whole[end:])
                    if b"numba" in whole:  # compiled callers of a kernel are cached, too
                        environment["NUMBA_CACHE_DIR"] = f"{scratch}/numba"
                command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
                command += ["--basetemp", f"{scratch}/base", *words, *tests]
                return self._outcome(command, environment, limit)
            finally:
                if path:
                    path.write_bytes(whole)

    def _outcome(self, command: list[str], environment: dict[str, str], limit: float) -> str:
        process = subprocess.Popen(
            command,
            cwd=self.root,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            preexec_fn=bounded,
        )
        try:
            process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return "time"
        # 5: no test is left after those that are slow or fail anyhow
        return {0: "passed", 1: "failed", 2: "failed", 5: "passed"}.get(
            process.returncode, "failed"
        )


def bounded() -> None:
    """Hold a run of tests to its memory, and let others go first."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    os.nice(10)


class Baseline:
    """How long tests take without a mutant, and which of them are slow or fail anyhow."""

    def __init__(self) -> None:
        self.known: dict[tuple[str, ...], tuple[float, list[str]]] = {}

    def of(self, tree: Tree, tests: list[str]) -> tuple[float, list[str]]:
        """Seconds of the tests that mutants meet, and the words that leave the others out."""
        missing = [one for one in tests if (one,) not in self.known]
        for one in missing:
            with tempfile.NamedTemporaryFile(suffix=".xml") as report:
                tree.run([one], 600.0, f"--junitxml={report.name}")
                try:
                    cases = list(ET.parse(report.name).iter("testcase"))
                except ET.ParseError:
                    cases = []
            seconds, left_out = 0.0, []
            for case in cases:
                spent = float(case.get("time", 0.0))
                bad = case.find("failure") is not None or case.find("error") is not None
                if bad or spent > SLOW:
                    place = case.get("classname", "").replace(".", "/") + ".py"
                    left_out += ["--deselect", f"{place}::{case.get('name')}"]
                else:
                    seconds += spent
            self.known[(one,)] = (seconds, left_out if cases else ["--ignore", one])
        parts = [self.known[(one,)] for one in tests]
        return sum(part[0] for part in parts), [word for part in parts for word in part[1]]


def try_one(tree: Tree, mutant: Mutant, baseline: Baseline, near_only: bool) -> dict[str, object]:
    """Run the tests of the module and, if these pass, those of the whole room."""
    begun = time.monotonic()
    near = tests_of(tree.root, mutant)
    everything = room_tests(tree.root, mutant)
    if not near[0].endswith(".py"):
        near = everything
    rest = [] if near_only else [one for one in everything if one not in near]
    for tests in (near, rest):
        if tests:
            seconds, words = baseline.of(tree, tests)
            outcome = tree.run(tests, 60.0 + 4.0 * seconds, "-x", *words, mutant=mutant)
            if outcome not in {"passed", "none"}:
                break
    return {**described(mutant, outcome, begun), "tests": "module" if near_only else "room"}


def described(mutant: Mutant, outcome: str, begun: float) -> dict[str, object]:
    """Make the line of the record; tests that no longer end have noticed, too."""
    said = "survived" if outcome in {"passed", "none"} else "noticed"
    return {
        "key": mutant.key,
        "room": mutant.room,
        "outcome": said,
        "by": outcome,
        "mutant": str(mutant),
        "seconds": round(time.monotonic() - begun, 1),
    }


def run_all(mutants: list[Mutant], jobs: int, record: Path, near_only: bool) -> None:
    """Try every mutant that the record lacks, several at a time."""
    record.parent.mkdir(parents=True, exist_ok=True)
    baselines: Baseline = Baseline()
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        trees: Queue[Tree] = Queue()
        for number in range(jobs):
            trees.put(Tree(Path(scratch) / str(number)))

        def one(mutant: Mutant) -> None:
            tree = trees.get()
            try:
                line = try_one(tree, mutant, baselines, near_only)
            finally:
                trees.put(tree)
            with record.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
            print(f"{line['outcome']:9} {line['seconds']:6} s  {line['mutant']}", flush=True)

        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(one, mutants))


def sample(mutants: list[Mutant], seconds: float) -> int:
    """Try a few, the tests of their module first, as far as the time goes."""
    end = time.monotonic() + seconds
    tried: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        tree = Tree(Path(scratch))
        for mutant in mutants:
            left = end - time.monotonic()
            if left < 5.0:
                break
            begun = time.monotonic()
            near = tests_of(tree.root, mutant)
            rest = [one for one in room_tests(tree.root, mutant) if one not in near]
            tests = near + rest if near[0].endswith(".py") else rest
            outcome = tree.run(tests, min(left, 60.0), "-x", mutant=mutant)
            if outcome in {"time", "none"}:
                print(f"undecided after {time.monotonic() - begun:.0f} s  {mutant}", flush=True)
                continue
            tried.append(described(mutant, outcome, begun))
            print(f"{tried[-1]['outcome']:9} {tried[-1]['mutant']}", flush=True)
    noticed = sum(line["outcome"] == "noticed" for line in tried)
    print(f"{noticed} of {len(tried)} mutants noticed")
    return int(len(tried) >= 6 and 2 * noticed < len(tried))


def read_record(record: Path) -> list[dict[str, str]]:
    """Read the last outcome of every mutant."""
    text = record.read_text(encoding="utf-8") if record.exists() else ""
    lines = [json.loads(line) for line in text.splitlines()]
    return list({line["key"]: line for line in lines}.values())


def summary(record: Path) -> int:
    """Print the share of every room, and each survivor with the reason where it is equivalent."""
    lines = read_record(record)
    reasons = json.loads(EQUIVALENT.read_text(encoding="utf-8")) if EQUIVALENT.exists() else {}
    print("\n| room | mutants | noticed | equivalent | survive |\n|---|---|---|---|---|")
    for room in [*ROOMS, None]:
        own = [line for line in lines if room in (None, line["room"])]
        noticed = sum(line["outcome"] == "noticed" for line in own)
        equal = sum(line["outcome"] == "survived" and line["key"] in reasons for line in own)
        rest = len(own) - noticed - equal
        print(f"| {room or 'all'} | {len(own)} | {noticed} | {equal} | {rest} |")
    for line in lines:
        if line["outcome"] == "survived":
            reason = reasons.get(line["key"], "survives")
            print(f"- `{line['key']}` {line['mutant']}: {reason}")
    return 0


def main() -> int:
    """Run as asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", help=f"of {', '.join(ROOMS)}; all when left out")
    parser.add_argument("--count", type=int, default=60, help="mutants of each room (default 60)")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--record", type=Path, default=ROOT / "out" / "mutations.jsonl")
    parser.add_argument(
        "--near", action="store_true", help="run the tests of the module alone; quicker"
    )
    parser.add_argument("--sample", type=int, help="so many mutants of all rooms, and no record")
    parser.add_argument("--seconds", type=float, default=300.0, help="that a sample may take")
    parser.add_argument("--summary", action="store_true", help="only print what the record holds")
    asked = parser.parse_args()
    unknown = [room for room in asked.rooms if room not in ROOMS]
    if unknown:
        parser.error(f"unknown room {', '.join(unknown)}; there are {', '.join(ROOMS)}")
    if asked.summary:
        return summary(asked.record)
    draw = random.Random(asked.seed)
    chosen = []
    for room in asked.rooms or ROOMS:
        of_room = find_mutants(ROOT, room)
        draw.shuffle(of_room)
        chosen.append(of_room)
    if asked.sample:
        pool = [mutant for of_room in chosen for mutant in of_room]
        return sample(draw.sample(pool, asked.sample), asked.seconds)
    done = {
        line["key"]
        for line in read_record(asked.record)
        if line["outcome"] == "noticed" or line["tests"] == "room" or asked.near
    }
    # the rooms take turns, so that a run that is broken off has seen them all
    turns = [
        of_room[place] for place in range(asked.count) for of_room in chosen if place < len(of_room)
    ]
    left = [mutant for mutant in turns if mutant.key not in done]
    run_all(left, asked.jobs, asked.record, asked.near)
    return summary(asked.record)


if __name__ == "__main__":
    sys.exit(main())
