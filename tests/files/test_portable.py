"""System calls stand in the rooms of the floor, and files have the same bytes on every system."""

import ast
from pathlib import Path

import stepblocks

ROOT = Path(stepblocks.__file__).parent
FLOOR = {"files", "compute"}
POSIX_MODULES = {"fcntl", "resource", "pwd", "grp", "termios", "msvcrt"}
# what Windows or macOS lack, as attributes of os and signal
POSIX_CALLS = {
    *("fork", "killpg", "setsid", "sched_getaffinity", "O_DIRECTORY", "O_NOFOLLOW", "mkfifo"),
    *("SIGKILL", "SIGXCPU", "SIGHUP", "SIGPIPE", "SIGALRM", "cpu_count", "fsync", "flock"),
    *("getuid", "geteuid", "getgid", "chown", "statvfs"),
}


def list_modules():
    """Every module with its room and its tree."""
    for path in sorted(ROOT.rglob("*.py")):
        yield path.relative_to(ROOT), ast.parse(path.read_text(encoding="utf-8"))


def test_only_the_floor_makes_system_calls():
    found = []
    for path, tree in list_modules():
        if path.parts[0] in FLOOR:
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found += [(path, alias.name) for alias in node.names if alias.name in POSIX_MODULES]
            is_call = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
            if is_call and node.value.id in ("os", "signal") and node.attr in POSIX_CALLS:
                found.append((path, node.attr))
    assert found == []


def test_text_is_written_with_its_encoding_and_the_same_line_ends_on_every_system():
    found = []
    for path, tree in list_modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                named = {keyword.arg for keyword in node.keywords}
                # a drawing writes texts, too, which are no files
                if node.func.attr == "write_text" and "encoding" in named:
                    found += [(path, node.lineno)] * ("newline" not in named)
    assert found == []
