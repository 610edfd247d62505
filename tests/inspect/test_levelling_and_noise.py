"""Levels, planes, spikes and noise.

Each against a closed form, or against the sum that a fast way replaces.
"""

import math

import numpy as np
import pytest

from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.inspect.features import _compute_likelihood_gain, _estimate_correlated_point_count
from stepblocks.inspect.found_edges import _compute_window_differences, _find_plateau_middle
from stepblocks.inspect.levelling import (
    Fit,
    filter_by_running_median,
    fit_two_planes,
    fit_without_spikes,
)
from stepblocks.inspect.noise import (
    LEAST_SCATTER,
    compute_estimator_covariance,
    estimate_autocovariance,
    estimate_robust_scale,
    factor_covariance,
    find_outliers,
    make_linear_estimate,
)

X = np.arange(-400, 400) * 1e-6


def test_a_running_median_takes_spikes_away_and_leaves_edges_where_they_are():
    heights = np.where(np.arange(60) < 30, 0.0, 5.0)
    spiked = heights.copy()
    spiked[[7, 44]] = 100.0, -100.0
    np.testing.assert_array_equal(filter_by_running_median(spiked), heights)
    spiked[20] = np.nan
    calm = filter_by_running_median(spiked)
    assert np.isnan(calm[20])
    np.testing.assert_array_equal(np.delete(calm, 20), np.delete(heights, 20))


@pytest.mark.parametrize(("tilt", "height"), [(0.0, 10e-6), (4e-3, -25e-6)])
def test_two_planes_give_tilt_and_height_of_a_step_exactly_and_their_weights_are_the_estimate(
    tilt, height
):
    z = np.where(X > 0.2e-6, height, 0.0) + tilt * X + 1e-3
    planes = fit_two_planes(X, z, 0.2e-6, np.abs(X) > 50e-6)
    assert planes.tilt == pytest.approx(tilt, abs=1e-12)
    assert planes.height.value == pytest.approx(height, abs=1e-15)
    assert planes.offset == pytest.approx(1e-3)
    at_middle = planes.offset + tilt * 0.2e-6
    assert planes.fit.weights @ z == pytest.approx(
        [planes.tilt, at_middle, planes.height.value], abs=1e-12
    )
    assert (planes.height.std, planes.fit.rejected) == (0.0, 0)


def test_two_planes_leave_spikes_out_and_count_them():
    z = edge_gauge(X, 20e-6) + np.random.default_rng(3).normal(0.0, 10e-9, len(X))
    clean = fit_two_planes(X, z, 0.0, np.abs(X) > 30e-6)
    z[[10, 200, 700]] += 5e-6
    spiked = fit_two_planes(X, z, 0.0, np.abs(X) > 30e-6)
    assert spiked.fit.rejected == clean.fit.rejected + 3
    assert not spiked.fit.used[[10, 200, 700]].any()
    assert spiked.height.value == pytest.approx(clean.height.value, abs=clean.height.std)


def test_the_robust_scale_of_a_normal_law_is_its_standard_deviation_and_spikes_do_not_move_it():
    sample = np.random.default_rng(4).normal(5e-6, 30e-9, 200_000)
    assert estimate_robust_scale(sample) == pytest.approx(30e-9, rel=0.01)
    sample[:1000] = 1.0
    assert estimate_robust_scale(sample) == pytest.approx(30e-9, rel=0.02)
    assert find_outliers(sample, np.isfinite(sample))[:1000].all()
    # beyond five standard deviations: 6e-7
    assert find_outliers(sample, np.isfinite(sample))[1000:].mean() < 1e-5


def test_the_rounding_of_a_processor_is_no_scatter_and_holds_no_spikes():
    residuals = np.random.default_rng(5).normal(0.0, 1e-3 * LEAST_SCATTER, 100)
    residuals[3] = 1e-9
    assert not find_outliers(residuals, np.isfinite(residuals)).any()
    np.testing.assert_array_equal(estimate_autocovariance([residuals * 1e-6]), [0.0])


