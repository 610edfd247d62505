"""What to measure next: only where something is open, and where it would tell most."""

from dataclasses import replace

import numpy as np
import pytest

from stepblocks.declaration.read import load_set
from stepblocks.lawsearch.choice import Rival
from stepblocks.lawsearch.discrimination import RankedSetting
from stepblocks.lawsearch.findings import Finding, Verdict
from stepblocks.lawsearch.fit import fit_with_effects
from stepblocks.loop.bench_model import list_candidate_laws, list_covariate_ranges
from stepblocks.loop.experiment import (
    NextBlock,
    NextExperiment,
    format_block_stimulus,
    propose_experiment,
)
from stepblocks.loop.settings import build_setting_grid
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.state import CHANNELS


@pytest.fixture(scope="module")
def found(worn):
    return worn[2].found


def test_where_nothing_is_open_nothing_is_asked_for(found):
    assert propose_experiment(replace(found, verdict=Verdict.NONE, findings=())) is None


def test_a_claim_without_a_rival_is_tried_against_nothing(found):
    law = next(
        e
        for e in list_candidate_laws(
            found.problem.trials, list_covariate_ranges(found.problem.trials)
        )
        if e.id == "load_dependent_friction"
    )
    claim = replace(found.findings[0], effect=law, rivals=())
    extended = fit_with_effects(found.problem, (law,), {"load_dependent_friction.exponent": 0.1})
    asked = propose_experiment(replace(found, findings=(claim,), extended=extended))
    assert asked.separates == ("load_dependent_friction", "nothing")
    gains = [trial.expected_gain for trial in asked.trials]
    assert gains == sorted(gains, reverse=True)
    # origin: twice a log likelihood of 12 is odds of 400 to 1
    assert asked.repeats == int(np.ceil(12.0 / gains[0]))


def test_no_trial_is_asked_for_at_an_hour_that_has_gone(found):
    """What has run in stays so: the first trials would tell most, and do not come again."""
    asked = propose_experiment(found)
    assert asked.separates == ("running_in", "nothing")
    last = float(np.max(found.problem.trials.covariates["run_order"]))
    assert all(trial.settings["run_order"] == last + 1.0 for trial in asked.trials)
    assert asked.trials or "drag a fresh or cleaned block" in asked.calibration[0]


def test_only_what_the_bench_has_done_is_asked_for_and_only_where_the_tip_slips(found):
    trials = found.problem.trials
    asked = propose_experiment(found).rows
    claims = []
    for law in list_candidate_laws(trials, list_covariate_ranges(trials)):
        if law.id not in ("load_dependent_friction", "edge_rounding", "viscous_drag"):
            continue
        fitted = fit_with_effects(found.problem, (law,), {})
        if law.id == "viscous_drag":
            # there is none, and none that is negative: claim one
            drag = {"viscous_drag.coefficient_n_s_per_m": 2.0}
            fitted = replace(fitted, values=fitted.values | drag)
        finding = replace(found.findings[0], effect=law, rivals=())
        claims.append(replace(found, findings=(finding,), extended=fitted))
    for claim in claims:
        asked = asked + propose_experiment(claim).rows
    assert len(asked) > 3 * len(claims)
    for name in ("load_n", "speed_mm_s"):
        assert {one[name] for one in asked} <= set(trials.covariates[name].tolist())
    heights = trials.covariates["height_um"]
    highest = float(np.nanmax(np.exp(trials.values[:, CHANNELS.index("ln_peak_force")])))
    friction = found.extended.values["friction"]
    for one in asked:
        assert heights.min() <= one["height_um"] <= heights.max()
        # origin: equations (1) and (2), F tan(a + atan mu), beside the force of sliding
        angle = np.arccos(1.0 - one["height_um"] / 125.0) + np.arctan(friction)
        pull = one["load_n"] * np.tan(angle)
        assert angle < 0.5 * np.pi
        assert 1.05 * friction * one["load_n"] < pull < 1.3 * highest


