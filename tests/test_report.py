"""The report reads what benchmarks print, and mutants are put where they are said to be."""

import hashlib
import importlib
import importlib.util
import json
import runpy
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def report():
    return importlib.import_module("report")


@pytest.fixture(scope="module")
def mutations():
    return importlib.import_module("mutations")


@pytest.fixture(scope="module")
def soak():
    return importlib.import_module("soak")


def test_a_summary_of_no_draws_says_that_there_are_none(monkeypatch, capsys):
    coverage = importlib.import_module("softgauge_coverage")
    monkeypatch.setattr(coverage, "OUT", coverage.records.ROOT / "out" / "none.jsonl")
    monkeypatch.setattr("sys.argv", ["softgauge_coverage.py", "--summary"])
    assert coverage.main() == 1
    assert "no draws of the present code in out/none.jsonl" in capsys.readouterr().out


def test_tables_of_an_output_are_found_in_markdown_and_in_columns(report):
    text = "| a | b |\n|---|---:|\n| 1 | 2 |\n\nname   value\nfirst thing   3\nsecond   4\n"
    markdown, columns = report.read_tables(text)
    assert (markdown["columns"], markdown["rows"]) == (["a", "b"], [["1", "2"]])
    assert columns["rows"] == [["first thing", "3"], ["second", "4"]]


def test_a_table_of_the_evidence_is_read_as_it_was_printed_with_its_empty_cells(report):
    evidence = importlib.import_module("literature.__main__")
    rows = [["power of 10 µJ", "625 µW", "", "", "agrees"], ["step", "", "2 mJ", "1 mJ", ""]]
    table = pd.DataFrame(rows, columns=["figure", "formula", "drag", "rod", "verdict"])
    printed = f"Published\n\n{evidence.format_markdown(table)}\n\nThe end.\n"
    (read,) = report.read_tables(printed)
    assert read == {"caption": "Published", "columns": list(table.columns), "rows": rows}


def test_a_figure_is_the_text_that_its_pattern_finds(report):
    assert report.find_figure("drags per second: 3729", r": (\d+)", "{}") == "3,729"
    assert report.find_figure("| **all 9** | **2018** |", r"\*\*(2\d+)\*\*", "{:GB} GB") == "2.0 GB"
    assert report.find_figure("nothing here", r"(\d+)", "{}") is None


def test_every_record_has_a_part_that_measures_it_again(report):
    names = [part.name for part in report.PARTS]
    assert sorted(names) == sorted(path.stem for path in (ROOT / "docs" / "records").iterdir())


def test_the_programs_of_every_part_are_there(report):
    for part in report.PARTS:
        for line in part.command.split(" && "):
            words = line.split()
            assert words[0] == "python"
            if words[1] == "-m":
                assert importlib.util.find_spec(words[2]), line
            else:
                assert (ROOT / words[1]).is_file(), line


def test_every_benchmark_loads():
    pytest.importorskip("mujoco")  # one of them drags in it
    for path in sorted((ROOT / "benchmarks").glob("*.py")):
        module = importlib.import_module(path.stem)
        assert path.samefile(module.__file__)
        assert callable(getattr(module, "main", str)), path


def test_a_part_of_several_programs_reads_the_output_of_all(report, tmp_path):
    one, two = tmp_path / "one.py", tmp_path / "two.py"
    one.write_text("print('first: 0.1766')")
    two.write_text("print('second: 12')")
    figures = {"a": (r"first: (\S+)", "{:%}"), "b": (r"second: (\d+)", "{} of 13")}
    part = report.Part("none", f"python {one} && python {two}", figures)
    before = {"code": [], "commit": "a", "date": "b", "tables": []}
    before["figures"] = [{"id": "a", "text": "?", "older": "c"}, {"id": "b"}, {"id": "c"}]
    assert report.measure(part, before)["figures"] == [
        {"id": "a", "text": "18 %"},
        {"id": "b", "text": "12 of 13"},
        {"id": "c", "older": "a, b"},
    ]