def test_the_autocovariance_of_roughness_is_the_one_that_was_put_in():
    # Gaussian-correlated: gamma(k) = rough^2 exp(-(k / length)^2), white noise on lag 0 alone
    pieces = [
        correlated_noise(20_000, 1e-6, 10e-9, 40e-9, 5e-6, np.random.default_rng(seed))
        for seed in range(4)
    ]
    gamma = estimate_autocovariance(pieces)
    assert gamma[0] == pytest.approx(10e-9**2 + 40e-9**2, rel=0.05)
    for lag in (2, 5):
        assert gamma[lag] == pytest.approx(40e-9**2 * math.exp(-((lag / 5.0) ** 2)), rel=0.15)
    spectrum = np.fft.rfft(np.concatenate([gamma, np.zeros(4 * len(gamma)), gamma[:0:-1]])).real
    # a covariance: no negative power beyond rounding of the window
    assert spectrum.min() > -1e-3 * spectrum.max()


def test_estimates_from_white_noise_have_the_covariance_of_the_weights():
    weights = np.random.default_rng(6).normal(size=(3, 50))
    np.testing.assert_allclose(
        compute_estimator_covariance(weights, np.array([4.0])), 4.0 * weights @ weights.T
    )
    # one lag: the sum over pairs, written out
    gamma = np.array([4.0, 1.5])
    toeplitz = 4.0 * np.eye(50) + 1.5 * (np.eye(50, k=1) + np.eye(50, k=-1))
    np.testing.assert_allclose(
        compute_estimator_covariance(weights, gamma), weights @ toeplitz @ weights.T
    )


def test_the_root_of_a_singular_covariance_gives_it_back():
    columns = np.random.default_rng(7).normal(size=(5, 2))
    covariance = columns @ columns.T  # rank 2 of 5
    root = factor_covariance(covariance)
    np.testing.assert_allclose(root.T @ root, covariance, atol=1e-12)


def test_the_mean_of_white_noise_is_known_to_its_scatter_over_the_root_of_n():
    count, found = 400, []
    for seed in range(200):
        noise = np.random.default_rng(seed).normal(0.0, 20e-9, count)
        ones = np.ones(count)
        found.append(
            make_linear_estimate(
                0.0, ones / count, noise - noise.mean(), ones > 0.0, ones[np.newaxis]
            )
        )
    assert np.sqrt(np.mean([one.std**2 for one in found])) == pytest.approx(
        20e-9 / math.sqrt(count), rel=0.05
    )
    assert 50.0 < np.median([one.dof for one in found]) <= count


def test_the_mean_of_a_moving_average_is_known_less_well_by_its_closed_form():
    # z_i = e_i + 0.8 e_(i-1): the variance of a mean of n is (1 + 0.8)^2 / n, less an end term of
    # order 1 / n^2
    count, found = 1000, []
    for seed in range(100):
        e = np.random.default_rng(seed).normal(0.0, 1e-8, count + 1)
        noise = e[1:] + 0.8 * e[:-1]
        ones = np.ones(count)
        found.append(
            make_linear_estimate(
                0.0, ones / count, noise - noise.mean(), ones > 0.0, ones[np.newaxis]
            ).std
        )
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1.8e-8 / math.sqrt(count), rel=0.05)


def test_no_residuals_leave_no_uncertainty():
    ones = np.ones(100)
    quiet = make_linear_estimate(0.0, ones / 100, 0.0 * ones, ones > 0.0, ones[np.newaxis])
    assert (quiet.std, quiet.dof) == (0.0, math.inf)
    # a scatter below that of rounding is none either, one above it is
    turns = np.where(np.arange(100) % 2, 1.0, -1.0) * LEAST_SCATTER
    for share, certain in ((0.5, True), (2.0, False)):
        found = make_linear_estimate(0.0, ones / 100, share * turns, ones > 0.0, ones[np.newaxis])
        assert (found.std == 0.0) is certain


