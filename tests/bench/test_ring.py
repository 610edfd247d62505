"""A damped ring: frequency, decay and amplitude come back."""

import numpy as np
import pytest
from scipy.optimize import curve_fit

from oracles.traces import Course, hum
from stepblocks.bench.signal.ring import RingBasis, fit_damped_ring
from stepblocks.bench.signal.rubbing import KNOWN_SPREAD, compute_rubbing_force, fit_rubbing_ring
from stepblocks.bench.signal.separable import (
    compute_numeric_jacobian,
    guess_ring_frequency_and_decay,
)

COURSE = Course(phase=0.4)
TIME = COURSE.clock(tail=0.12)
AFTER = np.searchsorted(TIME, COURSE.release + 0.25e-3)
SINCE = TIME[AFTER:]


def after(std=2e-3, seed=6, course=COURSE):
    noise = std * np.random.default_rng(seed).standard_normal(SINCE.size)
    return course.force(SINCE) + noise


def ring_of(force, noise=2e-3):
    return fit_damped_ring(SINCE, force, COURSE.release, 50.0, noise)


@pytest.mark.parametrize("frequency", [140.0, 250.0, 333.0, 610.0])
@pytest.mark.parametrize("decay", [6e-3, 14.2e-3, 50e-3])
def test_a_guess_is_near_enough_to_begin_from(frequency, decay):
    force = Course(frequency=frequency, decay_time=decay, amplitude=0.9).ring(SINCE)
    guessed, guessed_decay = guess_ring_frequency_and_decay(SINCE, force)
    assert guessed == pytest.approx(frequency, rel=0.05)
    assert 0.3 * decay < guessed_decay < 3.0 * decay


def test_without_noise_every_figure_comes_back():
    ring = ring_of(after(0.0), noise=1e-6)
    assert ring.frequency[0] == pytest.approx(287.0, rel=1e-7)
    assert ring.decay_time[0] == pytest.approx(17e-3, rel=1e-6)
    assert ring.level[0] == pytest.approx(0.12, rel=1e-6)
    assert ring.compute_amplitude(COURSE.release)[0] == pytest.approx(0.53, rel=1e-6)
    np.testing.assert_allclose(ring.compute_curve(SINCE), after(0.0), atol=1e-7)


def test_fit_and_uncertainties_are_those_of_scipy():
    force = after()
    ring = ring_of(force)

    def model(t, frequency, decay, release, level, drift, rest, cosine, sine, hum_c, hum_s):
        since, mains = t - COURSE.release, 2.0 * np.pi * 50.0 * t
        phase = 2.0 * np.pi * frequency * since
        swing = np.exp(-since / decay) * (cosine * np.cos(phase) + sine * np.sin(phase))
        slow = level + drift * since + hum_c * np.cos(mains) + hum_s * np.sin(mains)
        return slow + rest * np.exp(-since / release) + swing

    start = (286.0, 16e-3, 0.5e-3, 0.1, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0)
    # origin: scipy's curve_fit of all ten parameters at once, with a Jacobian of its own
    values, covariance = curve_fit(model, SINCE, force, p0=start, xtol=1e-12, ftol=1e-12)
    assert ring.frequency[0] == pytest.approx(values[0], rel=1e-6)
    assert ring.decay_time[0] == pytest.approx(values[1], rel=1e-4)
    stds = np.sqrt(np.diag(covariance))
    # the covariance may be widened by what correlation of neighbours white noise shows by chance
    assert stds[0] * 0.99 < ring.frequency[1] < 1.3 * stds[0]
    assert stds[1] * 0.99 < ring.decay_time[1] < 1.3 * stds[1]
    assert stds[3] * 0.99 < ring.level[1] < 1.3 * stds[3]


def test_the_amplitude_is_carried_back_by_its_own_decay_and_the_less_certain_the_farther():
    ring = ring_of(after())
    here, here_std = ring.compute_amplitude(COURSE.release)
    assert here == pytest.approx(0.53, abs=4.0 * here_std)
    early, early_std = ring.compute_amplitude(COURSE.release - 10e-3)
    # origin: exp(10 ms / tau)
    assert early / here == pytest.approx(np.exp(10e-3 / ring.decay_time[0]), rel=1e-9)
    assert early_std / early > here_std / here


