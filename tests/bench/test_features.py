"""Features on records of known truth: no bias from hum, drift, quantisation and start-up.

Honest uncertainties.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stepblocks.bench.faults import LandmarkError
from stepblocks.bench.signal import Trace
from stepblocks.bench.signal.features import FEATURE_COLUMNS, measure_trace
from stepblocks.bench.signal.rubbing import compute_rubbing_force, fit_rubbing_ring
from stepblocks.bench.signal.spectrum import compute_energy_share_in_band
from stepblocks.rehearse.record import Rig, Truth, record_trial_by_equations

K = 9810.0
PLAIN = Truth(
    load=0.8,
    sliding_force=0.12,
    slope=98.1,
    peak_force=1.2,
    amplitude=0.53,
    frequency=300.0,
    decay_time=21.2e-3,
)
RIGS = {
    "hum 50": Rig(hum=10e-3),
    "hum 60": Rig(hum=10e-3, mains=60.0),
    "coarse": Rig(quantum=5e-3, noise=2e-3),
    "start-up": Rig(start_up=60e-3),
    "quiet": Rig(hum=0.0, quantum=0.0, noise=1e-4),
}
EXPECTED = {
    "sliding_friction": (0.15, "sliding_friction_std"),
    "normal_load_n": (0.8, "normal_load_std_n"),
    "loading_slope_n_per_s": (98.1, "loading_slope_std_n_per_s"),
    "peak_force_n": (1.2, "peak_force_std_n"),
    "release_level_n": (0.12, "release_level_std_n"),
    "ring_frequency_hz": (300.0, "ring_frequency_std_hz"),
    "decay_time_s": (21.2e-3, "decay_time_std_s"),
    "ring_amplitude_n": (0.53, "ring_amplitude_std_n"),
    "vibration_energy_j": (0.53**2 / (2 * K), "vibration_energy_std_j"),
    "sympathetic_force_n": (0.25 * 0.53, "sympathetic_force_std_n"),
}


def pulls(rig: Rig, count: int, seed: int, truth: Truth = PLAIN) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    found = {name: [] for name in EXPECTED}
    for _ in range(count):
        features = measure_trace(
            record_trial_by_equations(truth, rig, random)[0], K, truth.slope / K
        ).features
        for name, (value, std) in EXPECTED.items():
            found[name].append((features[name] - value) / features[std])
    return {name: np.array(values) for name, values in found.items()}


@pytest.mark.long
@pytest.mark.parametrize("name", RIGS)
def test_no_disturbance_biases_a_feature_and_uncertainties_are_honest(name):
    count = 40
    for feature, pull in pulls(RIGS[name], count, seed=3).items():
        # origin: the mean of n standard normal numbers scatters by 1/sqrt(n), their spread by
        # 1/sqrt(2n); four sigma
        assert abs(pull.mean()) < 4.0 / math.sqrt(count) + 0.1, feature
        assert 0.55 < pull.std() < 1.6, feature


def test_a_drift_moves_the_zero_and_nothing_else():
    random = np.random.default_rng(5)
    trace, onset, _ = record_trial_by_equations(PLAIN, Rig(drift=50e-3), random)
    features = measure_trace(trace, K, PLAIN.slope / K).features
    zero = 50e-3 * onset / 2.0
    assert features["peak_force_n"] == pytest.approx(
        1.2 + zero, abs=5 * features["peak_force_std_n"]
    )
    assert features["ring_amplitude_n"] == pytest.approx(
        0.53, abs=5 * features["ring_amplitude_std_n"]
    )
    assert features["loading_slope_n_per_s"] == pytest.approx(
        98.1, abs=5 * features["loading_slope_std_n_per_s"]
    )


def test_without_disturbance_the_truth_comes_back():
    rig = Rig(hum=0.0, quantum=0.0, noise=1e-7)
    trace, onset, release = record_trial_by_equations(PLAIN, rig, np.random.default_rng(2))
    features = measure_trace(trace, K, PLAIN.slope / K).features
    assert set(features) == set(FEATURE_COLUMNS)
    assert features["loading_onset_s"] == pytest.approx(onset, abs=1e-7)
    assert features["release_time_s"] == pytest.approx(release, abs=1e-7)
    assert features["ring_amplitude_n"] == pytest.approx(0.53, rel=1e-5)
    assert features["spring_constant_n_per_m"] == pytest.approx(K, rel=1e-5)
    assert features["vibration_energy_j"] == pytest.approx(0.53**2 / (2 * K), rel=2e-5)


def test_energy_goes_with_the_square_of_the_forces_and_one_over_the_stiffness():
    trace, _, _ = record_trial_by_equations(
        PLAIN, Rig(hum=0.0, quantum=0.0, noise=1e-6), np.random.default_rng(2)
    )
    double = Trace(trace.time, 2.0 * trace.tangential, 2.0 * trace.normal)
    one, two = measure_trace(trace, K).features, measure_trace(double, 2.0 * K).features
    assert two["vibration_energy_j"] == pytest.approx(2.0 * one["vibration_energy_j"], rel=1e-6)
    assert two["sliding_friction"] == pytest.approx(one["sliding_friction"], rel=1e-6)
    assert math.isnan(one["spring_constant_n_per_m"])


def test_a_rubbing_ring_gives_its_friction_and_its_amplitude():
    truth = Truth(
        load=0.8,
        sliding_force=0.12,
        slope=98.1,
        peak_force=1.9,
        amplitude=1.5,
        frequency=270.0,
        decay_time=28e-3,
        gap=0.24,
        release_decay=0.1e-3,
    )
    random = np.random.default_rng(8)
    for _ in range(3):
        found = measure_trace(
            record_trial_by_equations(truth, Rig(), random)[0], K, truth.slope / K
        )
        assert not found.aftermath.rings_freely
        features = found.features
        # origin: each half cycle costs the amplitude twice the friction, four times it per period
        decay = 4.0 * 0.12 * 270.0
        assert features["friction_decay_n_per_s"] == pytest.approx(decay, rel=0.03)
        assert features["ring_amplitude_n"] == pytest.approx(1.5, rel=0.02)
        assert features["ring_frequency_hz"] == pytest.approx(270.0, abs=0.5)


@pytest.mark.parametrize(
    ("slope", "decay"), [(5.0, 0.03), (60.0, 0.03), (300.0, 0.03), (300.0, 2e-3), (600.0, 3e-3)]
)
def test_the_pieces_of_a_rubbing_ring_solve_its_equation_of_motion(slope, decay):
    # origin: scipy's integrator on f'' = -w^2 (f - L(sign)) - (2/tau) f' - f/tau^2, sign smoothed
    # over 1e-3 N/s; the damped cosine with frequency w and decay tau belongs to w0^2 = w^2 +
    # 1/tau^2
    level, gap, frequency = 0.1, 0.3, 270.0
    stiff = (2 * math.pi * frequency) ** 2 + decay**-2

    def motion(_, y):
        rest = level - 0.5 * gap * (1.0 + math.tanh((y[1] - slope) / 1e-1))
        return [y[1], -stiff * (y[0] - rest) - 2.0 / decay * y[1]]

    time = np.linspace(0.0, 0.012, 121)
    exact = solve_ivp(
        motion,
        (0.0, 0.012),
        [-1.0, 0.0],
        t_eval=time,
        method="LSODA",
        rtol=1e-8,
        atol=1e-9,
        max_step=2e-5,
    )
    ours = compute_rubbing_force(time, level, gap, (frequency, decay), (-1.0, 0.0), slope)
    assert np.abs(exact.y[0] - ours).max() < 4e-3


@pytest.mark.parametrize(("amplitude", "slope"), [(0.168, 196.2), (0.45, 196.2), (0.7, 20.0)])
def test_a_tip_that_comes_to_rest_never_chatters(amplitude, slope):
    # these starts end close to the lower level, where damping at the speed of the ramp decides
    # whether it sticks
    time = np.linspace(0.0, 0.15, 1501)
    for gap in np.linspace(0.05, 0.15, 41):
        force = compute_rubbing_force(
            time, 0.048, gap, (270.0, 0.0284), (0.048 + amplitude, -amplitude / 0.0284), slope
        )
        assert np.abs(force).max() < 1.0 + amplitude
        assert force[-200:].mean() == pytest.approx(0.048, abs=0.01)


@pytest.mark.parametrize("gap", [0.02, 0.1, 0.4])
def test_a_rubbing_ring_is_fitted_whatever_its_friction_is_guessed_to_be(gap):
    # the fit begins at a gap of twice the level, 0.8 N; expected is what the record was made of
    time, slope = np.linspace(0.0, 0.08, 801), 60.0
    force = compute_rubbing_force(time, 0.4, gap, (280.0, 20e-3), (-1.1, 0.0), slope)
    force += 1e-3 * np.random.default_rng(0).standard_normal(force.size)
    found = fit_rubbing_ring(time, force, 0.4, (300.0, 25e-3), slope, 1e-3)
    assert found.values[:4] == pytest.approx([0.4, gap, 280.0, 20e-3], rel=0.03)


def test_the_spring_is_the_slope_of_the_ramp_over_the_speed_of_the_handle():
    trace = record_trial_by_equations(PLAIN, Rig(), np.random.default_rng(4))[0]
    for speed in (2e-3, 20e-3):
        found = measure_trace(trace, K, speed)
        assert found.features["spring_constant_n_per_m"] == pytest.approx(
            PLAIN.slope / speed, rel=0.01
        )


def test_band_shares_follow_parseval():
    rate, time = 10e3, np.arange(4000) / 10e3
    ring = np.exp(-time / 0.02) * np.cos(2 * np.pi * 300.0 * time)
    parts = [
        compute_energy_share_in_band(ring, rate, band)
        for band in ((0.0, 250.0), (250.0, 350.0), (350.0, 1e9))
    ]
    assert sum(parts) == pytest.approx(1.0, abs=1e-9)
    # origin: a damped cosine is a Lorentz line of half width 1/tau; share within +-d is (2/pi)
    # atan(2 pi d tau)
    assert parts[1] == pytest.approx(2 / math.pi * math.atan(2 * math.pi * 50.0 * 0.02), abs=0.03)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda f, t: np.minimum(f, 0.15), "no slip"),
        (lambda f, t: np.maximum.accumulate(f), "no release"),
        (lambda f, t: f - 3.0 * t, ""),
    ],
)
def test_a_record_without_the_course_of_a_trial_says_what_it_lacks(change, reason):
    trace, _, _ = record_trial_by_equations(PLAIN, Rig(hum=0.0), np.random.default_rng(4))
    changed = Trace(trace.time, change(trace.tangential, trace.time), trace.normal)
    if reason:
        with pytest.raises(LandmarkError, match=reason):
            measure_trace(changed, K)
    else:
        assert measure_trace(changed, K).features["ring_amplitude_n"] == pytest.approx(
            0.53, rel=0.03
        )
