"""Change the core in one place at a time, and see whether the tests notice.

python benchmarks/mutations.py [ROOM ...] [--count N] [--seed N] [--record FILE]
python benchmarks/mutations.py --keys KEY ... [--tests "tests/drag/test_drag.py -k foot"]
python benchmarks/mutations.py --sample 20 --seed 7 --seconds 300

A mutant changes one operator, number or condition of one function in a copy of the checkout. It is
noticed when a test fails. The full run goes room by room in an order drawn from ``--seed``, keeps
every outcome in the record and goes on from there the next time. A mutant meets the tests of its
room that call its function, the quickest first, then the other tests of these files; which tests
call what is measured once and kept beside the record (``reach-ROOM.json``; delete it to measure
again). Survivors that no test can notice stand with their reason in
``mutations_equivalent.json``; there, too, those ``chosen``: a width of a line or an allowance for
which there is no expected value, and which count as survivors. A sample tries few
mutants of all rooms, 60 s each for the quick tests and, where these pass, 60 s for the long ones,
and ``--seconds`` in all; what does not end in that time is undecided. Its exit code is 1 where more
than three, and more than a share of ``--survivors`` of those that ended, survive; equivalent ones
are not tried.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import gc
import hashlib
import importlib
import json
import os
import random
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeGuard

import pytest
from hypothesis import Phase, settings

ROOT = Path(__file__).resolve().parents[1]
HOUSE = Path("src") / "stepblocks"
# room of the source, and the folder of its tests
ROOMS = {
    "contact": "contact",
    "drag": "drag",
    "inspect": "inspect",
    "lawsearch": "lawsearch",
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
MOST_OF_SAMPLE = 60.0  # s, for the quick and for the long tests of a mutant of a sample
LEAST_LEFT = 5.0  # s, in which a run of tests can begin
SLOW = 30.0  # s; slower tests are left out of the runs of mutants
SHIPPED = 15.0  # s to build the shipped stimuli, for the tests that need them
UNKNOWN = 1.0  # s, of a test that is newer than what was measured
# 5: no test is left after those that are slow
OUTCOMES = {0: "passed", 5: "passed", -signal.SIGPROF: "time"}
PRELOADED = ("numpy", "scipy.optimize", "scipy.stats", "scipy.signal", "scipy.interpolate")
PRELOADED += (
    "hypothesis",
    "pandas",
    "numba",
    "pydantic",
    "matplotlib.figure",
    "typer",
    "lxml.etree",
    "jinja2",
)


def compute_key(path: str, function: str, before: str, after: str) -> str:
    """Compute the key of a change of an expression of a function."""
    text = "|".join((path, function, before, after))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


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
        return compute_key(self.path, self.function, self.before, self.after)

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {self.function}: {self.before}  ->  {self.after}"


def changed(node: ast.expr) -> Iterator[ast.expr]:
    """Yield each changed form of an expression."""
    if isinstance(node, ast.Compare):
        yield from changed_comparisons(node)
    elif isinstance(node, ast.BinOp):
        yield from changed_arithmetic(node)
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
        yield from changed_calls(node)
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)


def changed_comparisons(node: ast.Compare) -> Iterator[ast.expr]:
    """Yield a comparison with one operator shifted, then with one turned round."""
    for table in (COMPARE, REVERSED):
        for place, operator in enumerate(node.ops):
            if type(operator) in table:
                operators = list(node.ops)
                operators[place] = table[type(operator)]()
                yield ast.Compare(node.left, operators, node.comparators)


def changed_arithmetic(node: ast.BinOp) -> Iterator[ast.expr]:
    """Yield an expression with another operator, unless it may join texts."""
    if type(node.op) not in ARITHMETIC or is_text(node.left) or is_text(node.right):
        return
    yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)


def changed_calls(node: ast.Call) -> Iterator[ast.expr]:
    """Yield the call of another function, where that is known to take the same arguments."""
    function: ast.expr
    if isinstance(node.func, ast.Attribute) and node.func.attr in CALLS:
        function = ast.Attribute(node.func.value, CALLS[node.func.attr], ast.Load())
        yield ast.Call(function, node.args, node.keywords)
    if isinstance(node.func, ast.Name) and node.func.id in CALLS:
        function = ast.Name(CALLS[node.func.id], ast.Load())
        yield ast.Call(function, node.args, node.keywords)


def is_text(node: ast.AST) -> bool:
    """Whether an operand is a text, or another constant that is no number."""
    return isinstance(node, ast.Constant | ast.JoinedStr) and not is_number(node)


def is_number(node: ast.AST) -> TypeGuard[ast.Constant]:
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

    @contextlib.contextmanager
    def changed(self, mutant: Mutant | None) -> Iterator[bool]:
        """Let a mutant stand meanwhile; says whether its file holds kernels to compile."""
        path = self.root / mutant.path if mutant else None
        whole = path.read_bytes() if path else b""
        try:
            if path and mutant:
                times = path.stat().st_atime_ns, path.stat().st_mtime_ns
                start, end = mutant.span
                path.write_bytes(whole[:start] + mutant.after.encode() + whole[end:])
            yield b"numba" in whole  # compiled callers of a kernel are cached, too
        finally:
            if path:
                path.write_bytes(whole)
                os.utime(path, ns=times)  # so that what is compiled of it still counts

    def run(self, tests: list[str], limit: float, *words: str, mutant: Mutant | None = None) -> str:
        """Run tests: ``passed``, ``failed`` or ``time``; a mutant stands meanwhile."""
        paths = [str(self.root / "src"), str(self.root / "benchmarks")]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(paths),
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        with tempfile.TemporaryDirectory() as scratch, self.changed(mutant) as compiled:
            if compiled:
                environment["NUMBA_CACHE_DIR"] = f"{scratch}/numba"
            command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
            command += ["--basetemp", f"{scratch}/base", *words, *tests]
            return self._outcome(command, environment, limit)

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
        return OUTCOMES.get(process.returncode, "failed")


def bounded() -> None:
    """Hold a run of tests to its memory, and let others go first."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    os.nice(max(0, 10 - os.nice(0)))


