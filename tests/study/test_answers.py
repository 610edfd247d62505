"""What is wrong with a table of answers is said in one line; what is missing is stated, never
filled in silently.
"""

import csv
import io
from dataclasses import replace

import pandas as pd
import pytest

from oracles.designs import compared, crossed, lined
from stepblocks.errors import StudyError
from stepblocks.files.tables import format_csv
from stepblocks.study.analysis.judgements import join_answers
from stepblocks.study.analysis.people import describe_unusual_participants
from stepblocks.study.analysis.result_table import COLUMNS
from stepblocks.study.design.blocks import Item
from stepblocks.study.design.read import SheetRow, read_answers, read_design
from stepblocks.study.design.sheet import format_code_key_csv, make_blinded_row
from stepblocks.study.design.simulate import Observer
from stepblocks.study.design.simulated_answers import simulate_answers

BLOCKS = [Item(f"step-{h:03}", f"STEP-{h:03}", h * 1e-6) for h in (25, 50, 75)]
ENERGIES = {"step-025": 10e-6, "step-050": 35e-6, "step-075": 141e-6}


@pytest.fixture
def study():
    design = crossed("estimates", 4, BLOCKS, 2, 1, ("bare", "soft")).trials
    return design, lined(simulate_answers(design, ENERGIES, {"soft": 0.5}, Observer(), seed=2))


def refused(design, answers, message):
    with pytest.raises(StudyError, match=message):
        join_answers(design, answers)


def test_a_complete_table_is_joined_in_si(study):
    table = join_answers(*study)
    assert table.missing == table.left == ()
    assert len(table.frame) == 4 * 2 * 3 * 2
    row = table.frame.iloc[0]
    assert row["error"] == pytest.approx(row["estimate"] - row["height"], abs=1e-12)
    assert 1e-6 < row["estimate"] < 5e-4


def test_missing_cells_are_counted_and_named(study):
    design, answers = study
    answers[3].cells["estimate_um"] = ""
    table = join_answers(design, answers[:10] + answers[11:])
    assert list(table.missing) == [
        answers[3].key,
        answers[10].key,
    ]
    assert "2 missing judgements" in " ".join(table.list_notes())
    result = table.analyse()
    assert result.measure("bias").f_test.terms[0].df_error == 46 - 6
    assert "2 missing judgements" in " ".join(result.notes)


def test_a_participant_who_left_is_left_out_and_named(study):
    design, answers = study
    half = [row for row in answers if row.key.participant != "3" or int(row.key.trial) <= 6]
    table = join_answers(design, half)
    assert table.left == ("3",)
    assert "3" not in set(table.frame["participant"])
    assert "participant 3" in " ".join(table.list_notes())
    gone = join_answers(design, [row for row in answers if row.key.participant != "2"])
    assert gone.left == ("2",)


def test_a_trial_answered_twice_is_refused_with_both_places(study):
    design, answers = study
    refused(
        design,
        [*answers, replace(answers[5], file="other.csv", line=9)],
        r"twice \[other.csv, line 9; first answers.csv, line 7\]",
    )


@pytest.mark.parametrize("value", ["-1", "nan", "inf", "fifty", "1e6", "5_0", "0x10"])
def test_an_impossible_estimate_is_refused_with_its_line(study, value):
    design, answers = study
    answers[7].cells["estimate_um"] = value
    refused(
        design,
        answers,
        rf"estimate_um must be a number from 0 to 10000, got '{value}' \[answers.csv, line 9\]",
    )


def test_a_wrong_code_is_refused_and_the_right_one_named(study):
    design, answers = study
    code = answers[0].cells["code"]
    others = [row.cells["code"] for row in answers if row.cells["code"] != code]
    answers[0].cells["code"] = others[0]
    refused(design, answers, "code must be .* in this trial, as planned")


def test_another_probe_than_planned_is_refused(study):
    design, answers = study
    answers[0].cells["condition"] = "hard"
    refused(design, answers, "condition must be")


def test_a_trial_outside_the_design_is_refused(study):
    design, answers = study
    stranger = replace(answers[0], cells={**answers[0].cells, "participant": "99"})
    refused(design, [*answers, stranger], "must be in the design, got '99'")


def test_a_block_that_nobody_judged_is_refused(study):
    design, answers = study
    gone = {
        (row["participant"], row["trial"])
        for row in design
        if (row["stimulus"], row["condition"]) == ("step-050", "soft")
    }
    kept = [row for row in answers if row.key not in gone]
    refused(design, kept, "no answer for step-050 with soft")
    for row in answers:
        row.cells["estimate_um"] = ""
    refused(design, answers, "at least one participant")


