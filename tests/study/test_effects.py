"""Power for an effect that is stated as a length or as d, beside the noncentral t."""

import pytest
from statsmodels.stats.power import TTestPower

import stepblocks
from stepblocks.errors import StudyError
from stepblocks.study.design.simulate import Observer
from stepblocks.study.power import SimulatedStudy, simulate_difference_spread, simulate_p_value

HEIGHTS = [30e-6, 60e-6]
PROBES = ("bare", "soft")


def make_study(effect=0.0, measure="bias"):
    observer = Observer(condition_spread=2e-6)
    energies = (1e-6, 4e-6)
    return SimulatedStudy(
        12, 2, (30e-6, 60e-6), energies, (("a", 1.0), ("b", 1.0)), observer, (), measure, effect
    )


def test_a_length_is_an_effect_over_the_spread_of_the_participants():
    """Responses to two conditions differ by sqrt(2) spreads, and by the noise of their means."""
    spread = simulate_difference_spread(make_study(), 1)
    assert spread > 2e-6 * 2.0**0.5
    assert simulate_difference_spread(make_study(), 2) == pytest.approx(spread, rel=0.08)
    small = [simulate_p_value(make_study(0.0), "mixed", seed) for seed in range(8)]
    large = [simulate_p_value(make_study(3.0 * spread), "mixed", seed) for seed in range(8)]
    assert max(large) < 1e-4 < min(small)


def estimate(runs, **effect):
    table = stepblocks.study_power(
        HEIGHTS, seed=3, probes=PROBES, measure="bias", participants=(12,), runs=runs, **effect
    )
    return table.iloc[0]


@pytest.mark.long
@pytest.mark.parametrize(
    "runs",
    [40, pytest.param(600, marks=pytest.mark.long)],
)
def test_the_power_of_d_is_that_of_the_noncentral_t(runs):
    row = estimate(runs, effect_size=0.9)
    expected = TTestPower().power(0.9, 12, 0.05)
    slack = 0.02  # of the spread that is found, and of the mixed model
    assert row["low_95_ratio"] - slack <= expected <= row["high_95_ratio"] + slack


@pytest.mark.parametrize(
    ("options", "wrong"),
    [
        ({"effect": 1e-6, "effect_size": 0.5}, "as a length or as d, got both"),
        ({"effect": 1e-6, "measure": "spread"}, "which is no length, must be stated as d"),
        ({"effect": float("nan")}, "effect must be finite"),
        ({"effect_size": 0.5, "experiment": "constant", "standard": "step-030"}, "must be of bias"),
    ],
)
def test_an_effect_that_a_measure_cannot_have_is_refused(options, wrong):
    options = {"probes": PROBES, **options}
    with pytest.raises(StudyError, match=wrong):
        stepblocks.study_power(HEIGHTS, seed=1, runs=10, **options)
