"""Adaptive studies from the command line: stepwise, interrupted, simulated, and on into the report."""

import csv
import io
import json
import re
from pathlib import Path

import pytest

from oracles.adaptive_participants import answer_all
from stepblocks.cli import main
from stepblocks.errors import StudyError
from stepblocks.study.adaptive import open_adaptive, record_answer

TEN = str(Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml")


def run(capsys, *arguments):
    code = main(["study", "adaptive", *map(str, arguments)])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def table(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture
def folder(tmp_path, capsys):
    options = ["--standard", "step-050", "--participants", 2, "--trials", 30, "--seed", 5]
    assert run(capsys, "start", TEN, *options, "-o", tmp_path / "s")[0] == 0
    return tmp_path / "s"


def keyed(monkeypatch, capsys, folder, text):
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    return run(capsys, "run", folder, "--participant", 1)[1]


def test_answers_given_one_by_one_or_at_the_keyboard_make_the_same_record(
    folder, capsys, tmp_path, monkeypatch
):
    for trial, letter in enumerate("ynyyn", start=1):
        record_answer(folder, 1, trial, letter == "y")
    record = (folder / "answers" / "participant-1.csv").read_bytes()
    options = ["--standard", "step-050", "--participants", 2, "--trials", 30, "--seed", 5]
    run(capsys, "start", TEN, *options, "-o", tmp_path / "t")
    assert "stopped after 2 trials" in keyed(monkeypatch, capsys, tmp_path / "t", "y\nwhat\nn\nq\n")
    # the keyboard is gone after the third
    assert "stopped after 5 trials" in keyed(monkeypatch, capsys, tmp_path / "t", "y\ny\nn\n")
    assert (tmp_path / "t" / "answers" / "participant-1.csv").read_bytes() == record
    # asking changes nothing
    assert keyed(monkeypatch, capsys, folder, "q\n").startswith(
        f"trial 6: first {open_adaptive(folder).session(1).next_pair().first}"
    )


def test_a_trainee_is_told_what_was_right(tmp_path, capsys, monkeypatch):
    start = [
        "start",
        TEN,
        "--standard",
        "step-050",
        "--method",
        "training",
        "--seed",
        5,
        "-o",
        tmp_path,
    ]
    assert run(capsys, *start)[0] == 0
    pair = (study := open_adaptive(tmp_path)).session(1).next_pair()
    second = study.blocks[pair.second].height > study.blocks[pair.first].height
    told = keyed(monkeypatch, capsys, tmp_path, "y\nq\n" if second else "n\nq\n")
    assert "right\n" in told
    assert "wrong" not in told


def test_who_writes_the_answers_sees_neither_identity_nor_height(folder):
    answer_all(folder, 0.3, seed=2)
    text = (folder / "answers" / "participant-2.csv").read_text()
    assert not re.search(r"step|STEP|\d{3}", text)
    key = {row["code"] for row in table(folder / "key.csv")}
    assert {row["first_code"] for row in table(folder / "answers" / "participant-2.csv")} <= key


def test_answers_go_on_into_results_and_report(folder, capsys):
    assert answer_all(folder, 0.3, seed=2) == 60
    code, _out, _ = run(capsys, "result", folder)
    assert code == 0
    rows = table(folder / "adaptive-results.csv")
    assert [row["state"] for row in rows] == ["done", "done"]
    assert all(
        float(row["weber_low_95_ratio"])
        < float(row["weber_ratio"])
        < float(row["weber_high_95_ratio"])
        for row in rows
    )
    assert (
        main(
            [
                "study",
                "analyse",
                str(folder),
                str(folder / "answers.csv"),
                "-o",
                str(folder / "report"),
            ]
        )
        == 0
    )
    assert "point of subjective equality" in (folder / "report" / "results.csv").read_text()


def test_damage_is_named_with_its_line(folder, capsys):
    for trial in (1, 2):
        record_answer(folder, 1, trial, True)
    with pytest.raises(StudyError, match="trial must be 3"):
        record_answer(folder, 1, 2, False)
    assert (
        "participant must be one of 1 to 2, got 3"
        in run(capsys, "run", folder, "--participant", 3)[2]
    )
    path = folder / "answers" / "participant-1.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], lines[2].replace("1,2,", "1,2,X")]) + "\n")
    code, _, err = run(capsys, "run", folder, "--participant", 1)
    assert (
        code,
        "the procedure asks for participant, trial and codes 1 2" in err,
        "line 3" in err,
    ) == (2, True, True)
    path.write_text("\n".join([*lines[:2], lines[2][:-1] + "?"]) + "\n")
    assert "second_is_higher must be y or n, got '?'" in run(capsys, "result", folder)[2]
    setup = json.loads((folder / "setup.json").read_text())
    for broken in (
        "",
        "[]",
        json.dumps(setup | {"schema": 9}),
        json.dumps(setup | {"trials": "many"}),
    ):
        (folder / "setup.json").write_text(broken)
        code, _, err = run(capsys, "run", folder, "--participant", 1)
        assert code == 2
        assert "setup.json" in err
        assert "Traceback" not in err
