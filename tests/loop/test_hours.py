"""What goes with the hour: levels of days, jumps and drifts, found and taken out.

Expected values are those planted on a bench of features.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from oracles.feature_bench import bench_trials, design_columns, noise_free
from oracles.features_file import features_of
from stepblocks.contact.operating_point import Tool
from stepblocks.lawsearch.adequacy import ReplicateTest
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.lawsearch.run_order import compute_jump_place_interval
from stepblocks.lawsearch.walk import find_level_starts_by_level_count
from stepblocks.loop.bench_model import SessionModel, list_covariate_ranges
from stepblocks.loop.compose import _estimate_noise_floor
from stepblocks.loop.session_table import build_session_table

_MODEL = SessionModel(Tool(frequency=300.0, decay_time=0.02))


def _explain(factor, seed, **columns):
    """Explain 96 trials whose friction is multiplied by one factor each."""
    design = design_columns(96, seed) | columns
    law = Law(
        "hour",
        "mu f",
        (Parameter("on", "1", 0.0, 0.0, 1.0, 1.0),),
        lambda state, _, values: state.changed(friction=state.friction * factor),
        "friction",
    )
    trials = bench_trials(design, seed, ((law, {"on": 1.0}),))
    found = explain(_MODEL, trials, _MODEL.candidates(trials), Rules(draws=200))
    left = trials.values[:, 1] - found.extended.predicted[:, 1]
    return found, float(np.sqrt(np.nanmean(left**2)))


_RUN = np.arange(1.0, 97.0)
_DAYS = np.select([_RUN < 20, _RUN < 70], [1.0, 1.25], 1.1)


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_three_days_of_unequal_length_are_found_each_with_its_first_trial_and_its_level(seed):
    found, left = _explain(_DAYS, seed)
    (finding,) = found.findings
    assert (found.verdict, finding.effect.place) == (Verdict.EFFECT, ("friction", "run_order"))
    values, std = (
        finding.effect.pick_own_values(of) for of in (found.extended.values, found.extended.std)
    )
    assert values["at_trial[second]"] == pytest.approx(19.5, abs=0.6)
    assert values["at_trial[third]"] == pytest.approx(69.5, abs=0.6)
    for name, factor in (("step[second]", 1.25), ("step[third]", 1.1)):
        assert abs(values[name] - math.log(factor)) < 3.0 * std[name]
    assert left < 0.02  # of ln F_px; 0.05 with the days in it


@pytest.mark.long
def test_a_day_that_the_log_names_has_a_level_of_its_own():
    days = np.select([_DAYS == 1.0, _DAYS == 1.25], ["mon", "tue"], "wed")
    found, left = _explain(_DAYS, 1, day=days)
    (finding,) = found.findings
    assert (found.verdict, finding.effect.place) == (Verdict.EFFECT, ("friction", "day"))
    assert finding.rivals == ()
    own = finding.effect.pick_own_values(found.extended.values)
    assert own["g[tue]"] == pytest.approx(math.log(1.25), abs=0.03)
    assert own["g[wed]"] == pytest.approx(math.log(1.1), abs=0.03)
    assert left < 0.02


@pytest.mark.long
def test_a_jump_and_a_drift_of_friction_are_taken_out():
    found, left = _explain(np.where(_RUN < 37, 1.0, 1.2), 1)
    assert [f.effect.id for f in found.findings] == ["step_friction_run_order"]
    assert found.extended.values["step_friction_run_order.at_trial"] == pytest.approx(36.5, abs=0.6)
    # of so clear a jump the place is known to the two trials that it lies between
    (finding,) = found.findings
    assert compute_jump_place_interval(
        found.problem, found.extended, finding.effect, "at_trial", _RUN
    ) == (
        36.0,
        37.0,
    )
    assert left < 0.02
    found, left = _explain(1.0 + 0.3 * (_RUN / 96.0 - 0.5), 3)
    assert [f.effect.id for f in found.findings] == ["trend_friction_run_order"]
    # ln of 1.15 over 0.85 from end to end, the slope is that of half the run
    slope = 0.5 * math.log(1.15 / 0.85)
    assert found.extended.values["trend_friction_run_order.slope"] == pytest.approx(slope, abs=0.02)
    assert left < 0.02


_SINCE = np.concatenate([np.arange(float(count)) for count in (24, 24, 20, 16, 12)])
_RESTS = {
    "pause_s": np.where(_SINCE == 0.0, 700.0 + _RUN, 60.0 + 7.0 * _RUN % 31.0),
    "trials_since_rest": _SINCE,
}


@pytest.mark.long
def test_friction_that_falls_by_a_quarter_after_a_rest_and_comes_back_is_no_wandering():
    found, left = _explain(1.0 - 0.25 * np.exp(-_SINCE / 5.0), 2, **_RESTS)
    assert found.hints == ()
    (finding,) = found.findings
    assert (found.verdict, finding.effect.id, finding.rivals) == (Verdict.EFFECT, "rest", ())
    values, std = (
        finding.effect.pick_own_values(of) for of in (found.extended.values, found.extended.std)
    )
    assert abs(values["excess"] + 0.25) < 3.0 * std["excess"] < 0.05
    assert abs(values["settling_trials"] - 5.0) < 3.0 * std["settling_trials"] < 3.0
    assert left < 0.02  # of ln F_px; 0.035 with the rests in it


@pytest.mark.long
def test_friction_of_the_first_trial_after_a_rest_alone_changes_with_the_pause():
    found, left = _explain(np.where(_SINCE == 0.0, 0.75, 1.0), 2, **_RESTS)
    (finding,) = found.findings
    assert (found.verdict, finding.effect.id) == (Verdict.EFFECT, "step_friction_pause_s")
    own = finding.effect.pick_own_values(found.extended.values)
    assert own["step"] == pytest.approx(math.log(0.75), abs=0.06)
    assert 90.0 < own["at"] < 700.0  # the longest usual pause, the shortest rest [s]
    assert left < 0.02


@pytest.mark.long
def test_friction_that_wanders_is_taken_out_along_the_run_and_no_law_is_claimed():
    steps = np.random.default_rng([3, 9]).standard_normal(96)
    found, left = _explain(np.exp(0.12 * np.cumsum(steps) / math.sqrt(96.0)), 3)
    assert [hint.kind for hint in found.hints] == ["neighbours"]
    (finding,) = found.findings
    assert finding.effect.place == ("friction", "run_order")
    assert (found.verdict, finding.verdict) == (Verdict.UNEXPLAINED, Verdict.UNEXPLAINED)
    nominal = found.problem.trials.values[:, 1] - found.nominal.predicted[:, 1]
    assert left < 0.9 * float(np.sqrt(np.nanmean(nominal**2)))


def test_levels_are_those_of_the_least_sum_of_squares():
    # origin: all partitions of twenty values into three levels of six and more, tried one by one
    values = np.random.default_rng(4).standard_normal(20) + np.repeat([0.0, 1.0, 0.3], [7, 6, 7])

    def cost(one, other):
        parts = np.split(values, [one, other])
        return sum(float(np.sum((part - part.mean()) ** 2)) for part in parts)

    tried = [(one, other) for one in range(6, 9) for other in range(one + 6, 15)]
    two, three = find_level_starts_by_level_count(values)
    assert tuple(three) == min(tried, key=lambda pair: cost(*pair))
    assert len(two) == 1


def test_a_label_the_data_had_not_is_taken_for_the_mean_of_all():
    place = next(r for r in _ranges(day=np.array(["a", "b", "c"] * 10)) if r.name == "day")
    np.testing.assert_allclose(
        place.build_smooth_columns(np.array(["a", "b", "c", "d"])),
        [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0 / 3.0, 1.0 / 3.0]],
    )


def _ranges(**columns):
    trials = bench_trials(design_columns(30, 1), 1)
    covariates = {name: column[: len(trials)] for name, column in columns.items()}
    return list_covariate_ranges(replace(trials, covariates={**trials.covariates, **covariates}))


@pytest.mark.long
def test_the_noise_beside_a_cause_that_goes_with_the_hour_is_what_the_bench_scatters_by():
    # origin: the same drags of the bench without scatter. A regression of fourth order in the run
    # cannot follow two and a half periods
    design = design_columns(96, 1)
    law = Law(
        "hour",
        "mu f",
        (Parameter("on", "1", 0.0, 0.0, 1.0, 1.0),),
        lambda state, _, values: state.changed(
            friction=state.friction * (1.0 + 0.2 * np.cos(2.0 * np.pi * _RUN / 38.0))
        ),
        "friction",
    )
    planted = ((law, {"on": 1.0}),)
    trials = bench_trials(design, 1, planted)
    rows = trials.covariates["run_order"].astype(int) - 1  # a tip that locks shows no energy
    scatter = np.nanstd(trials.values - noise_free(design, 1, planted)[rows], axis=0)
    table = build_session_table(features_of(trials), 9810.0, 125e-6)
    model = table.model
    found = explain(model, table.trials, model.candidates(table.trials), Rules(draws=200))
    unknown = ReplicateTest(replicate_std=math.nan, replicate_dof=0, lack_of_fit_p_value=math.nan)
    floor = _estimate_noise_floor(table, found.extended, [unknown, unknown])
    energy, force = floor.ln_energy_rms, floor.ln_peak_force_rms
    assert energy == pytest.approx(scatter[0], rel=0.2)
    assert force == pytest.approx(scatter[1], rel=0.2)
