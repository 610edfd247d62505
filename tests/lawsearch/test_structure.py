"""Differences that no column describes: each kind has its own test, and chance passes none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from oracles.toy_model import Toy, toy_effects, toy_trials
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules, Verdict
from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.lawsearch.run_order import (
    build_wandering_errors,
    compute_jump_place_interval,
    follows_time,
)
from stepblocks.lawsearch.search import find_residual_structure, search_effects
from stepblocks.lawsearch.structure import (
    OrderedErrors,
    estimate_quantity_errors,
    find_structure_hints,
    find_two_group_hint,
    make_neighbour_correlation_hint,
)
from stepblocks.lawsearch.walk import fit_random_walk

_MODEL = Toy()


def _shifted(n: int, seed: int, shift: np.ndarray):
    """Trials of the toy whose level is another by `shift`: first by one, second by two of it."""
    trials = toy_trials(n, seed)
    trials.values[:] += shift[:, None] * np.array([1.0, 2.0])
    return trials


def _hints(trials):
    problem = build_problem(_MODEL, trials)
    return find_structure_hints(problem, fit_with_effects(problem))


def test_chance_alone_is_reported_as_nothing():
    assert [_hints(toy_trials(90, seed)) for seed in range(12)] == [()] * 12


def test_two_groups_are_reported_with_the_trials_of_each():
    second = np.random.default_rng(5).integers(0, 2, 90).astype(bool)
    (hint,) = _hints(_shifted(90, 5, 0.7 * second))
    assert (hint.kind, hint.quantity) == ("heaps", "level")
    low, high = hint.clusters
    assert sorted((*low, *high)) == list(range(90))
    assert np.mean(second[list(high)]) > 0.97
    assert np.mean(second[list(low)]) < 0.03


def test_groups_nearer_than_the_uncertainty_of_an_error_are_none():
    # what shrinks errors to a tenth of their uncertainty shrinks chance with them: a load that does
    # not scatter fell into groups a millionth apart
    values = np.concatenate([np.linspace(-1.0, 1.0, 40), np.linspace(9.0, 11.0, 20)]) * 1e-7
    rows = np.arange(60)
    hint = find_two_group_hint("load", OrderedErrors(rows, values, np.full(60, 1e-7)))
    assert hint is not None
    assert [len(group) for group in hint.clusters] == [40, 20]
    assert find_two_group_hint("load", OrderedErrors(rows, values, np.full(60, 1e-6))) is None


def test_neighbours_that_err_together_are_reported_and_no_law_is_read_off_them():
    random = np.random.default_rng(8)
    trials = _shifted(160, 8, 0.12 * np.cumsum(random.standard_normal(160)))
    found = explain(_MODEL, trials, toy_effects(), Rules(draws=150))
    assert [hint.kind for hint in found.hints] == ["neighbours"]
    assert found.findings == ()
    assert found.verdict is Verdict.UNEXPLAINED


def test_the_estimate_of_a_trial_is_what_moved_all_its_channels_alike():
    shift = np.zeros(60)
    shift[7] = 1.5
    trials = _shifted(60, 3, shift)
    problem = build_problem(_MODEL, trials)
    errors, std = estimate_quantity_errors(problem, fit_with_effects(problem))
    assert errors[7, 0] == pytest.approx(1.5, abs=0.5)
    assert np.all(std > 0.0)
    assert errors.shape == std.shape == (60, 1)


def test_the_likelihood_of_a_walk_is_that_of_its_covariance():
    n = 40
    values = np.random.default_rng(2).standard_normal(n)
    # origin: scipy's multivariate normal on n - 1 contrasts, with the covariance of a walk written
    # out
    order = np.arange(1, n + 1)
    contrast = np.linalg.svd(np.eye(n) - 1.0 / n)[2][: n - 1]

    def dense(s: float, e: float) -> float:
        own = contrast @ (s**2 * np.minimum.outer(order, order) + e**2 * np.eye(n)) @ contrast.T
        return float(multivariate_normal(np.zeros(n - 1), own).logpdf(contrast @ values))

    walk = fit_random_walk(values)
    alone = float(np.sqrt(np.var(values) * n / (n - 1)))
    assert walk.gain == pytest.approx(
        2.0 * (dense(walk.step, walk.scatter) - dense(0.0, alone)), abs=1e-6
    )


def test_the_waves_of_a_wandering_quantity_are_those_that_carry_most_of_a_walk():
    # Karhunen and Loeve: variances are the eigenvalues of the covariance of a walk about its mean
    trials = toy_trials(90, 3)
    problem = build_problem(_MODEL, trials)
    values = np.cumsum(np.random.default_rng(2).standard_normal(90))
    found = build_wandering_errors(
        problem, fit_with_effects(problem), {_MODEL.quantities[0]: values}
    )
    place = np.arange(90)
    about_mean = np.eye(90) - 1.0 / 90
    walk = about_mean @ np.minimum.outer(place, place) @ about_mean
    power = np.linalg.eigvalsh(walk)[::-1] * fit_random_walk(values).step ** 2
    assert len(found) == 23
    assert [one.std**2 for one in found] == pytest.approx(power[:23].tolist(), rel=1e-9)
    waves = np.array([one.column[:, 0] for one in found])
    np.testing.assert_allclose(waves @ waves.T, np.eye(23), atol=1e-12)


@pytest.mark.long
def test_the_place_of_a_jump_lies_in_its_interval_as_often_as_stated():
    jump = Law(
        "jump",
        "level + step from a place of z on",
        (
            Parameter("step", "1", 0.0, -9.0, 9.0, 0.1),
            Parameter("at", "1", 0.0, -1.0, 1.0, 0.05),
        ),
        lambda level, trials, own: level + own["step"] * (trials.covariates["z"] > own["at"]),
        "level",
        "z",
        ({"at": 0.0},),
        steps=("at",),
    )
    inside, widths = 0, []
    for seed in range(40):
        trials = toy_trials(60, 500 + seed)
        rise = 0.5 * (trials.covariates["z"] > 0.2)
        trials = replace(trials, values=trials.values + np.stack([rise, 2.0 * rise], axis=1))
        problem = build_problem(Toy(), trials)
        problem = problem.estimate_noise_about_fit(
            fit_with_effects(problem, [jump], {"jump.at": 0.2, "jump.step": 0.5})
        )
        fitted = fit_with_effects(problem, [jump], {"jump.at": 0.2, "jump.step": 0.5})
        low, high = compute_jump_place_interval(problem, fitted, jump, "at", trials.covariates["z"])
        inside += low <= 0.2 <= high
        widths.append(high - low)
    # origin: Hansen 2000; of 40 intervals of 95 %, 35 hold it but for one draw in a hundred
    assert inside >= 35
    assert np.median(widths) < 0.2  # of the two that z spans


def test_an_effect_follows_time_where_its_covariate_does_and_not_where_it_is_constant():
    trials = toy_trials(60, 4)
    columns = trials.covariates | {"hour": np.arange(60.0), "same": np.full(60, 3.0)}
    trials = replace(trials, covariates=columns)
    law = toy_effects()[0]
    problem = build_problem(_MODEL, trials)
    follows = {
        name: follows_time(problem, replace(law, covariate=name)) for name in ("hour", "same", "w")
    }
    assert follows == {"hour": True, "same": False, "w": False}


def test_neighbours_are_tested_by_ljung_and_box_over_five_lags():
    # trials that alternate: no walk, so that the portmanteau test alone speaks
    values = np.random.default_rng(3).standard_normal(120)
    values[1:] -= 0.4 * values[:-1]
    from_mean, n = values - values.mean(), values.size
    r = np.array([from_mean[k:] @ from_mean[: n - k] for k in range(1, 6)]) / (
        from_mean @ from_mean
    )
    # origin: Ljung and Box 1978, Q = n (n + 2) sum r_k^2 / (n - k), chi squared of five lags
    q = n * (n + 2.0) * np.sum(r**2 / (n - np.arange(1.0, 6.0)))
    assert fit_random_walk(values).gain < 1e-6
    found = make_neighbour_correlation_hint("level", values)
    assert found.p_value == pytest.approx(2.0 * chi2.sf(q, 5), rel=1e-9)


def test_a_trial_that_shows_nothing_of_a_quantity_has_no_error_and_ten_times_its_scatter():
    trials = toy_trials(60, 3)
    trials.values[11] = np.nan
    problem = build_problem(_MODEL, trials)
    errors, std = estimate_quantity_errors(problem, fit_with_effects(problem))
    assert np.isnan(errors[11, 0])
    assert np.isfinite(np.delete(errors, 11)).all()
    # closed form: nothing but the prior is known, a normal law ten times as wide as the scatter
    scatter = np.sqrt(problem.noise.scatter.quantities[0])
    assert std[11, 0] == pytest.approx(10.0 * scatter, rel=1e-9)


def test_a_quantity_wanders_where_neighbours_err_together_and_not_where_trials_fall_in_heaps():
    random = np.random.default_rng(8)
    walk = 0.12 * np.cumsum(random.standard_normal(160))
    heaps = 0.7 * random.integers(0, 2, 160)
    for shift, kind, wanders in ((walk, "neighbours", {"level"}), (heaps, "heaps", set())):
        grown = search_effects(build_problem(_MODEL, _shifted(160, 8, shift)), [], Rules(draws=20))
        structure = find_residual_structure(grown)
        assert [hint.kind for hint in structure.hints] == [kind]
        assert structure.wandering == wanders
