"""Sudden changes are found at the reading at which they were made, and nothing beside them.

Each is planted on a bench of features by its formula; intervals are those of four standard
uncertainties.
"""

import numpy as np
import pytest

from oracles.feature_bench import bench_trials, block_scans, design_columns
from stepblocks.contact.operating_point import Tool
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.loop.bench_model import SessionModel, list_candidate_laws, list_covariate_ranges
from stepblocks.rig.effects.grammar.slots import SLOT_MOVES

_SIZE = 0.05  # of a change of the logarithm


def _search(columns, seed, slot, size):
    """Search for what moves a slot by a size that is given for each trial."""
    move = SLOT_MOVES[slot]
    on = (Parameter("on", "1", 0.0, 0.0, 1.0, 1.0),)
    planted = Law("planted", "as written", on, lambda state, *_: move.change(state, size), slot)
    trials = bench_trials(columns, seed, ((planted, {"on": 1.0}),))
    model = SessionModel(Tool(frequency=300.0, decay_time=0.02), scanned=block_scans(columns, seed))
    candidates = list_candidate_laws(trials, list_covariate_ranges(trials))
    found = explain(model, trials, candidates, Rules(draws=100))
    return found, [finding.effect.id for finding in found.findings]


@pytest.mark.long
def test_a_jump_of_the_stiffness_leaves_nothing_to_explain_beside_it():
    columns = design_columns(96, 11)
    run = columns["run_order"]
    found, names = _search(columns, 11, "stiffness", _SIZE * (run > 40.0))
    assert names == ["step_stiffness_run_order"]
    assert found.verdict is Verdict.EFFECT
    shown, stds = found.extended.values, found.extended.std
    step = "step_stiffness_run_order.step"
    assert abs(shown[step] - _SIZE) < 4.0 * stds[step]
    assert 40.0 < shown["step_stiffness_run_order.at_trial"] < 41.0


@pytest.mark.long
@pytest.mark.parametrize("seed", [12, 13])
def test_a_jump_is_laid_to_the_reading_that_it_follows(seed):
    # between the twelve places at which jumps are scored, where another reading nearly jumps too
    columns = design_columns(240, seed)
    temperature = np.sort(np.unique(columns["temperature_c"]))
    place = 0.5 * (temperature[84] + temperature[85])
    found, names = _search(columns, seed, "gain", -_SIZE * (columns["temperature_c"] > place))
    assert names == ["step_gain_temperature_c"]
    shown = found.extended.values["step_gain_temperature_c.at"]
    assert temperature[84] <= shown <= temperature[85]


@pytest.mark.long
@pytest.mark.parametrize("size", [0.3, -0.3])
def test_a_pulse_of_the_conversion_is_one_and_not_three_levels(size):
    columns = design_columns(240, 14)
    run = columns["run_order"]
    found, names = _search(columns, 14, "conversion", size * ((run > 72.5) & (run < 132.5)))
    assert names == ["step_conversion_run_order~pulse"]
    step = "step_conversion_run_order~pulse.step"
    assert abs(found.extended.values[step] - size) < 4.0 * found.extended.std[step]


@pytest.mark.long
def test_a_line_over_a_decade_that_one_operator_follows_is_a_line_of_hers_alone():
    columns = design_columns(240, 15)
    speed = columns["speed_mm_s"]
    share = (speed - speed.min()) / np.ptp(speed)
    size = _SIZE * (columns["operator"] == "B") * share
    found, names = _search(columns, 15, "stiffness", size)
    law = "trend_stiffness_operator * speed_mm_s~line"
    assert names == [law]
    for name, true in (("slope[A]", 0.0), ("slope[B]", 0.5 * _SIZE), ("level[B]", 0.5 * _SIZE)):
        parameter = f"{law}.{name}"
        assert abs(found.extended.values[parameter] - true) < 4.0 * found.extended.std[parameter]
