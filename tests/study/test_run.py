"""The functions of the study as a notebook calls them: paths as text, defaults of the paper, tables
back.
"""

import math
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from stepblocks.declaration.read import load_set
from stepblocks.errors import ContactError, PipelineError, StudyError
from stepblocks.predict.predictions import predict_single_drag
from stepblocks.study.design.blocks import choose_blocks
from stepblocks.study.design.simulate import Observer
from stepblocks.study.power import study_power
from stepblocks.study.run import analyse_study, design_study, simulate_study, write_sheets

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
FOUR = str(STIMULI / "paper-four.toml")


@pytest.fixture
def folder(tmp_path):
    design_study(FOUR, str(tmp_path), seed=1, participants=3, repetitions=1)
    return str(tmp_path)


def test_without_options_a_study_is_experiment_one_of_the_paper(tmp_path):
    design = design_study(FOUR, tmp_path, seed=1)
    # ten participants, three probes, four blocks, three repetitions
    assert (design.experiment, len(design.trials)) == ("estimates", 10 * 3 * 4 * 3)
    assert {trial["condition"] for trial in design.trials} == {"bare", "hard", "soft"}
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "design.csv",
        "key.csv",
        "plan.json",
        "preregistration.md",
    ]


def test_a_pattern_chooses_the_blocks(tmp_path):
    design = design_study(FOUR, tmp_path, seed=1, only="apparatus-0*")
    assert {trial["stimulus"] for trial in design.trials} == {
        "apparatus-025",
        "apparatus-050",
        "apparatus-075",
    }
    with pytest.raises(PipelineError, match="has none that match 'x'"):
        design_study(FOUR, tmp_path, seed=1, only="x")


def test_an_unknown_experiment_is_refused_with_those_that_there_are(tmp_path):
    with pytest.raises(
        PipelineError,
        match="one of estimates, virtual, constant, magnitude, adaptive, got 'paired'",
    ):
        design_study(FOUR, tmp_path, seed=1, experiment="paired")


def test_energies_are_those_of_equation_one_unless_the_drag_in_time_says_otherwise():
    stimuli = load_set(Path(FOUR))
    place = {"ball_radius": 150e-6, "normal_load": 1.0, "friction": 0.1}
    load, point = 1.0, choose_blocks(FOUR, place).point
    (found,) = choose_blocks(FOUR, place, "*-025").predict_energies().values()
    # a = arccos(1 - H/(R + r)), F = N tan(a + atan mu), E = C F^2 / 2k with the k and C_v of the
    # paper
    force = load * math.tan(math.acos(1.0 - 25e-6 / 150e-6) + math.atan(0.1))
    assert found == pytest.approx(0.20 * 0.5 * force**2 / 9.81e3, rel=1e-9)
    # with the higher blocks, of whose energy the drag keeps more than twice as much, the drag
    # speaks for all
    asked = [predict_single_drag(block.counterface(), point) for block in stimuli.step_block]
    assert [one.drag_differs for one in asked] == [False, True, True, True]
    assert list(choose_blocks(FOUR, place).predict_energies().values()) == [
        one.in_time.energy for one in asked
    ]


def test_what_is_left_out_is_the_first_of_the_file_under_which_every_block_rings():
    stimuli = load_set(Path(FOUR))
    point, grid = choose_blocks(FOUR, {"friction": 0.05}).point, stimuli.prediction
    assert (point.ball_radius, point.friction) == (grid.tip_radii[0], 0.05)
    # under 0.25 N the drag walks over the step of 25 um: not the first load, the second
    assert point.normal_load == grid.normal_loads[1]
    assert (
        predict_single_drag(
            stimuli.step_block[0].counterface(), replace(point, normal_load=0.25)
        ).felt_energy
        == 0.0
    )
    assert point.tool.stiffness == grid.tool.stiffness
    with pytest.raises(ContactError, match="ball_radius must be positive"):
        choose_blocks(FOUR, {"ball_radius": 0.0})


def test_a_block_that_holds_the_probe_cannot_be_felt():
    with pytest.raises(PipelineError, match=r"apparatus-100 is locked at friction 0\.3"):
        choose_blocks(FOUR, {"ball_radius": 125e-6, "friction": 0.3}, "*-100").predict_energies()


def test_a_study_is_analysed_in_memory_or_into_a_folder(folder, tmp_path):
    assert write_sheets(folder) == 3
    assert (
        simulate_study(folder, FOUR, f"{folder}/answers.csv", seed=2, damping={"soft": 0.4}) == 36
    )
    before = sorted(tmp_path.rglob("*"))
    result = analyse_study(folder, [f"{folder}/answers.csv"])
    assert sorted(tmp_path.rglob("*")) == before
    assert result.notes[0] == "36 judgements of 3 participants."
    again = analyse_study(folder, [f"{folder}/answers.csv"], tmp_path / "report")
    assert (
        (tmp_path / "report" / "results.csv").read_text()
        == result.results_csv()
        == again.results_csv()
    )
    assert (tmp_path / "report" / "judgements.csv").read_text() == result.judgements_csv()