class Reach:
    """Which tests of each room call which function, measured once for each room and kept."""

    def __init__(self, folder: Path, near: bool = False, enough: float = 120.0) -> None:
        self.folder, self.near, self.enough = folder, near, enough
        self.known: dict[str, dict[str, Any]] = {}
        self.collected: dict[str, dict[str, float]] = {}

    def of(self, tree: Tree, room: str) -> dict[str, Any]:
        """Read what is known of a room, or run its tests under the plugin that watches calls."""
        if room not in self.known:
            path = self.folder / f"reach-{ROOMS[room]}.json"
            if not path.exists() and self.near:
                return {"seconds": {}, "failed": [], "tests": {}, "setups": {}}
            if not path.exists():
                print(f"{room}: which tests call which function", flush=True)
                os.environ |= {"REACH_SOURCE": str(tree.root), "REACH_RECORD": str(path)}
                tree.run([f"tests/{ROOMS[room]}"], 7200.0, "-p", "mutations_reach")
            self.known[room] = json.loads(path.read_text(encoding="utf-8"))
        return self.known[room]

    def collect(self, tree: Tree, room: str) -> dict[str, float]:
        """List the tests that a room has now, with the seconds that each takes."""
        if room not in self.collected:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "tests"
                words = "--collect-only", f"tests/{ROOMS[room]}"
                run_forked(tree, [], 600.0, None, Collected(path), *words)
                found = json.loads(path.read_text(encoding="utf-8"))
            known = self.of(tree, room)
            self.collected[room] = {
                test: known["seconds"].get(test, UNKNOWN) + SHIPPED * shipped
                for test, shipped in found.items()
                if test not in known["failed"]
            }
        return self.collected[room]

    def tests_for(self, tree: Tree, mutant: Mutant) -> dict[str, float]:
        """Name the tests that a mutant must pass in their order, with the seconds of each.

        First the tests that call its function, then the other tests of their files and of those
        that name its module; the quickest first, and as many as are enough. What fails anyhow or
        is slow is left out. Compiled kernels are not seen when they are called: there the tests
        count that call the modules around them.
        """
        found, spent = self.of(tree, mutant.room), self.collect(tree, mutant.room)
        name = f"{mutant.path}::{mutant.function}"
        direct = {*found["tests"].get(name, []), *found["setups"].get(name, [])}
        if not direct and b"numba" in (tree.root / mutant.path).read_bytes():
            direct = find_tests_around(tree, mutant, found["tests"])
        named = [test for test in tests_of(tree.root, mutant) if test.endswith(".py")]
        files = {file_of(test) for test in direct} | set(named)
        # tests that are newer than what was measured may call it, too
        for test in spent:
            if test not in found["seconds"] and file_of(test) in files:
                direct.add(test)
        order = []
        for test, seconds in spent.items():
            is_near = not files or test in direct or file_of(test) in files
            if seconds > SLOW or not is_near:
                continue
            is_elsewhere = seconds > 1.0 and file_of(test) not in named
            order.append((test not in direct, is_elsewhere, seconds, test))
        return self.choose_first(sorted(order))

    def choose_first(self, order: list[tuple[bool, bool, float, str]]) -> dict[str, float]:
        """Choose as many tests as are enough, in order, the first in any case."""
        chosen, total = {}, 0.0
        for *_, seconds, test in order:
            total += seconds
            if total <= self.enough or not chosen:
                chosen[test] = seconds
        return chosen


