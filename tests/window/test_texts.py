"""Every text of the window stands once, in one file, and is shown somewhere."""

import ast
import re
from collections import Counter
from pathlib import Path

pages = Path(__file__).resolve().parents[2] / "src" / "stepblocks" / "window"


def list_names():
    module = ast.parse((pages / "texts.py").read_text(encoding="utf-8"))
    return [node.targets[0].id for node in module.body if isinstance(node, ast.Assign)]


def test_no_text_replaces_another_of_its_name():
    repeated = [name for name, count in Counter(list_names()).items() if count > 1]
    assert repeated == []


def test_every_text_is_used_and_every_one_that_is_used_is_there():
    used = set()
    for path in pages.glob("*.py"):
        used |= set(re.findall(r"\btexts\.([A-Z_]+)\b", path.read_text(encoding="utf-8")))
    assert used == set(list_names())