def test_all_trials_that_stand_twice_are_counted(study):
    design, answers = study
    refused(design, [*answers, *answers[:3]], "must occur once, got .* twice, and 2 more")


def test_names_and_estimates_that_are_likely_mistyped_are_said():
    frame = pd.DataFrame({"participant": ["P 1", "p1", "P 2"], "height": [5e-5, 4e-5, 6e-5]})
    frame["estimate"] = frame.height * 1e-3
    remarks = describe_unusual_participants(frame, "estimate")
    assert "Participants 'P 1' and 'p1' count as two: are they one person?" in remarks
    assert any("is the unit of their column right?" in remark for remark in remarks)


@pytest.mark.parametrize("value", ["0", "8", "2.5", "good"])
def test_a_rating_off_its_scale_is_refused(value):
    design = crossed("virtual", 2, BLOCKS, 1, 1).trials
    answers = lined(simulate_answers(design, ENERGIES, {}, Observer(), seed=2))
    answers[0].cells["realism_rating"] = value
    refused(design, answers, "realism_rating must be a whole number from 1 to 7")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text.replace("estimate_um", "estimate"), "got no estimate_um"),
        (lambda text: text + "1,2\n", "must have 5 cells as the header"),
        (lambda text: text + "1,2,3,4,5,6\n", "must have 5 cells as the header"),
        (lambda text: text.replace("code", "number"), "got no code, but .*number"),
        (lambda text: text + '"', "table must be a CSV: unexpected end of data"),
        (lambda text: text.encode() + b"\xff\x81", "text must be UTF-8, UTF-16 or Windows-1252"),
    ],
)
def test_a_damaged_file_is_refused_by_name(study, tmp_path, damage, message):
    design, _ = study
    path = tmp_path / "answers.csv"
    damaged = damage(format_csv(map(make_blinded_row, design)))
    path.write_bytes(damaged if isinstance(damaged, bytes) else damaged.encode())
    with pytest.raises(StudyError, match=message) as caught:
        read_answers(path, "estimates")
    assert "answers.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_come_back_as_they_were_written(tmp_path):
    design = compared(2, BLOCKS, 2, 3, "step-050")
    path = tmp_path / "design.csv"
    path.write_text(format_csv(design.trials))
    rows = read_design(path)
    assert rows == design.trials
    sheet = tmp_path / "sheet.csv"
    sheet.write_text(format_csv(map(make_blinded_row, rows)))
    assert len(read_answers(sheet, "constant")) == len(rows)


def test_run_sheets_are_blind_and_the_key_opens_them():
    design = compared(3, BLOCKS, 2, 3, "step-050")
    rows = design.trials
    sheet, key = (
        format_csv(map(make_blinded_row, rows)),
        list(csv.DictReader(io.StringIO(format_code_key_csv(design.blocks)))),
    )
    for item in BLOCKS:
        assert item.identity not in sheet
        assert item.engraved not in sheet
    assert {(row["engraved"], row["stimulus"]) for row in key} == {
        (item.engraved, item.identity) for item in BLOCKS
    }
    by_code = {(row["participant"], row["code"]): row["stimulus"] for row in key}
    for plan, shown in zip(rows, csv.DictReader(io.StringIO(sheet)), strict=True):
        pair = [by_code[plan["participant"], shown[name]] for name in ("first_code", "second_code")]
        assert pair == (
            [plan["standard"], plan["stimulus"]]
            if plan["condition"] == "standard-first"
            else [plan["stimulus"], plan["standard"]]
        )


def test_every_figure_of_the_results_has_a_unit(study):
    result = join_answers(*study).analyse()
    rows = list(csv.DictReader(io.StringIO(result.results_csv())))
    assert tuple(rows[0]) == COLUMNS
    assert {row["unit"] for row in rows} == {"1", "um"}
    assert (
        result.judgements_csv()
        .splitlines()[0]
        .startswith(
            "participant,trial,condition,repetition,stimulus,height_um,estimate_um,error_um"
        )
    )


def test_all_that_is_wrong_with_a_table_of_answers_is_reported_at_once_by_its_lines(study):
    design, answers = study
    answers[0].cells["condition"] = "hard"
    answers[7].cells["estimate_um"] = answers[9].cells["estimate_um"] = "fifty"
    stranger = SheetRow({**answers[3].cells, "participant": "99"}, "answers.csv", 50)
    with pytest.raises(StudyError) as caught:
        join_answers(design, [*answers, stranger])
    head, *lines = str(caught.value).splitlines()
    assert head == "3 mistakes [answers.csv]"
    assert [line.rsplit("[", 1)[1] for line in lines] == [
        "line 2]",
        "line 50]",
        "line 9 and 1 more]",
    ]