def file_of(test: str) -> str:
    """Name the file of a test, or of a function, as ``file::name``."""
    return test.split("::")[0]


def find_tests_around(tree: Tree, mutant: Mutant, calls: dict[str, list[str]]) -> set[str]:
    """Find the tests that call the modules which name that of a mutant; `calls` are by function."""
    stem = Path(mutant.path).stem
    around = set()
    for path in (tree.root / HOUSE / mutant.room).rglob("*.py"):
        if re.search(rf"\b{stem}\b", path.read_text(encoding="utf-8")):
            around.add(path.relative_to(tree.root).as_posix())
    found = set()
    for function, tests in calls.items():
        if file_of(function) in around:
            found.update(tests)
    return found


class FirstFailure:
    """A plugin of pytest that writes down which test failed first, and bounds what each computes.

    A test that computes far longer than without the mutant ends this process.
    """

    def __init__(self, path: Path, seconds: dict[str, float]) -> None:
        self.path, self.seconds = path, seconds

    def pytest_sessionstart(self, session: Any) -> None:
        """Let hypothesis stop at the first example that fails: no smaller one is looked for."""
        phases = (Phase.explicit, Phase.generate)
        settings.register_profile("mutants", settings(), phases=phases)
        settings.load_profile("mutants")

    def pytest_runtest_setup(self, item: Any) -> None:
        """Set the limit of a test."""
        seconds = self.seconds.get(item.nodeid, SLOW)
        signal.setitimer(signal.ITIMER_PROF, 15.0 + 6.0 * seconds)

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Keep the first one."""
        if report.failed and not self.path.exists():
            self.path.write_text(report.nodeid, encoding="utf-8")


class Collected:
    """A plugin of pytest that writes down the tests that there are, and what they share."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def pytest_collection_finish(self, session: Any) -> None:
        """Write every test, and whether it waits for the shipped stimuli to be built."""
        found = {item.nodeid: "shipped_output" in item.fixturenames for item in session.items}
        self.path.write_text(json.dumps(found), encoding="utf-8")


def patch(tree: Tree, mutant: Mutant) -> bool:
    """Put the changed code of a mutant into the functions that this process has loaded.

    Whether that is all there is to change: not where a kernel is compiled from the source, where
    the change is not within the code of a function (a default), or the module is not loaded.
    """
    path = tree.root / mutant.path
    source = path.read_bytes()
    if b"numba" in source:
        return False
    new = find_codes(compile(source, str(path), "exec"), {})
    start, end = mutant.span
    size = end - start
    whole = source[:start] + mutant.before.encode() + source[start + len(mutant.after.encode()) :]
    old = find_codes(compile(whole, str(path), "exec"), {})
    assert size == len(mutant.before.encode())
    name = mutant.function
    while name and name not in old:
        name = name.rpartition(".")[0]
    if not name or old[name] == new[name]:
        return False
    loaded = [
        one
        for one in gc.get_objects()
        if type(one) is FunctionType  # no proxy of what is gone
        and one.__code__.co_filename == str(path)
        and one.__code__.co_qualname == name
    ]
    for one in loaded:
        one.__code__ = new[name]
    return bool(loaded)


def find_codes(code: CodeType, found: dict[str, CodeType]) -> dict[str, CodeType]:
    """Find the code of the functions of a module and of its classes by their dotted names."""
    for one in code.co_consts:
        if isinstance(one, CodeType) and "<" not in one.co_qualname:
            found.setdefault(one.co_qualname, one)
            find_codes(one, found)
    return found


