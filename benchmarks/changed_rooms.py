"""Run the quick tests of the rooms that the working tree changed: what `make check` ends with.

A change in ``src/stepblocks/drag`` or ``tests/drag`` runs ``tests/drag``; a change at the root of
the package, of the tests or of the project runs the tests that lie in no room. Changed is what
differs from the last commit; where nothing does, the last commit itself.
"""

import subprocess
import sys
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[1]
PYTEST = [sys.executable, "-m", "pytest", "-n", "auto", "--dist", "loadfile"]


def list_changed_files() -> list[str]:
    """Names of files that differ from the last commit, or, in a clean tree, that it changed."""
    tracked = _ask_git("diff", "--name-only", "HEAD")
    untracked = _ask_git("ls-files", "--others", "--exclude-standard")
    return tracked + untracked or _ask_git("diff", "--name-only", "HEAD~1", "HEAD")


def _ask_git(*arguments: str) -> list[str]:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def find_room(name: str) -> str | None:
    """Room of tests of a changed file; "" for the root, None where no test reads it."""
    parts = PurePosixPath(name).parts
    if parts[:2] == ("src", "stepblocks"):
        inner = parts[2:]
    elif parts[0] == "tests":
        inner = parts[1:]
    elif name in ("pyproject.toml", "README.md", "Makefile") or parts[0] in ("docs", "stimuli"):
        return ""
    else:
        return None
    return inner[0] if len(inner) > 1 else ""


def list_tests(rooms: set[str]) -> list[str]:
    """Paths to hand to pytest, of rooms that have tests."""
    paths = []
    for room in sorted(rooms):
        if room == "":
            paths += sorted(str(path) for path in (ROOT / "tests").glob("test_*.py"))
        elif any((ROOT / "tests" / room).glob("test_*.py")):
            paths.append(str(ROOT / "tests" / room))
    return paths


def main() -> int:
    """Run the tests; return the exit code of pytest."""
    rooms = {find_room(name) for name in list_changed_files()}
    paths = list_tests({room for room in rooms if room is not None})
    if not paths:
        print("no room has changed")
        return 0
    print("rooms:", ", ".join(sorted(room or "root" for room in rooms if room is not None)))
    return subprocess.run([*PYTEST, *paths], cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
