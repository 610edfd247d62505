"""The ordinal model over participants: exact derivatives, a sandwich that another model gives too,
and a level that holds.
"""

import numpy as np
import pandas as pd
import pytest

from stepblocks.errors import StudyError
from stepblocks.study.analysis.ordinal import fit_ordinal_model, fit_proportional_odds


def ratings(seed, people, each, response, cuts=(-0.7, 0.8)):
    generator = np.random.default_rng(seed)
    person, on = np.repeat(np.arange(people), 2 * each), np.tile(np.repeat([0, 1], each), people)
    latent = (
        0.7 * generator.standard_normal(people)[person]
        + response * generator.standard_normal(people)[person] * on
    )
    rating = np.digitize(latent + generator.logistic(size=person.size), cuts)
    return pd.DataFrame(
        {
            "rating": rating,
            "condition": np.where(on, "on", "off"),
            "participant": person.astype(str),
        }
    )


def parts(frame):
    on = (frame["condition"] == "on").astype(float)
    return frame["rating"], pd.DataFrame({"on": on, "x": np.linspace(-1.0, 2.0, len(frame))})


def test_the_fit_is_that_of_statsmodels():
    from statsmodels.miscmodels.ordinal_model import OrderedModel

    rating, exog = parts(ratings(1, 6, 10, 0.5, (-2.0, -0.5, 0.4, 1.9)))
    values, covariance, log_likelihood = fit_proportional_odds(rating, exog)
    ordered = pd.Series(pd.Categorical(rating, ordered=True))
    other = OrderedModel(ordered, exog, distr="logit").fit(method="bfgs", disp=0, gtol=1e-6)
    assert values == pytest.approx(other.params.to_numpy()[:2], abs=1e-4)
    assert np.sqrt(np.diag(covariance)) == pytest.approx(other.bse.to_numpy()[:2], rel=1e-3)
    assert log_likelihood == pytest.approx(other.llf, abs=1e-6)


def test_with_two_categories_it_is_the_logit_of_statsmodels_with_its_clustered_errors():
    # of these ratings the most likely levels are the same for all
    import statsmodels.api as sm

    frame = ratings(2, 9, 8, 0.8, cuts=(0.2,))
    rating, exog = parts(frame)
    groups = frame["participant"].astype(int).to_numpy()
    values, covariance, _ = fit_proportional_odds(rating, exog, groups)
    logit = sm.Logit(frame["rating"], sm.add_constant(exog)).fit(
        disp=0,
        method="newton",
        tol=1e-12,
        cov_type="cluster",
        cov_kwds={"groups": groups, "use_correction": False},
    )
    assert values == pytest.approx(logit.params.to_numpy()[1:], rel=1e-6)
    ours = covariance * 8.0 / 9.0
    assert ours == pytest.approx(logit.cov_params().to_numpy()[1:, 1:], rel=1e-5)


@pytest.mark.long
def test_errors_over_participants_are_those_of_leaving_each_out():
    # jackknife of Tukey (1958): how far the estimates without each participant are apart
    rating, exog = parts(frame := ratings(7, 30, 6, 0.6))
    who = frame["participant"].astype(int).to_numpy()
    values, covariance, _ = fit_proportional_odds(rating, exog, who)
    without = []
    for one in range(30):
        kept = who != one
        others = np.unique(who[kept], return_inverse=True)[1]
        without.append(fit_proportional_odds(rating[kept], exog[kept], others)[0])
    errors = np.std(without, axis=0) * np.sqrt(29.0)
    assert np.sqrt(np.diag(covariance)) == pytest.approx(errors, rel=0.1)
    assert np.mean(without, axis=0) == pytest.approx(values, abs=0.1 * errors.min())


@pytest.mark.long
def test_few_ratings_of_each_participant_do_not_enlarge_the_odds():
    # with a free level for each participant three ratings with and without gave 1.38 for 1.2
    frames = []
    for seed in range(40):
        random = np.random.default_rng(seed)
        who, on, _ = (index.ravel() for index in np.indices((10, 2, 3)))
        latent = 1.5 * random.standard_normal(10)[who] + 1.2 * on + random.logistic(size=60)
        rating = np.clip(np.round(4.0 + latent), 1, 7)
        frames.append(pd.DataFrame({"rating": rating, "on": on, "who": who.astype(str)}))
    found = [fit_ordinal_model(one, "rating", "on", "who").effects[0].difference for one in frames]
    assert np.mean(found) == pytest.approx(1.2, abs=2.0 * np.std(found) / np.sqrt(40.0))
    assert np.mean(found) < 1.34