def preload(tree: Tree) -> None:
    """Load the libraries and the source, once for all forks."""
    sys.dont_write_bytecode = True
    sys.path[:] = [str(tree.root / "src"), *(one for one in sys.path if "stepblocks" not in one)]
    for path in sorted((tree.root / HOUSE).rglob("*.py")):
        name = ".".join(path.relative_to(tree.root / "src").with_suffix("").parts)
        if not name.endswith("__main__") and "/cli/" not in str(path):
            with contextlib.suppress(ImportError):
                importlib.import_module(name.removesuffix(".__init__"))
    for library in PRELOADED:
        with contextlib.suppress(ImportError):
            importlib.import_module(library)


def run_forked(
    tree: Tree,
    tests: list[str],
    limit: float,
    mutant: Mutant | None,
    plugin: object = None,
    *words: str,
) -> str:
    """Run tests as `Tree.run` does, in a fork of this process, which has all code loaded."""
    with tempfile.TemporaryDirectory() as scratch, tree.changed(mutant) as compiled:
        child = os.fork()
        if child == 0:
            code = 70
            try:
                os.setsid()
                bounded()
                os.chdir(tree.root)
                null = os.open(os.devnull, os.O_RDWR)
                for number in range(3):
                    os.dup2(null, number)
                os.environ["PYTHONPATH"] = str(tree.root / "src")
                os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
                sys.dont_write_bytecode = True
                sys.path[:] = [one for one in sys.path if one != str(ROOT)]
                if mutant and not patch(tree, mutant):
                    for name in [one for one in sys.modules if one.split(".")[0] == "stepblocks"]:
                        del sys.modules[name]  # it is loaded again from the changed source
                if compiled:
                    import numba

                    os.environ["NUMBA_CACHE_DIR"] = f"{scratch}/numba"
                    numba.core.config.reload_config()
                base = ["-q", "-x", "-p", "no:cacheprovider", "--basetemp", f"{scratch}/base"]
                base += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
                code = int(pytest.main([*base, *words, *tests], plugins=[plugin] if plugin else []))
            finally:
                os._exit(code)
        end = time.monotonic() + limit
        while time.monotonic() < end:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                return OUTCOMES.get(os.waitstatus_to_exitcode(status), "failed")
            time.sleep(0.02)
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return "time"


def try_one(
    tree: Tree, mutant: Mutant, reach: Reach, given: list[str] | None = None
) -> dict[str, object]:
    """Run the tests that call the function, then those of their files; or tests that are given."""
    begun = time.monotonic()
    tests = dict.fromkeys(given, SLOW) if given else reach.tests_for(tree, mutant)
    limit = 300.0 + 6.0 * sum(tests.values())
    outcome, by = run_and_name(tree, tests, limit, mutant)
    while by in tests and not passes(tree, by):
        del tests[by]  # it fails without the mutant, too
        outcome, by = run_and_name(tree, tests, limit, mutant)
    line = described(mutant, outcome, begun) | {"enough": reach.enough}
    return line | ({"test": by} if by else {})


def run_and_name(
    tree: Tree, tests: dict[str, float], limit: float, mutant: Mutant | None
) -> tuple[str, str]:
    """Run tests in a fork, and name the one that failed first."""
    if not tests:
        return "passed", ""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "failed"
        outcome = run_forked(tree, [*tests], limit, mutant, FirstFailure(path, tests))
        return outcome, path.read_text(encoding="utf-8") if path.exists() else ""


SOUND: dict[str, bool] = {}


def passes(tree: Tree, test: str) -> bool:
    """Whether a test passes by itself without a mutant; each is tried once."""
    if test not in SOUND:
        SOUND[test] = run_and_name(tree, {test: SLOW}, 240.0, None)[0] == "passed"
    return SOUND[test]


def described(mutant: Mutant, outcome: str, begun: float) -> dict[str, object]:
    """Make the line of the record; tests that no longer end have noticed, too."""
    return {
        "key": mutant.key,
        "room": mutant.room,
        "outcome": "survived" if outcome == "passed" else "noticed",
        "by": outcome,
        "mutant": str(mutant),
        "seconds": round(time.monotonic() - begun, 1),
    }


