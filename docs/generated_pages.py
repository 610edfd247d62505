"""Fill the pages that the source writes: commands, files, messages, and the verification report."""

import ast
import re
import sys
import tomllib
from pathlib import Path

DOCS = Path(__file__).resolve().parent
HOUSE = DOCS.parent / "src" / "stepblocks"
sys.path.insert(0, str(DOCS.parent / "benchmarks"))

import records  # noqa: E402

UNITS = {
    "um": "µm",
    "mm": "mm",
    "m": "m",
    "uj": "µJ",
    "j": "J",
    "n": "N",
    "uw": "µW",
    "deg": "°",
    "hz": "Hz",
    "s": "s",
    "db": "dB",
    "g": "g",
    "mm_s": "mm/s",
    "m_s": "m/s",
    "n_per_s": "N/s",
    "n_per_m": "N/m",
    "c": "°C",
    "pct": "%",
    "mm_or_deg": "mm or °",
    "v_per_v_per_n": "V/V/N",
}
ENDS = sorted(UNITS, key=len, reverse=True)
DERIVED = {
    "_95_low": "lower end of the 95 % interval",
    "_95_high": "upper end of the 95 % interval",
    "_std": "standard uncertainty",
    "_low": "least value over the tolerances or lower end of the interval",
    "_high": "greatest value over the tolerances or upper end of the interval",
}


def column_files():
    """List the files with columns, as they are described."""
    text = (DOCS / "reference" / "columns.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)["file"]


def column_unit(name):
    """Find the unit that the end of a name says."""
    return next((UNITS[end] for end in ENDS if name.endswith(f"_{end}")), "")


def column_base(name):
    """Find the name and the words of a column that says how sure another one is."""
    if name.startswith("factor_"):
        return "factor_NAME", "level of a declared factor"
    for word, meaning in DERIVED.items():
        if word in name:
            return name.replace(word, "", 1), meaning
    return name, ""


def columns_table():
    """Write a section for each file."""
    lines = []
    for file in column_files():
        lines += [f"## {file['name']}", f"Written by {file['by']}. {file['about']}"]
        rows = ["| column | unit | meaning |", "|---|---|---|"]
        rows += [
            f"| `{name}` | {column_unit(name)} | {meaning} |"
            for name, meaning in file["columns"].items()
        ]
        lines.append("\n".join(rows))
    return "\n\n".join(lines)


def value_name(node):
    """Name the value that stands in a message."""
    names = [
        one.attr if isinstance(one, ast.Attribute) else one.id
        for one in ast.walk(node)
        if isinstance(one, ast.Attribute | ast.Name)
    ]
    ours = [name for name in names if name not in {"self", "str", "repr", "len", "brief"}]
    return ours[0].strip("_").replace("_", " ") if ours else "value"


def template(node):
    """Write a message with its values as words in angle brackets; nothing for what is no text."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        parts = [
            part.value if isinstance(part, ast.Constant) else f"<{value_name(part.value)}>"
            for part in node.values
        ]
        return "".join(parts)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return template(node.left) + template(node.right)
    return ""


def messages():
    """Find every message of a room: what is raised, and what is added to the mistakes of a file."""
    found = {}
    for path in sorted(HOUSE.rglob("*.py")):
        room = path.relative_to(HOUSE).parts[0].removesuffix(".py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            texts = []
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                if ast.unparse(node.exc.func).endswith("Error"):
                    texts = [node.exc.args[0]]
            elif isinstance(node, ast.Call) and re.search(
                r"(?:^|Error\.)require$", ast.unparse(node.func)
            ):
                texts = node.args[1:2]
            elif (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr == "append"
                and "mistakes" in ast.unparse(node.func.value)
                and isinstance(node.args[0], ast.Tuple)
            ):
                texts = [node.args[0].elts[-1]]
            for text in texts:
                said = template(text).strip()
                if len(re.sub(r"<[^>]*>|\W", "", said)) > 8:
                    found.setdefault(room, set()).add(" ".join(said.split()))
    return found


def messages_table():
    """Write a section for each room."""
    lines = []
    for room, texts in sorted(messages().items()):
        lines.append(f"## {room}")
        lines.append("\n".join(f"- `{text.replace('`', chr(39))}`" for text in sorted(texts)))
    return "\n\n".join(lines)


COMMON = {"--quiet", "--json", "--wide", "--force"}  # named once, at the head of the page


def option_row(context, option):
    """Write the row of an argument or option."""
    record = option.get_help_record(context)
    if record is None:  # an argument, whose help stands in the description
        return f"| `{option.make_metavar(context)}` | {getattr(option, 'help', '') or ''} |"
    name, meaning = record
    name = re.sub(r" <(?:list\[)?\w+\]?>$", "", name)
    return f"| `{name}` | {' '.join(meaning.split())} |"


def commands_table():
    """Write a section for each command, as its help says it."""
    from click import Context

    from stepblocks.cli import make_root_command

    lines = []

    def walk(command, words, parent):
        context = Context(command, info_name=command.name, parent=parent)
        if hasattr(command, "commands"):
            for word, child in command.commands.items():
                walk(child, (*words, word), context)
            return
        lines.append(f"## {' '.join(words)}")
        lines.append(" ".join((command.help or "").split()))
        own = [one for one in command.params if not {*one.opts} & COMMON and not one.hidden]
        rows = [option_row(context, one) for one in own]
        lines.append("\n".join(["| argument or option | meaning |", "|---|---|", *rows]))

    walk(make_root_command(), (), None)
    return "\n\n".join(lines)


PAGES = {
    "reference/commands.md": commands_table,
    "reference/files.md": columns_table,
    "reference/messages.md": messages_table,
    "verification.md": records.report,
}


def on_page_markdown(markdown, page, **_):
    """Add to a page what the source says."""
    write = PAGES.get(page.file.src_uri)
    return f"{markdown}\n\n{write()}\n" if write else markdown
