"""What a loop found is shown as it was written, and every point of it leads to its trace."""

import asyncio
import json
import shlex

import pandas as pd
import pytest

pytest.importorskip("nicegui")

from nicegui import ui
from nicegui.testing.user_simulation import user_simulation

from oracles.learned import make_learned_model
from oracles.loop_folder import MEASURED_OVER_PREDICTED, write_explained_session
from stepblocks.cli import make_root_command
from stepblocks.declaration.read import load_set
from stepblocks.errors import PipelineError
from stepblocks.predict.learned import predict_trials
from stepblocks.window.agreement import (
    AskedExperiment,
    Figure,
    FoundEffect,
    HeldOutErrors,
    LoopFinding,
    ModelPart,
    list_trial_agreements,
    read_loop_finding,
)
from stepblocks.window.felt import predict_felt
from stepblocks.window.folder import Folder
from stepblocks.window.loop_view import make_drawing_command, make_prediction_command
from stepblocks.window.next_view import describe_reasons
from stepblocks.window.window import Window


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A folder with a session, and what a loop would have written of it."""
    folder = tmp_path_factory.mktemp("lab")
    write_explained_session(folder)
    return folder


def test_each_trial_stands_over_both_models_where_it_was_measured(lab):
    session, output = lab / "bench" / "b1", lab / "out" / "b1-loop"
    found = list_trial_agreements(session, output)
    assert [row.trial for row in found] == ["1", "2", "3", "4"]
    assert Figure.ENERGY not in found[1].extended
    for row in found:
        assert row.extended[Figure.FORCE] == pytest.approx(MEASURED_OVER_PREDICTED, rel=1e-6)
    # friction that runs in raises the force: the nominal model, without it, is further off
    assert found[0].nominal[Figure.FORCE] > found[0].extended[Figure.FORCE]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"finding": 1}', '{"verdict": "effect"}'])
def test_a_damaged_result_is_one_line(text, tmp_path):
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(PipelineError, match="result of a loop must be"):
        read_loop_finding(tmp_path)


@pytest.mark.parametrize("name", ["bench/b1", "-x/a b"])
def test_the_commands_of_a_loop_are_taken_by_the_command_line(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).mkdir(parents=True)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "model.json").touch()
    commands = make_root_command()
    for shown in (
        make_prediction_command(name, "out"),
        make_drawing_command(name, "out", "--force"),
    ):
        words = shlex.split(shown.line)
        command = commands.commands[words[1]]
        params = command.make_context("stepblocks", words[2:]).params
        assert not params.get("force")


async def open_loop(folder):
    """Open the page of the bench on a session that was explained before; click on a trial."""
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/bench?session=bench/b1")
        await user.should_see(marker="agreement", retries=200)
        shown = [label.text for label in user.find(kind=ui.label).elements]
        (errors,) = user.find(marker="errors").elements
        (settings,) = user.find(marker="settings").elements
        (chart,) = user.find(marker="agreement").elements
        options = json.loads(json.dumps(chart.options))
        point = {"componentType": "series", "seriesType": "scatter", "seriesIndex": 1}
        point |= {"seriesName": "after", "name": "4", "dataIndex": 2, "data": {}, "value": []}
        user.find(marker="agreement").trigger("componentClick", point)
        await user.should_see(marker="trace", retries=300)
        await user.should_see("--trials=4")
        (trace,) = user.find(marker="trace").elements
        return shown, errors.rows, settings.rows, options, trace.props["src"]


def test_the_page_shows_the_finding_its_errors_and_a_click_on_a_point_its_trace(lab):
    shown, errors, settings, options, trace = asyncio.run(open_loop(lab))
    assert (
        "It would confirm a change of friction over the order of the run, mainly by the peak force."
    ) in shown
    assert "Wipe the tip before each trial." in shown
    assert any("35 µm high: out/b1-loop/next-block.toml" in text for text in shown)
    assert any(text.startswith("4 trials at the first setting") for text in shown)
    assert [row["height_um"] for row in settings] == ["20", "50"]
    assert "Friction runs in (effect)" in shown
    assert "Held apart: 3 (let go early)" in shown
    assert [(row["energy"], row["force"]) for row in errors] == [("26", "-"), ("8", "2")]
    before, after, apart = options["series"]
    assert [point["name"] for point in before["data"]] == ["1", "3", "4"]  # 2 was not measured
    assert [point["name"] for point in after["data"]] == ["1", "4"]
    assert [point["name"] for point in apart["data"]] == ["3"]
    assert after["data"][0]["value"] == [1, MEASURED_OVER_PREDICTED]
    assert trace.startswith("data:image/png;base64,iVBOR")
    assert any(text.startswith("stepblocks predict bench/b1 --model") for text in shown)


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        (AskedExperiment(("the tips differ", "the days differ")), "The tips differ."),
        (AskedExperiment(("hook", "edge"), channel="ln_energy"), "It would tell hook from edge"),
    ],
)
def test_a_reason_of_an_experiment_is_what_it_tells_apart_or_what_is_open(asked, reason):
    effects = (FoundEffect("hook", "none"), FoundEffect("edge", "block"))
    errors = ModelPart(HeldOutErrors(None, None))
    finding = LoopFinding("", "", errors, errors, (), effects)
    reasons = describe_reasons(finding, asked)
    assert reasons[0].startswith(reason)
    assert len(reasons) == (1 if asked.channel else 2)


def test_a_model_predicts_on_the_page_to_declare_what_it_predicts_of_a_trial(lab, tmp_path):
    """The middle of what the session covered stands for what a stimulus file does not say."""
    path = tmp_path / "mine.toml"
    declared = (
        '[prediction]\nnormal_loads = ["0.8 N"]\n[[step_block]]\nid = "a"\nheight = "40 um"\n'
    )
    path.write_text(declared)
    model = make_learned_model({"running_in": {"excess": 0.6, "settling_trials": 30.0}}, 0.01)
    stimuli = load_set(path)
    (plain,) = predict_felt(stimuli)
    (felt,) = predict_felt(stimuli, model)
    trial = {"trial": "1", "block": "a", "tip": "tip-125", "height_um": 40.0, "load_n": 0.8}
    trial |= {"speed_mm_s": 10.0, "run_order": 60.5, "operator": "A"}
    expected = predict_trials(pd.DataFrame([trial]), model)
    energy = float(felt.learned.split(" (")[0])
    assert energy == pytest.approx(1e6 * expected["vibration_energy_j"][0], rel=0.01)
    assert plain.learned == ""
    assert plain.energy != felt.energy  # friction, spring and conversion are those of the session


def test_models_are_found_beside_a_build(lab, tmp_path):
    assert Folder(lab).list_models() == ["out/b1-loop/model.json"]
    (tmp_path / "out" / "x-loop").mkdir(parents=True)
    (tmp_path / "out" / "manifest.json").touch()
    (tmp_path / "out" / "x-loop" / "model.json").touch()
    assert Folder(tmp_path).list_models() == ["out/x-loop/model.json"]


async def open_with_model(folder, name):
    async with user_simulation(root=Window(folder).build) as user:
        await user.open(f"/declare?file=mine.toml&model={name}")
        await user.should_see(marker="felt", retries=200)
        (table,) = user.find(marker="felt").elements
        for _ in range(200):
            if table.rows:
                break
            await asyncio.sleep(0.1)
        shown = [label.text for label in user.find(kind=ui.label).elements]
        return shown, [column["name"] for column in table.columns]


@pytest.mark.long
def test_the_page_to_declare_shows_the_command_that_predicts_by_the_model(lab):
    (lab / "mine.toml").write_text('[[step_block]]\nid = "a"\nheight = "40 um"\n')
    shown, columns = asyncio.run(open_with_model(lab, "out/b1-loop/model.json"))
    assert "stepblocks build mine.toml -o out --model out/b1-loop/model.json" in shown
    assert "learned" in columns
    shown, columns = asyncio.run(open_with_model(lab, "../secret.json"))
    assert not any("--model" in text for text in shown)
    assert "learned" not in columns
