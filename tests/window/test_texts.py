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


WORDS = re.compile(r"[^\W\d_]{2,} [^\W\d_]{2,}")
# what is written for the browser, not for its user
MARKUP = re.compile(
    r"\b(role|aria-label|no-caps|dense|class|href|viewBox|tabindex|default-src)\b|=>|[{}<>]"
)
STYLED_BY = ("classes", "props", "style")
MARKS = ("offset points", "axes fraction")  # coordinates of the drawing library
PYTHON = "import stepblocks\n\nstepblocks."  # begin of the lines to copy
SHOWN_BY = ("label", "button", "link", "notify", "show_message", "show_heading", "expansion")


def list_passages(module):
    """The constants of a module that read as words, without docstrings and markup."""
    left_out = set()
    for node in ast.walk(module):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            left_out.add(node.value)
        is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
        if is_call and node.func.attr in STYLED_BY:
            left_out |= set(ast.walk(node)) - set(ast.walk(node.func))
    for node in ast.walk(module):
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
            continue
        is_text = WORDS.search(node.value) and not MARKUP.search(node.value)
        if is_text and node not in left_out and node.value not in (*MARKS, PYTHON):
            yield node.lineno, node.value


def list_shown_literals(module):
    """Texts that a page is given as they stand, of one word too."""
    for node in ast.walk(module):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        name = ""
        if isinstance(node.func, ast.Attribute):
            name = node.func.attr
        if isinstance(node.func, ast.Name):
            name = node.func.id
        is_shown = name in SHOWN_BY or name.endswith("Error")
        first = node.args[0]
        if is_shown and isinstance(first, ast.Constant | ast.JoinedStr):
            yield node.lineno, ast.unparse(first)


def test_no_text_of_the_window_stands_outside_its_one_file():
    """A translation is one file: messages about what was given to the window are in it, too."""
    found = []
    for path in sorted(pages.glob("*.py")):
        if path.name == "texts.py":
            continue
        module = ast.parse(path.read_text(encoding="utf-8"))
        for line, text in (*list_passages(module), *list_shown_literals(module)):
            found.append(f"{path.name}:{line}: {text}")
    assert found == []
