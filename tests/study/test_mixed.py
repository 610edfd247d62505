"""The mixed model: what it must not depend on, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.linalg import helmert

from stepblocks.errors import StudyError
from stepblocks.study.analysis.mixed import fit_mixed_model
from stepblocks.study.analysis.repeated import assess_contrast_effect

DATA = Path(__file__).parent / "data"
R = json.loads((DATA / "population.json").read_text())


def judged(seed=1, people=8, response=0.6):
    """Estimates of two blocks by `people` with two probes, three times each; participants differ in
    level and response.
    """
    generator = np.random.default_rng(seed)
    person, probe, block, _ = (index.ravel() for index in np.indices((people, 2, 2, 3)))
    y = (
        0.5 * probe
        + generator.standard_normal(people)[person]
        + generator.standard_normal(person.size)
    )
    y += response * generator.standard_normal((people, 2))[person, probe]
    return pd.DataFrame(
        {
            "y": y,
            "person": person.astype(str),
            "probe": probe.astype(str),
            "block": block.astype(str),
        }
    )


def fitted(frame):
    return fit_mixed_model(frame, "y", "probe", "person", "block")


def test_a_change_of_unit_and_of_zero_moves_the_figures_and_no_statistic():
    one, other = fitted(judged()), fitted(judged().assign(y=lambda f: f["y"] * 1e-6 + 4e-6))
    assert other.condition.f == pytest.approx(one.condition.f, rel=1e-5)
    for name in ("sd_participant", "sd_condition", "sd_residual"):
        assert getattr(other, name) == pytest.approx(getattr(one, name) * 1e-6, rel=1e-3)
    for (_, mean, error), (_, moved, same) in zip(one.means, other.means, strict=True):
        assert (moved, same) == pytest.approx((mean * 1e-6 + 4e-6, error * 1e-6), rel=1e-4)


def test_with_two_conditions_it_is_the_paired_t_test_of_the_participants_means():
    # complete data: F is the square of Student's t of the differences within participants
    from scipy.stats import ttest_rel

    frame = judged(2)
    means = frame.groupby(["person", "probe"])["y"].mean().unstack()
    t = ttest_rel(means["0"], means["1"])
    fit = fitted(frame)
    assert fit.condition.f == pytest.approx(t.statistic**2, rel=1e-4)
    (difference,) = fit.intervals
    limits = t.confidence_interval(0.95)
    assert (difference.low, difference.high) == pytest.approx((limits.low, limits.high), rel=1e-3)


def test_the_level_of_a_participant_says_nothing_about_the_probes():
    frame = judged(3)
    shifted = frame.assign(y=frame["y"] + 3.0 * frame["person"].astype(float))
    assert fitted(shifted).condition.f == pytest.approx(fitted(frame).condition.f, rel=1e-4)
    # 0, 3 ... 21 have a standard deviation of 7.3, beside which the participants' own of 1 is
    # little
    assert fitted(shifted).sd_participant == pytest.approx(7.3, abs=1.0)


def test_an_optimum_is_known_to_all_its_digits_whatever_the_last_bits_and_the_order_of_the_rows():
    # a likelihood is flat at its optimum: a line search alone knew it to half its digits, which
    # ones by chance. Of complete data the statistic at the optimum itself is Student's t squared
    from scipy.stats import ttest_rel

    frame, random = judged(5), np.random.default_rng(5)
    means = frame.groupby(["person", "probe"])["y"].mean().unstack()
    fit = fitted(frame)
    assert fit.condition.f == pytest.approx(
        ttest_rel(means["0"], means["1"]).statistic ** 2, rel=1e-10
    )
    bits = frame.assign(y=frame["y"] * (1.0 + 1e-13 * random.choice([-1.0, 1.0], len(frame))))
    for other in (fitted(bits), fitted(frame.sample(frac=1.0, random_state=5))):
        for name in ("sd_participant", "sd_condition", "sd_residual"):
            assert getattr(other, name) == pytest.approx(getattr(fit, name), rel=1e-9)
        assert other.condition.f == pytest.approx(fit.condition.f, rel=1e-9)
        assert [row[1:] for row in other.means] == [
            pytest.approx(row[1:], rel=1e-9) for row in fit.means
        ]


def test_unbalanced_data_have_the_test_and_the_pairs_of_lmertest():
    # tests/study/data/population.R on accuracy.csv with a fifth of the rows and a cell missing
    rows = pd.read_csv(DATA / "accuracy.csv", dtype={"participant": str})
    rows["y"] = rows["estimate_um"] - rows["height_um"]
    kept = (np.arange(len(rows)) * 7919) % 10 >= 2
    kept &= ~((rows["participant"] == "3") & (rows["condition"] == "soft"))
    fit = fit_mixed_model(rows[kept], "y", "condition", "participant", "stimulus")
    term = fit.condition
    # lme4 stops at a tolerance of its optimiser: five digits
    assert [term.f, term.p, term.df, term.df_error] == pytest.approx(
        R["unbalanced mixed F"], rel=5e-5
    )
    spreads = [fit.sd_condition, fit.sd_participant, fit.sd_residual]
    assert spreads == pytest.approx(R["unbalanced standard deviations"], rel=5e-5) or spreads == (
        pytest.approx([R["unbalanced standard deviations"][n] for n in (1, 0, 2)], rel=5e-5)
    )
    for one in fit.intervals:
        difference, low, high, _, df = R[f"unbalanced pair {one.first} - {one.second}"]
        reach = (high - low) / 2.0  # R's are not adjusted for the family
        assert (one.difference, one.df) == pytest.approx((difference, df), rel=5e-5)
        assert one.error * stats.t.ppf(0.975, df) == pytest.approx(reach, rel=5e-5)


def test_sphericity_and_its_correction_are_those_of_afex():
    # tests/study/data/population.R: afex::aov_ez on the participants' mean absolute errors
    rows = pd.read_csv(DATA / "accuracy.csv", dtype={"participant": str})
    rows["value"] = (rows["estimate_um"] - rows["height_um"]).abs()
    table = rows.groupby(["participant", "condition"])["value"].mean().unstack()
    term, found = assess_contrast_effect("condition", table.to_numpy(), helmert(table.shape[1]))
    w, p = R["Mauchly W, p"]
    epsilon, corrected = R["Huynh and Feldt epsilon, p"]
    assert (found.statistic, found.p) == pytest.approx((w, p), rel=1e-6)
    assert found.epsilon == pytest.approx(R["Greenhouse and Geisser epsilon, p"][0], rel=1e-6)
    assert (found.huynh_feldt, term.p) == pytest.approx((epsilon, corrected), rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(("conditions", "spread"), [(3, 1.0), (4, 1.0), (3, 6.0)])
def test_the_level_of_ten_participants_is_kept_whether_differences_vary_alike_or_not(
    conditions, spread
):
    # 4,000 studies without an effect: one standard error of a level of 0.05 is 0.0034
    random = np.random.default_rng(6)
    tables = random.standard_normal((4000, 10, conditions)) * [spread, *[1.0] * (conditions - 1)]
    found = [assess_contrast_effect("condition", own, helmert(conditions))[0].p for own in tables]
    assert 0.04 < np.mean(np.array(found) < 0.05) < 0.06


def test_of_two_conditions_there_is_nothing_to_correct():
    table = np.random.default_rng(2).standard_normal((5, 2))
    term, found = assess_contrast_effect("condition", table, helmert(2))
    assert (found.epsilon, found.huynh_feldt) == pytest.approx((1.0, 1.0))
    assert term.p == pytest.approx(stats.ttest_rel(*table.T).pvalue)


def test_a_participant_without_one_condition_stays_in_the_model():
    frame = judged()
    left = frame[(frame["person"] != "0") | (frame["probe"] != "1")]
    assert fitted(left).condition.df_error < fitted(frame).condition.df_error == pytest.approx(7.0)


def test_intervals_can_be_left_out():
    assert fit_mixed_model(judged(), "y", "probe", "person", intervals=False).intervals == ()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda f: f[f["person"] == "0"], "at least two participants, got 1"),
        (lambda f: f.assign(y=np.nan), "y must be finite in every row"),
        (lambda f: f.assign(y=2.0), "y must not be the same in all 96 rows"),
    ],
)
def test_what_carries_no_mixed_model_is_refused(damage, message):
    with pytest.raises(StudyError, match=message):
        fitted(damage(judged()))


def test_degrees_of_freedom_have_six_decimals_so_that_no_last_bit_is_written():
    frame = judged(4).drop(index=[0, 7, 31, 60])
    freedom = [one.df for one in fitted(frame).intervals]
    assert freedom
    assert [round(one, 6) for one in freedom] == freedom
    assert any(round(one, 5) != one for one in freedom)