def run_all(
    mutants: list[Mutant], record: Path, reach: Reach, given: list[str] | None = None
) -> None:
    """Try every mutant, one after the other."""
    record.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        tree = Tree(Path(scratch))
        preload(tree)
        for mutant in mutants:
            line = try_one(tree, mutant, reach, given)
            with record.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
            print(f"{line['outcome']:9} {line['seconds']:6} s  {line['mutant']}", flush=True)


@dataclass(frozen=True)
class KnownSurvivor:
    """A mutant that no test can notice, or none has a value to hold it to.

    Attributes
    ----------
    path, function, before, after : str
        As those of the mutant.
    reason : str
    chosen : bool
        Whether the changed value was chosen by us, so that no expected value exists.
    """

    path: str
    function: str
    before: str
    after: str
    reason: str
    chosen: bool = False

    @property
    def key(self) -> str:
        """Key of the mutant."""
        return compute_key(self.path, self.function, self.before, self.after)


def read_known_survivors() -> dict[str, KnownSurvivor]:
    """Read why the survivors that are known survive, by their keys."""
    if not EQUIVALENT.exists():
        return {}
    found = {}
    for fields in json.loads(EQUIVALENT.read_text(encoding="utf-8")):
        survivor = KnownSurvivor(**fields)
        found[survivor.key] = survivor
    return found


def is_too_many(outcomes: list[str], share: float) -> bool:
    """Whether more than a share of the mutants that ended survived, and more than three."""
    return outcomes.count("survived") > max(3.0, share * len(outcomes))


def run_near_tests_first(tree: Tree, mutant: Mutant, left: float) -> str:
    """Run the quick tests of a room, those of the module first; where all pass, its long ones.

    A test counts whether the quick run has it or the long one.
    """
    end = time.monotonic() + left
    near = tests_of(tree.root, mutant)
    rest = [name for name in room_tests(tree.root, mutant) if name not in near]
    tests = near + rest if near[0].endswith(".py") else rest
    outcome = tree.run(tests, min(left, MOST_OF_SAMPLE), "-x", mutant=mutant)
    left = end - time.monotonic()
    if outcome != "passed" or left < LEAST_LEFT:
        return outcome
    return tree.run(tests, min(left, MOST_OF_SAMPLE), "-x", "-m", "long", mutant=mutant)


def sample(mutants: list[Mutant], seconds: float, share: float) -> int:
    """Try a few, the tests of their module first, as far as the time goes."""
    known = read_known_survivors()
    mutants = [mutant for mutant in mutants if mutant.key not in known]
    end = time.monotonic() + seconds
    tried: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        tree = Tree(Path(scratch))
        for mutant in mutants:
            left = end - time.monotonic()
            if left < LEAST_LEFT:
                break
            begun = time.monotonic()
            outcome = run_near_tests_first(tree, mutant, left)
            if outcome == "time":
                print(f"undecided after {time.monotonic() - begun:.0f} s  {mutant}", flush=True)
                continue
            tried.append(described(mutant, outcome, begun))
            print(f"{tried[-1]['outcome']:9} {tried[-1]['mutant']}", flush=True)
    outcomes = [str(line["outcome"]) for line in tried]
    print(f"{outcomes.count('noticed')} of {len(tried)} mutants noticed")
    return int(is_too_many(outcomes, share))


def read_record(record: Path) -> list[dict[str, str]]:
    """Read the last outcome of every mutant."""
    text = record.read_text(encoding="utf-8") if record.exists() else ""
    lines = [json.loads(line) for line in text.splitlines()]
    return list({line["key"]: line for line in lines}.values())


def summary(record: Path) -> int:
    """Print the share of every room, and each survivor with the reason where it is equivalent."""
    present = {mutant.key for room in ROOMS for mutant in find_mutants(ROOT, room)}
    tried = read_record(record)
    lines = [line for line in tried if line["key"] in present]
    known = read_known_survivors()
    equivalent = {key for key, survivor in known.items() if not survivor.chosen}
    print_shares(lines, equivalent)
    print("\nSurvivors:\n\n| place | change | why no test can notice it |\n|---|---|---|")
    for line in lines:
        if line["outcome"] == "survived":
            print_survivor(line, known.get(line["key"]))
    gone = len(tried) - len(lines)
    if gone:
        print(f"\n{gone} more were tried in functions that have changed since.")
    return 0


