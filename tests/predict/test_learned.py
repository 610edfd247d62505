"""A learned model in the prediction of stimuli: the same as a trial of that step."""

import math

import pandas as pd
import pytest

from oracles.learned import make_learned_model
from oracles.shipped import load_shipped
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.predict.learned import (
    apply_learned_constants,
    format_learned_columns,
    predict_learned_drag,
    predict_trials,
)
from stepblocks.predict.predictions import predict_by_formula

_CONDITION = OperatingPoint(ball_radius=110e-6, normal_load=0.8, friction=0.4, speed=8e-3)
_ROUNDED = {"edge_rounding": {"edge_radius_m": 14e-6}}


def test_a_step_is_asked_about_like_a_trial_of_it():
    learned = make_learned_model(_ROUNDED, std=0.002, scatter=0.03)
    found = predict_learned_drag(learned, "step-050", 50e-6, _CONDITION)
    row = {
        "trial": "1",
        "block": "step-050",
        "height_um": 50.0,
        "load_n": 0.8,
        "speed_mm_s": 8.0,
        "tip": "tip-110",
    }
    trial = predict_trials(pd.DataFrame([row]), learned).iloc[0]
    assert found.peak_force == pytest.approx(
        [trial[f"peak_force{end}_n"] for end in ("", "_low", "_high")], rel=1e-12, abs=0.0
    )
    assert found.energy == pytest.approx(
        [trial[f"vibration_energy{end}_j"] for end in ("", "_low", "_high")], rel=1e-12, abs=0.0
    )
    assert found.status == "ok"


def test_friction_and_tool_are_those_that_were_learnt_not_those_that_were_assumed():
    found = predict_learned_drag(make_learned_model(_ROUNDED), "step-050", 50e-6, _CONDITION)
    assert found.friction == pytest.approx(0.17)
    learnt = (
        found.tool.stiffness,
        found.tool.conversion,
        found.tool.frequency,
        found.tool.decay_time,
    )
    assert learnt == pytest.approx((1.05 * 9500.0, 0.23, 290.0, 0.021))
    assert found.tool.detection_threshold == PAPER.tool.detection_threshold
    assert found.edge_radius == pytest.approx(14e-6, rel=1e-9, abs=0.0)


def test_what_an_effect_follows_is_taken_in_the_middle_of_the_data():
    learned = make_learned_model({"running_in": {"excess": 0.5, "settling_trials": 30.0}})
    found = predict_learned_drag(learned, "step-050", 50e-6, _CONDITION)
    assert found.friction == pytest.approx(0.17 * (1.0 + 0.5 * math.exp(-60.5 / 30.0)))
    assert found.edge_radius == 0.0


def test_a_step_beyond_the_data_is_flagged():
    assert (
        predict_learned_drag(make_learned_model(), "step-090", 90e-6, _CONDITION).status
        == "outside-range(height_um)"
    )


def test_a_set_is_predicted_with_the_constants_of_the_session():
    stimuli = apply_learned_constants(load_shipped("paper-four"), make_learned_model())
    assert stimuli.prediction.frictions == (0.17,)
    assert stimuli.prediction.tool.stiffness == pytest.approx(1.05 * 9500.0)
    assert stimuli.prediction.tool.conversion == pytest.approx(0.23)


@pytest.mark.parametrize("name", ["paper-four", "crown-margins"])
def test_columns_say_the_same_as_a_plain_step_of_the_same_critical_angle(name):
    learned = make_learned_model()
    seen = set()
    for prediction in predict_by_formula(apply_learned_constants(load_shipped(name), learned)):
        columns = format_learned_columns(prediction, learned)
        seen.add(prediction.release.status.value)
        if prediction.release.status.value != "releases":
            assert set(columns.values()) == {""}
        elif columns["learned_status"] != "locked":
            # without effects the extended model is equation (1) with the same constants, whatever
            # the kind of edge
            force, energy = (
                float(columns["learned_peak_force_n"]),
                float(columns["learned_vibration_energy_uj"]),
            )
            assert force == pytest.approx(prediction.release.pull_force, rel=1e-5)
            assert energy * 1e-6 == pytest.approx(
                prediction.release.vibration_energy, rel=1e-5, abs=0.0
            )
    assert "releases" in seen


def test_a_model_that_follows_the_speed_is_asked_about_the_speed_of_the_condition():
    # C_v (v / 6 mm/s)^q: at 8 mm/s the energy is (8 / 6)^q times that of the same model at q = 0
    def energy(exponent):
        learned = make_learned_model({"speed_dependent_conversion": {"exponent": exponent}})
        return predict_learned_drag(learned, "step-050", 50e-6, _CONDITION).energy[0]

    assert energy(0.7) / energy(0.0) == pytest.approx((8.0 / 6.0) ** 0.7, rel=1e-9)
