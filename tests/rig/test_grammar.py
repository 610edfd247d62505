"""Composed laws: every shape in every slot over every covariate.

Shapes are compared with their formulas; what the search may not be fooled by stands here, too.
"""

import numpy as np
import pytest

from stepblocks.rig.effects.friction import FRICTION_LAWS
from stepblocks.rig.effects.geometry import make_exchange_law
from stepblocks.rig.effects.grammar.compose import list_composed_laws
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.grammar.slots import MAIN_SLOTS, SLOT_MOVES
from stepblocks.rig.effects.release_motion import compute_log_excess_and_ring_share
from stepblocks.rig.forward import build_bench_design, build_nominal_state
from stepblocks.rig.state import compute_shown_channels

_PLAIN = CovariateRange("temperature_c", 18.0, 26.0)
_WIDE = CovariateRange("load_n", 0.1, 1.6, True)
_FEW = CovariateRange("speed_mm_s", 2.0, 20.0, False, (), 3)
_TWO = CovariateRange("half", 0.0, 1.0, False, (), 2)
_LABELS = CovariateRange("operator", labels=("A", "B", "C"), distinct=3)


@pytest.fixture
def state():
    columns = {
        "height_um": [30.0] * 5,
        "load_n": [0.5] * 5,
        "speed_mm_s": [5.0] * 5,
        "tip_radius_um": [125.0] * 5,
    }
    values = {"friction": 0.15, "ln_conversion": -1.6, "stiffness_ratio": 1.0}
    design = build_bench_design(np.array(["b"] * 5), columns, 9810.0)
    return build_nominal_state(design, values | {"ln_ring_frequency": 5.7, "ln_decay_time": -4.0})


def test_a_range_is_laid_out_from_0_to_1_and_flat_beyond_it():
    assert _PLAIN.scale_to_unit(np.array([10.0, 18.0, 22.0, 26.0, 40.0])).tolist() == [
        0.0,
        0.0,
        0.5,
        1.0,
        1.0,
    ]
    # a decade is laid out by its logarithm: the middle of 0.1 to 1.6 is 0.4
    assert _WIDE.scale_to_unit(np.array([0.1, 0.4, 1.6, 0.0])) == pytest.approx(
        [0.0, 0.5, 1.0, 0.0]
    )


def test_a_line_goes_from_minus_one_to_one():
    assert _PLAIN.build_line_column(np.array([18.0, 22.0, 26.0])).ravel().tolist() == [
        -1.0,
        0.0,
        1.0,
    ]


def test_a_smooth_follows_every_cubic_of_its_covariate():
    # cubic B-splines of two pieces hold all cubics; with the constant of the nominal model they fit
    # any of them exactly
    x = np.linspace(18.0, 26.0, 60)
    basis = np.column_stack([np.ones(60), _PLAIN.build_smooth_columns(x)])
    assert np.linalg.matrix_rank(basis) == 5
    for power in range(4):
        target = (x - 22.0) ** power
        fitted = basis @ np.linalg.lstsq(basis, target, rcond=None)[0]
        assert fitted == pytest.approx(target, abs=1e-9)


def test_a_smooth_has_two_continuous_derivatives_where_its_pieces_meet():
    x = 22.0 + np.linspace(-0.02, 0.02, 401)
    second = np.diff(_PLAIN.build_smooth_columns(x), n=2, axis=0) / (x[1] - x[0]) ** 2
    assert np.abs(np.diff(second, axis=0)).max() < 1e-2 * np.abs(second).max() + 1e-5


def test_few_settings_take_powers_and_labels_take_one_column_each():
    assert _FEW.build_smooth_columns(np.array([2.0, 11.0, 20.0])).tolist() == [
        [-1.0, 1.0],
        [0.0, 0.0],
        [1.0, 1.0],
    ]
    # a label that the data had not is taken for the mean of all
    third = 1.0 / 3.0
    assert _LABELS.build_smooth_columns(np.array(["A", "B", "C", "D"])).tolist() == [
        [0, 0],
        [1, 0],
        [0, 1],
        [third, third],
    ]
    assert [place.smooth_column_count for place in (_PLAIN, _FEW, _TWO, _LABELS)] == [4, 2, 1, 2]


