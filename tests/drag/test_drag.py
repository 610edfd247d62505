"""The drag in time: limits, conservation, convergence, sticking.

And the paper's figures in kind.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from oracles.snap import snap_load
from oracles.tip_paths import step_path
from stepblocks.contact.critical_angle import find_margin_angles, find_step_angle
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.operating_point import Tool
from stepblocks.drag.plan import choose_time_step_and_bristles
from stepblocks.drag.probe import PAPER_DRAG, DragSettings, build_probe_of_tool
from stepblocks.drag.ring import (
    LOADING_BAND,
    RING_BAND,
    compute_phase_spectrum,
    compute_spectral_band_share,
    measure_ring,
)
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.track import build_profile_track, build_step_track
from stepblocks.errors import ContactError

R = 125e-6
STIFF = replace(PAPER_DRAG, contact_power=1.0, contact_stiffness=3e8, damping_ratio=0.05)
"""A contact that gives 3 nm under 1 N, for limits in which the equations know no compliance."""


# Expected value: equation (1).
@pytest.mark.parametrize(
    ("height", "load", "mu"), [(10e-6, 1.3, 0.12), (31e-6, 0.7, 0.21), (60e-6, 0.4, 0.08)]
)
def test_the_peak_tends_to_equation_one_as_the_speed_falls_and_the_contact_hardens(
    height, load, mu
):
    formula = find_release(find_step_angle(height, R), load, mu).pull_force
    errors = []
    for speed in (5e-3, 1e-3, 0.1e-3):
        settings = DragSettings(load, mu, speed=speed, ring_time=1e-3, lead=2e-6)
        errors.append(
            simulate_drag(build_step_track(height, R), STIFF, settings).peak_force / formula - 1.0
        )
    # the edge stops the tip and sets the spring ringing with v sqrt(k m); the slip takes time: both
    # go with the speed
    assert abs(errors[2]) < 2e-3
    assert abs(errors[2]) < abs(errors[1]) < abs(errors[0])
    assert errors[0] * formula <= 2.0 * 5e-3 * math.sqrt(STIFF.stiffness * STIFF.mass)


def test_contact_compliance_lowers_the_peak_in_proportion_to_the_indentation():
    formula = find_release(find_step_angle(50e-6, R), 1.0, 0.15).pull_force
    settings = DragSettings(1.0, 0.15, speed=0.1e-3, ring_time=1e-3, lead=2e-6)
    loss = []
    for stiffness in (4e6, 8e6, 16e6):
        probe = replace(STIFF, contact_stiffness=stiffness)
        loss.append(
            1.0 - simulate_drag(build_step_track(50e-6, R), probe, settings).peak_force / formula
        )
    assert all(value > 0 for value in loss)
    assert loss[0] / loss[1] == pytest.approx(2.0, rel=0.25)
    assert loss[1] / loss[2] == pytest.approx(2.0, rel=0.25)


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("height", "load", "mu"), [(10e-6, 1.3, 0.0), (40e-6, 0.6, 0.17), (100e-6, 0.075, 0.1)]
)
def test_the_energy_ledger_closes_to_a_thousandth(height, load, mu):
    for speed in (2e-3, 20e-3):
        trace = simulate_drag(
            build_step_track(height, R), PAPER_DRAG, DragSettings(load, mu, speed=speed)
        )
        assert trace.ledger_error < 1e-3
        assert (
            min(trace.ledger[name] for name in ("friction_loss", "damping_loss", "impact_loss"))
            >= -1e-12
        )


def test_without_friction_and_damping_nothing_is_lost():
    probe = replace(PAPER_DRAG, damping_ratio=0.0, contact_loss=0.0)
    trace = simulate_drag(
        build_step_track(40e-6, R), probe, DragSettings(0.6, 0.0, speed=5e-3, resolution=60.0)
    )
    assert trace.ledger["friction_loss"] == 0.0
    assert trace.ledger["damping_loss"] == 0.0
    assert trace.ledger["impact_loss"] == 0.0
    stored = sum(trace.ledger[name] for name in ("kinetic", "spring", "lift", "contact", "bristle"))
    assert stored == pytest.approx(trace.ledger["handle_work"], rel=1e-4)


def test_the_lift_is_the_load_times_the_height():
    trace = simulate_drag(build_step_track(33e-6, R), STIFF, DragSettings(0.8, 0.15, speed=5e-3))
    assert trace.ledger["lift"] == pytest.approx(0.8 * 33e-6, rel=0.01)


def test_halving_the_step_quarters_the_error_of_the_ledger():
    errors = []
    for resolution in (15.0, 30.0, 60.0):
        settings = DragSettings(0.8, 0.0, speed=10e-3, resolution=resolution, ring_time=2e-3)
        errors.append(simulate_drag(build_step_track(30e-6, R), PAPER_DRAG, settings).ledger_error)
    assert errors[0] / errors[2] > 8.0


def test_halving_the_step_settles_peak_and_ring():
    results = []
    for resolution in (20.0, 40.0, 80.0):
        trace = simulate_drag(
            build_step_track(50e-6, R),
            PAPER_DRAG,
            DragSettings(0.5, 0.15, speed=5e-3, resolution=resolution),
        )
        results.append((trace.peak_force, measure_ring(trace).energy))
    peaks, energies = np.array(results).T
    assert abs(peaks[1] / peaks[2] - 1.0) < 1e-3
    assert abs(energies[1] / energies[2] - 1.0) < 1e-2


def test_the_loading_ramp_has_the_slope_of_spring_times_speed():
    trace = simulate_drag(
        build_step_track(50e-6, R), PAPER_DRAG, DragSettings(1.0, 0.15, speed=5e-3, lead=5e-6)
    )
    time, force = trace.column("time_s"), trace.column("fx_n")
    ramp = (time > trace.release_time - 20e-3) & (time < trace.release_time - 8e-3)
    slope = np.polyfit(time[ramp], force[ramp], 1)[0]
    assert slope == pytest.approx(9.81e3 * 5e-3, rel=0.04)


def test_a_tip_that_is_free_rings_at_its_natural_frequency():
    # At a vanishing load nothing but the spring acts after the slip: 300 Hz by construction.
    trace = simulate_drag(
        build_step_track(100e-6, R), PAPER_DRAG, DragSettings(0.08, 0.1, speed=5e-3)
    )
    assert measure_ring(trace).frequency == pytest.approx(300.0, abs=6.0)


def test_figures_three_to_five_in_kind_and_number_on_a_high_step_under_a_light_load():
    # Origin: the paper; E_v 10-20 uJ, > 64 % of loading in 0-100 Hz, about 86 % of vibration in
    # 250-350 Hz.
    probe = replace(PAPER_DRAG, damping_ratio=0.01)
    trace = simulate_drag(build_step_track(100e-6, R), probe, DragSettings(0.075, 0.1, speed=5e-3))
    ring = measure_ring(trace)
    assert 10e-6 < ring.energy < 20e-6
    assert ring.loading_share > 0.64
    assert ring.ring_band_share == pytest.approx(0.86, abs=0.04)
    assert ring.duration > 16e-3


def test_figures_three_to_five_come_out_at_once_for_a_rod_as_stiff_along_the_normal():
    # Origin: the paper; C_v 20 %, E_v 10-20 uJ over 16 ms, > 64 % of loading in 0-100 Hz, about 86
    # % of vibration in 250-350 Hz, a sympathetic resonance along the normal. A round rod has one
    # stiffness and one mass in both directions.
    probe = replace(PAPER_DRAG, damping_ratio=0.033, normal_stiffness=9.81e3, carrier_mass=20e-3)
    trace = simulate_drag(build_step_track(100e-6, R), probe, DragSettings(0.1, 0.1, speed=5e-3))
    ring = measure_ring(trace)
    assert trace.ledger_error < 1e-3
    assert 10e-6 < ring.energy < 20e-6
    assert ring.share == pytest.approx(0.20, abs=0.04)
    assert ring.decay_time == pytest.approx(16e-3, abs=2e-3)
    assert ring.loading_share > 0.64
    assert ring.ring_band_share == pytest.approx(0.86, abs=0.02)
    assert (
        compute_spectral_band_share(*compute_phase_spectrum(trace, "vibration", "fy_n"), RING_BAND)
        > 0.5
    )


def test_the_decay_time_of_a_free_ring_is_that_of_its_damper():
    # Origin: amplitude exp(-zeta omega t) of a damped oscillator; after the slip the tip of this
    # rod flies for 20 ms.
    for zeta in (0.033, 0.05):
        probe = replace(PAPER_DRAG, damping_ratio=zeta, normal_stiffness=9.81e3, carrier_mass=20e-3)
        trace = simulate_drag(
            build_step_track(100e-6, R), probe, DragSettings(0.1, 0.1, speed=5e-3)
        )
        assert measure_ring(trace).decay_time == pytest.approx(
            1.0 / (zeta * 2 * math.pi * 300.0), rel=0.15
        )


def test_sixteen_milliseconds_come_out_where_friction_ends_the_ring():
    probe = replace(PAPER_DRAG, damping_ratio=0.01)
    ring = measure_ring(
        simulate_drag(build_step_track(75e-6, R), probe, DragSettings(0.2, 0.15, speed=5e-3))
    )
    assert ring.duration == pytest.approx(16e-3, abs=2.5e-3)
    assert 10e-6 < ring.energy < 20e-6
    # and here the reproduction falls short of 86 %: friction shortens and detunes the ring
    assert 0.6 < ring.ring_band_share < 0.8


def test_a_locked_tip_loads_without_release():
    trace = simulate_drag(
        build_step_track(100e-6, R), PAPER_DRAG, DragSettings(0.2, 0.3, speed=20e-3)
    )
    assert trace.status is Status.LOCKED
    with pytest.raises(ContactError, match="no ring"):
        measure_ring(trace)


def test_a_flat_surface_gives_steady_sliding_and_no_catch():
    track = build_profile_track(np.linspace(0, 3e-3, 40), np.zeros(40), R)
    trace = simulate_drag(track, PAPER_DRAG, DragSettings(0.9, 0.2, speed=20e-3))
    assert trace.status is Status.NO_CATCH
    assert np.abs(trace.column("fx_n") - 0.18).max() < 1e-3 * 0.18 + 1e-6


def test_friction_at_rest_that_exceeds_sliding_friction_raises_the_peak():
    base = DragSettings(1.0, 0.15, speed=2e-3, ring_time=5e-3)
    plain = simulate_drag(build_step_track(25e-6, R), STIFF, base).peak_force
    sticky = simulate_drag(
        build_step_track(25e-6, R), STIFF, replace(base, static_friction=0.25, stribeck_speed=20e-3)
    ).peak_force
    limit = find_release(find_step_angle(25e-6, R), 1.0, 0.25).pull_force
    assert plain < sticky <= limit * 1.01


def test_a_pulled_handle_needs_more_than_the_peak_force_to_pass():
    formula = find_release(find_step_angle(25e-6, R), 1.0, 0.15).pull_force
    pulled = DragSettings(
        1.0, 0.15, speed=0.0, pulling_force=0.7 * formula, handle_mass=0.1, handle_damping=500.0
    )
    track = build_step_track(25e-6, R)
    held = simulate_drag(track, PAPER_DRAG, pulled)
    passed = simulate_drag(track, PAPER_DRAG, replace(pulled, pulling_force=1.5 * formula))
    assert held.status is Status.LOCKED
    assert passed.status is Status.RELEASES
    assert passed.ledger_error < 1e-3
    assert passed.peak_force == pytest.approx(formula, rel=0.05)


def test_a_load_on_a_sprung_carrier_rings_along_the_normal_and_keeps_the_ledger():
    probe = replace(PAPER_DRAG, normal_stiffness=9.81e3, carrier_mass=0.05)
    for height, load in ((50e-6, 0.5), (75e-6, 0.2)):
        trace = simulate_drag(
            build_step_track(height, R), probe, DragSettings(load, 0.15, speed=5e-3)
        )
        assert trace.ledger_error < 1e-3
    after = trace.column("time_s") > trace.release_time
    assert np.ptp(trace.column("fy_n")[after]) > 0.05  # N


def test_scaling_lengths_by_s_and_the_spring_by_one_over_s_keeps_every_force():
    # Origin: project facts, scaling for simulators; the mass scales by 1/S^... so that time stays:
    # m = k / omega^2.
    s = 23.0
    small = replace(STIFF, contact_stiffness=1e8)
    large = replace(
        small, stiffness=small.stiffness / s, mass=small.mass / s, contact_stiffness=1e8 / s
    )
    a = simulate_drag(
        build_step_track(40e-6, R), small, DragSettings(0.6, 0.15, speed=4e-3, ring_time=3e-3)
    )
    b = simulate_drag(
        build_step_track(s * 40e-6, s * R),
        large,
        DragSettings(0.6, 0.15, speed=s * 4e-3, ring_time=3e-3, lead=s * 20e-6),
    )
    assert b.peak_force == pytest.approx(a.peak_force, rel=1e-3)
    assert b.stored_energy == pytest.approx(s * a.stored_energy, rel=2e-3)


def test_the_track_of_a_profile_is_the_track_in_closed_form():
    height = 41e-6
    closed = build_step_track(height, R)
    x = np.linspace(-1.5e-3, 1.5e-3, 3001)
    z = np.where(x < 0, 0.0, height)
    track = build_profile_track(np.insert(x, 1500, 0.0), np.insert(z, 1500, 0.0), R)
    assert track.kinks.size == 1
    assert track.x[track.kinks[0]] == pytest.approx(closed.x[closed.kinks[0]], rel=1e-9)
    assert track.find_notch(+1.0)[2] == pytest.approx(find_step_angle(height, R), rel=1e-9)
    assert track.z == pytest.approx(step_path(track.x, height, R), abs=1e-9 * height)
    settings = DragSettings(0.6, 0.15, speed=5e-3)
    assert simulate_drag(track, PAPER_DRAG, settings).peak_force == pytest.approx(
        simulate_drag(closed, PAPER_DRAG, settings).peak_force, rel=1e-3
    )


def test_a_margin_is_felt_in_both_directions_with_its_own_force():
    gap, rise = 70e-6, 6e-6
    x = np.array([-1.5e-3, 0, 0, gap, gap, 1.5e-3])
    z = np.array([0, 0, -1e-3, -1e-3, rise, rise])
    for backward, angle in zip((False, True), find_margin_angles(gap, rise, R), strict=True):
        settings = DragSettings(0.6, 0.15, speed=1e-3, ring_time=2e-3, lead=30e-6)
        trace = simulate_drag(
            build_profile_track(x, z, R, backward=backward),
            replace(STIFF, contact_stiffness=1e8),
            settings,
        )
        assert trace.peak_force == pytest.approx(
            find_release(angle, 0.6, 0.15).pull_force, rel=0.03
        )


def test_a_rounded_edge_lowers_the_peak_as_the_closed_form_says():
    settings = DragSettings(0.6, 0.15, speed=1e-3, ring_time=1e-3, lead=5e-6)
    peak = simulate_drag(build_step_track(40e-6, R, 14e-6), STIFF, settings).peak_force
    assert peak == pytest.approx(
        find_release(find_step_angle(40e-6, R, 14e-6), 0.6, 0.15).pull_force, rel=0.01
    )


def test_the_share_that_rings_grows_with_the_height_and_is_no_constant():
    settings = DragSettings(1.0, 0.15, speed=5e-3)
    heights = (10e-6, 25e-6, 50e-6, 75e-6)
    share = [
        measure_ring(
            simulate_drag(build_step_track(h, R), PAPER_DRAG, settings), with_spectra=False
        ).share
        for h in heights
    ]
    assert (np.diff(share) > 0).all()
    assert share[0] < 0.25 < share[-1]


def test_below_the_snap_load_a_slow_tip_climbs_over_without_a_ring():
    # Origin: stability of a spring against a force that falls with position, dF/dx = -k; not from
    # the simulation.
    angle = find_step_angle(40e-6, R)
    load = snap_load(angle, 0.15, PAPER_DRAG.stiffness, R)
    shares = []
    for factor in (0.7, 3.0):
        trace = simulate_drag(
            build_step_track(40e-6, R), STIFF, DragSettings(factor * load, 0.15, speed=0.3e-3)
        )
        shares.append(measure_ring(trace).share)
    assert shares[0] < 0.01
    assert shares[1] > 0.2


def test_spectra_count_all_energy_once():
    trace = simulate_drag(
        build_step_track(75e-6, R), PAPER_DRAG, DragSettings(0.2, 0.15, speed=5e-3)
    )
    frequency, energy = compute_phase_spectrum(trace, "vibration")
    bands = [
        compute_spectral_band_share(frequency, energy, (a, a + 999.9999))
        for a in range(0, 5000, 1000)
    ]
    assert sum(bands) == pytest.approx(1.0, abs=1e-3)
    assert (
        compute_spectral_band_share(frequency, energy, LOADING_BAND)
        + compute_spectral_band_share(frequency, energy, RING_BAND)
        < 1.0
    )


def test_hertz_by_johnson():
    # Origin: F = 4/3 E* sqrt(R) d^1.5 with E* = 115.4 GPa for steel on steel, evaluated by hand.
    assert PAPER_DRAG.contact_stiffness == pytest.approx(
        4 / 3 * 115.3846e9 * math.sqrt(125e-6), rel=1e-5
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: DragSettings(-1.0, 0.15), "normal_load"),
        (lambda: DragSettings(1.0, -0.1), "friction"),
        (lambda: DragSettings(1.0, 0.1, speed=0.0), "exactly one of speed"),
        (lambda: DragSettings(1.0, 0.1, pulling_force=1.0), "exactly one of speed"),
        (lambda: DragSettings(1.0, 0.3, static_friction=0.2), "static_friction"),
        (lambda: DragSettings(1.0, 0.1, speed=math.nan), "speed"),
        (
            lambda: DragSettings(1.0, 0.1, speed=0.0, pulling_force=0.5, handle_mass=0.0),
            "handle_mass must be positive",
        ),
        (lambda: replace(PAPER_DRAG, mass=0.0), "mass"),
        (lambda: replace(PAPER_DRAG, contact_power=0.5), "contact_power"),
        (lambda: build_step_track(130e-6, R), "too-high"),
        (lambda: build_step_track(0.0, R), "height must be positive"),
        (lambda: build_profile_track([-1e-3, 0, 0, 1e-3], [0, 0, 2e-4, 2e-4], R), "too-high"),
        (
            lambda: simulate_drag(
                build_step_track(25e-6, R), PAPER_DRAG, DragSettings(1.0, 0.1, speed=1e-9)
            ),
            "drag faster",
        ),
    ],
)
def test_a_drag_that_makes_no_sense_is_one_clear_error(call, message):
    with pytest.raises(ContactError, match=message):
        call()


def test_a_probe_is_as_heavy_as_damped_and_as_hard_as_its_tool_and_ball_say():
    # Origin: m = k / (2 pi f)^2, zeta = 1 / (2 pi f T) and Hertz' F = 4/3 E* sqrt(R) d^1.5, E* = E
    # / 2(1 - nu^2).
    probe = build_probe_of_tool(
        Tool(7.3e3, frequency=251.0, decay_time=9e-3), 83e-6, contact_loss=2.0
    )
    assert probe.frequency == pytest.approx(251.0, rel=1e-12)
    assert probe.mass == pytest.approx(7.3e3 / (math.tau * 251.0) ** 2, rel=1e-12)
    assert probe.damping_ratio == pytest.approx(1.0 / (math.tau * 251.0 * 9e-3), rel=1e-12)
    reduced = 210e9 / (2.0 * (1.0 - 0.3**2))
    assert probe.contact_stiffness == pytest.approx(
        4.0 / 3.0 * reduced * math.sqrt(83e-6), rel=1e-12
    )
    assert probe.contact_loss == 2.0


# cubic stiffness of a spring that is a fifth stiffer at a stretch of 0.1 mm [N/m^3]
HARD = 9810.0 * 1.5e7


def test_a_hard_spring_stretches_by_the_real_root_of_its_cubic():
    probe = replace(PAPER_DRAG, hardening=HARD)
    for force in (-2.0, 0.03, 1.7):
        x = probe.compute_stretch(force)
        assert probe.stiffness * x + HARD * x**3 == pytest.approx(force, rel=1e-12)
    # origin: integral of the force over the stretch
    x = probe.compute_stretch(1.7)
    assert probe.compute_energy(1.7) == pytest.approx(
        0.5 * probe.stiffness * x**2 + 0.25 * HARD * x**4, rel=1e-12
    )


def test_a_hard_spring_leaves_the_peak_where_it_is_stores_less_and_keeps_the_ledger():
    track, settings = build_step_track(40e-6, 125e-6), DragSettings(0.8, 0.15, speed=10e-3)
    soft, hard = (
        simulate_drag(track, probe, settings)
        for probe in (PAPER_DRAG, replace(PAPER_DRAG, hardening=HARD))
    )
    # the force that lifts the tip over the edge knows nothing of the spring
    # but for what a tip with mass lags
    assert hard.peak_force == pytest.approx(soft.peak_force, rel=0.02)
    assert hard.stored_energy < 0.9 * soft.stored_energy
    assert hard.ledger_error < 1e-3
    # origin: the ramp is F(v t), not k v t; a tip in the corner gives way as much with either
    # spring
    rates = []
    for trace in (soft, hard):
        time, force = trace.column("time_s"), trace.column("fx_n")
        ramp = (force > 0.4) & (force < 1.0) & (time < trace.release_time)
        rates.append(
            np.polyfit(time[ramp], [trace.probe.compute_stretch(f) for f in force[ramp]], 1)[0]
        )
    assert rates[1] == pytest.approx(rates[0], rel=5e-3)
    assert rates[1] == pytest.approx(10e-3, rel=0.03)


@pytest.mark.repeats
@pytest.mark.parametrize("contact", [PAPER_DRAG.contact_stiffness, 1e5])
@pytest.mark.parametrize("factor", [0.04, 30.0])
def test_the_time_step_knows_no_unit_of_force(factor, contact):
    # loads, stiffnesses and masses times a factor: every period stays. On a hard contact a blow is
    # the greatest force, on one as soft as rubber the climb
    def step(f):
        probe = replace(
            PAPER_DRAG,
            stiffness=PAPER_DRAG.stiffness * f,
            mass=PAPER_DRAG.mass * f,
            contact_stiffness=contact * f,
        )
        return choose_time_step_and_bristles(probe, DragSettings(0.7 * f, 0.15), 90.0 * f)[:2]

    (one, grip), (other, more) = step(1.0), step(factor)
    assert other == pytest.approx(one, rel=1e-9)
    assert more == pytest.approx(factor * grip, rel=1e-9)


def test_while_it_slides_the_tool_pulls_the_friction_of_the_tip_and_that_of_the_tissue():
    settings = DragSettings(1.2, 0.2, tissue_friction=0.3)
    assert settings.compute_sliding_force() == pytest.approx(1.2 * 0.2 + 0.3, rel=1e-12)


def test_a_sprung_carrier_must_have_a_mass_and_a_rigid_one_need_not():
    with pytest.raises(ContactError, match="carrier_mass must be positive"):
        replace(PAPER_DRAG, normal_stiffness=9.81e3, carrier_mass=0.0)
    assert replace(PAPER_DRAG, normal_stiffness=0.0, carrier_mass=0.0).carrier_mass == 0.0
