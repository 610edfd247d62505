"""What the design tells: shares of a claim, checks of residuals, imitators and the next trials."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from statsmodels.api import OLS, add_constant

from oracles.toy_model import Toy, toy_effects, toy_trials
from stepblocks.lawsearch import adequacy
from stepblocks.lawsearch.adequacy import (
    compare_misfit_with_replicates,
    compute_smooth_p_value,
    find_largest_gain_shares,
    fit_without_each_channel,
)
from stepblocks.lawsearch.discrimination import rank_settings
from stepblocks.lawsearch.explain import explain
from stepblocks.lawsearch.findings import Rules
from stepblocks.lawsearch.fit import build_problem, fit_with_effects
from stepblocks.lawsearch.forward_model import Floats, Trials
from stepblocks.lawsearch.identifiability import find_indistinguishable_effects
from stepblocks.lawsearch.law import ActiveEffects, Law, Parameter
from stepblocks.lawsearch.noise import build_noise
from stepblocks.lawsearch.scatter import Scatter

_RULES = Rules(draws=200)


def test_what_a_constant_imitates_is_named_from_the_design_alone() -> None:
    problem = build_problem(Toy(), toy_trials(60, 4))
    outcome = find_indistinguishable_effects(problem, fit_with_effects(problem), toy_effects())
    assert outcome.imitated_by_constants == {"shift": ("a",)}


def test_the_next_trials_lie_where_the_rivals_differ_most() -> None:
    trials = toy_trials(120, 9, square=0.5)
    found = explain(Toy(), trials, toy_effects(), _RULES)
    grid = toy_trials(50, 10)
    proposal = rank_settings(found.problem, found.extended, found.nominal, grid, ("z",))
    assert proposal is not None
    difference = np.abs(grid.covariates["z"]) ** 2
    best = float(proposal.settings[0].settings["z"])
    # the nominal level sits at the mean of z^2, a third: the ends differ by 0.5 * 2/3, the middle
    # by 0.5 / 3
    assert best**2 == pytest.approx(float(difference.max()))
    gains = [one.expected_gain for one in proposal.settings]
    assert gains == sorted(gains, reverse=True)


@dataclass(frozen=True)
class Specimens(Toy):
    """A toy whose specimens have levels of their own, which are known to a tenth."""

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        own = [
            Parameter(f"off[{one}]", "1", 0.0, -10.0, 10.0, 0.1, 0.1, block=str(one))
            for one in np.unique(trials.block)
        ]
        return (*super().parameters(trials), *own)

    def predict(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        off = np.array([values[f"off[{one}]"] for one in trials.block])
        return super().predict(trials, values, effects) + np.outer(off, [1.0, 2.0])


def test_a_specimen_that_is_yet_to_be_made_tells_no_more_than_its_own_level_leaves() -> None:
    problem = build_problem(Specimens(), toy_trials(60, 9, square=0.5))
    extended, nominal = fit_with_effects(problem, toy_effects()[:1]), fit_with_effects(problem)
    # values at which the rivals differ by the law alone, as on a specimen that both know alike
    rival = replace(
        nominal, values={n: v for n, v in extended.values.items() if n in nominal.values}
    )
    at = {"x": np.zeros(1), "z": np.ones(1), "w": np.zeros(1)}
    # and one nearer: by 0.2 it differs, which two deviations of the level of a new one make up for
    near = replace(extended, values={**extended.values, "square_of_z.size": 0.3})
    known, new, never = (
        rank_settings(
            problem,
            extended,
            other,
            Trials(
                at,
                problem.trials.channels,
                np.full((1, 2), np.nan),
                np.full((1, 2), np.nan),
                np.array([block]),
            ),
            ("z",),
        )
        for block, other in (("p", rival), ("made", rival), ("made", near))
    )
    assert known is not None
    assert new is not None
    assert never is not None
    size = extended.values["square_of_z.size"]
    seen = known.settings[0].expected_gain / size**2  # of a level of one
    # origin: law and level move both channels alike: the gain falls by 1 + 0.1^2 times that of one
    assert new.settings[0].expected_gain == pytest.approx(
        size**2 * seen / (1.0 + 0.01 * seen), rel=1e-6
    )
    # many trials on the known one settle it; of the new one its level stays open
    assert known.repeats == int(np.ceil(12.0 / (size**2 * seen)))
    assert new.repeats == int(np.ceil(12.0 / (seen * (size**2 - 0.12))))
    # odds of 400 to 1 ask for 12, and (0.2 / 0.1)^2 is the most that there is
    assert never.repeats == 0


def test_the_interval_promised_after_the_next_trials_is_that_of_a_fit_with_them() -> None:
    trials, grid = toy_trials(24, 9, square=0.5), toy_trials(50, 10)
    problem = build_problem(Toy(), trials)
    law = toy_effects()[0]
    nominal, extended = fit_with_effects(problem), fit_with_effects(problem, [law])
    asked = rank_settings(problem, extended, nominal, grid, ("z",))
    assert asked is not None
    (best,) = np.flatnonzero(grid.covariates["z"] == asked.settings[0].settings["z"])
    # origin: the same least squares with these trials among the others
    new = grid.take(np.full(asked.repeats, best))
    both = Trials(
        {n: np.append(c, new.covariates[n]) for n, c in trials.covariates.items()},
        trials.channels,
        np.vstack([trials.values, new.values]),
        np.vstack([trials.std, new.std]),
        np.append(trials.block, new.block),
    )
    responses = Toy().responses(both, extended.values)
    noise = build_noise(both, (), responses, problem.noise.scatter)
    after = fit_with_effects(replace(problem, trials=both, noise=noise), [law])
    name = "square_of_z.size"
    assert asked.width_after == {
        name: pytest.approx(after.std[name] / extended.std[name], rel=1e-6)
    }
    assert 0.3 < asked.width_after[name] < 0.9


def test_settings_that_tie_are_asked_for_in_the_order_of_the_grid_whatever_the_last_bits() -> None:
    trials = toy_trials(120, 9, square=0.5)
    found = explain(Toy(), trials, toy_effects(), _RULES)
    # z = 1 and -1 are one to the square; a millionth of the gain is less than a fit knows
    for turned in (1.0, -1.0):
        z = turned * np.array([0.1, 1.0, -1.0 - 1e-9, 1.0 + 1e-9])
        grid = Trials(
            {"x": np.zeros(4), "z": z, "w": np.zeros(4)},
            trials.channels,
            np.full((4, 2), np.nan),
            np.full((4, 2), np.nan),
            np.full(4, "p"),
        )
        rivals = found.extended, found.nominal
        proposal = rank_settings(found.problem, *rivals, grid, ("z",))
        assert proposal is not None
        assert [one.settings["z"] for one in proposal.settings] == z[[1, 2, 3, 0]].tolist()


def test_pure_error_is_the_scatter_among_replicates() -> None:
    generator = np.random.default_rng(11)
    cells = [i // 4 for i in range(400)]
    noise = generator.normal(0.0, 0.2, 400)
    fine = compare_misfit_with_replicates(noise, cells, constant_count=1)
    assert fine.replicate_std == pytest.approx(0.2, rel=0.1)
    assert fine.lack_of_fit_p_value > 0.01
    assert (
        compare_misfit_with_replicates(
            noise + 0.3 * np.sin(np.array(cells)), cells, constant_count=1
        ).lack_of_fit_p_value
        < 1e-6
    )
    assert np.isnan(
        compare_misfit_with_replicates(
            noise[:4], [0, 1, 2, 3], constant_count=1
        ).lack_of_fit_p_value
    )


def test_a_condition_that_never_changes_has_no_smooth_though_its_scatter_is_a_rounded_zero():
    load = np.full(20, 0.4)  # their mean is 0.4 and 5e-17
    trials = Trials(
        {"load_n": load}, ("energy",), np.zeros((20, 1)), np.ones((20, 1)), np.array(["a"] * 20)
    )
    assert adequacy.build_smooth_columns(trials, "load_n") is None
    changed = np.where(np.arange(20) < 10, 0.4, 0.5)
    assert adequacy.build_smooth_columns(
        replace(trials, covariates={"load_n": changed}), "load_n"
    ).shape == (
        20,
        1,
    )


def test_what_columns_explain_of_a_residual_is_judged_as_in_a_regression_at_any_mean() -> None:
    # origin: the F-test of ordinary least squares in statsmodels
    random = np.random.default_rng(3)
    columns = random.standard_normal((60, 3))
    residual = 5.0 + 0.3 * columns[:, 1] + random.standard_normal(60)
    ours = compute_smooth_p_value(residual, columns)
    assert ours == pytest.approx(OLS(residual, add_constant(columns)).fit().f_pvalue, rel=1e-9)
    assert compute_smooth_p_value(residual - 9.0, columns) == pytest.approx(ours, rel=1e-9)


def test_the_constant_that_imitates_an_effect_most_is_named_first() -> None:
    def apply(level: Floats, trials: Trials, own: Mapping[str, float]) -> Floats:
        return level + own["size"] * (1.0 + trials.covariates["x"])

    size = Parameter("size", "1", 0.0, -10.0, 10.0, 0.1)
    trials = toy_trials(60, 4)
    trials.values[:, 1] = np.nan
    problem = build_problem(Toy(), trials)
    lean = Law("lean", "s (1 + x)", (size,), apply, "level", "x")
    outcome = find_indistinguishable_effects(problem, fit_with_effects(problem), [lean])
    # closed form: on the first channel 1 + x is one column of a and one of b, and that of ones is
    # longer than that of x, which lies within one of zero
    assert outcome.imitated_by_constants == {"lean": ("a", "b")}


@dataclass(frozen=True)
class Gauge(Toy):
    """A toy whose effects change what is shown and not the level, which is known beforehand."""

    known: float = float("inf")

    def parameters(self, trials: Trials) -> tuple[Parameter, ...]:
        level, slope = super().parameters(trials)
        return replace(level, prior_std=self.known), slope

    def predict(
        self, trials: Trials, values: Mapping[str, float], effects: ActiveEffects = ()
    ) -> Floats:
        shown = super().predict(trials, values)
        for effect, own in effects:
            shown = effect.apply(shown, trials, own)
        return shown


def _law_of(pattern: Floats) -> Law:
    def apply(shown: Floats, _: Trials, own: Mapping[str, float]) -> Floats:
        return shown + own["size"] * pattern

    return Law("shown", "", (Parameter("size", "1", 0.0, -10.0, 10.0, 0.1),), apply, "sensor")


@pytest.mark.parametrize("seen_by", [0, 1])
def test_the_channel_that_an_effect_moves_carries_it_whatever_the_order_of_channels(
    seen_by: int,
) -> None:
    # both channels share nearly all of their scatter, so that what one alone shows is told by
    # their difference; without the one that moved the law changes nothing, and all is lost
    trials, moved = toy_trials(80, 1), np.zeros((80, 2))
    moved[:, seen_by] = 0.2 * (-1.0) ** np.arange(80)
    moved[7, seen_by] = 0.9
    problem = build_problem(Gauge(), trials)
    fitted = fit_with_effects(problem)
    problem = replace(
        problem,
        trials=replace(trials, values=fitted.predicted + moved),
        noise=build_noise(
            trials,
            (),
            Toy().responses(trials, {}),
            Scatter(np.array([0.04]), np.array([1e-4, 1e-4]), 80),
        ),
    )
    current = fit_with_effects(problem, [_law_of(moved)])
    without_channel = fit_without_each_channel(problem, current)
    trial, channel = find_largest_gain_shares(fit_with_effects(problem), current, without_channel)
    assert channel == (seen_by, pytest.approx(1.0))
    assert trial == (7, pytest.approx(0.81 / (0.81 + 79 * 0.04), abs=2e-3))


def test_of_what_a_certificate_says_no_trial_has_a_share() -> None:
    # the level, 1, is certified as 0.5 with 0.05; a hundred trials know it to 0.01 and draw it
    # there at a cost of nearly (0.5 / 0.05)^2, of which a law of what is shown frees it
    problem = build_problem(Gauge(known=0.05), toy_trials(120, 3))
    law = _law_of(np.tile([1.0, 2.0], (120, 1)))
    base, current = fit_with_effects(problem), fit_with_effects(problem, [law])
    assert base.cost - current.cost == pytest.approx(100.0, rel=0.1)
    without_channel = fit_without_each_channel(problem, current)
    (_, of_trial), (_, of_channel) = find_largest_gain_shares(base, current, without_channel)
    assert of_trial < 0.03
    # the level is seen in both channels
    assert of_channel < 0.5
