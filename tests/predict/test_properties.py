"""Laws that every table of predictions keeps: scales, order of rows and columns, units."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from stepblocks.predict.table import predict_table

SAID = ["critical_angle_deg", "peak_force_n", "vibration_energy_uj"]
# steps that release far from locking, so that a scaled or raised one does as well
rows = st.lists(
    st.fixed_dictionaries(
        {
            "height_um": st.floats(5.0, 50.0),
            "edge_radius_um": st.floats(0.0, 20.0),
            "tip_radius_um": st.floats(120.0, 200.0),
            "load_n": st.floats(0.1, 0.5),
            "friction": st.floats(0.01, 0.2),
        }
    ),
    min_size=1,
    max_size=3,
)
factors = st.floats(0.5, 2.0)
few = settings(max_examples=12)


def predict(table, **scaled):
    """Predict a table of which columns are multiplied; what is said of its rows."""
    table = pd.DataFrame(table)
    return predict_table(table.assign(**{name: table[name] * by for name, by in scaled.items()}))


@few
@given(rows, factors)
def test_forces_are_as_the_load_and_energies_as_its_square(table, by):
    once, scaled = predict(table), predict(table, load_n=by)
    ratios = (scaled[SAID] / once[SAID]).to_numpy()
    assert ratios == pytest.approx(np.tile([1.0, by, by * by], (len(table), 1)), rel=1e-9)


@few
@given(rows, factors)
def test_angles_and_forces_ask_for_no_unit_of_length(table, by):
    lengths = dict.fromkeys(("height_um", "edge_radius_um", "tip_radius_um"), by)
    once, scaled = predict(table), predict(table, **lengths)
    assert scaled[SAID].to_numpy() == pytest.approx(once[SAID].to_numpy(), rel=1e-7)


@few
@given(rows, factors, factors)
def test_energies_are_as_the_conversion_and_as_one_over_the_spring(table, share, stiffness):
    given_ones = [row | {"conversion": 0.2, "stiffness_n_m": 9810.0} for row in table]
    once = predict(given_ones)
    scaled = predict(given_ones, conversion=share, stiffness_n_m=stiffness)
    energy = once["vibration_energy_uj"] * share / stiffness
    assert scaled["vibration_energy_uj"].to_numpy() == pytest.approx(energy.to_numpy(), rel=1e-9)
    assert scaled["peak_force_n"].to_numpy() == pytest.approx(once["peak_force_n"], rel=1e-12)


@few
@given(rows, st.sampled_from(["height_um", "friction", "load_n"]), st.floats(1.01, 1.2))
def test_a_higher_step_more_friction_and_more_load_ask_for_more_pull(table, name, by):
    once, more = predict(table), predict(table, **{name: by})
    assert (more["peak_force_n"] > once["peak_force_n"]).all()


@few
@given(rows, st.sampled_from(["edge_radius_um", "tip_radius_um"]), st.floats(1.01, 1.5))
def test_a_rounder_edge_and_a_blunter_tip_ask_for_less_pull(table, name, by):
    assert (predict(table, **{name: by})["peak_force_n"] <= predict(table)["peak_force_n"]).all()


@few
@given(rows, st.randoms(use_true_random=False))
def test_neither_the_order_of_rows_nor_that_of_columns_changes_a_row(table, random):
    frame = predict(table)
    order, names = list(range(len(table))), list(table[0])
    random.shuffle(order)
    random.shuffle(names)
    mixed = predict([{name: table[place][name] for name in names} for place in order])
    for said in SAID:
        assert mixed[said].tolist() == frame[said][order].tolist()


@few
@given(rows)
def test_a_table_says_the_same_in_another_unit(table):
    frame = pd.DataFrame(table)
    other = pd.DataFrame(
        {
            "height_nm": frame["height_um"] * 1e3,
            "edge_radius_mm": frame["edge_radius_um"] * 1e-3,
            "tip_radius_m": frame["tip_radius_um"] * 1e-6,
            "load_mn": frame["load_n"] * 1e3,
        }
    ).assign(friction=frame["friction"])
    expected = predict_table(frame)[SAID].to_numpy()
    assert predict_table(other)[SAID].to_numpy() == pytest.approx(expected, rel=1e-7)