def test_what_goes_with_a_rest_is_asked_for_right_after_one_and_at_the_longest_from_it(found):
    trials = found.problem.trials
    since = np.arange(float(len(trials))) % 31.0
    trials = replace(trials, covariates=trials.covariates | {"trials_since_rest": since})
    asked = build_setting_grid(trials, ["trials_since_rest"]).covariates["trials_since_rest"]
    assert {0.0, 30.0} < set(asked.tolist()) < set(since.tolist())


def test_rivals_are_asked_apart_from_each_other(found):
    (finding,) = found.findings
    trials = found.problem.trials
    law = next(
        e
        for e in list_candidate_laws(trials, list_covariate_ranges(trials))
        if e.id == "trend_friction_run_order"
    )
    fitted = fit_with_effects(found.problem, (law,), found.nominal.values)
    doubted = Finding(
        finding.effect, Verdict.AMBIGUOUS, finding.gate_p, finding.gain, (Rival(law, fitted, 1.0),)
    )
    asked = propose_experiment(replace(found, findings=(doubted,), verdict=Verdict.AMBIGUOUS))
    assert asked.separates == ("running_in", "trend_friction_run_order")
    assert {"height_um", "load_n", "speed_mm_s", "run_order"} <= set(asked.trials[0].settings)


def test_the_height_of_a_block_is_asked_of_no_other_block(found):
    trials = found.problem.trials
    block = str(trials.block[0])
    law = next(e for e in list_named_laws([block]) if e.covariate == "block")
    claim = replace(found.findings[0], effect=law, rivals=())
    extended = fit_with_effects(found.problem, (law,), {f"{law.id}.height_error_m": 3e-6})
    asked = propose_experiment(replace(found, findings=(claim,), extended=extended))
    height = float(trials.covariates["height_um"][0])
    assert {one.settings["height_um"] for one in asked.trials} == {height}
    assert 0.0 < asked.width_after[f"{law.id}.height_error_m"] < 1.0


def test_a_model_cannot_be_distinguished_from_itself(found):
    (finding,) = found.findings
    same = Finding(
        finding.effect,
        Verdict.AMBIGUOUS,
        finding.gate_p,
        finding.gain,
        (Rival(finding.effect, found.extended, 0.0),),
    )
    asked = propose_experiment(replace(found, findings=(same,), verdict=Verdict.AMBIGUOUS))
    assert asked.trials == ()
    assert "no setting within reach" in asked.note
    assert format_block_stimulus(asked) is None


def test_a_height_that_is_there_needs_no_new_block(found):
    heights = set(found.problem.trials.covariates["height_um"].tolist())
    asked = propose_experiment(found)
    assert (asked.block is not None) == (asked.trials[0].settings["height_um"] not in heights)


@pytest.mark.parametrize("height", ["5 um", "15 um", "90 um"])
def test_the_block_that_is_asked_for_is_a_stimulus(tmp_path, height):
    asked = NextExperiment(
        separates=("edge_rounding", "nothing"),
        trials=tuple(RankedSetting({"load_n": load}, 6.0) for load in (1.5, 0.3, 1.5)),
        block=NextBlock(name="step-new", height=height, tip="125 um", friction="0.170"),
    )
    path = tmp_path / "next-block.toml"
    path.write_text(format_block_stimulus(asked))
    stimuli = load_set(path)
    (block,) = stimuli.stimuli
    assert (block.id, block.height.nominal) == (
        "step-new",
        pytest.approx(float(height.split()[0]) * 1e-6),
    )
    assert stimuli.prediction.normal_loads == (0.3, 1.5)
    assert stimuli.prediction.frictions == (0.17,)


@pytest.mark.parametrize("experiment", [None, NextExperiment(())])
def test_no_block_is_written_where_none_is_asked_for(experiment):
    assert format_block_stimulus(experiment) is None
