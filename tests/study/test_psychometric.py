"""The psychometric function: what it must not depend on, what it bounds, and what it refuses."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import ndtr

from stepblocks.errors import StudyError
from stepblocks.study.analysis.psychometric import MAX_LAPSE, fit_psychometric

LEVELS = np.geomspace(20e-6, 80e-6, 7)
EACH = 40_000
TOTALS = [EACH] * 7


def exact_hits(threshold=40e-6, spread=0.35, guess=0.0, lapse=0.0):
    """Answers as an observer of the model gives them on average, rounded to whole ones."""
    p = guess + (1.0 - guess - lapse) * ndtr(np.log(LEVELS / threshold) / spread)
    return np.round(EACH * p).astype(int)


def test_the_model_s_own_answers_give_the_model_back():
    fit = fit_psychometric(LEVELS, exact_hits(), TOTALS)
    assert (fit.threshold[0], fit.spread) == pytest.approx((40e-6, 0.35), rel=5e-3)
    assert fit.weber[0] == pytest.approx(math.expm1(0.6744897501960817 * fit.spread), rel=1e-9)
    assert fit.weber[1] < fit.weber[0] < fit.weber[2]
    assert fit.threshold[1] < 40e-6 < fit.threshold[2]
    assert fit.df == 4


def test_the_unit_of_the_levels_moves_the_threshold_alone():
    one = fit_psychometric(LEVELS, exact_hits(), TOTALS)
    other = fit_psychometric(LEVELS * 1e6, exact_hits(), TOTALS)
    assert other.threshold[0] == pytest.approx(one.threshold[0] * 1e6, rel=1e-4)
    assert (other.weber[0], other.lapse, other.deviance) == pytest.approx(
        (one.weber[0], one.lapse, one.deviance), abs=2e-4
    )


def test_answers_mirrored_about_the_threshold_mirror_the_fit():
    # levels and answers turned round in the logarithm about 40 um
    hits = exact_hits(36e-6)
    one = fit_psychometric(LEVELS, hits, TOTALS)
    other = fit_psychometric((40e-6**2 / LEVELS)[::-1], (EACH - hits)[::-1], TOTALS)
    # as far as the optimiser goes
    assert other.threshold[0] * one.threshold[0] == pytest.approx(40e-6**2, rel=1e-6)
    assert other.spread == pytest.approx(one.spread, rel=1e-5)


def test_the_lapse_rate_stays_below_its_bound():
    fit = fit_psychometric(LEVELS, exact_hits(spread=0.1, lapse=0.2, guess=0.2), TOTALS)
    assert fit.lapse == pytest.approx(MAX_LAPSE, abs=1e-6)


def test_four_times_the_trials_halve_the_interval():
    # the error of a maximum-likelihood estimate falls with the square root of the number of trials
    one = fit_psychometric(LEVELS, exact_hits(), TOTALS)
    four = fit_psychometric(LEVELS, 4 * exact_hits(), [4 * EACH] * 7)
    widths = [math.log(fit.threshold[2] / fit.threshold[1]) for fit in (one, four)]
    assert widths[0] == pytest.approx(2.0 * widths[1], rel=1e-3)  # differentiated numerically


def test_levels_without_trials_say_nothing():
    fit = fit_psychometric([*LEVELS, 1.0], [*exact_hits(), 0], [*TOTALS, 0])
    assert fit.threshold[0] == pytest.approx(
        fit_psychometric(LEVELS, exact_hits(), TOTALS).threshold[0], rel=1e-12
    )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (([1.0, 2.0], [1, 2, 3], [4, 4, 4]), "lists of one length, got 2, 3 and 3"),
        (([0.0, 2.0, 3.0], [1, 2, 3], [4, 4, 4]), "levels must be positive and finite"),
        (([1.0, 2.0, 3.0], [1, 2, 3.5], [4, 4, 4]), "hits must be whole numbers"),
        (([1.0, 2.0, 2.0], [1, 2, 3], [4, 4, 4]), "needs trials at three levels, got 2"),
        (([1.0, 2.0, 3.0, 4.0], [0, 0, 9, 9], [9] * 4), "from none to all between two levels"),
    ],
)
def test_a_malformed_table_is_refused(given, message):
    with pytest.raises(StudyError, match=message):
        fit_psychometric(*given)


def test_the_dispersion_is_pearson_s_chi_squared_over_its_degrees_of_freedom():
    hits = np.array([3, 4, 12, 19, 31, 34, 40])
    fit = fit_psychometric(LEVELS, hits, [40] * 7)
    rise = ndtr(np.log(LEVELS / fit.threshold[0]) / fit.spread)
    p = fit.lapse + (1.0 - 2.0 * fit.lapse) * rise
    # the two parameters of the curve and the lapse rate are fitted; what they could still take up
    # is next to nothing at the best fit
    squares = np.sum((hits - 40 * p) ** 2 / (40 * p * (1.0 - p)))
    assert fit.dispersion == pytest.approx(squares / (7 - 3), rel=0.02)


def test_the_fit_is_the_greatest_likelihood_that_a_search_without_slopes_finds():
    # independent: the simplex of scipy over the same model, its lapse rate within its bound
    hits = np.array([3, 4, 12, 19, 31, 34, 39])
    fit = fit_psychometric(LEVELS, hits, [40] * 7)

    def lose(point):
        lapse = np.clip(point[2], 0.0, MAX_LAPSE)
        p = lapse + (1.0 - 2.0 * lapse) * ndtr((np.log(LEVELS * 1e6) - point[0]) / point[1])
        return -np.sum(hits * np.log(p) + (40 - hits) * np.log(1.0 - p))

    found = minimize(lose, [np.log(40.0), 0.35, 0.02], method="Nelder-Mead", tol=1e-10).x
    assert fit.threshold[0] == pytest.approx(np.exp(found[0]) * 1e-6, rel=1e-4)
    assert fit.spread == pytest.approx(found[1], rel=1e-3)
    assert fit.lapse == pytest.approx(np.clip(found[2], 0.0, MAX_LAPSE), abs=1e-4)
