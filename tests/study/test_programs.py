"""Trials in other programs: what they read is written, what they write is read without renaming."""

import csv
import itertools
import json
import shutil
import subprocess
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from statsmodels.stats.anova import AnovaRM

from oracles.study_layouts import (
    write_csv,
    write_gorilla,
    write_jspsych,
    write_opensesame,
    write_psychopy,
    write_qualtrics,
)
from stepblocks.errors import StudyError
from stepblocks.study.analysis.foreign import read_foreign_judgements
from stepblocks.study.columns import RATINGS
from stepblocks.study.run import (
    _read_judgements,
    analyse_study,
    design_study,
    simulate_study,
    write_sheets,
)

# what is found out about a file is said in warnings
pytestmark = pytest.mark.filterwarnings("ignore::stepblocks.errors.ReadingWarning")

ESTIMATE = ("estimate_um",)
HIGHER = ("second_is_higher",)
PLANS = {
    "estimates": {},
    "virtual": {},
    "constant": {"standard": "step-050"},
    "magnitude": {},
}
ANSWERS = ("estimate_um", "realism_rating", "second_is_higher", "magnitude_ratio")
LAYOUTS = ("psychopy", "jspsych", "qualtrics", "gorilla", "own")


def simulate_estimates(seed, people=8, missed=3):
    """Estimates of participants with three probes, of whom some miss single answers."""
    generator = np.random.default_rng(seed)
    rows = []
    for person in range(people):
        level = generator.normal(0.0, 3.0)
        shift = {probe: generator.normal(0.0, 1.5) for probe in ("bare", "hard", "soft")}
        cells = [*itertools.product(shift, (25, 50, 75, 100), range(2))]
        for probe, height, _ in (cells[index] for index in generator.permutation(len(cells))):
            spread = {"bare": 4.0, "hard": 5.0, "soft": 7.0}[probe]
            estimate = height + level + shift[probe] + generator.normal(0.0, spread)
            rows.append(
                {
                    "participant": f"{person + 1}",
                    "condition": probe,
                    "height_um": f"{height}",
                    "estimate_um": f"{max(estimate, 0.5):.2f}",
                }
            )
    for number in generator.choice(len(rows), missed, replace=False):
        rows[number]["estimate_um"] = ""
    return rows


def write_layout(layout, folder, rows):
    """Write judgements in a layout; return what `analyse_study` is told of it beside the path."""
    if layout == "psychopy":
        write_psychopy(folder, rows, ESTIMATE)
    elif layout == "jspsych":
        write_jspsych(folder, rows, ESTIMATE)
    elif layout == "opensesame":
        write_opensesame(folder, rows, ESTIMATE)
    elif layout == "gorilla":
        write_gorilla(folder / "data_exp.csv", rows, ESTIMATE)
    elif layout == "qualtrics":
        write_qualtrics(folder / "survey.csv", rows, "estimate_um")
        return {"wide": "{condition}_{height_um}_{repetition}"}
    else:
        renamed = {"participant": "vp", "condition": "probe", "estimate_um": "answer"}
        table = [{renamed.get(name, name): row[name] for name in row} for row in rows]
        (folder / "own.csv").write_text(write_csv(table, list(table[0])))
        return {"columns": renamed}
    return {}


def read_layout(layout, folder, rows):
    """Write judgements in a layout and read them back, sorted by what they are."""
    folder.mkdir()
    told = SimpleNamespace(columns={}, wide="")
    told.__dict__.update(write_layout(layout, folder, rows))
    judgements = read_foreign_judgements([folder], told.columns, "estimates", RATINGS, told.wide)
    assert not any("Left out of every model" in note for note in judgements.remarks)
    frame = judgements.frame.assign(participant=judgements.frame["participant"].str.lstrip("R_"))
    columns = ["participant", "condition", "height", "estimate"]
    return frame.sort_values(columns)[columns].to_numpy().tolist()


def test_every_layout_gives_the_judgements_that_were_written(tmp_path):
    rows = simulate_estimates(1)
    expected = read_layout("own", tmp_path / "own", rows)
    assert len(expected) == len(rows) - 3
    for layout in ("psychopy", "jspsych", "opensesame", "qualtrics", "gorilla"):
        assert read_layout(layout, tmp_path / layout, rows) == expected, layout


def test_records_of_psychopy_give_the_analysis_of_variance_of_statsmodels(tmp_path):
    check_against_statsmodels(tmp_path, "psychopy", 1)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(100, 120))
