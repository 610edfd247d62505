"""Check the Python of every page with mypy, against the types of the library.

python benchmarks/page_types.py
"""

import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
CELL = re.compile(r"^(?P<indent> *)```python\n(?P<code>.*?)^(?P=indent)```$", re.M | re.S)
HEAD = "# mypy: allow-untyped-defs"


def extract_code(text: str) -> str:
    """Return the Python of a page on its own lines, without commands of a shell."""
    lines = [""] * (text.count("\n") + 1)
    for cell in CELL.finditer(text):
        first = text.count("\n", 0, cell.start("code"))
        for number, line in enumerate(cell["code"].splitlines(), start=first):
            code = line.removeprefix(cell["indent"])
            lines[number] = re.sub(r"^(\s*)[!%].*", r"\1pass", code)
    return "\n".join([HEAD, *lines[1:]]) if any(lines) else ""


def check_pages(pages: list[Path]) -> str:
    """Return what mypy finds wrong in pages, "" for nothing; lines are those of the page."""
    with TemporaryDirectory() as folder:
        names = []
        for number, page in enumerate(pages):
            if code := extract_code(page.read_text(encoding="utf-8")):
                file = Path(folder) / f"page_{number}.py"
                file.write_text(code, encoding="utf-8")
                names.append(str(file))
        # with the settings of the package, so that it is not checked again
        done = subprocess.run(
            [sys.executable, "-m", "mypy", "--no-error-summary", *names],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
    # mypy may show the folder of an earlier run, where it found the same
    said = done.stdout + done.stderr
    return re.sub(r"\S*page_(\d+)\.py", lambda found: str(pages[int(found[1])]), said)


def main() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    said = check_pages(pages)
    print(said or f"the Python of {len(pages)} pages is sound")
    sys.exit(bool(said))


if __name__ == "__main__":
    main()