def test_every_slot_is_offered_over_every_covariate_as_a_line_where_that_differs_from_a_smooth():
    laws = list_composed_laws((_PLAIN, _TWO, _LABELS))
    smooths = [law for law in laws if law.id.startswith("smooth_")]
    trends = [law for law in laws if law.id.startswith("trend_")]
    assert len(smooths) == 3 * len(SLOT_MOVES)
    assert {law.covariate for law in trends} == {"temperature_c"}
    # of numbers jumps have a name, of labels levels and a force by which each presses
    jumps = ["step_friction_temperature_c", "step_conversion_temperature_c"]
    levels = ["smooth_friction_operator", "smooth_conversion_operator"]
    assert {law.id for law in laws if law.named} == {*jumps, *levels, "added_load_operator"}
    assert max(law.rank for law in trends) < min(law.rank for law in smooths)
    for law in laws:
        # where something changes is its shape
        shape = {"at"} & {p.name for p in law.parameters}
        assert set(law.amplitudes) == {p.name for p in law.parameters} - shape


def test_a_trend_of_friction_is_a_factor_over_the_range(state):
    law = next(
        law for law in list_composed_laws((_PLAIN,)) if law.id == "trend_friction_temperature_c"
    )
    moved = law.apply(state, np.array([18.0, 20.0, 22.0, 24.0, 26.0]), {"slope": 0.2})
    assert np.log(moved.friction / state.friction) == pytest.approx(
        [-0.2, -0.1, 0.0, 0.1, 0.2], abs=1e-12
    )


def test_a_law_asked_with_another_column_forgets_the_first(state):
    law = next(
        law for law in list_composed_laws((_PLAIN,)) if law.id == "trend_conversion_temperature_c"
    )
    hot, cold = (law.apply(state, np.full(5, t), {"slope": 0.3}).conversion for t in (26.0, 18.0))
    assert np.log(hot / cold) == pytest.approx(np.full(5, 0.6))


def test_ways_into_one_slot_differ_in_what_the_bench_shows(state):
    def shown(name):
        return (
            compute_shown_channels(SLOT_MOVES[name].change(state, np.full(5, 0.1)))[0]
            - compute_shown_channels(state)[0]
        )

    # unseen by the gauge, the load ratio stays; a load while climbing leaves the sliding friction
    # alone
    assert shown("load")[6] == pytest.approx(0.0, abs=1e-12)
    assert shown("seen_load")[6] == pytest.approx(np.expm1(0.1))
    assert shown("climb_load")[2] == pytest.approx(0.0, abs=1e-12)
    # energies weighed with the spring fall by its factor
    assert shown("stiffness")[0] - shown("weighed_stiffness")[0] == pytest.approx(0.1)
    assert shown("ramp_stiffness")[4] == pytest.approx(0.0, abs=1e-12)
    assert shown("stiffness")[4] == pytest.approx(0.05)
    assert shown("gain")[:2] == pytest.approx([0.2, 0.1])


def test_a_step_as_high_as_the_ball_counts_as_the_highest_that_a_fit_may_stray_to():
    same = np.ones(2)
    far = compute_log_excess_and_ring_share(
        np.array([0.97, 1.4]), 0.16 * same, 2.0 * same, 0.05 * same, 0.025 * same, 0.0 * same
    )
    assert far[0][0] == far[0][1]
    assert far[1][0] == far[1][1]


@pytest.mark.parametrize(
    ("height", "stiffness"), [(0.16, 2.0), (0.24, 2.5), (0.4, 1.1), (0.64, 4.0)]
)
def test_a_release_is_continuous_in_its_friction(height, stiffness):
    # a step of the integration is no step of the answer: a fit takes differences over such changes
    friction = 0.15 + 1e-6 * np.arange(200)
    same = np.ones(200)
    for figure in compute_log_excess_and_ring_share(
        height * same, friction, stiffness * same, 0.05 * same, 0.025 * same, 0.0 * same
    ):
        assert np.ptp(np.diff(figure)) < 5e-4


