"""The analyses agree with published results on data that nobody here made."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stepblocks.study.analysis.anova import run_f_test
from stepblocks.study.analysis.magnitudes import fit_power_law
from stepblocks.study.analysis.mixed import fit_mixed_model
from stepblocks.study.analysis.ordinal import fit_proportional_odds
from stepblocks.study.analysis.psychometric import fit_psychometric


def nist(name):
    """Data and certified F of a one-way analysis of variance, NIST Statistical Reference Datasets,
    as scipy ships them.
    """
    import scipy.stats

    path = Path(scipy.stats.__file__).parent / "tests" / "data" / "nist_anova" / name
    if not path.is_file():
        pytest.skip("this scipy comes without its tests")
    lines = path.read_text().splitlines()
    certified = next(line.split() for line in lines if line.startswith("Between"))
    data = np.array([line.split() for line in lines[60:] if line.strip()], dtype=float)
    return pd.DataFrame({"group": data[:, 0].astype(int).astype(str), "y": data[:, 1]}), certified


@pytest.mark.parametrize(
    "name", ["SiRstv.dat", "AtmWtAg.dat", "SmLs01.dat", "SmLs04.dat", "SmLs06.dat"]
)
def test_f_test_gives_the_certified_values_of_nist(name):
    frame, certified = nist(name)
    term = run_f_test(frame, "y", "group", intervals=False).terms[0]
    df, squares, _, f = (float(text) for text in certified[-4:])
    assert term.df == df
    assert term.sum_of_squares == pytest.approx(squares, rel=1e-6)
    assert term.f == pytest.approx(f, rel=1e-6)


WARPBREAKS = (
    "26 30 54 25 70 52 51 26 67 18 21 29 17 12 18 35 30 36 36 21 24 18 10 43 28 15 26 "
    "27 14 29 19 29 31 41 20 44 42 26 19 16 39 28 21 39 29 20 21 24 17 13 15 15 16 28"
)


def test_tukey_s_intervals_are_those_of_r_s_documentation():
    # R, ?TukeyHSD: TukeyHSD(aov(breaks ~ wool + tension, data = warpbreaks), "tension"), all digits
    # that R prints
    frame = pd.DataFrame(
        {
            "breaks": np.array(WARPBREAKS.split(), float),
            "wool": ["A"] * 27 + ["B"] * 27,
            "tension": (["L"] * 9 + ["M"] * 9 + ["H"] * 9) * 2,
        }
    )
    found = run_f_test(frame, "breaks", "tension", "wool", interaction=False)
    printed = {
        ("H", "L"): (-14.722222, -24.07564, -5.3688015, 0.0011218),
        ("H", "M"): (-4.722222, -14.07564, 4.6311985, 0.4474210),
        ("L", "M"): (10.0, 0.6465793, 19.35342, 0.0336262),
    }
    for one in found.intervals:
        difference, low, high, p = printed[one.first, one.second]
        assert one.difference == pytest.approx(difference, abs=5e-7)
        assert (one.low, one.high) == pytest.approx((low, high), abs=5e-6)
        assert one.p == pytest.approx(p, abs=5e-8)
    # R, ?warpbreaks: summary(aov(breaks ~ wool + tension)) prints F 3.339 and 7.537
    assert [round(term.f, 3) for term in found.terms] == [7.537, 3.339]


def test_tukey_s_intervals_are_scipy_s_where_there_is_one_factor():
    from scipy.stats import tukey_hsd

    groups = [
        [24.5, 23.5, 26.4, 27.1, 29.9],
        [28.4, 34.2, 29.5, 32.2, 30.1],
        [26.1, 28.3, 24.3, 26.2, 27.8, 25.0],
    ]
    # the example of its documentation and one value more, so that numbers differ
    other = tukey_hsd(*groups)
    limits = other.confidence_interval(0.95)
    frame = pd.DataFrame(
        [(str(i), v) for i, group in enumerate(groups) for v in group], columns=["group", "y"]
    )
    for one in run_f_test(frame, "y", "group").intervals:
        i, j = int(one.first), int(one.second)
        assert one.difference == pytest.approx(other.statistic[i, j], rel=1e-9)
        assert (one.low, one.high) == pytest.approx((limits.low[i, j], limits.high[i, j]), rel=1e-6)
        assert one.p == pytest.approx(other.pvalue[i, j], abs=1e-9)


DYESTUFF = (
    "1545 1440 1440 1520 1580 1540 1555 1490 1560 1495 1595 1550 1605 1510 1560 "
    "1445 1440 1595 1465 1545 1595 1630 1515 1635 1625 1520 1455 1450 1480 1445"
)


def test_mixed_model_gives_lme4_s_estimates_of_the_dyestuff():
    # Bates, lme4: Mixed-effects modeling with R (2010), section 1.3: lmer(Yield ~ 1 + (1 | Batch),
    # Dyestuff): REML criterion 319.65, variances 1764.05 and 2451.25, intercept 1527.50, its
    # standard error 19.38. The design is balanced, so REML has a closed form in the mean squares of
    # the analysis of variance.
    values = np.array(DYESTUFF.split(), float).reshape(6, 5)
    frame = pd.DataFrame(
        {"yield": values.ravel(), "batch": np.repeat(list("ABCDEF"), 5), "all": "all"}
    )
    fit = fit_mixed_model(frame, "yield", "all", "batch")
    within = values.var(axis=1, ddof=1).mean()
    between = values.mean(axis=1).var(ddof=1) * 5
    assert within == pytest.approx(2451.25)
    assert fit.sd_residual**2 == pytest.approx(within, rel=1e-6)
    assert fit.sd_participant**2 == pytest.approx((between - within) / 5, rel=1e-6)
    assert fit.sd_participant**2 == pytest.approx(1764.05, abs=0.005)
    _, mean, error = fit.means[0]
    assert mean == pytest.approx(1527.5, rel=1e-9)
    assert error == pytest.approx((between / 30) ** 0.5, rel=1e-6)
    assert -2 * fit.log_likelihood == pytest.approx(319.6543, abs=5e-5)  # ?lme4::Dyestuff


@pytest.mark.parametrize(
    ("response", "seed", "remarked"), [(0.8, 3, False), (0.0, 1, True), (0.0, 2, True)]
)
def test_mixed_model_gives_the_repeated_measures_f_of_statsmodels(response, seed, remarked):
    from statsmodels.stats.anova import AnovaRM

    # For complete data the two tests are one, also where a variance comes out as zero; the oracle
    # is another routine.
    generator = np.random.default_rng(seed)
    person, probe, block, _ = (i.ravel() for i in np.indices((8, 3, 2, 2)))
    y = (
        generator.standard_normal(8)[person]
        + response * generator.standard_normal((8, 3))[person, probe]
        + generator.standard_normal(96)
        + 0.4 * probe
    )
    frame = pd.DataFrame(
        {
            "y": y * 1e-6,
            "person": person.astype(str),
            "probe": probe.astype(str),
            "block": block.astype(str),
        }
    )
    fit = fit_mixed_model(frame, "y", "probe", "person", "block")
    term = fit.condition
    assert bool(fit.remarks) == remarked
    table = (
        AnovaRM(frame.assign(y=y), "y", "person", within=["probe"], aggregate_func="mean")
        .fit()
        .anova_table
    )
    assert term.f == pytest.approx(table["F Value"].iloc[0], rel=1e-5)
    assert term.p == pytest.approx(table["Pr > F"].iloc[0], rel=1e-5)
    assert (term.df, term.df_error) == (2, 14)


BEETLES = (
    [1.6907, 1.7242, 1.7552, 1.7842, 1.8113, 1.8369, 1.8610, 1.8839],
    [6, 13, 18, 28, 52, 53, 61, 60],
    [59, 60, 62, 56, 63, 59, 62, 60],
)


def test_psychometric_fit_gives_the_published_probit_of_bliss_s_beetles():
    # Bliss (1935); Dobson, An Introduction to Generalized Linear Models, table 7.4 and R: probit
    # -34.935 + 19.728 x, deviance 10.12, where the best lapse rate is 0
    x, dead, total = BEETLES
    fit = fit_psychometric(np.exp(x), dead, total)
    assert 1 / fit.spread == pytest.approx(19.728, abs=5e-4)
    assert np.log(fit.threshold[0]) / fit.spread == pytest.approx(34.935, abs=5e-4)
    assert fit.deviance == pytest.approx(10.12, abs=5e-3)
    assert fit.lapse == pytest.approx(0.0, abs=1e-6)


def test_threshold_and_its_error_are_those_of_dose_p():
    # Venables and Ripley, Modern Applied Statistics with S, section 7.2, the formula of dose.p at p
    # = 1/2 of a probit: the delta method on statsmodels' own covariance; without lapses in the data
    # ours is the same statement
    import statsmodels.api as sm

    x, dead, total = (np.asarray(values, dtype=float) for values in BEETLES)
    probit = sm.families.Binomial(sm.families.links.Probit())
    glm = sm.GLM(np.column_stack([dead, total - dead]), sm.add_constant(x), family=probit).fit(
        tol=1e-14
    )
    dose = -glm.params[0] / glm.params[1]
    gradient = np.array([1.0, dose]) / glm.params[1]
    # the observed information, which ours inverts, is not the expected one of a probit, but near it
    error = np.sqrt(gradient @ np.asarray(glm.cov_params()) @ gradient)
    fit = fit_psychometric(np.exp(x), dead, total)
    assert np.log(fit.threshold[0]) == pytest.approx(dose, abs=1e-6)
    assert np.log(fit.threshold[2] / fit.threshold[1]) / 2.0 / 1.959964 == pytest.approx(
        error, rel=0.02
    )


def test_ordinal_model_gives_stata_s_ologit():
    # UCLA Statistical Consulting, Ordered logistic regression, Stata output; the data ship with
    # statsmodels' tests
    import statsmodels

    path = (
        Path(statsmodels.__file__).parent / "miscmodels" / "tests" / "results" / "ologit_ucla.csv"
    )
    if not path.is_file():
        pytest.skip("this statsmodels comes without its tests")
    frame = pd.read_csv(path)
    frame["apply"] = pd.Categorical(
        frame["apply"], ["unlikely", "somewhat likely", "very likely"], ordered=True
    )
    values, covariance, log_likelihood = fit_proportional_odds(
        frame["apply"].cat.codes, frame[["pared", "public", "gpa"]]
    )
    assert values == pytest.approx([1.047664, -0.0586828, 0.6157458], abs=1e-6)
    assert np.sqrt(np.diag(covariance)) == pytest.approx(
        [0.2657891, 0.2978588, 0.2606311], abs=1e-6
    )
    assert log_likelihood == pytest.approx(-358.51244, abs=1e-5)


def test_power_law_is_exact_on_exact_data():
    frame = pd.DataFrame(
        [(p, x, m * x**0.5) for p, m in (("1", 2.0), ("2", 7.0)) for x in (1e-5, 3e-5, 9e-5)],
        columns=["p", "x", "y"],
    )
    law = fit_power_law(frame, "y", "x", "p")
    assert (law.exponent, law.low, law.high) == pytest.approx((0.5, 0.5, 0.5), abs=1e-9)
