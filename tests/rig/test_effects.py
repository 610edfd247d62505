"""Effects: each vanishes at its start, changes its slot alone, and keeps the limits of its law."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from oracles.learned import CONSTANTS
from stepblocks.contact.critical_angle import find_step_angle
from stepblocks.contact.energy import find_release
from stepblocks.lawsearch.law import Law
from stepblocks.rig.effects.grammar.compose import list_composed_laws
from stepblocks.rig.effects.grammar.covariates import CovariateRange
from stepblocks.rig.effects.named import list_named_laws
from stepblocks.rig.forward import (
    BenchDesign,
    build_nominal_state,
)
from stepblocks.rig.state import CHANNELS, DragState, compute_shown_channels

_ENERGY, _FORCE, _FRICTION, _SPRING, _RING, _DECAY, _LOAD = range(7)
_RANGES = (
    CovariateRange("temperature_c", 18.0, 26.0),
    CovariateRange("speed_mm_s", 2.0, 20.0, True, (), 4),
    CovariateRange("operator", labels=("A", "B"), distinct=2),
)


def _design() -> BenchDesign:
    n = 24
    return BenchDesign(
        block=np.array(["step-020", "step-050", "step-070"] * 8),
        height=np.array([20e-6, 50e-6, 70e-6] * 8),
        load=np.repeat([0.3, 0.8, 1.1, 0.5], 6),
        speed=np.tile([2e-3, 5e-3, 10e-3, 20e-3], 6),
        tip_radius=np.full(n, 120e-6),
        spring_constant=9500.0,
    )


def _state() -> DragState:
    return build_nominal_state(_design(), CONSTANTS)


def _covariate(law: Law, state: DragState) -> object:
    n = len(state.height)
    columns = {
        "run_order": np.arange(1.0, n + 1.0),
        "temperature_c": np.linspace(19.0, 25.0, n),
        "speed_mm_s": state.speed * 1e3,
        "load_n": state.set_load,
        "operator": np.array(["A", "B"] * (n // 2)),
        "block": _design().block,
        "passes_of_block": np.arange(n) // 3 + 1.0,
        "trials_since_rest": np.arange(n) % 5 + 0.0,
        "previous_load_n": np.roll(state.set_load, 1),
        "speed_mm_s / load_n": state.speed * 1e3 / state.set_load,
        "peak_force_n": state.compute_peak_force(),
    }
    return columns.get(law.covariate)


def _all_laws() -> tuple[Law, ...]:
    return (*list_named_laws(["step-050"]), *list_composed_laws(_RANGES))


def _changed(law: Law, **values: float) -> np.ndarray:
    state = _state()
    neutral = {p.name: p.start for p in law.parameters} | dict(law.shapes[0])
    return compute_shown_channels(
        law.apply(state, _covariate(law, state), neutral | values)
    ) - compute_shown_channels(state)


@pytest.mark.parametrize("law", _all_laws(), ids=lambda law: law.id)
def test_every_law_vanishes_at_its_start_and_moves_something_beside_it(law: Law) -> None:
    assert np.allclose(_changed(law), 0.0, atol=1e-12)
    for name in law.amplitudes:
        parameter = next(p for p in law.parameters if p.name == name)
        moved = _changed(law, **{name: parameter.start + parameter.scale})
        assert np.all(np.isfinite(moved))
        assert np.max(np.abs(moved)) > 1e-6


@pytest.mark.parametrize("law", _all_laws(), ids=lambda law: law.id)
def test_a_slot_shows_only_in_its_channels(law: Law) -> None:
    parameter = next(p for p in law.parameters if p.name == law.amplitudes[-1])
    moved = (
        np.max(np.abs(_changed(law, **{parameter.name: parameter.start + parameter.scale})), axis=0)
        > 1e-9
    )
    seen = {
        # a tilt shows in the sliding force as well, and a contact that gives way in the ramp
        "contact_geometry": {
            _ENERGY,
            _FORCE,
            _SPRING if law.id.startswith("elastic") else _FRICTION,
        },
        "friction": {_ENERGY, _FORCE, _FRICTION},
        "normal_load": {_ENERGY, _FORCE, _FRICTION, _LOAD},
        # what rubs in a warm spring may die away otherwise
        "stiffness": {_ENERGY, _SPRING, _RING, _DECAY},
        "conversion": {_ENERGY, _FORCE} if law.id == "real_release" else {_ENERGY},
        "drag": {_ENERGY, _FORCE, _FRICTION},
        "ring": {_RING, _DECAY},
        "sensor": {_ENERGY, _FORCE, _FRICTION, _SPRING, _RING, _DECAY, _LOAD},
    }[law.slot]
    assert set(np.flatnonzero(moved).tolist()) <= seen


def test_identifiers_are_unique() -> None:
    names = [law.id for law in _all_laws()]
    assert len(set(names)) == len(names)


def test_the_nominal_channels_are_equations_one_and_two() -> None:
    shown = compute_shown_channels(_state())
    design = _design()
    for i in range(len(design.block)):
        angle = find_step_angle(float(design.height[i]), 120e-6)
        one = find_release(angle, float(design.load[i]), 0.17)
        assert shown[i, _FORCE] == pytest.approx(math.log(one.pull_force), abs=1e-12)
        energy = 0.23 * one.pull_force**2 / 2.0 / (1.05 * 9500.0)
        assert shown[i, _ENERGY] == pytest.approx(math.log(energy), abs=1e-12)
    assert shown[:, _FRICTION] == pytest.approx(np.full(24, 0.17))
    assert len(CHANNELS) == shown.shape[1]


def _law(name: str) -> Law:
    return next(law for law in list_named_laws() if law.id == name)


def test_tilt_is_friction_tan_of_atan_mu_plus_tilt() -> None:
    tilted = compute_shown_channels(_law("block_tilt").apply(_state(), None, {"tilt_rad": 0.03}))
    other = build_nominal_state(
        _design(), CONSTANTS | {"friction": math.tan(math.atan(0.17) + 0.03)}
    )
    assert np.allclose(tilted, compute_shown_channels(other), atol=1e-12)


def test_friction_by_speed_over_load_is_its_formula() -> None:
    # origin: mu (1 + s exp(-(v / F) / h)), written out for one trial
    state = _state()
    ratio = state.speed[1] / state.set_load[1]
    values = {"excess": 0.8, "number": 7e-3}
    law = _law("hersey_friction")
    shown = compute_shown_channels(law.apply(state, _covariate(law, state), values))
    assert shown[1, _FRICTION] == pytest.approx(0.17 * (1.0 + 0.8 * math.exp(-ratio / 7e-3)))
    power = _law("hersey_friction~power")
    shown = compute_shown_channels(power.apply(state, _covariate(power, state), {"exponent": 0.2}))
    assert shown[1, _FRICTION] == pytest.approx(0.17 * (ratio / 0.01) ** -0.2)


def test_a_spring_that_softens_rings_lower_and_keeps_the_energy_that_is_read() -> None:
    # E_v is A^2 / 2k with the declared k, and A^2 goes as F^2: no softening shows in it
    law, state = _law("softening_spring"), _state()
    celsius = np.full(24, 25.0)
    values = {"softening_per_k": 0.02, "damping_power": 0.5}
    moved = compute_shown_channels(law.apply(state, celsius, values)) - compute_shown_channels(
        state
    )
    left = 1.0 - 3.0 * 0.02
    assert moved[:, _ENERGY] == pytest.approx(np.zeros(24), abs=1e-12)
    assert moved[:, _SPRING] == pytest.approx(np.full(24, 1.05 * (left - 1.0)))
    assert moved[:, _RING] == pytest.approx(np.full(24, 0.5 * math.log(left)))
    # a damper of constant ratio: the time constant goes with one over the pitch
    assert moved[:, _DECAY] == pytest.approx(np.full(24, -0.5 * math.log(left)))


def test_edge_and_tip_add_to_one_radius() -> None:
    edge = _law("edge_rounding").apply(_state(), None, {"edge_radius_m": 14e-6})
    tip = _law("tip_radius_error").apply(_state(), None, {"radius_error_m": 14e-6})
    assert np.array_equal(compute_shown_channels(edge), compute_shown_channels(tip))
    angle = find_step_angle(50e-6, 120e-6, 14e-6)
    one = find_release(angle, float(edge.set_load[1]), 0.17)
    assert compute_shown_channels(edge)[1, _FORCE] == pytest.approx(
        math.log(one.pull_force), abs=1e-12
    )


@pytest.mark.parametrize(
    ("law", "power"), [("elastic_indentation", 2.0 / 3.0), ("elastic_indentation~linear", 1.0)]
)
def test_a_contact_that_gives_way_takes_what_the_edge_bears_and_not_the_weight(
    law: str, power: float
) -> None:
    state, depth, friction = _state(), 0.4e-6, 0.17

    def pull(height: float, radius: float, load: float, per_newton: float) -> float:
        # origin: forces on the ball as its last weight leaves the floor, solved together with the
        # depth at the edge
        def slope(dent: float) -> float:
            return math.acos((radius - height) / (radius - dent))

        def borne(dent: float) -> float:
            return load / (math.cos(slope(dent)) - friction * math.sin(slope(dent)))

        dent = (
            brentq(lambda d: d - per_newton * borne(d) ** power, 0.0, 0.5 * height)
            if per_newton
            else 0.0
        )
        return borne(dent) * (math.sin(slope(dent)) + friction * math.cos(slope(dent)))

    cases = list(
        zip(state.height.tolist(), state.radius.tolist(), state.load.tolist(), strict=True)
    )
    exact = [math.log(pull(*case, depth) / pull(*case, 0.0)) for case in cases]
    shown = np.log(
        _law(law).apply(state, state.set_load, {"depth_at_1n_m": depth}).compute_peak_force()
        / state.compute_peak_force()
    )
    assert shown == pytest.approx(exact, rel=0.04)


def test_floor_and_edge_give_way_in_series_with_the_spring() -> None:
    state, depth = _state(), 0.6e-6
    shown = compute_shown_channels(
        _law("elastic_indentation~linear").apply(state, state.set_load, {"depth_at_1n_m": depth})
    )
    for n, (height, radius) in enumerate(
        zip(state.height.tolist(), state.radius.tolist(), strict=True)
    ):
        # origin: a point held by two springs, one upright and one along the line from edge to
        # centre, pulled level
        cosine = 1.0 - height / radius
        across = np.array([-math.sqrt(1.0 - cosine**2), cosine])
        stiffness = (np.outer(across, across) + np.diag([0.0, 1.0])) / depth
        level = float(np.linalg.inv(stiffness)[0, 0])
        spring = 1.05 * 9500.0
        assert shown[n, _SPRING] == pytest.approx(1.0 / (1.0 / spring + level) / 9500.0, rel=1e-9)


def test_gain_squared_conversion_and_stiffness_act_on_energy_as_one_product() -> None:
    gain = compute_shown_channels(_law("sensor_gain").apply(_state(), None, {"ln_gain": 0.1}))[
        :, _ENERGY
    ]
    conversion = compute_shown_channels(
        build_nominal_state(_design(), CONSTANTS | {"ln_conversion": math.log(0.23) + 0.2})
    )[:, _ENERGY]
    stiffness = compute_shown_channels(
        build_nominal_state(_design(), CONSTANTS | {"stiffness_ratio": 1.05 * math.exp(-0.2)})
    )[:, _ENERGY]
    assert gain == pytest.approx(conversion, abs=1e-12)
    assert gain == pytest.approx(stiffness, abs=1e-12)


def test_hardening_stores_the_integral_of_its_own_force() -> None:
    state = _law("hardening_spring").apply(
        _state(), None, {"cubic_per_n2": 0.2, "pitch_share": 0.0}
    )
    force = state.compute_peak_force()
    # origin: the real root of u + g u^3 = F, by numpy's companion matrix
    roots = [np.roots([0.2, 0.0, 1.0, -f]) for f in force]
    linear = np.array([float(r[np.abs(r.imag) < 1e-9].real[0]) for r in roots])
    k = 1.05 * 9500.0
    x = np.linspace(0.0, 1.0, 20001)[:, None] * linear / k
    integral = np.trapezoid(k * x + 0.2 * (k * x) ** 3, x, axis=0)
    # what rings shows as the force at the amplitude that holds that energy about the level it rings
    # about
    rest = np.array(
        [
            float(r[np.abs(r.imag) < 1e-9].real[0])
            for r in (np.roots([0.2, 0, 1, -0.17 * n]) for n in state.load)
        ]
    )
    level = 1.0 + 3.0 * 0.2 * rest**2
    swing = [
        np.roots([0.05, 0.0, 0.5 * c, 0.0, -0.23 * e * 9500.0])
        for c, e in zip(level, integral, strict=True)
    ]
    size = np.array([float(r[(np.abs(r.imag) < 1e-9) & (r.real > 0)].real[0]) for r in swing])
    shown = (level * size + 0.2 * size**3) ** 2 / 2.0 / 9500.0
    assert np.exp(compute_shown_channels(state)[:, _ENERGY]) == pytest.approx(shown, rel=1e-6)


def test_zeros_and_cross_talk_enter_no_energy_and_move_the_readings_by_themselves() -> None:
    nominal = compute_shown_channels(_state())
    shown = np.exp(nominal[:, _FORCE])
    zero = compute_shown_channels(_law("tangential_zero").apply(_state(), None, {"zero_n": 0.02}))
    cross = compute_shown_channels(_law("cross_talk").apply(_state(), None, {"cross_talk": 0.03}))
    for moved, added in ((zero, 0.02), (cross, 0.03 * _state().set_load)):
        assert moved[:, _ENERGY] == pytest.approx(nominal[:, _ENERGY], abs=1e-12)
        assert np.exp(moved[:, _FORCE]) - shown == pytest.approx(added)
        assert moved[:, _FRICTION] - nominal[:, _FRICTION] == pytest.approx(
            added / _state().set_load
        )
    gain = compute_shown_channels(
        _law("normal_gain").apply(_state(), None, {"normal_ln_gain": math.log(0.96)})
    )
    assert gain[:, _LOAD] == pytest.approx(np.full(24, 0.96))
    assert gain[:, _FRICTION] == pytest.approx(np.full(24, 0.17 / 0.96))
    assert gain[:, :2] == pytest.approx(nominal[:, :2])


def test_cross_talk_shows_the_pull_on_the_normal_gauge_and_a_fast_clock_slows_what_is_timed() -> (
    None
):
    nominal = compute_shown_channels(_state())
    cross = compute_shown_channels(
        _law("normal_cross_talk").apply(_state(), None, {"normal_cross_talk": 0.05})
    )
    # origin: before the edge the pull is mu times the load
    assert cross[:, _LOAD] == pytest.approx(nominal[:, _LOAD] + 0.05 * 0.17)
    assert cross[:, :2] == pytest.approx(nominal[:, :2])
    late = compute_shown_channels(_law("clock").apply(_state(), None, {"ln_clock": math.log(1.01)}))
    # the slope of the ramp is per second, the ring has its cycles per second, the decay its seconds
    assert late[:, _SPRING] == pytest.approx(nominal[:, _SPRING] / 1.01)
    assert late[:, _DECAY] - nominal[:, _DECAY] == pytest.approx(np.full(24, math.log(1.01)))
    assert nominal[:, _RING] - late[:, _RING] == pytest.approx(np.full(24, math.log(1.01)))


def test_friction_on_the_edge_moves_the_peak_and_not_the_sliding_force() -> None:
    edge = compute_shown_channels(
        _law("edge_friction").apply(_state(), None, {"edge_over_face": 0.8})
    )
    other = compute_shown_channels(
        build_nominal_state(_design(), CONSTANTS | {"friction": 0.8 * 0.17})
    )
    assert edge[:, [_ENERGY, _FORCE]] == pytest.approx(other[:, [_ENERGY, _FORCE]])
    assert edge[:, _FRICTION] == pytest.approx(np.full(24, 0.17))


def test_a_hardening_ramp_is_as_steep_as_the_line_through_it() -> None:
    state = _law("hardening_spring").apply(
        _state(), None, {"cubic_per_n2": 0.2, "pitch_share": 0.0}
    )
    force, sliding = state.compute_peak_force(), state.compute_sliding_force()
    # origin: numpy's least-squares line through nine tenths of the ramp from sliding
    for i in (0, 7, 20):
        low, top = (
            float(r[np.abs(r.imag) < 1e-9].real[0])
            for r in (np.roots([0.2, 0, 1, -f]) for f in (sliding[i], force[i]))
        )
        u = np.linspace(low, low + 0.9 * (top - low), 20001)
        assert compute_shown_channels(state)[i, _SPRING] == pytest.approx(
            1.05 * np.polyfit(u, u + 0.2 * u**3, 1)[0], rel=1e-5
        )


def test_running_in_is_forgotten_in_the_end() -> None:
    law = _law("running_in")
    late = law.apply(_state(), np.full(24, 1e4), {"excess": 0.9, "settling_trials": 45.0})
    first = law.apply(_state(), np.zeros(24), {"excess": 0.9, "settling_trials": 45.0})
    assert late.friction == pytest.approx(np.full(24, 0.17))
    assert first.friction == pytest.approx(np.full(24, 0.17 * 1.9))


def test_a_slow_gauge_loses_what_the_ramp_makes_in_its_time_constant() -> None:
    law = _law("sensor_bandwidth")
    state = law.apply(_state(), None, {"time_constant_s": 1e-5})
    lost = np.exp(compute_shown_channels(_state())[:, _FORCE]) - np.exp(
        compute_shown_channels(state)[:, _FORCE]
    )
    # a ramp long against the time constant lags by slope times constant
    assert lost == pytest.approx(1.05 * 9500.0 * state.speed * 1e-5, rel=1e-3)


def test_the_ring_of_a_spring_that_a_fit_bends_too_far_keeps_a_frequency() -> None:
    # the ends of the limits of both parameters, and more of a ring than a spring can hold
    ringing = _state().changed(conversion=np.full(24, 4.0))
    limits = {"cubic_per_n2": 5.0, "pitch_share": -0.5}
    state = _law("hardening_spring").apply(ringing, None, limits)
    assert np.isfinite(compute_shown_channels(state)).all()


def test_a_spring_that_hardens_rings_as_fast_as_duffings_oscillator() -> None:
    # no friction, so that it rings about the unloaded spring
    values = CONSTANTS | {"friction": 0.0}
    nominal = build_nominal_state(_design(), values)
    cubic = 0.05
    state = _law("hardening_spring").apply(
        nominal, None, {"cubic_per_n2": cubic, "pitch_share": 1.0}
    )
    shown = compute_shown_channels(state)
    # the energy is shown as the force at the amplitude
    force = np.sqrt(2.0 * 9500.0 * np.exp(shown[:, _ENERGY]))
    roots = [np.roots([cubic, 0.0, 1.0, -one]) for one in force]
    amplitude = np.array([float(r[np.abs(r.imag) < 1e-9].real[0]) for r in roots])
    # origin: the exact period of x'' + x + g x^3 = 0 by its integral over the phase
    phase = np.linspace(0.0, 0.5 * np.pi, 20001)
    size = 0.5 * cubic * amplitude[:, None] ** 2
    inverse = 1.0 / np.sqrt(1.0 + size * (1.0 + np.sin(phase) ** 2))
    period = np.trapezoid(inverse, phase, axis=1) / (0.5 * np.pi)
    higher = shown[:, _RING] - compute_shown_channels(nominal)[:, _RING]
    assert cubic * amplitude.max() ** 2 > 0.02
    assert higher == pytest.approx(-np.log(period), rel=0.01)