@pytest.mark.long
def test_what_tests_hold_stands_while_they_pass(report, tmp_path):
    test = tmp_path / "test_one.py"
    test.write_text("def test_one():\n    assert True\n")
    part = report.Part("none", f"python -m pytest -q {test}", held=True)
    before = {"code": [], "commit": "a", "date": "b", "tables": [1]}
    before["figures"] = [{"id": "a", "text": "1e-5", "older": "c"}]
    record = report.measure(part, before)
    assert (record["figures"], record["tables"]) == ([{"id": "a", "text": "1e-5"}], [1])
    for text, said in (
        ("def test_one():\n    assert False\n", "exit code 1"),
        ("import pytest\ndef test_one():\n    pytest.skip('no program')\n", "were skipped"),
    ):
        test.write_text(text)
        with pytest.raises(RuntimeError, match=said):
            report.measure(part, before)


def test_every_figure_of_a_record_comes_from_what_its_part_prints_or_is_held_by_its_tests(report):
    for part in report.PARTS:
        path = ROOT / "docs" / "records" / f"{part.name}.json"
        known = {one["id"] for one in json.loads(path.read_text())["figures"]}
        assert set(part.figures) == (set() if part.held else known), part.name
        assert part.optional <= set(part.figures)


def test_a_figure_of_a_program_that_is_not_here_keeps_its_text_with_a_mark(report, tmp_path):
    one = tmp_path / "one.py"
    one.write_text("print('a: 3')")
    figures = {"a": (r"a: (\d+)", "{}"), "b": (r"b: (\d+)", "{}")}
    part = report.Part("none", f"python {one}", figures, optional=frozenset("b"))
    before = {"code": [], "commit": "x", "date": "y", "tables": []}
    before["figures"] = [{"id": "a", "text": "2"}, {"id": "b", "text": "7"}]
    assert report.measure(part, before)["figures"] == [
        {"id": "a", "text": "3"},
        {"id": "b", "text": "7", "older": "x, y"},
    ]


def test_a_part_that_fails_leaves_the_record_as_it_was(report, tmp_path):
    part = report.Part("none", "python -c raise(SystemExit(3))")
    with pytest.raises(RuntimeError, match="exit code 3"):
        report.measure(part, {"code": [], "figures": [], "commit": "a", "date": "b"})


def test_a_mutant_changes_the_expression_that_it_names_and_nothing_else(mutations):
    for room in ("drag", "study/analysis"):
        for mutant in mutations.find_mutants(ROOT, room)[::40]:
            whole = (ROOT / mutant.path).read_bytes()
            start, end = mutant.span
            assert whole[start:end].decode() == mutant.before
            changed = whole[:start] + mutant.after.encode() + whole[end:]
            compile(changed, mutant.path, "exec")
            assert mutant.before != mutant.after


@pytest.mark.long
def test_the_core_offers_more_mutants_than_are_asked_for_and_each_has_tests(mutations):
    for room in mutations.ROOMS:
        found = mutations.find_mutants(ROOT, room)
        assert len(found) > 60
        for mutant in found[::100]:
            assert all((ROOT / name).exists() for name in mutations.tests_of(ROOT, mutant))


@pytest.mark.long
def test_a_mutant_stands_only_while_its_tests_run(mutations, tmp_path, monkeypatch):
    house = tmp_path / "src" / "stepblocks" / "drag"
    house.mkdir(parents=True)
    (house / "one.py").write_text("def twice(x):\n    return 2 * x\n")
    folder = tmp_path / "tests" / "drag"
    folder.mkdir(parents=True)
    (folder / "test_one.py").write_text(
        "import runpy\n\n"
        "def test_twice():\n"
        "    one = runpy.run_path('src/stepblocks/drag/one.py')\n"
        "    assert one['twice'](3) == 6\n"
    )
    monkeypatch.setattr(mutations, "ROOT", tmp_path)
    tree = mutations.Tree(tmp_path / "copy")
    found = mutations.find_mutants(tmp_path, "drag")
    assert {mutant.after for mutant in found} == {"(2 / x)", "3"}
    tests = mutations.tests_of(tmp_path, found[0])
    assert tests == ["tests/drag/test_one.py"]
    assert tree.run(tests, 600.0) == "passed"
    for mutant in found:
        assert tree.run(tests, 600.0, mutant=mutant) == "failed"
    assert tree.run(tests, 600.0) == "passed"


