"""Least squares: the same values and covariances as scipy and the closed forms.

At any scale of the columns.
"""

import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from stepblocks.bench.signal.separable import (
    build_wave_columns,
    compute_chi_squared_excess,
    compute_correlation_inflation,
    compute_numeric_jacobian,
    estimate_covariance,
    fit_linear,
    fit_separable,
    propagate_std,
)

TIME = np.linspace(0.0, 0.4, 500)


def decaying(rate_scale=1.0):
    return lambda shape: np.column_stack(
        [np.ones_like(TIME), np.exp(-TIME * rate_scale / shape[0])]
    )


def noisy(seed=1, std=0.02):
    return (
        2.0
        + 3.0 * np.exp(-TIME / 0.11)
        + std * np.random.default_rng(seed).standard_normal(TIME.size)
    )


def fitted(values, start=0.05):
    return fit_separable(
        decaying(), values, np.array([start]), np.array([0.01]), np.array([1.0]), np.array([0.1])
    )


def test_a_separable_fit_is_the_fit_of_all_parameters_at_once():
    values = noisy()
    ours = fitted(values)
    # origin: scipy's curve_fit, which searches all three parameters together
    theirs, covariance = curve_fit(
        lambda t, tau, level, size: level + size * np.exp(-t / tau),
        TIME,
        values,
        p0=(0.1, 1.9, 2.9),
        xtol=1e-12,
    )
    np.testing.assert_allclose([*ours.shape, *ours.weights], theirs, rtol=1e-5)
    widening = compute_correlation_inflation(ours.residuals)
    np.testing.assert_allclose(ours.covariance, covariance * widening, rtol=2e-3)
    assert ours.get_std(1) == pytest.approx(math.sqrt(covariance[1, 1] * widening), rel=1e-3)


@pytest.mark.parametrize("start", [0.02, 0.3, 5.0])
def test_the_fit_does_not_hang_on_its_start_even_one_out_of_bounds(start):
    np.testing.assert_allclose(fitted(noisy(), start).shape, fitted(noisy()).shape, rtol=1e-5)


def test_a_constant_factor_on_the_data_scales_weights_and_leaves_the_shape():
    one, thousand = fitted(noisy()), fitted(1e3 * noisy())
    np.testing.assert_allclose(thousand.shape, one.shape, rtol=1e-7)
    np.testing.assert_allclose(thousand.weights, 1e3 * one.weights, rtol=1e-7)
    np.testing.assert_allclose(thousand.get_std(1), 1e3 * one.get_std(1), rtol=1e-5)


def test_a_linear_fit_leaves_residuals_that_no_column_explains():
    columns = np.column_stack([np.ones_like(TIME), TIME, build_wave_columns(TIME, 50.0)])
    weights, residuals = fit_linear(columns, noisy())
    np.testing.assert_allclose(columns.T @ residuals, 0.0, atol=1e-9)
    np.testing.assert_allclose(columns @ weights + residuals, noisy(), rtol=1e-12)


def test_a_wave_is_a_point_on_a_circle_that_turns_at_its_frequency():
    cosine, sine = build_wave_columns(TIME, 37.0).T
    np.testing.assert_allclose(np.hypot(cosine, sine), 1.0, rtol=1e-12)
    turned = np.unwrap(np.arctan2(sine, cosine))
    np.testing.assert_allclose(np.diff(turned) / np.diff(TIME), 2.0 * np.pi * 37.0, rtol=1e-9)


def test_the_mean_of_white_noise_is_known_to_sigma_over_root_n():
    # origin: var(mean) = s^2 / n
    values = 5e-3 * np.random.default_rng(8).standard_normal(4000)
    covariance = estimate_covariance(np.ones((4000, 1)), values - values.mean())
    assert math.sqrt(covariance[0, 0]) == pytest.approx(
        values.std(ddof=1) / math.sqrt(4000), rel=0.05
    )


