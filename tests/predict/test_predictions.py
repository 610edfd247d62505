"""The predictions of a set: rows, file and table, with the set's own tools and tips."""

import csv
import io
import math
from pathlib import Path

import pandas as pd
import pytest

import stepblocks
from oracles.shipped import load_shipped
from stepblocks.contact.counterface import Margin, Step
from stepblocks.contact.energy import Status
from stepblocks.errors import StepblocksError
from stepblocks.predict.columns import (
    choose_terminal_columns,
    format_predictions_csv,
    format_row_cells,
    make_prediction_row,
)
from stepblocks.predict.predictions import predict_and_drag_set
from stepblocks.predict.run import predict_set

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"
FOUR, MARGINS, TIPS, SHEATHS = (
    load_shipped(name) for name in ("paper-four", "crown-margins", "probe-tips", "sheaths")
)


@pytest.fixture(scope="module")
def four():
    return predict_and_drag_set(FOUR)


def test_file_rows_and_table_of_a_set_hold_the_same_figures(four):
    rows = list(csv.DictReader(io.StringIO(format_predictions_csv(four))))
    assert rows == [format_row_cells(make_prediction_row(one)) for one in four]
    frame = predict_set(FOUR)
    behind = ["jnd_to_next", "jnd_to_next_95_low", "jnd_to_next_95_high"]
    assert list(frame.columns) == [*rows[0], *behind]
    frame = frame[list(rows[0])]
    assert len(rows) == len(frame) == len(four)
    for name in frame.columns:
        for text, value in zip((row[name] for row in rows), frame[name], strict=True):
            if isinstance(value, str):
                assert text == value
            elif math.isnan(value):
                assert text == ""
            else:
                assert float(text) == pytest.approx(value, rel=1e-5)


def test_a_notebook_predicts_a_set_or_its_file():
    by_file = predict_set(str(STIMULI / "paper-four.toml"))
    pd.testing.assert_frame_equal(by_file, predict_set(FOUR))
    pd.testing.assert_frame_equal(stepblocks.predict_set(FOUR), by_file)
    with pytest.raises(StepblocksError):
        predict_set(STIMULI / "nowhere.toml")


def test_every_condition_of_the_grid_is_predicted_once_and_in_order(four):
    grid = FOUR.prediction
    expected = [
        (block.id, tip, friction, load)
        for block in FOUR.stimuli
        for tip in grid.tip_radii
        for friction in grid.frictions
        for load in grid.normal_loads
    ]
    assert [
        (p.stimulus, p.point.ball_radius, p.point.friction, p.point.normal_load) for p in four
    ] == expected


def test_each_prediction_is_its_counterface_under_its_operating_point(four):
    for p in (*four, *predict_and_drag_set(MARGINS)):
        release = p.face.release(p.point, p.backward)
        assert release.status is p.release.status
        assert release.angle == p.release.angle
        assert p.release.vibration_energy == pytest.approx(
            release.vibration_energy, rel=1e-15, nan_ok=True
        )
        assert p.drag_direction == p.face.ways[p.backward]
        assert isinstance(p.face, Step if p.drag_direction == "up" else Margin)


def test_the_nominal_lies_between_its_limits(four):
    for p in (*four, *predict_and_drag_set(MARGINS), *predict_and_drag_set(TIPS)):
        assert p.limits[0].angle <= p.release.angle <= p.limits[1].angle
        if all(one.status is Status.RELEASES for one in (p.release, *p.limits)):
            assert p.limits[0].pull_force <= p.release.pull_force <= p.limits[1].pull_force


def test_a_tip_brings_its_own_ball_to_the_steps_of_its_set():
    balls = {part.id: part.ball for part in TIPS.stimuli}
    for p in predict_and_drag_set(TIPS):
        assert p.point.ball_radius == balls[p.stimulus].nominal
        assert p.face.far_side in TIPS.prediction.step_heights
        # Origin: equation (2); a step as high as the ball is met at its riser
        share = min(p.face.far_side / p.point.ball_radius, 1.0)
        assert p.release.angle == pytest.approx(math.acos(1.0 - share))


def test_under_a_sheath_the_probe_has_the_spring_and_the_ring_of_that_sheath():
    for p in predict_and_drag_set(SHEATHS):
        part = next(part for part in SHEATHS.stimuli if part.id == p.stimulus)
        ring = SHEATHS.predict_ring(part)
        assert (p.point.tool.stiffness, p.point.tool.frequency) == (ring.stiffness, ring.frequency)
        assert str(p.limits[0]) == str(p.limits[1])  # the tolerances of a sheath move no angle


def test_further_columns_stand_behind(four):
    text = format_predictions_csv(four, lambda prediction: {"again": prediction.stimulus})
    rows = list(csv.DictReader(io.StringIO(text)))
    assert list(rows[0])[-1] == "again"
    assert all(row["again"] == row["stimulus"] for row in rows)


def test_a_terminal_is_shown_the_drawn_interval_of_the_energy_alone(four):
    columns = choose_terminal_columns(list(make_prediction_row(four[0])))
    assert {
        "vibration_energy_95_low_uj",
        "vibration_energy_95_high_uj",
        "status",
        "peak_force_n",
    } <= set(columns)
    assert not {"peak_force_low_n", "peak_force_95_high_n", "vibration_energy_low_uj"} & set(
        columns
    )


def test_a_row_has_energies_and_intervals_to_compare_unless_it_is_beyond_a_limit(four):
    for one in four:
        row, beyond = make_prediction_row(one), one.release.status.is_beyond_limit
        worst = [row[f"vibration_energy_{end}_uj"] for end in ("low", "high")]
        if one.release.status is Status.RELEASES and one.limits[1].status is Status.RELEASES:
            assert worst[0] < row["vibration_energy_uj"] < worst[1]
            assert row["intervals_agree"] in ("yes", "no")
        assert not beyond or (all(map(math.isnan, worst)) and row["intervals_agree"] == "")
    assert {one.release.status.is_beyond_limit for one in four} == {True, False}
