"""The F-test and its intervals against closed forms, and what they refuse."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from stepblocks.errors import StudyError
from stepblocks.study.analysis.anova import make_term, run_f_test


def crossed(seed, effect=0.0, each=4):
    """Two conditions by three blocks, `each` judgements per cell, normal with a spread of 1."""
    a, b, _ = (index.ravel() for index in np.indices((2, 3, each)))
    y = np.random.default_rng(seed).standard_normal(a.size) + effect * a + 0.3 * b
    return pd.DataFrame({"y": y, "a": a.astype(str), "b": b.astype(str)})


def test_with_two_groups_f_is_the_square_of_student_s_t():
    frame = crossed(1, 0.7)
    one, two = (frame.loc[frame["a"] == name, "y"] for name in "01")
    t = stats.ttest_ind(one, two)
    term = run_f_test(frame, "y", "a").terms[0]
    assert term.f == pytest.approx(t.statistic**2, rel=1e-9)
    assert term.p == pytest.approx(t.pvalue, rel=1e-9)
    (difference,) = run_f_test(frame, "y", "a").intervals
    limits = t.confidence_interval(0.95)
    assert (difference.low, difference.high) == pytest.approx((limits.low, limits.high), rel=1e-6)


def test_sums_of_squares_of_a_balanced_table_are_those_of_its_means():
    frame = crossed(2, 0.5)
    cells = frame.groupby(["a", "b"])["y"].mean().unstack()
    grand, rows, columns = cells.to_numpy().mean(), cells.mean(axis=1), cells.mean(axis=0)
    both = cells.sub(rows, axis=0).sub(columns, axis=1) + grand
    expected = [
        12 * ((rows - grand) ** 2).sum(),
        8 * ((columns - grand) ** 2).sum(),
        4 * (both.to_numpy() ** 2).sum(),
    ]
    found = run_f_test(frame, "y", "a", "b")
    assert [term.name for term in found.terms] == ["a", "b", "a:b"]
    assert [term.sum_of_squares for term in found.terms] == pytest.approx(expected, rel=1e-9)
    assert [term.df for term in found.terms] == [1, 2, 2]
    assert [term.df_error for term in found.terms] == [24 - 6] * 3


def test_a_change_of_unit_or_of_zero_moves_no_statistic():
    frame = crossed(3, 0.5)
    moved = frame.assign(y=frame["y"] * 1e-6 + 7e-4)
    for one, other in zip(
        run_f_test(frame, "y", "a", "b").terms, run_f_test(moved, "y", "a", "b").terms, strict=True
    ):
        assert (one.f, one.p, one.eta_squared) == pytest.approx(
            (other.f, other.p, other.eta_squared), rel=1e-7
        )
    (one,), (other,) = run_f_test(frame, "y", "a").intervals, run_f_test(moved, "y", "a").intervals
    assert (one.low * 1e-6, one.high * 1e-6, one.effect_size) == pytest.approx(
        (other.low, other.high, other.effect_size)
    )


def test_the_interval_of_eta_squared_is_that_of_the_noncentrality():
    # Steiger (2004): at the ends of the interval the observed F lies at the 2.5 % points of the
    # noncentral F, as far as statsmodels solves for them
    term = make_term("probe", 2.0, 45.0, 1.0, 6.5)
    low, high = (48.0 * eta / (1.0 - eta) for eta in (term.eta_low, term.eta_high))
    assert stats.ncf.sf(6.5, 2, 45, low) == pytest.approx(0.025, abs=2e-5)
    assert stats.ncf.cdf(6.5, 2, 45, high) == pytest.approx(0.025, abs=2e-5)
    assert term.eta_low < term.eta_squared < term.eta_high
    assert make_term("none", 2.0, 45.0, 1.0, 0.1).eta_low == 0.0


@pytest.mark.parametrize(
    ("damage", "factors", "message"),
    [
        (lambda f: f.assign(a="1"), ["a"], "a must have at least two levels"),
        (lambda f: f.assign(y=np.inf), ["a"], "y must be finite in every row"),
        (lambda f: f.assign(y=f["y"].where(f.index > 0)), ["a"], "y must be finite in every row"),
        (
            lambda f: f[(f["a"] == "0") | (f["b"] != "2")],
            ["a", "b"],
            "every combination of a and b",
        ),
        (lambda f: f.drop_duplicates(["a", "b"]), ["a", "b"], "the error must be estimable"),
        (lambda f: f.assign(y=f["a"].astype(float)), ["a"], "the error must be estimable"),
    ],
)
def test_what_carries_no_f_test_is_refused(damage, factors, message):
    with pytest.raises(StudyError, match=message):
        run_f_test(damage(crossed(4)), "y", *factors)
