"""The model of a session: its design, its constants, what it shows of a drag, and how that answers
to scatter.
"""

import math

import numpy as np
import pytest

from stepblocks.contact.kernels import compute_edge_contact_angle, compute_height_at_angle
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.errors import ContactError
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.effects.release_motion import compute_log_excess_and_ring_share
from stepblocks.rig.forward import (
    BenchDesign,
    build_bench_design,
    build_extended_state,
    build_nominal_state,
    compute_channel_responses,
    list_fitted_constants,
    make_height_error_name,
    parse_tip_radius_um,
)
from stepblocks.rig.state import CHANNELS, compute_shown_channels

_ENERGY, _FORCE, _FRICTION, _SPRING, _RING, _DECAY, _LOAD = range(7)
_VALUES = {
    "friction": 0.17,
    "ln_conversion": math.log(0.23),
    "stiffness_ratio": 1.05,
    "ln_ring_frequency": math.log(290.0),
    "ln_decay_time": math.log(0.021),
}
_COLUMNS = {
    "height_um": np.array([20, 50, 70, 50]),
    "load_n": np.array([0.3, 0.8, 1.1, 0.5]),
    "speed_mm_s": np.array([2.0, 5.0, 10.0, 20.0]),
    "tip_radius_um": np.full(4, 120.0),
    "run_order": np.arange(1.0, 5.0),
}
_BLOCK = np.array(["step-020", "step-050", "step-070", "step-050"])


@pytest.fixture
def design():
    return build_bench_design(_BLOCK, _COLUMNS, 9500.0)


def _law(name):
    return next(law for law in list_named_laws() if law.id == name)


def test_columns_come_in_their_units_and_go_in_si(design):
    assert design.height == pytest.approx([20e-6, 50e-6, 70e-6, 50e-6])
    assert design.speed == pytest.approx([2e-3, 5e-3, 10e-3, 20e-3])
    assert design.tip_radius == pytest.approx(np.full(4, 120e-6))
    assert design.load.tolist() == [0.3, 0.8, 1.1, 0.5]
    assert design.covariates["run_order"].tolist() == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("name", "radius"),
    [("tip-90", 90.0), ("tip-62.5um", 62.5), (" tip-125 ", 125.0), ("blue", 120.0), ("nan", 120.0)],
)
def test_a_tip_has_the_radius_in_its_name_or_that_of_the_probe(name, radius):
    assert parse_tip_radius_um(name, 120.0) == radius


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["height", "load", "speed", "tip_radius", "spring_constant"])
def test_a_design_that_is_not_positive_and_finite_is_refused_by_name(name, bad):
    good = {name: np.ones(2) for name in ("height", "load", "speed", "tip_radius")} | {
        "spring_constant": 9810.0
    }
    spoiled = bad if name == "spring_constant" else np.array([1.0, bad])
    with pytest.raises(ContactError, match=name):
        BenchDesign(block=np.array(["a", "b"]), **(good | {name: spoiled}))


def test_a_design_without_trials_is_refused():
    with pytest.raises(ContactError, match="at least one trial"):
        build_bench_design(np.array([]), dict.fromkeys(_COLUMNS, np.array([])), 9500.0)


def test_a_fit_begins_at_the_tool_and_keeps_every_step_a_step(design):
    found = {
        p.name: p
        for p in list_fitted_constants(
            design, Tool(conversion=0.3, frequency=280.0, decay_time=0.03)
        )
    }
    begun = [
        math.exp(found[f"ln_{name}"].start)
        for name in ("conversion", "ring_frequency", "decay_time")
    ]
    assert begun == pytest.approx([0.3, 280.0, 0.03])
    assert found["friction"].start == PAPER.friction
    for p in found.values():
        assert p.low < p.start < p.high
    lowest = found[make_height_error_name("step-020")]
    # origin: a height error of 12 standard deviations, but no more than four fifths of the step
    assert (lowest.low, found[make_height_error_name("step-070")].high) == pytest.approx(
        (-12e-6, 12e-6)
    )
    thin = build_bench_design(
        np.array(["a"]),
        {k: v[:1] for k, v in (_COLUMNS | {"height_um": np.array([5.0])}).items()},
        9500.0,
    )
    assert list_fitted_constants(thin)[-1].low == pytest.approx(-4e-6)
    assert lowest.block == "step-020"