def print_shares(lines: list[dict[str, str]], equivalent: set[str]) -> None:
    """Print how many mutants of every room are noticed; `equivalent` are keys of survivors."""
    print("Mutants:")
    print("\n| room | mutants | noticed | equivalent | survive |\n|---|---|---|---|---|")
    for room in [*ROOMS, None]:
        of_room = [line for line in lines if room in (None, line["room"])]
        noticed = sum(line["outcome"] == "noticed" for line in of_room)
        survivors = [line["key"] for line in of_room if line["outcome"] == "survived"]
        equal = len([key for key in survivors if key in equivalent])
        remaining = len(of_room) - noticed - equal
        print(f"| {room or 'all'} | {len(of_room)} | {noticed} | {equal} | {remaining} |")


def print_survivor(line: dict[str, str], known: KnownSurvivor | None) -> None:
    """Print a survivor with the reason where one is known."""
    text = " ".join(line["mutant"].removeprefix("src/stepblocks/").split())
    place, change = text.replace("|", "or").split(": ", 1)
    why = "none known: a test is missing"
    if known is not None:
        why = known.reason
        if known.chosen:
            why = f"no value to hold it to: {why}"
    print(f"| {place} | {change} | {why} |")


def read_options() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", help=f"of {', '.join(ROOMS)}; all when left out")
    parser.add_argument("--count", type=int, default=60, help="mutants of each room (default 60)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--record", type=Path, default=ROOT / "out" / "mutations.jsonl")
    parser.add_argument("--keys", nargs="+", help="these mutants alone, tried or not")
    parser.add_argument("--tests", help="words for pytest: try --keys against these tests")
    parser.add_argument(
        "--near",
        action="store_true",
        help="where it is not known which tests call what, those that name the module",
    )
    parser.add_argument(
        "--enough",
        type=float,
        default=120.0,
        help="seconds of tests that a mutant meets, the quickest ones (default 120)",
    )
    parser.add_argument("--sample", type=int, help="so many mutants of all rooms, and no record")
    parser.add_argument("--seconds", type=float, default=300.0, help="that a sample may take")
    parser.add_argument(
        "--survivors", type=float, default=0.3, help="share that fails a sample (default 0.3)"
    )
    parser.add_argument("--summary", action="store_true", help="only print what the record holds")
    asked = parser.parse_args()
    unknown = [room for room in asked.rooms if room not in ROOMS]
    if unknown:
        parser.error(f"unknown room {', '.join(unknown)}; there are {', '.join(ROOMS)}")
    return asked


def main() -> int:
    """Run as asked."""
    asked = read_options()
    if asked.summary:
        return summary(asked.record)
    draw = random.Random(asked.seed)
    chosen = []
    for room in asked.rooms or ROOMS:
        of_room = find_mutants(ROOT, room)
        draw.shuffle(of_room)
        chosen.append(of_room)
    pool = [mutant for of_room in chosen for mutant in of_room]
    if asked.sample:
        return sample(draw.sample(pool, asked.sample), asked.seconds, asked.survivors)
    reach = Reach(asked.record.resolve().parent, asked.near, asked.enough)
    if asked.keys:
        left = [mutant for mutant in pool if mutant.key in asked.keys]
        run_all(left, asked.record, reach, shlex.split(asked.tests or ""))
        return 0
    done = read_decided_keys(asked.record, asked.enough)
    turns = take_turns(chosen, asked.count)
    run_all([mutant for mutant in turns if mutant.key not in done], asked.record, reach)
    return summary(asked.record)


def read_decided_keys(record: Path, enough: float) -> set[str]:
    """Read which mutants were noticed, or survived tests of `enough` seconds."""
    decided = set()
    for line in read_record(record):
        has_met_enough = float(line.get("enough", 120.0)) >= enough
        if line["outcome"] == "noticed" or has_met_enough:
            decided.add(line["key"])
    return decided


def take_turns(by_room: list[list[Mutant]], count: int) -> list[Mutant]:
    """Take the first `count` mutants of every room in turns, so that a run that stops saw all."""
    turns = []
    for place in range(count):
        for of_room in by_room:
            if place < len(of_room):
                turns.append(of_room[place])
    return turns


if __name__ == "__main__":
    sys.exit(main())
