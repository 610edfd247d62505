"""The house: who may import whom, where the CAD kernel lives, how large a room may grow."""

import ast
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCES = sorted((ROOT / "src" / "stepblocks").rglob("*.py"))


def imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def test_data_walks_downhill():
    done = subprocess.run(
        [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_only_the_kernel_imports_the_cad_library():
    users = {
        path.relative_to(ROOT / "src").as_posix()
        for path in SOURCES
        for name in imported(path)
        if name.split(".")[0] in {"cadquery", "OCP"}
    }
    assert users == {"stepblocks/cad/kernel.py", "stepblocks/cad/pmi.py"}


def test_no_file_is_longer_than_a_room():
    long = {path.name: count for path in SOURCES if (count := len(path.read_text().splitlines())) > 500}
    assert long == {}


def test_there_is_no_drawer_of_oddments():
    assert not [path for path in SOURCES if re.fullmatch(r"(utils?|helpers?|misc|common)\.py", path.name)]


def test_nothing_is_read_by_pickle_or_eval():
    for path in SOURCES:
        tree = ast.parse(path.read_text())
        names = {
            node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        }
        assert not names & {"eval", "exec"}, path
        assert not {"pickle", "shelve", "marshal"} & {name.split(".")[0] for name in imported(path)}, path