def test_a_height_error_moves_the_trials_of_its_block_alone(design):
    moved = build_nominal_state(design, _VALUES | {make_height_error_name("step-050"): 2e-6}).height
    assert moved - design.height == pytest.approx([0.0, 2e-6, 0.0, 2e-6])


def test_what_follows_the_peak_acts_when_all_else_has_acted(design):
    seen = []

    def noting(name, covariate):
        def apply(state, column, values):
            seen.append((name, None if column is None else np.asarray(column).copy()))
            return state.changed(load=state.load * (1.0 + values["share"]))

        return Law(
            name,
            name,
            (Parameter("share", "1", 0.0, -1.0, 1.0, 0.1),),
            apply,
            "normal_load",
            covariate,
        )

    laws = [noting("late", "peak_force_n"), noting("plain", "none")]
    state = build_extended_state(design, _VALUES, [(law, {"share": 0.1}) for law in laws])
    assert [name for name, _ in seen] == ["plain", "late"]
    nominal = build_nominal_state(design, _VALUES)
    assert seen[1][1] == pytest.approx(
        nominal.changed(load=nominal.load * 1.1).compute_peak_force()
    )
    assert state.load == pytest.approx(nominal.load * 1.21)


def test_an_effect_follows_its_column_or_the_block(design):
    worn = build_extended_state(design, _VALUES, [(_law("tip_wear"), {"growth_m_per_trial": 1e-7})])
    assert worn.radius == pytest.approx(120e-6 + 1e-7 * np.arange(1.0, 5.0))
    (error,) = list_named_laws(["step-050"])[-1:]
    assert build_extended_state(
        design, _VALUES, [(error, {"height_error_m": 3e-6})]
    ).height == pytest.approx(design.height + 3e-6 * (_BLOCK == "step-050"))


def test_scatter_shows_in_the_channels_as_the_equations_say(design):
    state = build_nominal_state(design, _VALUES)
    found = compute_channel_responses(state)
    total = compute_edge_contact_angle(design.height, design.tip_radius) + math.atan(0.17)
    # d ln tan(a + atan mu) / d ln mu
    by_friction = 0.17 / (np.sin(total) * np.cos(total)) / (1.0 + 0.17**2)
    assert found[:, _FORCE, 0] == pytest.approx(by_friction, rel=1e-3)
    assert found[:, _ENERGY, 0] == pytest.approx(2.0 * by_friction, rel=1e-3)
    assert found[:, _FRICTION, 0] == pytest.approx(np.full(4, 0.17), rel=1e-6)
    # load: once in the force, twice in the energy, and the gauge sees it; conversion: in the energy
    # alone
    assert found[:, [_FORCE, _ENERGY, _LOAD], 1] == pytest.approx(
        np.tile([1.0, 2.0, 1.0], (4, 1)), rel=1e-3
    )
    assert found[:, _ENERGY, 2] == pytest.approx(np.ones(4), rel=1e-3)
    others = [j for j in range(7) if j != _ENERGY]
    assert np.abs(found[:, others, 2]).max() < 1e-9


def test_a_locked_tip_is_reported_and_still_has_finite_channels(design):
    state = build_nominal_state(design, _VALUES | {"friction": 0.6})
    # origin: a + atan mu >= 90 deg at H = 70 um, R = 120 um, mu = 0.6 (65.4 + 31.0 deg) and at no
    # lower step
    assert state.mark_locked_trials().tolist() == [False, False, True, False]
    assert np.all(np.isfinite(compute_shown_channels(state)))
    assert compute_shown_channels(state).shape == (4, len(CHANNELS))


def test_a_step_as_high_as_the_ball_never_lets_go(design):
    state = build_nominal_state(design, _VALUES)
    assert state.changed(height=state.radius.copy()).mark_locked_trials().all()