def test_studies_in_five_layouts_give_the_analysis_of_variance_of_statsmodels(tmp_path, seed):
    rows = simulate_estimates(seed)
    expected = read_layout("own", tmp_path / "own", rows)
    for layout in LAYOUTS[:-1]:
        assert read_layout(layout, tmp_path / layout, rows) == expected, layout
    analysed = tmp_path / "analysed"
    analysed.mkdir()
    check_against_statsmodels(analysed, LAYOUTS[seed % len(LAYOUTS)], seed)


def check_against_statsmodels(folder, layout, seed):
    """Compare the test of the absolute error with `AnovaRM` on participants' means."""
    rows = simulate_estimates(seed, missed=0)
    result = analyse_study(None, [folder], **write_layout(layout, folder, rows))
    table = pd.DataFrame(rows).astype({"estimate_um": float, "height_um": float})
    assert len(result.frame) == len(table)
    table["value"] = (table["estimate_um"] - table["height_um"]).abs()
    means = table.groupby(["participant", "condition"])["value"].mean().reset_index()
    oracle = AnovaRM(means, "value", "participant", within=["condition"]).fit().anova_table
    measure = result.measure()
    assert measure.name == "absolute error"
    assert measure.corrected.f == pytest.approx(oracle.loc["condition", "F Value"], rel=1e-6)
    wide = means.pivot_table("value", "participant", "condition")
    for pair in measure.paired:
        difference = (wide[pair.first] - wide[pair.second]).mean() * 1e-6
        assert pair.difference == pytest.approx(difference, rel=1e-9)


def plan(folder, experiment, people=2):
    """Design a study, and simulate the answers to its trials."""
    design_study(
        [20e-6, 50e-6, 80e-6],
        folder,
        seed=1,
        participants=people,
        repetitions=2,
        experiment=experiment,
        **PLANS[experiment],
    )
    simulate_study(folder, None, folder / "answers.csv", seed=2)
    with (folder / "answers.csv").open(newline="") as file:
        answers = {(row["participant"], row["trial"]): row for row in csv.DictReader(file)}
    return answers


def run_conditions(folder, program, answers, names):
    """Return the trials as a program reads them, answered; rows as `study_layouts` takes them."""
    rows = []
    for path in sorted((folder / program).glob("participant-*.csv")):
        with path.open(newline="") as file:
            for trial in csv.DictReader(file):
                given = answers[trial["sb_participant"], trial["sb_trial"]]
                row = {"participant": trial["sb_participant"], **trial}
                rows.append(row | {name: given[name] for name in names})
    return rows


def read_frame(folder, path):
    frame = _read_judgements(folder, [path], RATINGS, {}).frame
    return frame.drop(columns=["reaction_s"], errors="ignore").to_dict("records")


@pytest.mark.parametrize("experiment", PLANS)
@pytest.mark.parametrize("program", ["psychopy", "opensesame", "jspsych"])
def test_trials_run_in_another_program_are_read_as_run_sheets_are(tmp_path, program, experiment):
    answers = plan(tmp_path, experiment)
    names = [name for name in next(iter(answers.values())) if name in ANSWERS]
    assert write_sheets(tmp_path, program=program) == 2
    assert "study analyse" in (tmp_path / program / "README.md").read_text()
    source = "psychopy" if program == "jspsych" else program
    write_sheets(tmp_path, program=source)
    rows = run_conditions(tmp_path, source, answers, names)
    records = tmp_path / "records"
    records.mkdir()
    if program == "psychopy":
        write_psychopy(records, rows, names, component="")
    elif program == "jspsych":
        write_jspsych(records, rows, names, kind="survey-text", form="json")
    else:
        renamed = [{**row, **{f"response_{name}": row[name] for name in names}} for row in rows]
        write_opensesame(records, renamed, names)
    assert read_frame(tmp_path, records) == read_frame(tmp_path, tmp_path / "answers.csv")


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
@pytest.mark.parametrize("experiment", ["virtual", "constant"])
def test_the_timeline_for_jspsych_asks_every_trial_by_its_codes(tmp_path, experiment):
    answers = plan(tmp_path, experiment)
    write_sheets(tmp_path, program="jspsych")
    script = """
        const types = ["HtmlButtonResponse", "HtmlKeyboardResponse", "SurveyText"];
        for (const name of types) { globalThis["jsPsych" + name] = name; }
        const { makeStepblocksTimeline, stepblocksTrials } = require(process.argv[1]);
        let variables = {};
        const jsPsych = {
          timelineVariable: (name) => ({ name }),
          evaluateTimelineVariable: (name) => variables[name],
        };
        const made = makeStepblocksTimeline(jsPsych, "2");
        const shown = made.timeline_variables.map((trial) => {
          variables = trial;
          return made.timeline[0].stimulus();
        });
        console.log(JSON.stringify({ shown, trials: made.timeline_variables,
          answer: made.timeline[1] }));
    """
    path = tmp_path / "jspsych" / "trials.js"
    run = subprocess.run(
        ["node", "-e", script, str(path)], capture_output=True, text=True, check=True
    )
    made = json.loads(run.stdout)
    assert [trial["sb_trial"] for trial in made["trials"]] == [
        trial for person, trial in answers if person == "2"
    ]
    for shown, trial in zip(made["shown"], made["trials"], strict=True):
        codes = [text for name, text in trial.items() if name.endswith("code")]
        assert codes
        assert all(code in shown for code in codes)
    assert "50" not in "".join(made["shown"])  # no height
    assert set(made["trials"][0]) <= set(made["answer"]["data"])


