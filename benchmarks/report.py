"""Measure the figures of the verification report again, part by part.

python benchmarks/report.py [PART ...] [--list] [--again] [--busy]

Each part runs one benchmark, reads figures and tables from what it prints, and leaves a record in
out/report. A part whose code has not changed since its record is left out, so a run can be broken
off and goes on with the next part. At the end the records go to docs/records, and the pages that
quote a figure get its new text. Parts that measure time are left out on a busy machine.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shlex
import subprocess
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from report_parts import PARTS, Part

import records

ROOT = records.ROOT
OUT = ROOT / "out" / "report"
LIBRARIES = ("numpy", "scipy", "numba", "cadquery", "mujoco")
SHARED = os.environ.get("STEPBLOCKS_SHARED", str(ROOT.parent / "shared"))


def machine() -> str:
    """Describe this machine: cores, processor, system, and how busy it was."""
    load = os.getloadavg()[0]
    busy = f"load {load:.1f}" if load > 0.7 else "otherwise idle"
    return f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}, {busy}"


def versions() -> dict[str, str]:
    """List Python and the libraries on which figures depend."""
    found = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def commit() -> str:
    """Name the commit, with a mark where the checkout differs from it."""
    command = ["git", "describe", "--always", "--dirty=, changed"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def read_tables(text: str) -> list[dict[str, Any]]:
    """Find the tables of an output: Markdown, or columns set apart by two spaces."""
    found: list[tuple[str, list[list[str]]]] = [("", [])]
    caption = "Output"
    for line in text.splitlines():
        cells = split_cells(line)
        if cells is None:
            continue
        if found[-1][1] and len(cells) != len(found[-1][1][0]):
            found.append(("", []))
        if len(cells) > 1:
            found[-1][1].append(cells)
            found[-1] = (found[-1][0] or caption, found[-1][1])
        elif cells:
            caption = cells[0].strip("# :") or caption
    return [
        {"caption": caption, "columns": table[0], "rows": table[1:]}
        for caption, table in found
        if len(table) > 1
    ]


def split_cells(line: str) -> list[str] | None:
    """Split a line of an output into cells; None for the rule below the head of a table."""
    if not line.startswith("|"):
        return [cell for cell in re.split(r"\s{2,}", line.strip()) if cell]
    cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
    if set("".join(cells)) <= set("-: ") and any(cells):
        return None
    return cells


def largest(text: str, pattern: str, form: str) -> str | None:
    """Find the largest size of all numbers that a pattern finds."""
    sizes = [abs(float(one)) for one in re.findall(pattern, text, re.MULTILINE)]
    return form.format(max(sizes)).replace("e-0", "e-") if sizes else None


def find_figure(text: str, pattern: str, form: str) -> str | None:
    """Find the text of a figure in an output; ``LARGEST `` asks for the largest of all matches."""
    if pattern.startswith("LARGEST "):
        return largest(text, pattern.removeprefix("LARGEST "), form)
    found = re.search(pattern, text)
    if found is None:
        return None
    if ":GB" in form:
        return form.replace("{:GB}", f"{float(found[1]) / 1000.0:.1f}")
    if ":%" in form:
        return form.replace("{:%}", f"{100.0 * float(found[1]):.0f} %")
    groups = (f"{int(one):,}" if one.isdigit() and len(one) > 3 else one for one in found.groups())
    return form.format(*groups)


def run_command(line: str) -> str:
    """Run a command line of a part with the Python of this process, and return what it prints."""
    words = shlex.split(line.replace("{shared}", SHARED))
    folders = [str(ROOT / name) for name in ("src", "benchmarks", "tests")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    done = subprocess.run(
        [sys.executable, *words[1:]], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    if done.returncode != 0:
        lines = (done.stdout + done.stderr).strip().splitlines()
        raise RuntimeError(f"exit code {done.returncode}: {lines[-1] if lines else 'no output'}")
    return done.stdout


def measure(part: Part, before: dict[str, Any] | None) -> dict[str, Any]:
    """Run a part and make its record; what its output does not say keeps its older text."""
    begun = time.monotonic()
    output = "".join(run_command(line) for line in part.command.split(" && "))
    if before is None:
        raise RuntimeError("no record to begin with in docs/records")
    if part.held and re.search(r"\d skipped", output):
        raise RuntimeError("tests that hold its figures were skipped")
    record = {**before, "figures": [dict(figure) for figure in before["figures"]]}
    for figure in record["figures"]:
        if part.held:
            figure.pop("older", None)
        elif figure["id"] in part.figures:
            text = find_figure(output, *part.figures[figure["id"]])
            if text is None and figure["id"] in part.optional:
                figure.setdefault("older", f"{before['commit']}, {before['date']}")
                continue
            if text is None:
                raise RuntimeError(f"the output does not say {figure['id']}")
            figure["text"] = text
            figure.pop("older", None)
        else:
            figure.setdefault("older", f"{before['commit']}, {before['date']}")
    return {
        **record,
        "command": part.command.replace("{shared}", "FOLDER"),
        "code_hash": records.code_hash(*record["code"]),
        "commit": commit(),
        "date": time.strftime("%Y-%m-%d"),
        "machine": machine(),
        "versions": versions(),
        "minutes": round((time.monotonic() - begun) / 60.0, 1),
        "tables": before["tables"] if part.held else read_tables(output),
    }


def write(path: Path, record: dict[str, Any]) -> None:
    """Write a record."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(record, indent=1, ensure_ascii=False) + "\n"
    path.write_text(text, encoding="utf-8")