def test_smooths_are_zero_in_the_middle_and_flat_beyond_the_range():
    place = CovariateRange("temperature_c", 18.0, 26.0)
    assert np.allclose(place.build_smooth_columns(np.array([22.0])), 0.0)
    assert np.array_equal(
        place.build_smooth_columns(np.array([26.0])), place.build_smooth_columns(np.array([40.0]))
    )


def test_levels_are_named_by_every_label_but_the_first():
    law = next(
        law for law in list_composed_laws((_LABELS,)) if law.id == "smooth_friction_operator"
    )
    assert [one.name for one in law.parameters] == ["g[B]", "g[C]"]


@pytest.mark.parametrize(("trials", "shortest"), [(240.0, 6.0), (4000.0, 16.0)])
def test_swings_are_tried_half_a_turn_apart_down_to_six_trials_or_250_turns(trials, shortest):
    run = CovariateRange("run_order", 0.0, trials)
    (law,) = (law for law in list_composed_laws((run,)) if law.id == "periodic_friction_run_order")
    periods = np.array([shape["period_trials"] for shape in law.shapes])
    assert np.diff(2.0 * trials / periods) == pytest.approx(1.0)
    # what is seen to rise and fall but once need not come back
    assert periods[0] == pytest.approx(trials / 1.5)
    assert law.parameters[-1].high < trials
    assert periods[-1] == pytest.approx(shortest)


_RUN = CovariateRange("run_order", 1.0, 241.0)
_LOAD = CovariateRange("load_n", 0.4, 1.6, False, (), 4)
_GROUPED = CovariateRange("operator * load_n", pair=(_LABELS, _LOAD))
_EVERYWHERE = (_RUN, _PLAIN, _LOAD, _LABELS, _GROUPED)


@pytest.fixture(scope="module")
def composed():
    return {law.id: law for law in list_composed_laws(_EVERYWHERE)}


def size(law, column, **values):
    return law.apply.size(np.asarray(column), values)


def test_every_shape_is_offered_in_every_main_slot_or_has_a_name_of_its_own_there(composed):
    offered = {(law.slot, law.shape) for law in composed.values()}
    assert {law.shape for law in composed.values()} == {
        *("", "line", "levels", "power", "reciprocal", "settling", "threshold", "saturation"),
        *("jump", "pulse", "swing", "group_lines"),
    }
    for slot in {SLOT_MOVES[move].slot for move in MAIN_SLOTS}:
        missing = [
            shape
            for shape in ("line", "levels", "power", "reciprocal", "threshold", "group_lines")
            if (slot, shape) not in offered
        ]
        assert missing == [], slot


def test_no_two_composed_laws_share_an_id_and_each_that_claims_has_words(composed):
    assert len(composed) == len(list_composed_laws(_EVERYWHERE))
    silent = [
        law.id for law in composed.values() if (law.named or law.shape) and not law.description
    ]
    assert silent == []


def test_each_shape_is_its_formula(composed):
    run = np.array([1.0, 61.0, 121.0, 241.0])
    load = np.array([0.4, 0.8, 1.6])
    # the middle of 0.4 to 1.6 by logarithms is 0.8
    assert size(composed["trend_stiffness_load_n~power"], load, exponent=0.5) == pytest.approx(
        0.5 * np.log(load / 0.8)
    )
    assert size(composed["trend_friction_load_n~reciprocal"], load, share=0.3) == pytest.approx(
        0.3 * (0.8 / load - 1.0)
    )
    settling = composed["trend_zero_run_order~settling"]
    assert size(settling, run, excess=2.0, settling_trials=30.0) == pytest.approx(
        2.0 * np.exp(-(run - 1.0) / 30.0)
    )
    threshold = composed["trend_gain_run_order~threshold"]
    assert size(threshold, run, rise=0.4, at=121.0).tolist() == [0.0, 0.0, 0.0, 0.4]
    saturation = composed["trend_gain_run_order~saturation"]
    assert size(saturation, run, rise=0.4, at=121.0).tolist() == [0.0, 0.2, 0.4, 0.4]
    pulse = composed["step_stiffness_run_order~pulse"]
    assert size(pulse, run, step=0.1, from_trial=50.0, until_trial=200.0) == pytest.approx(
        [0.0, 0.1, 0.1, 0.0]
    )


