"""Fits and noise on a linear toy, where generalised least squares has a closed form."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import OptimizeResult, least_squares, minimize
from scipy.stats import multivariate_normal, norm

from oracles.toy_model import Toy, toy_effects, toy_trials
from stepblocks.errors import PipelineError
from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.lawsearch.forward_model import Floats, Systematic, Trials
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.lawsearch.noise import build_noise
from stepblocks.lawsearch.objective import HopelessFitError, Objective
from stepblocks.lawsearch.problem import Problem
from stepblocks.lawsearch.scatter import (
    Residual,
    Scatter,
    combine_least_scatter,
    compute_replicate_residual,
    estimate_scatter,
    mark_outliers,
)


def test_fit_is_generalised_least_squares() -> None:
    trials = toy_trials(80, 1)
    problem = build_problem(Toy(), trials)
    found = fit_with_effects(problem)
    # closed form: beta = (X' V^-1 X)^-1 X' V^-1 y with V of one trial
    v = problem.noise.scatter
    covariance = v.quantities[0] * np.outer([1, 2], [1, 2]) + np.diag(v.channels + 0.05**2)
    weight = np.linalg.inv(covariance)
    design = np.stack([np.array([[1.0, x], [2.0, 0.0]]) for x in trials.covariates["x"]])
    normal = np.einsum("nki,kl,nlj->ij", design, weight, design)
    right = np.einsum("nki,kl,nl->i", design, weight, trials.values)
    assert [found.values["a"], found.values["b"]] == pytest.approx(
        np.linalg.solve(normal, right).tolist(), rel=1e-6
    )
    stds = np.sqrt(np.diag(np.linalg.inv(normal)))
    assert [found.std["a"], found.std["b"]] == pytest.approx(stds.tolist(), rel=1e-4)


def test_a_fit_that_a_rival_leads_by_far_is_given_up_after_some_steps_and_no_other() -> None:
    problem = build_problem(Toy(), toy_trials(80, 1))
    bend = toy_effects()[0]
    jump = replace(bend, steps=(bend.parameters[0].name,))
    # of what is left to be gained at its end, nothing, a lead is 15 more by a factor of 0.7: 21.4;
    # where something changes at once, which a slope knows less of, by one of 0.4 at the second
    # step: 37.5
    for effect, lead, steps, steps_ahead in (
        (bend, 21.4, 0, 5),
        (jump, 37.5, 1, 2),
        (jump, 21.4, 2, 5),
    ):
        done = fit_with_effects(problem, (effect,))
        ahead, far_ahead = (
            Objective(problem, (effect,), done.criterion - part * lead) for part in (0.99, 1.01)
        )
        end = np.array([done.values[p.name] for p in ahead.parameters]) / ahead.scale
        slopes = [one.jacobian(end) for one in (*(steps * [far_ahead]), *(steps_ahead * [ahead]))]
        assert np.array_equal(slopes[0], slopes[-1])
        with pytest.raises(HopelessFitError):
            far_ahead.jacobian(end)


def test_a_fit_that_presses_on_a_bound_ends_there_with_the_least_cost_within_bounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searches = []

    def search(*arguments: Any, **options: Any) -> OptimizeResult:
        solution = least_squares(*arguments, **options)
        searches.append(solution)
        return solution

    problem = build_problem(Toy(), toy_trials(80, 1, square=3.0))
    square = toy_effects()[0]
    bounded = replace(square, parameters=(replace(square.parameters[0], high=2.0),))
    objective = Objective(problem, (bounded,))
    size = objective.names.index("square_of_z.size")
    size_at_bound = objective.bounds[1][size]

    def compute_cost(constants: Floats) -> float:
        residual = objective.residual(np.insert(constants, size, size_at_bound))
        return float(residual @ residual)

    start = np.delete(objective.start, size)
    # an independent program finds the same constants beside the bound
    least = minimize(compute_cost, start, method="Powell", options={"ftol": 1e-12})
    monkeypatch.setattr("stepblocks.lawsearch.fit.least_squares", search)
    found = fit_with_effects(problem, (bounded,))
    assert found.values["square_of_z.size"] == pytest.approx(2.0, abs=1e-4)
    assert found.cost == pytest.approx(least.fun, abs=1e-2)
    # no second search is asked for what lies beyond the bound
    assert len(searches) == 1


def test_scatter_is_split_between_the_common_quantity_and_the_channels() -> None:
    generator = np.random.default_rng(3)
    n, level, own = 4000, 0.3, 0.1
    responses = np.tile(np.array([[1.0], [2.0], [0.0]]), (n, 1, 1))
    residual = level * generator.standard_normal((n, 1)) * np.array([1.0, 2.0, 0.0])
    residual += own * generator.standard_normal((n, 3))
    found = estimate_scatter(Residual(residual, n), np.full((n, 3), 0.02), responses)
    assert np.sqrt(found.quantities[0]) == pytest.approx(level, rel=0.05)
    assert np.sqrt(found.channels + 0.02**2) == pytest.approx(own, rel=0.1)


def test_the_least_of_two_scatters_adds_up_to_no_less_than_either_saw() -> None:
    # one channel, moved by one quantity: 0.05^2 + 0.13^2 either way, split the one way and the
    # other
    splits = [
        Scatter(np.array([a**2]), np.array([b**2]), 60) for a, b in ((0.05, 0.13), (0.13, 0.05))
    ]
    found = combine_least_scatter(splits, np.ones((4, 1, 1)))
    assert found.quantities + found.channels == pytest.approx(0.05**2 + 0.13**2)
    # a channel that scatters less by one of the two estimates in all is taken from that one
    calm = combine_least_scatter(
        [splits[0], Scatter(np.array([0.01]), np.array([1e-4]), 40)], np.ones((4, 1, 1))
    )
    assert calm.quantities + calm.channels == pytest.approx(0.0101)
    assert calm.dof == 40


def test_whitened_noise_is_white_and_missing_values_vanish() -> None:
    trials = toy_trials(50, 2)
    values = trials.values.copy()
    values[::5, 1] = np.nan
    trials = replace(trials, values=values)
    responses = Toy().responses(trials, {})
    noise = build_noise(
        trials, (), responses, Scatter(np.array([0.04]), np.array([0.01, 0.01]), 50)
    )
    generator = np.random.default_rng(0)
    drawn = 0.2 * generator.standard_normal((50, 1, 3000)) * np.array([1.0, 2.0])[None, :, None]
    drawn = drawn + np.sqrt(0.01 + 0.05**2) * generator.standard_normal((50, 2, 3000))
    white = noise.whiten(np.where(trials.seen[:, :, None], drawn, np.nan)).reshape(50, 2, 3000)
    assert np.all(white[::5, 1] == 0.0)
    kept = white[np.broadcast_to(trials.seen[:, :, None], white.shape)]
    assert np.std(kept) == pytest.approx(1.0, abs=0.01)


def test_a_systematic_error_costs_no_more_than_its_prior() -> None:
    trials = toy_trials(40, 4)
    shape = np.linspace(-1.0, 1.0, 40)
    scatter = Scatter(np.array([1e-4]), np.array([1e-2, 1e-2]), 40)
    noise = build_noise(
        trials, [Systematic("first", shape, 0.5)], Toy().responses(trials, {}), scatter
    )
    residual = np.zeros((40, 2))
    residual[:, 0] = 0.5 * shape
    # a shift of one deviation: its squared distance is one, less what the noise leaves open
    assert float(np.sum(noise.whiten(residual) ** 2)) == pytest.approx(1.0, abs=0.05)


def test_a_sum_of_errors_that_trials_share_scatters_as_their_prior_says() -> None:
    # closed form: of the error z c, z of deviation s, the sum with weights w is z (w c)
    trials = toy_trials(40, 4)
    shape, weights = np.linspace(-1.0, 2.0, 40), np.random.default_rng(0).normal(size=(40, 2))
    noise = build_noise(
        trials,
        [Systematic("first", shape, 0.5)],
        Toy().responses(trials, {}),
        Scatter(np.array([1e-4]), np.array([1e-2, 1e-2]), 40),
    )
    expected = (0.5 * float(weights[:, 0] @ shape)) ** 2
    assert noise.compute_shared_variance(weights) == pytest.approx(expected)
    assert noise.compute_shared_variance(0.0 * weights) == 0.0


def test_what_trials_share_is_no_scatter_of_each() -> None:
    # an error along the run, which no covariate follows, of twenty times the scatter of a trial
    shape = np.linspace(-1.0, 1.0, 120)

    class Shared(Toy):
        def systematics(self, trials: Trials) -> list[Systematic]:
            return [Systematic("first", shape, 0.5)]

    trials = toy_trials(120, 6, scatter=1e-3, noise=0.02)
    shared = np.stack([0.4 * shape, np.zeros(120)], axis=1)
    trials = replace(trials, values=trials.values + shared)
    # what is said of it beforehand is followed, as no covariate does
    assert build_problem(Shared(), trials).noise.scatter.channels[0] < 0.01**2
    blind = build_problem(Toy(), trials)
    assert blind.noise.scatter.channels[0] > 0.15**2
    # and the next fit takes it up, with all that is known by then
    problem = replace(blind, model=Shared())
    problem = problem.estimate_noise_about_fit(fit_with_effects(problem))
    # origin: the trials were drawn with 0.02, which their own uncertainty covers
    assert problem.noise.scatter.channels[0] < 0.01**2
    assert problem.noise.subtract_shared_errors(shared) == pytest.approx(
        np.zeros((120, 2)), abs=1e-3
    )


def test_a_value_far_from_all_others_is_marked_and_no_other() -> None:
    trials = toy_trials(60, 5)
    values = trials.values.copy()
    values[17, 1] += 30.0
    marked = mark_outliers(replace(trials, values=values))
    assert np.argwhere(marked).tolist() == [[17, 1]]


def test_parameters_of_one_specimen_share_a_difference_and_fit_as_if_alone() -> None:
    class Offsets(Toy):
        def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
            extra = [
                Parameter(f"o_{b}", "1", 0.0, -5.0, 5.0, 0.1, 1.0, b) for b in ("p", "q", "r", "s")
            ]
            return (*super().parameters(trials), *extra)

        def predict(self, trials, values, effects=()):  # type: ignore[no-untyped-def]
            base = super().predict(trials, values, effects)
            shift = np.array([values.get(f"o_{b}", 0.0) for b in trials.block])
            return base + np.stack([shift, 0.0 * shift], axis=1)

    trials = toy_trials(80, 6)
    shifted = trials.values + np.stack([0.7 * (trials.block == "q"), np.zeros(80)], axis=1)
    found = fit_with_effects(build_problem(Offsets(), replace(trials, values=shifted)))
    assert found.values["o_q"] - found.values["o_p"] == pytest.approx(0.7, abs=0.12)


def test_an_effect_at_its_start_changes_nothing() -> None:
    trials = toy_trials(30, 7)
    problem = build_problem(Toy(), trials)
    base = fit_with_effects(problem)
    effects: list[Law] = toy_effects()
    values = base.values | {f"{e.id}.size": 0.0 for e in effects}
    assert np.array_equal(
        Problem(Toy(), trials, problem.noise).predict(effects, values), base.predicted
    )


def test_too_few_trials_are_refused_by_name_and_number() -> None:
    with pytest.raises(PipelineError, match="at least 12"):
        build_problem(Toy(), toy_trials(8, 1))


def test_censored_values_count_as_what_they_exceed_and_do_not_bend_the_fit() -> None:
    trials = toy_trials(400, 6, scatter=0.0, noise=0.3)
    cut, first = 1.5, trials.values[:, 0]
    values = np.stack([np.where(first > cut, np.nan, first), np.full(400, np.nan)], axis=1)
    floor = np.full((400, 2), np.nan)
    floor[first > cut, 0] = cut
    scatter = Scatter(np.zeros(1), np.zeros(2), 400)

    def fitted(limits):  # type: ignore[no-untyped-def]
        told = replace(trials, values=values, floor=limits)
        noise = build_noise(told, (), Toy().responses(told, {}), scatter)
        return fit_with_effects(Problem(Toy(), told, noise))

    # origin: Tobin's likelihood written out and minimised by another method; the truth is 1 + 2 x
    def minus_twice_log_likelihood(beta):  # type: ignore[no-untyped-def]
        ahead = beta[0] + beta[1] * trials.covariates["x"]
        seen = np.isfinite(values[:, 0])
        exceeds = norm.logsf((cut - ahead[~seen]) / 0.3)
        return np.sum(((values[seen, 0] - ahead[seen]) / 0.3) ** 2) - 2.0 * np.sum(exceeds)

    best = minimize(
        minus_twice_log_likelihood,
        [0.5, 0.5],
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-9},
    )
    found, dropped = fitted(floor), fitted(None)
    assert [found.values["a"], found.values["b"]] == pytest.approx(best.x.tolist(), abs=2e-4)
    assert found.cost == pytest.approx(best.fun, rel=1e-5)
    assert abs(found.values["b"] - 2.0) < 2.5 * found.std["b"]
    assert abs(dropped.values["b"] - 2.0) > 3.0 * dropped.std["b"]


def test_replicates_scatter_as_their_unbiased_variance_also_in_cells_of_unlike_size() -> None:
    # pairs and fours: on average over the trials each cell's square is its variance over n - 1
    sizes = [2] * 10 + [4] * 10
    cells = np.repeat(np.arange(20), sizes)
    trials = toy_trials(60, 4)
    found = compute_replicate_residual(trials, cells.tolist())
    residual, dof = found.values, found.dof
    assert dof == 60 - 20
    for j in range(2):
        variances = [np.var(trials.values[cells == one, j], ddof=1) for one in range(20)]
        expected = np.average(variances, weights=sizes) * dof / 60
        assert np.mean(residual[:, j] ** 2) == pytest.approx(expected, rel=1e-12)


def test_the_slope_of_the_cost_is_its_derivative_where_values_are_censored() -> None:
    trials = toy_trials(60, 6)
    floor = np.full((60, 2), np.nan)
    floor[::3, 0] = trials.values[::3, 0] - 0.2
    values = np.where(np.isfinite(floor), np.nan, trials.values)
    problem = build_problem(Toy(), replace(trials, values=values, floor=floor))
    objective = Objective(problem, ())
    x = objective.start + np.array([0.37, -0.21])
    for i, one in enumerate(np.eye(len(x)) * 1e-5):
        slope = (objective.residual(x + one) - objective.residual(x - one)) / 2e-5
        np.testing.assert_allclose(objective.jacobian(x)[:, i], slope, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("unit", [1.0, 1e-4])
def test_values_that_are_missing_take_no_part_in_the_scatter_of_the_others(unit: float) -> None:
    n, std = 400, 0.02 * unit
    residual = 0.1 * unit * np.random.default_rng(6).standard_normal((n, 2))
    residual[::4, 1] = np.nan
    found = estimate_scatter(Residual(residual, n - 3), np.full((n, 2), std), np.zeros((n, 2, 0)))
    # closed form: with equal uncertainties the most likely variance is the mean square, with the
    # degrees of freedom that the regression took, less that of the uncertainties
    expected = np.nanmean(residual**2, axis=0) * n / (n - 3) - std**2
    assert found.channels == pytest.approx(expected, rel=1e-4)


def test_scatter_is_where_the_likelihood_of_a_normal_is_greatest() -> None:
    random = np.random.default_rng(5)
    responses = random.normal(size=(80, 3, 2))
    residual = np.einsum("nck,nk->nc", responses, random.normal(size=(80, 2)) * [0.4, 0.1])
    residual += random.normal(size=(80, 3)) * [0.1, 0.2, 0.3]
    std = np.full((80, 3), 0.05)

    def likelihood(quantities: Floats, channels: Floats) -> float:
        return sum(
            multivariate_normal.logpdf(
                row, cov=shown @ np.diag(quantities) @ shown.T + np.diag(channels + 0.05**2)
            )
            for row, shown in zip(residual, responses, strict=True)
        )

    found = estimate_scatter(Residual(residual, 80), std, responses)
    best = likelihood(found.quantities, found.channels)
    for factor in (0.9, 1.1):
        for k in range(2):
            assert (
                likelihood(
                    found.quantities * np.where(np.arange(2) == k, factor, 1.0), found.channels
                )
                < best
            )
        for j in range(3):
            assert (
                likelihood(
                    found.quantities, found.channels * np.where(np.arange(3) == j, factor, 1.0)
                )
                < best
            )
