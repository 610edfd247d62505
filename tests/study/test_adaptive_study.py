"""An adaptive study in its folder: pair by pair, the same again after any interruption, and on into the analysis."""

import json
import math
from pathlib import Path

import pytest

from oracles.adaptive_participants import answer_all
from stepblocks.errors import PipelineError, StudyError
from stepblocks.study.adaptive import (
    estimate_participants,
    open_adaptive,
    record_answer,
    start_adaptive,
)
from stepblocks.study.run import analyse_study
from stepblocks.study.sheet import read_answers, read_design

TEN = str(Path(__file__).resolve().parents[2] / "stimuli" / "paper-ten.toml")


def next_pair(folder, participant):
    return open_adaptive(folder).session(participant).next_pair()


@pytest.fixture
def folder(tmp_path):
    start_adaptive(TEN, tmp_path, standard="step-050", seed=5, participants=2, trials=12)
    return str(tmp_path)


def test_a_pair_is_asked_for_until_it_is_answered(folder):
    pair = next_pair(folder, 1)
    assert next_pair(folder, 1) == pair
    session = record_answer(folder, 1, pair.trial, second_is_higher=True)
    assert [given for given, _ in session.answers] == [pair]
    assert next_pair(folder, 1).trial == 2
    assert next_pair(folder, 2).trial == 1


def test_a_session_ends_and_says_so(folder):
    while (pair := next_pair(folder, 2)) is not None:
        assert str(open_adaptive(folder).session(2)) == (
            f"participant 2, trial {pair.trial}: first {pair.first}, then {pair.second}"
        )
        session = record_answer(folder, 2, pair.trial, pair.trial % 2 == 0)
    assert str(session) == "participant 2: done after 12 trials"
    with pytest.raises(StudyError, match="is done after 12 trials"):
        record_answer(folder, 2, 13, True)


def test_what_was_set_up_is_what_is_opened(folder):
    study = open_adaptive(folder)
    standard = study.blocks[study.plan.standard]
    assert (standard.identity, standard.engraved) == ("step-050", "STEP-050")
    assert standard.height == pytest.approx(50e-6, rel=1e-12)
    assert len(study.plan.compared) == 9
    assert (
        start_adaptive(TEN, folder, standard="step-050", seed=5, participants=2, trials=12) == study
    )
    with pytest.raises(PipelineError, match="has another content already"):
        start_adaptive(TEN, folder, standard="step-060", seed=5)


def test_results_are_written_for_the_analysis_of_constant_stimuli(folder):
    assert answer_all(folder, 0.3, seed=1) == 24
    table = estimate_participants(folder)
    assert table["participant"].tolist() == [1, 2]
    assert (table["weber_low_95_ratio"] < table["weber_high_95_ratio"]).all()
    design, answers = (
        read_design(Path(folder, "design.csv")),
        read_answers(Path(folder, "answers.csv"), "constant"),
    )
    assert len(design) == len(answers) == 24
    for row, given in zip(design, answers, strict=True):
        first = row["standard_code"] if row["condition"] == "standard-first" else row["code"]
        assert (given["participant"], given["trial"], given["first_code"]) == (
            row["participant"],
            row["trial"],
            first,
        )
        assert row["standard"] == "step-050" != row["stimulus"]
    assert len(analyse_study(folder, [f"{folder}/answers.csv"]).comparisons[0].curves) == 2


def test_answers_that_tell_no_threshold_leave_their_figures_open(tmp_path):
    start_adaptive(
        TEN, tmp_path, standard="step-050", seed=5, participants=1, method="staircase", trials=4
    )
    record_answer(tmp_path, 1, 1, True)
    (row,) = estimate_participants(tmp_path).to_dict("records")
    assert math.isnan(row["equal_um"])
    assert row["state"].startswith("goes on; a threshold needs two reversals")
    assert (
        '1,1,,,,,,,"goes on; a threshold needs'
        in Path(tmp_path, "adaptive-results.csv").read_text()
    )


def test_without_an_answer_there_is_no_result(folder):
    with pytest.raises(PipelineError, match="at least one participant must have answered"):
        estimate_participants(folder)


def test_a_record_that_was_changed_does_not_pass(folder):
    record_answer(folder, 1, 1, True)
    record_answer(folder, 1, 2, False)
    record = Path(folder, "answers", "participant-1.csv")
    lines = record.read_text().splitlines(keepends=True)
    record.write_text("".join([lines[0], lines[2]]))
    with pytest.raises(StudyError, match=r"asks for participant, trial and codes 1 1 .* line 2"):
        next_pair(folder, 1)
    record.write_text("".join([lines[0], *[lines[1].replace(",y", ",perhaps")]]))
    with pytest.raises(
        StudyError, match=r"second_is_higher must be y or n, got 'perhaps' .* line 2"
    ):
        next_pair(folder, 1)


def test_a_setup_of_another_time_or_shape_is_refused_with_its_place(folder):
    path = Path(folder, "setup.json")
    setup = json.loads(path.read_text())
    for broken, message in (
        (setup | {"schema": 2}, r"schema must be 1, got 2 .*setup\.json"),
        ({**setup, "blocks": []}, r"setup must be as 'adaptive start' wrote it: .*setup\.json"),
        ({"schema": 1}, r"setup must be as 'adaptive start' wrote it: KeyError"),
    ):
        path.write_text(json.dumps(broken))
        with pytest.raises(PipelineError, match=message):
            open_adaptive(folder)
    path.unlink()
    with pytest.raises(PipelineError, match="must be set up first"):
        open_adaptive(folder)


def test_a_standard_that_is_no_block_of_the_file_is_refused(tmp_path):
    other = str(Path(TEN).with_name("paper-four.toml"))
    with pytest.raises(PipelineError, match="standard must be one of apparatus-025, apparatus-050"):
        start_adaptive(other, tmp_path / "x", standard="step-050", seed=1)
