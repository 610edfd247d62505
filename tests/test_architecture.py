"""The house: who may import whom, and that nothing stands twice or unreached."""

import ast
import itertools
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
HOUSE = ROOT / "src" / "stepblocks"
SOURCES = sorted(HOUSE.rglob("*.py"))
# what all rooms may import
NOUNS = {
    *("declaration", "parts", "cad", "contact", "rig", "lawsearch", "scans", "artefacts"),
    *("records", "files", "compute"),
}
# what people write and read as a program or a page, also as a template
WRITTEN = (".py", ".pyi", ".js", ".css", ".html", ".c", ".h", ".cpp", ".cs", ".sh")


@cache
def read_trees():
    """Read the syntax trees of all sources, once for all tests."""
    return {path: ast.parse(path.read_text()) for path in SOURCES}


@cache
def list_nodes(path):
    """List all nodes of the syntax tree of a source, once for all tests."""
    return list(ast.walk(read_trees()[path]))


def module_of(path):
    name = ".".join(path.relative_to(HOUSE.parent).with_suffix("").parts)
    return name.removesuffix(".__init__")


MODULES = {module_of(path): path for path in SOURCES}


def imported(path):
    """Names of the modules that a file imports anywhere, also for types alone."""
    for node in list_nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in MODULES else node.module


def ours(path):
    return {name for name in imported(path) if name in MODULES}