@pytest.mark.long
def test_the_test_over_participants_keeps_its_level_where_they_respond_differently():
    from scipy.stats import binom

    runs = 60
    found = [
        fit_ordinal_model(ratings(seed, 6, 9, 1.5), "rating", "condition", "participant")
        for seed in range(runs)
    ]
    most = binom.ppf(0.9995, runs, 0.05)
    assert sum(fit.participants.p < 0.05 for fit in found) <= most


def test_intervals_are_those_of_student_over_participants_and_the_test_is_the_same_statement():
    fit = fit_ordinal_model(ratings(4, 7, 6, 0.4), "rating", "condition", "participant")
    (effect,) = fit.effects
    assert fit.participants.statistic == pytest.approx(
        (effect.difference / effect.error) ** 2, rel=1e-9
    )
    assert (fit.participants.df, fit.participants.df_error) == (1.0, 6.0)
    # two-sided 95 % point of Student's t with 6 degrees of freedom: 2.4469 (any table)
    assert effect.high - effect.low == pytest.approx(2.0 * 2.446912 * effect.error, rel=1e-6)
    assert (effect.low < 0.0 < effect.high) == (fit.participants.p > 0.05)


def test_too_few_participants_are_refused():
    with pytest.raises(
        StudyError, match="more participants than compared conditions must have rated"
    ):
        fit_ordinal_model(
            ratings(5, 2, 12, 0.0).assign(condition=lambda f: [f"c{i % 3}" for i in range(len(f))]),
            "rating",
            "condition",
            "participant",
        )


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_ratings_that_meet_in_one_category_have_no_finite_odds(seed):
    # 2 to 4 without and 4 to 6 with: the likelihood rises with the odds for ever
    draws = np.random.default_rng(seed).integers(2, 5, (3, 2, 30)) + np.array([[0], [2]])
    who, vibration, _ = (index.ravel() for index in np.indices(draws.shape))
    frame = pd.DataFrame({"who": who.astype(str), "on": vibration, "rating": draws.ravel()})
    with pytest.raises(StudyError, match="no finite odds fit"):
        fit_ordinal_model(frame, "rating", "on", "who")


def test_each_of_several_factors_is_tested_beside_the_others_where_cells_outnumber_people():
    # twelve cells, ten people: all cells at once left an F with no degree of freedom of the error.
    # Odds of e per doubling of the amplitude, none of frequency and block.
    shape = (10, 3, 2, 2, 6)
    random, indices = np.random.default_rng(5), np.indices(shape)
    who, amplitude, frequency, block, _ = (index.ravel() for index in indices)
    latent = random.standard_normal(10)[who] + 1.0 * amplitude
    rating = np.clip(np.round(3.0 + latent + random.logistic(size=who.size)), 1, 7)
    names = np.array(["0.5", "1", "2"]), np.array(["150 Hz", "300 Hz"])
    frame = pd.DataFrame(
        {
            "participant": who.astype(str),
            "rating": rating,
            "amplitude": names[0][amplitude],
            "frequency": names[1][frequency],
            "block": block.astype(str),
        }
    )
    factors = ["amplitude", "frequency", "block"]
    fits = {
        name: fit_ordinal_model(
            frame, "rating", name, "participant", [other for other in factors if other != name]
        )
        for name in factors
    }
    loud = fits["amplitude"]
    assert (loud.participants.df, loud.participants.df_error) == (2.0, 8.0)
    assert loud.participants.p < 1e-3
    assert min(fits["frequency"].participants.p, fits["block"].participants.p) > 0.05
    found = {(one.first, one.second): one for one in loud.effects}
    for pair, logit in {("1", "0.5"): 1.0, ("2", "1"): 1.0, ("2", "0.5"): 2.0}.items():
        assert found[pair].low < logit < found[pair].high
    assert found["2", "0.5"].difference == pytest.approx(
        found["2", "1"].difference + found["1", "0.5"].difference, abs=1e-9
    )
