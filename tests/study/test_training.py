"""Training by difficulty: three of four right, over days, by codes that tell nothing."""

import csv
import http.client
import json
import threading

import numpy as np
import pytest
from scipy.stats import norm

import stepblocks
from stepblocks.errors import StudyError
from stepblocks.study.conduct.clock import SteadyClock
from stepblocks.study.conduct.server import RunServer
from stepblocks.study.design.read import read_design
from stepblocks.study.design.training import Staircase
from stepblocks.study.run import design_study

DAY = 86_400.0
HEIGHTS = [50e-6 * 1.03**step for step in range(25)]


@pytest.fixture
def study(tmp_path):
    design_study(
        [20e-6, 30e-6, 34e-6, 40e-6, 44e-6, 55e-6],
        tmp_path,
        seed=1,
        participants=2,
        experiment="adaptive",
        standard="step-040",
        trials=10,
    )
    return tmp_path


def give(training, right):
    """Answer the next pair rightly or wrongly."""
    row = training.now
    is_higher = float(row["height_um"]) > float(row["standard_height_um"])
    second_is_higher = is_higher == (row["condition"] == "standard-first")
    text = "y" if second_is_higher == right else "n"
    training.answer(row["trial"], {"second_is_higher": text}, 1.5)


@pytest.mark.parametrize("weber", [0.2, 0.3])
def test_three_of_four_pairs_are_right_whoever_is_trained(tmp_path, weber):
    """Kaernbach 1991: one harder, three easier settle where three of four are right."""
    name = f"step-{HEIGHTS[0] * 1e6:03.6g}"
    design_study(
        HEIGHTS, tmp_path, seed=1, participants=1, experiment="adaptive", standard=name, trials=20
    )
    staircase = Staircase(read_design(tmp_path / "design.csv"))
    generator = np.random.default_rng(3)
    spread = np.log1p(weber) / norm.ppf(0.75)  # three of four are right at a Weber fraction
    rights, differences = [], []
    for _ in range(1500):
        trial = staircase.choose_next_pair()
        is_higher = float(trial.row["height_um"]) > float(trial.row["standard_height_um"])
        felt = trial.difference + generator.normal(0.0, spread)
        called_higher = is_higher == (felt > 0.0)
        second = called_higher == (trial.row["condition"] == "standard-first")
        answer = {**trial.row, "second_is_higher": "y" if second else "n"}
        rights.append(staircase.update_with_answer(trial, answer))
        differences.append(trial.difference)
    assert np.mean(rights[100:]) == pytest.approx(0.75, abs=0.015)
    assert np.exp(np.mean(differences[100:])) - 1.0 == pytest.approx(weber, rel=0.15)


def test_pairs_grow_harder_by_one_level_and_easier_by_three(study):
    training = stepblocks.open_training(study, "1", 20)
    levels = []
    for right in (True, True, True, True, True, False, True, False, False):
        levels.append(training.state()["training"])
        give(training, right)
    training.close()
    found = [int(text.split()[1]) for text in levels]
    assert found == [1, 2, 3, 4, 5, 5, 2, 3, 1]


def test_a_training_goes_on_over_days_from_its_answers_alone(study, monkeypatch):
    now = [SteadyClock().read_time()]
    monkeypatch.setattr(SteadyClock, "read_time", lambda self: now[0])
    for right in (6, 5, 7):
        training = stepblocks.open_training(study, "1", 8)
        for number in range(8):
            give(training, number < right)
            if number == 3:  # a break
                training.close()
                training = stepblocks.open_training(study, "1", 8)
        assert training.now is None
        assert training.state()["done"]
        training.close()
        now[0] += DAY
    days = stepblocks.read_training(study)
    assert [(day.trials, day.right) for day in days] == [(8, 6), (8, 5), (8, 7)]
    assert len({day.date for day in days}) == 3
    assert all(day.right_low < day.right / 8 < day.right_high for day in days)
    with (study / "training" / "progress.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["right_ratio"] for row in rows] == ["0.7500", "0.6250", "0.8750"]
    assert {row["participant"] for row in rows} == {"1"}
    assert not (study / "runs").exists()  # no answer of the study


def test_neither_page_nor_files_tell_a_height_or_a_code_of_the_trials(study):
    training = stepblocks.open_training(study, "1", 4)
    shown = []
    for number in range(4):
        shown.append(training.state())
        give(training, number != 2)
    training.close()
    design = read_design(study / "design.csv")
    codes = {row[name] for row in design for name in ("code", "standard_code")}
    text = json.dumps(shown) + "".join(
        path.read_text() for path in (study / "training").glob("*.csv")
    )
    assert not any(f'"{code}"' in text or f",{code}," in text for code in codes)
    for row in design:
        assert row["stimulus"] not in text
        assert f'"{row["height_um"]}"' not in text


def test_an_answer_that_was_changed_by_hand_is_refused(study):
    training = stepblocks.open_training(study, "1", 4)
    for _ in range(3):
        give(training, right=True)
    training.close()
    lines = training.path.read_text().splitlines()
    swapped = [lines[0], lines[2], lines[1], lines[3]]
    training.path.write_text("\n".join(swapped) + "\n")
    with pytest.raises(StudyError, match=r"must be .* here, as the answers before lead to"):
        stepblocks.open_training(study, "1", 4)


def test_what_training_cannot_do_is_refused(study, tmp_path_factory):
    with pytest.raises(StudyError, match="participant must be one of 1, 2, got '3'"):
        stepblocks.open_training(study, "3")
    with pytest.raises(StudyError, match="train must be from 1 to 10000 trials, got 0"):
        stepblocks.open_training(study, "1", 0)
    training = stepblocks.open_training(study, "1", 4)
    with pytest.raises(StudyError, match="cannot be taken back"):
        training.undo()
    with pytest.raises(StudyError, match="trial must be the one that is next"):
        training.answer("7", {"second_is_higher": "y"})
    with pytest.raises(StudyError, match="second_is_higher must be y or n"):
        training.answer("1", {"second_is_higher": "perhaps"})
    assert training.answered == 0
    training.close()
    folder = tmp_path_factory.mktemp("estimates")
    design_study([20e-6, 50e-6], folder, seed=1, participants=1)
    with pytest.raises(StudyError, match="train is an option of constant, adaptive, not of estim"):
        stepblocks.open_training(folder, "1")


@pytest.mark.long
def test_the_page_serves_a_training_until_the_sitting_is_done(study):
    training = stepblocks.open_training(study, "2", 1)
    server = RunServer(training)
    served = threading.Thread(target=server.serve_until_done, daemon=True)
    served.start()
    client = http.client.HTTPConnection("127.0.0.1", server.server_address[1])
    body = json.dumps({"trial": "1", "answers": {"second_is_higher": "y"}})
    client.request("POST", "/answer", body, {"X-Stepblocks": server.token})
    said = json.loads(client.getresponse().read())
    assert (said["done"], said["feedback"] in ("right", "wrong")) == (True, True)
    client.close()
    served.join(10.0)
    assert (study / "training" / "progress.csv").exists()
