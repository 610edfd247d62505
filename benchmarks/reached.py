"""List every function that no command and no public name calls.

Run ``python benchmarks/reached.py`` under Python 3.12 or newer (``sys.monitoring`` tells of a
function's first call and then costs nothing). Confined readers, workers and commands in processes
of their own are watched too. What numba compiles is never called as Python: it counts as called
where a called function names it. Exits 1 where a function stayed cold.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "stepblocks"
RUNS_A_COMMAND = re.compile(
    r"stepblocks\.cli|-m[\", ]+stepblocks|^import stepblocks|^from stepblocks import", re.M
)
COMPILES = re.compile(r"\b(njit|jit|guvectorize|vectorize)\b")
WATCH = """
import os, sys
told = os.open({record!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
def begin(code, offset):
    if code.co_filename.startswith({source!r}):
        os.write(told, f"{{code.co_filename}}:{{code.co_qualname}}\\n".encode())
    return sys.monitoring.DISABLE
sys.monitoring.use_tool_id(4, "reached")
sys.monitoring.register_callback(4, sys.monitoring.events.PY_START, begin)
sys.monitoring.set_events(4, sys.monitoring.events.PY_START)
"""


def called_by(tests: list[Path]) -> set[str]:
    """``file:function`` of all that these tests call, in whatever process."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder, "called")
        Path(folder, "sitecustomize.py").write_text(
            WATCH.format(record=str(record), source=str(SOURCE)), encoding="utf-8"
        )
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([folder, str(SOURCE.parent)])}
        subprocess.run(
            [
                sys.executable,
                "-m",
                "pytest",
                "-q",
                "-n",
                "auto",
                "--dist",
                "loadfile",
                *map(str, tests),
            ],
            cwd=ROOT,
            env=environment,
            check=False,  # a test that fails has called what it called, and fails elsewhere too
        )
        return set(record.read_text(encoding="utf-8").splitlines())


def functions_of(path: Path) -> dict[str, ast.FunctionDef]:
    """Name the functions and methods of a file; those within functions belong to these."""
    found = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            found[node.name] = node
        elif isinstance(node, ast.ClassDef):
            found |= {
                f"{node.name}.{m.name}": m for m in node.body if isinstance(m, ast.FunctionDef)
            }
    return {name: node for name, node in found.items() if ast.unparse(node.body[-1]) != "..."}


def names_in(node: ast.AST) -> set[str]:
    """Collect the names that code mentions."""
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def is_compiled(node: ast.FunctionDef) -> bool:
    """Tell whether numba compiles a function, by its decorators."""
    decorators = " ".join(map(ast.unparse, node.decorator_list))
    return bool(COMPILES.search(decorators))


def warm_kernels(cold: dict[str, ast.FunctionDef], named: set[str]) -> None:
    """Take from `cold` the kernels that called code names, and those that these name in turn."""
    while True:
        kernels = []
        for place, node in cold.items():
            if node.name in named and is_compiled(node):
                kernels.append(place)
        if not kernels:
            return
        for place in kernels:
            named |= names_in(cold.pop(place))


def main() -> int:
    """Run the tests and print the cold functions."""
    tests = []
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        if RUNS_A_COMMAND.search(path.read_text()):
            tests.append(path)
    called = called_by(tests)
    cold, named = {}, set()
    for path in sorted(SOURCE.rglob("*.py")):
        for name, node in functions_of(path).items():
            if f"{path}:{name}" in called:
                named |= names_in(node)
            else:
                cold[f"{path.relative_to(SOURCE)}:{name}"] = node
    warm_kernels(cold, named)
    print("\n".join(cold) or "every function is called by a command or a public name")
    return 1 if cold else 0


if __name__ == "__main__":
    sys.exit(main())