def test_the_taper_of_an_autocovariance_is_the_window_of_parzen():
    # Parzen 1961: 1 - 6 u^2 + 6 u^3 up to the middle, 2 (1 - u)^3 behind it
    rng = np.random.default_rng(11)
    residuals = 1e-7 * np.convolve(rng.normal(size=4000), np.ones(9), mode="valid")
    gamma = estimate_autocovariance([residuals], parameters=0)
    n = len(residuals)
    plain = np.array([residuals[: n - k] @ residuals[k:] / n for k in range(len(gamma))])
    window = gamma / plain
    u = np.arange(len(gamma)) / len(gamma)
    inner = u <= 0.5
    np.testing.assert_allclose(window[inner], (1 - 6 * u**2 + 6 * u**3)[inner], rtol=1e-6)
    np.testing.assert_allclose(window[~inner], (2 * (1 - u) ** 3)[~inner], rtol=1e-6)


@pytest.mark.parametrize("count", [400, 401])
def test_windows_beside_a_gap_see_a_step_and_no_slope(count):
    known = np.ones(count, dtype=bool)
    x = np.arange(count)
    seen = _compute_window_differences(3e-9 * x + np.where(x < 200, 0.0, 5e-6), known, 12)
    assert int(np.nanargmax(seen)) + 1 == pytest.approx(200, abs=6)
    assert np.nanmax(seen) == pytest.approx(5e-6, rel=1e-3)
    assert np.nanmedian(np.abs(seen)) < 1e-9


def test_the_gain_of_an_exact_fit_is_bounded_by_the_rounding_of_a_processor():
    # n ln((S + n e^2) / (n e^2)), S what a smooth curve of as many parameters leaves
    t = np.linspace(-1.0, 1.0, 200)
    z = np.where(t > 0.0, 4e-12, 0.0)
    nothing, terms = np.zeros((2, 200)), 2
    fit = Fit(nothing, nothing, np.zeros(2), np.zeros(200), np.ones(200, dtype=bool), 0)
    curve = np.stack([t, np.ones(200), np.cos(0.5 * np.pi * (t + 1.0))]).T
    left = z - curve @ np.linalg.lstsq(curve, z, rcond=None)[0]
    floor = 200 * LEAST_SCATTER**2
    expected = 200 * math.log((float(left @ left) + floor) / floor)
    assert _compute_likelihood_gain(t, z, fit, terms, 1.0) == pytest.approx(expected, rel=1e-9)


def test_the_middle_of_a_plateau_is_as_far_from_either_end():
    size = np.zeros(40)
    size[10:15] = [0.98, 1.0, 0.99, 0.98, 0.97]
    assert _find_plateau_middle(size, 11, 4) == 12
    assert _find_plateau_middle(size, 11, 2) == 11  # too wide for windows of that reach


def test_stray_points_at_one_end_do_not_pull_a_line():
    # one of ten points stands 0.2 um too high at one end; the others lie on a line within 1 nm
    x = np.linspace(-1.0, 1.0, 401)
    noise = np.random.default_rng(11).normal(0.0, 1e-9, x.size)
    stray = x > 0.8
    z = 3e-7 + 5e-7 * x + noise + np.where(stray, 2e-7, 0.0)
    found = fit_without_spikes(np.stack([np.ones_like(x), x]), z, np.ones(x.size, dtype=bool))
    assert found.solution == pytest.approx([3e-7, 5e-7], abs=1e-9)
    assert not found.used[stray].any()


def test_a_fit_without_residuals_gains_on_a_smooth_curve_by_the_scatter_that_counts_least():
    # n ln((S + f) / (0 + f)), where f is the least scatter squared times n
    t = np.linspace(-1.0, 1.0, 200)
    kept = np.ones(t.size, dtype=bool)
    step = np.where(t > 0.0, 1e-6, 0.0)
    fit = Fit(np.stack([np.ones_like(t), step]), np.eye(2, 200), np.zeros(2), 0.0 * t, kept, 0)
    together = _estimate_correlated_point_count(fit)
    gain = _compute_likelihood_gain(t, step, fit, 1, together)
    curve = np.stack([t, np.ones_like(t)])
    left = step - np.linalg.lstsq(curve.T, step, rcond=None)[0] @ curve
    floor = 200 * LEAST_SCATTER**2
    assert gain == pytest.approx(200 * math.log((np.sum(left**2) + floor) / floor))
    assert together == 1.0