def test_lost_energy_fades_out_and_never_turns_negative(design):
    state = build_nominal_state(design, _VALUES)
    whole = np.exp(compute_shown_channels(state)[:, _ENERGY])
    little = np.exp(compute_shown_channels(state.changed(lost_energy=0.5 * whole))[:, _ENERGY])
    assert little == pytest.approx(0.5 * whole)
    losses = np.linspace(0.0, 5.0, 60)
    left = np.stack(
        [
            compute_shown_channels(state.changed(lost_energy=loss * whole))[:, _ENERGY]
            for loss in losses
        ]
    )
    assert np.all(np.isfinite(left))
    assert np.all(np.diff(left, axis=0) < 0.0)


def test_a_gauge_of_first_order_shows_the_ring_smaller(design):
    lag = 4e-4
    slow = compute_shown_channels(build_nominal_state(design, _VALUES).changed(lag=np.full(4, lag)))
    short = (
        compute_shown_channels(build_nominal_state(design, _VALUES))[:, _ENERGY] - slow[:, _ENERGY]
    )
    # origin: the gain of a low pass of first order, squared
    assert np.exp(short) == pytest.approx(np.full(4, 1.0 + (2.0 * math.pi * 290.0 * lag) ** 2))


def test_ring_spring_and_damping_show_in_frequency_and_decay(design):
    state = build_nominal_state(design, _VALUES)
    moved = compute_shown_channels(
        state.changed(ring_stiffness=1.21 * state.ring_stiffness, damping=2.0 * state.damping)
    )
    assert np.exp(moved[:, _RING]) == pytest.approx(np.full(4, 290.0 * 1.1))
    assert np.exp(moved[:, _DECAY]) == pytest.approx(np.full(4, 0.021 / 2.0))
    # an amplitude of force counts with the nominal spring, whatever spring it rings with
    assert np.exp(moved[:, _ENERGY] - compute_shown_channels(state)[:, _ENERGY]) == pytest.approx(
        np.full(4, 1.21)
    )


def test_the_gauge_of_the_load_sees_an_offset_as_friction_and_as_load(design):
    state = build_nominal_state(design, _VALUES)
    moved = compute_shown_channels(state.changed(sensed_offset=0.1 * state.set_load))
    assert moved[:, _LOAD] == pytest.approx(np.full(4, 1.1))
    assert moved[:, _FRICTION] == pytest.approx(np.full(4, 0.17 / 1.1))


def test_the_spring_shown_is_that_of_the_ramp(design):
    assert compute_shown_channels(build_nominal_state(design, _VALUES))[
        :, _SPRING
    ] == pytest.approx(np.full(4, 1.05))


def test_changing_a_slot_leaves_the_state_it_came_from_alone(design):
    state = build_nominal_state(design, _VALUES)
    before = state.height.copy()
    state.changed(height=state.height + 1e-6)
    assert np.array_equal(state.height, before)


@pytest.mark.parametrize("height", [1e-9, 10e-6, 60e-6, 119e-6])
def test_height_and_critical_angle_are_inverse(height):
    assert compute_height_at_angle(
        compute_edge_contact_angle(height, 120e-6), 120e-6
    ) == pytest.approx(height, rel=1e-12)


def test_the_damper_takes_its_share_of_the_pull_in_proportion_to_the_speed(design):
    # while the tip is held the handle moves on at v: the damper 2 k / (omega^2 T) pulls c v
    state = build_nominal_state(design, _VALUES | {"damper_share": 0.7})
    omega = 2.0 * math.pi * 290.0
    damper = 2.0 * 9500.0 / (omega**2 * 0.021)
    assert state.climb_drag == pytest.approx(-0.7 * damper * np.array([2e-3, 5e-3, 10e-3, 20e-3]))


def test_a_release_in_motion_knows_no_unit_of_length_and_none_of_force(design):
    # lengths and speeds times a, forces times b, so stiffness times b / a
    def move(a, b, soft=1.0):
        state = build_nominal_state(design, _VALUES)
        state = state.changed(
            height=state.height * a,
            radius=state.radius * a,
            speed=state.speed * a,
            load=state.load * b,
            stiffness=state.stiffness * b / a / soft,
        )
        return _law("real_release").apply(state, None, {"weight": 1.0})

    one, other = move(1.0, 1.0), move(1.3, 1.7)
    assert one.climb_load.max() > 1e-3
    assert other.climb_load == pytest.approx(one.climb_load * 1.7, rel=1e-6)
    assert other.conversion == pytest.approx(one.conversion, rel=1e-6)
    # and it is no limit of a hard tool that is the same for all: k R / N counts
    softer = move(1.0, 1.0, soft=2.0)
    assert np.abs(softer.conversion / one.conversion - 1.0).min() > 0.01