def test_a_sample_of_mutants_fails_where_more_than_the_stated_share_survives(
    mutations, tmp_path, monkeypatch
):
    found = mutations.find_mutants(ROOT, "drag")[:10]
    monkeypatch.setattr(mutations, "EQUIVALENT", tmp_path / "none.json")
    monkeypatch.setattr(mutations, "Tree", lambda _: SimpleNamespace(root=ROOT, run=answer))
    answers = []

    def answer(*_, **__):
        return answers.pop()

    for survivors, code in ((3, 0), (4, 1)):
        # the quick tests of a survivor pass, and then its long ones
        answers[:] = ["passed", "passed"] * survivors + ["failed"] * (10 - survivors)
        assert mutations.sample(found, 600.0, 0.3) == code
    # what long tests alone notice has not survived; answers are taken from the end
    answers[:] = ["failed", "passed"] * 10
    assert mutations.sample(found, 600.0, 0.3) == 0
    assert answers == []
    # one that is known to be equivalent is not tried
    fields = ("path", "function", "before", "after")
    equal = {name: getattr(found[0], name) for name in fields} | {"reason": "equal"}
    (tmp_path / "none.json").write_text(json.dumps([equal]))
    answers[:] = ["failed"] * 9
    assert mutations.sample(found, 600.0, 0.3) == 0
    assert answers == []


@pytest.mark.long
def test_every_mutant_that_no_test_can_notice_is_one_of_the_present_code(mutations):
    """A reason for code that has changed since says nothing of what stands there now."""
    present = set()
    for room in mutations.ROOMS:
        for mutant in mutations.find_mutants(ROOT, room):
            present.add(mutant.key)
    known = mutations.read_known_survivors()
    outdated = [survivor for key, survivor in known.items() if key not in present]
    assert known
    assert outdated == []


def test_the_hash_of_code_sees_templates_and_no_comment(report, tmp_path, monkeypatch):
    records = report.records
    room = tmp_path / "src" / "stepblocks" / "room"
    room.mkdir(parents=True)
    monkeypatch.setattr(records, "ROOT", tmp_path)
    count = records.code_hash.__wrapped__
    (room / "one.py").write_text("x = 1\n")
    (room / "page.js").write_text("let x = 1;\n")
    first = count("room")
    (room / "one.py").write_text('"""A word."""\nx = 1  # a comment\n')
    assert count("room") == first
    (room / "page.js").write_text("let x = 2;\n")
    assert count("room") != first


def test_the_site_hooks_know_every_generated_page():
    hooks = runpy.run_path(str(ROOT / "docs" / "generated_pages.py"))
    assert all((ROOT / "docs" / page).exists() for page in hooks["PAGES"])


def test_a_mutant_stands_in_functions_that_are_loaded_already(mutations, tmp_path, monkeypatch):
    text = "class A:\n    @staticmethod\n    def f(x):\n        return [x + 1 for _ in range(2)]\n"
    path = tmp_path / "loaded_before.py"
    path.write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    import loaded_before

    call = loaded_before.A.f
    assert call(3) == [4, 4]
    start = text.index("x + 1")
    mutant = mutations.Mutant("", path.name, "A.f", 4, (start, start + 5), "x + 1", "(x - 1)")
    path.write_text(text.replace("x + 1", "(x - 1)"))
    assert mutations.patch(SimpleNamespace(root=tmp_path), mutant)
    assert call(3) == [2, 2]


def test_a_soak_sees_growth_after_the_warm_up_and_half_a_file(soak, tmp_path):
    # twenty rounds of warm-up, then one more each round: medians of fifths of 100 to 199
    values = [float(number) for number in [*range(20), *range(100, 200)]]
    assert soak.find_growth(values, 20) == (109.5, 189.5)
    assert soak.find_growth([900.0] * 20 + [7.0] * 100, 20) == (7.0, 7.0)
    (tmp_path / ".partial-1").mkdir()
    (tmp_path / ".partial-1" / "draft").write_text("x")
    (tmp_path / ".stepblocks.json").write_text('{"a": 1')
    (tmp_path / "a").write_text("x")
    found = soak.hash_tree(tmp_path)
    assert found == {".stepblocks.json": "half", "a": hashlib.sha256(b"x").hexdigest()}
