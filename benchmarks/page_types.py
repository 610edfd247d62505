"""Check the Python of every page, benchmark and example with mypy, against the library's types.

python benchmarks/page_types.py

A page must fit the types. A benchmark, which few tests run, may leave its own types out; but no
name, attribute or argument may be missing that it asks for, so that a rename cannot break it
unnoticed.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
CELL = re.compile(r"^(?P<indent> *)```python\n(?P<code>.*?)^(?P=indent)```$", re.M | re.S)
HEAD = "# mypy: allow-untyped-defs"
# what mypy says where a thing is not there; a name that a module imports, and a program patches, is
MISSING = re.compile(
    r"^(?!.*does not explicitly export)(.*?):\d+: error: .*\[(attr-defined|call-arg|call-overload"
    r"|import-not-found|index|name-defined|syntax|union-attr)\]$",
    re.M,
)
FOLDERS = [str(ROOT / name) for name in ("src", "tests", "benchmarks")]


def extract_code(text: str) -> str:
    """Return the Python of a page on its own lines, without commands of a shell."""
    lines = [""] * (text.count("\n") + 1)
    for cell in CELL.finditer(text):
        first = text.count("\n", 0, cell.start("code"))
        for number, line in enumerate(cell["code"].splitlines(), start=first):
            code = line.removeprefix(cell["indent"])
            lines[number] = re.sub(r"^(\s*)[!%].*", r"\1pass", code)
    return "\n".join([HEAD, *lines[1:]]) if any(lines) else ""


def run_mypy(names: list[str]) -> tuple[int, str]:
    """Run mypy with the settings of the package and its kept results; exit code and output."""
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", *names],
        cwd=ROOT,
        env={**os.environ, "MYPYPATH": os.pathsep.join(FOLDERS)},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def check_pages(pages: list[Path]) -> str:
    """Return what mypy finds wrong in pages, "" for nothing; lines are those of the page."""
    with TemporaryDirectory() as folder:
        names = []
        for number, page in enumerate(pages):
            if code := extract_code(page.read_text(encoding="utf-8")):
                file = Path(folder) / f"page_{number}.py"
                file.write_text(code, encoding="utf-8")
                names.append(str(file))
        _, said = run_mypy(names)
    # mypy may show the folder of an earlier run, where it found the same
    return re.sub(r"\S*page_(\d+)\.py", lambda found: str(pages[int(found[1])]), said)


def list_programs() -> list[Path]:
    """List the programs beside the package."""
    folders = [ROOT / "benchmarks", ROOT / "examples"]
    return sorted(path for folder in folders for path in folder.rglob("*.py"))


def check_programs(programs: list[Path]) -> str:
    """Return a line for each name, attribute or argument of programs that is not there."""
    names = [
        str(path.relative_to(ROOT) if path.is_relative_to(ROOT) else path) for path in programs
    ]
    code, said = run_mypy(names)
    if code > 1:  # it did not come to its end
        return said
    # by its name alone: mypy may show the folder of an earlier run, where it found the same
    known = {path.name for path in programs}
    lines = []
    for found in MISSING.finditer(said):
        place = Path(found[1])
        if place.name in known and place.parts[0] not in ("src", "tests"):
            lines.append(f"{found[0]}\n")
    return "".join(lines)


def main() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    programs = list_programs()
    said = check_pages(pages) + check_programs(programs)
    print(said or f"the Python of {len(pages)} pages and {len(programs)} programs is sound")
    sys.exit(bool(said))


if __name__ == "__main__":
    main()