def test_scanned_heights_become_tight_priors(design):
    found = {
        one.name: one
        for one in list_fitted_constants(design, scanned={"step-050": (50.6e-6, 15e-9)})
    }
    assert found[make_height_error_name("step-050")].start == pytest.approx(0.6e-6)
    assert found[make_height_error_name("step-050")].prior_std == pytest.approx(100e-9)
    assert found[make_height_error_name("step-020")].prior_std == pytest.approx(1e-6)


def test_a_bent_gauge_shows_the_ramp_as_steep_as_the_chord_of_its_curve(design):
    # origin: a gauge that shows F (1 + q F) shows e - s as (e - s) (1 + q (s + e))
    state = build_nominal_state(design, _VALUES)
    straight = compute_shown_channels(state)[:, _SPRING]
    bent = compute_shown_channels(state.changed(gauge_square=np.full(4, 0.05)))[:, _SPRING]
    s = state.compute_sliding_force()
    e = s + 0.9 * (state.compute_peak_force() - s)  # where the line through a ramp ends
    chord = (e + 0.05 * e**2 - s - 0.05 * s**2) / (e - s)
    assert bent / straight == pytest.approx(chord, rel=1e-12)


def test_a_normal_gauge_that_is_not_zeroed_shows_more_load_and_less_friction(design):
    moved = compute_shown_channels(
        _law("normal_zero").apply(
            build_nominal_state(design, _VALUES), None, {"normal_zero_n": 0.02}
        )
    )
    load = _COLUMNS["load_n"]
    assert moved[:, _LOAD] == pytest.approx((load + 0.02) / load)
    assert moved[:, _FRICTION] == pytest.approx(0.17 * load / (load + 0.02))


def test_a_release_in_motion_takes_the_mass_that_the_ring_tells(design):
    # origin: m = k / omega^2; what counts is k R / N, v sqrt(k m) / N and the share of critical
    # damping
    state = build_nominal_state(design, _VALUES)
    moved = _law("real_release").apply(state, None, {"weight": 1.0})
    mass = state.stiffness / (2.0 * math.pi * state.frequency) ** 2
    excess, share = compute_log_excess_and_ring_share(
        state.height / state.radius,
        state.friction,
        state.stiffness * state.radius / state.load,
        state.speed * np.sqrt(state.stiffness * mass) / state.load,
        1.0 / (2.0 * math.pi * state.frequency * state.decay_time),
        np.zeros(4),
    )
    assert moved.climb_load == pytest.approx(state.climb_load + state.load * np.expm1(excess))
    # where the motion rings with the paper's share, the conversion stays what it is
    assert moved.conversion == pytest.approx(
        state.conversion * np.exp(share) / PAPER.tool.conversion
    )


def test_a_gauge_with_loops_shows_a_ring_that_is_late_by_its_own_amplitude(design):
    # origin: loops after Rayleigh lag by 4 b A / 3 pi at a swing of A, which decays; a line through
    # the phase, each swing weighed by its energy, rises by what the lag falls meanwhile
    loops = 0.03
    state = build_nominal_state(design, _VALUES)
    plain = compute_shown_channels(state)
    shown = compute_shown_channels(state.changed(gauge_hysteresis=np.full(4, loops)))
    swing = np.sqrt(2.0 * state.nominal_stiffness * np.exp(plain[:, CHANNELS.index("ln_energy")]))
    decay = state.decay_time[0]
    time = np.linspace(0.0, 20.0 * decay, 200_001)
    fall = np.exp(-time / decay)
    lag = -4.0 / (3.0 * math.pi) * loops * fall
    slope = np.polyfit(time, lag, 1, w=fall)[0]  # the weights of polyfit count twice
    faster = slope * swing / (2.0 * math.pi * state.frequency)
    place = CHANNELS.index("ln_ring_frequency")
    assert faster.min() > 1e-5
    assert shown[:, place] - plain[:, place] == pytest.approx(faster, rel=1e-4)
