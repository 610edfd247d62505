"""Calibration first: what the ramps say of the declaration is said, and enters the intervals."""

from dataclasses import replace

import numpy as np
import pytest

from oracles.feature_bench import bench_trials, block_errors, design_columns
from oracles.features_file import features_of
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.loop.bench_model import list_candidate_laws, list_covariate_ranges
from stepblocks.loop.calibration_check import apply_calibration_checks, check_calibration
from stepblocks.loop.declared_checks import Declared
from stepblocks.loop.session_table import build_session_table
from stepblocks.rig.forward import make_height_error_name

_TRIALS, _SEED = 40, 4


def build_table(gain=0.0, spring=1.0, known=None):
    """Build a session of 40 trials without scans, with another gain or spring than declared."""
    columns = design_columns(_TRIALS, _SEED)
    empty = bench_trials(columns, 0)
    laws = list_candidate_laws(empty, list_covariate_ranges(empty))
    law = next(law for law in laws if law.id == "sensor_gain")
    effects = ((law, {"ln_gain": float(np.log1p(gain))}),)
    trials = bench_trials(columns, _SEED, effects, truth={"stiffness_ratio": spring})
    return columns, build_session_table(features_of(trials), 9810.0, 125e-6, None, known)


@pytest.fixture(scope="module")
def gained():
    columns, table = build_table(gain=0.04)
    rules = Rules(most=0, draws=20)  # no search: only the fit
    found = explain(table.model, table.trials, (), rules)
    return columns, table, found


def test_ramps_that_contradict_the_declared_spring_are_said_with_their_suspects(gained):
    _, table, _ = gained
    spring = next(
        check
        for check in check_calibration(table.trials, table.model)
        if check.quantity is Declared.SPRING
    )
    # origin: a gain of 4 % makes every ramp 4 % steeper
    assert spring.contradicts
    assert spring.low < 1.04 < spring.high
    assert "more than the declared spring: spring, speed or tangential gain" in spring.sentence
    assert "weigh the spring" in spring.quantity.advice


def test_intervals_of_heights_hold_what_is_not_known_of_the_gain(gained):
    columns, table, found = gained
    weighed, _ = apply_calibration_checks(found, check_calibration(table.trials, table.model))
    missed_before, missed = 0, 0
    for block, error in block_errors(columns, _SEED).items():
        name = make_height_error_name(block)
        miss = abs(found.extended.values[name] - error)
        missed_before += miss > 1.96 * found.extended.std[name]
        missed += miss > 1.96 * weighed.extended.std[name]
    assert missed_before >= 4
    assert missed == 0
    assert found.verdict is Verdict.NONE
    assert weighed.verdict is Verdict.AMBIGUOUS


@pytest.mark.parametrize(("spring", "slip"), [(0.5, 0.5), (2.0, 2.0), (1.0, None)])
def test_a_factor_at_which_people_slip_is_named_with_the_rate_among_the_suspects(spring, slip):
    _, table = build_table(spring=spring)
    check = check_calibration(table.trials, table.model)[0]
    assert check.slip == slip
    assert check.contradicts is (slip is not None)
    assert ("acquisition.sample_rate" in check.sentence) is (slip is not None)


def test_a_certificate_of_the_spring_that_agrees_with_the_ramps_is_no_contradiction():
    _, table = build_table(spring=1.04, known={"spring_constant": (1.04 * 9810.0, 50.0)})
    assert not check_calibration(table.trials, table.model)[0].contradicts
    ruled_out = replace(table.model, known={"spring_constant": (9810.0, 50.0)})
    assert check_calibration(table.trials, ruled_out)[0].contradicts
