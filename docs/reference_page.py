"""Fill docs/reference/library.md with every public name, room by room; the stub lists them.

Beside them stand the classes of what public functions return, such as `Drag`.
"""

import ast
import inspect
import typing
from pathlib import Path

import stepblocks

STUB = Path(__file__).resolve().parents[1] / "src" / "stepblocks" / "__init__.pyi"


def names():
    """Yield the module and the name of everything public."""
    for node in ast.parse(STUB.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            yield from ((node.module, one.name) for one in node.names)


def classes_in(annotation):
    """Yield the classes of ours that an annotation names."""
    if inspect.isclass(annotation) and annotation.__module__.startswith("stepblocks."):
        yield annotation
    for part in typing.get_args(annotation):
        yield from classes_in(part)


def results():
    """Yield the module and the name of every class that a public function returns."""
    for _, name in names():
        function = getattr(stepblocks, name)
        returned = inspect.isfunction(function) and function.__annotations__.get("return")
        for kind in classes_in(returned):
            yield kind.__module__.removeprefix("stepblocks."), kind.__name__


def on_page_markdown(markdown, page, **_):
    """Add what mkdocstrings shall describe."""
    if page.file.src_uri != "reference/library.md":
        return markdown
    lines, room = [markdown], None
    for module, name in sorted({*names(), *results()}):
        if module.split(".")[0] != room:
            room = module.split(".")[0]
            lines.append(f"## {room}")
        lines.append(f"::: stepblocks.{module}.{name}")
    return "\n\n".join(lines)
