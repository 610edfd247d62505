"""Fill docs/reference/library.md with every public name, room by room; the stub lists them."""

import ast
from pathlib import Path

STUB = Path(__file__).resolve().parents[1] / "src" / "stepblocks" / "__init__.pyi"


def names():
    """Yield the module and the name of everything public."""
    for node in ast.parse(STUB.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            yield from ((node.module, one.name) for one in node.names)


def on_page_markdown(markdown, page, **_):
    """Add what mkdocstrings shall describe."""
    if page.file.src_uri != "reference/library.md":
        return markdown
    lines, room = [markdown], None
    for module, name in sorted(names()):
        if module.split(".")[0] != room:
            room = module.split(".")[0]
            lines.append(f"## {room}")
        lines.append(f"::: stepblocks.{module}.{name}")
    return "\n\n".join(lines)