def test_data_walks_downhill():
    done = subprocess.run(
        [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_no_two_modules_import_each_other_in_a_circle():
    networkx = pytest.importorskip("networkx")
    graph = networkx.DiGraph(
        (module, name) for module, path in MODULES.items() for name in ours(path)
    )
    assert [ring for ring in networkx.strongly_connected_components(graph) if len(ring) > 1] == []


def test_rooms_import_each_other_along_the_arrows_that_the_page_draws_and_along_no_other():
    page = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    chart = re.search(r"flowchart TD\n(.*?)```", page, re.DOTALL)[1]
    drawn = {
        (one, other)
        for line in re.sub(r'\[".*?"\]', "", chart).splitlines()
        for left, right in itertools.pairwise(line.split("-->"))
        for one in left.split("&")
        for other in right.split("&")
    }
    drawn = {(one.strip(), other.strip()) for one, other in drawn}
    rooms = {room for _, room in drawn if (HOUSE / room).is_dir()} | {"study"}
    rooms -= NOUNS
    walked = {
        (module.split(".")[1], name.split(".")[1])
        for module, path in MODULES.items()
        for name in ours(path)
        if module.count(".") and name.count(".")
    }
    among = {(one, other) for one, other in walked if {one, other} <= rooms and one != other}
    assert among == {(one, other) for one, other in drawn if {one, other} <= rooms}


def test_only_the_kernel_imports_the_cad_library():
    users = {
        path.relative_to(HOUSE).parts[0]
        for path in SOURCES
        for name in imported(path)
        if name.split(".")[0] in {"cadquery", "OCP"}
    }
    assert users == {"cad"}


def test_no_line_is_longer_than_a_hundred_characters():
    """Of the files that people write; outside them a line is data, such as a table or a drawing."""
    long = [
        f"{path.relative_to(ROOT)}:{number}"
        for folder in ("src", "tests", "benchmarks")
        for path in sorted((ROOT / folder).rglob("*.*"))
        if path.name.removesuffix(".j2").endswith(WRITTEN)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if len(line) > 100
    ]
    assert long == []


def test_nothing_takes_more_than_six_positional_arguments():
    def too_many(node):
        compiled = (
            any("jit" in ast.unparse(decorator) for decorator in node.decorator_list)
            or node.name in jitted
        )
        taken = [
            a.arg for a in (*node.args.posonlyargs, *node.args.args) if a.arg not in ("self", "cls")
        ]
        return len(taken) > 6 and not compiled

    jitted = {
        name
        for path in SOURCES
        for name in re.findall(r"njit\(cache=True\)\((\w+)\)", path.read_text())
    }
    found = [
        f"{module_of(path)}.{node.name}"
        for path in SOURCES
        for node in list_nodes(path)
        if isinstance(node, ast.FunctionDef) and too_many(node)
    ]
    assert found == []


def test_every_module_is_reached_from_a_command_or_the_public_face():
    start = [name for name in MODULES if name.startswith("stepblocks.cli")] + [
        "stepblocks",
        "stepblocks.__main__",
    ]
    stub = ast.parse((HOUSE / "__init__.pyi").read_text())
    start += [
        f"stepblocks.{node.module}" for node in ast.walk(stub) if isinstance(node, ast.ImportFrom)
    ]
    reached, waiting = set(), list(start)
    while waiting:
        name = waiting.pop()
        if name in reached or name not in MODULES:
            continue
        reached.add(name)
        waiting += [*ours(MODULES[name]), name.rpartition(".")[0]]
    assert sorted(set(MODULES) - reached) == []


# what is called by a name that stands in no source: by Python, Typer, pydantic, numba,
# http.server and notebooks
HOOKS = {
    "get_params",
    "parse_args",
    "on_broken_pipe",
    "do_GET",
    "do_POST",
    "log_message",
    "_repr_html_",
}
Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def words_of(node):
    """Names, attributes and words of short texts in a definition or statement; of a class without
    its ordinary methods.
    """
    parts = [node]
    if isinstance(node, ast.ClassDef):
        called = [m for m in node.body if isinstance(m, ast.FunctionDef) and is_called_by_itself(m)]
        yield from (method.name for method in called)
        parts = [
            *node.bases,
            *node.decorator_list,
            *called,
            *(m for m in node.body if not isinstance(m, Definition)),
        ]
    for one in (inner for part in parts for inner in ast.walk(part)):
        if isinstance(one, ast.Name):
            yield one.id
        elif isinstance(one, ast.Attribute):
            yield one.attr
        elif isinstance(one, ast.Constant) and isinstance(one.value, str) and len(one.value) < 200:
            yield from re.findall(r"[A-Za-z_]\w*", one.value)


def is_called_by_itself(method):
    decorators = " ".join(map(ast.unparse, method.decorator_list))
    return method.name.startswith("__") or re.search("validator|overload|every_rule", decorators)


def test_every_function_is_reached_by_name_from_a_command_or_the_public_face():
    """A function that is named only by what is itself not reached is dead; words are matched, so
    what is named is not proven to run.
    """
    says = defaultdict(set)
    for path, tree in read_trees().items():
        for node in list_nodes(path):
            if isinstance(node, Definition):
                says[node.name] |= set(words_of(node))
        for node in tree.body:
            if isinstance(node, ast.Assign | ast.AnnAssign):  # a registry, or a type
                words = set(words_of(node))
                for one in ast.walk(node):
                    if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store):
                        says[one.id] |= words
    forms = [path for form in ("*.j2", "*.html", "templates/*.txt") for path in HOUSE.rglob(form)]
    doors = [HOUSE / "__init__.pyi", *forms]
    waiting = {
        word for path in doors for word in re.findall(r"[A-Za-z_]\w*", path.read_text())
    } | HOOKS
    public = set(re.findall(r" as (\w+)", (HOUSE / "__init__.pyi").read_text()))
    for path, tree in read_trees().items():
        if module_of(path) in {
            "stepblocks.cli",
            "stepblocks.__main__",
            "stepblocks.compute.compiled",  # it makes its cache before anything is compiled
            "stepblocks.files.confined",
        }:
            waiting |= set(words_of(tree))
        for node in tree.body:  # a function that is declared as a command
            if isinstance(node, ast.FunctionDef) and any(
                ast.unparse(one).startswith("register_command(") for one in node.decorator_list
            ):
                waiting.add(node.name)
        for node in list_nodes(path):
            # what a public class shows, its users name
            if isinstance(node, ast.ClassDef) and node.name in public:
                waiting |= {
                    member.name for member in node.body if isinstance(member, ast.FunctionDef)
                }
    reached = set()
    while waiting:
        word = waiting.pop()
        reached.add(word)
        waiting |= says[word] - reached
    dead = [
        f"{module_of(path)}.{node.name}"
        for path in SOURCES
        for node in list_nodes(path)
        if isinstance(node, Definition)
        and node.name not in reached
        and not node.name.startswith("__")
    ]
    assert not dead, f"neither a command nor a public name leads to {', '.join(dead)}"


def logical_lines(path):
    """Lines of code without comments, docstrings and imports, white space folded, with their
    numbers.
    """
    text = path.read_text().splitlines()
    out = set()
    for node in list_nodes(path):
        skip = isinstance(node, ast.Import | ast.ImportFrom)
        skip |= (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        )
        if skip:
            out.update(range(node.lineno, node.end_lineno + 1))
    for number, line in enumerate(text, start=1):
        folded = " ".join(line.split("  # ")[0].split())
        if number not in out and len(folded) > 3 and not folded.startswith("#"):
            yield number, folded


def test_no_ten_lines_stand_twice():
    seen = {}
    twice = []
    for path in SOURCES:
        lines = list(logical_lines(path))
        for window in zip(*(itertools.islice(lines, k, None) for k in range(10)), strict=False):
            key = tuple(line for _, line in window)
            place = f"{module_of(path)}:{window[0][0]}"
            if key in seen:
                twice.append(f"{seen[key]} ~ {place}")
            seen.setdefault(key, place)
    assert twice == []


def test_there_is_no_drawer_of_oddments():
    assert not [
        path for path in SOURCES if re.fullmatch(r"(utils?|helpers?|misc|common)\.py", path.name)
    ]


def test_nothing_is_read_by_pickle_or_eval():
    for path in SOURCES:
        names = {
            node.func.id
            for node in list_nodes(path)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        }
        assert not names & {"eval", "exec"}, path
        assert not {"pickle", "shelve", "marshal"} & {
            name.split(".")[0] for name in imported(path)
        }, path