def test_a_jump_between_two_readings_leaves_both_at_their_levels():
    # 25 trials and 1,000 alike: the change is as wide as readings are apart
    for trials in (25, 1000):
        run = np.arange(1.0, trials + 1.0)
        covariate = CovariateRange("run_order", 1.0, float(trials), distinct=trials)
        law = {law.id: law for law in list_composed_laws((covariate,))}["step_zero_run_order"]
        shown = size(law, run, step=0.7, at_trial=10.5)
        assert shown.tolist() == [0.0] * 10 + [0.7] * (trials - 10)


def test_over_a_decade_a_line_stands_beside_the_power():
    speed = np.array([2.0, 6.5, 11.0, 20.0])
    wide = CovariateRange("speed_mm_s", 2.0, 20.0, True, (), 4)
    pair = CovariateRange("operator * speed_mm_s", pair=(_LABELS, wide))
    laws = {law.id: law for law in list_composed_laws((wide, pair))}
    line = laws["trend_stiffness_speed_mm_s~line"]
    assert line.shape == "line"
    assert size(line, speed, slope=0.1) == pytest.approx([-0.1, -0.05, 0.0, 0.1])
    power = laws["trend_stiffness_speed_mm_s"]
    assert power.shape == "power"
    expected = 0.1 * np.log(speed / np.sqrt(40.0)) / np.log(np.sqrt(10.0))
    assert size(power, speed, slope=0.1) == pytest.approx(expected)
    of_labels = laws["trend_stiffness_operator * speed_mm_s~line"]
    column = np.array([["A", "2"], ["A", "11"], ["B", "20"]])
    values = {f"slope[{label}]": 0.1 for label in "ABC"} | {"level[B]": 0.0, "level[C]": 0.0}
    assert of_labels.apply.size(column, values) == pytest.approx([-0.1, 0.0, 0.1])
    # each is written by what it is straight over
    for stem in ("trend_stiffness_speed_mm_s", "trend_stiffness_operator * speed_mm_s"):
        assert "g a straight line over ln speed_mm_s" in laws[stem].form
        assert "g a straight line over speed_mm_s" in laws[f"{stem}~line"].form


def test_a_number_acts_under_each_label_by_itself(composed):
    law = composed["trend_seen_load_operator * load_n"]
    column = np.array([["A", "0.4"], ["A", "1.6"], ["B", "1.6"], ["C", "1.0"]])
    values = {"slope[A]": 0.1, "slope[B]": 0.2, "slope[C]": 0.3, "level[B]": 1.0, "level[C]": 2.0}
    # from -1 to 1 over the range; B and C stand above A by their levels
    assert law.apply.size(column, values) == pytest.approx([-0.1, 0.1, 1.2, 2.0])
    # whoever follows the load for each operator has not found another place than the load
    assert law.refines == ("operator", "load_n")


def test_what_is_set_moves_no_zero_of_a_gauge(composed):
    assert "trend_zero_temperature_c" in composed
    assert "trend_zero_load_n" not in composed


def test_exchanged_blocks_move_by_the_difference_of_their_heights(state):
    law = make_exchange_law("step-040", "step-050")
    blocks = np.array(["step-040", "step-050", "step-060", "step-040", "step-050"])
    moved = law.apply(state, blocks, {"difference_m": 10e-6})
    assert (moved.height - state.height) * 1e6 == pytest.approx([10.0, -10.0, 0.0, 10.0, -10.0])


def test_adhesion_adds_a_force_that_no_load_makes(state):
    law = next(law for law in FRICTION_LAWS if law.id == "adhesive_friction")
    moved = law.apply(state, None, {"adhesion_n": 0.05})
    # origin: F = mu N + A, after Derjaguin (1934, doi:10.1007/BF01333114)
    assert moved.friction * 0.5 == pytest.approx(state.friction * 0.5 + 0.05)
