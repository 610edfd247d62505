"""A session that is simulated on the kit has its weights for loads and errs by its budget."""

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stepblocks.bench.session import open_session
from stepblocks.declaration.read import load_set
from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.parts.apparatus.loads import compute_normal_load
from stepblocks.rehearse.kit_loads import (
    compute_largest_common_std,
    draw_trial_load_error,
    find_nearest_weight,
)
from stepblocks.rehearse.plan import read_session_plan
from stepblocks.rehearse.run import simulate_session

FILE = Path(__file__).resolve().parents[2] / "stimuli" / "apparatus.toml"
KIT = load_set(FILE).stimuli[0].kit
G = 9.80665
PLAN = """schema = 1
seed = 4
format = "csv"
apparatus = "apparatus.toml"
[design]
heights = ["20 um"]
loads = ["0.294 N", "0.49 N"]
speeds = ["2 mm/s"]
repeats = 2
"""


def write_plan(tmp_path, text=PLAN):
    shutil.copy(FILE, tmp_path)
    path = tmp_path / "plan.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_loads_of_a_plan_are_those_of_the_weights(tmp_path):
    plan = read_session_plan(write_plan(tmp_path))
    assert plan.apparatus == KIT
    assert plan.design.loads == pytest.approx([0.03 * G, 0.05 * G], rel=1e-12)
    assert plan.scatter.load == 0.0  # the budget of the kit stands for it


def test_over_many_sessions_a_load_scatters_by_its_budget():
    load = find_nearest_weight(KIT, 0.49)
    chance = np.random.default_rng(1)
    errors = [draw_trial_load_error(KIT, 0.49, seed, chance) for seed in range(1500)]
    # a standard deviation of 1,500 draws is known to 1.8 % (JCGM 100, E.4.3)
    assert np.std(errors) == pytest.approx(load.std, rel=0.06)
    assert abs(np.mean(errors)) < 4.0 * load.std / np.sqrt(1500.0)


def test_within_a_session_only_the_friction_of_the_pivot_changes():
    load = compute_normal_load(KIT, 0.05)
    pivot = load.budget[-1]
    chance = np.random.default_rng(1)
    errors = [draw_trial_load_error(KIT, 0.49, 7, chance) for _ in range(1000)]
    assert np.std(errors) == pytest.approx(pivot.std, rel=0.05)
    assert np.ptp(errors) <= 2.0 * pivot.half_width


def test_gravity_is_the_same_error_under_every_weight():
    # what is left of two weights beside their own mass and place is one share of their force
    def draw(load, seed):
        chance = np.random.default_rng(0)
        return draw_trial_load_error(KIT, load, seed, chance) / load

    light = [draw(0.294, seed) for seed in range(1000)]
    heavy = [draw(1.079, seed) for seed in range(1000)]
    budget = {line.source.value: line.std for line in compute_normal_load(KIT, 0.11).budget}
    share = budget["gravity"] ** 2 / compute_normal_load(KIT, 0.11).common_std ** 2
    assert np.corrcoef(light, heavy)[0, 1] == pytest.approx(share, abs=0.08)


def test_a_simulated_session_errs_by_its_kit_and_declares_so(tmp_path):
    output = tmp_path / "session"
    simulate_session(write_plan(tmp_path), output)
    declared = tomllib.loads((output / "session.toml").read_text(encoding="utf-8"))
    std = compute_largest_common_std(KIT, [0.294, 0.49])
    assert std == compute_normal_load(KIT, 0.05).common_std
    assert declared["calibration"] == {"load_error": ["0 mN", f"{std * 1e3:.2g} mN"]}
    known = open_session(output).calibration.list_known_constants()
    assert known["load_bias_n"] == pytest.approx((0.0, std), rel=0.05)
    truth = pd.read_csv(output / "truth.csv")
    trials = pd.read_csv(output / "trials.csv")
    errors = truth["normal_load_n"] - trials["load_n"]
    most = sum(line.half_width for line in compute_normal_load(KIT, 0.05).budget)
    assert (errors.abs() < most).all()
    assert (errors.abs() > 1e-6).all()
    for _, of_a_weight in errors.groupby(trials["load_n"]):
        assert np.ptp(of_a_weight) < 0.2e-3  # only the pivot


@pytest.mark.parametrize(
    ("declared", "wrong", "message"),
    [
        ('"0.49 N"]', '"0.6 N"]', r"loads must be those of the weights of drag-rig .*got 0.6 N"),
        ("repeats = 2", "repeats = 2\n[scatter]\nload = 0.01", "load must be left out, because"),
        ('"apparatus.toml"', "7", "apparatus must be the name of a stimulus file, got 7"),
        ('"apparatus.toml"', '"none.toml"', "none.toml"),
    ],
)
def test_a_plan_that_does_not_suit_its_kit_is_refused(declared, wrong, message, tmp_path):
    path = write_plan(tmp_path, PLAN.replace(declared, wrong))
    with pytest.raises(StepblocksError, match=message):
        read_session_plan(path)


def test_a_file_without_a_kit_is_refused(tmp_path):
    shutil.copy(FILE.with_name("probe-tips.toml"), tmp_path)
    path = write_plan(tmp_path, PLAN.replace("apparatus.toml", "probe-tips.toml"))
    with pytest.raises(PipelineError, match=r"declare a kit in \[\[apparatus\]\], got none"):
        read_session_plan(path)