def quote() -> list[str]:
    """Put the text of every figure where a page quotes it, and list the pages that changed."""
    texts = records.figures()
    changed = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        old = page.read_text(encoding="utf-8")
        new = re.sub(
            r"\[[^\]\[]+\](\((?:\.\./|docs/)*verification\.md#([\w-]+)\))",
            lambda found: f"[{texts[found[2]]}]{found[1]}" if texts.get(found[2]) else found[0],
            old,
        )
        if new != old:
            page.write_text(new, encoding="utf-8")
            changed.append(page.relative_to(ROOT).as_posix())
    return changed


def main() -> int:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help="all when left out")
    parser.add_argument("--list", action="store_true", help="only say what would be measured")
    parser.add_argument("--again", action="store_true", help="also parts whose code is the same")
    parser.add_argument("--busy", action="store_true", help="times, too, on a busy machine")
    asked = parser.parse_args()
    unknown = sorted(set(asked.parts) - {part.name for part in PARTS})
    if unknown:
        parser.error(f"unknown part {', '.join(unknown)}")
    failed = False
    for part in PARTS:
        if asked.parts and part.name not in asked.parts:
            continue
        said, fails = bring_up_to_date(part, asked)
        failed |= fails
        print(f"{part.name}: {said}", flush=True)
    for page in quote() if not asked.list else ():
        print(f"{page}: its figures are new")
    return int(failed)


def bring_up_to_date(part: Part, asked: argparse.Namespace) -> tuple[str, bool]:
    """Measure a part where that is asked for and due; return what to say, and whether it failed."""
    path = OUT / f"{part.name}.json"
    kept = path if path.exists() else records.FOLDER / path.name
    before = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else None
    if before and not records.is_older(before) and not asked.again:
        return "is as new as the code", False
    if asked.list:
        return f"takes about {part.minutes:g} min", False
    if part.timing and os.getloadavg()[0] > 0.7 and not asked.busy:
        return "measures times, and this machine is busy: left out", False
    try:
        record = measure(part, before)
    except (RuntimeError, OSError) as error:
        return f"failed, {error}", True
    write(path, record)
    write(records.FOLDER / path.name, record)
    return f"measured in {record['minutes']} min", False


if __name__ == "__main__":
    sys.exit(main())
