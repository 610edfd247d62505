"""Records of what was measured: one JSON for each part of the verification report, in docs/records.

A record holds title, command, commit, date, machine and versions, the rooms of the source that it
speaks of with a hash of their code, figures by name, and tables. Pages quote a figure as a link to
it, ``[19.2 s](verification.md#loop-240)``; tests/test_docs.py holds each to its record.
"""

from __future__ import annotations

import ast
import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "records"


@cache
def code_hash(*rooms: str) -> str:
    """Hash the code of rooms or of single files: Python without comments and docstrings.

    Other files, such as C, pages and tables, count with every byte.
    """
    digest = hashlib.sha256()
    for room in sorted(rooms):
        place = ROOT / "src" / "stepblocks" / room
        for path in [place] if place.is_file() else sorted(place.rglob("*.*")):
            if path.suffix == ".pyc" or not path.is_file():
                continue
            if path.suffix != ".py":
                digest.update(path.read_bytes())
                continue
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for node in ast.walk(tree):
                if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module) and node.body:
                    first = node.body[0]
                    if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                        node.body = node.body[1:]
            digest.update(ast.dump(tree).encode())
    return digest.hexdigest()[:16]


def load() -> list[dict[str, Any]]:
    """Read every record, in the order of their titles."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(FOLDER.glob("*.json"))]
    return sorted(found, key=lambda record: record["title"])


def figures() -> dict[str, str]:
    """Find the text of every figure, and of every part, by the name that pages link."""
    found = {}
    for record in load():
        found[record["part"]] = ""
        found |= {figure["id"]: figure["text"] for figure in record["figures"]}
    return found


def is_older(record: dict[str, Any]) -> bool:
    """Whether the code of which a record speaks has changed since."""
    return record["code_hash"] != code_hash(*record["code"])


def rows(table: list[list[str]]) -> str:
    """Write rows of cells as a Markdown table; the first one is the header."""
    head, *rest = (
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in table
    )
    return "\n".join([head, "|" + "---|" * len(table[0]), *rest])


def source(figure: dict[str, Any]) -> str:
    """Say where a figure comes from that the last run did not measure again."""
    return f" (carried over from {figure['older']})" if "older" in figure else ""


def section(record: dict[str, Any]) -> str:
    """Write the section of one part."""
    versions = ", ".join(f"{name} {version}" for name, version in record["versions"].items())
    age = " **Older than the code of which it speaks.**" if is_older(record) else ""
    lines = [
        f"## {record['title']} {{ #{record['part']} }}",
        f"`{record['command']}`. Commit {record['commit']}, {record['date']}; {record['machine']};"
        f" {versions}.{age}",
    ]
    if record["about"]:
        lines.append(record["about"])
    if record["figures"]:
        table = [["figure", "of what"]]
        table += [
            [f'<a id="{figure["id"]}"></a>{figure["text"]}', figure["says"] + source(figure)]
            for figure in record["figures"]
        ]
        lines.append(rows(table))
    for table in record["tables"]:
        lines += [table["caption"] + ":", rows([table["columns"], *table["rows"]])]
    return "\n\n".join(lines)


def report() -> str:
    """Write the verification report."""
    every = load()
    old = sum(is_older(record) for record in every)
    head = f"{len(every)} parts; {old} of them were measured with older code than this.\n\n"
    return head + "\n\n".join(section(record) for record in every)