def test_answers_to_one_trial_in_two_rows_are_joined(tmp_path):
    """jsPsych shows a slider for the height, then another for the realism."""
    answers = plan(tmp_path, "virtual")
    write_sheets(tmp_path, program="psychopy")
    names = ("estimate_um", "realism_rating")
    records = []
    for row in run_conditions(tmp_path, "psychopy", answers, names):
        varied = {name: text for name, text in row.items() if name not in names}
        for number, name in enumerate(names):
            shared = {"trial_type": "html-slider-response", "trial_index": number, "rt": 900}
            shared |= {"time_elapsed": 1000, "sb_answer": name, "response": float(row[name])}
            records.append({**shared, **varied})
    path = tmp_path / "all.json"
    path.write_text(json.dumps(records))
    assert read_frame(tmp_path, path) == read_frame(tmp_path, tmp_path / "answers.csv")


def test_missed_keys_and_keys_of_instructions_are_no_answers(tmp_path):
    answers = plan(tmp_path, "constant")
    write_sheets(tmp_path, program="psychopy")
    rows = run_conditions(tmp_path, "psychopy", answers, HIGHER)
    rows = [{**row, "ready.keys": "space"} for row in rows]
    rows[3]["second_is_higher"] = ""
    write_psychopy(tmp_path / "psychopy", rows, HIGHER, component="key_resp.keys")
    records = tmp_path / "records"
    records.mkdir()
    for path in (tmp_path / "psychopy").glob("*_steps.csv"):
        path.rename(records / path.name)
    judgements = _read_judgements(tmp_path, [records], RATINGS, {})
    assert [(key.participant, key.trial) for key in judgements.missing] == [("1", "4")]
    assert set(judgements.frame["reaction_s"]) == {1.25}


def test_which_of_two_sliders_holds_the_answer_is_asked(tmp_path):
    rows = [{**row, "sure.response": "3"} for row in simulate_estimates(1, people=3)]
    write_psychopy(tmp_path, rows, ESTIMATE)
    with pytest.raises(StudyError, match=r"which of .* holds estimate_um must be said"):
        read_foreign_judgements([tmp_path], {}, "estimates")
    columns = {"estimate_um": "slider.response"}
    assert len(read_foreign_judgements([tmp_path], columns, "estimates").frame) == 69


def test_positions_of_buttons_are_no_answers(tmp_path):
    rows = [{"participant": "1", "height_um": "40", "second_is_higher": "1"}] * 6
    write_jspsych(tmp_path, rows, HIGHER, kind="html-button-response")
    with pytest.raises(StudyError, match="positions of buttons in 'response of html-button-resp"):
        read_foreign_judgements([tmp_path], {}, "constant")


@pytest.mark.parametrize(
    ("pattern", "wrong"),
    [
        ("{condition}_{height_um}", "must fit the names"),
        ("bare", "must name columns in braces"),
        ("{a}{a}", "must name columns in braces"),
    ],
)
def test_a_pattern_that_fits_no_column_is_refused(tmp_path, pattern, wrong):
    write_qualtrics(tmp_path / "a.csv", simulate_estimates(1, people=3), "estimate_um")
    with pytest.raises(StudyError, match=f"wide {wrong}"):
        read_foreign_judgements([tmp_path], {}, "estimates", RATINGS, pattern)


@pytest.mark.parametrize("text", ["{}", "[1]", "[", '[{"a": ' + "[" * 100_000])
def test_json_that_is_no_list_of_records_is_refused(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(StudyError, match="records must be"):
        read_foreign_judgements([tmp_path / "a.json"], {}, "estimates")


def test_a_program_that_is_not_known_is_refused(tmp_path):
    plan(tmp_path, "estimates")
    with pytest.raises(StudyError, match="program must be one of psychopy, jspsych, opensesame"):
        write_sheets(tmp_path, program="e-prime")
