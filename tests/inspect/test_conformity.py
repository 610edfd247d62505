"""ISO 14253-1 at its limits, and the risk it leaves to the user, by Monte Carlo."""

import math

import numpy as np
import pytest

from stepblocks.errors import MetrologyError
from stepblocks.inspect.conformity import Outcome, decide_conformity
from stepblocks.parts.tolerance import GUARD_FACTOR

LOWER, UPPER, U = 9.0e-6, 11.0e-6, 0.1e-6
G = GUARD_FACTOR * U


@pytest.mark.parametrize(
    ("value", "verdict"),
    [
        (10.0e-6, Outcome.CONFORMS),
        (UPPER - G - 1e-12, Outcome.CONFORMS),
        (UPPER - G + 1e-12, Outcome.NOT_PROVEN),
        (UPPER, Outcome.NOT_PROVEN),
        (UPPER + G - 1e-12, Outcome.NOT_PROVEN),
        (UPPER + G + 1e-12, Outcome.DOES_NOT_CONFORM),
        (LOWER + G + 1e-12, Outcome.CONFORMS),
        (LOWER + G - 1e-12, Outcome.NOT_PROVEN),
        (LOWER - G + 1e-12, Outcome.NOT_PROVEN),
        (LOWER - G - 1e-12, Outcome.DOES_NOT_CONFORM),
    ],
)
def test_the_three_outcomes_change_exactly_at_the_guard_bands(value, verdict):
    assert decide_conformity(value, U, LOWER, UPPER).verdict is verdict


def test_exit_codes_are_0_1_3():
    assert [verdict.exit_code for verdict in Outcome] == [0, 1, 3]


def test_a_tolerance_narrower_than_two_guard_bands_can_never_be_proven():
    values = np.linspace(9.5e-6, 10.5e-6, 201)
    verdicts = {decide_conformity(value, U, 9.9e-6, 10.1e-6).verdict for value in values}
    assert Outcome.CONFORMS not in verdicts
    assert Outcome.DOES_NOT_CONFORM in verdicts


def test_one_sided_limits_leave_the_other_side_open():
    assert decide_conformity(0.2e-6, 0.1e-6, upper=1e-6).verdict is Outcome.CONFORMS
    assert decide_conformity(-5.0, 0.1e-6, upper=1e-6).verdict is Outcome.CONFORMS
    assert decide_conformity(1.3e-6, 0.1e-6, upper=1e-6).verdict is Outcome.DOES_NOT_CONFORM


def test_at_the_guard_band_the_probability_of_conformity_is_95_percent():
    # one-sided normal: Phi(1.65) = 0.9505 (tables)
    assert decide_conformity(UPPER - G, U, upper=UPPER).probability == pytest.approx(
        0.9505, abs=1e-4
    )
    assert decide_conformity(UPPER, U, upper=UPPER).probability == pytest.approx(0.5)


@pytest.mark.parametrize(
    "arguments", [(math.nan, U, LOWER, UPPER), (1e-5, -U, LOWER, UPPER), (1e-5, U, UPPER, LOWER)]
)
def test_malformed_questions_are_refused(arguments):
    with pytest.raises(MetrologyError):
        decide_conformity(*arguments)


def test_no_accepted_part_lies_outside_with_more_than_5_percent():
    # the specific risk at the worst true value, right at the limit: Phi(-1.65) = 4.95 %
    random = np.random.default_rng(5)
    measured = UPPER + random.normal(0.0, U, 200_000)
    accepted = np.mean(
        [
            decide_conformity(value, U, LOWER, UPPER).verdict is Outcome.CONFORMS
            for value in measured[:20_000]
        ]
    )
    assert accepted == pytest.approx(0.0495, abs=0.005)


def test_few_degrees_of_freedom_widen_the_guard_band_so_that_the_risk_stays_5_percent():
    random = np.random.default_rng(6)
    means, stds = [], []
    for _ in range(4_000):
        sample = UPPER + random.normal(0.0, U, 4)
        means.append(sample.mean())
        stds.append(sample.std(ddof=1) / 2.0)
    accepted = [
        decide_conformity(m, s, LOWER, UPPER, dof=3).verdict is Outcome.CONFORMS
        for m, s in zip(means, stds, strict=True)
    ]
    assert np.mean(accepted) == pytest.approx(0.05, abs=0.0104)  # 1.65 alone would accept 9.9 %
    # Student's table
    assert decide_conformity(10e-6, U, LOWER, UPPER, dof=3).guard == pytest.approx(
        2.353 * U, rel=1e-3
    )
    assert decide_conformity(10e-6, U, LOWER, UPPER, dof=1e9).guard == pytest.approx(G)