def test_columns_of_very_different_size_and_an_empty_one_do_no_harm():
    columns = np.column_stack([np.ones_like(TIME), 1e9 * TIME, np.zeros_like(TIME)])
    _, residuals = fit_linear(columns[:, :2], noisy())
    covariance = estimate_covariance(columns, residuals)
    plain = estimate_covariance(columns[:, :2], residuals)
    assert covariance[2, 2] == 0.0
    np.testing.assert_allclose(covariance[:2, :2], plain, rtol=0.01)


def test_what_is_known_before_narrows_the_covariance_like_one_more_measurement():
    residuals = 1e-2 * np.random.default_rng(3).standard_normal(400)
    column, known = np.full((400, 1), 0.1), np.array([[7.0]])
    before = estimate_covariance(column, residuals)
    after = estimate_covariance(column, residuals, known)
    # origin: information adds, sum of squares 4 of the data and 49 of what is known
    assert after[0, 0] == pytest.approx(before[0, 0] * 4.0 / (4.0 + 49.0), rel=1e-9)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_correlated_residuals_widen_by_their_integrated_autocorrelation(rho):
    random = np.random.default_rng(2)
    steps = random.standard_normal(40_000)
    values = np.empty_like(steps)
    values[0] = steps[0]
    for i in range(1, steps.size):
        values[i] = rho * values[i - 1] + steps[i]
    # origin: of an autoregressive process of first order, 1 + 2 sum rho^k = (1 + rho) / (1 - rho)
    assert compute_correlation_inflation(values) == pytest.approx((1 + rho) / (1 - rho), rel=0.1)


def test_a_differenced_jacobian_stays_inside_its_bounds():
    seen = []

    def model(point):
        seen.append(point.copy())
        return np.array([point[0] ** 2, np.exp(point[1])])

    point, step = np.array([0.0, 2.0]), np.array([1e-4, 1e-4])
    found = compute_numeric_jacobian(
        model, point, step, np.array([0.0, -np.inf]), np.array([1.0, 2.0])
    )
    assert all(0.0 <= p[0] <= 1.0 and p[1] <= 2.0 for p in seen)
    np.testing.assert_allclose(found, [[0.0, 0.0], [0.0, np.exp(2.0)]], atol=1e-3)


def test_uncertainties_propagate_by_the_gradient_and_never_below_zero():
    covariance = np.array([[4.0, -1.0], [-1.0, 9.0]])
    # origin: var(x + 2 y) = 4 + 4 * 9 - 4
    assert propagate_std(np.array([1.0, 2.0]), covariance) == pytest.approx(6.0)
    assert propagate_std(np.array([1.0, 1.0]), -covariance) == 0.0


def test_the_misfit_of_white_noise_is_a_few_standard_errors_and_grows_with_a_wrong_model():
    noise = 3e-3 * np.random.default_rng(5).standard_normal(2000)
    assert abs(compute_chi_squared_excess(noise, 10, 80, 3e-3)) < 4.0
    begun_wrong = noise.copy()
    begun_wrong[:80] += 6e-3
    # origin: 80 samples with a variance of five times the noise miss it by 4 / sqrt(2 / 80)
    # standard errors
    assert compute_chi_squared_excess(begun_wrong, 10, 80, 3e-3) == pytest.approx(
        4.0 / math.sqrt(2.0 / 80.0), rel=0.3
    )
    assert compute_chi_squared_excess(noise, 10, 80, 0.0) == math.inf


def test_a_residual_twice_the_noise_misses_by_its_chi_square():
    # n - p degrees of freedom: (chi^2 / f - 1) over the standard deviation sqrt(2 / f)
    residuals = np.full(100, 6e-3)
    freedom = 100 - 10
    expected = (100 * 4.0 / freedom - 1.0) / math.sqrt(2.0 / freedom)
    assert compute_chi_squared_excess(residuals, 10, 20, 3e-3) == pytest.approx(expected, rel=1e-12)