def test_hum_and_drift_beside_a_ring_do_not_move_it():
    plain = ring_of(after())
    disturbed = ring_of(after() + hum(SINCE, 30e-3) + 0.2 * (SINCE - COURSE.release))
    assert disturbed.frequency[0] == pytest.approx(plain.frequency[0], abs=1e-3)
    assert disturbed.compute_amplitude(COURSE.release)[0] == pytest.approx(
        plain.compute_amplitude(COURSE.release)[0], rel=1e-4
    )
    assert disturbed.level[0] == pytest.approx(plain.level[0], abs=2e-4)


def test_a_ring_of_another_kind_misses_its_noise_where_it_begins():
    good = ring_of(after())
    assert good.misfit < 5.0
    since = SINCE - COURSE.release
    # a triangle wave of the same period is no cosine
    phase = (since * COURSE.frequency) % 1.0
    triangle = (
        COURSE.amplitude * np.exp(-since / COURSE.decay_time) * (4.0 * np.abs(phase - 0.5) - 1.0)
    )
    wrong = after() - COURSE.ring(SINCE) + triangle
    assert ring_of(wrong).misfit > 20.0


def test_the_band_of_the_curve_covers_its_scatter():
    at = COURSE.release + 2e-3
    pulls = []
    for seed in range(30):
        ring = ring_of(after(seed=seed))
        pulls.append(
            (ring.compute_curve(np.array([at]))[0] - COURSE.force(np.array([at]))[0])
            / ring.compute_curve_std(at)
        )
    # origin: a standard normal number; four sigma of the mean and of the spread of 30
    assert abs(np.mean(pulls)) < 0.73
    assert 0.5 < np.std(pulls) < 1.5


@pytest.mark.parametrize("noise", [2e-3, 5e-3])
def test_a_gap_is_sought_until_one_is_seen_though_a_tip_that_sticks_fits_within_the_noise(noise):
    # forward 0.40 N, back 0.36 N: a fit from the gap of dry friction, 0.80 N, never slips back
    time, tool = np.arange(1000) / 1e4, (270.0, 28e-3)
    force = compute_rubbing_force(time, 0.4, 0.04, tool, (0.3, 0.0), COURSE.slope)
    force += noise * np.random.default_rng(1).standard_normal(time.size)
    found = fit_rubbing_ring(time, force, 0.4, tool, COURSE.slope, noise, spread=KNOWN_SPREAD)
    assert found.values[1] == pytest.approx(0.04, abs=4.0 * found.get_std(1))


def test_a_fit_misses_its_noise_by_what_its_ten_figures_leave_of_few_samples():
    # Expected value: chi squared of 60 samples and ten fitted figures (frequency, two decays,
    # level, drift, hum of two, rest, ring of two) is 50 on average, its spread 10. Of 8 ms, 16
    # samples, at most 16 are expected, with a spread of sqrt(32).
    time = COURSE.release + 0.25e-3 + np.arange(60) / 2e3
    noise, squares = 2e-3, []
    for seed in range(40):
        force = COURSE.force(time) + noise * np.random.default_rng(seed).standard_normal(time.size)
        ring = fit_damped_ring(time, force, COURSE.release, 50.0, noise)
        square = (ring.fit.residuals / noise) ** 2
        squares.append(square.sum())
        whole, begun = (square.sum() - 50.0) / 10.0, (square[:16].sum() - 16.0) / np.sqrt(32.0)
        assert ring.misfit == pytest.approx(max(whole, begun), abs=1e-9)
    # four standard errors of the mean of 40
    assert np.mean(squares) == pytest.approx(50.0, abs=40.0 / np.sqrt(40))


@pytest.mark.parametrize("is_bent", [False, True])
def test_slopes_in_closed_form_are_those_of_differences(is_bent):
    basis = RingBasis(COURSE.release, 50.0, is_bent=is_bent)
    since = SINCE - COURSE.release
    shape = np.array([287.0, 17e-3, 0.4e-3])
    columns = basis.build_columns(since, shape)
    weights = np.random.default_rng(3).standard_normal(columns.shape[1])
    found = basis.differentiate_cosine(since, shape, columns, weights)
    expected = compute_numeric_jacobian(
        lambda moved: basis.build_columns(since, moved) @ weights, shape, 1e-5 * shape
    )
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