def test_a_damper_must_be_a_condition_of_the_design(folder):
    with pytest.raises(
        PipelineError, match=r"conditions of the design \(bare, hard, soft\), got 'wood'"
    ):
        simulate_study(folder, FOUR, f"{folder}/answers.csv", seed=2, damping={"wood": 0.5})


@pytest.mark.parametrize("share", [0.0, -0.5, math.nan])
def test_a_damper_leaves_a_share_of_the_energy(folder, share):
    output = Path(folder) / "wrong.csv"
    with pytest.raises(PipelineError, match=r"damping must be positive .* for soft"):
        simulate_study(folder, FOUR, output, seed=2, damping={"soft": share})
    assert not output.exists()


def test_a_damped_probe_damps_both_blocks_of_a_pair(tmp_path):
    # Weber's law: a share of both energies leaves their ratio, and so every answer, as it was
    options = {"probes": ("bare", "soft"), "standard": "step-030", "participants": 2}
    heights = [20e-6, 25e-6, 30e-6, 35e-6, 40e-6]
    design_study(heights, tmp_path, seed=1, experiment="constant", **options)
    for name, share in (("whole", 1.0), ("half", 0.5)):
        simulate_study(tmp_path, None, tmp_path / f"{name}.csv", seed=2, damping={"soft": share})
    assert (tmp_path / "whole.csv").read_bytes() == (tmp_path / "half.csv").read_bytes()


def test_a_harder_press_is_not_taken_for_a_higher_block(folder):
    # who connects each block with what it rings with under this load reads its height off, whatever
    # the load
    quiet = Observer(weber=0.0, response_noise=0.0, participant_spread=0.0)
    for name, load in (("one", 0.5), ("two", 1.0)):
        simulate_study(
            folder, FOUR, f"{folder}/{name}.csv", seed=2, observer=quiet, normal_load=load
        )
    assert Path(folder, "one.csv").read_bytes() == Path(folder, "two.csv").read_bytes()


def test_power_is_one_row_per_size_and_the_same_in_its_file(tmp_path):
    options = {"seed": 1, "damping": {"bare": 1.0, "soft": 0.5}, "analysis": "f-test", "runs": 10}
    table = study_power(
        FOUR, tmp_path / "new" / "power.csv", participants=(2, 3), repetitions=(1, 2), **options
    )
    assert table[["participants", "repetitions"]].to_numpy().tolist() == [
        [2, 1],
        [2, 2],
        [3, 1],
        [3, 2],
    ]
    assert (table["judgements_each"] == table["repetitions"] * 4 * 2).all()
    assert (table["low_95_ratio"] <= table["power_ratio"]).all()
    written = pd.read_csv(tmp_path / "new" / "power.csv")
    assert written["power_ratio"].tolist() == pytest.approx(table["power_ratio"].tolist(), abs=5e-4)
    (alone,) = study_power(FOUR, participants=(3,), repetitions=(2,), **options).to_dict("records")
    assert alone == table.to_dict("records")[3]


def test_the_power_of_ratings_is_asked_of_virtual_blocks_alone():
    options = {"seed": 1, "measure": "realism", "participants": (4,), "runs": 10}
    (row,) = study_power(FOUR, experiment="virtual", **options).to_dict("records")
    assert (row["measure"], row["analysis"], row["judgements_each"]) == ("realism", "ordinal", 24)
    for wrong in ({}, {"experiment": "virtual", "probes": ("bare",)}):
        with pytest.raises(StudyError, match="realism must be rated in the experiment virtual"):
            study_power(FOUR, **options | wrong)


@pytest.mark.parametrize("experiment", ["magnitude", "adaptive", "estimate"])
def test_power_of_an_experiment_that_is_not_known_is_refused(experiment):
    with pytest.raises(StudyError, match=f"power is known of .*, got '{experiment}'"):
        study_power(FOUR, seed=1, experiment=experiment, damping={"soft": 0.5}, runs=10)


@pytest.mark.parametrize("name", ["x/../../../evil", "..\\\\evil", "/tmp/evil", "a b", "p" * 41])
def test_a_participant_is_one_word_and_leads_no_sheet_out_of_its_folder(folder, name):
    design = Path(folder) / "design.csv"
    table = pd.read_csv(design, dtype=str, keep_default_na=False)
    table["participant"] = table["participant"].replace("1", name)
    table.to_csv(design, index=False)
    before = sorted(Path(folder).rglob("*"))
    with pytest.raises(StudyError, match="participant must be one word of at most 40 characters"):
        write_sheets(folder)
    assert sorted(Path(folder).rglob("*")) == before
