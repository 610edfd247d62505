"""Tables and datasets of others: read under their names, with semicolons and decimal commas, and
read back the same.
"""

import json
import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from stepblocks.cli import main
from stepblocks.errors import ReadingWarning, StudyError
from stepblocks.study.analysis.exchange import share_study
from stepblocks.study.analysis.page import render_study_report
from stepblocks.study.analysis.prose import format_apa_p, format_headline
from stepblocks.study.conduct.run import open_run
from stepblocks.study.power import study_power
from stepblocks.study.run import analyse_study, design_study, simulate_study

HEIGHTS = (20e-6, 40e-6, 60e-6, 80e-6)
COLUMNS = {
    "participant": "subject",
    "condition": "probe",
    "height_mm": "h",
    "estimate_um": "answer",
}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A study of heights alone, without CAD, with three times the noise in one condition."""
    folder = tmp_path_factory.mktemp("study")
    design_study(HEIGHTS, folder, seed=1, participants=6)
    simulate_study(folder, None, folder / "sheets" / "answers.csv", seed=2, noise={"soft": 3.0})
    return folder


@pytest.fixture(scope="module")
def result(study):
    return analyse_study(study, [study / "sheets"])


@pytest.mark.long
def test_a_table_of_somebody_else_is_read_with_its_names_and_decimal_commas(
    study, result, tmp_path
):
    judged = pd.read_csv(__import__("io").StringIO(result.judgements_csv()))
    lines = ["subject;probe;h;answer;remark"]
    for row in judged.itertuples():
        lines.append(
            f"{row.participant};{row.condition};{row.height_um / 1000:.3f};"
            f"{row.estimate_um};x".replace(".", ",")
        )
    (tmp_path / "my.csv").write_text("\n".join(lines) + "\n", encoding="utf-8-sig")
    with pytest.warns(ReadingWarning, match="semicolons|decimal commas"):
        theirs = analyse_study(None, [tmp_path / "my.csv"], columns=COLUMNS)
    assert theirs.results_csv() == result.results_csv()
    code = main(
        [
            "study",
            "analyse",
            "--data",
            str(tmp_path / "my.csv"),
            "--columns",
            ",".join(f"{ours}={yours}" for ours, yours in COLUMNS.items()),
            "-o",
            str(tmp_path / "out"),
        ]
    )
    assert (code, (tmp_path / "out" / "results.csv").read_text()) == (0, result.results_csv())


def test_a_run_sheet_may_call_every_column_and_unit_otherwise(study, result, tmp_path):
    sheet = pd.read_csv(study / "sheets" / "answers.csv", dtype=str)
    sheet["estimate_um"] = [f"{float(text) / 1000:.6g}" for text in sheet["estimate_um"]]
    theirs = {
        "participant": "Participant ID",
        "trial": "Trial no.",
        "condition": "Probe",
        "code": "Block",
        "estimate_um": "Answer (mm)",
    }
    sheet.rename(columns=theirs).to_csv(tmp_path / "sheet.csv", index=False)
    named = theirs | {"estimate_mm": theirs["estimate_um"]}
    del named["estimate_um"]
    judged = analyse_study(study, [tmp_path / "sheet.csv"], columns=named)
    assert judged.results_csv() == result.results_csv()


def test_what_a_table_lacks_is_named_with_its_place(tmp_path):
    path = tmp_path / "my.csv"
    path.write_text("subject,probe,h,answer\n1,bare,0.02,20\n")
    for columns, message in (
        (COLUMNS | {"condition": "sonde"}, r"got no condition \[.*my.csv, line 2\]"),
        (COLUMNS | {"weight": "x"}, "columns must be named for participant, .* got 'weight'"),
        (
            COLUMNS | {"height_um": "answer", "height_mm": "answer", "estimate_um": "probe"},
            "estimate_um must be a number",
        ),
    ):
        with pytest.raises(StudyError, match=message):
            analyse_study(None, [path], columns=columns)


@pytest.mark.parametrize("form", ["bids"])
def test_a_dataset_is_read_back_to_the_same_figures(study, result, tmp_path, form):
    share_study(study, [study / "sheets"], tmp_path / form, form)
    again = analyse_study(None, [tmp_path / form])
    assert again.results_csv() == result.results_csv()
    assert again.judgements_csv() == result.judgements_csv()


def test_bids_says_what_every_column_is_and_its_validator_has_no_error(study, tmp_path):
    share_study(study, [study / "sheets"], tmp_path / "bids")
    said = json.loads((tmp_path / "bids" / "task-estimates_beh.json").read_text())
    (first, *_) = sorted(tmp_path.glob("bids/sub-*/beh/*.tsv"))
    assert set(first.read_text().splitlines()[0].split("\t")) <= set(said)
    assert said["estimate_um"]["Units"] == "um"
    validator = shutil.which("bids-validator")
    if validator is None:
        pytest.skip("bids-validator (an npm package) is not installed")
    found = subprocess.run(
        [validator, "--json", str(tmp_path / "bids")], capture_output=True, text=True, check=False
    )
    assert json.loads(found.stdout)["issues"]["errors"] == []


def test_the_report_opens_with_what_was_found_and_ends_as_a_journal_wants_it(result):
    said = format_headline(result)
    assert said.startswith("Primary outcome, absolute error: ")
    assert re.search(r"with soft it is larger by .* than with (bare|hard)", said)
    assert "µm" in said
    assert " um" not in said
    page = " ".join(render_study_report(result).split())  # as it is read
    assert (
        "6 participants gave 216 judgements of 4 blocks in 3 conditions (bare, hard, soft)" in page
    )
    assert [format_apa_p(p) for p in (0.0004, 0.0312, 0.5)] == ["< .001", "= .031", "= .500"]


def test_a_result_is_printed_with_its_first_finding(result):
    first = result.findings()[0]
    assert repr(result).endswith(f" judgements, {first.name}: p = {first.p:.3g}>")


def test_a_primary_outcome_that_the_experiment_has_not_is_preregistered_nowhere(tmp_path):
    with pytest.raises(
        StudyError, match="primary must be one of bias; absolute error; spread, got 'biaas'"
    ):
        design_study(HEIGHTS, tmp_path / "s", seed=1, participants=6, primary="biaas")
    assert not (tmp_path / "s").exists()


def test_only_the_primary_outcome_opens_the_headline(tmp_path):
    # noise scatters the estimates: the spread and the absolute error find it, the bias does not
    design_study(HEIGHTS, tmp_path, seed=1, participants=6, probes=("a", "b"), primary="bias")
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2, noise={"b": 4.0})
    result = analyse_study(tmp_path, [tmp_path / "answers.csv"])
    said = format_headline(result)
    assert said.startswith("Primary outcome, bias: no difference between conditions was found")
    assert "secondary" not in said.lower()
    first, *rest = result.findings()
    assert (first.name, first.primary, first.p == first.corrected) == ("bias", True, True)
    assert {one.name for one in rest if one.corrected < 0.05} == {"absolute error", "spread"}
    with pytest.raises(StudyError, match="primary must be one of absolute error; bias; spread"):
        analyse_study(tmp_path, [tmp_path / "answers.csv"], primary="speed")
    with pytest.raises(StudyError, match="reference must be one of a, b, got 'c'"):
        analyse_study(tmp_path, [tmp_path / "answers.csv"], reference="c")


@pytest.mark.long
def test_groups_of_participants_are_compared(study, tmp_path):
    people = tmp_path / "people.csv"
    people.write_text(
        "participant,group\n"
        + "".join(f"{n},{'dentist' if n < 4 else 'student'}\n" for n in range(1, 7))
    )
    table = analyse_study(study, [study / "sheets"], groups=people, equivalent=2e-6).table()
    assert {"group, partial eta squared", "condition:group, partial eta squared"} <= set(
        table["quantity"]
    )
    assert "bare and hard differ by less than the margin" in set(table["quantity"])
    people.write_text("participant,group\n1,dentist\n")
    with pytest.raises(
        StudyError, match="every participant must have a group, got none for 2, 3, 4, 5, 6"
    ):
        analyse_study(study, [study / "sheets"], groups=people)


@pytest.mark.long
def test_groups_are_compared_where_all_participants_meet_one_condition(tmp_path):
    # expected: Student's t of SciPy over the participants' mean errors
    design_study(HEIGHTS, tmp_path, seed=1, participants=8, probes=("bare",))
    simulate_study(tmp_path, None, tmp_path / "answers.csv", seed=2)
    people = {f"{n}": "dentist" if n < 4 else "student" for n in range(1, 9)}
    (tmp_path / "people.csv").write_text(
        "participant,group\n" + "".join(f"{who},{group}\n" for who, group in people.items())
    )
    command = ["study", "analyse", str(tmp_path), str(tmp_path / "answers.csv")]
    assert main(command) == 2  # nothing differs without groups
    assert main([*command, "--groups", str(tmp_path / "people.csv")]) == 0
    table = pd.read_csv(tmp_path / "report" / "results.csv")
    (row,) = table[
        (table["measure"] == "bias")
        & (table["quantity"] == "dentist minus student")
        & (table["analysis"] == "mixed model")
    ].to_dict("records")
    judged = pd.read_csv(tmp_path / "report" / "judgements.csv", dtype={"participant": str})
    means = judged.groupby("participant")["error_um"].mean()
    dentists = means.index.map(people) == "dentist"
    found = stats.ttest_ind(means[dentists], means[~dentists])
    ends = found.confidence_interval()
    assert row["p"] == pytest.approx(found.pvalue, rel=1e-4)
    assert [row["low_95"], row["high_95"]] == pytest.approx([ends.low, ends.high], rel=1e-4)


def test_power_of_pairs_is_that_of_the_binomial():
    """Closed form of 1 participant pair more: at chance a one-sided 5 % test finds 5 %, far apart
    it always finds.
    """
    table = study_power(
        (49.999e-6, 50e-6, 90e-6),
        seed=3,
        experiment="2afc",
        standard="step-050",
        participants=(12,),
        repetitions=(10,),
        runs=2000,
    )
    level, certain = table["power_ratio"]
    assert level == pytest.approx(0.05, abs=0.015)
    assert certain == 1.0


def test_power_takes_its_conditions_from_the_probes_bare_included():
    options = {
        "seed": 1,
        "participants": (4,),
        "repetitions": (2,),
        "runs": 10,
        "analysis": "f-test",
    }
    (row,) = study_power(
        HEIGHTS, probes=("bare", "hard", "soft"), noise={"soft": 4.0}, **options
    ).to_dict("records")
    assert (row["judgements_each"], row["measure"]) == (2 * 4 * 3, "absolute error")
    assert row["power_ratio"] > 0.5


@pytest.mark.long
def test_when_a_trial_was_shown_and_answered_stands_in_every_file(tmp_path):
    design_study(HEIGHTS, tmp_path, seed=1, participants=3, repetitions=2, probes=("a", "b"))
    random = np.random.default_rng(1)
    for who in ("1", "2", "3"):
        run = open_run(tmp_path, who)
        while run.now is not None:
            estimate = float(run.now["height_um"]) + random.uniform(0.0, 9.0)
            run.answer(run.now["trial"], {"estimate_um": f"{estimate:.1f}"}, reaction=1.25)
        run.close()
    written = pd.read_csv(tmp_path / "runs" / "participant-1.csv", dtype=str)
    analyse_study(tmp_path, [tmp_path / "runs"], tmp_path / "report")
    share_study(tmp_path, [tmp_path / "runs"], tmp_path / "set")
    judged = pd.read_csv(tmp_path / "report" / "judgements.csv", dtype=str)
    shared = pd.read_csv(next(tmp_path.glob("set/sub-1/beh/*.tsv")), sep="\t", dtype=str)
    for name in ("shown_utc", "answered_utc"):
        for table in (judged[judged["participant"] == "1"], shared):
            assert [*table[name]] == [*written[name]]
    assert {*judged["reaction_s"].astype(float), *shared["reaction_s"].astype(float)} == {1.25}
    again = analyse_study(None, [tmp_path / "set"])
    assert [*again.frame["reaction_s"]] == [1.25] * 48


def test_an_effect_size_says_what_it_is_over(result):
    rows = result.table().query("measure == 'bias' and quantity.str.contains('hard, over')")
    said = dict(zip(rows["analysis"], rows["quantity"].str.partition(", ")[2], strict=True))
    assert said["participants' differences"] == "over the standard deviation of the differences"
    assert said["mixed model"] == said["tukey"] == "over the residual standard deviation"
