"""What the pages promise is there: the files that they name, the commands and options that they
show, the pages they link.
"""

import importlib
import re
import runpy
from pathlib import Path

import page_types
import pytest

from stepblocks.cli import make_root_command

ROOT = Path(__file__).resolve().parents[1]
HOUSE = ROOT / "src" / "stepblocks"
DOCS = ROOT / "docs"
PAGES = [ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING")]
PAGES += sorted(DOCS.rglob("*.md"))
ROOMS = sorted(
    path.name for path in HOUSE.iterdir() if path.is_dir() and (path / "__init__.py").exists()
)
PLACES = re.compile(
    rf"(?<![\w/.<>-])(?:tests|src|benchmarks|stimuli|docs|{'|'.join(ROOMS)})/"
    r"[\w./{}*-]*(?:::\w+)?"
)
SUFFIXES = "json|cpp|py|toml|csv|html"  # drag.json is a file, no name of the library
NAMES = re.compile(
    rf"(?<![\w./-])(?:stepblocks|{'|'.join(ROOMS)})(?:\.(?!(?:{SUFFIXES})\b)\w+)+(?!\w*\.?[/\w])"
)
# files of the reader's own, in examples
THEIRS = {
    "stimuli/mine.toml",
    "stimuli/x.toml",
    "tests/ROOM",
    "loop/model.json",
}
SHELLS = ("", "bash", "sh", "console", "text")


def blocks(page):
    """Language and text of every fenced block."""
    return re.findall(r"^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


def spans(page):
    """Every stretch of code in a line of prose."""
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return [span.replace("\n", " ") for span in re.findall(r"`([^`]+)`", prose)]


def shell_lines(page):
    """Every line that a reader might type, its comment cut off."""
    typed = [text.replace("\\\n", " ") for language, text in blocks(page) if language in SHELLS]
    return [line.split("  #")[0] for text in typed for line in text.splitlines()] + spans(page)


def named_places(page):
    for text in [*spans(page), *(text for _, text in blocks(page))]:
        for place in PLACES.findall(text):
            yield place.rstrip(".,:/")


def exists(place):
    path, _, test = place.partition("::")
    # a room may be named without the way to it, a module without its suffix
    for start in (ROOT, HOUSE):
        for found in start.glob(re.sub(r"\{.*?\}", "*", path)) if path else ():
            return not test or f"def {test}(" in found.read_text(encoding="utf-8")
        if start is HOUSE and (start / f"{path}.py").exists():
            return True
    return False


def all_options():
    """The options of every command, by its words."""
    found = {}

    def walk(command, words):
        names = {"-h", "--help"}
        names.update(name for one in command.params for name in one.opts)
        found[words] = names
        for word, child in getattr(command, "commands", {}).items():
            walk(child, (*words, word))

    walk(make_root_command(), ())
    return found


OPTIONS = all_options()


def shown_commands(line):
    """Each command of a line with the words after it: its name as far as there is one, and its
    options.
    """
    for said in re.split(r"(?<![\w./-])(?:python -m )?stepblocks(?= [a-z-])", line)[1:]:
        words = re.split(r"[\s,;|]+", said.strip())
        command = ()
        while words and (*command, words[0]) in OPTIONS:
            command = (*command, words.pop(0))
        yield (
            command,
            said.split()[0],
            {
                word.split("=")[0]
                for word in words
                if re.fullmatch(r"--[a-z][a-z0-9-]*(=.*)?", word)
            },
        )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_that_a_page_names_exists(page):
    assert [
        place for place in named_places(page) if place not in THEIRS and not exists(place)
    ] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_and_option_that_a_page_shows_is_offered(page):
    wrong = []
    for line in shell_lines(page):
        for command, first, options in shown_commands(line):
            if not command:
                wrong.append(f"stepblocks {first}")
            wrong += [f"{' '.join(command)} {option}" for option in options - OPTIONS[command]]
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_option_of_a_benchmark_that_a_page_shows_is_one(page):
    wrong = []
    for line in shell_lines(page):
        for script, rest in re.findall(r"python (benchmarks/\w+\.py)(.*)", line):
            text = (ROOT / script).read_text(encoding="utf-8")
            wrong += [
                f"{script} {option}"
                for option in re.findall(r"--[a-z][a-z0-9-]*", rest)
                if f'"{option}"' not in text
            ]
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_option_named_by_itself_is_one_of_some_command(page):
    known = set().union(*OPTIONS.values())
    scripts = "".join(
        path.read_text(encoding="utf-8") for path in (ROOT / "benchmarks").rglob("*.py")
    )
    named = {
        word
        for span in spans(page)
        if span.startswith("--")
        for word in re.findall(r"--[a-z][a-z0-9-]*", span)
    }
    assert {option for option in named - known if f'"{option}"' not in scripts} == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_relative_link_leads_to_a_file(page):
    targets = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    assert [
        target for target in targets if "://" not in target and not (page.parent / target).exists()
    ] == []


def resolves(dotted):
    """Whether a dotted name below the package is a module, or something in one."""
    for cut in range(len(dotted), 0, -1):
        try:
            found = importlib.import_module(".".join(dotted[:cut]))
        except ModuleNotFoundError:
            continue
        for name in dotted[cut:]:
            if not hasattr(found, name):
                return False
            found = getattr(found, name)
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_name_of_the_library_that_a_page_shows_is_there(page):
    said = {name for text in spans(page) for name in NAMES.findall(text)}
    python = "\n".join(text for language, text in blocks(page) if language == "python")
    said |= set(re.findall(r"(?<![\w.])stepblocks\.[\w.]*\w", python))
    for module, names in re.findall(r"^from (stepblocks[\w.]*) import (.+)$", python, re.M):
        said |= {f"{module}.{name.split(' as ')[0].strip()}" for name in names.split(",")}
    parts = {name: name.removeprefix("stepblocks.").split(".") for name in said}
    assert [name for name, words in parts.items() if not resolves(["stepblocks", *words])] == []


# the hooks of the site and the records of what was measured
GENERATED = runpy.run_path(str(DOCS / "generated_pages.py"))
FIGURES = GENERATED["records"].figures()


def misquoted(text):
    """Each link to the report that says another figure than was measured; one to a whole part says
    none.
    """
    quoted = re.findall(r"\[([^\]]+)\]\((?:\.\./|docs/)*verification\.md#([\w-]+)\)", text)
    measured = [(said, name, FIGURES.get(name, "no such figure")) for said, name in quoted]
    return [
        (said, name, figure)
        for said, name, figure in measured
        if (" ".join(said.split()) != figure if figure else re.search(r"\d", said))
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_figure_that_a_page_quotes_is_the_one_that_was_measured(page):
    assert misquoted(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("said", "figure"),
    [("none", "one"), ("1890", "189"), ("0.189", "189"), ("-18 %", "18 %"), ("6 of 17", "6 of 1")],
)
def test_a_figure_within_another_one_is_no_quotation_of_it(said, figure, monkeypatch):
    monkeypatch.setitem(FIGURES, "a-figure", figure)
    link = "It is [{}](../verification.md#a-figure) in all."
    assert misquoted(link.format(said)) == [(said, "a-figure", figure)]
    assert misquoted(link.format(figure)) == []
    assert misquoted(link.format(figure.replace(" ", "\n"))) == []
    assert misquoted("[1](verification.md#gone)") == [("1", "gone", "no such figure")]
    assert misquoted("[7 %](verification.md#drag-paper)") == [("7 %", "drag-paper", "")]


def test_figures_have_one_record_each_and_every_record_says_how_it_was_measured():
    every = GENERATED["records"].load()
    names = [one["part"] for one in every] + [fig["id"] for one in every for fig in one["figures"]]
    assert len(names) == len(set(names))
    for record in every:
        for key in ("title", "command", "commit", "date", "machine", "versions"):
            assert record[key], (record["part"], key)
        assert [one for one in record["code"] if not (HOUSE / one).exists()] == []
        for table in record["tables"]:
            assert {len(row) for row in table["rows"]} <= {len(table["columns"])}, table["caption"]


def test_the_report_marks_what_is_older_than_the_code():
    module = GENERATED["records"]
    record = module.load()[0]
    now = {**record, "code_hash": module.code_hash(*record["code"])}
    assert "Older than the code" not in module.section(now)
    assert "Older than the code" in module.section({**now, "code_hash": "another"})


def test_the_glossary_gives_each_term_once_with_a_source():
    text = (DOCS / "reference" / "glossary.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    terms = [row[0] for row in rows[1:]]
    assert {len(row) for row in rows} == {3}
    assert len(terms) == len(set(terms)) >= 60


def test_every_page_is_in_the_contents_of_the_site():
    contents = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = [path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")]
    assert [page for page in pages if page not in contents] == []


@pytest.mark.long
def test_the_python_of_every_page_fits_the_types_of_the_library(tmp_path):
    # a page of a field that is gone is among them, so that what finds nothing is known to look
    wrong = tmp_path / "wrong.md"
    wrong.write_text(
        "# A page\n\n```python\nimport stepblocks as sb\n!ls\n"
        'print(sb.order_parts("a.toml", "out").missing)\n```\n'
    )
    said = page_types.check_pages([*PAGES, wrong])
    assert re.fullmatch(rf'{wrong}:6: error: .* has no attribute "missing".*\n', said), said


@pytest.mark.long
def test_a_benchmark_asks_for_nothing_that_is_not_there(tmp_path):
    # four slips of a rename are among them, and a patched name, which is no slip
    wrong = tmp_path / "wrong_benchmark.py"
    wrong.write_text(
        "from stepblocks.contact.operating_point import OperatingPoint\n"
        "from stepblocks.study.experiments import comparisons\n"
        "from stepblocks.study.analysis.population import Nobody\n\n\n"
        "def main():\n"
        "    point = OperatingPoint(125e-6, 1.0, 0.15, normal=1.0)\n"
        "    comparisons.fit_comparisons_of_setting = None\n"
        "    print(point.radius, undeclared)\n"
    )
    said = page_types.check_programs([*page_types.list_programs(), wrong])
    assert re.findall(r"(\w+)\.py:(\d+): error: .*\[(.*)\]", said) == [
        ("wrong_benchmark", "3", "attr-defined"),
        ("wrong_benchmark", "7", "call-arg"),
        ("wrong_benchmark", "9", "attr-defined"),
        ("wrong_benchmark", "9", "name-defined"),
    ], said


@pytest.mark.long
def test_one_number_gives_a_number_and_an_array_gives_an_array_to_a_type_checker(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "```python\nfrom typing import assert_type\n\nimport numpy as np\n"
        "import stepblocks as sb\nfrom numpy.typing import NDArray\n\n"
        "many: NDArray[np.float64] = np.array([10e-6, 20e-6])\n"
        "assert_type(sb.find_step_angle(25e-6, 125e-6), float)\n"
        "assert_type(sb.find_step_angle(many, 125e-6), NDArray[np.float64])\n"
        "assert_type(sb.find_margin_angles(50e-6, 0.0, 125e-6), tuple[float, float])\n"
        "assert_type(sb.find_release(0.5, 1.0, 0.15).pull_force, float)\n"
        "assert_type(sb.find_release(many, 1.0, 0.15).pull_force, NDArray[np.float64])\n```\n"
    )
    assert page_types.check_pages([page]) == ""


def test_messages_are_listed_from_the_source():
    text = GENERATED["messages_table"]()
    assert text.count("\n- `") > 300
    assert "must not exceed" in text
    # a rule that is raised, one that is required, and one of the studies
    assert "- `a mesh file must be at most" in text
    assert "- `scan must be a file, got <path>`" in text
    assert "- `standard must be one of <join>, got <standard>`" in text


def test_the_paper_has_at_most_a_thousand_words():
    assert len((DOCS / "paper.md").read_text(encoding="utf-8").split()) <= 1000


def test_columns_say_their_unit_and_each_is_described():
    for file in GENERATED["column_files"]():
        for name, meaning in file["columns"].items():
            assert meaning, (file["name"], name)
    assert GENERATED["column_unit"]("peak_force_n") == "N"
    assert GENERATED["column_unit"]("loading_slope_n_per_s") == "N/s"
